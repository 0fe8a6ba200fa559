"""Which sensor of the aircraft is wrong, from kinematics alone: inertial sensors against each other and air data.

Sources: [Eykeren14] L. Van Eykeren, Q. P. Chu, Sensor fault detection and isolation for aircraft control systems by
kinematic relations, Control Engineering Practice 31 (2014); [Lu15] P. Lu, L. Van Eykeren, E. van Kampen, Q. P. Chu,
Selective-reinitialization multiple-model adaptive estimation for fault detection and diagnosis, JGCD 38 (2015). No
aerodynamic coefficient enters, so that neither a gust nor a wrong coefficient nor an actuator fault moves the inertial
rows.

| row | residual | holds between |
|---|---|---|
| phi, theta, psi | attitude less integrated body rates | p, q, r and the three attitudes |
| climb | hdot less V_g (cos a sin theta - sin a cos theta cos phi), a over the ground | hdot, theta, alpha_g |
| turn | (g cos theta cos phi - g n_z + q u - p v)' integrated against w = V_g sin a | n_z, q, alpha_g |
| speed | g (n_x - sin theta) ... integrated against u = V_g cos a | n_x, theta, V_g |
| height | inertial altitude against integrated hdot | h, hdot |
| sound | V / M, the speed of sound, against what it was | V (true airspeed), M |
| impact | CAS, M and the pressure at the baroscope's altitude | CAS, M, h_baro |
| baro | barometric against inertial altitude | h_baro, h |

A row that integrates is a first-order observer, x_hat' = f + (x - x_hat) / tau, and the innovation x - x_hat its
residual: a step of x gives a jump that dies in tau, a constant error b of f gives -b tau for good. Offsets (rotation of
the earth, gravity) are learned in the first `t_learn`. Rows that fire within `t_collect` of the first one belong to one
fault, and name the sensor: the only one whose rows contain all that fired, of which every row that must fire did, and
whose first row jumped or did not; one that gusts would hide need not fire. More than one, or none, is AMBIGUOUS.

Climb, turn and speed take the lateral velocity from the vane, which has the gusts in it: their thresholds grow with the
rms of those, as the vane has it about its mean, and with the lateral motion through which they act.

Noise and frozen readings show in the second difference of the reading alone, y_k - 2 y_k-1 + y_k-2 of variance 6
sigma^2, in which motion at the sampling rate is nothing.

What kinematics cannot tell: a drift of phi from a constant error of p, of psi from one of r. The gyro is named.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.constants import G0
from fdi.common.decision import usable
from fdi.common.record import Detector
from fdi.common.tuning import thresholds
from fdi.common.verdict import AMBIGUOUS, NONE, SENSOR
from fdi.common.why import LOST_SENSOR, NOT_READY, VALID

SENSORS = (
    "p", "q", "r", "phi", "theta", "psi", "n_x", "n_z", "hdot", "h_inertial", "h_baro", "tas", "cas", "mach",
    "alpha_ground", "v_ground", "alpha", "beta", "n_y",
)  # fmt: skip
ROWS = ("phi", "theta", "psi", "climb", "turn", "speed", "height", "sound", "impact", "baro")
NS, NR = len(SENSORS), len(ROWS)
PHI, THETA, PSI, CLIMB, TURN, SPEED, HEIGHT, SOUND, IMPACT, BARO = range(NR)
# what an error of a sensor does: sensor, rows that it must move, rows that it may move too, whether the first one jumps
# (None: either)
SIGNATURES: tuple[Any, ...] = (
    ("p", ("phi",), ("turn",), False),
    ("phi", ("phi",), ("climb", "turn"), True),
    ("q", ("theta", "turn"), ("psi", "phi"), False),
    ("theta", ("climb",), ("theta", "speed"), None),
    ("theta", ("theta",), ("climb", "speed"), True),
    ("r", ("psi",), ("theta", "phi", "speed"), False),
    ("psi", ("psi",), (), True),
    ("n_x", ("speed",), (), False),
    ("n_z", ("turn",), (), False),
    ("hdot", ("height", "climb"), ("baro",), False),
    ("h_inertial", ("height",), ("baro",), True),
    ("h_inertial", ("height", "baro"), (), None),
    ("h_baro", ("baro",), ("impact",), None),
    ("tas", ("sound",), (), None),
    ("cas", ("impact",), (), None),
    ("mach", ("sound", "impact"), (), None),
    ("alpha_ground", ("turn", "climb"), ("speed",), None),
    ("v_ground", ("speed",), ("climb", "turn"), True),
)
NC = len(SIGNATURES)
CULPRITS = ("", *SENSORS)
HIDDEN = 1.25  # of a threshold: an error that shows larger should have fired
EARTH = 6.356766e6  # radius that makes a geometric altitude one of the standard atmosphere [m]


def _table(*columns):
    return np.array([[float(any(row in c[k] for k in columns)) for row in ROWS] for c in SIGNATURES])


MUST, MAY = _table(1), _table(1, 2)
JUMPS = np.array([{None: 0.0, True: 1.0, False: -1.0}[c[3]] for c in SIGNATURES])
FIRST = np.array([ROWS.index(c[1][0]) for c in SIGNATURES])
OF = np.array([SENSORS.index(c[0]) for c in SIGNATURES])
# how large an error of this size in the first row is in a row whose threshold gusts raise; times the speed where FAST
_SHOWN = {("q", "turn"): (1.0, True), ("alpha_ground", "climb"): (1.0, False), ("hdot", "climb"): (0.5, False)}
SHOWS, FAST = (
    np.array([[float(_SHOWN.get((c[0], row), (0.0, False))[k]) for row in ROWS] for c in SIGNATURES]) for k in (0, 1)
)

PARAMS = dtype(
    [
        ("threshold", "f8", (NR,)),  # of the rows: rad (3), m/s (3), m, m/s, relative, m
        ("jump", "f8", (NR,)),  # a change from tick to tick beyond it is one; the same units
        ("gust", "f8", (NR,)),  # growth of the thresholds with the rms of lateral gusts; their units per m/s
        ("side", "f8", (NR,), "rad"),  # of climb, turn and speed with lateral motion: the error of sideslip
        ("side_gust", "f8", (NR,), "-"),  # of which gusts make so many times their rms
        ("tau_gust", "f8", "s"),  # memory of that rms
        ("noise_ratio", "f8", "-"),  # second differences so many times their learned mean square are noise
        ("frozen_ratio", "f8", "-"),  # and so few times are a reading that repeats
        ("tau", "f8", "s"),  # of the rows that integrate
        ("tau_r", "f8", "s"),  # lag of the residuals
        ("tau_noise", "f8", "s"),  # memory of the second differences
        ("t_learn", "f8", "s"),  # offsets and noise are learned up to this time
        ("t_settle", "f8", "s"),  # from this time on
        ("t_collect", "f8", "s"),  # rows that fire so soon after the first one belong to it
        ("t_ambiguous", "f8", "s"),  # without a single name for so long it is ambiguous
        ("t_hold", "f8", "s"),  # a row that fired counts as fired for so long
        ("t_release", "f8", "s"),
    ]
)
UNITS = {
    **dict.fromkeys(("p", "q", "r"), "rad/s"), **dict.fromkeys(("n_x", "n_y", "n_z"), "g"), "mach": "-",
    **dict.fromkeys(("hdot", "tas", "cas", "v_ground"), "m/s"), **dict.fromkeys(("h_inertial", "h_baro"), "m"),
}  # fmt: skip
INPUTS = dtype([(n + tail, "f8", "-" if tail else UNITS.get(n, "rad")) for n in SENSORS for tail in ("", "_valid")])
STATE = dtype(
    [
        ("r", "f8", "-"),  # largest row, or noise, over its threshold
        ("alarm", "f8", "-"),
        ("verdict", "f8", "-"),  # SENSOR, AMBIGUOUS
        ("culprit", "f8", "-"),  # index into CULPRITS
        ("valid", "f8", "-"),
        ("why", "f8", "-"),  # code of fdi.common.why, 0 while valid
        ("res", "f8", (NR,), "rad, m/s, m, -"),  # residuals through the lag, less what was learned
        ("fired", "f8", (NR,), "s"),  # time for which a row still counts as fired
        ("jumped", "f8", (NR,), "s"),  # time for which it still counts as jumped
        ("raw", "f8", (NR,)),  # residuals
        ("last", "f8", (NR,)),  # at the tick before
        ("seen", "f8", (NR,)),  # 1 where the tick before had one
        ("model", "f8", (NR,)),  # states of the rows that integrate
        ("live", "f8", (NR,)),  # 1 where all sensors of a row are usable
        ("lateral", "f8", (NR,), "-"),  # share of an error of the lateral velocity that a row may show
        ("sideslip", "f8", "rad"),  # its mean and mean square, as the vane has it
        ("square", "f8", "rad2"),
        ("rough", "f8", "m/s"),  # rms of lateral gusts
        ("offset", "f8", (NR,)),
        ("limit", "f8", (NR,)),  # thresholds now
        ("y", "f8", (NS,)),  # readings
        ("ok", "f8", (NS,)),
        ("y_1", "f8", (NS,)),  # and those of the two ticks before
        ("y_2", "f8", (NS,)),
        ("ticks", "f8", (NS,)),  # usable in a row, at most 3
        ("level", "f8", (NS,)),  # learned mean square of the second difference
        ("power", "f8", (NS,)),  # the same now
        ("age", "f8", "s"),
        ("n_learn", "f8", "-"),
        ("since", "f8", "s"),  # time since the first row fired, 0 while none has
        ("noisy", "f8", "-"),  # 1 + sensor whose noise is wrong, 0 for none
        ("quiet", "f8", "s"),  # time since anything fired
    ]
)
OUTPUTS = ("r", "alarm", "verdict", "culprit", "valid", "why", "res")
DETECTOR = Detector(
    id="kinematic",
    level="aircraft",
    summary="sensors of the aircraft against each other by kinematic relations [Eykeren14]",
    inputs={name: name for name in SENSORS},
    group="airframe motion",
    designed_for={f"sensor.{name}": ("sensor",) for name in dict.fromkeys(c[0] for c in SIGNATURES)}
    | {"sensor.alpha": ("sensor", "ambiguous"), "sensor.beta": ("sensor", "ambiguous"), "sensor.n_y": ("sensor",)},
    blind="no force enters: neither effectors nor actuators; of alpha, beta and n_y it sees noise and a frozen reading",
    any_aircraft=True,
    fit=lambda site: params(own=site.own),
)


def params(which: str = "flight", *, t_learn: float = 8.0, own: Any = None) -> np.ndarray:
    """Return PARAMS with the threshold set `which`; offsets and noise are learned over the first `t_learn` seconds."""
    return record(PARAMS, t_learn=t_learn, **thresholds("kinematic", which, own))


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape: nothing learned."""
    return np.zeros(p.shape, STATE)


@kernel
def _read(x, u):
    """Copy the readings and their flags; one that is out repeats its last value."""
    _one(x, 0, u.p, u.p_valid)
    _one(x, 1, u.q, u.q_valid)
    _one(x, 2, u.r, u.r_valid)
    _one(x, 3, u.phi, u.phi_valid)
    _one(x, 4, u.theta, u.theta_valid)
    _one(x, 5, u.psi, u.psi_valid)
    _one(x, 6, u.n_x, u.n_x_valid)
    _one(x, 7, u.n_z, u.n_z_valid)
    _one(x, 8, u.hdot, u.hdot_valid)
    _one(x, 9, u.h_inertial, u.h_inertial_valid)
    _one(x, 10, u.h_baro, u.h_baro_valid)
    _one(x, 11, u.tas, u.tas_valid)
    _one(x, 12, u.cas, u.cas_valid)
    _one(x, 13, u.mach, u.mach_valid)
    _one(x, 14, u.alpha_ground, u.alpha_ground_valid)
    _one(x, 15, u.v_ground, u.v_ground_valid)
    _one(x, 16, u.alpha, u.alpha_valid)
    _one(x, 17, u.beta, u.beta_valid)
    _one(x, 18, u.n_y, u.n_y_valid)


@kernel
def _one(x, i, value, flag):
    x.ok[i] = usable(value, flag)
    if x.ok[i] > 0.5:
        x.y_2[i], x.y_1[i], x.y[i] = x.y_1[i], x.y[i], value
        x.ticks[i] = min(x.ticks[i] + 1.0, 3.0)
    else:
        x.ticks[i] = 0.0


@kernel
def _integrated(x, p, row, value, rate, live, dt, turn):
    """Advance a row that integrates: raw = value - model, x_hat' = rate + (x - x_hat) / tau; `turn` wraps at pi."""
    x.live[row] = live
    if live < 0.5 or x.seen[row] < 0.5:
        x.model[row], x.raw[row] = value, 0.0
        return
    ahead = x.model[row] + dt * rate
    e = value - ahead
    if turn > 0.5:
        e = math.atan2(math.sin(e), math.cos(e))
    x.raw[row] = e
    x.model[row] = ahead + dt / p.tau * e


@kernel
def _rows(x, p, dt):
    """Fill x.raw, x.live and x.limit from the readings."""
    y, ok = x.y, x.ok
    roll, pitch, yaw, phi, theta = y[0], y[1], y[2], y[3], y[4]
    sp, cp, st, ct = math.sin(phi), math.cos(phi), math.sin(theta), math.cos(theta)
    body = ok[0] * ok[1] * ok[2]
    rates = body * ok[3] * ok[4]
    turning = pitch * sp + yaw * cp
    _integrated(x, p, PHI, phi, roll + st / ct * turning, rates, dt, 1.0)
    _integrated(x, p, THETA, theta, pitch * cp - yaw * sp, rates, dt, 0.0)
    _integrated(x, p, PSI, y[5], turning / ct, rates * ok[5], dt, 1.0)
    u, w = y[15] * math.cos(y[14]), y[15] * math.sin(y[14])
    v = y[15] * math.sin(y[17]) if ok[17] > 0.5 else 0.0  # gusts are in it, and `side` allows for them
    path = ok[14] * ok[15] * ok[3] * ok[4]
    x.live[CLIMB] = path * ok[8]
    x.raw[CLIMB] = y[8] - (u * st - v * sp * ct - w * cp * ct)
    _integrated(x, p, TURN, w, pitch * u - roll * v + G0 * (ct * cp - y[7]), path * body * ok[7], dt, 0.0)
    _integrated(x, p, SPEED, u, yaw * v - pitch * w + G0 * (y[6] - st), path * body * ok[6], dt, 0.0)
    _integrated(x, p, HEIGHT, y[9], y[8], ok[8] * ok[9], dt, 0.0)
    x.live[SOUND] = ok[11] * ok[13] * ok[9]
    kelvin = kelvin_at(y[9] / (1.0 + y[9] / EARTH))
    x.raw[SOUND] = y[11] - y[13] * math.sqrt(1.4 * 287.05287 * kelvin)
    x.live[IMPACT] = ok[12] * ok[13] * ok[10]
    cas, mach = 0.2 * (y[12] / 340.294) * (y[12] / 340.294), 0.2 * y[13] * y[13]
    impact = math.exp(3.5 * math.log(1.0 + cas)) - 1.0
    static = math.exp(5.2558797 * math.log(kelvin_at(y[10]) / 288.15))
    if y[10] > 11000.0:
        static *= math.exp((11000.0 - y[10]) / 6341.62)
    x.raw[IMPACT] = impact / (static * (math.exp(3.5 * math.log(1.0 + mach)) - 1.0)) - 1.0
    x.live[BARO] = ok[9] * ok[10]
    x.raw[BARO] = y[10] - y[9]
    if ok[17] > 0.5:
        c = 1.0 - math.exp(-dt / p.tau_gust) if x.age > 0.0 else 1.0
        x.sideslip += c * (y[17] - x.sideslip)
        x.square += c * (y[17] * y[17] - x.square)
        x.rough = y[15] * math.sqrt(max(x.square - x.sideslip * x.sideslip, 0.0))
    # the rows take the lateral velocity from the sideslip in the air: in a bank, rolling and yawing gusts show in them
    fade = dt / p.tau
    x.lateral[CLIMB] = math.fabs(sp)
    x.lateral[TURN] += fade * (p.tau * math.fabs(roll) - x.lateral[TURN])
    x.lateral[SPEED] += fade * (p.tau * math.fabs(yaw) - x.lateral[SPEED])
    for i in range(NR):
        x.limit[i] = p.threshold[i] + p.gust[i] * x.rough
        x.limit[i] += x.lateral[i] * (p.side[i] * y[15] + p.side_gust[i] * x.rough)


@kernel
def kelvin_at(h):
    """Return the temperature of the standard atmosphere at `h` [m], up to 20 km [K]."""
    return max(288.15 - 0.0065 * h, 216.65)


@kernel
def _residuals(x, p, dt):
    """Learn offsets, lag the residuals, note what fires and what jumps; return the largest over its threshold."""
    c, largest = 1.0 - math.exp(-dt / p.tau_r), 0.0
    learning = x.age <= p.t_learn
    for i in range(NR):
        x.fired[i], x.jumped[i] = max(x.fired[i] - dt, 0.0), max(x.jumped[i] - dt, 0.0)
        if x.live[i] < 0.5:
            x.seen[i], x.res[i] = 0.0, 0.0
            continue
        if x.seen[i] > 0.5 and math.fabs(x.raw[i] - x.last[i]) > p.jump[i]:
            x.jumped[i] = p.t_hold
        x.last[i], x.seen[i] = x.raw[i], 1.0
        if learning:
            if x.age > p.t_settle:
                x.offset[i] += (x.raw[i] - x.offset[i]) / max(x.n_learn, 1.0)
            continue
        x.res[i] += c * (x.raw[i] - x.offset[i] - x.res[i])
        r = math.fabs(x.res[i]) / x.limit[i]
        largest = max(largest, r)
        if r >= 1.0:
            x.fired[i] = p.t_hold
    return largest


@kernel
def _noise(x, p, dt):
    """Judge each reading by its second difference; set x.noisy, return the largest ratio over its threshold."""
    c, largest, x.noisy = 1.0 - math.exp(-dt / p.tau_noise), 0.0, 0.0
    for i in range(NS):
        if x.ticks[i] < 2.5:
            continue
        d = x.y[i] - 2.0 * x.y_1[i] + x.y_2[i]
        if i == 5 and math.fabs(d) > 1.0:  # the heading passes 2 pi
            continue
        if x.age <= p.t_learn:
            if x.age > p.t_settle:
                x.level[i] += (d * d - x.level[i]) / max(x.n_learn, 1.0)
            x.power[i] = x.level[i]
            continue
        if x.level[i] <= 0.0:
            continue
        # a single jump is no noise: it counts as what three sigma of noise at the threshold would be
        x.power[i] += c * (min(d * d, 9.0 * p.noise_ratio * x.level[i]) - x.power[i])
        ratio = x.power[i] / x.level[i]
        loud = max(ratio / p.noise_ratio, p.frozen_ratio / max(ratio, 1e-12))
        if loud > largest:
            largest = loud
            if loud >= 1.0:
                x.noisy = i + 1.0
    return largest


@kernel
def _named(x):
    """Return (number of sensors that explain what fired and jumped, the last of them + 1)."""
    count, best = 0, 0
    for s in range(NC):
        fits = True
        for i in range(NR):
            on = x.fired[i] > 0.0
            missing = not on and MUST[s, i] > 0.5
            if missing and i != FIRST[s] and x.fired[FIRST[s]] > 0.0 and SHOWS[s, i] > 0.0:
                # gusts may hide it there
                size = math.fabs(x.res[FIRST[s]]) * SHOWS[s, i] * (x.y[15] if FAST[s, i] > 0.5 else 1.0)
                missing = size > HIDDEN * x.limit[i]
            if missing or (on and MAY[s, i] < 0.5):
                fits = False
        jumped = x.jumped[FIRST[s]] > 0.0
        if (JUMPS[s] > 0.5 and not jumped) or (JUMPS[s] < -0.5 and jumped):
            fits = False
        if fits and best != OF[s] + 1:
            count += 1
            best = OF[s] + 1
    return count, best


@kernel
def _decide(x, p, dt):
    """Name the sensor when the rows that belong together are in; hold the alarm for t_release."""
    any_row = False
    for i in range(NR):
        any_row = any_row or x.fired[i] > 0.0
    x.quiet = 0.0 if any_row or x.noisy > 0.5 else x.quiet + dt
    if not any_row:
        x.since = 0.0
    else:
        x.since += dt
    if x.noisy > 0.5 and (x.alarm < 0.5 or x.verdict == AMBIGUOUS):
        x.alarm, x.verdict, x.culprit = 1.0, SENSOR, x.noisy
    elif any_row and x.since >= p.t_collect and (x.alarm < 0.5 or x.verdict == AMBIGUOUS):
        count, best = _named(x)
        if count == 1:
            x.alarm, x.verdict, x.culprit = 1.0, SENSOR, best
        elif x.since >= p.t_ambiguous:
            x.alarm, x.verdict, x.culprit = 1.0, AMBIGUOUS, 0.0
    if x.alarm > 0.5 and x.quiet > p.t_release:
        x.alarm, x.verdict, x.culprit = 0.0, NONE, 0.0


@kernel
def step(x, u, p, dt):
    """Read, compare, decide."""
    _read(x, u)
    _rows(x, p, dt)
    x.age += dt
    if p.t_settle < x.age <= p.t_learn:
        x.n_learn += 1.0
    r = max(_residuals(x, p, dt), _noise(x, p, dt))
    live = 0.0
    for i in range(NR):
        live += x.live[i]
    x.why = NOT_READY if x.age <= p.t_learn else (LOST_SENSOR if live < 0.5 else VALID)
    x.valid = 1.0 if x.why == VALID else 0.0
    x.r = r if x.valid > 0.5 else 0.0
    if x.valid > 0.5:
        _decide(x, p, dt)
    else:
        x.alarm, x.verdict, x.culprit = 0.0, NONE, 0.0


rollout = entry(step, STATE, INPUTS, PARAMS)
