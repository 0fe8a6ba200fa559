"""Shared decision stage: small kernels that turn residuals into alarms.

The kernels with records read the fields that this module lists in `*_PARAMS` and `*_STATE`; a detector appends those
lists to its own PARAMS and STATE.

Who answers for what: a sensor is rod against surface; a jam is load beyond the hinge-moment model
with the surface still; a runaway is an input fault that moves the surface; an oscillation is what keeps its phase
over two periods. Rod against surface is tested first, because a step of the rod sensor also rings the input-fault
estimate.
"""

import math

from actuators.block import kernel
from actuators.common.limits import within as clipped

T_DISTURBED = 0.6  # [s] after the blame, or for as long as there is none, the input-fault estimate rings
LOAD_LEAST = 0.03  # a load of less than this has no side [1]
PLAY = 2.6e-3  # rod motion within which a loose surface moves [m]
T_LOOSE = 0.12  # after the alarm, when the disagreement has come to rest, it is asked which way it went [s]
T_HOLD = 5.0  # [s] an alarm outlives its estimate by: settling, 1 s, and two periods at 0.5 Hz, the slowest of a bank

FOREIGN = 3.5  # sigma beyond which a sample teaches nothing of the lever
GAIN_LIMIT = 0.15  # +-5 % on flow and on piston area, and some more
GAIN_MOTION = 0.002  # rod motion from which the gain is learned in earnest: 20 sigma of the sensor [m]

PAIR_PARAMS = [
    ("pair_tau", "f8", "s"),  # lag of the disagreement
    ("pair_clip", "f8", "m"),  # one sample counts for no more than this, so that a spike does not alarm
    ("pair_settle", "f8", "s"),  # time to learn the rigging before the test begins
    ("pair_learn", "f8", "s"),  # lag of the rigging afterwards
    ("pair_wash", "f8", "s"),  # memory of each sensor's distance from the model
    ("pair_threshold", "f8", "m"),  # disagreement
    ("pair_confirm", "f8", "s"),
    ("pair_release", "f8", "s"),
    ("pair_teach", "f8", "1/s"),  # rate at which the model's gain is learned in motion
    ("pair_judge", "f8", "s"),  # the model is trusted for this long after the alarm
    ("pair_ratio", "f8", "-"),  # the sensor that is blamed is this many times further from the model than the other
]
PAIR_STATE = [
    ("pair_time", "f8", "s"),  # usable time so far
    ("rigging", "f8", "m"),  # learned rod - arm surface
    ("pair_d", "f8", "m"),  # filtered disagreement
    ("pair_limit", "f8", "m"),  # what it may be
    ("model_q", "f8", "m"),  # integral of the model's rod velocity
    ("model_slow", "f8", "m"),  # the same, lagged
    ("model_bias", "f8", "m/s"),  # learned error of the model's rod velocity
    ("model_gain", "f8", "-"),  # learned error of its gain
    ("base_rod", "f8", "m"),  # slow rod - model
    ("base_surface", "f8", "m"),  # slow surface - model
    ("e_rod", "f8", "m"),  # filtered distance of the rod sensor from the model
    ("e_surface", "f8", "m"),  # of the surface sensor
    ("pair_timer", "f8", "s"),
    ("pair_age", "f8", "s"),  # time since the alarm
    ("sensor", "f8", "-"),  # 1 while the two are declared to disagree
    ("blame", "f8", "-"),  # 0 unknown, 1 rod, 2 surface
    ("backlash_suspected", "f8", "-"),  # 1 where the surface may be loose rather than its sensor wrong
    ("t_settling", "f8", "s"),  # time for which the input-fault estimate is still disturbed by it
]
RIGGING_SD, LEVER_SD, LAG_SD = 5e-3, 6e-3, 1.0  # of rigging [m], of the length of a machined lever [1], of a tick [1]
RIGGING_WALK, LEVER_WALK = 2.6e-13, 1e-12  # random walks of the first two [m^2/s], [1/s]
STEP_ERROR = 0.3  # share by which a prediction errs of what the rod moves in a tick while it accelerates
LEVER_KNOWN = 2.5  # standard deviations that what is not known of the lever may put the two sensors apart by
LEVER_STATE = [
    ("lever_offset", "f8", "m"),  # learned rod - arm surface at the rod's zero
    ("lever", "f8", "-"),  # learned error of the lever's length
    ("lever_lag", "f8", "-"),  # ticks by which the surface sensor's samples are older than the rod's
    ("lever_P", "f8", (6,), "m^2, m, 1, m, 1, 1"),  # covariance of the three: 00, 01, 11, 02, 12, 22
]


@kernel
def held(value, valid, last):
    """Return the measurement, or the last one when it is flagged invalid or not finite."""
    return value if usable(value, valid) > 0.5 else last


@kernel
def delayed(line, head, column, value, ticks, fresh):
    """Put `value` into the ring line[:, column] at `head` and return what was put there `ticks` before.

    One that is not finite repeats the last; a `fresh` ring is filled with it. `ticks` is less than the ring's length.
    """
    n = line.shape[0]
    if not math.isfinite(value):
        value = line[(head + n - 1) % n, column]
    if fresh:
        line[:, column] = value
    line[head, column] = value
    return line[(head + n - int(ticks)) % n, column]


@kernel
def shift(past, now):
    """Put `now` first into `past` (n,), newest first; the oldest is dropped."""
    for i in range(past.size - 1, 0, -1):
        past[i] = past[i - 1]
    past[0] = now


@kernel
def usable(value, valid):
    """Return 1.0 where a measurement is flagged valid and finite, else 0.0."""
    return 1.0 if valid > 0.5 and math.isfinite(value) else 0.0


@kernel
def confirm(timer, alarm, beyond, dt, t_confirm, t_release):
    """Return (timer, alarm) after one tick of a threshold test with confirmation and release.

    `timer` [s] grows while the residual is beyond its threshold, else shrinks, within 0 .. t_confirm + t_release.
    The alarm sets when it reaches t_confirm, and heals when it is back at zero: crossing now and then does not chatter.
    """
    longest = t_confirm + t_release
    timer = min(timer + dt, longest) if beyond else max(timer - dt, 0.0)
    # half a tick of slack: sums of dt are not exact
    if beyond and timer >= t_confirm - 0.5 * dt:
        return longest if alarm < 0.5 else timer, 1.0
    return timer, 0.0 if timer < 0.5 * dt else alarm


@kernel
def forget_lever(x):
    """Take back what is known of rigging, lever and lag."""
    x.lever_offset = x.lever = x.lever_lag = x.lever_P[1] = x.lever_P[3] = x.lever_P[4] = 0.0
    x.lever_P[0], x.lever_P[2], x.lever_P[5] = RIGGING_SD * RIGGING_SD, LEVER_SD * LEVER_SD, LAG_SD * LAG_SD


@kernel
def lever_gain(x, q, step):
    """Return the products of the covariance with (1, `q`, `step`)."""
    P = x.lever_P
    return P[0] + q * P[1] + step * P[3], P[1] + q * P[2] + step * P[4], P[3] + q * P[4] + step * P[5]


@kernel
def lever_variance(x, q, step):
    """Return the variance of `lever_at` [m^2]."""
    a, b, c = lever_gain(x, q, step)
    return max(a + q * b + step * c, 0.0)


@kernel
def lever_at(x, q, step):
    """Return how far rigging, lever and lag put rod and surface apart at the rod position `q` [m], while the rod moves
    by `step` [m] in a tick."""
    return x.lever_offset + q * x.lever + step * x.lever_lag


@kernel
def lever_slack(x, q, step):
    """Return how far they may put them apart beyond that [m]."""
    return LEVER_KNOWN * math.sqrt(lever_variance(x, q, step))


@kernel
def learn_lever(x, apart, q, step, r, dt):
    """Learn rigging, lever and lag from how far rod and surface are `apart`, with variance `r`: a Kalman filter.

    `q` and `step` are predicted [m]: a reading would carry its noise into the lever, and a `step` that is not large
    beside its own error would take the lag for smaller than it is. `apart` is of the readings [m].
    """
    P = x.lever_P
    if P[2] <= 0.0:
        forget_lever(x)
    a, b, c = lever_gain(x, q, step)
    s = a + q * b + step * c + r + STEP_ERROR * STEP_ERROR * step * step
    e = apart - lever_at(x, q, step)
    if e * e < FOREIGN * FOREIGN * s:  # beyond it is of a fault
        x.lever_offset += a * e / s
        x.lever += b * e / s
        x.lever_lag += c * e / s
        P[0] += RIGGING_WALK * dt - a * a / s
        P[1] -= a * b / s
        P[2] += LEVER_WALK * dt - b * b / s
        P[3] -= a * c / s
        P[4] -= b * c / s
        P[5] -= c * c / s


@kernel
def pair_test(x, y_rod, rod_good, y_surface, surface_good, model_v, load, slack, known, p, dt):
    """Compare two position sensors on one rod, and each with the model's own motion; positions in m of rod.

    `model_v` is a rod velocity that neither of them has touched lately [m/s], `load` the force on the rod over its
    stall force, + extends [1]; `slack` [m] is added to the threshold; where it is `known` the caller keeps the rigging.
    Sets `sensor`, `blame` and `backlash_suspected`: a surface that has moved the way its load drives it, and no further
    than PLAY, may as well have come loose.
    """
    x.model_q += ((1.0 + x.model_gain) * model_v + x.model_bias) * dt
    x.model_slow += dt / p.pair_wash * (x.model_q - x.model_slow)
    x.pair_limit = p.pair_threshold + slack
    suspicious = math.fabs(x.pair_d) > 0.7 * x.pair_limit
    x.t_settling = max(x.t_settling - dt, 0.0)
    if rod_good > 0.5 and surface_good > 0.5:
        _disagreement(x, y_rod, y_surface, suspicious, known, p, dt)
    if x.pair_time > 0.0:
        _distances(x, y_rod, rod_good, y_surface, surface_good, suspicious, p, dt)
    before = x.sensor
    beyond = math.fabs(x.pair_d) >= x.pair_limit
    x.pair_timer, x.sensor = confirm(x.pair_timer, x.sensor, beyond, dt, p.pair_confirm, p.pair_release)
    if beyond and x.sensor > 0.5:  # an oscillation is beyond it for a part of its period only
        x.pair_timer = p.pair_confirm + p.pair_release
    _blame(x, load, suspicious, p, dt)
    if x.sensor < 0.5 and before > 0.5:  # healed: learn anew where both stand
        x.base_rod += x.e_rod
        x.base_surface += x.e_surface
        x.e_rod = x.e_surface = 0.0


@kernel
def _disagreement(x, y_rod, y_surface, suspicious, known, p, dt):
    """Learn the rigging for pair_settle, then advance the filtered disagreement."""
    d = y_rod - y_surface - x.rigging
    if x.pair_time < p.pair_settle:
        x.pair_time += dt
        if not known:
            x.rigging += d * dt / x.pair_time
        if x.pair_time <= 1.5 * dt:
            x.base_rod = y_rod - x.model_q
            x.base_surface = y_surface - x.model_q
    else:
        x.pair_d += (1.0 - math.exp(-dt / p.pair_tau)) * clipped(d - x.pair_d, p.pair_clip)
        if not suspicious and not known:
            x.rigging += clipped(x.pair_d, p.pair_clip) * dt / p.pair_learn


@kernel
def _distances(x, y_rod, rod_good, y_surface, surface_good, suspicious, p, dt):
    """Advance how far each sensor is from the model, and what the model learns of its bias and gain."""
    a, w = 1.0 - math.exp(-dt / p.pair_tau), dt / p.pair_wash
    if rod_good > 0.5:
        e = y_rod - x.model_q - x.base_rod
        x.e_rod += a * clipped(e - x.e_rod, p.pair_clip)
        if not suspicious:
            x.base_rod += w * x.e_rod
    if surface_good > 0.5:
        e = y_surface - x.model_q - x.base_surface
        x.e_surface += a * clipped(e - x.e_surface, p.pair_clip)
        if not suspicious:
            x.base_surface += w * x.e_surface
            e = 0.5 * (x.e_rod + x.e_surface)
            x.model_bias += e * w / (3.0 * p.pair_wash)  # slow enough to be well damped
            moved = x.model_q - x.model_slow
            lesson = p.pair_teach * dt * e * moved / (moved * moved + GAIN_MOTION * GAIN_MOTION)
            x.model_gain = clipped(x.model_gain + lesson, GAIN_LIMIT)


@kernel
def _blame(x, load, suspicious, p, dt):
    """Set which sensor has left the model, and whether the surface may be loose instead."""
    x.pair_age = x.pair_age + dt if x.sensor > 0.5 else 0.0
    if x.sensor < 0.5:
        x.blame = 0.0
        x.t_settling = max(x.t_settling, 3.0 * p.pair_confirm if suspicious else 0.0)
    elif x.blame < 0.5:
        x.t_settling = T_DISTURBED
        if x.pair_age <= p.pair_judge:
            far, near = math.fabs(x.e_rod), math.fabs(x.e_surface)
            x.blame = 1.0 if far > p.pair_ratio * near else (2.0 if near > p.pair_ratio * far else 0.0)
    against = T_LOOSE < x.pair_age <= T_LOOSE + 1.5 * dt and math.fabs(load) > LOAD_LEAST and x.pair_d * load > 0.0
    if x.blame != 2.0:
        x.backlash_suspected = 1.0  # until it has been told apart
    elif math.fabs(x.pair_d) >= PLAY or against:
        x.backlash_suspected = 0.0
