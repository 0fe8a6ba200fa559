"""Faults of an electromechanical elevator actuator from one Kalman filter on the motor velocity, fit for flight.

[Jay]'s filter with what an elevator adds to the bench: the hinge moment HM0 + HM_delta x1 of a model enters the
prediction, its stiffness stands inside A, and what that model misses is a bounded load d (first-order Gauss-Markov).

    x = [x1 surface, x2 rate, x3 motor angle, x4 rate, x5 current, d],   x+ = Phi(HM_delta) x + G u + G_h HM0 + K gamma

| relation | broken by | in |
|---|---|---|
| position - surface - velocity's integral | a sensor, named by the other two; backlash | `position_consistency` |
| current - demand | the drive, or the current sensor: what the motor has felt tells which | `drive`, `shapes` |
| torque - motion | what holds the surface: a load that no hinge explains | `vote` |

On a verdict on the position sensor `reconf` asks to close the loop on pos_hat. With a lost sensor the rest goes on:

| lost | what is left |
|---|---|
| surface | the velocity against the position, AMBIGUOUS; drive and jam as ever |
| position | the velocity against the surface, AMBIGUOUS; drive and jam as ever; pos_hat |
| velocity | the position takes its place in the filter; position against surface, drive: AMBIGUOUS; jam |
| current | sensors and jam as ever |

While all is well, pos_hat is tied to the position sensor by a slow second Kalman filter on (offset c, rate b): it
learns the velocity sensor's small bias. From the first suspicion on it runs free, and its covariance is pos_sigma; once
the position sensor is named it is tied to the surface's. The filter's angle follows pos_hat, so that a velocity error
that has healed is left neither in the angle nor, times the hinge stiffness, in the load.

Windows are seconds. They are kept in slots, means over `n_sub` ticks and at least 5 ms long, and a test changes when a
slot ends; at 200 Hz a slot is a tick. At any rate the demand is as late as the sensors, and the continuous filter, its
noise densities and what a threshold means are those of 200 Hz.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.common import linkage
from actuators.constants import RAD_PER_DEG
from actuators.ema import jay
from fdi.common.decision import usable
from fdi.common.record import Detector, Estimate
from fdi.common.tuning import thresholds
from fdi.common.verdict import EFFECTIVENESS
from fdi.ema import backlash, drive, gains, position_consistency, sensor_noise, shapes, torque
from fdi.ema.dead_reckoning import reckon_position, slot
from fdi.ema.ema_kalman import VELOCITY
from fdi.ema.model import designed
from fdi.ema.velocity import correct, predict
from fdi.ema.vote import ISOLABLE_PARTS, decide, size

__all__ = ["INPUTS", "ISOLABLE_PARTS", "OUTPUTS", "PARAMS", "STATE", "init", "params", "rollout", "step"]

HISTORY = 10  # ticks of demand kept for the delay: 5 ms at 2 kHz

PARAMS = dtype([
    ("Phi", "f8", (6, 6)),    # transition over one tick without hinge stiffness, SI
    ("Phi_h", "f8", (6, 6)),  # its derivative by the hinge stiffness [per N m/rad]
    ("G", "f8", (6,)),        # of the demanded current
    ("G_h", "f8", (6,)),      # of the hinge moment
    ("K", "f8", (6,)),        # steady Kalman gain on the velocity [per rad/s]
    ("S_root", "f8", "rad/s"),  # standard deviation of the innovation
    ("lead", "f8", "m/rad"),  # ball screw
    ("ratio", "f8", "-"),     # surface per motor angle, spring at rest
    ("spring", "f8", "N m/rad"),  # l^2 K_s
    ("impulse", "f8", "rad/s/A"),  # velocity change per ampere and tick
    ("K_gi", "f8", "V/A"),    # drive: volts per ampere demanded
    ("R_loop", "f8", "Ohm"),  # K_i K_c + R
    ("R", "f8", "Ohm"),       # winding
    ("K_B", "f8", "V s/rad"),
    ("I_max", "f8", "A"),          # limits of the amplifier [A], [V]
    ("V_max", "f8", "V"),
    ("delay", "f8", "-"),          # ticks by which the sensors lag, 0 to HISTORY
    ("n_sub", "f8", "-"),          # ticks of a slot
    ("sigma_pos", "f8", "m"),  # position sensor noise
    ("sigma_rig", "f8", "m"),  # its rigging bias, which nothing here can see
    ("sigma_vel", "f8", "rad/s"),  # velocity sensor noise
    ("sigma_b", "f8", "rad/s"),  # its bias at engage
    ("walk_b", "f8", "rad/s"),  # and that bias's random walk per tick
    ("b_max", "f8", "rad/s"),  # largest velocity bias that is learned
    ("sigma_tie", "f8", "m"),  # position noise that the anchor assumes: large, so that it ties slowly
    ("th_R1", "f8", "m"),     # ramp of R1
    # load that no hinge explains, as large as a fault is to be: 0.4 of the stall moment, which jams and stops pass. A
    # false alarm is far below: training `ema` asks for 0.16 of that moment (fdi/thresholds: found, load)
    ("th_load", "f8", "N m"),
    ("stop_low", "f8", "m"),  # rod at the stops, less a margin: a drive that presses there is not jammed
    ("stop_high", "f8", "m"),
    ("load_max", "f8", "N m"),  # limit of the load estimate
    ("gate", "f8", "rad/s"),  # innovation, and step from sample to sample, beyond which it is a spike
    ("sigma_max", "f8", "m"),  # pos_sigma above which the estimate is not valid
    ("t_load", "f8", "s"),    # a stop that is hit or a gust at stall is over sooner
    ("t_hold", "f8", "s"),    # lag of the mean rate
    ("t_bad", "f8", "s"),     # velocity samples missing or rejected for longer: start again, or a fault
    ("t_start", "f8", "s"),   # after engage: the load estimate settles, no test counts
    ("t_doubt", "f8", "s"),   # a velocity sensor that was wrong tells nothing of the magnets for so long
    ("t_name", "f8", "s"),    # a name of the drive follows the alarm after so long at least
    ("phi_load", "f8", "rad/s/N m"),  # rate from the load state over a tick
    ("leak", "f8", "-"),  # of the load state over a tick
    ("felt_least", "f8", "-"),  # share of a gain that is off that the motor must have felt
    *position_consistency.PARAMS,
    *drive.PARAMS,
    *gains.PARAMS,
    *torque.PARAMS,
    *sensor_noise.PARAMS,
])
INPUTS = dtype([
    ("u", "f8", "A"),         # demanded current held over the tick that ends at this sample
    ("y_velocity", "f8", "rad/s"),  # motor rate
    ("y_position", "f8", "m"),  # rod position, + extends
    ("y_current", "f8", "A"),  # motor current, the monitor's copy
    ("velocity_valid", "f8", "-"),
    ("position_valid", "f8", "-"),
    ("current_valid", "f8", "-"),
    ("y_surface", "f8", "rad"),  # surface, trailing edge down +
    ("surface_valid", "f8", "-"),
    ("hm0_model", "f8", "N m"),  # hinge moment at zero deflection, + trailing edge down, by the model
    ("hmd_model", "f8", "N m/rad"),  # its slope, negative where it centres
])
STATE = dtype([
    ("r", "f8", "-"),         # largest test over its threshold
    ("alarm", "f8", "-"),     # 1 while a fault is declared
    ("verdict", "f8", "-"),   # NONE, SENSOR, JAM_SOLID, EFFECTIVENESS, AMBIGUOUS or of the drive
    ("isolated_part", "f8", "-"),   # index into ISOLABLE_PARTS
    ("valid", "f8", "-"),     # 1 while pos_hat can be trusted
    ("reconf", "f8", "-"),         # 1: close the loop on pos_hat
    ("pos_hat", "f8", "m"),   # estimated rod position, as the healthy sensor would read it
    ("pos_sigma", "f8", "m"),  # its standard deviation
    ("f_hat", "f8", "m, rad/s, A"),          # size of the declared fault [m], [rad/s] or [A]
    ("f_sigma", "f8", "m, rad/s, A"),        # its standard deviation, same unit
    ("eta", "f8", "-"),            # normalised innovation (6)
    ("R1", "f8", "m"),        # (9), mean of the last slot
    ("R2", "f8", "A"),        # (9), mean of the last slot
    ("load_hat", "f8", "N m"),  # hinge moment that the model misses
    ("x_hat", "f8", (6,), "rad, rad/s, rad, rad/s, A, N m"),  
    ("started", "f8", "-"),        # 1 once engaged
    ("age", "f8", "s"),       # since engage
    ("age_vel", "f8", "s"),   # since the last velocity sample that was used
    ("raw_last", "f8", "rad/s"),  # last velocity sample, spike or not
    ("age_cur", "f8", "s"),   # and of the current
    ("u_old", "f8", (HISTORY + 1,), "A"),  # demands held over the last ticks, newest first
    ("at_limit", "f8", "-"),       # 1: the amplifier is at its voltage limit
    ("hm0", "f8", "N m"),            # last finite values [N m], [N m/rad]
    ("hmd", "f8", "N m/rad"),
    ("reckon", "f8", "m"),    # position at engage and the velocity sensor's integral since
    ("w_last", "f8", "rad/s"),  # last velocity that went into it
    ("w_slow", "f8", "rad/s"),  # its mean over t_hold
    ("drift", "f8", "m"),     # y_position - reckon
    ("c", "f8", "m"),         # anchor: its line at this tick
    ("b", "f8", "m/s"),       # and slope
    ("P_cc", "f8", "m2"),           # covariance of both [m^2], [m^2/s], [m^2/s^2]
    ("P_cb", "f8", "m2/s"),
    ("P_bb", "f8", "m2/s2"),
    ("timer_load", "f8", "s"),
    ("hot_load", "f8", "-"),
    ("quiet_timer", "f8", "s"),  # since there was no sign of the fault
    ("hold", "f8", "s"),      # by which the alarm outlives its last sign
    ("hold_age", "f8", "s"),  # since the last alarm, 0 before the first
    ("alarm_age", "f8", "s"),  # since the alarm
    ("age_doubt", "f8", "s"), # since the velocity was last said to be wrong
    ("impact", "f8", "s"),    # time left after the rate has jumped as it does where a stop is hit
    ("shift", "f8", "rad"),   # motor angle less the position sensor's, where that stands for a lost velocity
    ("count", "f8", "-"),          # ticks of the slot that is open, 0 where one has just ended
    ("sum_drift", "f8", "m"),  # `drift`
    ("sum_R2", "f8", "A"),    # current less x5
    ("n_position", "f8", "-"),     # usable samples of position and current in it
    ("n_current", "f8", "-"),
    ("work", "f8", (6,)),     # scratch
    *position_consistency.STATE,
    *drive.STATE,
    ("even_lost", "f8", "-"),  # ticks of the sample that say nothing
    *gains.STATE,
    *torque.STATE,
    *backlash.STATE,
    *sensor_noise.STATE,
])
OUTPUTS = (
    "r", "alarm", "verdict", "isolated_part", "valid", "reconf", "pos_hat", "pos_sigma", "f_hat", "f_sigma", "eta",
    "R1", "R2", "load_hat", "hot_friction", "pair_name", "drive_lost",
)
DETECTOR = Detector(
    id="ema_kalman_flight",
    level="local",
    summary="Kalman filter with hinge load, process noise and surface sensor: sensors, drive and jam",
    technologies=("ema",),
    inputs={
        "u": "current_command", "y_velocity": "velocity", "y_position": "position", "y_current": "current",
        "y_surface": "surface", "hm0_model": "hm0", "hmd_model": "hmd",
    },
    group="actuator filters",
    designed_for={
        **dict.fromkeys((
            "ema.velocity", "ema.position", "ema.jam_liquid", "ema.current", "ema.surface", "ema.ofc_liquid@sensor",
        ), ("sensor",)),
        "ema.ofc_liquid": ("ofc_liquid",),
        "ema.ofc_solid": ("ofc_solid",),
        "ema.hardover": ("runaway",),
        "ema.jam*": ("jam_solid",),
        **dict.fromkeys(("ema.loss_of_effectiveness", "ema.magnet_loss", "ema.free_float"), ("effectiveness",)),
    },
    may_see={
        **dict.fromkeys((
            "ema.winding_resistance", "ema.backlash", "ema.friction",
        ), ("effectiveness", "ambiguous")),
    },
    blind="compares the sensors of one electromechanical drive with the model of its own demand: a fault before "
    "the demand moves both alike",
    estimates=(
        Estimate("velocity", "f_hat", "rad/s"), Estimate("position", "f_hat", "m"),
        Estimate("current", "f_hat", "A"),
    ),
    finer={
        "hot_friction": {1: ("friction", "jam")}, "pair_name": {int(EFFECTIVENESS): ("backlash", "free_float")},
        "drive_lost": {1: ("loss_of_effectiveness", "magnet_loss", "winding_resistance"),
                       2: ("free_float", "loss_of_effectiveness")},
    },
    looks_back={"delay": "u_old"},
    sizes={"n_sub": 1},
    fit=lambda site: params(dt=site.dt, travel=site.travel, **site.actuator),
)  # fmt: skip



def params(
    which: str = "flight",
    *,
    dt: float = jay.PERIOD,
    delay_s: float = 0.005,
    sigma_velocity: float = 1.0,
    sigma_position: float = 1e-4,
    travel: tuple[float, float] | None = None,
    **symbols: Any,
) -> np.ndarray:
    """Return PARAMS with threshold set `which` of fdi/thresholds/ema_kalman_flight.json.

    Sensors: noise per 5 ms sample, 1 sigma [rad/s], [m] ([Jay] section 4 read so), `delay_s` old. `symbols` replace
    those of `actuators.ema.jay.values("elevator")`. Model errors behind the gain: a load of 630 N m wandering with 20 s
    (it must follow 30 % of the hinge moment within a pulse and hardly leak) and 1 rad/s per 5 ms, white, of friction
    and torque error. Raises ValueError for unknown names.
    """
    v = jay.values("elevator", **symbols)
    travel = travel or linkage.TRAVEL
    made = designed(v, dt, sigma_velocity)
    noise = math.sqrt(jay.PERIOD / dt)
    trained = thresholds("ema_kalman_flight", which)
    arm, lead = v["arm"], v["lead"]
    amperes, volts = jay.LIMITS["elevator"]
    no_load = volts / v["K_B"]
    return record(
        PARAMS,
        **made,
        lead=lead,
        ratio=lead / arm,
        spring=arm * arm * v["K_s"],
        impulse=v["K_T"] / (v["J_M"] + v["J_N"] * (lead / arm) ** 2) * dt,
        K_gi=v["K_gi"],
        R_loop=v["K_ic"] + v["R"],
        R=v["R"],
        K_B=v["K_B"],
        I_max=amperes,
        V_max=volts,
        delay=float(round(delay_s / dt)),
        n_sub=slot(dt),
        sigma_pos=noise * sigma_position,
        sigma_rig=0.08 * RAD_PER_DEG * arm,  # sensor set `transport`: rigging
        sigma_vel=noise * sigma_velocity,
        sigma_b=2e-4 * no_load,  # twice the bias of 1e-4 of no-load that a velocity sensor is assumed to have
        walk_b=1e-4 * no_load * math.sqrt(dt / 100.0),  # which may change by itself in 100 s
        b_max=1e-3 * no_load,
        # ties pos_hat within some 20 s: slower than a fault, faster than a bias of 1e-3; of a slot's mean
        sigma_tie=noise / math.sqrt(slot(dt)) * 1.0 * RAD_PER_DEG * arm,
        gate=0.3 * no_load,  # twice what the stall current does in 5 ms
        load_max=2.0 * amperes * v["K_T"] * arm / lead,
        # a jam takes the whole stall moment; healthy drives stay below half of this (fdi/thresholds: found, load)
        th_load=0.4 * amperes * v["K_T"] * arm / lead,
        arm=arm,
        stop_low=arm * (travel[0] + 0.5 * RAD_PER_DEG),
        stop_high=arm * (travel[1] - 0.5 * RAD_PER_DEG),
        wind=v["K_T"] / (lead * v["K_s"]),
        t_lost=0.1,
        even=float(max(round(shapes.EVEN_S / dt), 1)),
        **shapes.priors(amperes),
        phi_load=dt * (lead / arm) / (v["J_M"] + v["J_N"] * (lead / arm) ** 2),
        leak=made["Phi"][5, 5],
        b_motor=v["K_B"] / (v["K_ic"] + v["R"]),
        th_friction=torque.RUBS * amperes * v["K_T"],
        **trained | {"th_rough": [*trained["th_rough"], sensor_noise.TH_CURRENT]},
    )


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape, not engaged: the first usable position sample engages it."""
    x = np.zeros(p.shape, STATE)
    x["gain_doubt"], x["magnets_doubt"], x["age_sigma"] = gains.GAIN, gains.MAGNETS_AT_FIRST, gains.AGE
    return x


@kernel
def _engage(x, u, p):
    x.x_hat[2] = u.y_position / p.lead
    x.x_hat[0] = (p.ratio * p.spring * x.x_hat[2] + x.hm0) / (p.spring - x.hmd)
    x.x_hat[3] = u.y_velocity if usable(u.y_velocity, u.velocity_valid) > 0.5 else 0.0
    x.x_hat[1] = p.ratio * x.x_hat[3]
    x.x_hat[4] = u.y_current if usable(u.y_current, u.current_valid) > 0.5 else 0.0
    x.pos_hat = x.reckon = u.y_position
    x.w_last = x.raw_last = x.x_hat[3]
    x.P_cc = p.sigma_pos * p.sigma_pos
    x.P_bb = (p.lead * p.sigma_b) * (p.lead * p.sigma_b)
    x.started = 1.0
    x.age_doubt = p.t_doubt


@kernel
def _hold(x, u):
    """Keep the hinge model and the demands of the last ticks."""
    if math.isfinite(u.hm0_model) and math.isfinite(u.hmd_model):
        x.hm0, x.hmd = u.hm0_model, u.hmd_model
    for i in range(HISTORY, 0, -1):
        x.u_old[i] = x.u_old[i - 1]
    if math.isfinite(u.u):
        x.u_old[0] = u.u


@kernel
def step(x, u, p, dt):
    """Predict to this sample, correct, test, name, and say how well the position is known."""
    _hold(x, u)
    if x.started < 0.5:
        if usable(u.y_position, u.position_valid) > 0.5:
            _engage(x, u, p)
        return
    x.age += dt
    gap = x.age_vel > p.t_bad
    x.count += 1.0
    if x.count >= p.n_sub:
        x.count = 0.0
    predict(x, x.u_old[int(p.delay)], p)
    w, mean, gamma = correct(x, u, p, dt)
    current = usable(u.y_current, u.current_valid) > 0.5
    x.age_cur = 0.0 if current else x.age_cur + dt
    if current:
        x.sum_R2 += u.y_current - x.x_hat[4]
        x.n_current += 1.0
    if x.count == 0.0 and x.n_current > 0.0:
        x.R2 = x.sum_R2 / x.n_current
        x.sum_R2 = x.n_current = 0.0
    reckon_position(x, u, p, dt, gap and x.age_vel == 0.0 and x.alarm < 0.5)
    position_consistency.update(x, u, mean, p, dt)
    x.age_doubt = 0.0 if x.isolated_part == VELOCITY else x.age_doubt + dt
    believed = x.age_vel == 0.0 and x.r_speed < 0.5 and x.age_doubt > p.t_doubt
    told = x.age_vel == 0.0 and x.at_limit < 0.5
    torque.rub(x, x.x_hat[3], gamma, told and p.stop_low < x.pos_hat < p.stop_high, p, dt)
    drive.watch(x, u.y_current, current, x.u_old[int(p.delay)], w, believed, gamma, p, dt)
    if x.even_ticks == 0.0:
        backlash.update(x, p)
    sensor_noise.watch(x, u, gamma, current, told, p, dt)
    decide(x, p, dt)
    size(x, p)
    x.load_hat = x.x_hat[5]
    fresh = x.age_vel < 0.2 and x.isolated_part != VELOCITY
    x.valid = 1.0 if fresh and x.pos_sigma < p.sigma_max else 0.0


rollout = entry(step, STATE, INPUTS, PARAMS)
