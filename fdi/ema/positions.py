"""Consistency of three positions of the rod: position sensor, surface sensor, integral of the velocity sensor.

    rod = y_position,   rod = arm y_surface + windup - rigging,   rod = lead times the integral of y_velocity + const

`windup` is what torque winds screw and mount up, by the filter. Two that agree against the third name it
(`fdi.common.decision.pair_test`): position against surface, each against the velocity's integral, whose constant
follows in `pair_wash`. Where both positions leave the integral together, the velocity is wrong. Whether a surface that
leaves the other two has play or its sensor is wrong the hinge moment says: within its play a surface rests where the
load drives it, and goes over when that turns. What stands against the load, or is larger, is the sensor's.

    pos_hat = integral + constant of the position sensor

Kinematics alone: no load, no torque and no parameter but the screw's lead enters. A position sensor that is wrong no
longer moves the constant, which then follows the surface. pos_sigma grows with the time without either, as if nothing
had been learned of the velocity's bias.
"""

import math

from actuators.block import kernel
from fdi.common import decision
from fdi.common.decision import PLAY, clipped, confirm, usable
from fdi.ema.ema_kalman import POSITION, VELOCITY

DOUBT = 0.7  # of the threshold: from there on the lever is not learned
MOVING = 10.0  # rate beside which that of its estimate's error is small [rad/s]
HALF = 0.5  # of `load_max` is the stall moment
WASH_FAULT = 0.3  # while the velocity is wrong, the integral's constant follows in [s]
VARIANCE = 2e-9  # of what windup and noise put the two apart by, over a second: 0.03 mm that last 2 s [m^2 s]
STANDS = 0.55  # of the threshold: so much of it keeps the alarm
TAU_LOAD, TURNS = 0.1, 300.0  # lag of the hinge moment [s], and that which surely has a sign [N m]
T_AGAINST = 0.35  # against the load: three lags of the difference and more [s]
FORGIVEN = 0.5  # share of the time to the other side that is taken off: a surface needs time to go over
T_SURFACE = 2.0  # the constant of a position sensor that is wrong follows the surface within [s]
# the filter's angle follows pos_hat within [s]: settled before the alarm of a healed sensor ends (1 s of release), and
# slow beside the load estimate, which has to follow the hinge moment of the angle that is corrected
T_ANGLE = 0.3

PARAMS = [
    *decision.PAIR_PARAMS,
    ("arm", "f8", "m"),  # lever of the surface
    ("th_speed", "f8", "m"),  # both positions less the velocity's integral
    ("rho_speed", "f8", "m s/rad"),  # and of the rate
    ("t_speed", "f8", "s"),
    ("t_release", "f8", "s"),  # an alarm outlives its cause by this
    ("t_lost", "f8", "s"),  # a sensor that is missing for longer is lost
    ("sigma_pos", "f8", "m"),  # position sensor noise
    ("sigma_rig", "f8", "m"),  # its rigging bias, which nothing here can see
    ("sigma_b", "f8", "m/s"),  # of the integral: bias that a velocity sensor has
    ("b_max", "f8", "rad/s"),  # largest velocity bias that is learned
    ("sigma_max", "f8", "m"),  # pos_sigma above which the estimate is not valid
]
STATE = [
    *decision.PAIR_STATE,
    *decision.LEVER_STATE,
    ("pair_load", "f8", "N m"),  # hinge moment, lagged
    ("against", "f8", "s"),  # time for which the surface is said to stand against it
    ("pos_hat", "f8", "m"),  # estimated rod position, as the healthy sensor would read it
    ("pos_sigma", "f8", "m"),  # its standard deviation
    ("R1", "f8", "m"),  # (9): position sensor less pos_hat, mean of 5 ms
    ("age_pos", "f8", "s"),  # since the last usable sample of the position
    ("age_surface", "f8", "s"),  # and of the surface
    ("age_tied", "f8", "s"),  # since pos_hat was last tied to either
    ("y_arm", "f8", "m"),  # what the surface sensor says of the rod
    ("tick_e", "f8", "m"),  # what both would leave the integral by, were the velocity read a tick earlier or later
    ("tick_base", "f8", "m"),  # and the integral's constants
    ("r_pair", "f8", "-"),  # position against surface, over its threshold
    ("r_speed", "f8", "-"),  # both against the velocity, over its threshold
    ("speed_timer", "f8", "s"),
    ("hot_speed", "f8", "-"),  # confirmed
]


@kernel
def surface_as_rod(x, u, q, step, position, p):
    """Return the rod as the surface sensor says it [m] at the rod position `q` that changes by
    `step` a tick.

    Where `position` is measured the windup is anything between that by the filter and that of a motor that is held.
    """
    with_load = q - p.arm * x.x_hat[0]
    without = with_load + p.arm / p.spring * x.x_hat[5]  # a motor that is held does not wind up the screw
    y = p.arm * u.y_surface + x.lever * q + x.lever_lag * step
    if position < 0.5 or x.pair_time < p.pair_settle:
        return y + with_load
    low, high = min(with_load, without), max(with_load, without)
    return y + min(max(u.y_position - x.rigging - y, low), high)


@kernel
def play(x, moment, dt):
    """Tell by the hinge `moment` [N m] whether a surface that has left the other two may as well have play."""
    x.pair_load += min(dt / TAU_LOAD, 1.0) * (moment - x.pair_load)
    e, sure = math.fabs(x.pair_d), dt * min(math.fabs(x.pair_load) / TURNS, 1.0)
    if x.sensor < 0.5:
        x.against = 0.0
    elif e > PLAY:
        x.against = T_AGAINST
    elif e > 0.5 * x.pair_limit:
        x.against = max(x.against + (sure if x.pair_d * x.pair_load > 0.0 else -FORGIVEN * sure), 0.0)


@kernel
def follow(x, share):
    """Let the integral's constants follow by `share` of what is left."""
    x.base_rod += share * x.e_rod
    x.tick_base += share * x.tick_e
    x.base_surface += share * x.e_surface


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
    x.r_speed = math.fabs(e) / (p.th_speed + p.rho_speed * math.fabs(w) + max(math.fabs(x.tick_e), aged))
    beyond = x.r_speed >= (STANDS if wrong else 1.0) and x.age >= p.t_start
    x.speed_timer, x.hot_speed = confirm(x.speed_timer, x.hot_speed, beyond, dt, p.t_speed, p.t_release)


@kernel
def estimate(x, y, seen, base, p, dt):
    """Write pos_hat, its deviation and R1 of the position `y` [m] where it is `seen`; `base` is the constant of the
    tick before [m]."""
    wrong = x.isolated_part == POSITION
    doubt = x.r_speed >= DOUBT and x.isolated_part != VELOCITY
    tied = not wrong and seen and not doubt and math.fabs(x.pair_d) <= DOUBT * x.pair_limit
    if wrong and x.age_surface == 0.0:
        x.base_rod = base + dt / T_SURFACE * (x.y_arm + x.rigging - x.model_q - base)
        tied = True
    elif doubt and x.age_surface > p.t_lost:  # of two witnesses neither is believed
        x.base_rod = base
    x.age_tied = 0.0 if tied else x.age_tied + dt
    x.pos_hat = x.model_q + x.base_rod
    x.pos_sigma = math.sqrt(p.sigma_rig * p.sigma_rig + p.sigma_b * p.sigma_b * x.age_tied * x.age_tied)
    if seen:
        x.R1 += p.share * (y - x.pos_hat - x.R1)
    if x.age_vel == 0.0:  # the filter's angle sees the hinge stiffness alone: a velocity error would stay in its load
        turn = dt / T_ANGLE * (x.pos_hat / p.lead - x.x_hat[2])
        x.x_hat[2] += turn
        x.x_hat[0] += p.ratio * turn


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
        x.y_arm = surface_as_rod(x, u, q, step, position, p)
    moment = x.hm0 + x.hmd * x.x_hat[0] + x.x_hat[5]
    load = moment / (p.load_max * HALF)
    bias, base = x.model_bias, x.base_rod
    decision.pair_test(x, u.y_position, position, x.y_arm, surface, p.lead * w, load, slack, True, p, dt)
    apart = u.y_position - x.y_arm
    if position > 0.5 and surface > 0.5 and x.sensor > 0.5:  # the pair's clip is for spikes before an alarm: 24 mm/s
        d = apart - x.rigging - x.pair_d
        x.pair_d += (1.0 - math.exp(-dt / p.pair_tau)) * (d - clipped(d, p.pair_clip))
    elif position > 0.5 and surface > 0.5 and math.fabs(x.pair_d) < DOUBT * x.pair_limit:
        apart += x.lever * q + x.lever_lag * step
        decision.learn_lever(x, apart, q, step, VARIANCE / dt, dt)
    x.tick_e += (1.0 - math.exp(-dt / p.pair_tau)) * (p.lead * dt * w - x.tick_base - x.tick_e)
    x.tick_base += dt / p.pair_wash * x.tick_e
    if x.impact > 0.0:  # within a tick the integral is not known
        follow(x, 1.0)
        x.e_rod = x.e_surface = x.tick_e = 0.0
    if x.isolated_part == VELOCITY:  # what is left tells of the velocity as it is
        follow(x, min(dt / WASH_FAULT, 1.0))
    x.r_pair = math.fabs(x.pair_d) / x.pair_limit
    speed(x, w, bias, aged, p, dt)
    play(x, moment, dt)
    estimate(x, u.y_position, position > 0.5, base, p, dt)
