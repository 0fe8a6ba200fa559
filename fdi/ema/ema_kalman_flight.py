"""Faults of an electromechanical elevator actuator from one Kalman filter on the motor velocity, fit for flight.

[Jay]'s filter with what an elevator adds to the bench: the hinge moment HM0 + HM_delta x1 of a model enters the
prediction, its stiffness stands inside A, and what that model misses is a bounded load d (first-order Gauss-Markov).

    x = [x1 surface, x2 rate, x3 motor angle, x4 rate, x5 current, d],   x+ = Phi(HM_delta) x + G u + G_h HM0 + K gamma

| relation | broken by | in |
|---|---|---|
| position - surface - velocity's integral | a sensor, named by the other two | `positions` |
| current - demand | the drive, or the current sensor: what the motor has felt tells which | `drive`, `shapes` |
| torque - motion | friction, and what holds the surface: a load that no hinge explains | `torque`, `vote` |
| a sample - those before it | a sensor that is noisy or frozen | `sensor_noise` |

On a verdict on the position sensor `reconf` asks to close the loop on pos_hat. With a lost sensor the rest goes on:

| lost | what is left |
|---|---|
| surface | the velocity against the position, AMBIGUOUS; drive and jam as ever |
| position | the velocity against the surface, AMBIGUOUS; drive and jam as ever; pos_hat |
| velocity | the position takes its place in the filter; position against surface, drive: AMBIGUOUS; jam |
| current | sensors and jam as ever |

While all is well, pos_hat is tied to the position sensor; from the first suspicion on it is the velocity's integral
alone, and once the position sensor is named it is tied to the surface's. The filter's angle follows pos_hat, so that a
velocity error that has healed is left neither in the angle nor, times the hinge stiffness, in the load.

Windows are seconds. At any rate the demand is as late as the sensors, and the continuous filter, its noise densities
and what a threshold means are those of 200 Hz: above, a lag takes the place of a tick, with the noise of 5 ms.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.common import linkage
from actuators.constants import RAD_PER_DEG
from actuators.ema import jay
from fdi.common.decision import shift, usable
from fdi.common.record import Detector, Estimate
from fdi.common.tuning import thresholds
from fdi.ema import drive, gains, positions, sensor_noise, shapes, torque
from fdi.ema.ema_kalman import VELOCITY
from fdi.ema.model import designed
from fdi.ema.velocity import correct, predict
from fdi.ema.vote import ISOLABLE_PARTS, decide, size

__all__ = ["INPUTS", "ISOLABLE_PARTS", "OUTPUTS", "PARAMS", "STATE", "init", "params", "rollout", "step"]

HISTORY = 10  # ticks of demand kept for the delay: 5 ms at 2 kHz
ENGAGED = 1e-9  # of `pair_time`: the position is tied before the surface is seen [s]

PARAMS = dtype([
    ("Phi", "f8", (6, 6)),    # transition over one tick without hinge stiffness, SI
    ("Phi_h", "f8", (6, 6)),  # its derivative by the hinge stiffness [per N m/rad]
    ("G", "f8", (6,)),        # of the demanded current
    ("G_h", "f8", (6,)),      # of the hinge moment
    ("K", "f8", (6,)),        # steady Kalman gain on the velocity [per rad/s]
    ("K_angle", "f8", (6,)),  # and on the position, in units of the motor's angle, where the velocity is lost [per rad]
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
    ("share", "f8", "-"),  # of a new tick in a mean that has the noise of 5 ms
    # load that no hinge explains, as large as a fault is to be: 0.4 of the stall moment, which jams and stops pass. A
    # false alarm is far below: training `ema` asks for 0.16 of that moment (fdi/thresholds: found, load)
    ("th_load", "f8", "N m"),
    ("stop_low", "f8", "m"),  # rod at the stops, less a margin: a drive that presses there is not jammed
    ("stop_high", "f8", "m"),
    ("load_max", "f8", "N m"),  # limit of the load estimate
    ("gate", "f8", "rad/s"),  # innovation, and step from sample to sample, beyond which it is a spike
    ("t_load", "f8", "s"),    # a stop that is hit or a gust at stall is over sooner
    ("t_bad", "f8", "s"),     # velocity samples missing or rejected for longer: start again, or a fault
    ("t_start", "f8", "s"),   # after engage: the load estimate settles, no test counts
    ("t_doubt", "f8", "s"),   # a velocity sensor that was wrong tells nothing of the magnets for so long
    ("t_name", "f8", "s"),    # a name of the drive follows the alarm after so long at least
    ("phi_load", "f8", "rad/s/N m"),  # rate from the load state over a tick
    ("leak", "f8", "-"),  # of the load state over a tick
    *positions.PARAMS,
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
    ("f_hat", "f8", "m, rad/s, A"),          # size of the declared fault [m], [rad/s] or [A]
    ("f_sigma", "f8", "m, rad/s, A"),        # its standard deviation, same unit
    ("eta", "f8", "-"),            # normalised innovation (6)
    ("R2", "f8", "A"),        # (9), mean of 5 ms
    ("load_hat", "f8", "N m"),  # hinge moment that the model misses
    ("x_hat", "f8", (6,), "rad, rad/s, rad, rad/s, A, N m"),
    ("started", "f8", "-"),        # 1 once engaged
    ("age", "f8", "s"),       # since engage
    ("age_vel", "f8", "s"),   # since the last velocity sample that was used
    ("raw_last", "f8", "rad/s"),  # last velocity sample, spike or not
    ("u_old", "f8", (HISTORY + 1,), "A"),  # demands held over the last ticks, newest first
    ("at_limit", "f8", "-"),       # 1: the amplifier is at its voltage limit
    ("hm0", "f8", "N m"),            # last finite values [N m], [N m/rad]
    ("hmd", "f8", "N m/rad"),
    ("w_last", "f8", "rad/s"),  # last velocity that went into it
    ("load_at", "f8", "m"),  # where the rod was when the load exceeded what a hinge may make of it
    ("load_travel", "f8", "m"),  # how far it has gone since
    ("timer_load", "f8", "s"),
    ("hot_load", "f8", "-"),
    ("alarm_age", "f8", "s"),  # since the alarm
    ("age_doubt", "f8", "s"), # since the velocity was last said to be wrong
    ("impact", "f8", "s"),    # time left after the rate has jumped as it does where a stop is hit
    ("work", "f8", (6,)),     # scratch
    *positions.STATE,
    *drive.STATE,
    ("even_lost", "f8", "-"),  # ticks of the sample that say nothing
    *gains.STATE,
    *torque.STATE,
    *sensor_noise.STATE,
])
OUTPUTS = (
    "r", "alarm", "verdict", "isolated_part", "valid", "reconf", "pos_hat", "pos_sigma", "f_hat", "f_sigma", "eta",
    "R1", "R2", "load_hat", "hot_friction", "drive_lost",
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
        "hot_friction": {1: ("friction", "jam")},
        "drive_lost": {1: ("loss_of_effectiveness", "magnet_loss", "winding_resistance"),
                       2: ("free_float", "loss_of_effectiveness")},
    },
    looks_back={"delay": "u_old"},
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
    made = designed(v, dt, sigma_velocity, sigma_position / v["lead"])
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
        share=min(2.0 * dt / (jay.PERIOD + dt), 1.0),  # 2 / (n + 1): the noise of n ticks
        sigma_pos=noise * sigma_position,
        sigma_rig=0.08 * RAD_PER_DEG * arm,  # sensor set `transport`: rigging
        sigma_b=1e-4 * no_load * lead,
        b_max=1e-3 * no_load,
        gate=0.3 * no_load,  # twice what the stall current does in 5 ms
        load_max=2.0 * amperes * v["K_T"] * arm / lead,
        # a jam takes the whole stall moment; healthy drives stay below half of this (fdi/thresholds: found, load)
        th_load=0.4 * amperes * v["K_T"] * arm / lead,
        arm=arm,
        stop_low=arm * (travel[0] + 0.5 * RAD_PER_DEG),
        stop_high=arm * (travel[1] - 0.5 * RAD_PER_DEG),
        t_lost=0.1,
        even=float(max(round(shapes.EVEN_S / dt), 1)),
        **shapes.priors(amperes),
        phi_load=dt * (lead / arm) / (v["J_M"] + v["J_N"] * (lead / arm) ** 2),
        leak=made["Phi"][5, 5],
        b_motor=v["K_B"] / (v["K_ic"] + v["R"]),
        th_friction=torque.RUBS * amperes * v["K_T"],
        **trained | {"th_rough": [max(noise, 1.0) * th for th in (*trained["th_rough"], sensor_noise.TH_CURRENT)]},
    )


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape, not engaged: the first usable position sample engages it."""
    x = np.zeros(p.shape, STATE)
    x["own_sd"] = gains.PRIOR
    return x


@kernel
def _engage(x, u, p):
    x.x_hat[2] = u.y_position / p.lead
    x.x_hat[0] = (p.ratio * p.spring * x.x_hat[2] + x.hm0) / (p.spring - x.hmd)
    x.x_hat[3] = u.y_velocity if usable(u.y_velocity, u.velocity_valid) > 0.5 else 0.0
    x.x_hat[1] = p.ratio * x.x_hat[3]
    x.x_hat[4] = u.y_current if usable(u.y_current, u.current_valid) > 0.5 else 0.0
    x.pos_hat = x.base_rod = x.base_surface = u.y_position
    x.pair_time = ENGAGED
    x.w_last = x.raw_last = x.x_hat[3]
    x.started = 1.0
    x.age_doubt = p.t_doubt


@kernel
def _hold(x, u):
    """Keep the hinge model and the demands of the last ticks."""
    if math.isfinite(u.hm0_model) and math.isfinite(u.hmd_model):
        x.hm0, x.hmd = u.hm0_model, u.hmd_model
    shift(x.u_old, u.u if math.isfinite(u.u) else x.u_old[0])


@kernel
def step(x, u, p, dt):
    """Predict to this sample, correct, test, name, and say how well the position is known."""
    _hold(x, u)
    if x.started < 0.5:
        if usable(u.y_position, u.position_valid) > 0.5:
            _engage(x, u, p)
        return
    x.age += dt
    predict(x, x.u_old[int(p.delay)], p)
    w, mean, gamma = correct(x, u, p, dt)
    current = usable(u.y_current, u.current_valid) > 0.5
    if current:
        x.R2 += p.share * (u.y_current - x.x_hat[4] - x.R2)
    positions.update(x, u, mean, p, dt)
    x.age_doubt = 0.0 if x.isolated_part == VELOCITY else x.age_doubt + dt
    believed = x.age_vel == 0.0 and x.r_speed < 0.5 and x.age_doubt > p.t_doubt
    told = x.age_vel == 0.0 and x.at_limit < 0.5
    torque.rub(x, x.x_hat[3], gamma, told and p.stop_low < x.pos_hat < p.stop_high, p, dt)
    drive.watch(x, u.y_current, current, w, believed, gamma, p, dt)
    sensor_noise.watch(x, u, gamma, current, told, p, dt)
    decide(x, p, dt)
    size(x, p)
    x.load_hat = x.x_hat[5]
    fresh = x.age_vel < 0.2 and x.isolated_part != VELOCITY
    x.valid = 1.0 if fresh and x.pos_sigma < p.sigma_max else 0.0


rollout = entry(step, STATE, INPUTS, PARAMS)
