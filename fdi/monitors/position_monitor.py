"""Position monitor: the common in-service check of a surface against its command, for either actuator technology.

    m = the command through the servo's own third-order reference model (actuators/common/reference.py),
    r = (surface - m) / (threshold + share lag),  lag: how far m is behind the command, a peak that fades

The reference's limits of rate, acceleration and jerk are what a healthy surface follows: where gusts and a protection
throw the command from stop to stop, a rate limit with lags behind it is up to 5 deg away from the surface, for longer
than the confirmation time. Loads and tolerances of a healthy servo show where it has to move: hence the share.

A deviation beyond the threshold for the confirmation time is an alarm. The monitor does not know why a surface is not
where it should be, so the alarm is AMBIGUOUS until the motion tells: JAM_SOLID after `t_rest` at rest while the model
moved, RUNAWAY after `travel_run` in one direction away from the model, still on its way after `t_run` or T_END at the
end of its travel, the deviation growing all the time (a step of the command is over sooner, and then follows), while
the model does not go the same way (a surface that follows with part of its command does). That class stays as long as
the alarm, a runaway's unless the surface turns back by `travel_run`: where the position sensor in the loop is frozen it
runs, too, but slows down and turns back once the command has passed the reading. A surface that slows down is therefore
not named yet, and one that turns back is AMBIGUOUS. A jam's stays unless the surface moves: a jam does not at all, and
in gusts, where the model passes a surface that stands again and again, only one that follows the model farther than
that is where it should be (`_moves`). A free-floating surface held by friction, a runaway too slow to move it and
a solid oscillation below 0.03 deg are jams to its sensor; an oscillation whose strokes are longer than `travel_run` is
taken for a runaway until it turns back.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.common import linkage, reference
from actuators.ema import servo as ema_servo
from actuators.hydraulic import servo as hydraulic_servo
from fdi.common.decision import clipped, confirm, held, usable
from fdi.common.record import Detector
from fdi.common.tuning import thresholds
from fdi.common.verdict import AMBIGUOUS, JAM_SOLID, NONE, RUNAWAY, SENSOR

CULPRITS = ("", "surface")

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
        ("t_run", "f8", "s"),  # ... and still moving after this, or at the end of its travel: a runaway
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
        ("m", "f8", "rad"),  # the model now: `actuators.common.reference` by other names, r being the statistic
        ("md", "f8", "rad/s"),
        ("mdd", "f8", "rad/s2"),
        ("model", "f8", "rad"),  # where the surface should have been when it was measured
        ("slow", "f8", "rad"),  # lagged surface
        ("mark", "f8", "rad"),  # where it was when it last moved by MOVED
        ("mark_time", "f8", "s"),  # since then
        ("calm", "f8", "rad"),  # surface lagged more
        ("rest", "f8", "rad"),  # where that was when it last moved by SLID
        ("rest_model", "f8", "rad"),  # and the model
        ("rest_time", "f8", "s"),  # since then
        ("rest_near", "f8", "s"),  # how long before that the surface had last been where it should be
        ("near", "f8", "s"),  # time since it was
        ("run_low", "f8", "rad"),  # range of the model since the surface was last not where it should be
        ("run_high", "f8", "rad"),
        ("run_width", "f8", "rad"),  # largest threshold meanwhile
        ("off", "f8", "s"),  # time since the first deviation since it last followed
        ("stand", "f8", "rad"),  # where it stood STOPPED after that
        ("shake", "f8", "rad2"),  # mean square of its swings about where it stands
        ("moves", "f8", "s"),  # for how long it is known to have moved from there by itself, until it follows
        ("slid", "f8", "s"),  # for so long it is held to be loose: it has moved where it should not be
        ("leave", "f8", "rad"),  # where the surface began to run away from the model
        ("leave_model", "f8", "rad"),  # and the model was then
        ("far", "f8", "rad"),  # how far it came
        ("run_time", "f8", "s"),  # for how long it moved so
        ("run", "f8", "-"),  # way of the run that was named, 0 for none while the alarm stands
        ("back", "f8", "rad"),  # how far it has turned back since
        ("lag", "f8", "rad"),  # fading peak of command less model
        ("gap", "f8", "rad"),  # lagged deviation
        ("widest", "f8", "rad"),  # its largest since the run began
        ("still", "f8", "s"),  # since that grew
        ("rate", "f8", "rad/s"),  # of the lagged surface
        ("rate_was", "f8", "rad/s"),  # and that lagged
        ("end_time", "f8", "s"),  # for how long it has been at the end of its travel
        ("timer", "f8", "s"),  # confirmation
        ("age", "f8", "s"),  # time since the last usable measurement
        ("r", "f8", "-"),  # deviation over threshold, signed
        ("alarm", "f8", "-"),  # 1 while a fault is declared
        ("verdict", "f8", "-"),  # class code
        ("culprit", "f8", "-"),  # 1 where the surface sensor is named
        ("valid", "f8", "-"),  # 1 while the measurement is fresh
        ("surface_last", "f8", "rad"),  # last reading, and its last step
        ("step_last", "f8", "rad"),
        ("turns", "f8", "-"),  # share of steps that turned back, over a second
        ("same", "f8", "s"),  # for how long the reading has repeated itself
        ("frozen", "f8", "-"),  # 1 where one that had noise does
    ]
)
OUTPUTS = ("r", "model", "rate", "alarm", "verdict", "culprit", "valid")
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


MOVED = math.radians(0.08)  # a surface that has moved further is on its way: ten sigma of its sensor, lagged
# a surface that stands moves by less than this behind the longer lag, ten sigma of its sensor; a free-floating one
# slides with the air by MOVED
SLID, TAU_CALM = math.radians(0.035), 0.1
# and swings between the lags by less than this, three sigma of its sensor: 0.03 deg from 1 to 6 Hz; memory of that, and
# when what is left of its stop is gone from it [s]
SHAKEN, TAU_SHAKE, STOOD = math.radians(0.0085), 0.5, 1.2
LOOSE = 30.0  # and sticks in between by its friction: remembered for so long [s]
T_SAME, TURNS = 0.1, 0.3  # a reading that repeats itself for so long [s]; share of steps that turn back: noise has 0.67
NEAR, STOPPED = 0.5, 0.6  # of the threshold, and for how long it may have been further away when it came to rest [s]
END = math.radians(1.0)  # from a limit: the end of the travel
GROWS = 0.1  # without a larger deviation for so long, a surface that moves follows its command [s]
SLOWS = 0.8  # of its lagged rate: a surface slower than that is about to stop or to turn back
T_END = 0.5  # at the end of the travel for so long: a frozen position sensor has turned the surface back by then [s]
AWAY = 0.25  # of the threshold: a smaller deviation is none
FOLLOWS = 0.5  # of the travel: where the model goes the same way so far, part of the command is lost
TRAVEL = (math.radians(-23.0), math.radians(17.0))  # of the elevator [rad]
STOP = math.radians(0.1)  # commands end so far inside the stops


def params(
    which: str = "flight", *, dt: float = 0.005, late: float = 0.005, limits: Any = None, **values: Any
) -> np.ndarray:
    """Return PARAMS with threshold set `which` for ticks of `dt` and measurements `late` old [s], travel `limits`.

    "flight" is for hydraulic segments, "flight_ema" for electromechanical ones; `values` replace any field.
    """
    ema, limits = which.endswith("_ema"), limits or TRAVEL
    servo, per = (ema_servo.params(dt=dt)[0], 1.0) if ema else (hydraulic_servo.params(dt=dt)[0], linkage.ARM)
    own = {name: servo[name] / (per if name.endswith("_max") else 1.0) for name, _ in reference.PARAM_FIELDS}
    own |= {"late": late, "limit_low": limits[0], "limit_high": limits[1]}
    return record(PARAMS, **{**own, **thresholds("position_monitor", which), **values})


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape, not yet started: the model starts at the first command."""
    return np.zeros(p.shape, STATE)


@kernel
def _predict(x, p, dt):
    """Advance the model to the next tick, with the limits of `actuators.common.reference`."""
    away = min(max(x.command, p.limit_low + STOP), p.limit_high - STOP) - x.m
    v = clipped(p.k1 * away, min(p.v_max, math.sqrt(0.8 * p.a_max * math.fabs(away))))
    a = clipped(p.k2 * (v - x.md), p.a_max)
    j = clipped(p.k3 * (a - x.mdd), p.j_max)
    x.lag = max(math.fabs(away), x.lag * (1.0 - min(dt / p.t_lag, 1.0)))
    x.m += dt * (x.md + dt * (x.mdd / 2.0 + dt * j / 6.0))
    x.md += dt * (x.mdd + dt * j / 2.0)
    x.mdd += dt * j


@kernel
def _moves(x, p, dt):
    """Ask whether the surface has moved by itself since it left the model: a jam does not move at all.

    The model passes a surface that stands as well. One that stayed near it (NEAR) while it moved by more than that has
    followed, and all before is forgotten.
    """
    if math.fabs(x.r) < NEAR:
        x.run_low, x.run_high = min(x.run_low, x.model), max(x.run_high, x.model)
        x.run_width = max(x.run_width, p.threshold + p.share * x.lag)
        if x.run_high - x.run_low > 3.0 * NEAR * x.run_width:  # twice is what passes a surface that stands
            x.off, x.moves = 0.0, 0.0
    else:
        x.run_low = x.run_high = x.model
        x.run_width = 0.0
    swing = x.slow - x.calm
    x.shake += dt / TAU_SHAKE * (min(swing * swing, 4.0 * SHAKEN * SHAKEN) - x.shake)
    if x.off > 0.0 or math.fabs(x.r) >= 1.0:
        x.off += dt
    if x.off < STOPPED:
        x.stand = x.calm
    elif x.off > LOOSE and x.alarm < 0.5:
        x.off, x.moves = 0.0, 0.0
    elif x.moves > 0.0 or math.fabs(x.calm - x.stand) > SLID or (x.off > STOOD and x.shake > SHAKEN * SHAKEN):
        x.moves += dt


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
def step(x, u, p, dt):
    """Advance the model, compare, confirm, name."""
    good = usable(u.surface, u.surface_valid)
    x.surface = held(u.surface, u.surface_valid, x.surface)
    if good > 0.5:
        _repeats(x, u.surface - x.surface_last, dt)
        x.surface_last = u.surface
    if math.isfinite(u.command):
        x.command = u.command
    if x.started < 0.5:
        if good < 0.5:
            x.valid = 0.0
            return
        x.started = 1.0
        x.m = min(max(x.command, p.limit_low + STOP), p.limit_high - STOP)
        x.slow = x.mark = x.calm = x.rest = x.leave = x.far = x.surface
        x.rest_model = x.leave_model = x.run_low = x.run_high = x.m
    x.model = x.m - p.late * x.md
    _predict(x, p, dt)
    x.age = 0.0 if good > 0.5 else x.age + dt
    x.valid = 1.0 if x.age <= p.t_invalid else 0.0
    if good < 0.5:
        return
    x.rate = (x.surface - x.slow) / p.tau_motion
    x.slow += (1.0 - math.exp(-dt / p.tau_motion)) * (x.surface - x.slow)
    x.rate_was += (1.0 - math.exp(-dt / TAU_CALM)) * (x.rate - x.rate_was)
    deviation = x.surface - x.model
    x.r = deviation / (p.threshold + p.share * x.lag)
    x.near = 0.0 if math.fabs(x.r) < NEAR else x.near + dt
    x.calm += (1.0 - math.exp(-dt / TAU_CALM)) * (x.surface - x.calm)
    x.rest_time += dt
    if math.fabs(x.calm - x.rest) > SLID:
        x.rest, x.rest_model, x.rest_time, x.rest_near = x.calm, x.model, 0.0, x.near
    _moves(x, p, dt)
    x.slid = max(x.slid - dt, 0.0)
    x.mark_time += dt
    away = math.copysign(1.0, deviation)  # the way back, or a surface where it should be, ends a run
    if math.fabs(x.r) < AWAY or (x.slow - x.leave) * away < 0.0 or (x.far - x.slow) * away > MOVED:
        x.leave = x.far = x.slow
        x.leave_model = x.model
        x.run_time = 0.0
    elif (x.slow - x.far) * away > 0.0:
        x.far = x.slow
    if math.fabs(x.slow - x.mark) > MOVED:
        x.run_time += min(x.mark_time, 0.5 * p.t_run)
        x.mark, x.mark_time = x.slow, 0.0
    x.end_time = x.end_time + dt if min(x.slow - p.limit_low, p.limit_high - x.slow) < END else 0.0
    x.gap += (1.0 - math.exp(-dt / p.tau_motion)) * (deviation - x.gap)
    if x.run_time == 0.0:
        x.widest = 0.0
    x.still += dt
    if math.fabs(x.gap) > x.widest + MOVED:
        x.widest, x.still = math.fabs(x.gap), 0.0
    if x.mark_time == 0.0 and x.near > STOPPED:
        x.slid = LOOSE
    x.timer, x.alarm = confirm(x.timer, x.alarm, math.fabs(x.r) >= 1.0, dt, p.t_confirm, p.t_release)
    if x.alarm < 0.5:
        x.verdict, x.culprit, x.run = NONE, 0.0, 0.0
    elif x.frozen > 0.5 or x.verdict == SENSOR:
        x.verdict, x.culprit = SENSOR, 1.0
    elif x.verdict == JAM_SOLID:
        slid = 0.0 < x.slid < LOOSE - STOPPED and x.near > STOPPED
        if slid or x.moves > STOPPED:  # and not back to where it should be
            x.verdict = AMBIGUOUS
    elif x.verdict == RUNAWAY:
        x.back = max(x.back - x.run * x.rate * dt, 0.0)
        x.verdict = AMBIGUOUS if x.back >= p.travel_run else RUNAWAY
    else:
        moved = math.fabs(x.model - x.rest_model) >= p.jam_share * math.fabs(deviation)
        travel = math.fabs(x.far - x.leave)
        own = (x.model - x.leave_model) * away <= FOLLOWS * travel
        goes_on = x.end_time == 0.0 and x.still <= GROWS and math.fabs(x.rate) >= SLOWS * math.fabs(x.rate_was)
        runs = x.end_time > T_END or (x.run_time >= p.t_run and goes_on)
        if travel >= p.travel_run and runs and own and x.run == 0.0:
            x.verdict, x.run, x.back = RUNAWAY, away, 0.0
        elif x.rest_time < p.t_rest or x.slid > 0.0 or x.moves > 0.0 or x.rest_near >= STOPPED:
            x.verdict = AMBIGUOUS
        elif moved and math.fabs(x.r) >= 1.0:
            x.verdict = JAM_SOLID
        else:
            x.verdict = AMBIGUOUS


rollout = entry(step, STATE, INPUTS, PARAMS)
