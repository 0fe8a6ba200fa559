"""The current of an EMA against its demand: what this drive makes of it, the test of what is left, and its samples.

    i = K_gi u / R_loop - b_motor w;   d = i + what the drive's own gain, magnets and ages make of it, limited
    f = y - d,   alarm: lagged power of f over what noise, rate and the doubts of these make of it

What is the drive's own is learned (`gains`); which fault it is: `shapes`.
"""

import math

from actuators.block import kernel
from fdi.common.decision import clipped, confirm
from fdi.common.sinusoid import put
from fdi.common.verdict import NONE
from fdi.ema import gains, shapes, torque
from fdi.ema.ema_kalman import VELOCITY

NO_CURRENT = 2.5  # of the largest: what a drive and a biased sensor together do not read
BLIND = 2.5  # threshold of f without the velocity sensor, over that with it
TAU_POWER, SPIKE = 0.1, 0.5  # lag of the power of f [s]; share of its threshold that one sample may fill

PARAMS = [
    ("th_f", "f8", "A"),  # rms of f, fixed part
    ("rho_f", "f8", "A s/rad"),  # and of the rate
    ("t_f", "f8", "s"),  # confirmation
    *shapes.PARAMS,
]
STATE = [
    ("f_now", "f8", "A"),  # measured current less the model's
    ("i_now", "f8", "A"),  # that of a nominal drive
    ("f_mean", "f8", "A"),  # over 5 ms
    ("f_power", "f8", "A2"),  # its square, lagged
    ("w_power", "f8", "rad2/s2"),
    ("turn", "f8", "rad/s"),  # by how much the rate changes in a tick, by the filter
    ("off_power", "f8", "A2"),  # of what the drive's own gain and magnets may make
    ("aged_power", "f8", "A2"),  # and the ages of the readings
    ("r_f", "f8", "-"),  # over its threshold
    ("f_timer", "f8", "s"),
    ("hot_f", "f8", "-"),  # confirmed
    *shapes.STATE,
]


@kernel
def demanded(x, w, p):
    """Write the columns of `gains` at the rate `w` [rad/s]; return the current that this drive makes of its demand and
    what it would be at rest [A]. A spike in the demand is no demand.
    """
    z, late, most = x.column, int(p.delay), 2.0 * p.I_max
    per_ampere, back = p.K_gi / p.R_loop, p.b_motor * w
    z[gains.GAIN] = clipped(per_ampere * x.u_old[late], most)
    i = z[gains.GAIN] - back
    z[gains.OLDER] = x.i_now - i
    z[gains.YOUNGER] = clipped(per_ampere * x.u_old[max(late - 1, 0)], most) - z[gains.GAIN]
    z[gains.RATE], z[gains.MAGNETS] = p.b_motor * x.turn, back
    x.i_now = i
    for k in range(gains.N):
        i += x.own[k] * z[k]
    i = clipped(i, p.I_max)
    return i, i + (1.0 - x.own[gains.MAGNETS]) * back


@kernel
def test(x, f, rest, w, seen, p, dt):
    """Test the power of `f` [A] where it is `seen`, at the current `rest` [A] and the rate `w` [rad/s]."""
    h = dt / TAU_POWER
    own, magnets = gains.doubt(x)
    off = own * math.fabs(rest) + magnets * p.b_motor * math.fabs(w)
    aged, turned = (x.own_sd[gains.OLDER] + gains.JITTER) * x.column[gains.OLDER], p.b_motor * x.turn
    x.off_power += h * (off * off - x.off_power)
    x.aged_power += h * (aged * aged + turned * turned - x.aged_power)
    least = math.sqrt(p.th_f * p.th_f + x.aged_power) + p.rho_f * math.sqrt(x.w_power) + math.sqrt(x.off_power)
    least *= 1.0 if x.age_vel <= p.t_bad else BLIND
    if seen:
        x.f_mean += p.share * (f - x.f_mean)  # so that noise weighs the same at every rate
        most = SPIKE * least * least / h  # one sample alone is no fault
        x.f_power += h * (min(x.f_mean * x.f_mean, most) - x.f_power)
        x.w_power += h * (w * w - x.w_power)
        x.r_f = math.sqrt(x.f_power) / least
    beyond = seen and x.r_f >= 1.0 and x.age >= p.t_start
    x.f_timer, x.hot_f = confirm(x.f_timer, x.hot_f, beyond, dt, p.t_f, p.t_release)


@kernel
def watch(x, y, current, w, measured, gamma, p, dt):
    """Take a tick: current `y` [A] where it is usable, rate `w`, which may be believed where it is `measured`, and its
    innovation `gamma` [rad/s].
    """
    d, rest = demanded(x, w, p)
    seen = current and x.at_limit < 0.5 and math.fabs(y) < NO_CURRENT * p.I_max
    f = y - d if seen else 0.0
    x.f_now = f
    test(x, f, rest, w, seen, p, dt)
    plain = measured and x.f_timer <= 0.0
    # while the demand stands the rate as predicted is the sensor's noise, and no voltage answers it
    if x.u_old[0] != x.u_old[1] and seen and plain and math.fabs(d) < p.I_max:
        gains.accumulate(x, f, w - gamma, p, dt)
    torque.feel(x, f, gamma, current, p, dt)
    s = x.even_sum
    s[shapes.F] += f
    s[shapes.C] += f + rest
    s[shapes.W_ROW] += w
    x.even_lost += 0.0 if seen else 1.0
    x.even_ticks += 1.0
    if x.even_ticks >= p.even:
        sample(x, plain, p, dt)


@kernel
def sample(x, plain, p, dt):
    """Put a sample into the ring, learn of it where it is `plain`, and weigh what f has been since it began."""
    x.even_head = put(x.even_ring, x.even_sum, p.even, x.even_head)
    whole = x.even_lost < 0.5
    x.even_ticks = x.even_lost = 0.0
    if whole and plain:
        gains.test(x, p, dt)
    if x.isolated_part == VELOCITY:
        gains.forget(x)
    if x.hot_f < 0.5 and x.f_timer <= 0.0:
        x.f_age = x.drive_lost = 0.0
        x.drive_name, x.drive_vote[1] = NONE, 0.0
        return
    x.f_age = x.f_age + 1.0 if whole else 0.0
    if x.hot_f > 0.5 and x.drive_name == NONE and int(x.f_age) % shapes.EVERY == 0:
        own, magnets = gains.doubt(x)
        shapes.weigh(x, p, own, min(0.06, magnets))
