"""The unknown-input observer that section 5 of [Jay] announces, beside the Kalman filter, on the same flights.

    z' = F z + T B u + K y,  x_hat = z + H y,  r = y - C x_hat
    H = E (C E)^+,  T = I - H C,  F = T A - K1 C,  K = K1 + F H

as J. Chen and R. Patton design it (*Robust Model-Based Fault Diagnosis for Dynamic Systems*, 1999, chapter 3). It
exists where rank(C E) = rank(E): for the moment on the surface it does not, since no rate of a sensor feels that. The
unknown input is therefore what turns the motor beside its own torque, spring and friction together: states are motor
angle, rate and current, all three measured. Two residuals are left, blind to every load: position against integrated
rate, and current against rate and demand. A fault of the position sensor moves the first, one of the current sensor the
second, one of the rate sensor both.
"""

import functools
from typing import Any

import numpy as np
from scipy.signal import lfilter

from actuators.ema import jay
from cosim.papers.jay import flown
from cosim.papers.jay.printed import motion
from fdi.rfafe.discrete import first_order_hold

DT = jay.PERIOD
SLOW = 0.05  # pole of position against rate [1/s]: a drift of rho settles at rho / SLOW
MEAN = 1.0  # lag of the residuals [s]
START = 4.0  # what of a flight is not looked at [s]
TRAINING, MARGIN = range(101, 109), 1.3  # seeds of the flights that set the limits, and what is put on their largest
JUDGED = range(201, 205)  # seeds of fault-free flights that are judged
SENSORS = {"position": (True, False), "velocity": (True, True), "current": (False, True)}


def exists() -> tuple[int, str]:
    """Return rank(C E) with the moment on the surface as the unknown input; in the note, of what turns the motor."""
    _, B = motion(jay.values("elevator"))
    C = np.zeros((3, 6))
    C[0, 2], C[1, 3], C[2, 4] = jay.values("elevator")["lead"], 1.0, 1.0
    rank = [int(np.linalg.matrix_rank(C @ E)) for E in (B[:, 1:], np.eye(6)[:, 3:4])]
    return rank[0], f"of 1; of the torque at the motor {rank[1]} of 1"


@functools.cache
def _design() -> tuple[np.ndarray, ...]:
    """Return (Phi, Gu, Gy0, Gy1, C, H) of the observer, sampled with y linear and u held."""
    v = jay.values("elevator")
    A, B = motion(v)
    A, B, E = A[2:5, 2:5], B[2:5, :1], np.eye(3)[:, 1:2]
    C = np.diag([v["lead"], 1.0, 1.0])
    H = E @ np.linalg.pinv(C @ E)
    T = np.eye(3) - H @ C
    F = np.diag([-SLOW, -1.0 / MEAN, A[2, 2]])
    K = (T @ A - F) @ np.linalg.inv(C) + F @ H
    return *first_order_hold(F, K, T @ B, DT), C, H


def residuals(flight: Any) -> np.ndarray:
    """Return (ticks, 2): the residuals of position [m] and current [A] of a flight, lagged by MEAN."""
    Phi, Gu, G0, G1, C, H = _design()
    y = flight[[f"ema_kalman_in.{flown.LANE}.y_{n}" for n in SENSORS]].to_numpy()
    u = flight[f"ema_kalman_in.{flown.LANE}.u"].to_numpy()
    z, out = np.linalg.solve(C, y[0]) - H @ y[0], np.zeros((len(y), 3))
    for k in range(1, len(y)):
        z = Phi @ z + Gu[:, 0] * u[k - 1] + G0 @ y[k - 1] + G1 @ y[k]  # sensors are a tick late, and so is the demand
        out[k] = y[k] - C @ (z + H @ y[k])
    share = 1.0 - np.exp(-DT / MEAN)
    return lfilter([share], [1.0, share - 1.0], out[:, [0, 2]], axis=0)


@functools.cache
def _limits() -> np.ndarray:
    flights = [flown.flight("jay-incipient-position", "faults=[]", f"seed={seed}") for seed in TRAINING]
    return MARGIN * np.max([np.abs(residuals(f)[round(START / DT) :]).max(0) for f in flights], axis=0)


def named(sensor: str, unit: str) -> tuple[int, str]:
    """Return how many sizes of a sensor's incipient faults are named within 50 s by which residuals are beyond."""

    def say(flight):
        late = (np.abs(residuals(flight)) > _limits())[round(flown.ONSET / DT) :]
        when = np.flatnonzero(late.any(1))
        if not len(when):
            return False, "silent"
        end = late[min(when[0] + round(5.0 / DT), len(late) - 1)]  # what is beyond five seconds after the first
        blamed = next((s for s, pattern in SENSORS.items() if pattern == tuple(end)), "nothing")
        return blamed == sensor, f"{DT * when[0]:.1f} s{'' if blamed == sensor else f', {blamed}'}"

    return flown.each_size(sensor, unit, say)


def quiet(share: float = 1.0) -> float:
    """Return the largest residual over its limit of fault-free flights that set no limit; `share` of K_T and K_B."""
    off = [f"tolerances.ema.{name}={share}" for name in ("K_T", "K_B")] if share != 1.0 else []
    flights = [flown.flight("jay-incipient-position", "faults=[]", f"seed={seed}", *off) for seed in JUDGED]
    return float(max((np.abs(residuals(f)[round(START / DT) :]).max(0) / _limits()).max() for f in flights))
