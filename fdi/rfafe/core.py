"""What `rfafe` and `rfafe_airframe` share: the discretised estimator with its trim and its dropouts.

    s+ = Phi s + Gu u + Gy0 y + Gy1 y+,  f_hat = S s + Sy y+,  s = [z, v]  (fdi/rfafe/discrete.py)  [Sun13] (2), (28)

y and u are deviations from trim in the units of the design; `PARAMS` holds the matrices at their largest size with the
sizes in use. The trim is learned from the first `n_trim` samples, for the outputs that `learn` marks: a flight point,
rigging and tolerances need no table then, but the start must be steady. A missing sample stops the estimator: f_hat is
held and flagged. It restarts from the next complete sample with its estimate kept in the integral, and is trusted again
after `t_settle`.
"""

import math
from typing import Any

import numpy as np

from actuators.block import kernel
from actuators.constants import RAD_PER_DEG
from fdi.common.decision import delayed, held
from fdi.common.why import LOST_SENSOR, NOT_READY, RATE, VALID
from fdi.rfafe import decision as rfafe_decision

AIRFRAME = 4  # outputs of the airframe, before those of elevators
NS, NY, NU, NF = 12, 8, 2, 2  # largest sizes: estimator state, outputs, inputs, faults
TAU_AHEAD = 2.0  # memory of a command beyond the rate limit: two periods of 1 Hz [s]
N_TRIM, T_TRIM = 40.0, 0.2  # to learn the trim: samples that leave a sixth of the sensors' noise, and motion [s]
NL = 72  # of the ring of inputs [ticks]: the actuator's lag beyond first order and the sensors' at 2 kHz, 60, and more

AIRFRAME_INPUTS = [
    ("tas", "f8", "m/s"), ("tas_valid", "f8", "-"),  # true airspeed
    ("alpha", "f8", "rad"), ("alpha_valid", "f8", "-"),  # angle of attack
    ("q", "f8", "rad/s"), ("q_valid", "f8", "-"),  # pitch rate
    ("theta", "f8", "rad"), ("theta_valid", "f8", "-"),  # pitch angle
]
PARAMS = [
    ("ns", "f8"), ("ny", "f8"), ("nu", "f8"), ("nf", "f8"),  # sizes in use
    ("Phi", "f8", (NS, NS)), ("Gu", "f8", (NS, NU)), ("Gy0", "f8", (NS, NY)), ("Gy1", "f8", (NS, NY)),
    ("S", "f8", (NF, NS)), ("Sy", "f8", (NF, NY)),
    ("Z0", "f8", (NS, NY)),      # state from a sample: z = C^+ y - H y
    ("alpha", "f8", "1/s"),      # v = f_hat / alpha restarts the integral
    ("n_trim", "f8", "-"),       # samples from which the trim is learned
    ("learn", "f8", (NY,)),      # 1 where an output's trim is learned
    ("u_delay", "f8", (NU,)),    # ticks by which u is delayed to match actuator and sensors, 0..NL-2
    ("act_a", "f8", (NU,), "1/s"),  # lag of each actuator's model
    ("act_rate", "f8"),          # its rate limit [design units/s]
    ("ahead_max", "f8", "deg"),  # mean command beyond what the rate limit follows, above which nothing is trusted
    ("unit", "f8"),              # SI per unit of f_hat
    ("t_settle", "f8", "s"),     # after a start the estimate is not trusted
    *rfafe_decision.PARAMS,
]

STATE = [
    ("s", "f8", (NS,)), ("w", "f8", (NS,)),       # estimator state and scratch
    ("y", "f8", (NY,)), ("y_old", "f8", (NY,)),   # deviations of this sample and the last [design units]
    ("u", "f8", (NU,)), ("u_late", "f8", (NU,)),  # input now, delayed
    ("line", "f8", (NL, NU)), ("head", "f8"),     # ring of the last
    ("act", "f8", (NU,)),         # actuator's model with its rate limit, deviation [design units]
    ("ahead", "f8"),              # mean command beyond what the rate limit follows [design units]
    ("u_in", "f8", (NU,)),        # last finite input
    ("rest", "f8", (NU,)),        # input at which the actuator would rest where it is
    ("y0", "f8", (NY,)), ("u0", "f8", (NU,)), ("seen", "f8"),  # learned trim, samples so far; < 0: to be left out
    ("f", "f8", (NF,), "rad"),           # estimate [SI]
    ("started", "f8", "-"),            # 1 while the estimator runs
    ("fresh", "f8", "-"),              # 0 before the first input
    ("age", "f8", "s"),           # since the start
    *rfafe_decision.STATE,
    ("r", "f8", "-"), ("alarm", "f8", "-"), ("verdict", "f8", "-"), ("isolated_part", "f8", "-"), ("valid", "f8", "-"),
    ("why", "f8", "-"),  # code of fdi.common.why, 0 while valid
]


def fill(p: Any, design: Any, entry: Any, dt: float, learn: tuple[int, ...]) -> Any:
    """Write a stored entry into a PARAMS record for tick `dt` [s]: design, input delays, actuator; the trims of the
    outputs marked in `learn` are learned. Raises ValueError for a delay that the block does not hold."""
    d = design.discrete
    p["ns"], p["ny"], p["nu"], p["nf"] = len(d.Phi), d.Gy0.shape[1], d.Gu.shape[1], len(d.S)
    matrices = {name: getattr(d, name) for name in ("Phi", "Gu", "Gy0", "Gy1", "S", "Sy")}
    for name, value in {**matrices, "Z0": np.linalg.pinv(design.C) - design.H}.items():
        p[name][0, : value.shape[0], : value.shape[1]] = value
    p["learn"][0, : len(learn)], p["n_trim"] = learn, max(N_TRIM, round(T_TRIM / dt))
    p["act_a"], p["act_rate"] = entry["actuator"]["a_rad_s"], entry["actuator"]["rate_deg_s"]
    late = np.round(np.broadcast_to(entry["u_delay_s"], NU) / dt)
    if late.min() < 0 or late.max() > NL - 2:
        raise ValueError(f"u_delay = {late} ticks; the block holds 0 to {NL - 2}")
    p["alpha"], p["unit"], p["u_delay"] = design.alpha, RAD_PER_DEG, late
    return p


@kernel
def read_airframe(x, u):
    """Take the airframe outputs in the units of the paper; of a lost one the last."""
    x.y[0] = held(u.tas, u.tas_valid, x.y_old[0] + x.y0[0])
    x.y[1] = held(u.alpha / RAD_PER_DEG, u.alpha_valid, x.y_old[1] + x.y0[1])
    x.y[2] = held(u.q / RAD_PER_DEG, u.q_valid, x.y_old[2] + x.y0[2])
    x.y[3] = held(u.theta / RAD_PER_DEG, u.theta_valid, x.y_old[3] + x.y0[3])


@kernel
def advance(x, p, good, dt):
    """Advance by one tick behind actuators that are lags with a rate limit, act' = a (u - act): u within act -+ rate/a;
    x.y holds this sample, x.u_in the input; `good` is 0 without a sample."""
    for j in range(int(p.nu)):
        x.rest[j] = x.u_in[j]
    if not learned(x, p, good):
        return
    beyond = 0.0
    for j in range(int(p.nu)):
        asked, most = x.u_in[j] - x.u0[j], p.act_rate / p.act_a[j]
        x.u[j] = min(max(asked, x.act[j] - most), x.act[j] + most)
        beyond = max(beyond, math.fabs(asked - x.u[j]))
        x.act[j] += (1.0 - math.exp(-p.act_a[j] * dt)) * (x.u[j] - x.act[j])
        x.u_late[j] = sent(x, p, x.u[j], j)
    x.ahead += (1.0 - math.exp(-dt / TAU_AHEAD)) * (beyond - x.ahead)
    turn(x)
    estimate(x, p, good, dt)


@kernel
def learned(x, p, good):
    """Return whether the trim is known; until then learn it as the mean of the outputs and of the inputs at which the
    actuators would rest."""
    x.why = LOST_SENSOR if good < 0.5 else NOT_READY
    if x.seen >= p.n_trim:
        return True
    if good > 0.5:
        x.seen += 1.0
    if good > 0.5 and x.seen > 0.0:
        for i in range(int(p.ny)):
            x.y0[i] += p.learn[i] * (x.y[i] - x.y0[i]) / x.seen
        for j in range(int(p.nu)):
            x.u0[j] += (x.rest[j] - x.u0[j]) / x.seen
    return False


@kernel
def sent(x, p, u, j):
    """Store input j of this tick and return the delayed one: without a delay what was held since the last sample."""
    return delayed(x.line, int(x.head), j, u, p.u_delay[j] + 1.0, x.fresh == 0.0)


@kernel
def turn(x):
    """Move the ring of inputs on by a tick."""
    x.head, x.fresh = (x.head + 1.0) % NL, 1.0


@kernel
def estimate(x, p, good, dt):
    """Advance the estimator to this sample and judge it; x.u and x.u_late hold the inputs."""
    for i in range(int(p.ny)):
        x.y[i] -= x.y0[i]
    if good < 0.5:
        x.started = 0.0
    elif x.started < 0.5:
        _start(x, p)
    else:
        _propagate(x, p)
        x.age += dt
    if good > 0.5:
        for i in range(int(p.nf)):
            x.f[i] = p.unit * _row(p.S[i], p.Sy[i], x, p)
        for j in range(int(p.ny)):
            x.y_old[j] = x.y[j]
    if x.started > 0.5 and x.age >= p.t_settle:
        # a command that keeps running ahead of the rate limit makes the linear actuator's model worthless
        x.why = VALID if x.ahead <= p.ahead_max else RATE
    x.valid = 1.0 if x.why == VALID else 0.0
    if x.valid > 0.5:
        rfafe_decision.decide(x, p, dt)
    else:
        rfafe_decision.forget(x, p, dt)


@kernel
def _row(a, b, x, p):
    """Return a s + b y."""
    out = 0.0
    for j in range(int(p.ns)):
        out += a[j] * x.s[j]
    for j in range(int(p.ny)):
        out += b[j] * x.y[j]
    return out


@kernel
def _start(x, p):
    """Set the state so that x_hat fits this sample and f_hat is what it was."""
    n = int(p.ns - p.nf)
    for i in range(int(p.ns)):
        x.s[i] = 0.0 if i < n else x.f[i - n] / (p.unit * p.alpha)
        for j in range(int(p.ny)):
            x.s[i] += p.Z0[i, j] * x.y[j]  # whose last rows are 0
    x.started, x.age = 1.0, 0.0


@kernel
def _propagate(x, p):
    """Advance [z, v] from the last sample to this one."""
    for i in range(int(p.ns)):
        a = _row(p.Phi[i], p.Gy1[i], x, p)
        for j in range(int(p.nu)):
            a += p.Gu[i, j] * x.u_late[j]
        for j in range(int(p.ny)):
            a += p.Gy0[i, j] * x.y_old[j]
        x.w[i] = a
    for i in range(int(p.ns)):
        x.s[i] = x.w[i]
