"""The vote of `ema_kalman_flight`: from its tests to a name, and back to health.

A sensor that two others contradict is named first, then what the drive does, then what holds the surface. An alarm is
AMBIGUOUS until one is sure; a name, once given, stays until the alarm ends.
"""

import math

from actuators.block import kernel
from fdi.common.decision import confirm
from fdi.common.verdict import AMBIGUOUS, EFFECTIVENESS, JAM_SOLID, NONE, SENSOR
from fdi.ema import sensor_noise, torque
from fdi.ema.ema_kalman import CURRENT, POSITION, VELOCITY
from fdi.ema.ema_kalman import ISOLABLE_PARTS as PUBLISHED
from fdi.ema.position_consistency import WASH_FAULT
from fdi.ema.sensor_noise import SURFACE

ISOLABLE_PARTS = (*PUBLISHED, "surface")
T_AGAIN = 3.0  # an alarm that comes back within that time had not healed: it is held twice as long [s]
HEAVY = 0.4  # of the load that is a jam's: what winds the screw up while the filter has yet to learn it
JAMMED = 1.5  # of the load that nothing explains: less may be friction
T_MOVING = 1.0  # after the alarm: what moves under such a load has not just been stopped [s]
SURE = 4.0  # information about what the motor has felt of a gain that is off: its share is known to a half


@kernel
def _blame(x, p):
    """Return the sensor that the others contradict, or 0."""
    two = x.r_pair < 0.7 and x.age_pos < p.t_lost and x.age_surface < p.t_lost
    if x.hot_speed > 0.5 and two:
        return VELOCITY
    if x.hot_f > 0.5 or x.age_vel > p.t_bad:  # no position can move the current; two witnesses are no vote
        return 0.0
    load = math.fabs(x.x_hat[5])  # which winds the screw up, and moves what is loose
    if x.sensor < 0.5:
        return 0.0
    if x.blame == 1.0 and load < p.th_load:
        return POSITION
    return SURFACE if x.blame == 2.0 and x.pair_name == SENSOR and load < HEAVY * p.th_load else 0.0


@kernel
def _drive(x, p):
    """Return (class, isolated_part) of what the current says, NONE while it is not sure."""
    if x.drive_name != NONE:
        return x.drive_name, x.drive_who
    felt = x.felt_J[0] >= SURE and x.felt_b[0] >= p.felt_least * x.felt_J[0]
    if x.hot_gain > 0.5 and (x.weak > 0.5 or felt):
        x.drive_lost = 1.0
        return EFFECTIVENESS, 0.0
    moves = x.w_power >= torque.CREEP * torque.CREEP  # what does not move may as well have jammed
    if x.hot_friction > 0.5 and x.hot_f < 0.5 and x.hot_gain < 0.5 and moves:
        return EFFECTIVENESS, 0.0
    return NONE, 0.0


@kernel
def _tested(x, p, dt):
    """Confirm the test of the load; return (whether any test shows a fault, the sensor that is wrong for sure or 0)."""
    load = math.fabs(x.x_hat[5]) / p.th_load
    heavy = x.age >= p.t_start and load >= 1.0 and p.stop_low < x.pos_hat < p.stop_high
    x.timer_load, x.hot_load = confirm(x.timer_load, x.hot_load, heavy, dt, p.t_load, p.t_release)
    x.r = max(max(max(x.r_pair, x.r_speed), max(x.r_f, x.r_gain)), max(max(x.r_friction, x.r_rough), load))
    told = sensor_noise.wrong(x, p, dt)
    sign = x.sensor + x.hot_speed + x.hot_f + x.hot_gain + x.hot_load + x.hot_friction > 0.5
    return sign or told != 0.0, told if told > 0.5 else _blame(x, p)


@kernel
def _name(x, who, p):
    """Name the fault: a sensor `who` is wrong for sure, the drive, or what holds the surface."""
    load = math.fabs(x.x_hat[5]) / p.th_load
    calm = x.sensor < 0.5 and x.r_speed < 0.7 and x.r_pair < 1.0
    if who > 0.5:
        x.verdict, x.isolated_part, x.reconf = SENSOR, who, 1.0 if who == POSITION else 0.0
    elif x.pair_name == EFFECTIVENESS and x.hot_f < 0.5 and load < HEAVY:
        x.verdict = EFFECTIVENESS
    elif calm and x.alarm_age >= p.t_name and x.age_vel == 0.0 and _drive(x, p)[0] != NONE:
        x.verdict, x.isolated_part = _drive(x, p)
    elif load >= 1.0 and x.hot_load > 0.5 and x.hot_f < 0.5 and x.hot_speed < 0.5 and x.blame < 0.5:
        if math.fabs(x.w_slow) < 0.1 * p.gate:
            x.verdict = JAM_SOLID if load >= JAMMED else AMBIGUOUS
        elif x.alarm_age >= T_MOVING:
            x.verdict = EFFECTIVENESS


@kernel
def decide(x, p, dt):
    """Raise the alarm where a test shows a fault, name it, and withdraw it."""
    sign, who = _tested(x, p, dt)
    x.quiet_timer = 0.0 if sign else x.quiet_timer + dt
    x.hold_age = x.hold_age + dt if x.hold_age > 0.0 else 0.0
    if not sign and (x.alarm < 0.5 or x.quiet_timer >= x.hold):
        x.alarm = x.isolated_part = x.reconf = x.alarm_age = x.drive_lost = 0.0
        x.verdict = NONE
        return
    if x.alarm < 0.5:
        x.alarm, x.verdict = 1.0, AMBIGUOUS
        again = 0.0 < x.hold_age < T_AGAIN  # what comes back has not healed: it is held for longer
        x.hold = p.t_release if again else 0.0
    x.hold_age = dt
    x.alarm_age += dt
    if x.verdict == AMBIGUOUS:
        _name(x, who, p)


@kernel
def size(x, p):
    """State the declared fault's size in its sensor's unit."""
    x.f_hat = x.f_sigma = 0.0
    if x.isolated_part == POSITION:
        x.f_hat = x.R1
        x.f_sigma = math.sqrt(x.P_cc + p.sigma_pos * p.sigma_pos / p.n_sub)  # R1 is a mean
    elif x.isolated_part == CURRENT:
        x.f_hat = x.R2
        x.f_sigma = p.th_f  # the model's error, not the noise, limits it
    elif x.isolated_part == VELOCITY:  # both positions leave the integral, which follows within WASH_FAULT
        x.f_hat = -0.5 * (x.e_rod + x.e_surface) / (p.lead * WASH_FAULT)
        x.f_sigma = 0.5 * p.sigma_pos / (p.lead * WASH_FAULT)
