"""Position monitor: the common in-service check of a surface against its command, for either actuator technology.

    m = the command through the servo's own third-order reference model (actuators/common/reference.py),
    r = (surface - m) / (threshold + share lag),  lag: how far m is behind the command, a peak that fades

The reference's limits of rate, acceleration and jerk are what a healthy surface follows. Loads and tolerances of a
healthy servo show where it has to move: hence the share.

A deviation beyond the threshold for the confirmation time is an alarm. Its name follows from how the surface moves:

    SENSOR      its reading had noise and repeats itself
    RUNAWAY     it has gone `travel_run` away from the model and after `t_run` goes on while the model does not
    JAM_SOLID   it stands for `t_rest`, while the model has moved
    AMBIGUOUS   anything else

A surface that moves as the model does follows its command, by whatever this is biased. A jam does not move: one that
does is AMBIGUOUS as long as it is remembered (LOOSE). A surface whose loop reads a frozen position runs as well, but
slows down and turns back once the command has passed the reading: what slows down is not named, and what turns back is
AMBIGUOUS. A free-floating surface that friction holds, a runaway too slow to move it and an oscillation of less than
0.06 deg are jams to this monitor.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record, zero_state
from actuators.common import linkage, reference
from actuators.ema import servo as ema_servo
from actuators.hydraulic import servo as hydraulic_servo
from fdi.common.decision import confirm, held, usable
from fdi.common.record import Detector
from fdi.common.reference import chase
from fdi.common.tuning import thresholds
from fdi.common.verdict import AMBIGUOUS, JAM_SOLID, NONE, RUNAWAY, SENSOR

ISOLABLE_PARTS = ("", "surface")

PARAMS = dtype(
    [
        *reference.PARAM_FIELDS,  # of the servo; unit: rad of surface
        ("late", "f8", "s"),  # age of the measurement
        ("limit_low", "f8", "rad"),  # travel, trailing edge up
        ("limit_high", "f8", "rad"),  # travel, trailing edge down
        ("threshold", "f8", "rad"),  # deviation
        ("share", "f8", "-"),  # and share of the model's lag
        ("t_lag", "f8", "s"),  # for which a peak of the lag is remembered
        ("t_confirm", "f8", "s"),
        ("t_release", "f8", "s"),
        ("tau_motion", "f8", "s"),  # lag of the surface whose motion names the class
        ("t_rest", "f8", "s"),  # at rest for so long, while the model moved: a jam
        ("jam_share", "f8", "-"),  # of the deviation that the model has moved meanwhile
        ("travel_run", "f8", "rad"),  # in one direction, away from the model, ...
        ("t_run", "f8", "s"),  # ... and still moving after this: a runaway
        ("t_invalid", "f8", "s"),  # without a measurement for longer the estimate is not valid
    ]
)
INPUTS = dtype(
    [
        ("command", "f8", "rad"),  # surface command of the law, trailing edge down +
        ("surface", "f8", "rad"),  # measured surface
        ("surface_valid", "f8", "-"),  # 1 when usable
    ]
)
STATE = dtype(
    [
        ("started", "f8", "-"),  # 1 after the first usable measurement
        ("command", "f8", "rad"),  # last finite command
        ("surface", "f8", "rad"),  # last usable measurement
        ("m", "f8", (3,)),  # the model now [rad], its rate and acceleration
        ("model", "f8", "rad"),  # where the surface should have been when it was measured
        ("lag", "f8", "rad"),  # fading peak of command less model
        ("slow", "f8", "rad"),  # lagged surface, its rate, and that lagged
        ("rate", "f8", "rad/s"),
        ("rate_was", "f8", "rad/s"),
        ("model_rate", "f8", "rad/s"),  # rate of the model, lagged as that
        ("calm", "f8", "rad"),  # surface lagged more
        ("away_time", "f8", "s"),  # since the surface was last where it should be
        ("rest", "f8", "rad"),  # where it was when it last moved by SLID, the model then, and the time since
        ("rest_model", "f8", "rad"),
        ("rest_time", "f8", "s"),
        ("loose", "f8", "s"),  # for so long it is held to move by itself
        ("leave", "f8", "rad"),  # where it began to go away from the model, and the time since
        ("leave_time", "f8", "s"),
        ("far", "f8", "rad"),  # how far it came
        ("turned", "f8", "-"),  # 1 where a runaway has turned back, while the alarm stands
        ("same", "f8", "s"),  # for how long the reading has repeated itself
        ("step_last", "f8", "rad"),  # its last step, and the share of steps that turned back, over a second
        ("turns", "f8", "-"),
        ("frozen", "f8", "-"),  # 1 where one that had noise repeats itself
        ("timer", "f8", "s"),  # confirmation
        ("age", "f8", "s"),  # time since the last usable measurement
        ("r", "f8", "-"),  # deviation over threshold, signed
        ("alarm", "f8", "-"),  # 1 while a fault is declared
        ("verdict", "f8", "-"),  # class code
        ("isolated_part", "f8", "-"),  # 1 where the surface sensor is named
        ("valid", "f8", "-"),  # 1 while the measurement is fresh
    ]
)
OUTPUTS = ("r", "model", "rate", "alarm", "verdict", "isolated_part", "valid")
DETECTOR = Detector(
    id="position_monitor",
    level="local",
    summary="command against position, threshold and confirmation time (baseline)",
    technologies=("hydraulic", "ema"),
    inputs={"command": "de_cmd", "surface": "surface"},
    group="monitors",
    designed_for={
        "*.jam*": ("jam_solid", "ambiguous"),
        "*.runaway*": ("runaway", "ambiguous"),
        **dict.fromkeys(("*.free_float", "*.bias@command"), ("ambiguous",)),
    },
    may_see={
        **dict.fromkeys((
            "*.ofc_*", "*.loss_of_effectiveness*", "*.supply_pressure_drop", "*.internal_leakage", "*.air_in_oil",
            "*.friction", "*.backlash", "*.magnet_loss", "*.winding_resistance", "*.rod", "*.position", "*.velocity",
        ), ("ambiguous",)),
        "*.surface": ("sensor", "ambiguous"),
    },
    blind="compares one elevator segment with its command: other effectors, aircraft sensors and monitor-only "
    "sensors move neither",
    fit=lambda site: params("flight_ema" if site.technology == "ema" else "flight", limits=site.travel, dt=site.dt,
                            late=site.delay("surface")),
)


# a surface that stands moves by less than this behind, or in, the longer lag [s], ten sigma of its sensor
SLID, TAU_CALM = math.radians(0.035), 0.1
LOOSE = 30.0  # a surface that has moved where it should not be is held to be loose for so long [s]
T_SAME, TURNS = 0.1, 0.3  # a reading that repeats itself for so long [s]; share of steps that turn back: noise has 0.67
NEAR, STOPPED = 0.5, 0.3  # of the threshold; a jam has come to rest so long after it was within that [s]
AWAY = 0.25  # of the threshold: a smaller deviation is none
SLOWS = 0.8  # of its lagged rate: a surface slower than that is about to stop or to turn back
STOP = math.radians(0.1)  # commands end so far inside the stops


def params(
    which: str = "flight", *, dt: float = 0.005, late: float = 0.005, limits: Any = None, **values: Any
) -> np.ndarray:
    """Return PARAMS with threshold set `which` for ticks of `dt` and measurements `late` old [s], travel `limits`.

    "flight" is for hydraulic segments, "flight_ema" for electromechanical ones; `values` replace any field.
    """
    ema, limits = which.endswith("_ema"), limits or linkage.TRAVEL
    servo, per = (ema_servo.params(dt=dt)[0], 1.0) if ema else (hydraulic_servo.params(dt=dt)[0], linkage.ARM)
    own = {name: servo[name] / (per if name.endswith("_max") else 1.0) for name, _ in reference.PARAM_FIELDS}
    own |= {"late": late, "limit_low": limits[0], "limit_high": limits[1]}
    return record(PARAMS, **{**own, **thresholds("position_monitor", which), **values})


init = zero_state(STATE)  # not yet started: the model starts at the first command


@kernel
def _predict(x, p, dt):
    """Advance the model to the next tick, with the limits of `actuators.common.reference`."""
    away = min(max(x.command, p.limit_low + STOP), p.limit_high - STOP) - x.m[0]
    x.lag = max(math.fabs(away), x.lag * (1.0 - min(dt / p.t_lag, 1.0)))
    most = min(p.v_max, math.sqrt(0.8 * p.a_max * math.fabs(away)))
    chase(x.m, away, most, p.k1, p.k2, p.k3, p.a_max, p.j_max, dt)


@kernel
def _repeats(x, step, dt):
    """Ask whether a reading that had noise, whose steps turned back, repeats itself: that of a jam does not."""
    if step != 0.0:
        x.turns += min(dt, 1.0) * ((1.0 if step * x.step_last < 0.0 else 0.0) - x.turns)
        x.step_last, x.same, x.frozen = step, 0.0, 0.0
        return
    x.same += dt
    x.turns -= min(dt, 1.0) * x.turns if x.frozen < 0.5 else 0.0  # a coarse quantum repeats itself in health, too
    if x.same >= T_SAME and x.turns > TURNS:
        x.frozen = 1.0


@kernel
def _start(x, p):
    """Let the model begin at the command, and every memory at the first reading."""
    x.started = 1.0
    x.m[0] = min(max(x.command, p.limit_low + STOP), p.limit_high - STOP)
    x.slow = x.calm = x.rest = x.leave = x.far = x.surface
    x.rest_model = x.m[0]


@kernel
def _follow(x, p, dt):
    """Lag the surface; note since when it stands, and whether it has moved where it should not be."""
    x.rate = (x.surface - x.slow) / p.tau_motion
    x.slow += (1.0 - math.exp(-dt / p.tau_motion)) * (x.surface - x.slow)
    a = 1.0 - math.exp(-dt / TAU_CALM)
    x.rate_was += a * (x.rate - x.rate_was)
    x.model_rate += a * (x.m[1] - x.model_rate)
    x.calm += a * (x.surface - x.calm)
    x.away_time = 0.0 if math.fabs(x.r) < NEAR else x.away_time + dt
    x.rest_time += dt
    x.loose = max(x.loose - dt, 0.0)
    if math.fabs(x.calm - x.rest) > SLID:
        if x.away_time > STOPPED or (x.rest_time > STOPPED and x.away_time > 0.0):
            x.loose = LOOSE
        x.rest, x.rest_model, x.rest_time = x.slow, x.model, 0.0


@kernel
def _runs(x, p, away, dt):
    """Return whether the surface runs `away` (+-1) from the model; the way back, or no deviation, begins anew."""
    named = x.verdict == RUNAWAY
    if named:
        away = math.copysign(1.0, x.far - x.leave)
    elif math.fabs(x.r) < AWAY or (x.slow - x.leave) * away < 0.0 or (x.far - x.slow) * away > 2.0 * SLID:
        x.leave = x.far = x.slow
        x.leave_time = 0.0
    x.leave_time += dt
    x.far = max(x.far * away, x.slow * away) * away
    x.turned = max(x.turned, 1.0 if named and (x.far - x.slow) * away >= p.travel_run else 0.0)
    was, alone = x.rate_was * away, (x.rate_was - x.model_rate) * away
    goes_on = x.leave_time >= p.t_run and was * TAU_CALM > SLID and min(x.rate * away, alone) > SLOWS * was
    return x.turned < 0.5 and (named or (goes_on and (x.far - x.leave) * away >= p.travel_run))


@kernel
def _name(x, p, runs):
    """Return the class of what is alarmed; a jam or a runaway that has been named stays until the motion says no."""
    if x.frozen > 0.5 or x.verdict == SENSOR:
        return SENSOR
    if runs:
        return RUNAWAY
    stands = x.rest_time >= p.t_rest and x.loose == 0.0
    moved = math.fabs(x.model - x.rest_model) >= p.jam_share * math.fabs(x.surface - x.model)
    return JAM_SOLID if x.loose == 0.0 and (x.verdict == JAM_SOLID or (stands and moved)) else AMBIGUOUS


@kernel
def step(x, u, p, dt):
    """Advance the model, compare, confirm, name."""
    good = usable(u.surface, u.surface_valid)
    if good > 0.5:
        _repeats(x, u.surface - x.surface, dt)
    x.surface = held(u.surface, u.surface_valid, x.surface)
    if math.isfinite(u.command):
        x.command = u.command
    if x.started < 0.5:
        if good < 0.5:
            x.valid = 0.0
            return
        _start(x, p)
    x.model = x.m[0] - p.late * x.m[1]
    _predict(x, p, dt)
    x.age = 0.0 if good > 0.5 else x.age + dt
    x.valid = 1.0 if x.age <= p.t_invalid else 0.0
    if good < 0.5:
        return
    x.r = (x.surface - x.model) / (p.threshold + p.share * x.lag)
    away = math.copysign(1.0, x.r)
    _follow(x, p, dt)
    runs = _runs(x, p, away, dt)
    x.timer, x.alarm = confirm(x.timer, x.alarm, math.fabs(x.r) >= 1.0, dt, p.t_confirm, p.t_release)
    x.verdict = _name(x, p, runs) if x.alarm > 0.5 else NONE
    x.turned *= x.alarm
    x.isolated_part = 1.0 if x.verdict == SENSOR else 0.0


rollout = entry(step, STATE, INPUTS, PARAMS)
