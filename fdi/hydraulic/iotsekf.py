"""IOTSEKF: the input fault of one hydraulic actuator, by the two-stage filter of [Lu17], and what it is.

The filter (`two_stage_ekf`) gives the state and the input fault f^i in the unit of the valve command: the servo's
estimate. Plain tests (`plain_tests`) and the evidence of fault hypotheses on the innovations of a filter without a
fault state (`fdi.isolation`) raise the alarm; `name` says which of them names it:

| asked in turn | verdict |
|---|---|
| equal samples; a gap between rod and surface | SENSOR, EFFECTIVENESS |
| a valve that stands open | RUNAWAY |
| rod against surface; a pressure whose flow is missing | SENSOR |
| load beyond the hinge-moment model at rest, for a second or where no pressure sensor explains it | JAM_SOLID |
| nonlinear models of soft oil and joined chambers | EFFECTIVENESS |
| hypothesis that leads in the longest window; does the command pass? | SENSOR, OFC_LIQUID, OFC_SOLID, EFFECTIVENESS |

Load forms: 0 ignored, as published; 1 a hinge-moment model; 2 the pressure is measured and the load is a random walk
(default). While its pressure sensor is left out, form 2 runs on the hinge-moment model, `valid` speaks for the rod
alone, and only the pair is tested. INPUTS take the observers' copies of the sensors and the valve command held over the
last tick.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.common import linkage
from actuators.hydraulic import lu17
from fdi.common.record import Detector, Estimate
from fdi.common.tuning import thresholds
from fdi.common.verdict import AMBIGUOUS, EFFECTIVENESS, JAM_SOLID, NONE, OFC_LIQUID, OFC_SOLID, RUNAWAY, SENSOR
from fdi.hydraulic import plain_tests
from fdi.hydraulic import two_stage_ekf as two_stage
from fdi.isolation import decide as by_evidence
from fdi.isolation import likelihood, multiple_models
from fdi.isolation.evidence import HYPOTHESES

ISOLABLE_PARTS = ("", "rod", "surface", "pressure")
FORMS: dict[str, dict] = {  # how the load is known: what `params` is told; "published" is (14)-(36) as printed
    "pressure": {"load": 2},
    "hinge model": {"load": 1},
    "published": {"load": 0, "centre": 0.0, "total_sign": 0.0, "gate_rod": two_stage.GATE_NONE},
}

PARAMS = dtype([*two_stage.PARAMS, *plain_tests.PARAMS, *likelihood.PARAMS])
INPUTS = dtype(
    [
        ("u", "f8", "-"),  # valve command held over the last tick, as the servo sent it
        ("y_rod", "f8", "m"),
        ("y_rod_valid", "f8", "-"),
        ("y_surface", "f8", "rad"),
        ("y_surface_valid", "f8", "-"),
        ("y_dp", "f8", "-"),  # pressure difference over supply
        ("y_dp_valid", "f8", "-"),
        ("hm0_model", "f8", "N m"),  # hinge moment at zero deflection, by the model
        ("hmd_model", "f8", "N m/rad"),  # its slope
    ]
)
STATE = dtype(
    [
        *two_stage.STATE,
        *plain_tests.STATE,
        *likelihood.STATE,
        *multiple_models.STATE,
        ("rod_low", "f8", "m"),  # travel since the alarm
        ("rod_high", "f8", "m"),
        ("rod_slow", "f8", "m"),
        ("next_verdict", "f8", "-"),  # name that stands now,
        ("next_isolated_part", "f8", "-"),
        ("next_s", "f8", "s"),  # and for how long it has
        ("kind", "f8", "-"),  # class of `fdi.isolation.decide`, which tells kinds of fault with one verdict apart
        ("r", "f8", "-"),  # largest of all tests over their thresholds
        ("alarm", "f8", "-"),  # 1 while a fault is declared
        ("verdict", "f8", "-"),  # class code
        ("isolated_part", "f8", "-"),  # index into ISOLABLE_PARTS
        ("valid", "f8", "-"),  # 1 while the estimate can be trusted
    ]
)
OUTPUTS = (
    *("r", "alarm", "verdict", "isolated_part", "valid", "f_hat", "f_sigma", "q_now", "v_now", "x3_now", "nis_rod"),
    *("nis_dp", "r_run", "r_jam", "evidence", "pair_d", "rigging", "likely_hz", "kind"),
)
DETECTOR = Detector(
    id="iotsekf",
    level="local",
    summary="iterated optimal two-stage EKF: input fault of a hydraulic actuator [Lu17]",
    technologies=("hydraulic",),
    inputs={
        "u": "valve_command", "y_rod": "rod", "y_surface": "surface", "y_dp": "pressure", "hm0_model": "hm0",
        "hmd_model": "hmd",
    },
    group="actuator filters",
    designed_for={  # [Lu17]; plain tests and evidence
        "hydraulic.ofc_liquid": ("ofc_liquid",),
        "hydraulic.ofc_solid": ("ofc_solid",),
        "hydraulic.jam_solid": ("jam_solid",),
        "hydraulic.runaway": ("runaway",),
        **dict.fromkeys((
            "hydraulic.jam_liquid", "hydraulic.rod", "hydraulic.surface", "hydraulic.pressure",
            "hydraulic.ofc_liquid@sensor",
        ), ("sensor",)),
        **dict.fromkeys((
            "hydraulic.loss_of_effectiveness", "hydraulic.supply_pressure_drop", "hydraulic.internal_leakage",
        ), ("effectiveness",)),
    },
    may_see={
        **dict.fromkeys(("hydraulic.air_in_oil", "hydraulic.free_float"), ("effectiveness", "ambiguous")),
        "hydraulic.friction": ("jam_solid", "effectiveness", "ambiguous"),
        "hydraulic.backlash": ("sensor", "effectiveness", "ambiguous"),
    },
    blind="compares one hydraulic rod with its own valve command: a fault before the valve command moves both alike",
    estimates=(Estimate("valve", "f_hat", "u"),),
    finer={"kind": {
        by_evidence.WEAK: ("loss_of_effectiveness", "supply_pressure_drop", "internal_leakage", "air_in_oil"),
        by_evidence.OF_LOAD: ("friction",), by_evidence.GAP: ("backlash",), by_evidence.FREE_FLOAT: ("free_float",),
    }},
    looks_back={"delay": "u_old", "lag_ticks": "u_old"},
    places={"likely_fault": ("ev", 0)},
    options={"form": tuple(FORMS)},  # the first is the default
    belongs={"load": "form"},
    slow={"asks": 0.0},  # evidence rests on what each tick's command leaves in the pressure
    fit=lambda site, form="pressure": params(
        **FORMS[form], dt=site.dt, own=site.own, **({"travel": site.travel} if site.travel else {}),
        **site.known(PARAMS.names),
    ),
)
NOISE = {
    # process noise densities: what friction, tolerances and an unmodelled load do to q', dP and F
    "q": (1e-12, 2e-6, 2e-5, 0.05),
    "q_f": 1e-3,
    "r_rod": 1e-8,  # 0.1 mm, sensor set `transport`
    "r_dp": 2.5e-5,  # 0.5 % of supply
    "P0": (1e-8, 1e-6, 1e-4, 1e-2),
    "P0_f": 1e-4,
    "r_spare": 2e-8,  # 0.02 deg on 0.30 m, rigging removed
}
SUSPICIOUS = 0.7  # of a threshold, from which on all evidence is asked for
HOLD_S = 0.3  # for which a name has stood before it is given [s]
HOLD_SLOW_S = 0.7  # of a loss, whose command may be gone
PASSES = 0.2  # distance of `lost` from a half that errors of its model may make: within it the class stays open
STILL = 0.5e-3  # rod travel of a jam: noise of its sensor [m]
RUBS_MOST, HOLDS_S = 0.6, 2.0  # friction holds no more of the stall force, seldom a rod for longer [s]
LASTS_S = 1.0  # a jam that has lasted outranks the pressure sensor [s]
JAM_S = 10.0  # so long a jam outlives its last evidence while the rod is still [s]

# fitted to the step response of f_hat on the linear model with these noises at 5 ms: off by 1 % rms with the pressure,
# by 3 % without
LAG = {2: {"lag_omega": 50.1, "lag_zeta": 0.64, "lag_ticks": 0.0}}
LAG[0] = LAG[1] = {"lag_omega": 56.0, "lag_zeta": 0.56, "lag_ticks": 5.0}
# the same with the pressure for ticks from 10 ms on, whose measurements are of this tick: off by 1 % rms. One Euler
# step is as long as the lag there, and what it errs by is fitted with it; [s], [rad/s], [-]
SLOW_LAG = (0.01, 0.0125, 1.0 / 60.0, 0.02), (54.2, 51.0, 45.8, 41.9), (0.624, 0.593, 0.558, 0.535)


def params(
    which: Any = None,
    *,
    load: Any = 2,
    dt: Any = 0.005,
    delay_s: float = 0.005,
    arm: float = linkage.ARM,
    travel: tuple[float, float] = linkage.TRAVEL,
    own: Any = None,
    **values: Any,
) -> np.ndarray:
    """Return PARAMS for load form `load`, ticks of `dt` seconds and measurements `delay_s` old.

    The sensors' noise density is that of samples of 5 ms at every rate. `which` names the threshold set, by default
    that of the load form; `values` replace any field.
    """
    chosen = thresholds("iotsekf", which or f"flight_load{load}", own)
    v = {**lu17.NOMINAL, **NOISE, **LAG[load], **likelihood.design(dt, arm, travel, load == 2), **chosen}
    for name in ("r_rod", "r_dp", "r_spare"):
        v[name] *= likelihood.PERIOD / dt
    if load != 2:
        v["q"] = (*v["q"][:3], 0.0)
    elif dt >= SLOW_LAG[0][0]:
        v["lag_omega"], v["lag_zeta"] = (float(np.interp(dt, SLOW_LAG[0], held)) for held in SLOW_LAG[1:])
    fixed = {
        "arm": arm,
        "load": float(load),
        "centre": 1.0,
        "total_sign": 1.0,
        "delay": float(round(delay_s / dt)),
        "epsilon": 1e-9,
        "gate_rod": 12.0,
        "spikes": 4.0,
        "t_invalid": 0.2,
        "limit": (0.0,) * HYPOTHESES,
    }
    p = record(PARAMS, **{**fixed, **v, **values})
    likelihood.respond(p, dt)
    return p


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape, nothing learned, not started: the filters begin at the first usable rod sample."""
    x = np.zeros(p.shape, STATE)
    likelihood.begin(x, p)
    return x


@kernel
def travel(x, u, dt):
    """Follow how far the rod has moved since the alarm."""
    if u.y_rod_valid > 0.5 and math.isfinite(u.y_rod):
        x.rod_slow += min(dt / 0.02, 1.0) * (u.y_rod - x.rod_slow)
    if x.alarm < 0.5:
        x.rod_low = x.rod_high = x.rod_slow
    x.rod_low, x.rod_high = min(x.rod_low, x.rod_slow), max(x.rod_high, x.rod_slow)


@kernel
def by_plain_tests(x, moved):
    """Return (verdict, isolated_part) of what can be nothing else; NONE where no plain test says so."""
    if x.frozen > 0.5:
        return SENSOR, x.frozen
    if x.loose > 0.5:
        return EFFECTIVENESS, 0.0
    if x.stands_open != 0.0:
        return RUNAWAY, 0.0
    if x.sensor > 0.5 and (x.blame == 1.0 or (x.blame == 2.0 and x.backlash_suspected < 0.5)):
        return SENSOR, x.blame
    if x.jam < 0.5:
        return (SENSOR, 3.0) if x.misread > 0.5 else (NONE, 0.0)
    if moved and (x.likely == by_evidence.WEAK or x.likely == by_evidence.OF_LOAD):
        return EFFECTIVENESS, 0.0
    if x.jam_s <= LASTS_S and x.likely == by_evidence.OF_PRESSURE:
        return NONE, 0.0
    rubs = x.jam_most < RUBS_MOST and (x.jam_s < HOLDS_S or moved)
    return (AMBIGUOUS if rubs else JAM_SOLID), 0.0


@kernel
def name(x):
    """Return (verdict, isolated_part) of what stands: first what can be nothing else, then what it may be taken for."""
    moved, likely = x.rod_high - x.rod_low >= STILL, x.likely
    verdict, isolated_part = by_plain_tests(x, moved)
    if verdict != NONE:
        return verdict, isolated_part
    # the evidence of a pressure sensor knows no model of joined chambers: while these lead, they outrank it
    joined = x.rival_lead[multiple_models.JOINED] > multiple_models.NAMED
    if max(x.shown[0], x.shown[1]) > 0.5 and x.sensor < 0.5 and (joined or likely != by_evidence.OF_PRESSURE):
        return EFFECTIVENESS, 0.0
    if likely == by_evidence.WEAK and x.dp_out > 0.5:
        likely = by_evidence.OF_PRESSURE  # a reading that drifts takes the flow of a leak
    of_load = likely == by_evidence.OF_LOAD and not moved
    of_sensor = likely == by_evidence.OF_PRESSURE and x.sensor > 0.5
    if of_load or of_sensor or (likely == by_evidence.OF_SURFACE and x.backlash_suspected > 0.5):
        return AMBIGUOUS, 0.0
    if by_evidence.OF_ROD <= likely <= by_evidence.OF_PRESSURE:
        return SENSOR, likely - by_evidence.OF_ROD + 1.0
    if likely == by_evidence.WEAK or likely == by_evidence.OF_LOAD:
        return EFFECTIVENESS, 0.0
    if likely == by_evidence.OF_VALVE:
        doubt = PASSES + by_evidence.SURE * x.lost_sd * x.lost_sd
        added = 0.5 - x.lost if math.fabs(x.lost - 0.5) > doubt else (x.likely_added if doubt > 0.5 else 0.0)
        return (OFC_LIQUID if added > 0.0 else (OFC_SOLID if added < 0.0 else AMBIGUOUS)), 0.0
    return AMBIGUOUS, 0.0


@kernel
def alarmed(x):
    """Write the alarm: of a plain test, or of the evidence."""
    rests = x.rod_high - x.rod_low < STILL and x.likely == by_evidence.OF_LOAD and x.since < JAM_S
    if x.evidence_timer > 0.0 and (rests or x.at_stop > 0.5):  # a rod at rest shows nothing; nor does one at its stop
        x.evidence_timer = by_evidence.RELEASE_S
    plain = max(max(x.sensor, x.jam), max(x.run, x.misread)) > 0.5 or x.frozen > 0.5
    x.alarm = 1.0 if plain or x.evidence_timer > 0.0 else 0.0
    if x.frozen > 0.5:  # its last value shows nothing of the actuator: filter, windows and models begin anew
        x.h_started, x.rival_s, x.likely = 0.0, -1.0, 0.0
        x.shown[0] = x.shown[1] = 0.0
        likelihood.restart(x)


@kernel
def conclude(x, dt):
    """Write alarm, verdict, isolated_part and kind; a name, and what takes its place, has stood for a while."""
    alarmed(x)
    if x.alarm < 0.5:
        x.verdict, x.isolated_part, x.kind, x.next_s, x.dp_out = NONE, 0.0, 0.0, 0.0, 0.0
        x.alarm_s = x.likely = x.named = x.likely_hz = x.named_hz = x.emptied = x.likely_added = 0.0
        return
    x.alarm_s += dt
    verdict, isolated_part = name(x)
    x.next_s = x.next_s + dt if verdict == x.next_verdict and isolated_part == x.next_isolated_part else 0.0
    x.next_verdict, x.next_isolated_part = verdict, isolated_part
    sure = max(x.frozen, max(x.sensor, x.misread)) > 0.5 or x.stands_open != 0.0  # has been confirmed
    slow = x.likely == by_evidence.WEAK or (x.likely == by_evidence.OF_PRESSURE and x.likely_hz == 0.0)
    if sure or x.next_s >= (HOLD_SLOW_S if slow else HOLD_S):
        x.verdict, x.isolated_part, x.named = verdict, isolated_part, x.likely
        x.named_fault, x.named_hz = x.likely_fault, x.likely_hz
    elif x.verdict == NONE:
        x.verdict = AMBIGUOUS
    x.dp_out = 1.0 if x.verdict == SENSOR and x.isolated_part == 3.0 else 0.0
    x.kind = by_evidence.GAP if x.loose > 0.5 else x.likely
    if x.loose < 0.5 and x.verdict == EFFECTIVENESS and max(x.shown[0], x.shown[1]) > 0.5:
        x.kind = by_evidence.FREE_FLOAT if x.shown[multiple_models.JOINED] > 0.5 else by_evidence.WEAK


@kernel
def step(x, u, p, dt):
    """Estimate state and input fault, test, ask the evidence, name what stands."""
    two_stage.remember(x, u)
    likelihood.listen(x, u, p, x.r > SUSPICIOUS, dt)
    two_stage.estimate(x, u, p, dt)
    if x.started < 0.5:
        x.valid = 0.0
        return
    x.valid = 1.0 if x.age <= p.t_invalid else 0.0
    plain_tests.update(x, u, p, dt)
    x.r = max(math.fabs(x.pair_d) / x.pair_limit, max(x.r_run, x.r_jam))
    multiple_models.update(x, u, p, dt)
    travel(x, u, dt)
    conclude(x, dt)
    x.r = max(x.r, x.evidence)


rollout = entry(step, STATE, INPUTS, PARAMS)
