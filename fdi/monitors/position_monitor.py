"""Position monitor: the common in-service check of a surface against its command, for either actuator technology.

    m' = the command through a rate limit and three equal lags,   r = (surface - m) / (threshold + share lag)

lag is how far the model is behind its command, a peak that fades: a servo that follows hard commands less closely than
the model is allowed a share of it (electromechanical segments; the share of hydraulic ones is zero).

A deviation beyond the threshold for the confirmation time is an alarm. The monitor does not know why a surface is not
where it should be, so the alarm is AMBIGUOUS until the motion tells: JAM_SOLID after `t_rest` at rest while the model
moved, RUNAWAY after `travel_run` in one direction away from the model, still on its way after `t_run` or at the end of
its travel (a step of the command is over sooner), while the model does not go the same way (a surface that follows
with part of its command does). That class then stays as long as the alarm. An oscillation whose strokes are longer
than `travel_run` is taken for a runaway, one too small to be told from rest for a jam.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from fdi.common.decision import confirm, held, usable
from fdi.common.record import Detector
from fdi.common.tuning import thresholds
from fdi.common.verdict import AMBIGUOUS, JAM_SOLID, NONE, RUNAWAY

CULPRITS = ("",)

PARAMS = dtype(
    [
        ("omega", "f8", "rad/s"),  # corner of each of the three lags
        ("rate_limit", "f8", "rad/s"),  # no-load surface rate
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
        ("m1", "f8", "rad"),  # command within the rate limit
        ("m2", "f8", "rad"),  # first lag
        ("m3", "f8", "rad"),  # second lag
        ("model", "f8", "rad"),  # where the surface should be
        ("lag", "f8", "rad"),  # fading peak of command less model
        ("slow", "f8", "rad"),  # lagged surface
        ("rest", "f8", "rad"),  # where the surface was when it last moved
        ("rest_model", "f8", "rad"),  # and the model
        ("rest_time", "f8", "s"),  # since then
        ("leave", "f8", "rad"),  # where the surface began to run away from the model
        ("leave_model", "f8", "rad"),  # and the model was then
        ("far", "f8", "rad"),  # how far it came
        ("run_time", "f8", "s"),  # for how long it moved so
        ("rate", "f8", "rad/s"),  # of the lagged surface
        ("timer", "f8", "s"),  # confirmation
        ("age", "f8", "s"),  # time since the last usable measurement
        ("r", "f8", "-"),  # deviation over threshold, signed
        ("alarm", "f8", "-"),  # 1 while a fault is declared
        ("verdict", "f8", "-"),  # class code
        ("culprit", "f8", "-"),  # 0
        ("valid", "f8", "-"),  # 1 while the measurement is fresh
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
            "*.surface",
        ), ("ambiguous",)),
    },
    blind="compares one elevator segment with its command: other effectors, aircraft sensors and monitor-only "
    "sensors move neither",
    fit=lambda site: params("flight_ema" if site.technology == "ema" else "flight", limits=site.travel),
)


MOVED = math.radians(0.08)  # a surface that has moved further is not at rest: ten sigma of its sensor after the lag
END = math.radians(1.0)  # from a limit: the end of the travel
AWAY = 0.25  # of the threshold: a smaller deviation is none
FOLLOWS = 0.5  # of the travel: where the model goes the same way so far, part of the command is lost
RATE_LIMIT = math.radians(40.0)  # of the servos' reference, both technologies (actuators/hydraulic/servo.py) [rad/s]
TRAVEL = (math.radians(-23.0), math.radians(17.0))  # of the elevator [rad]


def params(which: str = "flight", *, rate_limit: Any = RATE_LIMIT, limits: Any = None) -> np.ndarray:
    """Return PARAMS with threshold set `which`, the no-load rate [rad/s] and the travel limits [rad].

    "flight" is for hydraulic segments, "flight_ema" for electromechanical ones, which lag more in hard commands.
    """
    own, limits = thresholds("position_monitor", which), limits or TRAVEL
    return record(PARAMS, rate_limit=rate_limit, limit_low=limits[0], limit_high=limits[1], **own)


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape, not yet started: the model starts at the first command."""
    return np.zeros(p.shape, STATE)


@kernel
def step(x, u, p, dt):
    """Advance the model, compare, confirm, name."""
    good = usable(u.surface, u.surface_valid)
    x.surface = held(u.surface, u.surface_valid, x.surface)
    if math.isfinite(u.command):
        x.command = min(max(u.command, p.limit_low), p.limit_high)
    if x.started < 0.5:
        if good < 0.5:
            x.valid = 0.0
            return
        x.started = 1.0
        x.m1 = x.m2 = x.m3 = x.model = x.command
        x.slow = x.rest = x.leave = x.far = x.surface
        x.rest_model = x.leave_model = x.command
    # model: exact lags over the tick with their input held
    most = p.rate_limit * dt
    x.m1 += min(max(x.command - x.m1, -most), most)
    a = 1.0 - math.exp(-p.omega * dt)
    x.model += a * (x.m3 - x.model)
    x.m3 += a * (x.m2 - x.m3)
    x.m2 += a * (x.m1 - x.m2)
    x.lag = max(math.fabs(x.m1 - x.model), x.lag * (1.0 - min(dt / p.t_lag, 1.0)))
    x.age = 0.0 if good > 0.5 else x.age + dt
    x.valid = 1.0 if x.age <= p.t_invalid else 0.0
    if good < 0.5:
        return
    x.rate = (x.surface - x.slow) / p.tau_motion
    x.slow += (1.0 - math.exp(-dt / p.tau_motion)) * (x.surface - x.slow)
    x.rest_time += dt
    since = x.rest_time
    if math.fabs(x.slow - x.rest) > MOVED:
        x.rest, x.rest_model, x.rest_time = x.slow, x.model, 0.0
    deviation = x.surface - x.model
    x.r = deviation / (p.threshold + p.share * x.lag)
    away = math.copysign(1.0, deviation)  # the way back, or a surface where it should be, ends a run
    if math.fabs(x.r) < AWAY or (x.slow - x.leave) * away < 0.0 or (x.far - x.slow) * away > MOVED:
        x.leave = x.far = x.slow
        x.leave_model = x.model
        x.run_time = 0.0
    elif (x.slow - x.far) * away > 0.0:
        x.far = x.slow
    if x.rest_time == 0.0:
        x.run_time += since
    x.timer, x.alarm = confirm(x.timer, x.alarm, math.fabs(x.r) >= 1.0, dt, p.t_confirm, p.t_release)
    if x.alarm < 0.5:
        x.verdict = NONE
    elif x.verdict == NONE or x.verdict == AMBIGUOUS:
        moved = math.fabs(x.model - x.rest_model) >= p.jam_share * math.fabs(deviation)
        ended = min(x.slow - p.limit_low, p.limit_high - x.slow) < END
        travel = math.fabs(x.far - x.leave)
        own = (x.model - x.leave_model) * away <= FOLLOWS * travel
        if travel >= p.travel_run and (x.run_time >= p.t_run or ended) and own:
            x.verdict = RUNAWAY
        elif x.rest_time >= p.t_rest and moved and math.fabs(x.r) >= 1.0:
            x.verdict = JAM_SOLID
        else:
            x.verdict = AMBIGUOUS


rollout = entry(step, STATE, INPUTS, PARAMS)
