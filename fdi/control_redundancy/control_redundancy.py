"""Control-induced redundancy: which effector does not do what it is told, from static force equations. Source: [Mar10].

| symbol | here |
|---|---|
| a_b, f_i, g_ij (slide 7) | `n_x`, `n_y`, `n_z`; measured less computed rows `e`; `G` of `force_model` |
| delta_l, delta_m, delta_n, eta | aileron, elevator (mean of four), rudder, thrust; what JSBSim's XML gives of them |
| r_ij, r~_ij^k (slides 8 to 10) | `res`, one per family of `structure`, in row units: g, rad/s2 |
| signature (slide 10) | `fired`, compared through `S`, what one unit of each fault does to each residual |

A row is measured acceleration minus the full nonlinear force at the commands of `delay` ticks ago; thrust comes from
N1 by a static map. Nothing is integrated or differentiated. Two aids, both switchable: a sliding mean of at most 0.5 s
(`t_mean`, moved by tenths; slide 17 names it as future work) and an offset learned in the first 20 s (`t_learn`), no
decision before.

A residual fires beyond tau = threshold + rel times the activity of its rows (how far their contributions have moved
since they were learned): coefficients wrong by `rel` each cannot exceed that. An effector explains the residuals when
one value of its fault leaves every |r - S f| below tau; so a residual that the fault is too small to move does not vote
("don't care"), and one that moves without reason votes against. Declared when it is the only explanation for
`t_confirm`; afterwards only families blind to it are used for the next one. More than one explanation is AMBIGUOUS.

Forces alone take an accelerometer's error for an effector: one along x for thrust, and one of the vane for an elevator.
Where angle of attack and speed over the ground are measured, kinematics find them (`core.accelerometers`, `core.vane`),
and n_x, n_z or alpha is named instead; gusts hide an error of the vane, and then nothing is named. Other sensors and
a stabiliser that runs away (the law moves the elevators against it) are still named as the effector that acts alike.

`rows = "force+moment"` adds three rows with measured angular acceleration (a documented sensor), and single engines.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from fdi.common import gyro
from fdi.common.decision import T_HOLD, confirm
from fdi.common.envelope import ALPHA, FLYING, MACH, box
from fdi.common.record import Detector, Estimate, Site
from fdi.common.tuning import thresholds
from fdi.common.verdict import AMBIGUOUS, JAM_SOLID, NONE, SENSOR, THRUST
from fdi.common.why import BOX_ALPHA, BOX_MACH, BOX_SPEED, GUSTS, LOST_SENSOR, NOT_READY, VALID
from fdi.control_redundancy import force_model
from fdi.control_redundancy import structure as redundancy_structure
from fdi.control_redundancy.core import (
    BLOCKS,
    DELAY,
    NC,
    NF,
    NH,
    NR,
    NX,
    PITCH,
    accelerometers,
    accumulate,
    complete,
    delayed_commands,
    evaluate_families,
    fit_hypothesis,
    learn,
    row_errors,
    sliding_mean,
    vane,
)
from fdi.control_redundancy.force_model import params_dtype

EFFECTORS = ("elevator", "aileron", "rudder", "engine", "engine_1", "engine_2", "engine_3", "engine_4")
CULPRITS = ("", *EFFECTORS, "n_x", "n_z", "alpha")
FAR = 1e3  # beyond every position [rad]; a state is finite
FIRING = 0.8  # of a row's threshold: with less it says nothing of its accelerometer
DOUBT = 0.5  # of bias_share: with so much no effector is declared
MAYBE = 0.35  # of the error that lift asks for: with so much in the vane, slowly or of late, no effector is declared
TURN, TURN_0 = 0.6, 0.02  # how far, in share and in [rad/s2], the pitching may be from what an elevator would do
NEAR = 0.35  # so far the vane's error by kinematics is from the one that lift asks for, when it is named
LEARN = 8.0  # in flight, as the other observers of the aircraft [s]
STRIDE = 0.005  # [s] from one command kept to the next, at least
LAG = (0.06, 0.06, 0.09, 0.0)  # [s]: servos near 30 rad/s, the rudder's 20 rad/s, damping 0.9; the stabiliser creeps

PARAMS = params_dtype(
    [
        ("n_rows", "f8"),  # 3 forces, or 6 with moments
        ("n_hypotheses", "f8"),  # 4, or 8 with single engines
        ("n_families", "f8"),
        ("base_row", "f8", (NF,)),
        ("n_pivots", "f8", (NF,)),
        ("pivot_row", "f8", (NF, 2)),
        ("pivot_input", "f8", (NF, 2)),
        ("threshold", "f8", (NR,), "g, rad/s2"),  # of the rows: X Y Z [g], L M N [rad/s2]
        ("limit", "f8", (NH,)),  # largest believable fault: rad, fraction of thrust
        ("rel", "f8"),  # uncertainty of each coefficient
        ("rel_thrust", "f8"),  # uncertainty of the thrust map
        ("rel_spool", "f8"),  # core speed ahead of N1, per change of normalised N1 against its mean
        ("stride", "f8", "-"),  # commands are kept of every so many ticks: of each 5 ms, however short the tick
        ("late", "f8", (NC,), "-"),  # how late they act in the measurements: theirs and the actuator's delay
        ("rate", "f8", (NC,), "rad/s"),  # how fast a healthy actuator follows its command, 0 for at once
        ("t_mean", "f8", "s"),  # sliding mean, 0 for raw samples
        ("t_learn", "f8", "s"),  # offset learned over the first seconds, 0 for none
        ("t_confirm", "f8", "s"),
        ("t_ambiguous", "f8", "s"),  # firing for so long without a single explanation is an alarm
        ("t_release", "f8", "s"),
        ("t_kin", "f8", "s"),  # time constant of the kinematic observers of the accelerometers
        ("t_bias", "f8", "g"),  # errors of the accelerometers below this are none
        ("t_vane", "f8", "rad"),  # errors of the vane below this are none
        ("gust_max", "f8", "m/s"),  # rms of gusts beyond which nothing is said nor learned, 0 for no such bound
        ("bias_share", "f8", "-"),  # so much of a row's residual in its accelerometer makes it the accelerometer's
        ("t_invalid", "f8", "s"),  # averages start again after so long without data
    ]
)
_MEASURED = {  # of the aircraft -> unit
    **dict.fromkeys(("n_x", "n_y", "n_z"), "g"),  # forces over weight, forward right up +
    **dict.fromkeys(("alpha", "beta", "theta", "phi"), "rad"),
    **dict.fromkeys(("p", "q", "r"), "rad/s"),
    **dict.fromkeys(("cas", "tas"), "m/s"),
    "mach": "-",
    "mass": "kg",
    "cg": "-",  # fraction of the mean chord
    **dict.fromkeys(("n1_1", "n1_2", "n1_3", "n1_4"), "%"),
    **dict.fromkeys(("pdot", "qdot", "rdot"), "rad/s2"),  # only for rows = "force+moment"
}
_GROUND = {"alpha_ground": "rad", "v_ground": "m/s"}  # without them accelerometers are believed
_COMMANDS = (
    "de_lo",
    "de_li",
    "de_ri",
    "de_ro",
    "da_l",
    "da_r",
    "dr",
    "stab",
)  # of the surfaces, trailing edge down + (rudder: yaws left) [rad]
INPUTS = dtype([(n, "f8", "rad") for n in _COMMANDS]
               + [(n + t, "f8", "-" if t else unit)
                  for n, unit in (_MEASURED | _GROUND).items() for t in ("", "_valid")])
STATE = dtype(
    [
        ("r", "f8", "-"),  # largest residual in use over its threshold
        ("alarm", "f8", "-"),  # 1 while an effector is declared or residuals fire without a single explanation
        ("verdict", "f8", "-"),  # of the last declared: THRUST, JAM_SOLID, AMBIGUOUS
        ("culprit", "f8", "-"),  # index into CULPRITS, of the last declared
        ("valid", "f8", "-"),  # 1 when learned and the averages are full
        ("why", "f8", "-"),  # code of fdi.common.why, 0 while valid
        ("f_hat", "f8", "rad, fraction"),  # fault of the culprit: rad, or fraction of thrust (negative = lost)
        ("f_hat_elevator", "f8", "rad"),  # actual less commanded, under the hypothesis that this effector alone failed
        ("f_hat_aileron", "f8", "rad"),
        ("f_hat_rudder", "f8", "rad"),
        ("f_hat_thrust", "f8", "fraction"),  # fraction of total thrust
        ("bias", "f8", (2,), "g"),  # errors of n_x and n_z by kinematics
        ("candidates", "f8", "-"),  # bit h is set when effector h + 1 of CULPRITS explains the residuals
        ("declared", "f8", (NH,), "-"),  # 1 per declared effector
        ("res", "f8", (NF,), "g, rad/s2"),  # residuals [g], [rad/s2]
        ("tau", "f8", (NF,), "g, rad/s2"),  # their thresholds
        ("fired", "f8", (NF,), "-"),  # signature
        ("used", "f8", (NF,), "-"),
        ("S", "f8", (NF, NH), "g, rad/s2 per rad, fraction"),  # residual per unit of fault
        ("e", "f8", (NR,), "g, rad/s2"),
        ("act", "f8", (NR,), "g, rad/s2"),
        ("offset", "f8", (NR,), "g, rad/s2"),
        ("G", "f8", (NR, NH)),
        ("full", "f8", (NR,), "g, rad/s2"),  # mean sum of all contributions while learning
        ("suspect", "f8", "-"),  # 1: the offset is beyond what coefficients can do: a sensor or a fault from the start
        ("rows", "f8", (NR,)),
        ("column", "f8", (NR,)),
        ("c", "f8", (NR,)),
        ("slope", "f8", (6, 3)),
        ("variable", "f8", (15,)),
        ("part", "f8", (force_model.NK,)),
        ("part_0", "f8", (force_model.NK,)),
        ("cmd", "f8", (NC,)),
        ("line", "f8", (DELAY, NC)),
        ("head", "f8", "-"),
        ("phase", "f8", "-"),  # ticks until the next command is kept
        ("started", "f8", "-"),
        ("learned", "f8", "-"),
        ("n_learn", "f8", "-"),
        ("total", "f8", (BLOCKS, NX)),
        ("n_block", "f8", (BLOCKS,), "-"),
        ("block", "f8", "-"),
        ("avg", "f8", (NX,)),
        ("spool", "f8", "-"),  # mean normalised N1
        ("turning", "f8", (2,), "-"),  # the same, lagged twice
        ("calm", "f8", "-"),  # samples learned from, by their weight
        ("gone", "f8", "s"),  # time without data
        ("rougher", "f8", "s"),  # time for which gusts have been beyond gust_max
        ("last", "f8", "-"),  # hypothesis that is being confirmed, 0 for none
        ("timer", "f8", "s"),
        ("timer_any", "f8", "s"),
        ("quiet", "f8", (NH,), "s"),  # time that a declared effector has looked healthy
        ("low", "f8", (2,), "rad"),  # range of commanded and of reconstructed position since the declaration
        ("high", "f8", (2,), "rad"),
        ("bias_0", "f8", (2,), "g"),  # learned
        ("doubt", "f8", (2,), "g"),  # what gusts from the side may have made of them
        ("velocity", "f8", (2,), "m/s"),  # models of the velocity over the ground: forward, down
        ("moving", "f8", "-"),  # 1 once they have started
        ("vane", "f8", (3,), "rad"),  # angle of attack less that over the ground, less what was learned, by lag
        ("vane_mean", "f8", "rad"),  # of it, learned
        ("rough", "f8", "rad2"),  # mean square of the gusts in it
        ("lift", "f8", "g/rad"),  # Z row per angle of attack
        ("pitch", "f8", "rad/s2"),  # computed moment, negative; its value while learning; growth of the pitch rate
        ("pitch_0", "f8", "rad/s2"),
        ("grown", "f8", "rad/s"),
        ("q_last", "f8", "rad/s"),
        ("pitch_e", "f8", "1/s2"),  # what an elevator does to it
        ("part_a", "f8", (force_model.NK,)),
        ("slope_a", "f8", (6, 3)),
        ("blamed", "f8", "-"),  # sensor that is declared: 0, 1 n_x, 2 n_z, 3 alpha
        ("timer_bias", "f8", "s"),  # its confirmation
        ("on_bias", "f8", "-"),
        ("on", "f8", "-"),  # ambiguous alarm
        *gyro.STATE,
    ]
)
OUTPUTS = (
    "r", "alarm", "verdict", "culprit", "valid", "why", "f_hat", "f_hat_elevator", "f_hat_aileron", "f_hat_rudder",
    "f_hat_thrust", "bias", "candidates",
)
DETECTOR = Detector(
    id="control_redundancy",
    level="aircraft",
    summary="static residuals from the force equation, signature table [Mar10]",
    inputs={
        **dict.fromkeys(("de_lo", "de_li", "de_ri", "de_ro"), "de_cmd"),
        **{"stab": "stab_cmd", "da_l": "da_cmd", "da_r": "da_cmd", "dr": "dr_cmd"},
        **{word: word for word in (*_MEASURED, *_GROUND)},
    },
    group="airframe motion",
    designed_for={  # [Mar10]: locked effectors and thrust loss
        **dict.fromkeys(("*.jam_solid", "ema.jam"), ("jam_solid", "ambiguous")),
        "rudder": ("jam_solid",),
        "engine": ("thrust",),
    },
    may_see={
        **dict.fromkeys((
            "*.runaway*", "*.bias@command", "*.free_float", "*.loss_of_effectiveness*", "*.jam_liquid",
        ), ("jam_solid", "ambiguous")),
        "*.ofc_*": ("ambiguous",),
        **dict.fromkeys(("*.rod", "*.position"), ("jam_solid", "ambiguous")),
        **dict.fromkeys((
            "stabiliser", "sensor.n_y", "sensor.beta", "sensor.p",
            "sensor.q", "sensor.r", "sensor.cas", "sensor.tas", "sensor.mach", "sensor.mass", "sensor.cg",
            "sensor.n1_*",
        ), ("ambiguous",)),
        **dict.fromkeys(("sensor.n_x", "sensor.n_z", "sensor.alpha"), ("sensor", "ambiguous")),
    },
    blind="static force equations: faults inside an actuator move no force, and a transport's aileron shows in none",
    remark="a sensor other than n_x, n_z, alpha, or a stabiliser, that acts like an effector is named as that effector",
    estimates=(Estimate("elevator", "f_hat_elevator", "rad"), Estimate("thrust", "f_hat_thrust", "fraction")),
    looks_back={"late": "line"},
    sizes={
        "n_a": 0, "n_m": 0, "n_q": 0, "n_ka": 0, "n_k": 0, "axis": 0, "variable": 0, "effector": 0, "n_tm": 0,
        "n_tp": 0, "n_rows": 0, "n_hypotheses": 0, "n_families": 0, "base_row": 0, "n_pivots": 0, "pivot_row": 0,
        "pivot_input": 0,
    },
    places={"head": ("line", 0), "block": ("n_block", 0)},
    options={"rows": ("force", "force+moment")},  # the first is the default
    range={"tas": FLYING, "mach": MACH, "alpha_ground": ALPHA},  # not the vane: a fault of it is to be named
    fit=lambda site, **options: fitted(site, **options),
)  # fmt: skip


def params(
    which: str = "flight", *, model: force_model.ForceModel, dt: float = 0.005, rows: str = "force",
    delay: float = 2, lag: Sequence[float] | None = None, rate: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
    t_mean: float = 0.5, t_learn: float = 20.0, own: Any = None,
) -> np.ndarray:  # fmt: skip
    """Return PARAMS for a `ForceModel`; `rows` is "force" or "force+moment", `t_mean`, `t_learn` 0 switch the aids off.

    Commands are delayed by `delay` ticks as the measurements are [Mar10] slide 11, and by `lag` [s], what a healthy
    actuator takes on average (2 zeta / omega of a second-order one): elevator, aileron, rudder, stabiliser. They move
    at `rate` [rad/s] at most, in the same order, 0 for no limit. Of shorter ticks than 5 ms every `stride`-th is kept.
    Families come from the structure of the model's rows. Raises ValueError for other rows, a mean beyond 0.5 s, a
    delay beyond the buffer.
    """
    if rows not in ("force", "force+moment"):
        raise ValueError(f"rows = {rows!r}: give 'force' or 'force+moment'")
    if not 0 <= t_mean <= 0.5:
        raise ValueError(f"t_mean = {t_mean}: the sliding mean is at most 0.5 s")
    elevator, aileron, rudder, stabiliser = LAG if lag is None else lag
    stride = max(1.0, math.floor(STRIDE / dt + 1e-9))
    late = delay + np.round(_each(elevator, aileron, rudder, stabiliser) / dt)
    late = np.round((late - (stride - 1.0) / 2.0) / stride)  # the newest that is kept is half a stride old on average
    if late.max() >= DELAY or late.min() < 0:
        raise ValueError(f"a command delay of {late.max() * stride:.0f} ticks; at most {(DELAY - 1) * stride:.0f} fit")
    n = 3 if rows == "force" else 6
    found = redundancy_structure.families(model.structure()[:n], most=2 if n == 3 else 1)
    if len(found) > NF:
        raise ValueError(f"{len(found)} residual families, at most {NF} fit")
    pivots = np.zeros((NF, 2, 2))
    for i, family in enumerate(found):
        pivots[i, : len(family.pivots)] = np.reshape(family.pivots, (-1, 2))
    limits = thresholds("control_redundancy", which, own)
    return record(
        PARAMS, **force_model.fields(model), n_rows=n, n_hypotheses=4 if n == 3 else 8, n_families=len(found),
        base_row=_pad([f.base for f in found]), n_pivots=_pad([len(f.pivots) for f in found]),
        pivot_row=pivots[:, :, 0], pivot_input=pivots[:, :, 1], late=late, stride=stride, rate=_each(*rate),
        t_mean=t_mean, t_learn=t_learn,
        threshold=[limits.pop(f"t_{row}") for row in ("x", "y", "z", "l", "m", "n")],
        limit=[0.8, 0.8, 0.8, 1.2, 1.2, 1.2, 1.2, 1.2], **limits,
    )  # fmt: skip


def _each(elevator, aileron, rudder, stabiliser):
    return np.array([*[elevator] * 4, aileron, aileron, rudder, stabiliser])


def _pad(values):
    return np.r_[np.asarray(values, float), np.zeros(NF - len(values))]


def fitted(site: Site, **options: Any) -> np.ndarray:
    """Return PARAMS for a loop, on the force model of the aircraft that flies."""
    about = site.aircraft()
    late = {"delay": 1.0 + site.ticks("n_z"), "lag": about.delays, "rate": about.rates}
    return params(model=about.model, dt=site.dt, t_learn=LEARN, own=site.own, **late, **options)


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape: nothing learned, averages empty."""
    return np.zeros(p.shape, STATE)


@kernel
def _in_use(x, p):
    """Mark the families that no declared effector moves; return the largest residual in use over its threshold."""
    largest = 0.0
    for f in range(int(p.n_families)):
        x.used[f] = 1.0 if x.S[f, 0] == x.S[f, 0] else 0.0
        for h in range(int(p.n_hypotheses)):
            if x.declared[h] > 0.5 and math.fabs(x.S[f, h]) * p.limit[h] >= 0.5 * x.tau[f]:
                x.used[f] = 0.0
        if x.used[f] > 0.5:
            largest = max(largest, math.fabs(x.res[f]) / x.tau[f])
    return largest


@kernel
def _turns(x, p, value):
    """Return 1.0 when the aircraft turns as an elevator off by `value` turns it; moment rows ask that themselves."""
    asked = x.avg[PITCH + 1] * value
    return 1.0 if p.n_rows > 3.0 or math.fabs(x.avg[PITCH] - asked) <= TURN * math.fabs(asked) + TURN_0 else 0.0


@kernel
def _explain(x, p):
    """Return (number of hypotheses that explain the residuals, the best of them + 1); set their bits."""
    x.candidates, count, best, least, bit = 0.0, 0, 0, math.inf, 1.0
    for h in range(int(p.n_hypotheses)):
        if x.declared[h] < 0.5:
            value, worst = fit_hypothesis(x, p, h)
            fits = worst < 1.0 and math.fabs(value) <= p.limit[h]
            if fits and (h > 0 or _turns(x, p, value) > 0.5):
                x.candidates += bit
                count += 1
                if worst < least:
                    least, best = worst, h + 1
        bit *= 2.0
    return count, best


@kernel
def _estimate(x, p, h):
    """Return the fault of hypothesis h from the families that no other declared effector moves."""
    was = x.declared[h]
    x.declared[h] = 0.0
    _in_use(x, p)
    value, _ = fit_hypothesis(x, p, h)
    x.declared[h] = was
    return value


@kernel
def _accelerometer(x, p, share, doubt):
    """Return 1.0 or 2.0 when kinematics find `share` of a row's residual in n_x or n_z, else 0.0.

    `doubt` 1 asks that they do without what gusts from the side may have made of it; 0: they may.
    """
    found, most = 0.0, 0.0
    for i in range(2):
        e = x.avg[0] if i == 0 else -x.avg[2]  # a reading that is too large raises X and lowers Z
        b, row = math.copysign(max(math.fabs(x.bias[i]) - doubt * x.doubt[i], 0.0), x.bias[i]), 2 * i
        if math.fabs(e) < FIRING * (p.threshold[row] + p.rel * x.avg[NR + row]):
            continue
        if math.fabs(b) > p.t_bias and b * e > 0.0 and math.fabs(b) >= share * math.fabs(e):
            if math.fabs(b) > most:
                found, most = i + 1.0, math.fabs(b)
    return found


@kernel
def _vane(x, p):
    """Return how the vane explains the Z row: 2.0 kinematics find that error, 1.0 they may, 0.0 it is another's."""
    e, tau = x.avg[2], p.threshold[2] + p.rel * x.avg[NR + 2]
    if math.fabs(e) < FIRING * tau or x.lift >= 0.0:
        return 0.0
    error = -e / x.lift
    if math.fabs(error) < p.t_vane:
        return 0.0
    slow = x.vane[2]
    if math.fabs(slow - error) <= NEAR * math.fabs(error) and slow * slow > max(p.t_vane * p.t_vane, x.rough):
        return 2.0
    sign = math.copysign(1.0, error)
    most = max(x.vane[0] - slow, max(x.vane[1], slow)) if error > 0.0 else min(x.vane[0] - slow, min(x.vane[1], slow))
    most = max(sign * most, sign * x.vane[0])
    return 1.0 if most >= MAYBE * math.fabs(error) else 0.0


@kernel
def _decide(x, p, dt):
    """Declare the single explanation that lasts, release what has been quiet, name the class."""
    x.r = _in_use(x, p)
    if x.suspect > 0.5:
        x.alarm, x.verdict = 1.0, AMBIGUOUS
        return
    turning = x.gyro_off > 0.0  # q is wrong: kinematics take that for an error of n_x or n_z
    wrong = _accelerometer(x, p, p.bias_share, 1.0) if x.r >= 1.0 and not turning else 0.0
    maybe = _accelerometer(x, p, p.bias_share, 0.0) if x.r >= 1.0 and not turning else 0.0
    wind = _vane(x, p) if x.r >= 1.0 else 0.0
    off = x.vane[2] * x.vane[2] > max(p.t_vane * p.t_vane, x.rough)
    if wind > 1.5 and maybe < 1.5:  # a vane that lift finds wrong as well moves the X row, too
        wrong = 3.0
    elif wrong > 0.5 and off and x.blamed > 2.5:
        wrong = 3.0  # it was named, and still reads as wrong: near the stall lift no longer says by how much
    elif wrong == 1.0 and off:
        wrong = 0.0  # gusts or the vane
    x.timer_bias, x.on_bias = confirm(x.timer_bias, x.on_bias, wrong > 0.5, dt, p.t_confirm, p.t_release)
    x.blamed = wrong if wrong > 0.5 else (x.blamed if x.on_bias > 0.5 else 0.0)
    if wrong > 0.5 or x.on_bias > 0.5:  # its rows say nothing about effectors
        x.timer, x.last, x.timer_any = 0.0, 0.0, 0.0
        if x.on_bias > 0.5:
            x.alarm, x.verdict, x.culprit = 1.0, SENSOR, NH + x.blamed
        return
    if x.culprit > NH:
        x.culprit = 0.0
    count, best = _explain(x, p) if x.r >= 1.0 else (0, 0)
    if count == 1 and (turning or wind > 0.5 or _accelerometer(x, p, DOUBT * p.bias_share, 0.0) > 0.5):
        count = 2  # it may still turn out to be the sensor
    if count != 1 or best != x.last:
        x.timer = 0.0
    x.last = best if count == 1 else 0.0
    if count == 1:
        x.timer += dt
        if x.timer >= p.t_confirm - 0.5 * dt:
            h = best - 1
            x.declared[h], x.quiet[h], x.culprit, x.timer = 1.0, 0.0, best, 0.0
            for i in range(2):
                x.low[i], x.high[i] = FAR, -FAR
    x.timer_any, x.on = confirm(x.timer_any, x.on, x.r >= 1.0 and count != 1, dt, p.t_ambiguous, p.t_release)
    x.f_hat_elevator, x.f_hat_aileron = _estimate(x, p, 0), _estimate(x, p, 1)
    x.f_hat_rudder, x.f_hat_thrust = _estimate(x, p, 2), _estimate(x, p, 3)
    x.alarm = x.on
    for h in range(int(p.n_hypotheses)):
        if x.declared[h] > 0.5:
            f = _estimate(x, p, h)
            moved = 0.0
            for i in range(int(p.n_families)):
                if x.used[i] > 0.5:
                    moved = max(moved, math.fabs(x.S[i, h] * f) / x.tau[i])
            x.quiet[h] = 0.0 if moved >= 0.5 else x.quiet[h] + dt
            if x.quiet[h] > p.t_release:
                x.declared[h] = 0.0
                x.culprit = 0.0 if x.culprit == h + 1.0 else x.culprit
            else:
                x.alarm = 1.0
                x.f_hat = f if x.culprit == h + 1.0 else x.f_hat
    _name(x, p)


@kernel
def _name(x, p):
    """Set the verdict: THRUST for engines; a surface that stands while its command moves is JAM_SOLID."""
    if x.alarm < 0.5:
        x.verdict, x.culprit, x.f_hat = NONE, 0.0, 0.0
    elif x.culprit > 3.5:
        x.verdict = THRUST
    elif x.culprit > 0.5:
        command = x.avg[2 * NR + int(x.culprit) - 1]
        x.low[0], x.high[0] = min(x.low[0], command), max(x.high[0], command)
        x.low[1], x.high[1] = min(x.low[1], command + x.f_hat), max(x.high[1], command + x.f_hat)
        moved, stood = x.high[0] - x.low[0], x.high[1] - x.low[1]
        x.verdict = JAM_SOLID if moved > 0.03 and stood < 0.5 * moved else AMBIGUOUS
    else:
        x.verdict = AMBIGUOUS


@kernel
def _withdraw(x, p):
    """Take back what was declared: nothing has been measured for long."""
    for h in range(int(p.n_hypotheses)):
        x.declared[h] = 0.0
    x.on, x.timer, x.timer_any, x.last = 0.0, 0.0, 0.0, 0.0
    x.on_bias, x.timer_bias, x.blamed = 0.0, 0.0, 0.0
    x.r, x.alarm, x.verdict, x.culprit, x.f_hat = 0.0, 0.0, NONE, 0.0, 0.0
    x.f_hat_elevator, x.f_hat_aileron, x.f_hat_rudder, x.f_hat_thrust = 0.0, 0.0, 0.0, 0.0


@kernel
def step(x, u, p, dt):
    """Compare measured with computed forces at one tick, average, evaluate the residuals, decide."""
    delayed_commands(x, u, p, dt)
    x.started = 1.0
    gyro.compare(x, u, dt)
    beyond = box(u.tas, u.tas_valid, FLYING[0], FLYING[1], BOX_SPEED, VALID)
    beyond = box(u.mach, u.mach_valid, MACH[0], MACH[1], BOX_MACH, beyond)
    beyond = box(u.alpha_ground, u.alpha_ground_valid, ALPHA[0], ALPHA[1], BOX_ALPHA, beyond)
    if beyond != VALID or complete(u, p) < 0.5:
        x.gone += dt
        x.valid, x.why = 0.0, beyond if beyond != VALID else LOST_SENSOR
        if x.learned < 0.5:
            x.started = 0.0  # commands of a parked aircraft, or from before a gap, are not those of the flight
        if x.gone > p.t_invalid:
            for i in range(BLOCKS):
                x.n_block[i] = 0.0
                for j in range(NX):
                    x.total[i, j] = 0.0
        if x.gone > T_HOLD:
            _withdraw(x, p)
        return
    x.gone = 0.0
    row_errors(x, u, p)
    accelerometers(x, u, p, dt)
    vane(x, u, p, dt)
    rough = p.gust_max > 0.0 and x.rough * u.v_ground * u.v_ground > p.gust_max * p.gust_max
    x.rougher = x.rougher + dt if rough else 0.0
    if x.learned < 0.5:
        if not rough:
            learn(x, p, dt)
        x.valid, x.why = 0.0, GUSTS if rough else NOT_READY
        return
    full = accumulate(x, p, dt) > 0.5
    if rough:
        x.valid, x.why = 0.0, GUSTS
        if x.rougher > T_HOLD:
            _withdraw(x, p)
    elif full:
        x.valid = sliding_mean(x, p)
        x.why = VALID if x.valid > 0.5 else NOT_READY
        if x.valid > 0.5:
            evaluate_families(x, p)
            _decide(x, p, max(p.t_mean / BLOCKS, dt))


rollout = entry(step, STATE, INPUTS, PARAMS)
