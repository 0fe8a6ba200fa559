"""Faults of an EMA's drive: its current against the demand, and whether the motor has followed the difference.

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
| a warm or broken winding | f = -t d, small | EFFECTIVENESS where the motor has felt it, else AMBIGUOUS |
| current sensor | f = a + b t, a sine or a share of d, which the motor has not felt | SENSOR |

The innovations of the velocity (`torque`) tell two shares of f at once, by least squares: `felt`, as a torque, and
`misread`, as a velocity reading that is off by f / b_motor.

| who | felt | misread |
|---|---|---|
| drive | 1 | 0 |
| velocity sensor: the current that the filter expects is off, too | 1 | 1, less what noise is in f |
| current sensor | 0 | 0 |

A demand below friction moves nothing, and the innovations hold its torque in health, too: what that makes is learned
over TAU_KEPT from the demand within what friction keeps, and taken off. Friction keeps a part of what the drive does
from the motor: of K_T f it feels at least

    must = sum |f| max(|f| - T / K_T, 0) / sum f^2,   T the most that a healthy drive rubs,

the gain of a dead zone, 1 - 2 / pi (asin a + a sqrt(1 - a^2)) for a sine with a = T over its amplitude. A name is given
when one hypothesis leaves what noise leaves and the others several times as much.

What gain and magnets this drive has: `gains`.
"""

import math

from actuators.block import kernel
from fdi.common.decision import clipped, confirm
from fdi.common.sinusoid import beside, put
from fdi.common.verdict import EFFECTIVENESS, NONE, OFC_LIQUID, OFC_SOLID, RUNAWAY
from fdi.ema.gains import RELEASE, doubt, doubt_b, gains, tick
from fdi.ema.torque import push, read

RING = 100  # samples of each ring
EVEN_S, SLOW = 0.02, 10  # a sample of the fast ring [s]; of the slow one [samples of the fast]
NO_CURRENT = 2.5  # of the largest: what a drive and a biased sensor together do not read
BLIND = 2.5  # threshold of f without the velocity sensor, over that with it
TAU_POWER, SPIKE = 0.1, 0.8  # lag of the power of f [s]; share of its threshold that one sample may fill
LOW_HZ, HIGH_HZ, RATIO = 0.09, 11.0, 1.18  # frequencies of an oscillation [Hz]
PERIODS = 1.0  # that a window must hold
LEAST = 8  # samples before a name
PURE, CLEAR = 0.04, 5.0  # share that a hypothesis leaves where it explains; the next leaves so many times as much
SINES = 12.0  # energy that the best of many sines takes of noise, over that of a sample: more in one of 2,000
MORE = 4.0 * SINES  # energy over that of a sample's noise by which the next hypothesis leaves more
FIRM = 6.0  # an energy of so many times the noise's own is enough for a name
NEAR = 0.93  # of the voltage limit: from there on 5 % of K_B is worth more than the stall current
LOSS_SAMPLES = 30  # before a loss is told from what is slow
JUMP, STAYS = 3.0, 8.0  # samples after which a jump of c is seen, and has stayed
EVEN, SWING = 0.15, 0.4  # share by which it may change from one to the next, and while it stays
WEAK = -2.0  # weaker magnets, beside the class codes: what the motor feels says nothing then
VOTES = 3.0  # evaluations in a row that must agree
STUCK = 0.3  # of the largest current: less is a loss of the drive
LOSS_LEAST = 0.1  # less of a loss is a gain error
NOTHING = 0.01  # of the demand's power, a tenth of its size: less than that arrives of a free-floating drive
SENSOR = -1.0  # the current sensor, beside the class codes
ALPHA, BETA = 0.2, 0.02  # position in the place of a lost velocity: corrections of angle and rate
TAU_FELT = 0.03  # lag of what the motor feels [s]
HEALTHY = 0.03  # of the stall torque: one and a half times the friction of a healthy drive (actuators.ema.actuator)
SLOWEST, WIDE = 0.4, 1.5  # slowest oscillation that a short window may hold a part of [Hz]; from one to the next
TAU_KEPT = 60.0  # of what friction keeps in health [s]

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
]
STATE = [
    ("f_now", "f8", "A"),  # measured current less the model's
    ("d_now", "f8", "A"),  # the model's
    ("f_lag", "f8", "A"),  # lagged
    ("slot_f", "f8", "A"),  # sum of a slot, and its ticks
    ("slot_n", "f8", "-"),
    ("f_power", "f8", "A2"),  # its square, lagged
    ("w_power", "f8", "rad2/s2"),
    ("r_f", "f8", "-"),  # over its threshold
    ("f_timer", "f8", "s"),
    ("hot_f", "f8", "-"),  # confirmed
    ("f_age", "f8", "-"),  # samples since it began, 0 while there is nothing
    ("even_sum", "f8", (5,)),  # f, d, w, position less surface, surface
    ("even_ticks", "f8", "-"),
    ("even_lost", "f8", "-"),  # ticks of the sample that say nothing
    ("even_whole", "f8", "-"),  # samples since one had such ticks
    ("even_head", "f8", "-"),
    ("even_ring", "f8", (5, RING)),
    ("slow_sum", "f8", (5,)),
    ("slow_count", "f8", "-"),
    ("slow_head", "f8", "-"),
    ("slow_ring", "f8", (5, RING)),
    # signatures of f, of a gain, of a velocity that is off, innovation, signature of what friction may keep
    ("smoothed", "f8", (5,), "rad/s"),
    ("read_num", "f8"),  # the same of a velocity sensor that would be off by f / b_motor
    ("read_den", "f8"),
    ("kept_num", "f8", "rad2/s2"),  # in health: the innovation that a demand makes which friction keeps from the motor
    ("kept_den", "f8", "rad2/s2"),
    ("both_den", "f8"),  # product of that signature and that of f
    ("felt_num", "f8"),
    ("felt_den", "f8"),
    ("felt", "f8", "-"),  # share of f that the motor has felt, as a torque,
    ("misread", "f8", "-"),  # and, beside that, as a velocity that is misread
    ("grain", "f8", "-"),  # share of f that noise makes
    ("gain_num", "f8"),  # the same of a gain that is off
    ("gain_den", "f8"),
    ("off_power", "f8", "A2"),  # of what the gain may be off by, lagged as f_power
    ("drive_name", "f8", "-"),  # class of the hypothesis that explains, SENSOR, or NONE
    ("drive_vote", "f8", (2,), "-"),  # class that explains now: of the fast ring, of the slow one
    ("drive_votes", "f8", (2,), "-"),  # evaluations in a row that it has
    ("drive_hz", "f8", "Hz"),  # frequency of the oscillation
    ("drive_lost", "f8", "-"),  # of the demand: 1 a part does not arrive, 2 nothing arrives
    # what each hypothesis leaves over what there is: added, in place, stuck, loss, bias, magnets, line, scale
    ("residual", "f8", (8,), "-"),
    ("must", "f8", "-"),  # share of f that the motor must feel, were f real
    ("curved", "f8", "-"),  # what the best sine, slow ones too, leaves over what a bias or a line does, over the noise
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
def sine(x, slow, s, n, hz):
    """Return what a sine of `hz` leaves of f f, f d and d d over the last `n` samples; f is signal `s`, d the next."""
    h = EVEN_S * SLOW if slow else EVEN_S
    ring = x.slow_ring if slow else x.even_ring
    first = int(x.slow_head if slow else x.even_head) - n
    first = first + RING if first < 0 else first
    turn = 6.283185307179586 * hz * h
    return beside(ring[s], ring[s + 1], first, n, turn)


@kernel
def apart(ff, fd, dd, most):
    """Return the least energy of f - g d over gains g, -most[0] to most[1], that a healthy drive may be off by."""
    g = min(max(fd / dd, -most[0]), most[1]) if dd > 1e-12 else 0.0
    return max(ff - 2.0 * g * fd + g * g * dd, 0.0)


@kernel
def sine_leaves(x, slow, s, n, hz, instead, most):
    """Return the energy that a sine leaves: `instead` of f + d, else of f - g d."""
    ff, fd, dd = sine(x, slow, s, n, hz)
    return max(ff + 2.0 * fd + dd, 0.0) if instead else apart(ff, fd, dd, most)


@kernel
def best_sine(x, slow, s, n, instead, most):
    """Return (least energy that a sine leaves over the last `n` samples, its frequency [Hz]), see `sine_leaves`."""
    h = EVEN_S * SLOW if slow else EVEN_S
    least, at = 1e300, 0.0
    hz = max(0.5 / (n * h), LOW_HZ)
    top = min(HIGH_HZ, 0.4 / h)
    while hz <= top:
        e = sine_leaves(x, slow, s, n, hz, instead, most)
        if e < least:
            least, at = e, hz
        hz *= RATIO
    step = 0.5 * (RATIO - 1.0)
    for _ in range(9 if slow else 5):  # halve the step about the best; a window of 20 s resolves more than one of 2 s
        for side in range(2):
            hz = at * (1.0 + step) if side == 0 else at * (1.0 - step)
            e = sine_leaves(x, slow, s, n, hz, instead, most)
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
    n = min(int(min(x.f_age, x.even_whole) / SLOW) if slow else int(x.f_age), RING)
    if n < LEAST:
        return
    i = int(x.slow_head if slow else x.even_head) - n
    i = i + RING if i < 0 else i
    ff, fd, dd, f1, d1, ww, fw, dw, ft, tt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    beyond, rubs = 0.0, HEALTHY * p.I_max
    ring, h = (x.slow_ring, EVEN_S * SLOW) if slow else (x.even_ring, EVEN_S)
    for k in range(n):
        f, d, w = ring[0, i], ring[1, i], ring[2, i]
        ff += f * f
        beyond += math.fabs(f) * max(math.fabs(f) - rubs, 0.0)
        fd += f * d
        dd += d * d
        f1 += f
        d1 += d
        ww += w * w
        fw += f * w
        dw += d * w
        t = k - 0.5 * (n - 1)
        ft += f * t
        tt += t * t
        i = 0 if i == RING - 1 else i + 1
    wide = p.sigma_f / math.sqrt(SLOW) if slow else p.sigma_f
    tolerance = min(0.06, doubt_b(x)[0]) * p.b_motor
    own = doubt(x)
    noise_c = n * wide * wide + tolerance * tolerance * ww
    noise = noise_c + 4e-6 * dd
    if apart(ff, fd, dd, own) < FIRM * noise:
        return
    c1, cc = f1 + d1, ff + 2.0 * fd + dd
    added, hz_added = best_sine(x, slow, 0, n, False, own)
    instead, hz_instead = best_sine(x, slow, 0, n, True, own)
    stuck = max(cc - c1 * c1 / n, 0.0)
    bias = apart(ff - f1 * f1 / n, fd - f1 * d1 / n, dd - d1 * d1 / n, own)
    t = -fd / dd if dd > 0.0 else 0.0
    loss = max(ff - t * t * dd, 0.0) if t > max(LOSS_LEAST, own[0]) else ff
    weak = apart(ff - fw * fw / ww, fd - fw * dw / ww, dd - dw * dw / ww, own) if fw > 0.0 else ff
    x.residual[0], x.residual[1], x.residual[2] = added / ff, instead / ff, stuck / ff
    x.residual[3], x.residual[4] = loss / ff, bias / ff
    x.residual[5] = weak / ff
    x.grain = noise / ff
    x.residual[6] = max(ff - f1 * f1 / n - ft * ft / tt, 0.0) / ff
    back = (1.0 + x.magnets_own) * p.b_motor
    fi, ii = fd - back * fw, dd - back * (2.0 * dw - back * ww)  # of the current itself, which the sensor reads
    x.residual[7] = max(ff - fi * fi / ii, 0.0) / ff if math.fabs(fi) > LOSS_LEAST * ii else 1.0
    x.must = beyond / ff
    slowest, hz = added, SLOWEST
    while hz < 0.5 / (n * h):
        slowest = min(slowest, sine_leaves(x, slow, 0, n, hz, False, own))
        hz *= WIDE
    x.curved = (slowest - min(bias, x.residual[6] * ff)) / (wide * wide)
    least, which = 1e300, -1
    for k in range(6):
        if x.residual[k] * ff < least:
            least, which = x.residual[k] * ff, k
    clear = True  # the others leave several times as much, and more than noise and what the model may be off by make
    for k in range(6):
        through = max(1.0 - t, 0.0) if k == 3 else 1.0  # share of the demand, and its error, that comes through
        off = 0.0 if k == 1 or k == 2 else 4e-6 * dd * through * through
        more = MORE * wide * wide + CLEAR * (tolerance * tolerance * ww + off)
        clear = clear and (k == which or x.residual[k] * ff >= max(CLEAR * least, least + more))
    told = which == 1 or which == 2
    pure = least <= PURE * (cc if told else ff) + 2.0 * (noise_c if told else noise)
    said = NONE
    if pure and clear:
        hz = hz_added if which == 0 else hz_instead
        if which < 2 and hz * n * h >= PERIODS:
            said, x.drive_hz = OFC_LIQUID if which == 0 else OFC_SOLID, hz
        elif which == 2 and math.fabs(c1) > STUCK * p.I_max * n:
            said = RUNAWAY
        elif (which == 3 or which == 2) and x.f_age >= LOSS_SAMPLES:
            said = EFFECTIVENESS
        elif which == 5 and measured:
            said = WEAK
    elif cc <= min(2.0 * noise_c, instead + SINES * wide * wide) and min(added, min(bias, weak)) >= CLEAR * noise:
        said = EFFECTIVENESS if x.f_age >= LOSS_SAMPLES else NONE  # nothing at all arrives
    k = 1 if slow else 0
    x.drive_votes[k] = 1.0 + (x.drive_votes[k] if said != NONE and said == x.drive_vote[k] else 0.0)
    x.drive_vote[k] = said
    if said != NONE and x.drive_votes[k] >= VOTES:
        x.drive_name = said
        if said == EFFECTIVENESS or said == WEAK:
            x.drive_lost = 2.0 if cc <= NOTHING * dd + 2.0 * noise_c else 1.0
        if said == WEAK:  # stays until motion tells otherwise: at rest magnets are neither weak nor healed
            x.hot_gain = x.weak = 1.0
            x.gain_timer = RELEASE
            x.gain_now[:] = 0.0


@kernel
def begin(x):
    """Start anew: nothing is wrong with the drive."""
    x.f_age = 0.0
    x.drive_name = NONE
    x.drive_vote[:] = NONE
    x.drive_votes[:] = 0.0
    x.drive_hz = x.drive_lost = x.jumped = x.must = x.curved = 0.0
    for k in range(8):
        x.residual[k] = 1.0


@kernel
def smooth(x, k, value, dt):
    """Return a signature or the innovation lagged by TAU_FELT, scaled so that white noise keeps its size.

    Of the velocity sensor's noise, which f shares, the filter leaves its fast part in the innovations: slow ones tell.
    """
    a = min(dt / TAU_FELT, 1.0)
    x.smoothed[k] += a * (value - x.smoothed[k])
    return x.smoothed[k] * math.sqrt((2.0 - a) / a)


@kernel
def felt_sigma(x, p, dt):
    """Return the deviation of `felt`, beside a `misread` that is estimated with it: that of the innovation, which
    `smooth` has made alike over TAU_FELT.
    """
    a = min(dt / TAU_FELT, 1.0)
    alone = x.felt_den - x.both_den * x.both_den / max(x.read_den, 1e-9)
    return p.S_root * math.sqrt((2.0 - a) / a / max(alone, 1e-9))


@kernel
def watch(x, y, current, u, w, measured, gamma, p, dt):
    """Take a tick: current `y` [A] where it is usable, demand `u` [A], rate `w`, which may be believed
    where it is `measured`, and its innovation `gamma` [rad/s].
    """
    inside = clipped(u, 2.0 * p.I_max * p.R_loop / p.K_gi)  # a spike in the demand is no demand
    x.amp_lag += p.amp * (inside - x.amp_lag)
    fast = inside - x.amp_lag
    d, rest, limit = demanded(u + x.amp_own * fast, w, x.gain_own, x.magnets_own, p)
    seen = current and not limit and math.fabs(y) < NO_CURRENT * p.I_max
    f = y - d if seen else 0.0
    if seen and math.fabs(d) < p.I_max:
        tick(x, f, rest, (1.0 + x.gain_own) * p.K_gi / p.R_loop * fast, w, w - gamma)
    x.f_now, x.d_now = f, d
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
        least = p.th_f + p.rho_f * math.sqrt(x.w_power) + math.sqrt(x.off_power)
        least *= 1.0 if x.age_vel <= p.t_bad else BLIND
        most = SPIKE * least * least * TAU_POWER / h  # one sample alone is no fault
        x.f_power += h / TAU_POWER * (min(g * g, most) - x.f_power)
        x.w_power += h / TAU_POWER * (w * w - x.w_power)
        x.r_f = math.sqrt(x.f_power) / least
    beyond = seen and x.r_f >= 1.0 and x.age >= p.t_start
    x.f_timer, x.hot_f = confirm(x.f_timer, x.hot_f, beyond, dt, p.t_f, p.t_release)
    if not seen:
        x.even_lost += 1.0
    felt = smooth(x, 0, push(x, 0, p.impulse * f, p), dt)
    lost = smooth(x, 1, push(x, 3, p.impulse * x.gain_a * rest, p), dt)
    kept = smooth(x, 4, push(x, 5, p.impulse * clipped(rest, HEALTHY * p.I_max), p), dt)
    off = smooth(x, 2, read(x, 4, f / p.b_motor, p), dt)
    gamma = smooth(x, 3, gamma, dt)
    if x.f_timer <= 0.0 and x.alarm < 0.5:
        x.kept_num += min(dt / TAU_KEPT, 1.0) * (gamma * kept - x.kept_num)
        x.kept_den += min(dt / TAU_KEPT, 1.0) * (kept * kept - x.kept_den)
    if x.hot_gain > 0.5:
        x.gain_num += gamma * lost
        x.gain_den += lost * lost
    else:
        x.gain_num = x.gain_den = 0.0
    gamma -= x.kept_num / max(x.kept_den, 1e-9) * kept
    if x.f_timer <= 0.0:  # what came shortly before an alarm is of its onset
        x.felt_num -= min(dt / TAU_POWER, 1.0) * x.felt_num
        x.felt_den -= min(dt / TAU_POWER, 1.0) * x.felt_den
        x.read_num -= min(dt / TAU_POWER, 1.0) * x.read_num
        x.read_den -= min(dt / TAU_POWER, 1.0) * x.read_den
        x.both_den -= min(dt / TAU_POWER, 1.0) * x.both_den
    if current:
        x.felt_num += gamma * felt
        x.felt_den += felt * felt
        x.read_num += gamma * off
        x.read_den += off * off
        x.both_den += felt * off
        det = max(x.felt_den * x.read_den - x.both_den * x.both_den, 1e-9)
        x.felt = (x.felt_num * x.read_den - x.read_num * x.both_den) / det
        x.misread = (x.read_num * x.felt_den - x.felt_num * x.both_den) / det
    x.even_sum[0] += f
    x.even_sum[1] += rest
    x.even_sum[2] += w
    x.even_sum[3] += x.pair_e
    x.even_sum[4] += x.y_surface
    x.even_ticks += 1.0
    if x.even_ticks < p.even:
        return
    head = int(x.even_head)
    x.even_head = put(x.even_ring, x.even_sum, p.even, x.even_head)
    for s in range(5):
        x.slow_sum[s] += x.even_ring[s, head]
    x.even_ticks = 0.0
    x.slow_count += 1.0
    if x.slow_count >= SLOW:
        x.slow_head = put(x.slow_ring, x.slow_sum, SLOW, x.slow_head)
        x.slow_count = 0.0
    whole = x.even_lost < 0.5
    x.even_whole = x.even_whole + 1.0 if whole else 0.0
    x.even_lost = 0.0
    f, d, w = x.even_ring[0, head], x.even_ring[1, head], x.even_ring[2, head]
    usual = p.th_f + (p.rho_f + doubt_b(x)[0] * p.b_motor) * math.fabs(w) + doubt(x)[0] * math.fabs(d)
    known = x.hot_gain > 0.5 and x.weak > 0.5
    best = min(min(x.residual[0], x.residual[1]), min(x.residual[2], min(x.residual[3], x.residual[4])))
    magnets = x.f_age > RING and x.residual[5] < 0.5 * best  # what explains best is told by more than one window
    plain = x.f_timer <= 0.0 or known or magnets
    if whole and measured and plain and math.fabs(f) < 3.0 * usual:
        gains(x, p, f, d, dt)
    x.gain_tick[:] = 0.0
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
    if x.hot_f > 0.5 and x.f_age >= LEAST and x.drive_name == NONE:
        if x.f_age > RING and x.slow_count == 0.0:
            explain(x, p, True, measured)
        elif int(x.f_age) % 2 == 0:
            explain(x, p, False, measured)
