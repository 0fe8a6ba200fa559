"""IOTSEKF: the input fault of one hydraulic actuator, by the two-stage filter of [Lu17], and what it is.

The filter (`two_stage`) gives the state and the input fault f^i in the unit of the valve command. Tests read them, and
`fdi/hydraulic/hypotheses.py` weighs what healthy, added, in place and lossy leave over before it gives a name:

| test | statistic | verdict |
|---|---|---|
| pair | rod - arm surface - rigging; each against the model's own motion | SENSOR rod, surface, or AMBIGUOUS |
| pressure | a jump, a frozen value, an excess whose flow is missing (load form 2, `pressure_test`) | SENSOR pressure |
| oscillation | two-period least squares of f_hat - gain u over a bank of frequencies | OFC_LIQUID, OFC_SOLID |
| jam | load beyond the hinge-moment model while the rod is still (load form 2) | JAM_SOLID |
| input fault | lagged f_hat - gain u | RUNAWAY |

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
from actuators.hydraulic.lu17 import opening, stiffness
from fdi.common import bank, decision
from fdi.common.decision import confirm, usable
from fdi.common.record import Detector, Estimate
from fdi.common.tuning import thresholds
from fdi.common.verdict import NONE, SENSOR
from fdi.hydraulic import command_response, hypotheses, pressure_test, runaway_test, sample_rings, sensor_noise
from fdi.hydraulic import two_stage_ekf as two_stage
from fdi.isolation import backlash, filter, likelihood, multiple_models
from fdi.isolation import decide as by_evidence
from fdi.isolation.evidence import HYPOTHESES

CULPRITS = ("", "rod", "surface", "pressure")
FORMS: dict[str, dict] = {  # how the load is known: what `params` is told; "published" is (14)-(36) as printed
    "pressure": {"load": 2},
    "hinge model": {"load": 1},
    "published": {"load": 0, "centre": 0.0, "total_sign": 0.0, "gate_rod": two_stage.GATE_NONE},
}

PARAMS = dtype(
    [
        *two_stage.PARAMS,
        *decision.PAIR_PARAMS,
        *decision.OFC_PARAMS,
        *sample_rings.PARAMS,
        *command_response.PARAMS,
        *pressure_test.PARAMS,
        *likelihood.PARAMS,
        ("lag_omega", "f8", "rad/s"),  # f_hat follows f as a second-order lag: corner
        ("lag_zeta", "f8", "-"),  # damping
        ("lag_ticks", "f8", "-"),  # dead time beyond the first tick
        ("run_tau", "f8", "s"),  # lag of the estimates that the runaway and jam tests use
        ("run_threshold", "f8", "-"),  # input fault
        ("run_share", "f8"),  # ... plus this share of the valve command
        ("run_confirm", "f8", "s"),
        ("jam_threshold", "f8", "-"),  # load beyond the model, over the stall force
        ("jam_share", "f8"),  # ... plus this share of the model's load
        ("jam_still", "f8", "m/s"),  # rod velocity below which the surface is still
        ("jam_confirm", "f8", "s"),
    ]
)
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
        *decision.PAIR_STATE,
        *decision.OFC_STATE,
        *sample_rings.STATE,
        *hypotheses.STATE,
        *command_response.STATE,
        *likelihood.STATE,
        ("jump_e", "f8", "m"),  # last innovation of the only position sensor
        ("jump_side", "f8", "m"),  # innovation at its jump
        ("jump_ticks", "f8", "-"),  # ticks for which the jump has stood
        ("jump_of", "f8", "-"),  # 1 the rod sensor, 2 the surface sensor, the only one left, has jumped
        ("form", "f8", "-"),  # noise of f_hat over that with all sensors
        ("noise_scale", "f8", "-"),  # the same with what noise the sensors are heard to have
        ("drive", "f8", "-"),  # valve command behind the filter's own lag, so that f_hat + drive is what the valve did
        ("drive_d", "f8", "1/s"),  # its derivative
        ("load_lag", "f8", "-"),  # pressure behind the same lag
        ("load_d", "f8", "1/s"),  # its derivative
        ("f_slow", "f8", "-"),  # lagged input fault, gain error removed
        ("u_slow", "f8", "-"),  # lagged valve command
        ("q_fast", "f8", "m"),  # rod, lagged once
        ("q_slow", "f8", "m"),  # rod, lagged more
        ("v_slow", "f8", "m/s"),  # velocity from their difference: the filter's own is wrong while a jam loads up
        ("excess", "f8", "-"),  # lagged load beyond the model
        ("run_timer", "f8", "s"),
        ("run", "f8", "-"),  # 1 while an input fault is declared
        ("jam_timer", "f8", "s"),
        ("jam", "f8", "-"),  # 1 while a jam is declared
        ("r_run", "f8", "-"),  # input fault over its threshold
        ("r_jam", "f8", "-"),  # load excess over its threshold
        ("r", "f8", "-"),  # largest of all tests over their thresholds
        ("alarm", "f8", "-"),  # 1 while a fault is declared
        ("verdict", "f8", "-"),  # class code
        ("culprit", "f8", "-"),  # index into CULPRITS
        ("valid", "f8", "-"),  # 1 while the estimate can be trusted
    ]
)
OUTPUTS = (
    *("r", "alarm", "verdict", "culprit", "valid", "f_hat", "f_sigma", "q_now", "v_now", "x3_now", "nis_rod", "nis_dp"),
    *("r_ofc", "r_run", "r_jam", "pair_d", "rigging", "gain", "ofc_hz", "ofc_amplitude", "kind"),
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
    designed_for={  # [Lu17]; five tests, fdi/hydraulic/iotsekf.py
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
        by_evidence.OF_LOAD: ("friction",), by_evidence.APART: ("backlash",), by_evidence.FREE_FLOAT: ("free_float",),
    }},
    looks_back={"delay": "u_old", "lag_ticks": "u_old"},
    sizes=bank.SIZES,
    places=bank.PLACES,
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
# An input fault beyond its threshold counts in proportion up to this: with 1.5, the half periods of an oscillation of
# 0.6 mm at 10 Hz, 35 ms beyond it, would do for a runaway
RUN_WEIGHT = 1.25
SUSPICIOUS = 0.7  # of a threshold, from which on all evidence is asked for
WITHOUT_ROD, WITHOUT_PRESSURE = 1.6, 4.0  # noise of f_hat on the surface sensor; on the hinge-moment model
JUMP, BEFORE = 6e-4, 0.4  # of a position, six sigma of the sensor [m], and the share that the sample before may have
PERIOD = 0.005  # of the samples whose variance stands in NOISE [s]

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
    v = {**lu17.NOMINAL, **NOISE, **LAG[load], **bank.design(dt), **sample_rings.design(dt, load),
         **command_response.design(dt), **likelihood.design(dt, arm, travel, load == 2), **chosen}
    for name in ("r_rod", "r_dp", "r_spare"):
        v[name] *= PERIOD / dt
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
        **pressure_test.FIXED,
        "spikes": 4.0,
        "t_invalid": 0.2,
        "keep_mean": 1.0 if load == 2 else 0.0,
        "limit": (0.0,) * HYPOTHESES,
    }
    p = record(PARAMS, **{**fixed, **v, **values})
    likelihood.respond(p, dt)
    return p


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape, nothing learned, not started: the filters begin at the first usable rod sample."""
    x = np.zeros(p.shape, STATE)
    x["step_age"] = pressure_test.SETTLES
    likelihood.begin(x, p)
    return x


@kernel
def model_velocity(x, p):
    """Return the rod velocity that valve and pressure alone imply, compressibility left out [m/s]. [Lu17] (4)"""
    v = x.u_old[int(p.delay)]
    x3 = x.x_hat[2]
    return (1.0 + x.gain) * p.phi_n / p.A_p * opening(v, x3) * v - p.L * x3


@kernel
def by_model(x, p):
    """Return what learned errors of oil and supply leave in the input fault of [Lu17] (4), behind its lag [1].

    The gain is learned beside it; leakage and a constant flow are what a slow fault of the pressure sensor looks like.
    """
    root = max(opening(x.drive, x.load_lag), lu17.ROOT_FLOOR)
    stiff = x.fed[filter.SOFT] - p.prior_mean[filter.SOFT]  # by how the two filters differ where nothing is learned
    soft = stiff / (1.0 + stiff) * x.load_d / stiffness(x.x_hat[0], p)
    return soft * p.A_p / (p.phi_n * root) - 0.5 * x.fed[filter.SUPPLY] * x.drive / (root * root)


@kernel
def jumped(x, rod, surface, dt):
    """Where only one position sensor is left, hold that it has jumped until there are two again to compare."""
    if rod > 0.5 and surface > 0.5:
        x.jump_of = 0.0
    elif x.pair_time > 0.0 and x.age == 0.0 and x.sensor < 0.5:
        e = math.fabs(x.gamma_rod)
        # samples of an oscillation rise one after the other
        if e > JUMP and x.jump_e < BEFORE * e and x.declared < 0.5:
            x.jump_ticks = 1.0
        elif x.jump_ticks > 0.0:
            x.jump_ticks = x.jump_ticks + 1.0 if x.gamma_rod * x.jump_side > 0.2 * JUMP * JUMP else 0.0
            if x.jump_ticks >= 3.0:
                x.jump_of = 1.0 if rod > 0.5 else 2.0
                x.jump_ticks = 0.0
                x.t_settling = max(x.t_settling, decision.T_DISTURBED)
        if x.jump_ticks == 1.0:
            x.jump_side = x.gamma_rod
        x.jump_e = e


@kernel
def decide(x, u, p, dt):
    """Run the tests on the estimate: sensors first, then oscillation, jam and input fault."""
    rod, surface = usable(u.y_rod, u.y_rod_valid), usable(u.y_surface, u.y_surface_valid)
    bulk = x.x_hat[2] / stiffness(x.x_hat[0], p)  # rod motion that only compresses oil
    y_surface = p.arm * u.y_surface + bulk
    known, slack = x.lever_P[2] > 0.0, 0.0  # by the filter without a fault state, where it runs
    if known:
        x.rigging, slack = decision.lever_at(x, x.h_hat[0])
    motion = model_velocity(x, p)
    decision.pair_test(x, u.y_rod + bulk, rod, y_surface, surface, motion, x.x_hat[3], slack, known, p, dt)
    pressure = usable(u.y_dp, u.y_dp_valid) if p.load == 2.0 else 0.0
    e_rod = u.y_rod - p.arm * u.y_surface - x.rigging - x.pair_d if surface > 0.5 else x.gamma_rod
    d = min(int(p.delay), two_stage.HISTORY - 2)
    gain = decision.GAIN_LIMIT + math.fabs((1.0 + x.fed[filter.SOFT]) * (1.0 + x.fed[filter.FAST]) - 1.0)
    steps = gain * math.fabs(x.G[2] * (x.u_old[d] - 2.0 * x.u_old[d + 1] + x.u_old[d + 2]))
    sensor_noise.update(x, rod, u.y_rod, e_rod, pressure, u.y_dp, x.dp_e, steps, p, dt)
    lost = p.load == 2.0 and x.age_dp > p.t_invalid
    form = WITHOUT_PRESSURE if lost else (WITHOUT_ROD if x.blame == 1.0 or x.age_rod > p.t_invalid else 1.0)
    loud = x.rod_noisy > 0.5 or x.dp_noisy > 0.5
    good = pressure > 0.5 and not lost and x.dp_out < 0.5 and x.dp_noisy < 0.5
    command_response.update(x, p, 1.0 if good else 0.0, dt)
    jumped(x, rod, surface, dt)
    if form != x.form or loud:
        x.t_settling = max(x.t_settling, decision.T_DISTURBED)
        x.form = form
    x.noise_scale = form * math.sqrt(max(1.0, max(x.rod_rough / p.r_rod, x.dp_noise / p.r_dp) / sensor_noise.USUAL))
    disturbed = x.t_settling > 0.0 or x.valid < 0.5
    if disturbed and (x.sensor > 0.5 or loud or x.valid < 0.5 or lost):
        hypotheses.forget(x, True)
    x.drive_d += dt * p.lag_omega * (p.lag_omega * (x.u_old[int(p.lag_ticks)] - x.drive) - 2.0 * p.lag_zeta * x.drive_d)
    x.drive += dt * x.drive_d
    x.load_d += dt * p.lag_omega * (p.lag_omega * (x.x_hat[2] - x.load_lag) - 2.0 * p.lag_zeta * x.load_d)
    x.load_lag += dt * x.load_d
    f = x.f_hat - by_model(x, p)
    renewed = bank.push(x, p, f, x.drive)
    fresh = sample_rings.push(x, p, f, x.drive, x.load_lag)
    other = x.jam > 0.5 or (x.swings < 1.5 and (x.run > 0.5 or x.r_run >= 1.0))
    hypotheses.search(x, p, renewed, fresh, disturbed, not disturbed and x.alarm < 0.5, other, dt)
    a = 1.0 - math.exp(-dt / p.run_tau)
    x.f_slow += a * (f - x.gain * x.drive - x.f_slow)
    x.u_slow += a * (x.drive - x.u_slow)
    run_share = p.run_share + decision.unlearned(x, p)
    x.r_run = math.fabs(x.f_slow) / (x.noise_scale * p.run_threshold + run_share * math.fabs(x.u_slow))
    ran = x.r_run >= 1.0 and not disturbed
    # size times time: against the servo, which fights it, a runaway is an input fault that comes and goes
    weighed = dt * min(x.r_run, RUN_WEIGHT) if ran else dt
    ran_before = x.run
    x.run_timer, x.run = confirm(x.run_timer, x.run, ran, weighed, p.run_confirm, p.t_release)
    x.step_age += dt
    if x.run < 0.5:
        x.run_side, x.swings = 0.0, 0.0
    elif ran:
        side = 1.0 if x.f_slow > 0.0 else -1.0
        if x.run_side == 0.0:
            x.run_side = side
        elif side != x.run_side:  # once may be the servo's answer to a runaway, back again is an oscillation
            x.run_side = side
            x.swings += 1.0
    x.r_jam = 0.0
    share = 0.0
    if p.load == 2.0:
        model = two_stage.load_model(x, u, p)
        x.excess += a * (x.x_hat[3] - model - x.excess)
        x.r_jam = math.fabs(x.excess) / (p.jam_threshold + p.jam_share * math.fabs(model))
        declared = disturbed or lost or x.run > 0.5 or x.jam > 0.5 or x.ofc_timer > 0.0
        pressure_test.keep(x, declared, dt)
        share = pressure_test.plausible(x, u, model, x.r_jam >= 1.0, declared, p, dt)
    x.q_fast += a * (x.x_hat[0] - x.q_fast)
    x.q_slow += dt / (2.0 * p.run_tau) * (x.q_fast - x.q_slow)
    x.v_slow = (x.q_fast - x.q_slow) / (2.0 * p.run_tau)
    still = math.fabs(x.v_slow) < p.jam_still
    jammed = x.r_jam >= 1.0 and still and not disturbed and not lost and (share < p.share_least or x.jam > 0.5)
    x.jam_timer, x.jam = confirm(x.jam_timer, x.jam, jammed, dt, p.jam_confirm, p.t_release)
    if renewed > 0.5:
        one = x.run > 0.5 and x.swings < 1.5 and x.proof < 0.5 * command_response.SURE and not (lost and still)
        x.opens = 1.0 if one and runaway_test.runs_away(x, p, dt) else 0.0
    before, named = x.declared, x.named
    hypotheses.conclude(x, x.jam > 0.5, x.run > 0.5)
    if before > 0.5 and x.declared < 0.5:  # half a period of a slow oscillation rises, falls and has no name
        hypotheses.forget(x, named != NONE)
    if (before > 0.5) != (x.declared > 0.5) or (ran_before < 0.5 and x.run > 0.5):
        command_response.reset(x)
    left_out = x.dp_out > 0.5 and x.sensor < 0.5
    if loud and x.sensor < 0.5:
        x.declared, x.verdict, x.culprit = 1.0, SENSOR, 1.0 if x.rod_noisy > 0.5 else 3.0
    elif x.jump_of > 0.5 and x.declared < 0.5:
        x.declared, x.verdict, x.culprit = 1.0, SENSOR, x.jump_of
    elif (left_out or math.fabs(x.dp_offset) > 0.5 * pressure_test.STEP_LEAST) and x.declared < 0.5:
        x.declared, x.verdict, x.culprit = 1.0, SENSOR, 3.0
    pair = math.fabs(x.pair_d) / x.pair_limit
    x.r = max(max(pair, x.r_ofc), max(x.r_run, x.r_jam if still or left_out else 0.0))


@kernel
def step(x, u, p, dt):
    """Estimate state and input fault, then test."""
    two_stage.estimate(x, u, p, dt)
    if x.started < 0.5:
        x.valid = 0.0
        return
    x.valid = 1.0 if x.age <= p.t_invalid and x.rod_wild < sensor_noise.WILD * p.r_rod else 0.0
    decide(x, u, p, dt)
    likelihood.listen(x, u, p, x.r > SUSPICIOUS, dt)
    if x.ended > 0.5:  # what the rings hold is of the fault that has healed
        hypotheses.forget(x, True)
    multiple_models.update(x, u, p, dt)
    backlash.update(x, x.x_hat[0], dt)
    by_evidence.follow(x, u, x.declared > 0.5, dt)
    x.alarm = x.declared
    asked = p.asks > 0.5 and x.h_lost[filter.PRESSURE] <= likelihood.LOST_S and x.sensor < 0.5
    if x.blocks == 0.0:
        x.borne = 1.0  # there is no evidence yet that could speak against the rules
    by_evidence.conclude(x, by_evidence.frozen(x, u, dt), asked)
    x.r = max(x.r, x.evidence)


rollout = entry(step, STATE, INPUTS, PARAMS)
