"""Bench of one electromechanical segment: servo, actuator, sensors, load and the flight filter, closed as in flight.

The filter's estimate closes the loop once it says so. Without an aircraft: thousands of draws cost a second.
"""

import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from scipy.signal import lfilter

from actuators.block import dtype, kernel
from actuators.constants import RAD_PER_DEG
from actuators.ema import actuator as ema
from actuators.ema import jay
from actuators.ema import servo as ema_servo
from actuators.numba_intrinsics import call
from fdi.ema import ema_kalman_flight as flight

DT, BYTES = 0.005, flight.STATE.itemsize
ARM = jay.values()["arm"]
NO_LOAD = jay.LIMITS["elevator"][1] / jay.values()["K_B"]  # [rad/s]
STALL = jay.LIMITS["elevator"][0]  # [A]
SURFACE = 0.02 * RAD_PER_DEG  # noise of the surface sensor [rad]
SIGMA = (1.0, 1e-4, 0.1)  # velocity [rad/s], position [m], current [A] per sample; [Jay] section 4 as 1 sigma

TICK = dtype([
    ("command", "f8"),  # surface [rad]
    ("hm0", "f8"),      # true hinge moment pair [N m], [N m/rad]
    ("hmd", "f8"),
    ("hm0_model", "f8"),
    ("hmd_model", "f8"),
    ("n_v", "f8"),      # sensor noise and constant errors, SI
    ("n_p", "f8"),
    ("n_c", "f8"),
    ("f_v", "f8"),      # faults: added, scale, frozen; velocity and position in the loop, current in the monitor
    ("s_v", "f8"),
    ("z_v", "f8"),
    ("f_p", "f8"),
    ("s_p", "f8"),
    ("z_p", "f8"),
    ("f_c", "f8"),
    ("s_c", "f8"),
    ("z_c", "f8"),
    ("ok_v", "f8"),     # valid flags
    ("ok_p", "f8"),
    ("ok_c", "f8"),
    ("n_s", "f8"),      # surface sensor: noise, its flag [rad]
    ("ok_s", "f8"),
    ("jam", "f8"),      # faults of the actuator and of the loop's current sensor
    ("f_i", "f8"),
    ("s_i", "f8"),
    ("f_u", "f8"),      # of the drive, as in actuators.ema.actuator [A]
    ("s_u", "f8"),
    ("loss", "f8"),
    ("magnet_loss", "f8"),
    ("backlash_add", "f8"),
    ("friction_add", "f8"),
    ("f_s", "f8"),      # of the surface sensor [rad]
    ("s_s", "f8"),
    ("z_s", "f8"),
])


@kernel
def _faulty(true, noise, add, scale, frozen, last):
    return last if frozen > 0.5 else (1.0 + scale) * true + noise + add


@numba.njit(error_model="numpy")
def fly(entries, tick, px, ps, pf, x, s, f, ux, us, uf, reconfigure, log, surface):
    """Fly every tick; log: address of flight.STATE per tick; surface: true angle x1 and N x3 / l, reference, [rad].

    `entries` are the addresses of filter, servo and drive as they fly: compiled into this loop they would take 12 s.
    """
    drive, servo, own, command, measured, read = x[0], s[0], f[0], ux[0], us[0], uf[0]
    lead, arm, nothing = px[0].lead, px[0].arm, np.zeros(2).ctypes.data
    w, y, c, delta = drive.motor_d, lead * drive.motor, drive.i, drive.delta
    last_v, last_p, last_c, last_s = w, y, c, delta
    for k in range(tick.shape[0]):
        t = tick[k]
        # sensors are one tick old
        last_v = _faulty(w, t.n_v, t.f_v, t.s_v, t.z_v, last_v)
        last_p = _faulty(y, t.n_p, t.f_p, t.s_p, t.z_p, last_p)
        last_c = _faulty(c, t.n_c, t.f_c, t.s_c, t.z_c, last_c)
        last_s = _faulty(delta, t.n_s, t.f_s, t.s_s, t.z_s, last_s)
        read.y_surface = last_s if t.ok_s > 0.5 else math.nan
        read.surface_valid = t.ok_s
        w, y, c, delta = drive.motor_d, lead * drive.motor, drive.i, drive.delta
        read.u = servo.u
        read.y_velocity = last_v if t.ok_v > 0.5 else math.nan
        read.y_position = last_p if t.ok_p > 0.5 else math.nan
        read.y_current = last_c if t.ok_c > 0.5 else math.nan
        read.velocity_valid, read.position_valid, read.current_valid = t.ok_v, t.ok_p, t.ok_c
        read.hm0_model, read.hmd_model = t.hm0_model, t.hmd_model
        call(entries[0], (nothing, nothing, f.ctypes.data, uf.ctypes.data, pf.ctypes.data, DT, 1, 1, log + k * BYTES))
        measured.command = t.command
        measured.pos_meas, measured.pos_valid, measured.vel_meas = read.y_position, t.ok_p, read.y_velocity
        measured.vel_valid, measured.pos_fb, measured.pos_use = t.ok_v, own.pos_hat, own.reconf if reconfigure else 0.0
        call(entries[1], (nothing, nothing, s.ctypes.data, us.ctypes.data, ps.ctypes.data, DT, 1, 1, 0))
        surface[k, 0], surface[k, 1] = drive.delta, lead * drive.motor / arm
        surface[k, 2], surface[k, 3] = servo.r, drive.i
        command.u, command.hm0, command.hmd = servo.u, t.hm0, t.hmd
        command.jam, command.f_i, command.s_i, command.f_u, command.s_u = t.jam, t.f_i, t.s_i, t.f_u, t.s_u
        command.loss, command.magnet_loss = t.loss, t.magnet_loss
        command.backlash_add, command.friction_add = t.backlash_add, t.friction_add
        call(entries[2], (nothing, nothing, x.ctypes.data, ux.ctypes.data, px.ctypes.data, DT, 1, 1, 0))


def three_two_one_one(t: Any, *, start: float, amplitude: float = 4 * RAD_PER_DEG, unit: float = 0.5) -> Any:
    """Return the command of a 3-2-1-1 [rad] at the times `t`."""
    phase = (np.asarray(t) - start) / unit
    return amplitude * np.select([phase < 0, phase < 3, phase < 5, phase < 6, phase < 7], [0, 1, -1, 1, -1], 0)


def script(
    seconds: float,
    *,
    command: Any = 0.0,
    hm0: Any = 1500.0,
    hmd: Any = -26e3,
    factor: Any = (1.0, 1.0),
    rng: np.random.Generator | None = None,
    gust: Any = 300.0,
    sigma: Any = SIGMA,
    bias: Any = 0.0,
) -> Any:
    """Return TICK records of a healthy flight: a load with gusts [N m, 1 sigma], its model wrong by two factors."""
    n = round(seconds / DT)
    tick = np.zeros(n, TICK)
    rng = np.random.default_rng(0) if rng is None else rng
    a = math.exp(-DT / 0.3)  # gusts: first order, 0.3 s
    load = lfilter([gust * math.sqrt(1 - a * a)], [1.0, -a], rng.standard_normal(n))
    tick["command"] = command
    tick["hm0"], tick["hmd"] = hm0 + load, hmd
    tick["hm0_model"], tick["hmd_model"] = factor[0] * tick["hm0"], factor[1] * hmd
    for name, one in zip(("n_v", "n_p", "n_c"), sigma):
        tick[name] = one * rng.standard_normal(n)
    tick["n_v"] += bias
    tick["n_s"] = SURFACE * sigma[1] / SIGMA[1] * rng.standard_normal(n)
    for name in ("ok_v", "ok_p", "ok_c", "ok_s"):
        tick[name] = 1.0
    return tick


@dataclass(frozen=True)
class Flight:
    """A flown script: the filter's STATE per tick and what was true at that tick [rad, A]."""

    log: np.ndarray
    surface: np.ndarray    # x1
    screw: np.ndarray      # N x3 / l
    reference: np.ndarray  # of the servo
    current: np.ndarray

    @property
    def estimate_error(self) -> Any:
        """Return pos_hat / l less what a healthy sensor, one tick old, would read [rad], from the second tick on."""
        return self.log["pos_hat"][1:] / ARM - self.screw[:-1]


def fly_bench(tick: Any, *, tolerance: Any = None, friction: Any = 1.0, reconfigure: Any = True, p: Any = None) -> Any:
    """Return the Flight of a script; `tolerance` multiplies the actuator's symbols, `friction` its Coulomb torques."""
    px = ema.params()
    for name, value in (tolerance or {}).items():
        px[name] *= value
    px["T_c"] *= friction
    px["T_s"] *= friction
    x = ema.init_at(px, tick["command"][:1], tick["hm0"][0], tick["hmd"][0])
    ps = ema_servo.params()
    s = ema_servo.init_at(ps, px["lead"] * x["motor"], x["i"])
    pf = flight.params() if p is None else p
    f = flight.init(pf)
    ux, us, uf = np.zeros(1, ema.INPUTS), np.zeros(1, ema_servo.INPUTS), np.zeros(1, flight.INPUTS)
    out, true = np.zeros(len(tick), flight.STATE), np.zeros((len(tick), 4))
    entries = np.array([block.rollout.native.address for block in (flight, ema_servo, ema)])
    fly(entries, tick, px, ps, pf, x, s, f, ux, us, uf, bool(reconfigure), out.ctypes.data, true)
    return Flight(out, *true.T.copy())
