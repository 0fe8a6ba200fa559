"""What `rfafe` and `rfafe_airframe` share: the discretised estimator, dropouts, and the decision on its estimate.

    s+ = Phi s + Gu u + Gy0 y + Gy1 y+,  f_hat = S s + Sy y+ + Su u,  s = [z, v]  (rfafe_discrete)  [Sun13] (2), (28)

y and u are deviations from trim in the units of the design; `PARAMS` holds the matrices at their largest size with the
sizes in use. A missing sample stops the estimator: f_hat is held and flagged. It restarts from the next complete sample
with its estimate kept in the integral, and is trusted again after `t_settle`.

Decision: f_hat, smoothed and freed of its slow part, must swing beyond +threshold and -threshold in turn, `n_half`
times with at most `t_half` in between (an oscillation), or its slow part must stay beyond `th_static` for `t_static`.
"""

import math

import numpy as np

from actuators.block import kernel
from fdi.decision import confirm
from fdi.verdict import AMBIGUOUS, NONE

NS, NY, NU, NF = 12, 8, 4, 2  # largest sizes: estimator state, outputs, inputs, faults
NL = 24  # longest delay of the input [ticks]: 0.12 s at 200 Hz, an actuator's lag beyond first order and the sensors'

PARAMS = [
    ("ns", "f8"), ("ny", "f8"), ("nu", "f8"), ("nf", "f8"),  # sizes in use
    ("Phi", "f8", (NS, NS)), ("Gu", "f8", (NS, NU)), ("Gy0", "f8", (NS, NY)), ("Gy1", "f8", (NS, NY)),
    ("S", "f8", (NF, NS)), ("Sy", "f8", (NF, NY)), ("Su", "f8", (NF, NU)),
    ("R", "f8", (NY, NS)), ("Ry", "f8", (NY, NY)), ("Ru", "f8", (NY, NU)),
    ("Z0", "f8", (NS, NY)),      # state from a sample: z = C^+ y - H y
    ("Z0u", "f8", (NS, NU)),     # and from the input that goes with it
    ("alpha", "f8"),             # v = f_hat / alpha restarts the integral [1/s]
    ("y_trim", "f8", (NY,)),     # [design units]
    ("u_trim", "f8", (NU,)),
    ("u_delay", "f8"),           # ticks by which u is delayed to match actuator and sensors, 0..NL-1
    ("unit", "f8"),              # SI per unit of f_hat
    ("t_settle", "f8"),          # after a start the estimate is not trusted [s]
    ("tau_smooth", "f8"),        # two equal lags on f_hat [s]
    ("tau_slow", "f8"),          # lag of its slow part [s]
    ("threshold", "f8"),         # swing [SI unit of f_hat]
    ("n_half", "f8"),            # half periods to an alarm
    ("t_half", "f8"),            # longest half period [s]
    ("t_release", "f8"),         # without a swing for so long the alarm ends [s]
    ("th_static", "f8"),         # slow part [SI unit of f_hat]
    ("t_static", "f8"),          # [s]
]

STATE = [
    ("s", "f8", (NS,)), ("w", "f8", (NS,)),       # estimator state and scratch
    ("y", "f8", (NY,)), ("y_old", "f8", (NY,)),   # deviations of this sample and the last [design units]
    ("u", "f8", (NU,)), ("line", "f8", (NL, NU)),  # input now, and those of the last ticks
    ("res", "f8", (NY,)),         # residual y - C x_hat [design units]
    ("f", "f8", (NF,)),           # estimate [SI]
    ("started", "f8"),            # 1 while the estimator runs
    ("fresh", "f8"),              # 0 before the first input
    ("age", "f8"),                # since the start [s]
    ("lag1", "f8", (NF,)), ("lag2", "f8", (NF,)), ("slow", "f8", (NF,)),  # smoothed f_hat, its slow part [SI]
    ("side", "f8", (NF,)),        # sign of the last swing
    ("count", "f8", (NF,)),       # swings in turn
    ("since", "f8", (NF,)),       # since the last swing [s]
    ("timer", "f8"),              # confirmation of the static test [s]
    ("static", "f8"),             # its alarm
    ("r", "f8"), ("alarm", "f8"), ("verdict", "f8"), ("culprit", "f8"), ("valid", "f8"),
]


def fill(p, design, *, y_trim, u_trim, unit, u_delay=0.0):
    """Write a `Design` (or a stored one) into a PARAMS record; trims in design units, `unit` SI per unit of f_hat."""
    d = design.discrete
    sizes = {"ns": d.Phi.shape[0], "ny": d.Gy0.shape[1], "nu": d.Gu.shape[1], "nf": d.S.shape[0]}
    for name, limit in zip(sizes, (NS, NY, NU, NF)):
        if sizes[name] > limit:
            raise ValueError(f"{name} = {sizes[name]} is more than the block's {limit}")
        p[name] = sizes[name]
    start = np.linalg.pinv(design.C) - design.H
    matrices = {name: getattr(d, name) for name in ("Phi", "Gu", "Gy0", "Gy1", "S", "Sy", "Su", "R", "Ry", "Ru")}
    for name, value in {**matrices, "Z0": start, "Z0u": -start @ d.D}.items():
        p[name][0, : value.shape[0], : value.shape[1]] = value
    p["y_trim"][0, : len(y_trim)], p["u_trim"][0, : len(u_trim)] = y_trim, u_trim
    if not 0 <= u_delay <= NL - 1:
        raise ValueError(f"u_delay = {u_delay} ticks; the block holds 0 to {NL - 1}")
    p["alpha"], p["unit"], p["u_delay"] = design.alpha, unit, round(u_delay)
    return p


@kernel
def advance(x, p, good, dt):
    """Advance by one tick; x.y holds this sample, x.u this tick's input, less trim; `good` is 0 without a sample."""
    ns, ny, nu, nf = int(p.ns), int(p.ny), int(p.nu), int(p.nf)
    if x.fresh == 0.0:
        for j in range(nu):
            for k in range(NL):
                x.line[k, j] = x.u[j]
        x.fresh = 1.0
    late = int(p.u_delay)  # line[k] is the input of k + 1 ticks ago: line[0] has been held since the last sample
    if good < 0.5:
        x.started = 0.0
    elif x.started < 0.5:
        _start(x, p, ns, ny, nu, nf, late)
    else:
        _propagate(x, p, ns, ny, nu, late)
        x.age += dt
    if good > 0.5:
        for i in range(nf):
            x.f[i] = p.unit * _row(p.S[i], p.Sy[i], p.Su[i], x, ns, ny, nu, late)
        for i in range(ny):
            x.res[i] = _row(p.R[i], p.Ry[i], p.Ru[i], x, ns, ny, nu, late)
        for j in range(ny):
            x.y_old[j] = x.y[j]
    for j in range(nu):
        for k in range(NL - 1, 0, -1):
            x.line[k, j] = x.line[k - 1, j]
        x.line[0, j] = x.u[j]
    x.valid = 1.0 if x.started > 0.5 and x.age >= p.t_settle else 0.0
    decide(x, p, nf, dt)


@kernel
def _row(a, b, c, x, ns, ny, nu, late):
    """Return a s + b y + c u."""
    out = 0.0
    for j in range(ns):
        out += a[j] * x.s[j]
    for j in range(ny):
        out += b[j] * x.y[j]
    for j in range(nu):
        out += c[j] * x.line[late, j]
    return out


@kernel
def _start(x, p, ns, ny, nu, nf, late):
    """Set the state so that x_hat fits this sample and f_hat is what it was."""
    for i in range(ns):
        x.s[i] = 0.0
    for i in range(ns):
        x.w[i] = _row(x.s, p.Z0[i], p.Z0u[i], x, ns, ny, nu, late)
    for i in range(ns):
        x.s[i] = x.w[i]
    for i in range(nf):
        x.s[ns - nf + i] = x.f[i] / (p.unit * p.alpha)
    x.started = 1.0
    x.age = 0.0


@kernel
def _propagate(x, p, ns, ny, nu, late):
    """Advance [z, v] from the last sample to this one."""
    for i in range(ns):
        a = _row(p.Phi[i], p.Gy1[i], p.Gu[i], x, ns, ny, nu, late)
        for j in range(ny):
            a += p.Gy0[i, j] * x.y_old[j]
        x.w[i] = a
    for i in range(ns):
        x.s[i] = x.w[i]


@kernel
def decide(x, p, nf, dt):
    """Count swings of f_hat, watch its slow part; set r, alarm, verdict and culprit (1 + index, or 0)."""
    if x.valid < 0.5:
        for i in range(nf):  # nothing is concluded from a settling estimate, and it leaves no trace
            x.lag1[i] = x.lag2[i] = x.slow[i] = x.f[i]
            x.count[i] = x.side[i] = 0.0
        x.r = 0.0
        return
    a = 1.0 - math.exp(-dt / p.tau_smooth)
    b = 1.0 - math.exp(-dt / p.tau_slow)
    before, x.r, alarm, static, who = x.alarm, 0.0, 0.0, 0.0, 0
    for i in range(nf):
        x.lag2[i] += a * (x.lag1[i] - x.lag2[i])
        x.lag1[i] += a * (x.f[i] - x.lag1[i])
        x.slow[i] += b * (x.lag2[i] - x.slow[i])
        swing = (x.lag2[i] - x.slow[i]) / p.threshold
        x.since[i] += dt
        side = 1.0 if swing >= 1.0 else (-1.0 if swing <= -1.0 else 0.0)
        if side != 0.0 and side != x.side[i]:
            x.count[i] = x.count[i] + 1.0 if x.since[i] <= p.t_half else 1.0
            x.side[i] = side
            x.since[i] = 0.0
        if x.since[i] > p.t_release:
            x.count[i] = x.side[i] = 0.0
        if x.count[i] >= p.n_half:
            alarm, who = 1.0, i
        still = x.slow[i] / p.th_static
        static = max(static, math.fabs(still))
        if max(math.fabs(swing), math.fabs(still)) > math.fabs(x.r):
            x.r = swing if math.fabs(swing) > math.fabs(still) else still
            if alarm == 0.0:
                who = i
    x.timer, x.static = confirm(x.timer, x.static, static >= 1.0, dt, p.t_static, p.t_release)
    x.alarm = max(alarm, x.static)
    if x.alarm < 0.5:
        x.verdict, x.culprit = NONE, 0.0
    elif before < 0.5:
        # a solid OFC lacks the command that a liquid one has, a jam the oscillation: here all of it is one f_hat
        x.verdict, x.culprit = AMBIGUOUS, 1.0 + who
