"""What did the drive do? The current against its demand, and whether the motor has felt the difference.

f is the measured current less that of the model, w the motor's rate, d the current that the model has at rest (it
droops by K_B w / R_loop), in means of EVEN_S; c = f + d is what the drive was told in fact. The current loop settles in
0.3 ms and no load enters, so that a fault of the drive is in f whole and at once. What is left of f or c since the
fault began says which it is:

| hypothesis | model | name |
|---|---|---|
| oscillation added | f = a cos + b sin | OFC_LIQUID |
| oscillation in place | c = a cos + b sin | OFC_SOLID |
| stuck at a current | c = const, large | RUNAWAY |
| less than demanded | f = -t d | EFFECTIVENESS |
| weaker magnets | f = t w: the voltage that the motor makes is missing | EFFECTIVENESS |
| a warm or broken winding | f = -t d, small | AMBIGUOUS: the current sensor's scale may be off as little |

A difference that the motor has not felt is the current sensor's. `felt` compares the innovations of the velocity with
those that f would have caused, were it real: e+ = (1 - K4) e + impulse f + share of the load, by the filter's own gain.
A name is given when one hypothesis leaves what noise leaves and the others several times as much.

Amplifier, winding and magnets of a healthy drive are a few per cent off their nominal values, the first two by as much
as a warm winding is. What a drive has in its first LEARN seconds is taken for its own, the gain up to TOLERANCE, the
voltage of its rate up to OFF_B where it has moved enough; what changes later is a fault.
"""

import math

from actuators.block import kernel
from fdi.common.decision import confirm
from fdi.common.sinusoid import products
from fdi.common.verdict import EFFECTIVENESS, NONE, OFC_LIQUID, OFC_SOLID, RUNAWAY

RING = 100  # samples of each ring
EVEN_S, SLOW = 0.02, 10  # a sample of the fast ring [s]; of the slow one [samples of the fast]
NO_CURRENT = 2.5  # of the largest: what a drive and a biased sensor together do not read
BLIND = 2.5  # threshold of f without the velocity sensor, over that with it
TAU_POWER, SPIKE = 0.1, 0.8  # lag of the power of f [s]; share of its threshold that one sample may fill
LOW_HZ, HIGH_HZ, RATIO = 0.09, 11.0, 1.18  # frequencies of an oscillation [Hz]
PERIODS = 1.0  # that a window must hold
LEAST = 8  # samples before a name
PURE, CLEAR = 0.04, 5.0  # share that a hypothesis leaves where it explains; the next leaves so many times as much
FIRM = 6.0  # an energy of so many times the noise's own is enough for a name
NEAR = 0.93  # of the voltage limit: from there on 5 % of K_B is worth more than the stall current
LOSS_SAMPLES = 30  # before a loss is told from what is slow
JUMP, STAYS = 3.0, 8.0  # samples after which a jump of c is seen, and has stayed
EVEN, SWING = 0.15, 0.4  # share by which it may change from one to the next, and while it stays
WEAK = -2.0  # weaker magnets, beside the class codes: what the motor feels says nothing then
VOTES = 3.0  # evaluations in a row that must agree
STUCK = 0.3  # of the largest current: less is a loss of the drive
LOSS_LEAST = 0.1  # less of a loss is a gain error
SENSOR = -1.0  # the current sensor, beside the class codes
ALPHA, BETA = 0.2, 0.02  # position in the place of a lost velocity: corrections of angle and rate
TAU_MOST, TAU_NOW = 60.0, 0.6  # longest and shortest memory of the gains [s]
KNOWN_A, KNOWN_B = 0.0015, 0.02  # deviations of gain and magnets: what is told so well of both is forgotten
KNOWN_NOW = 0.0045  # deviation of the gain when it is asked whether it stands or has healed: under half of `th_a`
STANDS = 0.7  # of a gain's threshold: keeps the alarm
RELEASE = 0.5  # [s]: what shows it has a memory of its own
HEALED, HEALED_B = 2.0, 2.5  # of that: a gain, magnets that surely are less have healed
# by how much the gain of the current may be less, and more, than nominal before it is learned. Two numbers of 5 % over
# two of 5 %: .82 to 1.22. No fault of a drive makes its current larger, so there twice the tolerances are allowed: 1.49
TOLERANCE = (0.2, 0.5)
LEARN = (2.0, 4.0, 10.0)  # times at which what the gain is off becomes the drive's own [s]
# of what a gain is off half is expected in zero and pole of the amplifier, and missed as far as the demand was fast
# when it was learned: a fifth of its power, about, in still air
LAG = 0.1
SURE, SURE_B = 0.01, 0.03  # deviations of gain and magnets with which they can be learned
# of the current that the rate takes away, as b: K_B over K_ic, .90 to 1.11, twice that where it takes more (b is
# negative), which weaker magnets do not; and .04 that the amplifier's lag makes of it
OFF_B = (0.27, 0.15)
MAGNETS = 0.05  # deviation of healthy ones

PARAMS = [
    ("even", "f8", "-"),  # ticks of a sample
    ("sigma_f", "f8", "A"),  # noise of a sample of f: the sensor's 0.1 A over four ticks, and the demand's own
    ("th_f", "f8", "A"),  # rms of f, fixed part
    ("rho_f", "f8", "A s/rad"),  # and of the rate
    ("t_f", "f8", "s"),  # confirmation
    ("phi_load", "f8", "rad/s/N m"),  # rate from the load state over a tick
    ("leak", "f8", "-"),  # of the load state over a tick
    ("felt_least", "f8", "-"),  # share of f that the motor must have felt: a drive's is 1, a sensor's 0
    ("felt_most", "f8", "-"),  # and may have, where it is the sensor's
    ("b_motor", "f8", "A s/rad"),  # current per rate that weaker magnets would cause, all lost
    # sizes from which a gain is a fault; how often a healthy one alarms is z_gain's
    ("th_a", "f8", "-"),  # gain error of the current: a winding 39 % up, 100 K warm, takes .0095, one 80 % up .0195
    ("th_b", "f8", "-"),  # share of the magnets: beyond two tolerances of 5 %
    ("z_gain", "f8", "-"),  # by so many deviations beyond it, by `cosim train ema`
]
STATE = [
    ("f_now", "f8", "A"),  # measured current less the model's
    ("f_lag", "f8", "A"),  # lagged
    ("slot_f", "f8", "A"),  # sum of a slot, and its ticks
    ("slot_n", "f8", "-"),
    ("f_power", "f8", "A2"),  # its square, lagged
    ("w_power", "f8", "rad2/s2"),
    ("r_f", "f8", "-"),  # over its threshold
    ("f_timer", "f8", "s"),
    ("hot_f", "f8", "-"),  # confirmed
    ("f_age", "f8", "-"),  # samples since it began, 0 while there is nothing
    ("even_sum", "f8", (3,)),  # f, d, w
    ("even_ticks", "f8", "-"),
    ("even_lost", "f8", "-"),  # ticks of the sample that say nothing
    ("even_head", "f8", "-"),
    ("even_ring", "f8", (3, RING)),
    ("slow_sum", "f8", (3,)),
    ("slow_count", "f8", "-"),
    ("slow_head", "f8", "-"),
    ("slow_ring", "f8", (3, RING)),
    ("twin", "f8", (2,)),  # error of rate [rad/s] and load [N m] that f would have caused
    ("felt_num", "f8"),
    ("felt_den", "f8"),
    ("felt", "f8", "-"),  # share of f that the motor has felt
    ("gain_sum", "f8", (6,)),  # ff, fd, fw, dd, dw, ww, as long as it takes to know
    ("gain_now", "f8", (6,)),  # over TAU_NOW
    ("gain_own", "f8", "-"),  # of this drive, less one
    ("gain_doubt", "f8", "-"),  # deviation with which it was learned
    ("gain_learned", "f8", "-"),  # times
    ("magnets_own", "f8", "-"),  # voltage per rate of this drive, less one
    ("magnets_doubt", "f8", "-"),
    ("magnets_learned", "f8", "-"),  # 1 where it is
    ("off_power", "f8", "A2"),  # of what the gain may be off by, lagged as f_power
    ("gain_a", "f8", "-"),  # f = a d + b w
    ("gain_b", "f8", "-"),  # b over b_motor
    ("r_gain", "f8", "-"),  # the larger over its threshold
    ("gain_timer", "f8", "s"),
    ("hot_gain", "f8", "-"),  # 1 while a gain is off
    ("weak", "f8", "-"),  # 1 where it is the magnets'
    ("drive_name", "f8", "-"),  # class of the hypothesis that explains, SENSOR, or NONE
    ("drive_vote", "f8", "-"),  # class that explains now
    ("drive_votes", "f8", "-"),  # evaluations in a row that it has
    ("drive_hz", "f8", "Hz"),  # frequency of the oscillation
    ("left", "f8", (6,), "-"),  # what each leaves over what there is: added, in place, stuck, loss, bias, magnets
    ("jumped", "f8", "A"),  # what the current jumped to and stays at, 0 where it did not
]


@kernel
def demanded(u, w, own, magnets, p):
    """Return (current that this drive makes of the demand `u` [A] at the rate `w` [rad/s], and would at rest, near its
    voltage); its gain is off by the share `own`, its magnets by `magnets`, its limits are not.
    """
    back = (1.0 + magnets) * p.K_B * w
    i = min(max(((1.0 + own) * p.K_gi * u - back) / p.R_loop, -p.I_max), p.I_max)
    return i, i + back / p.R_loop, math.fabs(p.R * i + back) > NEAR * p.V_max


@kernel
def sample(x, slow, s, i):
    """Return signal `s` (0 f, 1 d, 2 w) of sample `i` of a ring."""
    return x.slow_ring[s, i] if slow else x.even_ring[s, i]


@kernel
def sine(x, slow, n, hz):
    """Return what a sine of `hz` leaves of f f, f d and d d over the last `n` samples."""
    h = EVEN_S * SLOW if slow else EVEN_S
    ring = x.slow_ring if slow else x.even_ring
    first = int(x.slow_head if slow else x.even_head) - n
    first = first + RING if first < 0 else first
    _, _, ff, fd, dd, fc, fs, dc, ds, cc, cs, ss = products(ring[0], ring[1], first, n, 6.283185307179586 * hz * h, 0.0)
    det = cc * ss - cs * cs
    if det <= 1e-9 * n * n:
        return ff, fd, dd
    f_c, f_s = (fc * ss - fs * cs) / det, (fs * cc - fc * cs) / det
    d_c, d_s = (dc * ss - ds * cs) / det, (ds * cc - dc * cs) / det
    return ff - f_c * fc - f_s * fs, fd - f_c * dc - f_s * ds, dd - d_c * dc - d_s * ds


@kernel
def apart(ff, fd, dd, most):
    """Return the least energy of f - g d over gains g, -most[0] to most[1], that a healthy drive may be off by."""
    g = min(max(fd / dd, -most[0]), most[1]) if dd > 1e-12 else 0.0
    return max(ff - 2.0 * g * fd + g * g * dd, 0.0)


@kernel
def sine_leaves(x, slow, n, hz, instead, most):
    """Return the energy that a sine leaves: `instead` of f + d, else of f - g d."""
    ff, fd, dd = sine(x, slow, n, hz)
    return max(ff + 2.0 * fd + dd, 0.0) if instead else apart(ff, fd, dd, most)


@kernel
def best_sine(x, slow, n, instead, most):
    """Return (least energy that a sine leaves over the last `n` samples, its frequency [Hz]), see `sine_leaves`."""
    h = EVEN_S * SLOW if slow else EVEN_S
    least, at = 1e300, 0.0
    hz = max(0.5 / (n * h), LOW_HZ)
    top = min(HIGH_HZ, 0.4 / h)
    while hz <= top:
        e = sine_leaves(x, slow, n, hz, instead, most)
        if e < least:
            least, at = e, hz
        hz *= RATIO
    step = 0.5 * (RATIO - 1.0)
    for _ in range(5):  # halve the step about the best
        for side in range(2):
            hz = at * (1.0 + step) if side == 0 else at * (1.0 - step)
            e = sine_leaves(x, slow, n, hz, instead, most)
            if e < least:
                least, at = e, hz
                break
        step *= 0.5
    return least, at


@kernel
def explain(x, p, slow, measured):
    """Weigh the hypotheses over the samples since f began, of one ring; write `drive_name` where one is sure; magnets
    are weaker only where the rate is `measured`.
    """
    n = min(int(x.f_age / SLOW) if slow else int(x.f_age), RING)
    i = int(x.slow_head if slow else x.even_head) - n
    i = i + RING if i < 0 else i
    ff, fd, dd, f1, d1, ww, fw, dw = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(n):
        f, d, w = sample(x, slow, 0, i), sample(x, slow, 1, i), sample(x, slow, 2, i)
        ff += f * f
        fd += f * d
        dd += d * d
        f1 += f
        d1 += d
        ww += w * w
        fw += f * w
        dw += d * w
        i = 0 if i == RING - 1 else i + 1
    wide = p.sigma_f / math.sqrt(SLOW) if slow else p.sigma_f
    tolerance = min(0.06, doubt_b(x)[0]) * p.b_motor
    own = doubt(x)
    noise_c = n * wide * wide + tolerance * tolerance * ww
    noise = noise_c + 4e-6 * dd
    if apart(ff, fd, dd, own) < FIRM * noise:
        return
    c1, cc = f1 + d1, ff + 2.0 * fd + dd
    added, hz_added = best_sine(x, slow, n, False, own)
    instead, hz_instead = best_sine(x, slow, n, True, own)
    stuck = max(cc - c1 * c1 / n, 0.0)
    bias = apart(ff - f1 * f1 / n, fd - f1 * d1 / n, dd - d1 * d1 / n, own)
    t = -fd / dd if dd > 0.0 else 0.0
    loss = max(ff - t * t * dd, 0.0) if t > max(LOSS_LEAST, own[0]) else ff
    weak = apart(ff - fw * fw / ww, fd - fw * dw / ww, dd - dw * dw / ww, own) if fw > 0.0 else ff
    x.left[0], x.left[1], x.left[2], x.left[3], x.left[4] = added / ff, instead / ff, stuck / ff, loss / ff, bias / ff
    x.left[5] = weak / ff
    least, which = 1e300, -1
    for k in range(6):
        if x.left[k] * ff < least:
            least, which = x.left[k] * ff, k
    clear = True  # the others leave several times as much, and of what the drive was told more than its noise
    for k in range(6):
        clear = clear and (k == which or x.left[k] * ff >= CLEAR * max(least, noise_c if k == 1 or k == 2 else noise))
    told = which == 1 or which == 2
    pure = least <= PURE * (cc if told else ff) + 2.0 * (noise_c if told else noise)
    said = NONE
    if pure and clear:
        hz = hz_added if which == 0 else hz_instead
        if which < 2 and hz * n * (EVEN_S * SLOW if slow else EVEN_S) >= PERIODS:
            said, x.drive_hz = OFC_LIQUID if which == 0 else OFC_SOLID, hz
        elif which == 2 and math.fabs(c1) > STUCK * p.I_max * n:
            said = RUNAWAY
        elif (which == 3 or which == 2) and x.f_age >= LOSS_SAMPLES:
            said = EFFECTIVENESS
        elif which == 5 and measured:
            said = WEAK
    elif cc <= 2.0 * noise_c and x.f_age >= LOSS_SAMPLES and min(added, min(bias, weak)) >= CLEAR * noise:
        said = EFFECTIVENESS  # nothing at all arrives
    x.drive_votes = x.drive_votes + 1.0 if said != NONE and said == x.drive_vote else 1.0
    x.drive_vote = said
    if said != NONE and x.drive_votes >= VOTES:
        x.drive_name = said
        if said == WEAK:  # stays until motion tells otherwise: at rest magnets are neither weak nor healed
            x.hot_gain = x.weak = 1.0
            x.gain_timer = RELEASE
            for k in range(6):
                x.gain_now[k] = 0.0


@kernel
def doubt(x):
    """Return by how much the gain of this drive's current may be less, and more, than it is taken for.

    What is learned of fast demands misses a share of what the amplifier makes of slow ones: that of LAG.
    """
    off = 2.0 * x.gain_doubt + LAG * math.fabs(x.gain_own) + 1e-3
    return TOLERANCE if x.gain_learned < 0.5 else (off, off)


@kernel
def doubt_b(x):
    """Return by how much the share `b` of this drive may be less, and more, than it is taken for."""
    off = 2.0 * x.magnets_doubt + 5e-3
    return OFF_B if x.magnets_learned < 0.5 else (off, off)


@kernel
def outside(v, most):
    """Return by how much `v` is beyond -most[0] to most[1], negative inside."""
    return max(-v - most[0], v - most[1])


@kernel
def learn(x, a, da, p):
    """Take what the gain is off, `a` with deviation `da`, for the drive's own at the times of LEARN; the voltage of its
    magnets, too, where it has moved enough.
    """
    k = int(x.gain_learned)
    if k >= 3 or x.age < LEARN[k] or da > SURE or outside(x.gain_own + a * (1.0 + x.gain_own), TOLERANCE) > 0.0:
        return
    both, b, d_both, db = solve(x.gain_sum, p.sigma_f, 0.0)
    b, db = b / p.b_motor, db / p.b_motor
    known = db <= SURE_B and outside(b - x.magnets_own, OFF_B) <= 0.0
    if known and outside(x.gain_own + both * (1.0 + x.gain_own), TOLERANCE) <= 0.0:
        a, da = both, d_both
        x.magnets_own -= b
        x.magnets_doubt = db
        x.magnets_learned = 1.0
    else:
        b = 0.0
    x.gain_own += a * (1.0 + x.gain_own)
    x.gain_doubt = da
    x.gain_learned += 1.0
    b *= p.b_motor
    for s in (x.gain_sum, x.gain_now):  # f - a d - b w, (1 + a) d
        s[0] += a * a * s[3] + b * b * s[5] - 2.0 * (a * s[1] + b * s[2] - a * b * s[4])
        s[1] = (1.0 + a) * (s[1] - a * s[3] - b * s[4])
        s[2] -= a * s[4] + b * s[5]
        s[3] *= (1.0 + a) * (1.0 + a)
        s[4] *= 1.0 + a


@kernel
def solve(s, noise, sure):
    """Return (a, b, deviation of a, of b) of f = a d + b w from sums `s` with noise of deviation `noise`; `sure` is
    what is known beforehand of b, that it is small: (noise over its deviation)^2.
    """
    ww = s[5] + sure
    det = s[3] * ww - s[4] * s[4]
    if det <= 1e-6 * s[3] * ww or det <= 0.0:
        return 0.0, 0.0, 1e3, 1e3
    a, b = (s[1] * ww - s[2] * s[4]) / det, (s[2] * s[3] - s[1] * s[4]) / det
    return a, b, noise * math.sqrt(ww / det), noise * math.sqrt(s[3] / det)


@kernel
def gain_and_magnets(s, p):
    """Return (a, b, deviation of a, of b), b over b_motor: healthy magnets are off by MAGNETS, which tells of a."""
    sure = p.sigma_f / (MAGNETS * p.b_motor)
    a, _, da, _ = solve(s, p.sigma_f, sure * sure)
    _, b, _, db = solve(s, p.sigma_f, 0.0)
    return a, b / p.b_motor, da, db / p.b_motor


@kernel
def gains(x, p, f, d, w, dt):
    """Take a sample into the gains of current and magnets, and test them."""
    h, ka, kb = p.even * dt, KNOWN_A * d / p.sigma_f, KNOWN_B * p.b_motor * w / p.sigma_f
    for k in range(2):
        # forgets by what the sample tells, so that a drive at work is judged at once, one at rest at all
        told = min(ka * ka, kb * kb)
        if k == 1:  # magnets at rest are neither weak nor healed
            told = 1.0 if x.weak > 0.5 else (KNOWN_NOW * d / p.sigma_f) * (KNOWN_NOW * d / p.sigma_f)
        keep = 1.0 - min(max(told, h / TAU_MOST), h / TAU_NOW)
        if k == 0 and x.age < LEARN[2]:
            keep = 1.0  # all there is to learn from
        s = x.gain_sum if k == 0 else x.gain_now
        s[0] = keep * s[0] + f * f
        s[1] = keep * s[1] + f * d
        s[2] = keep * s[2] + f * w
        s[3] = keep * s[3] + d * d
        s[4] = keep * s[4] + d * w
        s[5] = keep * s[5] + w * w
    a, x.gain_b, da, db = gain_and_magnets(x.gain_sum, p)
    x.gain_a = a
    over_a = math.fabs(a) if x.gain_learned > 0.5 else outside(a, TOLERANCE)
    over_a -= p.z_gain * math.sqrt(da * da + x.gain_doubt * x.gain_doubt)
    over_b = math.fabs(x.gain_b) if x.magnets_learned > 0.5 else outside(x.gain_b, OFF_B)
    over_b -= p.z_gain * math.sqrt(db * db + x.magnets_doubt * x.magnets_doubt)
    x.r_gain = max(over_a / p.th_a, over_b / p.th_b)
    sure = True
    if x.hot_gain > 0.5:  # `gain_now` tells whether it stands or has healed; where nothing moves, neither
        a, b, da, db = gain_and_magnets(x.gain_now, p)
        size, off, least, most = math.fabs(a), 2.0 * da, STANDS * p.th_a, HEALED * STANDS * p.th_a
        if x.weak > 0.5:
            size, off, least, most = math.fabs(b), 2.0 * db, STANDS * p.th_b, HEALED_B * STANDS * p.th_b
        shows = size - off > least
        sure = shows or size + off < most
    else:
        if x.r_gain < 1.0:
            learn(x, a, da, p)
        shows = x.r_gain >= 1.0
        if shows:
            x.weak = 1.0 if over_b / p.th_b > over_a / p.th_a else 0.0
    before = x.hot_gain
    if sure:
        x.gain_timer, x.hot_gain = confirm(x.gain_timer, x.hot_gain, shows, p.even * dt, 0.2, RELEASE)
    if before > 0.5 and x.hot_gain < 0.5:  # healed: what came before is of the fault
        for k in range(6):
            x.gain_sum[k] = x.gain_now[k]


@kernel
def begin(x):
    """Start anew: nothing is wrong with the drive."""
    x.f_age = 0.0
    x.drive_name = x.drive_vote = NONE
    x.drive_hz = x.drive_votes = x.jumped = 0.0
    for k in range(6):
        x.left[k] = 1.0


@kernel
def watch(x, y, current, u, w, measured, gamma, p, dt):
    """Take a tick: current `y` [A] where it is usable, demand `u` [A], rate `w`, which may be believed
    where it is `measured`, and its innovation `gamma` [rad/s].
    """
    d, rest, limit = demanded(u, w, x.gain_own, x.magnets_own, p)
    seen = current and not limit and math.fabs(y) < NO_CURRENT * p.I_max
    f = y - d if seen else 0.0
    x.f_now = f
    x.f_lag += min(dt / 0.03, 1.0) * (f - x.f_lag)
    if seen:
        x.slot_f += f
        x.slot_n += 1.0
    if x.count == 0.0 and x.slot_n > 0.0:  # of a slot, so that noise weighs the same at every rate
        h, g = p.n_sub * dt, x.slot_f / x.slot_n
        x.slot_f = x.slot_n = 0.0
        off = doubt(x)[1 if g * rest > 0.0 else 0] * math.fabs(rest)
        off += doubt_b(x)[1 if g * w > 0.0 else 0] * p.b_motor * math.fabs(w)
        x.off_power += h / TAU_POWER * (off * off - x.off_power)
        fixed = p.th_f + p.rho_f * math.sqrt(x.w_power) + math.sqrt(x.off_power)
        least = fixed * (1.0 if x.age_vel <= p.t_bad else BLIND)
        most = SPIKE * least * least * TAU_POWER / h  # one sample alone is no fault
        x.f_power += h / TAU_POWER * (min(g * g, most) - x.f_power)
        x.w_power += h / TAU_POWER * (w * w - x.w_power)
        x.r_f = math.sqrt(x.f_power) / least
    beyond = seen and x.r_f >= 1.0 and x.age >= p.t_start
    x.f_timer, x.hot_f = confirm(x.f_timer, x.hot_f, beyond, dt, p.t_f, p.t_release)
    if not seen:
        x.even_lost += 1.0
    # what the innovation would be, were f real
    load = x.twin[1] - p.K[5] * x.twin[0]
    x.twin[0] = (1.0 - p.K[3]) * x.twin[0] + p.impulse * f + p.phi_load * load
    x.twin[1] = p.leak * load
    if x.f_timer <= 0.0:  # what came shortly before an alarm is of its onset
        x.felt_num -= min(dt / TAU_POWER, 1.0) * x.felt_num
        x.felt_den -= min(dt / TAU_POWER, 1.0) * x.felt_den
    if current:
        x.felt_num += gamma * x.twin[0]
        x.felt_den += x.twin[0] * x.twin[0]
        x.felt = x.felt_num / max(x.felt_den, 1e-9)
    x.even_sum[0] += f
    x.even_sum[1] += rest
    x.even_sum[2] += w
    x.even_ticks += 1.0
    if x.even_ticks < p.even:
        return
    head = int(x.even_head)
    for s in range(3):
        x.even_ring[s, head] = x.even_sum[s] / p.even
        x.slow_sum[s] += x.even_sum[s] / p.even
        x.even_sum[s] = 0.0
    x.even_head = 0.0 if head == RING - 1 else head + 1.0
    x.even_ticks = 0.0
    x.slow_count += 1.0
    if x.slow_count >= SLOW:
        slow = int(x.slow_head)
        for s in range(3):
            x.slow_ring[s, slow] = x.slow_sum[s] / SLOW
            x.slow_sum[s] = 0.0
        x.slow_head = 0.0 if slow == RING - 1 else slow + 1.0
        x.slow_count = 0.0
    whole = x.even_lost < 0.5
    x.even_lost = 0.0
    f, d, w = x.even_ring[0, head], x.even_ring[1, head], x.even_ring[2, head]
    usual = p.th_f + (p.rho_f + doubt_b(x)[0] * p.b_motor) * math.fabs(w) + doubt(x)[0] * math.fabs(d)
    known = x.hot_gain > 0.5 and x.weak > 0.5
    best = min(min(x.left[0], x.left[1]), min(x.left[2], min(x.left[3], x.left[4])))
    magnets = x.f_age > RING and x.left[5] < 0.5 * best  # what explains best is told by more than one window
    plain = x.f_timer <= 0.0 or known or magnets
    if whole and measured and plain and math.fabs(f) < 3.0 * usual:
        gains(x, p, f, d, w, dt)
    if x.hot_f < 0.5 and x.f_timer <= 0.0:
        if x.f_age > 0.0:
            begin(x)
        return
    x.f_age += 1.0
    c = f + d
    large = STUCK * p.I_max
    before = RING - 1 if head == 0 else head - 1
    change = c - x.even_ring[0, before] - x.even_ring[1, before]
    if x.f_age == JUMP and min(f * c, min(c * c, f * f)) >= large * large and math.fabs(change) < EVEN * math.fabs(c):
        x.jumped = c
    elif whole and math.fabs(c - x.jumped) > SWING * math.fabs(x.jumped):  # what the voltage limits says nothing
        x.jumped = 0.0
    if x.f_age >= STAYS and x.jumped != 0.0 and x.drive_name == NONE:
        x.drive_name = RUNAWAY
    if x.hot_f > 0.5 and x.f_age >= LEAST and x.drive_name == NONE and int(x.f_age) % 2 == 0:
        explain(x, p, False, measured)
        if x.drive_name == NONE and x.f_age > RING and x.slow_count == 0.0:
            explain(x, p, True, measured)
