"""The vote of `ema_kalman_flight`: from its tests to a name, and back to health.

A sensor that two others contradict is named first, then what the drive does, then what holds the surface. An alarm is
AMBIGUOUS until one is sure; a name, once given, stays until the alarm ends. Without its surface sensor the position is
judged by the jump of R1, as said in `ema_kalman_flight`.
"""

import math

from actuators.block import kernel
from fdi.common.decision import confirm
from fdi.common.verdict import AMBIGUOUS, EFFECTIVENESS, JAM_SOLID, NONE, SENSOR
from fdi.ema import drive, sensor_noise, torque
from fdi.ema.dead_reckoning import MEAN
from fdi.ema.ema_kalman import CULPRITS as PUBLISHED
from fdi.ema.ema_kalman import CURRENT, POSITION, VELOCITY
from fdi.ema.sensor_noise import SURFACE

CULPRITS = (*PUBLISHED, "surface")
T_AGAIN = 3.0  # an alarm that comes back within that time had not healed: it is held twice as long [s]
WEAK_LEFT = 0.4  # weaker magnets leave more of what a current sensor does
HEAVY = 0.4  # of the load that is a jam's: what winds the screw up while the filter has yet to learn it
JAMMED = 1.5  # of the load that nothing explains: less may be friction
T_MOVING = 1.0  # after the alarm: what moves under such a load has not just been stopped [s]
SURE = 120.0  # information about what the motor has felt [rad2/s2]: the share is known to a tenth
SURE_READ = 4.0 * SURE  # of a velocity that is off: its own noise is in f, too
MISREAD = 0.35  # half of what a velocity sensor that is off leaves in f for its own
# it leaves no more than this, and is felt as a torque, too: not by half or twice as much; what is neither is a torque
# that no current tells of, as of a sensor in the drive's own loop
MISREAD_MOST, FELT_TOO = 1.3, 0.5
GRAIN = 1.5  # times what noise leaves that a current sensor's hypothesis may
SURE_SINE = 3.0  # deviations by which a sine has been felt less than the motor must
CURVED = drive.SINES


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
def _alone(x, p, dt):
    """Return the sensor that jumps against the other, without a surface sensor, or 0.

    A velocity that is off by as much as a jump needs, 20 rad/s and more, has b_motor times as much in f.
    """
    beyond = x.age >= p.t_start and x.r_jump >= 1.0
    x.timer_jump, x.hot_jump = confirm(x.timer_jump, x.hot_jump, beyond, dt, p.t_jump, 0.0)
    if x.hot_jump < 0.5 or x.age_cur > p.t_lost:
        return 0.0
    if x.r_f < 1.0:
        return POSITION
    return VELOCITY if x.read_num > p.felt_least * x.read_den else 0.0


@kernel
def _drive(x, p, dt):
    """Return (class, culprit) of what the current says, NONE while it is not sure."""
    if x.drive_name == drive.WEAK:
        return EFFECTIVENESS, 0.0
    even = min(x.residual[4], x.residual[6]) <= drive.PURE  # constant or growing: no drive fault adds that
    constant = even and x.curved >= CURVED  # no part of a slow sine
    read = p.felt_least <= x.misread <= MISREAD_MOST and x.misread * x.misread * x.read_den >= SURE_READ
    felt_too = math.fabs(x.felt - 1.0) <= FELT_TOO + SURE_SINE * drive.felt_sigma(x, p, dt)
    if x.hot_f > 0.5 and read and felt_too and not even:
        return SENSOR, VELOCITY
    if x.felt_den >= SURE:
        sine_or_drift, scale_or_bias = min(x.residual[0], x.residual[6]), min(x.residual[7], x.residual[4])
        shaped = min(sine_or_drift, scale_or_bias)
        most = p.felt_least if constant else p.felt_most
        sine = (even or x.residual[0] <= drive.PURE) and not constant
        unfelt = x.felt + SURE_SINE * drive.felt_sigma(x, p, dt) <= x.must
        told = unfelt or (not sine and shaped <= drive.PURE + GRAIN * x.grain)
        if told and x.residual[5] > WEAK_LEFT and shaped < 0.5 * x.residual[5] and -p.felt_least <= x.felt <= most:
            return SENSOR, CURRENT
        # friction keeps a part of a small one from the motor: more than a sensor's is felt, and what it must at least
        least = max(x.must, p.felt_most + SURE_SINE * drive.felt_sigma(x, p, dt))
        if x.felt >= min(p.felt_least, least) and x.misread < MISREAD and x.drive_name != NONE:
            return x.drive_name, 0.0
    if x.hot_gain > 0.5 and (x.weak > 0.5 or (x.gain_den >= SURE and x.gain_num >= p.felt_least * x.gain_den)):
        x.drive_lost = 1.0
        return EFFECTIVENESS, 0.0
    moves = x.w_power >= torque.CREEP * torque.CREEP  # what does not move may as well have jammed
    if x.hot_friction > 0.5 and x.hot_f < 0.5 and x.hot_gain < 0.5 and moves:
        return EFFECTIVENESS, 0.0
    return NONE, 0.0


@kernel
def decide(x, p, dt):
    """Confirm the tests, raise the alarm, name the fault, and withdraw it."""
    counts = x.age >= p.t_start
    ramp = math.fabs(x.R1) / p.th_R1
    inside = p.stop_low < x.pos_hat < p.stop_high
    heavy = counts and math.fabs(x.x_hat[5]) >= p.th_load and inside
    x.timer_load, x.hot_load = confirm(x.timer_load, x.hot_load, heavy, dt, p.t_load, p.t_release)
    lost_surface, lost_current = x.age_surface > p.t_lost, x.age_cur > p.t_lost
    alone = 0.0
    torque = lost_surface or lost_current
    if lost_surface:
        alone = _alone(x, p, dt)
    x.timer_ramp, x.hot_ramp = confirm(x.timer_ramp, x.hot_ramp, counts and lost_surface and ramp >= 1.0, dt, p.t_ramp,
                                       p.t_release)  # fmt: skip
    hot = counts and lost_current and x.r_velocity >= 1.0
    x.timer_cur, x.hot_cur = confirm(x.timer_cur, x.hot_cur, hot, dt, p.t_cur, p.t_release)
    x.r = max(max(x.r_pair, x.r_speed), max(max(x.r_f, x.r_gain), x.r_friction))
    x.r = max(max(x.r, x.r_rough), math.fabs(x.x_hat[5]) / p.th_load)
    if torque:
        x.r = max(x.r, max(x.r_velocity, max(x.r_jump, ramp)))
    sign = x.sensor > 0.5 or x.hot_speed > 0.5 or x.hot_f > 0.5 or x.hot_gain > 0.5 or x.hot_load > 0.5
    noisy, frozen = sensor_noise.noisy(x), sensor_noise.frozen(x, p, dt)
    sign = sign or x.hot_ramp > 0.5 or x.hot_cur > 0.5 or alone > 0.5 or noisy != 0.0 or frozen > 0.5
    sign = sign or x.hot_friction > 0.5
    sign = sign or (lost_surface and x.alarm > 0.5 and ramp >= 0.5)
    x.quiet_timer = 0.0 if sign else x.quiet_timer + dt
    x.hold_age = x.hold_age + dt if x.hold_age > 0.0 else 0.0
    if not sign and (x.alarm < 0.5 or x.quiet_timer >= x.hold):
        x.alarm = x.culprit = x.reconf = x.alarm_age = x.drive_lost = 0.0
        x.verdict = NONE
        return
    if x.alarm < 0.5:
        x.alarm, x.verdict = 1.0, AMBIGUOUS
        again = 0.0 < x.hold_age < T_AGAIN  # what comes back has not healed: it is held for longer
        x.hold = p.t_release if again else 0.0
    x.hold_age = dt
    x.alarm_age += dt
    if x.verdict != AMBIGUOUS:
        return
    who = _blame(x, p) if not lost_surface else alone
    if frozen > 0.5:
        who = frozen
    elif noisy > 0.5:
        who = noisy
    if who > 0.5:
        x.verdict, x.culprit = SENSOR, who
        if who == POSITION:
            x.reconf = 1.0
        return
    if x.pair_name == EFFECTIVENESS and x.hot_f < 0.5 and math.fabs(x.x_hat[5]) < HEAVY * p.th_load:
        x.verdict = EFFECTIVENESS
        return
    calm = x.sensor < 0.5 and x.r_speed < 0.7 and x.r_pair < 1.0
    if calm and x.alarm_age >= p.t_name and x.age_vel == 0.0:
        said, who = _drive(x, p, dt)
        if said != NONE:
            x.verdict, x.culprit = said, who
            return
    if heavy and x.hot_load > 0.5 and x.hot_f < 0.5 and x.hot_speed < 0.5 and x.blame < 0.5:
        if math.fabs(x.w_slow) < 0.1 * p.gate:
            x.verdict = JAM_SOLID if math.fabs(x.x_hat[5]) >= JAMMED * p.th_load else AMBIGUOUS
        elif x.alarm_age >= T_MOVING:
            x.verdict = EFFECTIVENESS


@kernel
def size(x, p, span):
    """State the declared fault's size in its sensor's unit; `span` [s] is what a jump of R1 is taken over."""
    x.f_hat = x.f_sigma = 0.0
    if x.culprit == POSITION:
        x.f_hat = x.R1
        x.f_sigma = math.sqrt(x.P_cc + p.sigma_pos * p.sigma_pos / p.n_sub)  # R1 is a mean
    elif x.culprit == CURRENT:
        x.f_hat = x.R2
        x.f_sigma = p.th_f  # the model's error, not the noise, limits it
    elif x.culprit == VELOCITY:
        x.f_hat = -x.jump / (p.lead * span)
        ends = 0.63 * math.sqrt(MEAN / (p.n_mean * p.n_sub))  # sqrt(2 / 5): both ends are means of five samples of 5 ms
        x.f_sigma = ends * p.sigma_pos / (p.lead * span)
