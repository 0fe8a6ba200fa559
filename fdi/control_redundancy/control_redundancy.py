"""Control-induced redundancy: the effector that does not obey, by static force equations. Source: [Mar10].

| symbol | here |
|---|---|
| a_b, f_i, g_ij (slide 7) | `n_x`, `n_y`, `n_z`; measured less computed rows `e`; `G` of `force_model` |
| delta_l, delta_m, delta_n, eta | aileron, elevator (mean of four), rudder, thrust; what JSBSim's XML gives of them |
| r_ij, r~_ij^k (slides 8 to 10) | `res`, one per family of `structure`, in row units [g] |
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
and no effector is named while one of them may explain its row. Other sensors and a stabiliser that runs away (the law
moves the elevators against it) are still named as the effector that acts alike.
"""

import math
from collections.abc import Sequence

import numpy as np

from actuators.block import dtype, entry, kernel, record, zero_state
from fdi.common.decision import T_HOLD
from fdi.common.record import LEARN_S, TICK, Detector, Estimate, Site
from fdi.common.tuning import Folder, thresholds
from fdi.common.why import (
    ALPHA,
    BOX_ALPHA,
    BOX_MACH,
    BOX_SPEED,
    FLYING,
    GUSTS,
    LOST_SENSOR,
    MACH,
    NOT_READY,
    VALID,
    box,
)  # fmt: skip
from fdi.control_redundancy import core, force_model
from fdi.control_redundancy import structure as redundancy_structure
from fdi.control_redundancy.core import BLOCKS, DELAY, NC, NF, NH, NR, NX
from fdi.control_redundancy.decide import decide, withdraw

EFFECTORS = ("elevator", "aileron", "rudder", "engine")
ISOLABLE_PARTS = ("", *EFFECTORS)
# elevator, aileron, rudder, stabiliser: how many commands each has, and its lag [s]: servos near 30 rad/s, the rudder's
# 20 rad/s, damping 0.9; the stabiliser creeps
COMMANDS, SERVO_LAG = (4, 2, 1, 1), (0.06, 0.06, 0.09, 0.0)

PARAMS = dtype(
    [
        *force_model.PARAMS,
        ("n_families", "f8"),
        ("base_row", "f8", (NF,)),
        ("n_pivots", "f8", (NF,)),
        ("pivot_row", "f8", (NF, 2)),
        ("pivot_input", "f8", (NF, 2)),
        ("threshold", "f8", (NR,), "g"),  # of the rows X Y Z
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
        ("t_bias", "f8", "g"),  # errors of the accelerometers below this are taken for zero
        ("t_vane", "f8", "rad"),  # errors of the vane below this are taken for zero
        ("gust_max", "f8", "m/s"),  # rms of gusts beyond which nothing is said nor learned, 0 for no such bound
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
    **dict.fromkeys(("n1_1", "n1_2", "n1_3", "n1_4"), "%"),
}
_GROUND = {"alpha_ground": "rad", "v_ground": "m/s"}  # without them accelerometers are believed
# of the surfaces, trailing edge down + (rudder: yaws left) [rad]
_COMMANDS = ("de_lo", "de_li", "de_ri", "de_ro", "da_l", "da_r", "dr", "stab")
INPUTS = dtype(
    [(n, "f8", "rad") for n in _COMMANDS]
    + [(n + t, "f8", "-" if t else unit) for n, unit in (_MEASURED | _GROUND).items() for t in ("", "_valid")]
)
STATE = dtype(
    [
        ("r", "f8", "-"),  # largest residual in use over its threshold
        ("alarm", "f8", "-"),  # 1 while an effector is declared or residuals fire without a single explanation
        ("verdict", "f8", "-"),  # of the last declared: THRUST, JAM_SOLID, AMBIGUOUS
        ("isolated_part", "f8", "-"),  # index into ISOLABLE_PARTS, of the last declared
        ("valid", "f8", "-"),  # 1 when learned and the averages are full
        ("why", "f8", "-"),  # code of fdi.common.why, 0 while valid
        ("f_hat", "f8", "rad, fraction"),  # fault of the isolated_part: rad, or fraction of thrust (negative = lost)
        ("f_hat_elevator", "f8", "rad"),  # actual less commanded, under the hypothesis that this effector alone failed
        ("f_hat_aileron", "f8", "rad"),
        ("f_hat_rudder", "f8", "rad"),
        ("f_hat_thrust", "f8", "fraction"),  # fraction of total thrust
        ("bias", "f8", (2,), "g"),  # errors of n_x and n_z by kinematics
        ("declared", "f8", (NH,), "-"),  # 1 per declared effector
        ("res", "f8", (NF,), "g"),  # residuals of the families
        ("tau", "f8", (NF,), "g"),  # their thresholds
        ("fired", "f8", (NF,), "-"),  # signature
        ("used", "f8", (NF,), "-"),
        ("S", "f8", (NF, NH), "g per rad, fraction"),  # residual per unit of fault
        ("e", "f8", (NR,), "g"),
        ("act", "f8", (NR,), "g"),
        ("offset", "f8", (NR,), "g"),
        ("G", "f8", (NR, NH)),
        ("rows", "f8", (NR,)),
        ("c", "f8", (NR,)),
        ("slope", "f8", (NR, 3)),
        ("variable", "f8", (15,)),
        ("part", "f8", (force_model.NK,)),
        ("part_0", "f8", (force_model.NK,)),
        ("cmd", "f8", (NC,)),
        ("asked", "f8", (NC,)),  # the command that they follow
        ("line", "f8", (DELAY, NC)),
        ("head", "f8", "-"),
        ("phase", "f8", "-"),  # ticks until the next command is kept
        ("started", "f8", "-"),
        ("learned", "f8", "-"),
        ("n_learn", "f8", "-"),
        ("total", "f8", (BLOCKS, NX)),
        ("in_block", "f8", "-"),  # ticks in the block that is being filled, and blocks that are full
        ("blocks", "f8", "-"),
        ("block", "f8", "-"),
        ("avg", "f8", (NX,)),
        ("spool", "f8", "-"),  # mean normalised N1
        ("turning", "f8", (2,), "-"),  # the same, lagged twice
        ("calm", "f8", "-"),  # samples learned from, by their weight
        ("gone", "f8", "s"),  # time without data, or in gusts beyond gust_max
        ("last", "f8", "-"),  # hypothesis that is being confirmed, 0 for none
        ("suspicion", "f8", "s"),  # for so long still a sensor may be what the residuals show
        ("timer", "f8", "s"),
        ("timer_any", "f8", "s"),
        ("quiet", "f8", (NH,), "s"),  # time that a declared effector has looked healthy
        ("held", "f8", (NH,), "rad, fraction"),  # where its surface stood last, or the thrust that was lost
        ("refuted", "f8", (NH,), "s"),  # time for which that would show and does not
        ("low", "f8", (2,), "rad"),  # range of commanded and of reconstructed position since the declaration
        ("high", "f8", (2,), "rad"),
        ("asked_low", "f8", (3,), "rad"),  # range of the surfaces' commands before the alarm
        ("asked_high", "f8", (3,), "rad"),
        ("bias_0", "f8", (2,), "g"),  # learned
        ("velocity", "f8", (2,), "m/s"),  # models of the velocity over the ground: forward, down
        ("moving", "f8", "-"),  # 1 once they have started
        ("vane", "f8", (3,), "rad"),  # angle of attack less that over the ground, less what was learned, by lag
        ("vane_mean", "f8", "rad"),  # of it, learned
        ("rough", "f8", "rad2"),  # mean square of the gusts in it
        ("lift", "f8", "g/rad"),  # Z row per angle of attack
        ("on", "f8", "-"),  # ambiguous alarm
    ]
)
OUTPUTS = (
    "r",
    "alarm",
    "verdict",
    "isolated_part",
    "valid",
    "why",
    "f_hat",
    "f_hat_elevator",
    "f_hat_aileron",
    "f_hat_rudder",
    "f_hat_thrust",
    "bias",
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
            "sensor.q", "sensor.r", "sensor.cas", "sensor.tas", "sensor.mach", "sensor.mass", "sensor.n1_*",
            "sensor.n_x", "sensor.n_z", "sensor.alpha",
        ), ("ambiguous",)),
    },
    blind="static force equations: faults inside an actuator move no force, and a transport's aileron shows in none",
    estimates=(Estimate("elevator", "f_hat_elevator", "rad"), Estimate("thrust", "f_hat_thrust", "fraction")),
    looks_back={"late": "line"},
    sizes={
        "n_a": 0, "n_m": 0, "n_q": 0, "n_ka": 0, "n_k": 0, "axis": 0, "variable": 0, "effector": 0, "n_tm": 0,
        "n_tp": 0, "n_families": 0, "base_row": 0, "n_pivots": 0, "pivot_row": 0,
        "pivot_input": 0,
    },
    places={"head": ("line", 0), "block": ("total", 0)},
    range={"tas": FLYING, "mach": MACH, "alpha_ground": ALPHA},  # not the vane: a fault of it is to be named
    fit=lambda site: fitted(site),
)  # fmt: skip


def params(
    which: str = "flight", *, model: force_model.ForceModel, dt: float = TICK, delay: float = 2,
    lag: Sequence[float] = SERVO_LAG, rate: Sequence[float] = (0.0, 0.0, 0.0, 0.0), t_mean: float = 0.5,
    t_learn: float = 20.0, own: Folder = None,
) -> np.ndarray:  # fmt: skip
    """Return PARAMS for a `ForceModel`; `t_mean`, `t_learn` 0 switch the aids off.

    Commands are delayed by `delay` ticks as the measurements are [Mar10] slide 11, and by `lag` [s], what a healthy
    actuator takes on average (2 zeta / omega of a second-order one): elevator, aileron, rudder, stabiliser. They move
    at `rate` [rad/s] at most, in the same order, 0 for no limit. Of shorter ticks than TICK every `stride`-th is kept.
    Families come from the structure of the model's rows. Raises ValueError for a mean beyond 0.5 s, a delay beyond the
    buffer, too many families.
    """
    tables = force_model.fields(model)
    stride = max(1.0, math.floor(TICK / dt + 1e-9))
    late = delay + np.round(np.repeat(lag, COMMANDS) / dt)
    late = np.round((late - (stride - 1.0) / 2.0) / stride)  # the newest that is kept is half a stride old on average
    found = redundancy_structure.families(model.structure())
    for wrong, message in (
        (not 0 <= t_mean <= 0.5, f"t_mean = {t_mean}: the sliding mean is at most 0.5 s"),
        (not 0 <= late.min() <= late.max() < DELAY, f"a command delay of {late.max() * stride:.0f} ticks; at most "
                                                    f"{(DELAY - 1) * stride:.0f} fit"),
        (len(found) > NF, f"{len(found)} residual families, at most {NF} fit"),
    ):  # fmt: skip
        if wrong:
            raise ValueError(message)
    p = record(
        PARAMS, **tables, n_families=len(found), late=late, stride=stride, rate=np.repeat(rate, COMMANDS),
        t_mean=t_mean, t_learn=t_learn, limit=[0.8, 0.8, 0.8, 1.2], **thresholds("control_redundancy", which, own),
    )  # fmt: skip
    for i, family in enumerate(found):
        p["base_row"][0, i], p["n_pivots"][0, i] = family.base, len(family.pivots)
        for m, (row, replaced) in enumerate(family.pivots):
            p["pivot_row"][0, i, m], p["pivot_input"][0, i, m] = row, replaced
    return p


def fitted(site: Site) -> np.ndarray:
    """Return PARAMS for a loop, on the force model of the aircraft that flies."""
    about = site.aircraft()
    return params(model=about.model, dt=site.dt, t_learn=LEARN_S, own=site.own, delay=1.0 + site.ticks("n_z"),
                  lag=about.delays, rate=about.rates)  # fmt: skip


init = zero_state(STATE)  # nothing learned, averages empty


@kernel
def _without_data(x, p, dt, why):
    """Judge nothing for the reason `why`; averages and what was declared do not outlive a long gap."""
    x.gone += dt
    x.valid, x.why = 0.0, why
    if x.learned < 0.5:
        x.started = 0.0  # commands of a parked aircraft, or from before a gap, are not those of the flight
    if x.gone > p.t_invalid:
        x.in_block = x.blocks = 0.0
    if x.gone > T_HOLD:
        withdraw(x)


@kernel
def step(x, u, p, dt):
    """Compare measured with computed forces at one tick, average, evaluate the residuals, decide."""
    core.delayed_commands(x, u, p, dt)
    why = box(u.tas, u.tas_valid, FLYING, BOX_SPEED, VALID)
    why = box(u.mach, u.mach_valid, MACH, BOX_MACH, why)
    why = box(u.alpha_ground, u.alpha_ground_valid, ALPHA, BOX_ALPHA, why)
    if why == VALID and not core.complete(u):
        why = LOST_SENSOR
    if why != VALID:
        _without_data(x, p, dt, why)
        return
    core.row_errors(x, u, p)
    core.accelerometers(x, u, p, dt)
    core.vane(x, u, p, dt)
    rough = p.gust_max > 0.0 and x.rough * u.v_ground * u.v_ground > p.gust_max * p.gust_max
    x.gone = x.gone + dt if rough else 0.0
    if x.learned < 0.5:
        if not rough:
            core.learn(x, p, dt)
        x.valid, x.why = 0.0, GUSTS if rough else NOT_READY
        return
    full = core.average(x, p, dt)
    if rough:
        x.valid, x.why = 0.0, GUSTS
        if x.gone > T_HOLD:
            withdraw(x)
    elif full:
        x.valid, x.why = 1.0, VALID
        core.evaluate_families(x, p)
        decide(x, p, max(p.t_mean / BLOCKS, dt))
    elif x.valid < 0.5:
        x.why = NOT_READY


rollout = entry(step, STATE, INPUTS, PARAMS)
