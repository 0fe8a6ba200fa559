"""From the estimate f_hat to an alarm: an oscillation by the frequency bank, anything else by its slow part.

Of several estimates the one with the most energy lately is suspect, and only it goes through the bank: f_hat beside the
command (fdi/common/bank.py). An oscillation is an amplitude beyond threshold + share |command| that keeps its phase
over both periods and explains its window, of f_hat or of f_hat + u, for several fits in a row. The slow part must stay
beyond its own threshold + share |command| for a confirmation time. Where f_hat is corrected (fdi/rfafe/correction.py),
thresholds grow with what the correction may be wrong by and with gusts.

The bank goes from 0.5 to 10.6 Hz: a slower oscillation is found only by what its slow part exceeds. When both sides
oscillate, the one with more energy is the suspect; the other is declared with it (`both`) when its own amplitude is
beyond the same threshold. While it is not, but more than SECOND of the suspect's, it is open whether one side
oscillates or both, and the name is AMBIGUOUS.

While the estimate is not trusted an alarm stands, for T_HOLD at most: so long a restart takes. After the restart an
oscillation has the same time to be found again.

Class. A liquid OFC is f = s(t), a solid one f = s(t) - u, or half of it where it is in one segment of two. With the
sine taken out of both, the regression of f_hat on -u is the share of the command that does not come through: 0, 1/2
or 1. All windows since the alarm count, each by the error of its share, so that the class is told only if the command
moved otherwise than the fault. From FAST on the sine is not taken out, but averaged away: two periods are too short for
a command to move in; of that longer window only what came after the oscillation was found counts. A servo that a fast
liquid OFC drives far beyond its rate limit loses a share of its command as well, of one segment of two up to the half
that a solid one takes: such a share is AMBIGUOUS, as is what is slow. A class is withdrawn when the share has come to
lie on the other's side.
"""

import math
from typing import Any

from actuators.block import kernel
from fdi.common import bank
from fdi.common.decision import T_HOLD, confirm
from fdi.common.verdict import AMBIGUOUS, NONE, OFC_LIQUID, OFC_SOLID

SECOND = 0.4  # of the suspect's amplitude: from there on the other side oscillates as well
# share of the command midway between a liquid OFC, 0, and a solid one of one segment of two, 1/2; what windows that
# overlap and residues that are no noise make of the variance of their mean; how many of its deviations are beyond doubt
CENTRE, ALIKE, SURE = 0.25, 8.0, 2.0
LEAST_SHARE = -0.32  # no fault gives the command back: further below the share of either class nothing is understood
FAST, FAST_N, FAST_S, LEAST = 5.5, 14, 0.1, 5  # [Hz]; samples of 0.1 s then; fewer tell no share
BEYOND = 3.0  # times its rate limit: at the limit a servo then makes a triangle half as large as its command
LOADED = (0.2, 0.75)  # share that a liquid OFC may take from it then, and a solid one of one segment takes
STAYS, SAME_LEAST = 0.7, 0.6  # an oscillation found stays: least fit over its threshold, and over its amplitude
BELOW = 0.99  # r of a fit beyond its threshold that is no oscillation

PARAMS = [
    *bank.PARAMS,
    ("bank_threshold", "f8", (bank.K,)),  # amplitude of f_hat in health [SI unit of f_hat]
    ("bank_share", "f8", (bank.K,), "-"),  # ... plus this share of the command's amplitude
    ("bank_doubt", "f8", (bank.K,), "-"),  # ... of what the correction may be wrong by (fdi/rfafe/correction.py)
    ("bank_stir", "f8", (bank.K,), "-"),  # ... of the rms of the angle of attack
    ("bank_floor", "f8", (bank.K,)),  # and at least this: what the servos' friction makes in still air
    ("coherence", "f8", "-"),  # least agreement of the two periods
    ("purity", "f8", "-"),  # least share of the window's power that the oscillation explains
    ("hits", "f8", "-"),  # fits in a row that must pass
    ("margin", "f8", "-"),  # how far from CENTRE the share of the command names the class, beyond its error
    ("t_release", "f8", "s"),  # an alarm outlives its cause by this
    ("tau_energy", "f8", "s"),  # memory of the energy that makes an estimate suspect
    ("tau_slow", "f8", "s"),  # lag of the slow part
    ("th_static", "f8"),  # slow part [SI unit of f_hat]
    ("static_share", "f8", "-"),  # ... plus this share of the command's deviation
    ("static_away", "f8", "-"),  # ... and of the angle of attack's distance from where the correction was learned
    ("t_static", "f8", "s"),
]


def state(faults: Any) -> list[Any]:
    """Return the STATE fields for `faults` estimates."""
    return [
        *bank.STATE,
        ("slow", "f8", (faults,), "rad"),  # slow part of f_hat [SI unit of f_hat]
        ("energy", "f8", (faults,), "rad2"),  # mean square of the rest
        ("suspect", "f8", "-"),  # index of the estimate in the bank
        ("hit", "f8", (bank.K,), "-"),  # fits in a row that passed
        ("r_ofc", "f8", "-"),  # largest fit over its threshold; below 1 without the shape of an oscillation
        ("ofc_timer", "f8", "s"),  # time for which an oscillation is still held to be there
        ("ofc_age", "f8", "s"),  # since it was found, pauses of up to T_HOLD counted in
        ("ofc_gone", "f8", "s"),  # of the pause
        ("ofc_class", "f8", "-"),  # its class
        ("most", "f8", "rad"),  # its threshold
        ("found_k", "f8", "-"),  # its place in the bank
        ("found_a", "f8", "rad"),  # its amplitude
        ("other", "f8", "-"),  # 1 while the other estimate swings as well, but within it: one side or both
        ("both", "f8", "-"),  # 1 while the other estimate oscillates beyond it as well
        ("lost_weight", "f8", "-"),  # sum of the weights of the windows so far
        ("lost_share", "f8", "-"),  # share of the command that does not come through, their mean
        ("timer", "f8", "s"),  # confirmation of the slow test
        ("static", "f8", "-"),  # its alarm
        ("blamed", "f8", "-"),  # index of the estimate that was last beyond it
        ("lost", "f8", "s"),  # time since the estimate was last trusted
    ]


@kernel
def forget(x, p, f, nf, dt):
    """Empty the bank while the estimate is not trusted; its slow part goes on, so that one bad sample is no step."""
    for i in range(nf):
        x.slow[i] += (1.0 - math.exp(-dt / p.tau_slow)) * (f[i] - x.slow[i])
        x.energy[i] = 0.0
    clear(x)
    x.r = 0.0
    x.r_ofc = 0.0
    x.lost += dt
    if x.lost > T_HOLD:
        x.ofc_timer, x.ofc_age, x.ofc_gone, x.timer, x.static = 0.0, 0.0, 0.0, 0.0, 0.0
        x.alarm, x.verdict, x.culprit, x.both = 0.0, NONE, 0.0, 0.0


@kernel
def clear(x):
    """Empty the bank."""
    for j in range(bank.LEVELS):
        x.bank_seen[j] = 0.0
    for k in range(bank.K):
        x.hit[k] = 0.0


@kernel
def decide(x, p, f, u, nf, nu, dt):
    """Judge the estimates f (nf,) beside the commands u (nu,), in SI less trim; set r, alarm, verdict, culprit."""
    a, b = 1.0 - math.exp(-dt / p.tau_slow), 1.0 - math.exp(-dt / p.tau_energy)
    if x.lost > 0.0 and x.ofc_timer > 0.0:
        x.ofc_timer = max(x.ofc_timer, T_HOLD)
    x.lost = 0.0
    still = 0.0
    worst = 0
    for i in range(nf):
        x.slow[i] += a * (f[i] - x.slow[i])
        e = f[i] - x.slow[i]
        x.energy[i] += b * (e * e - x.energy[i])
        r = x.slow[i] / (p.th_static + p.static_share * math.fabs(u[min(i, nu - 1)]) + p.static_away * x.away)
        if math.fabs(r) > math.fabs(still):
            still = r
            worst = i
    suspect = int(x.suspect)
    for i in range(nf):
        if x.energy[i] > 4.0 * x.energy[suspect]:  # twice the amplitude: noise alone does not change it
            suspect = i
    if suspect != int(x.suspect):
        x.suspect = suspect
        clear(x)
    renewed = bank.push(x, p, f[suspect], u[min(suspect, nu - 1)])
    x.ofc_timer = max(x.ofc_timer - dt, 0.0)
    x.ofc_gone = 0.0 if x.ofc_timer > 0.0 else x.ofc_gone + dt
    x.ofc_age = x.ofc_age + dt if x.ofc_gone < T_HOLD and (x.ofc_age > 0.0 or x.ofc_timer > 0.0) else 0.0
    if renewed > 0.5:
        oscillation(x, p)
    if math.fabs(still) >= 1.0:  # what passes zero while its alarm is held is not the other one's fault
        x.blamed = worst
    x.timer, x.static = confirm(x.timer, x.static, math.fabs(still) >= 1.0, dt, p.t_static, p.t_release)
    ofc = x.ofc_timer > 0.0
    if not ofc:
        x.both, x.other = 0.0, 0.0
    elif nf > 1:
        other = 2.0 * x.energy[1 - suspect]
        alike = other >= SECOND * SECOND * 2.0 * x.energy[suspect]
        x.both = 1.0 if alike and other >= x.most * x.most else x.both
        x.other = 1.0 if alike and x.both < 0.5 else 0.0
    x.r = max(x.r_ofc, math.fabs(still))
    x.alarm = 1.0 if ofc or x.static > 0.5 else 0.0
    if x.alarm < 0.5:
        x.verdict, x.culprit = NONE, 0.0
    else:
        x.verdict = x.ofc_class if ofc and x.other < 0.5 else AMBIGUOUS
        x.culprit = 1.0 + (suspect if ofc else x.blamed)


@kernel
def shaped(x, p, k, b):
    """Return whether f_hat + b u has the shape of an oscillation at frequency k; b = 1 where u is cut off (solid)."""
    agreement, purity, _ = bank.character(x, p, k, 1.0, b)
    return agreement >= p.coherence and purity >= p.purity


@kernel
def oscillation(x, p):
    """Test the renewed fits; hold an oscillation for `t_release` and name its class."""
    x.r_ofc = 0.0
    found, best, level = -1, 0.0, 0.0
    doubt, stir = math.sqrt(x.doubt), math.sqrt(x.stir)
    for k in range(bank.K):
        if x.bank_seen[int(p.bank_level[k])] <= p.bank_n[k]:
            continue  # its window is not full since the start
        most = p.bank_threshold[k] + p.bank_share[k] * math.sqrt(bank.mixed(x, k, 0.0, 1.0))
        most = max(most + p.bank_doubt[k] * doubt + p.bank_stir[k] * stir, p.bank_floor[k])
        r = math.sqrt(bank.mixed(x, k, 1.0, 0.0)) / most
        good = r >= 1.0 and (shaped(x, p, k, 0.0) or shaped(x, p, k, 1.0))
        x.r_ofc = max(x.r_ofc, r if good else min(r, BELOW))
        if x.bank_new[k] < 0.5:
            continue
        x.hit[k] = x.hit[k] + 1.0 if good else 0.0
        if x.hit[k] >= p.hits and r > best:
            found, best, level = k, r, most
        # a manoeuvre leaves so much beside it that it explains no window: that is no sign that it has ended
        alike = SAME_LEAST * x.found_a < r * most < x.found_a / SAME_LEAST
        if x.ofc_timer > 0.0 and k == x.found_k and r >= STAYS and alike:
            x.ofc_timer = p.t_release
    if found < 0:
        return
    if x.ofc_timer == 0.0:
        x.ofc_class = AMBIGUOUS
        x.lost_weight = 0.0
    x.ofc_timer, x.most, x.found_k, x.found_a = p.t_release, level, found, best * level
    share, weight = missing(x, p, found, x.ofc_age)
    x.lost_weight += weight
    if weight > 0.0:
        x.lost_share += (share - x.lost_share) * weight / x.lost_weight
    apart = x.lost_share - CENTRE
    says = OFC_SOLID if apart > 0.0 else OFC_LIQUID
    sane = x.lost_share > LEAST_SHARE
    if sane and x.lost_weight > 0.0 and math.fabs(apart) > p.margin + SURE * math.sqrt(ALIKE / x.lost_weight):
        x.ofc_class = says  # kept while the share lies on its side
    elif x.ofc_class != says or not sane:
        x.ofc_class = AMBIGUOUS
    # of one segment of two, whose amplitude is twice that of its side
    rate = 2.0 * math.sqrt(bank.mixed(x, found, 1.0, 0.0)) * 6.283185307179586 * p.bank_hz[found]
    if rate > BEYOND * p.act_rate * p.unit > 0.0 and LOADED[0] < x.lost_share < LOADED[1]:
        x.ofc_class = AMBIGUOUS


@kernel
def missing(x, p, k, age):
    """Return (share of the command that does not come through, 1 / its variance) by the window of frequency k.

    `age` is how long ago the oscillation was found [s]: what the long window of a fast one holds of the time before is
    of a healthy actuator, which loses nothing.
    """
    fast = p.bank_hz[k] > FAST
    n, j = (FAST_N, bank.LEVELS - 1) if fast else (int(p.bank_n[k]), int(p.bank_level[k]))
    if fast:
        n = min(n, int(age / FAST_S + 1e-6))
    if x.bank_seen[j] <= n or n < LEAST:
        return 0.0, 0.0
    i = int(x.bank_head[j]) - n
    if i < 0:
        i += bank.N
    loss = 0.0 if fast else p.bank_loss[k]
    turn_c, turn_s = math.cos(p.bank_angle[k]), math.sin(p.bank_angle[k])
    first = -0.5 * (n - 1) * p.bank_angle[k]
    c, s = math.cos(first), math.sin(first)
    f1, u1, ff, fu, uu = 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(n):
        f = x.bank_ring[0, j, i] - loss * (x.bank_cos[0, k] * c + x.bank_sin[0, k] * s)
        u = x.bank_ring[1, j, i] - loss * (x.bank_cos[1, k] * c + x.bank_sin[1, k] * s)
        f1 += f
        u1 += u
        ff += f * f
        fu += f * u
        uu += u * u
        i = 0 if i == bank.N - 1 else i + 1
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s
    ff -= f1 * f1 / n
    fu -= f1 * u1 / n
    uu -= u1 * u1 / n
    if uu <= 0.0:
        return 0.0, 0.0
    left = max(ff - fu * fu / uu, 0.01 * ff) / (n - 2.0)
    return -fu / uu, uu / left if left > 0.0 else 0.0
