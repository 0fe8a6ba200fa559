"""What `rfafe` and `rfafe_airframe` share: the discretised estimator with its trim and its dropouts.

    s+ = Phi s + Gu u + Gy0 y + Gy1 y+,  f_hat = S s + Sy y+ + Su u,  s = [z, v]  (rfafe_discrete)  [Sun13] (2), (28)

y and u are deviations from trim in the units of the design; `PARAMS` holds the matrices at their largest size with the
sizes in use. The trim is what `PARAMS` says plus what is learned from the first `n_trim` samples, for the outputs that
`learn` marks: a flight point, rigging and tolerances need no table then, but the start must be steady. A missing
sample stops the estimator: f_hat is held and flagged. It restarts from the next complete sample with its estimate
kept in the integral, and is trusted again after `t_settle`.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from actuators.block import kernel
from actuators.constants import RAD_PER_DEG
from fdi.common.decision import usable
from fdi.common.why import BANK, BOX_ALPHA, LOST_SENSOR, NOT_READY, RATE, VALID
from fdi.rfafe import correction
from fdi.rfafe import decision as rfafe_decision

AIRFRAME = 4  # outputs of the airframe, before those of elevators
NS, NY, NU, NF = 12, 8, 2, 2  # largest sizes: estimator state, outputs, inputs, faults
TAU_AHEAD = 2.0  # memory of a command beyond the rate limit: two periods of 1 Hz [s]
N_TRIM, T_TRIM = 40.0, 0.2  # to learn the trim: samples that leave a sixth of the sensors' noise, and motion [s]
NL = 72  # longest delay of the input [ticks]: the actuator's lag beyond first order and the sensors', at 2 kHz

AIRFRAME_INPUTS = [
    ("tas", "f8", "m/s"), ("tas_valid", "f8", "-"),  # true airspeed
    ("alpha", "f8", "rad"), ("alpha_valid", "f8", "-"),  # angle of attack
    ("q", "f8", "rad/s"), ("q_valid", "f8", "-"),  # pitch rate
    ("theta", "f8", "rad"), ("theta_valid", "f8", "-"),  # pitch angle
]
PARAMS = [
    ("ns", "f8"), ("ny", "f8"), ("nu", "f8"), ("nf", "f8"),  # sizes in use
    ("Phi", "f8", (NS, NS)), ("Gu", "f8", (NS, NU)), ("Gy0", "f8", (NS, NY)), ("Gy1", "f8", (NS, NY)),
    ("S", "f8", (NF, NS)), ("Sy", "f8", (NF, NY)), ("Su", "f8", (NF, NU)),
    ("Z0", "f8", (NS, NY)),      # state from a sample: z = C^+ y - H y
    ("Z0u", "f8", (NS, NU)),     # and from the input that goes with it
    ("alpha", "f8", "1/s"),      # v = f_hat / alpha restarts the integral
    ("y_trim", "f8", (NY,)),     # [design units]
    ("u_trim", "f8", (NU,)),
    ("n_trim", "f8", "-"),       # samples from which the rest of the trim is learned
    ("learn", "f8", (NY,)),      # 1 where an output's trim is learned
    ("u_delay", "f8", (NU,)),    # ticks by which u is delayed to match actuator and sensors, 0..NL-1
    ("act_a", "f8", (NU,), "1/s"),  # lag of each actuator's model
    ("act_rate", "f8"),          # its rate limit [design units/s], 0 for none
    ("ahead_max", "f8", "deg"),  # mean command beyond what the rate limit follows, above which nothing is trusted
    ("unit", "f8"),              # SI per unit of f_hat
    ("t_settle", "f8", "s"),     # after a start the estimate is not trusted
    *correction.PARAMS,
    *rfafe_decision.PARAMS,
]

STATE = [
    ("s", "f8", (NS,)), ("w", "f8", (NS,)),       # estimator state and scratch
    ("y", "f8", (NY,)), ("y_old", "f8", (NY,)),   # deviations of this sample and the last [design units]
    ("u", "f8", (NU,)), ("u_si", "f8", (NU,)), ("u_late", "f8", (NU,)),  # input now, delayed
    ("line", "f8", (NL, NU)), ("head", "f8"),     # ring of the last
    ("act", "f8", (NU,)),         # actuator's model with its rate limit, deviation [design units]
    ("ahead", "f8"),              # mean command beyond what the rate limit follows [design units]
    ("u_in", "f8", (NU,)),        # last finite input less `u_trim`
    ("rest", "f8", (NU,)),        # input at which the actuator would rest where it is
    ("y0", "f8", (NY,)), ("u0", "f8", (NU,)), ("seen", "f8"),  # learned trim, samples so far; < 0: to be left out
    ("f", "f8", (NF,), "rad"),           # estimate [SI]
    ("started", "f8", "-"),            # 1 while the estimator runs
    ("fresh", "f8", "-"),              # 0 before the first input
    ("age", "f8", "s"),           # since the start
    ("free", "f8", (NF,), "rad"),  # f less what is no fault in it: what is judged
    *correction.STATE,
    *rfafe_decision.state(NF),
    ("r", "f8", "-"), ("alarm", "f8", "-"), ("verdict", "f8", "-"), ("culprit", "f8", "-"), ("valid", "f8", "-"),
    ("why", "f8", "-"),  # code of fdi.common.why, 0 while valid
]


def fill(
    p: Any,
    design: Any,
    *,
    unit: Any,
    u_delay: Any = 0.0,
    act_a: float = 0.0,
    act_rate: float = 0.0,
    y_trim: Sequence[Any] = (),
    u_trim: Sequence[Any] = (),
    learn: Sequence[Any] = (),
    n_trim: float = 0.0,
) -> Any:
    """Write a Design into a PARAMS record; trims in design units, `unit` SI per unit of f_hat, delays in ticks.

    `u_delay` and `act_a` are one number for all inputs, or one each.
    """
    d = design.discrete
    sizes = {"ns": d.Phi.shape[0], "ny": d.Gy0.shape[1], "nu": d.Gu.shape[1], "nf": d.S.shape[0]}
    for name, limit in zip(sizes, (NS, NY, NU, NF)):
        if sizes[name] > limit:
            raise ValueError(f"{name} = {sizes[name]} is more than the block's {limit}")
        p[name] = sizes[name]
    start = np.linalg.pinv(design.C) - design.H
    matrices = {name: getattr(d, name) for name in ("Phi", "Gu", "Gy0", "Gy1", "S", "Sy", "Su")}
    for name, value in {**matrices, "Z0": start, "Z0u": -start @ design.D}.items():
        p[name][0, : value.shape[0], : value.shape[1]] = value
    p["y_trim"][0, : len(y_trim)], p["u_trim"][0, : len(u_trim)] = y_trim, u_trim
    p["learn"][0, : len(learn)], p["n_trim"] = learn, n_trim
    p["act_a"], p["act_rate"] = act_a, act_rate
    late = np.round(np.broadcast_to(u_delay, NU))
    if late.min() < 0 or late.max() > NL - 1:
        raise ValueError(f"u_delay = {u_delay} ticks; the block holds 0 to {NL - 1}")
    p["alpha"], p["unit"], p["u_delay"] = design.alpha, unit, late
    return p


def fill_stored(p: Any, design: Any, chosen: Any, dt: float, trim: Any, learn: Any) -> Any:
    """Write a stored entry into a PARAMS record for tick `dt` [s]: design, input delays, actuator.

    `trim` {tas [m/s], alpha, theta, elevator [rad]} is that of the outputs and of the input; None: those marked in
    `learn` are learned.
    """
    act, how = chosen.get("actuator", {}), {"learn": learn, "n_trim": max(N_TRIM, round(T_TRIM / dt))}
    if trim is not None:
        alpha, theta, elevator = (trim[name] / RAD_PER_DEG for name in ("alpha", "theta", "elevator"))
        outputs = [trim["tas"], alpha, 0.0, theta, *[elevator] * (len(learn) - AIRFRAME)]
        how = {"y_trim": outputs, "u_trim": [elevator] * NU}
    if "rate_deg_s" in act:
        how |= {"act_a": np.broadcast_to(act["a_rad_s"], NU), "act_rate": act["rate_deg_s"]}
    return fill(p, design, unit=RAD_PER_DEG, u_delay=np.asarray(chosen["u_delay_s"]) / dt, **how)


@kernel
def airframe_usable(u):
    """Return 1 when every airframe output has a finite, valid sample."""
    good = min(usable(u.tas, u.tas_valid), usable(u.alpha, u.alpha_valid))
    return min(good, min(usable(u.q, u.q_valid), usable(u.theta, u.theta_valid)))


@kernel
def read_airframe(x, u, p):
    """Take the airframe outputs as deviations from the trim in the units of the paper; of a lost one the last."""
    x.y[0] = u.tas - p.y_trim[0] if usable(u.tas, u.tas_valid) > 0.5 else x.y_old[0] + x.y0[0]
    x.y[1] = u.alpha / RAD_PER_DEG - p.y_trim[1] if usable(u.alpha, u.alpha_valid) > 0.5 else x.y_old[1] + x.y0[1]
    x.y[2] = u.q / RAD_PER_DEG - p.y_trim[2] if usable(u.q, u.q_valid) > 0.5 else x.y_old[2] + x.y0[2]
    x.y[3] = u.theta / RAD_PER_DEG - p.y_trim[3] if usable(u.theta, u.theta_valid) > 0.5 else x.y_old[3] + x.y0[3]


@kernel
def advance(x, p, good, dt):
    """Advance by one tick behind actuators that are lags with a rate limit; x.y holds this sample, x.u_in the input,
    less the trim of p; `good` is 0 without a sample."""
    for j in range(int(p.nu)):
        x.rest[j] = x.u_in[j]
    if not learned(x, p, good):
        return
    beyond = 0.0
    for j in range(int(p.nu)):
        x.u[j] = limited(x.u_in[j] - x.u0[j], x.act[j], p, j)
        beyond = max(beyond, math.fabs(x.u_in[j] - x.u0[j] - x.u[j]))
        x.act[j] += (1.0 - math.exp(-p.act_a[j] * dt)) * (x.u[j] - x.act[j])
        x.u_late[j] = delayed(x, p, x.u[j], j)
    x.fresh = 1.0
    turn(x)
    estimate(x, p, good, beyond, dt)


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
def delayed(x, p, u, j):
    """Store input j of this tick and return the delayed one: without a delay what was held since the last sample."""
    if x.fresh == 0.0:
        for k in range(NL):
            x.line[k, j] = u
    late = int(x.head) - 1 - int(p.u_delay[j])
    out = x.line[late + NL if late < 0 else late, j]
    x.line[int(x.head), j] = u
    return out


@kernel
def turn(x):
    """Move the ring of inputs on by a tick."""
    x.head = 0.0 if x.head >= NL - 1 else x.head + 1.0


@kernel
def estimate(x, p, good, beyond, dt):
    """Advance the estimator to this sample and judge it; x.u and x.u_late hold the inputs, `beyond` what of the command
    no actuator follows [design units]."""
    ns, ny, nu, nf = int(p.ns), int(p.ny), int(p.nu), int(p.nf)
    for i in range(ny):
        x.y[i] -= x.y0[i]
    x.ahead += (1.0 - math.exp(-dt / TAU_AHEAD)) * (beyond - x.ahead)
    if good < 0.5:
        x.started = 0.0
    elif x.started < 0.5:
        _start(x, p, ns, ny, nu, nf)
    else:
        _propagate(x, p, ns, ny, nu)
        x.age += dt
    if good > 0.5:
        for i in range(nf):
            x.f[i] = p.unit * _row(p.S[i], p.Sy[i], p.Su[i], x, ns, ny, nu)
            x.free[i] = x.f[i]
        if p.t_learn > 0.0:
            correction.correct(x, p, dt)
        for j in range(ny):
            x.y_old[j] = x.y[j]
    # a command that keeps running ahead of the rate limit makes the linear actuator's model worthless
    x.valid = 1.0 if x.started > 0.5 and x.age >= p.t_settle and x.ahead <= p.ahead_max else 0.0
    if x.banked > 0.0 and x.valid > 0.5:
        x.valid, x.why = 0.0, BANK
    elif x.taught < p.t_learn and x.valid > 0.5:
        x.valid, x.why = 0.0, NOT_READY
    elif x.steep > 0.0 and x.valid > 0.5:
        x.valid, x.why = 0.0, BOX_ALPHA
    elif x.valid > 0.5:
        x.why = VALID
    elif good > 0.5 and x.age >= p.t_settle:
        x.why = RATE
    if x.valid > 0.5:
        for j in range(nu):
            x.u_si[j] = p.unit * x.u[j]
        rfafe_decision.decide(x, p, x.free, x.u_si, nf, nu, dt)
    else:
        rfafe_decision.forget(x, p, x.free, nf, dt)


@kernel
def limited(u, act, p, j):
    """Return what of command `u` of actuator j a lag act' = a (u - act) follows at the rate limit: act -+ rate / a."""
    if p.act_rate <= 0.0:
        return u
    most = p.act_rate / p.act_a[j]
    return min(max(u, act - most), act + most)


@kernel
def _row(a, b, c, x, ns, ny, nu):
    """Return a s + b y + c u."""
    out = 0.0
    for j in range(ns):
        out += a[j] * x.s[j]
    for j in range(ny):
        out += b[j] * x.y[j]
    for j in range(nu):
        out += c[j] * x.u_late[j]
    return out


@kernel
def _start(x, p, ns, ny, nu, nf):
    """Set the state so that x_hat fits this sample and f_hat is what it was."""
    for i in range(ns):
        x.s[i] = 0.0
    for i in range(ns):
        x.w[i] = _row(x.s, p.Z0[i], p.Z0u[i], x, ns, ny, nu)
    for i in range(ns):
        x.s[i] = x.w[i]
    for i in range(nf):
        x.s[ns - nf + i] = x.f[i] / (p.unit * p.alpha)
    x.started = 1.0
    x.age = 0.0


@kernel
def _propagate(x, p, ns, ny, nu):
    """Advance [z, v] from the last sample to this one."""
    for i in range(ns):
        a = _row(p.Phi[i], p.Gy1[i], p.Gu[i], x, ns, ny, nu)
        for j in range(ny):
            a += p.Gy0[i, j] * x.y_old[j]
        x.w[i] = a
    for i in range(ns):
        x.s[i] = x.w[i]
