"""Consistency of three positions of the rod: position sensor, surface sensor, integral of the velocity sensor.

    rod = y_position,   rod = arm y_surface + windup - rigging,   rod = lead times the integral of y_velocity + const

`windup` is what torque winds screw and mount up, by the filter. Two that agree against the third name it
(`fdi.common.decision.pair_test`): position against surface, each against the velocity's integral, whose constant
follows in `pair_wash`. Where both positions leave the integral together, the velocity is wrong. Whether a surface that
leaves the other two is loose or its sensor wrong: `backlash`.
"""

import math

from actuators.block import kernel
from fdi.common import decision
from fdi.common.decision import clipped, confirm, usable
from fdi.ema.ema_kalman import VELOCITY

BLAMED = 0.6  # of the threshold: so far a position has left the integral before it is blamed
DOUBT = 0.7  # of the threshold: from there on the lever is not learned
MOVING = 10.0  # rate beside which that of its estimate's error is small [rad/s]
HALF = 0.5  # of `load_max` is the stall moment
WASH_FAULT = 0.3  # while the velocity is wrong, the integral's constant follows in [s]
VARIANCE = 2e-9  # of what windup and noise put the two apart by, over a second: 0.03 mm that last 2 s [m^2 s]
STANDS = 0.55  # of the threshold: so much of it keeps the alarm

PARAMS = [
    *decision.PAIR_PARAMS,
    ("arm", "f8", "m"),  # lever of the surface
    ("wind", "f8", "m/A"),  # windup of the screw per ampere that the demand does not explain
    ("th_speed", "f8", "m"),  # both positions less the velocity's integral
    ("rho_speed", "f8", "m s/rad"),  # and of the rate
    ("t_speed", "f8", "s"),
    ("t_release", "f8", "s"),  # an alarm outlives its cause by this
    ("t_lost", "f8", "s"),  # a sensor that is missing for longer is lost
]
STATE = [
    *decision.PAIR_STATE,
    *decision.LEVER_STATE,
    ("age_pos", "f8", "s"),  # since the last usable sample of the position
    ("age_surface", "f8", "s"),  # and of the surface
    ("y_arm", "f8", "m"),  # what the surface sensor says of the rod
    ("y_surface", "f8", "m"),  # the surface's reading, as rod
    ("pair_e", "f8", "m"),  # position less that of the surface
    ("r_pair", "f8", "-"),  # position against surface, over its threshold
    ("r_speed", "f8", "-"),  # both against the velocity, over its threshold
    ("speed_timer", "f8", "s"),
    ("hot_speed", "f8", "-"),  # confirmed
]


@kernel
def surface_as_rod(x, u, q, step, position, p):
    """Return the rod as the surface sensor says it [m] at the rod position `q` that changes by
    `step` a tick.

    Where `position` is measured the windup is anything between that by the filter, that of a motor that is held, and
    that of the current: torque says it no better.
    """
    with_load = q - p.arm * x.x_hat[0]
    without = with_load + p.arm / p.spring * x.x_hat[5]  # a motor that is held does not wind up the screw
    other = with_load + p.wind * x.f_lag
    y = p.arm * u.y_surface + x.lever * q + x.lever_lag * step
    if position < 0.5 or x.pair_time < p.pair_settle:
        return y + with_load
    low, high = min(with_load, min(without, other)), max(with_load, max(without, other))
    return y + min(max(u.y_position - x.rigging - y, low), high)


@kernel
def follow(x, share):
    """Let the integral's constants follow by `share` of what is left."""
    x.base_rod += share * x.e_rod
    x.base_surface += share * x.e_surface


@kernel
def compare(x, y, q, step, p, dt):
    """Compare the position `y` [m] and the surface's, both there, beyond what the pair test does."""
    apart = y - x.y_arm
    if x.pair_time < p.pair_settle:  # the constants are of the mean since engage, not of one noisy sample
        share = min(dt / max(x.pair_time, p.pair_tau), 1.0)
        follow(x, share)
        x.e_rod *= 1.0 - share
        x.e_surface *= 1.0 - share
    else:
        x.pair_e = apart - x.rigging
    if x.sensor > 0.5:  # the clip is for spikes before an alarm: 24 mm/s
        d = apart - x.rigging - x.pair_d
        x.pair_d += (1.0 - math.exp(-dt / p.pair_tau)) * (d - clipped(d, p.pair_clip))
    elif math.fabs(x.pair_d) < DOUBT * x.pair_limit:
        decision.learn_lever(x, apart + x.lever * q + x.lever_lag * step, q, step, VARIANCE / dt, dt)


@kernel
def speed(x, w, bias, aged, p, dt):
    """Test what both positions, or the one that is left, say of the velocity's integral; learn its `bias` [m/s]."""
    e, wrong = 0.0, x.isolated_part == VELOCITY
    if x.e_rod * x.e_surface > 0.0:  # what both say is learned, as far as a healthy velocity sensor may be off
        e = x.e_rod if math.fabs(x.e_rod) < math.fabs(x.e_surface) else x.e_surface
    x.model_bias = bias
    if not wrong and x.hot_speed < 0.5:  # of a sensor that is wrong nothing is learned
        x.model_bias = clipped(bias + e * dt / (3.0 * p.pair_wash * p.pair_wash), p.b_max * p.lead)
    no_position, no_surface = x.age_pos > p.t_lost, x.age_surface > p.t_lost
    if no_position or no_surface:
        e = x.e_surface if no_position else x.e_rod
    if x.age_vel > 0.0 or (no_position and no_surface):
        e = 0.0
    x.r_speed = math.fabs(e) / (p.th_speed + p.rho_speed * math.fabs(w) + aged)
    beyond = x.r_speed >= (STANDS if wrong else 1.0) and x.age >= p.t_start
    x.speed_timer, x.hot_speed = confirm(x.speed_timer, x.hot_speed, beyond, dt, p.t_speed, p.t_release)


@kernel
def update(x, u, w, p, dt):
    """Compare the three; `w` is the motor's mean rate of the tick, as measured or what stands for it [rad/s]. Any of
    them may be a tick older than is foreseen."""
    position, surface = usable(u.y_position, u.position_valid), usable(u.y_surface, u.surface_valid)
    x.age_pos = 0.0 if position > 0.5 else x.age_pos + dt
    x.age_surface = 0.0 if surface > 0.5 else x.age_surface + dt
    q = p.lead * x.x_hat[2]  # by the velocity: free of the readings' noise
    step = p.lead * dt * x.x_hat[3] if math.fabs(x.x_hat[3]) > MOVING else 0.0
    aged = p.lead * dt * math.sqrt(x.w_power)
    slack = decision.lever_slack(x, q, aged)
    x.rigging = x.lever_offset
    if surface > 0.5:
        x.y_surface = p.arm * u.y_surface
        x.y_arm = surface_as_rod(x, u, q, step, position, p)
    load = (x.hm0 + x.hmd * x.x_hat[0] + x.x_hat[5]) / (p.load_max * HALF)
    bias = x.model_bias
    decision.pair_test(x, u.y_position, position, x.y_arm, surface, p.lead * w, load, slack, True, p, dt)
    if position > 0.5 and surface > 0.5:
        compare(x, u.y_position, q, step, p, dt)
    if x.isolated_part == 0.0 and max(math.fabs(x.e_rod), math.fabs(x.e_surface)) < BLAMED * p.pair_threshold + aged:
        x.blame = 0.0  # which of them has left the integral cannot be seen yet
    if x.impact > 0.0:  # within a tick the integral is not known
        follow(x, 1.0)
        x.e_rod = x.e_surface = 0.0
    if x.isolated_part == VELOCITY:  # what is left tells of the velocity as it is
        follow(x, min(dt / WASH_FAULT, 1.0))
    x.r_pair = math.fabs(x.pair_d) / x.pair_limit
    speed(x, w, bias, aged, p, dt)
