"""Oscillation of the elevators in the pitch-moment equation: generalised likelihood ratio of its frequency and onset.

    y = x' theta + b (c cos wt + d sin wt) + e,    theta a random walk, e autoregressive

y is the pitch acceleration, q and qdot fused so that noise is little (moment.fuse), less the plant's nonlinear moment
at what the vane reads, at where the servo's own model has the elevator, and at the thrust that the accelerometer shows;
x (NX) are the parts of that moment, each of which may be wrong by a share, and what gusts add at the tail
(fdi/pitch_moment_glr/moment.py, `TERMS`). All readings are taken as old as the air data are. A Kalman filter learns
theta; of its innovations the likelihood ratio of an oscillation is taken, where what the filter learns of the
oscillation is followed, too (core.correlate). Sources: [Willsky76] A. Willsky, H. Jones, A generalized likelihood ratio
approach to the detection and estimation of jumps in linear systems, IEEE Trans. Automatic Control 21 (1976);
[Basseville93] M. Basseville, I. Nikiforov, Detection of Abrupt Changes, Prentice Hall (1993), sections 2.4, 7.2.4;
[Dahl76] P. Dahl, Solid friction damping of mechanical vibrations, AIAA Journal 14 (1976).

One moment does not tell which of the four segments swings, so the culprit is the elevator; the side is named where the
roll acceleration swings with the pitch acceleration as one side's elevator makes it. OFC_SOLID is named where the
command has lost part of its own effect since the oscillation began, OFC_LIQUID where it has not, else AMBIGUOUS.
"""

import math
from typing import Any

import numpy as np

from actuators.block import entry, kernel, record
from actuators.common import reference
from actuators.ema import servo as ema_servo
from actuators.hydraulic import servo as hydraulic_servo
from fdi.common.decision import usable
from fdi.common.envelope import ALPHA, FLYING, MACH, box
from fdi.common.record import Detector, Site
from fdi.common.tuning import thresholds
from fdi.common.verdict import NONE
from fdi.common.why import BOX_ALPHA, BOX_MACH, BOX_SPEED, LOST_SENSOR, NOT_READY, VALID
from fdi.control_redundancy import force_model
from fdi.pitch_moment_glr import core
from fdi.pitch_moment_glr.core import F_HIGH, F_LOW, NA, NF, correct, correlate, levinson, whiten
from fdi.pitch_moment_glr.decide import TURNS, classify, judge
from fdi.pitch_moment_glr.fields import INPUTS, MEASURED, NK, NK_A, PARAMS, STATE
from fdi.pitch_moment_glr.moment import FINE, LATE, NV, NX, TAPS, TAU_FUSE, follow, fuse, late_gust, terms, upward

CULPRITS = ("", "elevator", "elevator_left", "elevator_right")
SAMPLE = 0.02  # [s] from one sample of the regression to the next; readings are averaged in between
PERIODS = 5.0  # memory: after ten periods an oscillation has 0.76 of what a window of just these would have
STEEP = 3.0  # time constants of the high pass after an angle of attack beyond `alpha_max`
# theta before anything is learned: most of the tail's gust is not turned by the wing's wake; friction makes servos late
BEFORE = {4: 0.6, 5: -0.25, 8: -0.3e-3}
TERMS = (  # and its standard deviation then
    ("static moment at the angle of attack", 0.08), ("pitch rate", 0.12), ("elevator", 0.08),
    ("rate of the angle of attack", 0.3), ("gust between wing and tail, as a pitch rate", 0.15),
    ("elevator less its lag", 0.15), ("rate of the elevator [s]", 0.008), ("moment of thrust", 0.3),
    ("friction less its lag [m]", 0.15e-3), ("constant [rad/s2]", 0.002),
)  # fmt: skip

OUTPUTS = ("r", "alarm", "verdict", "culprit", "valid", "why", "frequency", "lost", "lean")
_OSCILLATION = ("ofc_liquid", "ofc_solid", "ambiguous")
DETECTOR = Detector(
    id="pitch_moment_glr",
    level="aircraft",
    summary="likelihood ratio of an elevator oscillation in the pitch-moment equation [Willsky76]",
    inputs={"command": "de_cmd", "stab": "stab_cmd", **{word: word for word in MEASURED}},
    group="airframe motion",
    designed_for={
        **dict.fromkeys(("*.ofc_liquid", "*.ofc_liquid@*"), ("ofc_liquid", "ambiguous")),
        **dict.fromkeys(("*.ofc_solid", "*.ofc_solid@*"), ("ofc_solid", "ambiguous")),
    },
    may_see={
        **dict.fromkeys((
            "*.jam*", "*.runaway*", "*.bias@command", "*.loss_of_effectiveness*", "*.free_float",
            "*.supply_pressure_drop", "*.rod", "*.position", "*.velocity", "*.backlash", "*.friction", "stabiliser",
            "engine", "rudder", "aileron", *(f"sensor.{word}" for word in MEASURED if word not in ("pdot",)),
        ), _OSCILLATION),
    },
    blind="reads the pitching motion alone: what does not swing the mean of the elevators",
    sizes={"n_a": 0, "n_m": 0, "n_q": 0, "n_ka": 0, "n_k": 0, "axis": 0, "variable": 0, "effector": 0, "stride": 1,
           "fine": 1},
    places={"head": ("line", 0), "place": ("past", 0), "turn": ("best", 0), "fused": ("apart", 0),
            "place_d": ("delayed", 0)},
    any_aircraft=True,
    range={"tas": FLYING, "mach": MACH, "alpha_ground": ALPHA},
    fit=lambda site: fitted(site),
)  # fmt: skip


def params(
    which: str = "flight", *, model: Any, dt: float = 0.005, late: float = 0.01, behind: float = 0.0,
    hydraulic: float = 1.0, limits: tuple[float, float] = (math.radians(-23.0), math.radians(17.0)), own: Any = None,
    actuators: Any = None, **values: Any,
) -> np.ndarray:  # fmt: skip
    """Return PARAMS for a `ForceModel` with threshold set `which`; `values` replace fields.

    `late` is the age of the pitch acceleration [s], `behind` what air data are older than it, `hydraulic` the share of
    the elevators that is hydraulic, `limits` their travel [rad], `actuators` {technology: what differs from it}. Raises
    ValueError for a model with more than NK quantities of lift, drag and pitch.
    """
    kept = [k for k, (axis, _) in enumerate(model.quantities) if axis in ("lift", "drag", "pitch")]
    made = force_model.fields(model)
    n_a = sum(k < len(model.t_a) for k in kept)
    if len(kept) > NK or n_a > NK_A:
        raise ValueError(f"{len(kept)} quantities of lift, drag and pitch, {n_a} with alpha; at most {NK}, {NK_A} fit")
    for field, size in (("t_a", NK_A), ("t_m", NK), ("axis", NK), ("variable", NK), ("effector", NK)):
        some = [k for k in kept if field != "t_a" or k < len(model.t_a)]
        cut = np.take(np.asarray(made[field]), some, axis=-1)
        made[field] = np.concatenate([cut, np.zeros((*cut.shape[:-1], size - cut.shape[-1]))], axis=-1)
    made |= {"n_k": len(kept), "n_ka": n_a}
    actuators = actuators or {}
    servos = (hydraulic_servo.params(dt=dt, **actuators.get("hydraulic", {}))[0],
              ema_servo.params(dt=dt, symbols=actuators.get("ema"))[0])  # fmt: skip
    arm = float(servos[0]["arm"])
    own_fields = {
        name: [s[name] / (arm if name.endswith("_max") and not i else 1.0) for i, s in enumerate(servos)]
        for name, _ in reference.PARAM_FIELDS
    }
    stride = max(1.0, math.floor(SAMPLE / dt + 1e-9))
    f = np.geomspace(F_LOW, F_HIGH, NF)
    angle = 2.0 * math.pi * f * stride * dt
    prior = np.array([sd for _, sd in TERMS])
    found = {
        **{n: v for n, v in made.items() if n in PARAMS.names},
        **own_fields, "part": [hydraulic, 1.0 - hydraulic], "arm": arm, "late": late + behind, "limit_low": limits[0],
        "limit_high": limits[1], "stride": stride, "turn_c": np.cos(angle), "turn_s": np.sin(angle),
        "keep": np.exp(-f * stride * dt / PERIODS), "period": 1.0 / f, "prior": prior, "swing_roll": swing_roll(model),
        "behind": behind, "taken": 1.0 - math.exp(-dt / max(behind - dt, 1e-9)), "blend": blend(stride * dt),
        "thrust_arm": thrust_arm(model), "tail_arm": tail_arm(model), "fine": max(1.0, math.floor(FINE / dt + 0.5)),
        **thresholds("pitch_moment_glr", which, own),
    }  # fmt: skip
    found["walk"] = np.asarray(prior) ** 2 / found.pop("t_walk")
    return record(PARAMS, **{**found, **values})


def swing_roll(model: Any) -> float:
    """Return the roll acceleration over the pitch acceleration that the left elevators make, at the model's middle."""
    roll, pitch = 0.0, 0.0
    for k, (axis, variable) in enumerate(model.quantities):
        if variable in ("de_lo", "de_li"):
            mean = float(model.t_m[k].mean())
            roll, pitch = roll + mean * (axis == "roll"), pitch + mean * (axis == "pitch")
    if pitch == 0.0:
        return 0.0
    return roll * model.span / model.gyration2[0] / (pitch * model.chord / model.gyration2[1])


def blend(ts: float) -> np.ndarray:
    """Return the symmetric filter (TAPS,) of the gyro's part: least noise from F_LOW to what sampling shows, octave by
    octave alike."""
    w = 2.0 * math.pi * np.geomspace(F_LOW, 0.5 / ts, 400)[:, None]
    noise = (w * TAU_FUSE) ** 2
    turn = np.exp(-1j * w * ts * (np.arange(TAPS) - TAPS // 2))
    rows = np.concatenate([turn * np.sqrt(1.0 + noise), -turn * np.sqrt((1.0 + noise) / noise)])
    aim = np.concatenate([0.0 * w, -np.sqrt((1.0 + noise) / noise)])[:, 0]
    stacked = np.concatenate([rows.real, rows.imag])
    return np.linalg.lstsq(stacked, np.concatenate([aim, 0.0 * aim]), rcond=None)[0]


def tail_arm(model: Any) -> float:
    """Return how far aft of the reference point the elevators' lift acts, at the model's middle [m]."""
    made = {"lift": 0.0, "pitch": 0.0}
    for k, (axis, variable) in enumerate(model.quantities):
        if variable.startswith("de_") and axis in made:
            made[axis] += float(model.t_m[k].mean())
    return -made["pitch"] / made["lift"] * model.chord if made["lift"] else 3.5 * model.chord


def thrust_arm(model: Any) -> float:
    """Return the pitch acceleration over the acceleration along the body that all engines together make [1/m]."""
    (tx, _, tz), (rx, _, rz) = model.thrust_axis, np.mean(model.engine, axis=0)
    return float((rz * tx - rx * tz) / tx / model.gyration2[1])


def fitted(site: Site, **values: Any) -> np.ndarray:
    """Return PARAMS for a loop, on the force model of the aircraft that flies."""
    kinds = list(site.technologies.values()) or ["hydraulic"]
    travel: dict[str, Any] = {"limits": site.travel} if site.travel else {}
    known = site.aircraft()
    return params(
        model=known.model, actuators=known.actuators, dt=site.dt, late=site.delay("qdot"), own=site.own,
        behind=site.delay("alpha") - site.delay("qdot"),
        hydraulic=1.0 - kinds.count("ema") / len(kinds), **travel, **values,
    )  # fmt: skip


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape: nothing learned."""
    x = np.zeros(p.shape, STATE)
    x["cosine"] = 1.0
    x["why"] = NOT_READY
    x["since_steep"] = p["t_learn"]
    for i, value in BEFORE.items():
        x["theta"][..., i] = value
    for i in range(NX):
        x["P"][..., i, i] = p["prior"][..., i] ** 2
    return x


@kernel
def _complete(u):
    """Return 1.0 when every measurement that the equation needs is usable."""
    good = usable(u.alpha, u.alpha_valid) * usable(u.alpha_ground, u.alpha_ground_valid)
    good *= usable(u.q, u.q_valid) * usable(u.qdot, u.qdot_valid) * usable(u.p, u.p_valid) * usable(u.r, u.r_valid)
    good *= usable(u.n_x, u.n_x_valid) * usable(u.n_z, u.n_z_valid) * usable(u.theta, u.theta_valid)
    good *= usable(u.phi, u.phi_valid) * usable(u.tas, u.tas_valid) * usable(u.v_ground, u.v_ground_valid)
    good *= usable(u.cas, u.cas_valid) * usable(u.mach, u.mach_valid)
    return good * usable(u.mass, u.mass_valid) * usable(u.cg, u.cg_valid) * (1.0 if u.mass > 0.0 else 0.0)


@kernel
def _hold(x, i, value, p):
    """Return `value` of `behind` ago: a tick, and a lag for the rest."""
    if p.behind <= 0.0:
        return value
    if x.started < 0.5:
        x.held[i] = value
    before = x.held[i]
    x.held[i] += p.taken * (value - before)
    return before


@kernel
def _read(x, u, p, dt):
    """Advance the servo models and the fused acceleration, add this tick to the sums of the sample."""
    if math.isfinite(u.command):
        x.command = u.command
    if math.isfinite(u.stab):
        x.stab = u.stab
    q, qdot, ground = _hold(x, 0, u.q, p), _hold(x, 1, u.qdot, p), _hold(x, 2, u.alpha_ground, p)
    v_ground = _hold(x, 9, u.v_ground, p)
    if x.started < 0.5:
        x.m[0] = x.m[1] = min(max(x.command, p.limit_low), p.limit_high)
    rate = p.part[0] * x.md[0] + p.part[1] * x.md[1]
    de = p.part[0] * follow(x, p, 0, x.command, dt) + p.part[1] * follow(x, p, 1, x.command, dt)
    tail = late_gust(x, p, upward(u.alpha, ground, u.tas, v_ground), u.tas, dt)
    s = x.sum_
    s[0] += u.alpha
    s[1] += ground
    s[2] += q
    s[3] += qdot
    s[4] += _hold(x, 3, u.p, p)
    s[5] += _hold(x, 4, u.r, p)
    s[6] += _hold(x, 6, u.n_x, p)
    s[7] += _hold(x, 7, u.n_z, p)
    s[8] += _hold(x, 8, math.cos(u.theta) * math.cos(u.phi), p)
    s[9] += u.tas
    s[10] += v_ground
    s[11] += de
    s[12] += 1.0
    x.sum_r[0] += rate
    x.sum_r[1] += _hold(x, 5, u.pdot if usable(u.pdot, u.pdot_valid) > 0.5 else 0.0, p)
    x.sum_r[2] += tail
    x.sum_r[3] += p.part[0] * x.stick / p.arm
    x.cas += (u.cas - x.cas) / s[12]
    x.mach += (u.mach - x.mach) / s[12]
    x.mass, x.cg = u.mass, u.cg
    x.started = 1.0


@kernel
def _high(x, i, value, c):
    """Return `value` less what it is slowly."""
    if x.filled < 0.5:
        x.low[i] = value
    x.low[i] += c * (value - x.low[i])
    return value - x.low[i]


@kernel
def _delay(x, computed):
    """Replace x.term by those of LATE samples ago; return the computed moment and the roll acceleration of then."""
    now = int(x.place_d)
    x.place_d = (now + 1) % LATE
    for i in range(NX - 1):
        x.term[i] = _late(x, now, i, x.term[i])
    return _late(x, now, NX - 1, computed), _late(x, now, NX, x.roll)


@kernel
def _late(x, now, i, new):
    """Keep a new value of signal i in the place `now`; return the one that was there, at the start the new one."""
    if x.filled < 0.5:
        x.delayed[:, i] = new
    before = x.delayed[now, i]
    x.delayed[now, i] = new
    return before


@kernel
def _forget(x):
    """Begin the sums of every hypothesis anew."""
    x.since = 0.0
    for f in range(NF):
        x.z_c[f] = x.z_s[f] = x.z_g[f] = x.R_c[f] = x.R_s[f] = 0.0
        x.M_cc[f] = x.M_cs[f] = x.M_ss[f] = x.M_gg[f] = 0.0
        for i in range(2):
            x.L_c[i, f] = x.L_s[i, f] = 0.0
        for i in range(4):
            x.d_c[i, f] = x.d_s[i, f] = 0.0
    for i in range(TURNS):
        x.best[i] = 0.0


@kernel
def _noise(x, p, e, ts, teach):
    """Advance autocorrelations of the residual `e`; whiten by them once a second."""
    now = int(x.place)
    if teach > 0.5:
        x.n_auto += 1.0
        c = max(ts / p.tau_noise, 1.0 / x.n_auto)
        x.auto[0] += c * (e * e - x.auto[0])
        for i in range(NA):
            x.auto[i + 1] += c * (e * x.past_e[(now + NA - 1 - i) % NA] - x.auto[i + 1])
        every = max(math.floor(1.0 / ts + 0.5), 1.0)
        if x.n_auto >= 2.0 * every and x.n_auto - every * math.floor(x.n_auto / every) < 0.5 and x.auto[0] > 0.0:
            x.power = levinson(x)
        elif x.n_auto < 2.0 * every:
            x.power = x.auto[0]
    x.past_e[now] = e


@kernel
def _sample(x, p, dt):
    """Advance regression and hypotheses by one sample."""
    n = x.sum_[NV]
    ts = p.stride * dt
    for i in range(NV):
        x.mean_[i] = x.sum_[i] / n
        x.sum_[i] = 0.0
    x.sum_[NV] = 0.0
    x.rate, x.roll, x.tail, x.rub = x.sum_r[0] / n, x.sum_r[1] / n, x.sum_r[2] / n, x.sum_r[3] / n
    x.sum_r[:] = 0.0
    computed = terms(x, p, ts)
    y = fuse(x, p, x.mean_[2], x.mean_[3], ts)
    computed, roll = _delay(x, computed)
    c = 1.0 - math.exp(-ts / p.tau_high)
    y = _high(x, NX, y - computed, c)
    roll = _high(x, NX + 1, roll, c)
    for i in range(NX - 1):
        x.high[i] = _high(x, i, x.term[i], c)
    x.high[NX - 1] = 1.0
    x.filled = 1.0
    x.age += ts
    x.since_steep = 0.0 if x.mean_[0] > p.alpha_max else x.since_steep + ts
    if x.age < p.t_settle:
        return
    e = y
    for i in range(NX):
        e -= x.high[i] * x.theta[i]
    _noise(x, p, e, ts, 1.0 if x.r < 0.5 else 0.0)
    now = int(x.place)
    rw = roll
    for i in range(NA):
        rw -= x.ar[i] * x.past_r[(now + NA - 1 - i) % NA]
    x.past_r[now] = roll
    yw = whiten(x, y)
    if x.since_steep < STEEP * p.tau_high:  # neither is what the high pass has of it anything to learn from
        _forget(x)
        return
    x.noise = max(max(x.power, x.local), 1e-10)
    s = core.gain(x, p, ts)
    x.e = yw
    for i in range(NX):
        x.e -= x.xw[i] * x.theta[i]
    x.s = s
    c = min(ts / p.tau_local, 1.0)
    known = s - x.noise
    x.local += c * (max(x.e * x.e - known, 0.0) - x.local)
    x.local_r += c * (rw * rw - x.local_r)
    correct(x, x.e, s)
    x.since += ts
    correlate(x, p, x.e, s, rw)


@kernel
def _silent(x, why):
    x.valid, x.why, x.r, x.alarm, x.verdict, x.culprit, x.hold = 0.0, why, 0.0, 0.0, NONE, 0.0, 0.0


@kernel
def step(x, u, p, dt):
    """Read; every `stride` ticks regress, correlate, judge."""
    good = _complete(u)
    beyond = box(u.tas, u.tas_valid, FLYING[0], FLYING[1], BOX_SPEED, VALID)
    beyond = box(u.mach, u.mach_valid, MACH[0], MACH[1], BOX_MACH, beyond)
    beyond = box(u.alpha_ground, u.alpha_ground_valid, ALPHA[0], ALPHA[1], BOX_ALPHA, beyond)
    if good > 0.5 and beyond != VALID:
        _silent(x, beyond)
        x.gone = 1.0
        return
    if good < 0.5:
        x.gone += dt
        if x.gone > 0.1:
            _silent(x, LOST_SENSOR)
        return
    if x.gone > 0.1:
        _forget(x)  # readings were lost: every filter begins anew, too
        x.filled = x.since_steep = 0.0
        x.age, x.started = min(x.age, p.t_learn - 5.0), 0.0
    x.gone = 0.0
    _read(x, u, p, dt)
    x.ticks += 1.0
    x.hold = max(x.hold - dt, 0.0)
    if x.ticks >= p.stride:
        x.ticks = 0.0
        _sample(x, p, dt)
        x.why = NOT_READY if x.age < p.t_learn else (BOX_ALPHA if x.mean_[0] > p.alpha_max else VALID)
        if x.why > 0.5:
            _silent(x, x.why)
            return
        x.valid = 1.0
        found = judge(x, p)
        if x.r >= 1.0:
            x.alarm, x.hold = 1.0, p.t_release
            classify(x, p, found)
    if x.hold <= 0.0:
        x.alarm, x.verdict, x.culprit = 0.0, NONE, 0.0


rollout = entry(step, STATE, INPUTS, PARAMS)
