"""The vote of `ema_kalman_flight`: from its tests to the name of a sensor, and back to health."""

import math

from actuators.block import kernel
from fdi.common.decision import confirm
from fdi.common.verdict import AMBIGUOUS, EFFECTIVENESS, JAM_SOLID, NONE, SENSOR
from fdi.ema.dead_reckoning import MEAN
from fdi.ema.ema_kalman import CURRENT, POSITION, VELOCITY


@kernel
def decide(x, p, dt):
    """Confirm the tests and read the table; a sensor once named stays named until it heals."""
    counts = x.age >= p.t_start
    ramp = math.fabs(x.R1) / p.th_R1
    hot = x.age_hot < p.t_hold and x.share >= p.share_hi
    both = hot and math.fabs(x.jump) >= p.th_both
    x.age_hot = 0.0 if x.r_velocity >= 1.0 else x.age_hot + dt
    lone = x.r_current if math.fabs(x.jump) < p.th_both else 0.0
    x.timer_vel, x.hot_vel = confirm(x.timer_vel, x.hot_vel, counts and both, dt, p.t_vel, 0.0)
    x.timer_jump, x.hot_jump = confirm(x.timer_jump, x.hot_jump, counts and x.r_jump >= 1.0, dt, p.t_jump, 0.0)
    x.timer_cur, x.hot_cur = confirm(x.timer_cur, x.hot_cur, counts and lone >= 1.0, dt, p.t_cur, 0.0)
    x.timer_ramp, x.hot_ramp = confirm(x.timer_ramp, x.hot_ramp, counts and ramp >= 1.0, dt, p.t_ramp, 0.0)
    heavy = counts and math.fabs(x.x_hat[5]) >= p.th_load
    x.timer_load, x.hot_load = confirm(x.timer_load, x.hot_load, heavy, dt, p.t_load, 0.0)
    x.r = max(max(x.r_velocity, x.r_current), max(x.r_jump, ramp))
    if x.culprit == VELOCITY or x.culprit == POSITION:
        return
    sharp = x.hot_jump > 0.5 and x.need >= p.th_need
    if x.hot_vel > 0.5 or (sharp and x.share >= p.share_hi):
        x.culprit, x.verdict, x.alarm = VELOCITY, SENSOR, 1.0
    elif sharp and x.share <= p.share_lo:
        x.culprit, x.verdict, x.alarm, x.reconf = POSITION, SENSOR, 1.0, 1.0
    elif x.alarm < 0.5:
        if x.hot_cur > 0.5 and x.felt >= p.share_real:
            x.verdict, x.alarm = EFFECTIVENESS, 1.0
        elif x.hot_cur > 0.5 and x.age_hot > p.t_hold:
            x.culprit, x.verdict, x.alarm = CURRENT, SENSOR, 1.0
        elif x.hot_load > 0.5:
            x.verdict, x.alarm = JAM_SOLID if math.fabs(x.w_slow) < 0.1 * p.gate else EFFECTIVENESS, 1.0
        elif x.hot_ramp > 0.5:
            x.verdict, x.alarm = AMBIGUOUS, 1.0


@kernel
def heal(x, p, dt):
    """End an alarm after agreement over both time and travel: a frozen sensor agrees as long as nothing moves."""
    apart = max(x.r_velocity, x.r_current) >= 1.0 or math.fabs(x.R1) >= 0.5 * p.th_R1 or x.hot_load > 0.5
    if x.alarm < 0.5 or apart:
        x.agree = 0.0
        x.low = x.high = x.pos_hat
        return
    x.agree += dt
    x.low = min(x.low, x.pos_hat)
    x.high = max(x.high, x.pos_hat)
    if x.agree >= p.t_heal and x.high - x.low >= p.heal_travel:
        x.alarm = x.reconf = x.culprit = x.agree = 0.0
        x.verdict = NONE


@kernel
def size(x, p, span):
    """State the declared fault's size in its sensor's unit; `span` [s] is what a jump of R1 is taken over."""
    x.f_hat = x.f_sigma = 0.0
    if x.culprit == POSITION:
        x.f_hat = x.R1
        x.f_sigma = math.sqrt(x.P_cc + p.sigma_pos * p.sigma_pos / p.n_sub)  # R1 is a mean
    elif x.culprit == CURRENT:
        x.f_hat = x.R2
        x.f_sigma = p.th_cur / 3.0  # the model's error, not the noise, limits it
    elif x.culprit == VELOCITY:
        x.f_hat = -x.jump / (p.lead * span)
        ends = 0.63 * math.sqrt(MEAN / (p.n_mean * p.n_sub))  # sqrt(2 / 5): both ends are means of five samples of 5 ms
        x.f_sigma = ends * p.sigma_pos / (p.lead * span)
