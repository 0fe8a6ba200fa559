"""What did the valve do? Hypotheses about the last seconds of a hydraulic actuator, judged by what they leave over.

f is the estimated input fault, d the valve command behind the same lag, so that w = f + d is what the valve did, and z
the pressure difference. Over a window of averaged samples each hypothesis leaves an energy, a sum of squares:

| hypothesis | model | energy | name |
|---|---|---|---|
| healthy | f = t d, t within GAIN_ERROR of the learned gain | H | |
| oscillation added | f = g d + a cos + b sin | L | OFC_LIQUID |
| oscillation in place | f = -d + a cos + b sin | S | OFC_SOLID |
| less than commanded | f = t1 d + t2 z: valve, supply; leakage; bypass | D | EFFECTIVENESS |
| a valve that stands open | f = -d + c from its jump on | | RUNAWAY |

A name is given when its hypothesis leaves what noise leaves, and every other several times as much; until then the
fault is AMBIGUOUS. An oscillation alone, without any other motion of the valve command, is the same fault added or in
place: w is a sine, and so is f. What tells them apart is the rest of the command, which passes or does not.
"""

import math
from typing import Any

from actuators.block import kernel
from fdi.common import bank, decision
from fdi.common.decision import clipped
from fdi.common.verdict import AMBIGUOUS, EFFECTIVENESS, JAM_SOLID, NONE, OFC_LIQUID, OFC_SOLID, RUNAWAY, SENSOR
from fdi.hydraulic import obeys

N = bank.N
SLOW = bank.LEVELS  # index of the slow ring
SLOW_HZ = (0.1, 0.126, 0.158, 0.2, 0.251, 0.316, 0.398)  # [Hz]; the bank begins at 0.5 Hz
SLOW_K = len(SLOW_HZ)
SLOW_S, EVEN_S = 0.5, 0.04  # samples of the slow ring and of the even one [s]
SHORT, LONG = 1.25, 2.0  # windows of an oscillation [periods]
GAIN_ERROR = 0.06  # of the learned gain
BESIDE, CLEAR = 2.0, 3.0  # an energy of so many times the noise's own is no noise; is enough for a name
STEP, WIDE = 0.1, 0.13  # of its frequency, before an alarm and after it; a neighbour in the bank is 0.27 away
OWN_FAST = 0.35  # above OWN_HZ
BEHIND = 0.6  # periods since the alarm rose before an oscillation in place is voted for
OWN, OWN_HZ = 0.6, 2.0  # f is w - d, and d in quadrature to w: up to OWN_HZ f has no less than this of the energy of w
OFFSET = 0.3  # energy of the mean over that about it
PART = 0.35  # share that an oscillation about a mean may leave before its frequency is looked for
PURE_SURE = 0.16  # share that an oscillation added leaves where the valve is known to obey
PURE, FAIR = 0.08, 0.5  # share that a hypothesis leaves where it explains, where it may
NOISY = 1.3  # and so many times what noise leaves
DOUBT = 2.0  # proof to the contrary that forbids a name
LEAD = 12.0  # the next best hypothesis leaves so many variances more (twice the logarithm of the likelihoods' ratio)
PERIODS, SWITCH = 3.0, 5.0  # periods for which a name must be the best; ... where another has been given
LOSS_ADDED = 0.6  # a loss leaves more than this of an added oscillation
LOSS_INSTEAD = 0.2  # ... and of one in place of the command
GOOD, FIRM = 0.06, 6.0  # a hypothesis that leaves less than this, of so many times the noise's energy, is good
SLOW_ONE, SLOW_LEFT = 0.56, 0.3  # a slow one [Hz] is named where the other leaves this share
SAME_HZ = 0.12  # votes agree on the frequency
WAS = 0.45  # w before the jump, over what it is after it
SUDDEN = 0.125  # a runaway's valve has opened within [s]
LOOSE = 0.6  # ... more of it where the valve is wide open: no oscillation is that fast for so long
EVEN = 0.05  # ... by its own noise and this share
FLAT, RISE, BEND = 0.2, 0.4, 3.0  # a runaway's valve stays so flat, BEND times as long as it took to rise from RISE
TRAVEL = 4e-3  # [m] that way
SHORT_HZ = 7.0  # above it any jolt fills the short window [Hz]
SHORT_RATIO = 1.5  # the short window takes so many thresholds
RECENT = 10  # even samples that must still show it
LOSS_SURE = 150.0  # even samples for which a loss explains, 6 s: half a period at 0.1 Hz, and more
LOSS_HITS = 10.0  # even windows in a row that show a loss
DEAD = 0.85  # a valve that loses more may as well be where something slow holds it
LOSS_LEAST, LEAK_LEAST, AIR_LEAST = 0.15, 0.05, 0.002  # of flow [1], pressure [1], its rate [s]
LEAK_MOST, AIR_MOST = 1.2, 0.2
LEAST_EVEN = 10  # even samples that a loss is fitted to

PARAMS = [
    ("sigma", "f8", (bank.LEVELS + 2,)),  # noise of f in the samples of the bank's rings, the slow and the even [1]
    ("slow_threshold", "f8", (SLOW_K,)),  # amplitude of f in quiet flight [1]
    ("slow_block", "f8"),  # samples of the bank's slowest ring in one of the slow ring
    ("even_block", "f8"),  # ticks in one of the even ring
    ("slow_hz", "f8", (SLOW_K,)),  # [Hz]
]
STATE = [
    ("slow_ring", "f8", (2, N)),  # f and d, averages of SLOW_S
    ("slow_sum", "f8", (2,)),
    ("slow_count", "f8"),
    ("slow_head", "f8"),
    ("slow_seen", "f8"),
    ("even_ring", "f8", (4, N)),  # f, d, z, z', averages of EVEN_S
    ("even_sum", "f8", (4,)),
    ("even_count", "f8"),
    ("even_head", "f8"),
    ("even_seen", "f8"),
    ("slow_ratio", "f8", (SLOW_K,)),  # amplitude over its threshold
    ("slow_hit", "f8", (SLOW_K,)),  # windows in a row that show it
    ("sure", "f8", (3,)),  # of added and in place: periods of agreement; of less than commanded: samples
    ("clock", "f8"),  # time [s]
    ("rose", "f8"),  # when the alarm rose [s]
    ("vote_hz", "f8", (2,)),  # frequency of the last vote, added and in place [Hz]
    ("vote_first", "f8", (2,)),  # since when votes have agreed [s]
    ("vote_last", "f8", (2,)),  # time of the last [s]
    ("vote_good", "f8", (2,)),  # good ones among them
    ("named", "f8"),  # name of the fault that stands, NONE before there is one
    ("left", "f8", (3,)),  # what the best window of each leaves, over what there is
    ("r_bank", "f8"),  # largest of the bank over its threshold
    ("fast", "f8"),  # 1 while that is no slow one's shadow at the lower end
    ("opens", "f8"),  # 1 where the valve stands open since a jump
    ("run_side", "f8"),  # sign of the input fault when it was last large
    ("swings", "f8"),  # how often it has been large on the other side since: from twice on it oscillates
    ("eff_timer", "f8"),  # time for which a loss is still held to be there [s]
    ("eff_hit", "f8"),  # windows in a row that show it
]


SIGMA = (0.00235, 0.00115, 0.0004, 0.0004, 0.00125)  # with sensor noise 1.2 times that of the set `transport`


ROUGHER = {0: 25.0, 1: 4.0, 2: 1.0}  # what a load that is not measured adds, by load form


def design(dt: float, load: Any) -> dict[str, Any]:
    """Return the PARAMS fields of ticks of `dt` seconds and of a load form."""
    last = max(round(bank.BLOCKS_S[-1] / dt), 1) * dt
    sigma = tuple(ROUGHER[load] * v for v in SIGMA)
    return {"sigma": sigma, "slow_hz": SLOW_HZ, "slow_block": float(round(SLOW_S / last)),
            "even_block": float(max(round(EVEN_S / dt), 1))}


@kernel
def push(x, p, f, d, z, r):
    """Take one tick into the even ring, and a sample of the bank's slowest ring into the slow one where it is new.

    Return 1.0 where the even ring has a new sample, 2.0 added where the slow one has.
    """
    fresh = 0.0
    x.even_sum[0] += f
    x.even_sum[1] += d
    x.even_sum[2] += z
    x.even_sum[3] += r
    x.even_count += 1.0
    if x.even_count >= p.even_block:
        head = int(x.even_head)
        for s in range(4):
            x.even_ring[s, head] = x.even_sum[s] / x.even_count
            x.even_sum[s] = 0.0
        x.even_head = 0.0 if head == N - 1 else head + 1.0
        x.even_count = 0.0
        x.even_seen += 1.0
        fresh = 1.0
    if x.bank_tick[bank.LEVELS - 1] == 0.0 and x.bank_seen[bank.LEVELS - 1] > 0.0:
        last = int(x.bank_head[bank.LEVELS - 1]) - 1
        if last < 0:
            last = N - 1
        for s in range(2):
            x.slow_sum[s] += x.bank_ring[s, bank.LEVELS - 1, last]
        x.slow_count += 1.0
        if x.slow_count >= p.slow_block:
            head = int(x.slow_head)
            for s in range(2):
                x.slow_ring[s, head] = x.slow_sum[s] / x.slow_count
                x.slow_sum[s] = 0.0
            x.slow_head = 0.0 if head == N - 1 else head + 1.0
            x.slow_count = 0.0
            x.slow_seen += 1.0
            fresh += 2.0
    return fresh


@kernel
def forget(x):
    """Empty every ring: what they hold is of a fault that has healed, or of a sensor that is no longer read."""
    for j in range(bank.LEVELS):
        x.bank_seen[j] = 0.0
    x.slow_seen = 0.0
    x.even_seen = 0.0
    for k in range(bank.K):
        x.ratio[k] = 0.0
        x.hit[k] = 0.0
    for k in range(SLOW_K):
        x.slow_hit[k] = 0.0
    x.r_ofc = 0.0
    x.eff_hit = 0.0
    for i in range(3):
        x.sure[i] = 0.0
        x.left[i] = 1.0


@kernel
def sample(x, s, j, i):
    """Return sample `i` of signal `s`, 0 f, 1 d, of ring `j`."""
    if j == SLOW:
        return x.slow_ring[s, i]
    return x.bank_ring[s, j, i]


@kernel
def begin(x, j, n):
    """Return the place of the oldest of the last `n` samples of ring `j`."""
    i = int(x.slow_head if j == SLOW else x.bank_head[j]) - n
    return i + N if i < 0 else i


@kernel
def tone(x, p, j, n, angle):
    """Fit a sine of `angle` [rad] a sample to the last `n` of ring `j`.

    Return (ff, fd, dd, ff', fd', dd', a, m): sums of products of f and d, the same of what the sine leaves of each,
    the sine's amplitude in f - g d, and the energy of its mean. Where f has an
    offset of its own (`keep_mean` 0) its mean is taken out first.
    """
    first = begin(x, j, n)
    mean = 0.0
    if p.keep_mean < 0.5:
        i = first
        for _ in range(n):
            mean += sample(x, 0, j, i)
            i = 0 if i == N - 1 else i + 1
        mean /= n
    start = -0.5 * (n - 1) * angle
    c, s = math.cos(start), math.sin(start)
    turn_c, turn_s = math.cos(angle), math.sin(angle)
    ff, fd, dd, fc, fs, dc, ds, cc, cs, ss = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    f1, d1 = 0.0, 0.0
    i = first
    for _ in range(n):
        f, d = sample(x, 0, j, i) - mean, sample(x, 1, j, i)
        f1 += f
        d1 += d
        ff += f * f
        fd += f * d
        dd += d * d
        fc += f * c
        fs += f * s
        dc += d * c
        ds += d * s
        cc += c * c
        cs += c * s
        ss += s * s
        i = 0 if i == N - 1 else i + 1
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s
    det = max(cc * ss - cs * cs, 1e-12)
    fa, fb = (fc * ss - fs * cs) / det, (fs * cc - fc * cs) / det
    da, db = (dc * ss - ds * cs) / det, (ds * cc - dc * cs) / det
    ea, eb = fa - x.gain * da, fb - x.gain * db
    offset = (f1 - x.gain * d1) / n
    return (ff, fd, dd, ff - fa * fc - fb * fs, fd - da * fc - db * fs, dd - da * dc - db * ds,
            math.sqrt(ea * ea + eb * eb), n * offset * offset)


@kernel
def least(ff, fd, dd, gain):
    """Return what f = t d leaves of f, the least over t within GAIN_ERROR of `gain`."""
    t = gain
    if dd > 0.0:
        t = min(max(fd / dd, gain - GAIN_ERROR), gain + GAIN_ERROR)
    return max(ff - 2.0 * t * fd + t * t * dd, 0.0)


@kernel
def lowest(a, m, c, step):
    """Return where a parabola through (-step, a), (0, m), (step, c) is lowest, within +-step."""
    bend = a - 2.0 * m + c
    if bend <= 0.0:
        return -step if a < c else step
    return clipped(0.5 * step * (a - c) / bend, step)


@kernel
def oscillates(x, p, j, n, angle):
    """Return (H, L, W, S, allowed, relative frequency of L, of S, amplitude, H about the mean): energies
    over the last `n` samples.

    W is the energy of w; `allowed` that of noise and of what the gain does not explain. Each sine is fitted at its own
    best frequency about `angle`.
    """
    step = STEP if x.alarm < 0.5 else WIDE
    ff, fd, dd, f0, m0, d0, a, still = tone(x, p, j, n, angle)
    H, W = least(ff, fd, dd, x.gain), max(ff + 2.0 * fd + dd, 0.0)
    L, S = least(f0, m0, d0, x.gain), max(f0 + 2.0 * m0 + d0, 0.0)
    part = decision.share(x, p)
    allowed = n * x.coarse * x.coarse * p.sigma[j] * p.sigma[j] + part * part * dd
    at_L, at_S = 1.0, 1.0
    if H > allowed and (L < 0.7 * H or S < 0.7 * W):
        _, _, _, f1, m1, d1, _, _ = tone(x, p, j, n, angle * (1.0 - step))
        _, _, _, f2, m2, d2, _, _ = tone(x, p, j, n, angle * (1.0 + step))
        at_L += lowest(least(f1, m1, d1, x.gain), L, least(f2, m2, d2, x.gain), step)
        at_S += lowest(f1 + 2.0 * m1 + d1, S, f2 + 2.0 * m2 + d2, step)
        _, _, _, f1, m1, d1, b, _ = tone(x, p, j, n, angle * at_L)
        new = least(f1, m1, d1, x.gain)
        if new < L:
            L, a = new, b
        _, _, _, f1, m1, d1, _, _ = tone(x, p, j, n, angle * at_S)
        S = min(S, max(f1 + 2.0 * m1 + d1, 0.0))
    return H, L, W, S, allowed, at_L, at_S, a, max(H - still, 0.0)


@kernel
def swing(x, j, n, angle):
    """Fit w to (1, cos, sin) over the last `n` samples of ring `j`.

    Return (energy about the mean, what is left of it, mean).
    """
    i = begin(x, j, n)
    start = -0.5 * (n - 1) * angle
    c, s = math.cos(start), math.sin(start)
    turn_c, turn_s = math.cos(angle), math.sin(angle)
    y1, c1, s1, yy, yc, ys, cc, cs, ss = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(n):
        y = sample(x, 0, j, i) + sample(x, 1, j, i)
        y1 += y
        c1 += c
        s1 += s
        yy += y * y
        yc += y * c
        ys += y * s
        cc += c * c
        cs += c * s
        ss += s * s
        i = 0 if i == N - 1 else i + 1
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s
    yy -= y1 * y1 / n
    yc -= y1 * c1 / n
    ys -= y1 * s1 / n
    cc -= c1 * c1 / n
    cs -= c1 * s1 / n
    ss -= s1 * s1 / n
    det = max(cc * ss - cs * cs, 1e-12)
    a, b = (yc * ss - ys * cs) / det, (ys * cc - yc * cs) / det
    return max(yy, 0.0), max(yy - a * yc - b * ys, 0.0), y1 / n


@kernel
def replaced(x, p, j, n, h, hz):
    """Vote for an oscillation in place of the command where w swings about a mean; the command is not obeyed.

    `h` [s] is a sample of the ring. What a soft or lossy actuator leaves over, and one let go, must be more.
    """
    angle = 6.283185307179586 * hz * h
    variance = x.coarse * x.coarse * p.sigma[j] * p.sigma[j]
    M, R, mean = swing(x, j, n, angle)
    x.left[1] = R / max(M, 1e-300)
    if n * mean * mean > OFFSET * M or (x.clock - x.rose) * hz < BEHIND:
        return False, hz
    m = max(min(int(n * h / EVEN_S + 0.5), N), LEAST_EVEN)
    if m <= x.even_seen:
        H, E, W, _ = losses(x, m)
        if E < LOSS_INSTEAD * H or W < LOSS_INSTEAD * M * m / n or H < (OWN if hz < OWN_HZ else OWN_FAST) * M * m / n:
            return False, hz
    if M < CLEAR * n * variance or R > PART * M + NOISY * n * variance:
        return False, hz
    _, below, _ = swing(x, j, n, angle * (1.0 - WIDE))
    _, above, _ = swing(x, j, n, angle * (1.0 + WIDE))
    move = lowest(below, R, above, WIDE)
    if math.fabs(move) > 0.999 * WIDE:
        return False, hz
    _, R, _ = swing(x, j, n, angle * (1.0 + move))
    hz *= 1.0 + move
    x.left[1] = R / max(M, 1e-300)
    if R <= PURE * M + NOISY * n * variance:
        vote(x, 1, hz, 1.0 if R < GOOD * M + n * variance and M > FIRM * n * variance else 0.0,
             PERIODS - 0.4 if j == SLOW else PERIODS)
    return True, hz


@kernel
def vote(x, i, hz, good, bonus):
    """Count a window for the oscillation added (`i` 0) or in place (1) at `hz`: votes of one frequency make a name.

    `sure` becomes the time over which they have agreed, in periods; two `good` ones count for PERIODS more.
    """
    if math.fabs(hz - x.vote_hz[i]) > SAME_HZ * hz or x.clock - x.vote_last[i] > 1.5 / hz:
        x.vote_first[i] = x.clock
        x.vote_good[i] = 0.0
    x.vote_hz[i] = hz
    x.vote_last[i] = x.clock
    x.vote_good[i] += good
    x.ofc_hz = hz
    x.sure[i] = (x.clock - x.vote_first[i]) * hz + (bonus if x.vote_good[i] >= 2.0 else 0.0)
    x.sure[1 - i] = 0.0
    x.vote_hz[1 - i] = 0.0


@kernel
def compare(x, p, H, L, W, S, B, n, h, variance, hz_L, hz_S, plain, stands, bonus):
    """Vote for the oscillation added or in place where it is explained and the other is clearly worse."""
    noise = n * variance
    H = max(H, 1e-300)
    x.left[0], x.left[1] = L / H, S / max(min(W, H), 1e-300)
    if H < CLEAR * noise:
        return
    lead = LEAD * variance
    other = 1.0
    m = max(min(int(n * h / EVEN_S + 0.5), N), LEAST_EVEN)
    if p.load == 2.0 and x.coarse < 2.0 and m <= x.even_seen:
        all, E, _ = loss(x, p, m)
        floor = m * p.sigma[SLOW + 1] * p.sigma[SLOW + 1]
        other = max(E - floor, 0.0) / max(all - floor, 1e-300) if all > 2.0 * floor else 1.0
    yes = obeys.obeys(x)
    added = plain and other > LOSS_ADDED and L <= (PURE_SURE if yes else PURE) * H + NOISY * noise
    least_w = min(W, H)
    explained = S <= PURE * least_w + NOISY * noise and other > LOSS_INSTEAD
    instead = stands and W > CLEAR * noise and explained
    if hz_L < SLOW_ONE:  # below it the command is seldom anything else within a few periods
        added = added and (yes or S > SLOW_LEFT * W)
        instead = instead and L > SLOW_LEFT * H
    if added and x.proof > -DOUBT and (yes or (S - L > lead and S > 2.0 * L)):
        vote(x, 0, hz_L, 1.0 if L < GOOD * H + noise and H > FIRM * noise else 0.0, bonus)
    elif instead and x.proof < DOUBT and min(L, B) - S > lead and min(L, B) > 2.0 * S:  # a slow one is an offset here
        vote(x, 1, hz_S, 1.0 if S < GOOD * least_w + noise and least_w > FIRM * noise else 0.0, bonus)


@kernel
def loss(x, p, n):
    """Return (H, least energy that a loss leaves, sum of d d) of the newest `n` even samples; see `losses`."""
    H, E, _, dd = losses(x, n)
    return H, E, dd


@kernel
def losses(x, n):
    """Fit each loss alone to the newest `n` even samples: f = t d, t z or t z', and w = t z of one let go.

    Return (H, least energy of the first three, energy of the last, sum of d d).

    A valve that passes less, or a lower supply: t d; leakage: t z; soft oil: t z'. All take away: t is negative.
    """
    i = int(x.even_head) - n
    if i < 0:
        i += N
    ff, fd, dd, fz, zz, fr, rr, dz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(n):
        f, d, z, r = x.even_ring[0, i], x.even_ring[1, i], x.even_ring[2, i], x.even_ring[3, i]
        ff += f * f
        fd += f * d
        dd += d * d
        fz += f * z
        zz += z * z
        dz += d * z
        fr += f * r
        rr += r * r
        i = 0 if i == N - 1 else i + 1
    H = least(ff, fd, dd, x.gain)
    E = H
    if dd > 0.0 and -DEAD < fd / dd < -LOSS_LEAST:
        E = min(E, ff - fd * fd / dd)
    if zz > 0.0 and -LEAK_MOST < fz / zz < -LEAK_LEAST:
        E = min(E, ff - fz * fz / zz)
    if rr > 0.0 and -AIR_MOST < fr / rr < -AIR_LEAST:
        E = min(E, ff - fr * fr / rr)
    W = ff + 2.0 * fd + dd
    if zz > 0.0 and fz + dz < 0.0:
        W -= (fz + dz) * (fz + dz) / zz
    return H, max(E, 0.0), max(W, 0.0), dd


@kernel
def effective(x, p):
    """Count even samples after which a loss explains the whole even ring, and shows in its newest part."""
    n = N if x.even_seen >= N else int(x.even_seen)
    if n < N // 2:
        return
    variance = p.sigma[SLOW + 1] * p.sigma[SLOW + 1]
    H, E, dd = loss(x, p, n)
    allowed = n * variance + p.bank_share * p.bank_share * dd
    x.left[2] = E / max(H, 1e-300)
    if H < 8.0 * allowed:
        x.eff_hit = 0.0
        return
    if E > max(FAIR * H, 1.5 * n * variance):
        x.eff_hit = 0.0
        x.sure[2] = 0.0
        return
    now, _, _ = loss(x, p, RECENT)
    if now < 3.0 * RECENT * variance:
        return
    x.eff_hit += 1.0
    if E <= 0.2 * H + NOISY * n * variance and x.left[2] < 0.5 * min(x.left[0], x.left[1]):
        x.sure[2] += 1.0


@kernel
def opened(x, p, j, least, h, opposed):
    """Return whether the valve stands open since a jump: w flat for BEND times as long as it took to get there.

    Over means of three samples of ring `j`, flat for at least so many samples.
    """
    if x.bank_seen[j] < N:
        return False
    newest = int(x.bank_head[j]) - 1
    newest = newest + N if newest < 0 else newest
    i, mean = newest, 0.0
    for _ in range(least):
        mean += (x.bank_ring[0, j, i] + x.bank_ring[1, j, i]) / least
        i = N - 1 if i == 0 else i - 1
    size = math.fabs(mean)
    side = 1.0 if mean > 0.0 else -1.0
    if size < 0.6 * x.coarse * p.run_threshold or side * x.bank_ring[1, j, newest] > -opposed * size:
        return False
    w0 = side * (x.bank_ring[0, j, newest] + x.bank_ring[1, j, newest])
    i = N - 1 if newest == 0 else newest - 1
    w1 = side * (x.bank_ring[0, j, i] + x.bank_ring[1, j, i])
    flat, rise, jumped = 0, 0, False
    flat_to = min(FLAT * size, (EVEN + LOOSE * size) * size + 1.2 * x.coarse * p.sigma[j])
    for _ in range(N - 2):
        i = N - 1 if i == 0 else i - 1
        w2 = side * (x.bank_ring[0, j, i] + x.bank_ring[1, j, i])
        w = (w0 + w1 + w2) / 3.0
        w0, w1 = w1, w2
        before = w if j > 0 else side * (x.bank_ring[0, j, i] - x.gain * x.bank_ring[1, j, i])
        if before <= RISE * size and w <= WAS * size:
            jumped = True
            break
        if rise == 0 and math.fabs(w - size) <= flat_to:
            flat += 1
        else:
            rise += 1
    sudden = rise * h <= SUDDEN and flat >= BEND * rise
    return jumped and flat >= least - 2 and sudden and flat * h * size >= TRAVEL


@kernel
def opened_since(x, p, dt):
    """Return whether one of the bank's faster rings shows a valve that stands open."""
    loaded = x.x_hat[3] * (x.f_slow + x.u_slow) > 0.0  # the way in which a surface that is let go moves
    if opened(x, p, 0, 18 if loaded else 12, p.bank_block[0] * dt, 0.0):
        return True
    return opened(x, p, 1, 16, p.bank_block[1] * dt, 0.6)


@kernel
def recent(x, j, n):
    """Return the mean square of f - g d over the newest `n` samples of ring `j`."""
    i = int(x.slow_head if j == SLOW else x.bank_head[j]) - 1
    H = 0.0
    for _ in range(n):
        i = i + N if i < 0 else i
        e = sample(x, 0, j, i) - x.gain * sample(x, 1, j, i)
        H += e * e
        i -= 1
    return H / n


@kernel
def look(x, p, j, period, hz, h, r, b):
    """Try both windows of an oscillation at `hz`; return (whether one shows, frequency [Hz], amplitude, kind).

    `period` is that of one period in samples of `h` seconds; `r` its amplitude in f over its threshold, `b` in w.
    """
    seen = int(x.slow_seen if j == SLOW else x.bank_seen[j])
    found, at, amplitude = False, 0.0, 0.0
    no = obeys.refuses(x)
    for length in (SHORT, LONG):
        n = int(length * period + 0.5)
        if n > N:
            n = N
        if n >= seen or (length == SHORT and hz > SHORT_HZ):
            continue
        if no:
            one, at_w = replaced(x, p, j, n, h, hz)
            if one:
                found, at = True, at_w
            continue
        H, L, W, S, allowed, at_L, at_S, a, B = oscillates(x, p, j, n, 6.283185307179586 / period)
        if H < BESIDE * allowed:
            continue
        part = 0.25 if j == SLOW else 0.5
        now = recent(x, j, max(int(part * period + 0.5), 2)) * n / H
        least_r = 1.0 if length == LONG else SHORT_RATIO
        plain = r >= least_r and L <= FAIR * H and now > 0.1
        stands = b >= 1.0 and S <= FAIR * W and S <= FAIR * B and now > 0.03
        if plain or stands:
            found = True
            better = L <= S
            at, amplitude = hz * (at_L if better else at_S), a
        bonus = PERIODS - 0.4 if j == SLOW else PERIODS
        plain, stands = r >= 1.0 and now > 0.1, b >= 1.0 and now > 0.03
        if x.alarm > 0.5:  # another frequency's shadow is no vote
            plain = plain and math.fabs(at_L - 1.0) < 0.999 * WIDE
            stands = stands and math.fabs(at_S - 1.0) < 0.999 * WIDE
        compare(x, p, H, L, W, S, B, n, h, allowed / n, hz * at_L, hz * at_S, plain, stands, bonus)
    return found, at, amplitude


@kernel
def search(x, p, renewed, fresh, blocked, teach, other, dt):
    """Look for an oscillation at every frequency whose window was renewed, and for a loss; hold what was found.

    From the first sign on, of which `other` tells that another test sees a fault, a sine in place of the command is
    looked for as well.
    """
    x.clock += dt
    x.ofc_timer = max(x.ofc_timer - dt, 0.0)
    x.eff_timer = max(x.eff_timer - dt, 0.0)
    suspected = other or x.ofc_timer > 0.0 or x.eff_timer > 0.0
    if fresh == 1.0 or fresh == 3.0:
        if blocked or p.load != 2.0 or x.coarse > 2.0:
            x.left[2] = 1.0
        else:
            effective(x, p)
            if x.eff_hit >= LOSS_HITS:
                x.eff_timer = p.t_release
    if renewed > 0.5:
        bank_search(x, p, blocked, teach, suspected, dt)
    if fresh >= 2.0 and not blocked:
        for k in range(SLOW_K):
            period = 1.0 / (p.slow_hz[k] * SLOW_S)
            if LONG * period >= x.slow_seen:
                x.slow_hit[k] = 0.0
                continue
            n = int(LONG * period + 0.5)
            _, _, dd, _, _, _, a, _ = tone(x, p, SLOW, min(n, N), 6.283185307179586 / period)
            r = a / (x.coarse * p.slow_threshold[k] + decision.share(x, p) * math.sqrt(2.0 * dd / n))
            if (r < 0.5 and not suspected) or x.fast > 0.5:
                x.slow_hit[k] = 0.0
                continue
            x.slow_ratio[k] = r
            x.r_ofc = max(x.r_ofc, r)
            found, _at, amplitude = look(x, p, SLOW, period, p.slow_hz[k], SLOW_S, r, 1.0 if suspected else 0.0)
            x.slow_hit[k] = x.slow_hit[k] + 1.0 if found else 0.0
            if x.slow_hit[k] >= p.hits:
                x.ofc_timer = p.t_release
                x.ofc_amplitude = amplitude


@kernel
def bank_search(x, p, blocked, teach, suspected, dt):
    """Look at the bank's renewed frequencies."""
    part = decision.share(x, p)
    x.r_ofc = 0.0
    peak_L, peak_S, most_L, most_S = -1, -1, 0.0, 0.0
    for k in range(bank.K):
        if x.bank_new[k] > 0.5:
            a = math.sqrt(bank.mixed(x, k, 1.0, -x.gain))
            x.ratio[k] = a / (x.coarse * p.bank_threshold[k] + part * math.sqrt(bank.mixed(x, k, 0.0, 1.0)))
            if teach and x.ratio[k] < 0.7:
                decision.learn_gain(x, p, k, dt)
        x.r_ofc = max(x.r_ofc, x.ratio[k])
        if x.ratio[k] > most_L:
            most_L, peak_L = x.ratio[k], k
        if suspected:
            b = math.sqrt(bank.mixed(x, k, 1.0, 1.0)) / (x.coarse * p.sum_threshold[k])
            if b > most_S:
                most_S, peak_S = b, k
    x.r_bank = x.r_ofc
    x.fast = 1.0 if x.r_bank >= 1.0 and peak_L > 1 else 0.0
    for k in range(bank.K):
        if x.bank_new[k] < 0.5:
            continue
        if blocked or (x.ratio[k] < 0.5 and not suspected):
            x.hit[k] = 0.0
            continue
        j = int(p.bank_level[k])
        h = p.bank_block[j] * dt
        b = math.sqrt(bank.mixed(x, k, 1.0, 1.0)) / (x.coarse * p.sum_threshold[k]) if suspected else 0.0
        found, at, amplitude = look(x, p, j, 1.0 / (p.bank_hz[k] * h), p.bank_hz[k], h, x.ratio[k], b)
        x.hit[k] = x.hit[k] + 1.0 if found else 0.0
        if x.hit[k] >= p.hits:
            x.ofc_timer = p.t_release
            if k == peak_L or k == peak_S:
                x.ofc_amplitude = amplitude / p.bank_loss[k]
                x.ofc_hz = at if x.ofc_hz == 0.0 else x.ofc_hz


@kernel
def conclude(x, jam, run):
    """Write `alarm`, `verdict` and `culprit` of a hydraulic lane: the name that stands, else the sensor's pair.

    A name is given once, when it is sure; another takes its place only when that has been sure for long. A jam takes
    the place of any but a runaway.
    """
    x.alarm = 1.0 if x.sensor > 0.5 or jam or run or x.ofc_timer > 0.0 or x.eff_timer > 0.0 else 0.0
    if x.alarm < 0.5:
        x.rose = x.clock
        x.verdict, x.culprit, x.named = NONE, 0.0, NONE
        for i in range(3):
            x.sure[i] = 0.0
        return
    need = PERIODS if x.named == NONE or x.named == RUNAWAY else PERIODS + SWITCH
    if jam and x.named != RUNAWAY:
        x.named = JAM_SOLID
    elif x.named == NONE and run and x.opens > 0.5:
        x.named = RUNAWAY
    elif x.sure[0] >= need:
        x.named = OFC_LIQUID
    elif x.sure[1] >= need:
        x.named = OFC_SOLID
    elif x.sure[2] >= LOSS_SURE and x.named != RUNAWAY:
        x.named = EFFECTIVENESS
    x.verdict, x.culprit = AMBIGUOUS, 0.0
    if x.named != NONE:  # beside a sensor that is wrong, too: the filter goes on without it
        x.verdict = x.named
    elif x.sensor > 0.5 and (x.blame == 1.0 or (x.blame == 2.0 and x.play < 0.5)):
        x.verdict, x.culprit = SENSOR, x.blame
