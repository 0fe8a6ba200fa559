"""The vote of `ema_kalman_flight`: from its tests to a name, and back to health.

A sensor that two others contradict is named first, then what the drive does, then what holds the surface. An alarm is
AMBIGUOUS until one is sure; a name, once given, stays until the alarm ends.
"""

import math

from actuators.block import kernel
from fdi.common.decision import confirm
from fdi.common.verdict import AMBIGUOUS, EFFECTIVENESS, JAM_SOLID, NONE, SENSOR
from fdi.ema import gains, sensor_noise, torque
from fdi.ema.ema_kalman import CURRENT, POSITION, VELOCITY
from fdi.ema.ema_kalman import ISOLABLE_PARTS as PUBLISHED
from fdi.ema.positions import T_AGAINST, WASH_FAULT
from fdi.ema.sensor_noise import SURFACE

ISOLABLE_PARTS = (*PUBLISHED, "surface")
# of the load that nothing explains: from there on one side to the stall moment on the other (0.4 to 1 of it). By what
# this winds up a jammed drive moves; one that goes further drives on, and its current sensor may be off in its loop
WINDUP = 3.5
JAMMED = 1.5  # of the load that nothing explains: less may be friction


@kernel
def _blame(x, p):
    """Return the sensor that the others contradict, or 0."""
    if x.hot_speed > 0.5 and x.r_pair < 0.7 and max(x.age_pos, x.age_surface) < p.t_lost:
        return VELOCITY
    if x.sensor < 0.5 or x.hot_f > 0.5 or x.age_vel > p.t_bad:  # no position moves the current; two are no vote
        return 0.0
    if x.blame == 1.0 and math.fabs(x.x_hat[5]) < p.th_load:  # which winds the screw up
        return POSITION
    return SURFACE if x.blame == 2.0 and x.against >= T_AGAINST else 0.0


@kernel
def _drive(x, p):
    """Return (class, isolated_part) of what the current says, AMBIGUOUS while it is not sure."""
    if x.drive_name != NONE:
        return x.drive_name, x.drive_who
    if x.hot_gain > 0.5 and x.change[gains.GAIN] < p.th_a and x.change[gains.MAGNETS] > -p.th_b:  # no drive gains
        x.drive_lost = 1.0
        return EFFECTIVENESS, 0.0
    moves = x.w_power >= torque.CREEP * torque.CREEP  # what does not move may as well have jammed
    return EFFECTIVENESS if x.hot_friction > 0.5 and x.hot_f < 0.5 and moves else AMBIGUOUS, 0.0


@kernel
def _name(x, who, load, p):
    """Name the fault: a sensor `who` is wrong for sure, the drive, or what holds the surface under a `load` that no
    hinge explains [th_load]."""
    if who > 0.5:
        x.verdict, x.isolated_part, x.reconf = SENSOR, who, 1.0 if who == POSITION else 0.0
    elif x.sensor < 0.5 and x.r_speed < 0.7 and x.alarm_age >= p.t_name and x.age_vel == 0.0:
        x.verdict, x.isolated_part = _drive(x, p)
    held = x.load_travel < WINDUP * p.th_load / p.spring * p.arm and x.hot_load > 0.5 and load >= JAMMED
    if x.verdict == AMBIGUOUS and held and x.hot_f < 0.5 and x.hot_speed < 0.5 and x.blame < 0.5:
        x.verdict = JAM_SOLID


@kernel
def decide(x, p, dt):
    """Raise the alarm where a test shows a fault, name it, and withdraw it."""
    load = math.fabs(x.x_hat[5]) / p.th_load
    x.load_at = x.pos_hat if load < 1.0 else x.load_at
    x.load_travel = max(x.load_travel if load >= 1.0 else 0.0, math.fabs(x.pos_hat - x.load_at))
    heavy = x.age >= p.t_start and load >= 1.0 and p.stop_low < x.pos_hat < p.stop_high
    x.timer_load, x.hot_load = confirm(x.timer_load, x.hot_load, heavy, dt, p.t_load, p.t_release)
    x.r = max(max(max(x.r_pair, x.r_speed), max(x.r_f, x.r_gain)), max(max(x.r_friction, x.r_rough), load))
    who = sensor_noise.wrong(x, p, dt)
    if who == 0.0 and x.sensor + x.hot_speed + x.hot_f + x.hot_gain + x.hot_load + x.hot_friction < 0.5:
        x.alarm = x.isolated_part = x.reconf = x.alarm_age = x.drive_lost = 0.0
        x.verdict = NONE
        return
    if x.alarm < 0.5:
        x.alarm, x.verdict = 1.0, AMBIGUOUS
    x.alarm_age += dt
    if x.verdict == AMBIGUOUS:
        _name(x, who if who > 0.5 else _blame(x, p), load, p)


@kernel
def size(x, p):
    """State the declared fault's size in its sensor's unit."""
    x.f_hat = x.f_sigma = 0.0
    if x.isolated_part == POSITION:
        x.f_hat = x.R1
        x.f_sigma = x.pos_sigma
    elif x.isolated_part == CURRENT:
        x.f_hat = x.R2
        x.f_sigma = p.th_f  # the model's error, not the noise, limits it
    elif x.isolated_part == VELOCITY:  # both positions leave the integral, which follows within WASH_FAULT
        x.f_hat = -0.5 * (x.e_rod + x.e_surface) / (p.lead * WASH_FAULT)
        x.f_sigma = 0.5 * p.sigma_pos / (p.lead * WASH_FAULT)
