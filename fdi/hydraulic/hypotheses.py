"""Hypotheses on the valve's motion over the last seconds, compared by the energy that each leaves unexplained.

f is the estimated input fault, d the valve command behind the same lag, so that w = f + d is what the valve did, and z
the pressure difference. Over a window of averaged samples each hypothesis leaves an energy, a sum of squares:

| hypothesis | model | energy | name |
|---|---|---|---|
| healthy | f = t d, t within GAIN_ERROR of the learned gain | H | |
| oscillation added | f = g d + a cos + b sin | L | OFC_LIQUID |
| oscillation in place | f = -d + a cos + b sin | S | OFC_SOLID |
| less than commanded | f = t d or t z: valve, supply; leakage | E | (by `fdi.isolation`) |
| a valve that stands open | f = -d + c from its jump on | | RUNAWAY |

A name is given when its hypothesis leaves what noise leaves, and every other several times as much; until then the
fault is AMBIGUOUS. An oscillation alone, without any other motion of the valve command, is the same fault added or in
place: w is a sine, and so is f. What tells them apart is the rest of the command, which passes or does not; its fast
part, which is always there, is tested by `fdi.hydraulic.command_response`. Where it comes through, nothing is in place
of the command; where it does not, a w that swings about no mean is, unless a loss explains it.
"""

import math

from actuators.block import kernel
from fdi.common import bank, decision
from fdi.common.decision import clipped
from fdi.common.verdict import AMBIGUOUS, JAM_SOLID, NONE, OFC_LIQUID, OFC_SOLID, RUNAWAY, SENSOR
from fdi.hydraulic import command_response, losses, sample_rings
from fdi.hydraulic.sample_rings import SLOW, SLOW_K, SLOW_S, N

SHORT, LONG = 1.25, 2.0  # windows of an oscillation [periods]
BESIDE, CLEAR = 2.0, 3.0  # an energy of so many times the noise's own is no noise; is enough for a name
STEP, WIDE = 0.1, 0.13  # of its frequency, before an alarm and after it; a neighbour in the bank is 0.27 away
ASKED = 0.2  # since the alarm rose before one added is voted for, unless the valve is known to obey [s]
BEHIND = 0.6  # periods since the alarm rose before an oscillation in place is voted for
OFFSET = 0.3  # energy of the mean over that about it
PART = 0.35  # share that an oscillation about a mean may leave before its frequency is looked for
PURE_SURE = 0.16  # share that an oscillation added leaves where the valve is known to obey
PURE, FAIR = 0.08, 0.5  # share that a hypothesis leaves where it explains, where it may
NOISY = 1.3  # and so many times what noise leaves
DOUBT = 2.0  # proof to the contrary that forbids a name
LEAD = 12.0  # the next best hypothesis leaves so many variances more (twice the logarithm of the likelihoods' ratio)
TAUGHT = 0.5  # of what the gain may be off by, where names are compared: one sigma, not the limit of an alarm
PERIODS, SWITCH = 3.0, 5.0  # periods for which a name must be the best; ... where another has been given
LOSS_ADDED = 0.6  # a loss leaves more than this of an added oscillation
LOSS_INSTEAD = 0.2  # ... and of one in place of the command
GOOD, FIRM = 0.06, 6.0  # a hypothesis that leaves less than this, of so many times the noise's energy, is good
SLOW_ONE, SLOW_LEFT = 0.56, 0.3  # a slow one [Hz] is named where the other leaves this share
STAYS, SAME_LEAST = 0.7, 0.6  # an oscillation found stays: least fit over its threshold, and over its amplitude
SAME_HZ = 0.12  # votes agree on the frequency
SHORT_HZ = 7.0  # above it any jolt fills the short window [Hz]
SHORT_RATIO = 1.5  # the short window takes so many thresholds

STATE = [
    ("slow_ratio", "f8", (SLOW_K,)),  # amplitude over its threshold
    ("slow_hit", "f8", (SLOW_K,)),  # windows in a row that show it
    ("sure", "f8", (2,)),  # of added and in place: periods of agreement
    ("clock", "f8"),  # time [s]
    ("declared", "f8"),  # 1 while one of the tests of `iotsekf` declares a fault
    ("rose", "f8"),  # when the alarm rose [s]
    ("vote_hz", "f8", (2,)),  # frequency of the last vote, added and in place [Hz]
    ("vote_first", "f8", (2,)),  # since when votes have agreed [s]
    ("vote_last", "f8", (2,)),  # time of the last [s]
    ("vote_good", "f8", (2,)),  # good ones among them
    ("named", "f8"),  # name of the fault that stands, NONE before there is one
    ("residual", "f8", (2,)),  # what the best window of each leaves, over what there is
    ("r_bank", "f8"),  # largest of the bank over its threshold
    ("fast", "f8"),  # 1 while that is no slow one's shadow at the lower end
    ("opens", "f8"),  # 1 where the valve stands open since a jump
    ("run_side", "f8"),  # sign of the input fault when it was last large
    ("swings", "f8"),  # how often it has been large on the other side since: from twice on it oscillates
]


@kernel
def forget(x, slow):
    """Empty every ring and what was counted in it, the slow ring only where `slow`."""
    sample_rings.empty(x, slow)
    for k in range(bank.K):
        x.ratio[k] = 0.0
        x.hit[k] = 0.0
    if slow:
        for k in range(SLOW_K):
            x.slow_hit[k] = 0.0
    x.r_ofc = 0.0
    for i in range(2):
        x.sure[i] = 0.0
        x.residual[i] = 1.0


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
    step = STEP if x.declared < 0.5 else WIDE
    ff, fd, dd, f0, m0, d0, a, still = sample_rings.tone(x, p, j, n, angle)
    H, W = losses.least(ff, fd, dd, x.gain), max(ff + 2.0 * fd + dd, 0.0)
    L, S = losses.least(f0, m0, d0, x.gain), max(f0 + 2.0 * m0 + d0, 0.0)
    part = p.bank_share + TAUGHT * decision.unlearned(x, p)
    allowed = n * x.noise_scale * x.noise_scale * p.sigma[j] * p.sigma[j] + part * part * dd
    at_L, at_S = 1.0, 1.0
    if H > allowed and (L < 0.7 * H or S < 0.7 * W):
        _, _, _, f1, m1, d1, _, _ = sample_rings.tone(x, p, j, n, angle * (1.0 - step))
        _, _, _, f2, m2, d2, _, _ = sample_rings.tone(x, p, j, n, angle * (1.0 + step))
        at_L += lowest(losses.least(f1, m1, d1, x.gain), L, losses.least(f2, m2, d2, x.gain), step)
        at_S += lowest(f1 + 2.0 * m1 + d1, S, f2 + 2.0 * m2 + d2, step)
        _, _, _, f1, m1, d1, b, _ = sample_rings.tone(x, p, j, n, angle * at_L)
        new = losses.least(f1, m1, d1, x.gain)
        if new < L:
            L, a = new, b
        _, _, _, f1, m1, d1, _, _ = sample_rings.tone(x, p, j, n, angle * at_S)
        S = min(S, max(f1 + 2.0 * m1 + d1, 0.0))
    return H, L, W, S, allowed, at_L, at_S, a, max(H - still, 0.0)


@kernel
def replaced(x, p, j, n, h, hz):
    """Vote for an oscillation in place of the command where w swings about a mean; the command is not obeyed.

    `h` [s] is a sample of the ring. A loss must leave more over.
    """
    angle = 6.283185307179586 * hz * h
    variance = x.noise_scale * x.noise_scale * p.sigma[j] * p.sigma[j]
    M, R, mean = sample_rings.swing(x, j, n, angle)
    x.residual[1] = R / max(M, 1e-300)
    if n * mean * mean > OFFSET * M or (x.clock - x.rose) * hz < BEHIND:
        return False, hz
    m = losses.even_window(n, h)
    if m <= x.even_seen:
        H, E, _ = losses.loss(x, m)
        if E < LOSS_INSTEAD * H:
            return False, hz
    if M < CLEAR * n * variance or R > PART * M + NOISY * n * variance:
        return False, hz
    _, below, _ = sample_rings.swing(x, j, n, angle * (1.0 - WIDE))
    _, above, _ = sample_rings.swing(x, j, n, angle * (1.0 + WIDE))
    move = lowest(below, R, above, WIDE)
    if math.fabs(move) > 0.999 * WIDE:
        return False, hz
    _, R, _ = sample_rings.swing(x, j, n, angle * (1.0 + move))
    hz *= 1.0 + move
    x.residual[1] = R / max(M, 1e-300)
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
    x.residual[0], x.residual[1] = L / H, S / max(min(W, H), 1e-300)
    if H < CLEAR * noise:
        return
    lead = LEAD * variance
    other = 1.0
    m = losses.even_window(n, h)
    if p.load == 2.0 and x.noise_scale < 2.0 and m <= x.even_seen:
        all, E, _ = losses.loss(x, m)
        floor = m * p.sigma[SLOW + 1] * p.sigma[SLOW + 1]
        other = max(E - floor, 0.0) / max(all - floor, 1e-300) if all > 2.0 * floor else 1.0
    yes = x.declared > 0.5 and command_response.present(x)  # before the alarm of the healthy valve
    added = plain and (yes or x.clock - x.rose > ASKED) and other > LOSS_ADDED
    added = added and L <= (PURE_SURE if yes else PURE) * H + NOISY * noise
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
def look(x, p, j, period, hz, h, r, b):
    """Try both windows of an oscillation at `hz`; return (whether one shows, frequency [Hz], amplitude, kind).

    `period` is that of one period in samples of `h` seconds; `r` its amplitude in f over its threshold, `b` in w.
    """
    seen = int(x.slow_seen if j == SLOW else x.bank_seen[j])
    found, at, amplitude = False, 0.0, 0.0
    no = command_response.absent(x)
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
        now = sample_rings.recent(x, j, max(int(part * period + 0.5), 2)) * n / H
        least_r = 1.0 if length == LONG else SHORT_RATIO
        plain = r >= least_r and L <= FAIR * H and now > 0.1
        stands = b >= 1.0 and S <= FAIR * W and S <= FAIR * B and now > 0.03
        if plain or stands:
            found = True
            better = L <= S
            at, amplitude = hz * (at_L if better else at_S), a
        bonus = PERIODS - 0.4 if j == SLOW else PERIODS
        plain, stands = r >= 1.0 and now > 0.1, b >= 1.0 and now > 0.03
        if x.declared > 0.5:  # another frequency's shadow is no vote
            plain = plain and math.fabs(at_L - 1.0) < 0.999 * WIDE
            stands = stands and math.fabs(at_S - 1.0) < 0.999 * WIDE
        compare(x, p, H, L, W, S, B, n, h, allowed / n, hz * at_L, hz * at_S, plain, stands, bonus)
    return found, at, amplitude


@kernel
def search(x, p, renewed, fresh, blocked, teach, other, dt):
    """Look for an oscillation at every frequency whose window was renewed; hold what was found.

    From the first sign on, of which `other` tells that another test sees a fault, a sine in place of the command is
    looked for as well.
    """
    x.clock += dt
    x.ofc_timer = max(x.ofc_timer - dt, 0.0)
    suspected = other or x.ofc_timer > 0.0
    if renewed > 0.5:
        bank_search(x, p, blocked, teach, suspected, dt)
    if fresh >= 2.0 and not blocked:
        for k in range(SLOW_K):
            period = 1.0 / (p.slow_hz[k] * SLOW_S)
            if LONG * period >= x.slow_seen:
                x.slow_hit[k] = 0.0
                continue
            n = int(LONG * period + 0.5)
            _, _, dd, _, _, _, a, _ = sample_rings.tone(x, p, SLOW, min(n, N), 6.283185307179586 / period)
            r = a / (x.noise_scale * p.slow_threshold[k] + decision.share(x, p) * math.sqrt(2.0 * dd / n))
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
            x.ratio[k] = a / (x.noise_scale * p.bank_threshold[k] + part * math.sqrt(bank.mixed(x, k, 0.0, 1.0)))
            if teach and x.ratio[k] < 0.7:
                decision.learn_gain(x, p, k, dt)
        x.r_ofc = max(x.r_ofc, x.ratio[k])
        if x.ratio[k] > most_L:
            most_L, peak_L = x.ratio[k], k
        if suspected:
            b = math.sqrt(bank.mixed(x, k, 1.0, 1.0)) / (x.noise_scale * p.sum_threshold[k])
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
        b = math.sqrt(bank.mixed(x, k, 1.0, 1.0)) / (x.noise_scale * p.sum_threshold[k]) if suspected else 0.0
        found, at, amplitude = look(x, p, j, 1.0 / (p.bank_hz[k] * h), p.bank_hz[k], h, x.ratio[k], b)
        x.hit[k] = x.hit[k] + 1.0 if found else 0.0
        if x.hit[k] >= p.hits:
            x.ofc_timer = p.t_release
            if k == peak_L or k == peak_S:
                if x.ofc_hz == 0.0 or x.declared < 0.5:
                    x.ofc_hz = at
                if math.fabs(at - x.ofc_hz) <= WIDE * x.ofc_hz:  # what passes at another frequency is another's
                    x.ofc_amplitude = amplitude / p.bank_loss[k]
        elif x.declared > 0.5 and x.ofc_timer > 0.0 and stays(x, p, k):
            x.ofc_timer = p.t_release


@kernel
def stays(x, p, k):
    """Tell whether the oscillation that was found is still there at frequency k, as large as it was.

    A manoeuvre leaves so much beside it that no window shows a sine alone; that is no sign that it has ended.
    """
    if x.named == RUNAWAY or x.named == JAM_SOLID:
        return False
    if math.fabs(p.bank_hz[k] - x.ofc_hz) > WIDE * x.ofc_hz or x.ratio[k] < STAYS:
        return False
    a = math.sqrt(bank.mixed(x, k, 1.0, -x.gain))  # `bank.design` has made good what the average loses
    return SAME_LEAST * x.ofc_amplitude < a < x.ofc_amplitude / SAME_LEAST


@kernel
def conclude(x, jam, run):
    """Write `declared`, `verdict` and `culprit` of a hydraulic lane: the name that stands, else the sensor's pair.

    A name is given once, when it is sure; another takes its place only when that has been sure for long, or when the
    valve has been asked and says otherwise. A jam takes the place of any but a runaway.
    """
    x.declared = 1.0 if x.sensor > 0.5 or jam or run or x.ofc_timer > 0.0 else 0.0
    if x.declared < 0.5:
        x.rose = x.clock
        x.verdict, x.culprit, x.named = NONE, 0.0, NONE
        for i in range(2):
            x.sure[i] = 0.0
        return
    if (x.named == OFC_LIQUID and command_response.absent(x)) or (x.named == OFC_SOLID and command_response.present(x)):
        x.named = NONE
    need = PERIODS if x.named == NONE or x.named == RUNAWAY else PERIODS + SWITCH
    if jam and x.named != RUNAWAY:
        x.named = JAM_SOLID
    elif x.named == NONE and run and x.opens > 0.5:
        x.named = RUNAWAY
    elif x.sure[0] >= need:
        x.named = OFC_LIQUID
    elif x.sure[1] >= need:
        x.named = OFC_SOLID
    x.verdict, x.culprit = AMBIGUOUS, 0.0
    if x.named != NONE:  # beside a sensor that is wrong, too: the filter goes on without it
        x.verdict = x.named
    elif x.sensor > 0.5 and (x.blame == 1.0 or (x.blame == 2.0 and x.backlash_suspected < 0.5)):
        x.verdict, x.culprit = SENSOR, x.blame
