"""From the estimate f_hat to an alarm: an oscillation by the frequency bank, anything else by its slow part.

Of several estimates the one with the most energy lately is suspect, and only it goes through the bank: f_hat beside the
command (fdi/common/bank.py). An oscillation is an amplitude beyond threshold + share |command| that keeps its phase
over both periods and explains its window, of f_hat or of f_hat + u, for several fits in a row. The slow part must stay
beyond its own threshold + share |command| for a confirmation time.

The bank goes from 0.5 to 10.6 Hz: a slower oscillation is found only by what its slow part exceeds. The other side is
declared with the suspect (`both`) when its own amplitude is beyond the same threshold and SECOND of the suspect's.

While the estimate is not trusted an alarm stands, for T_HOLD at most: so long a restart takes. After the restart an
oscillation has the same time to be found again.

Class. A liquid OFC is f = s(t), a solid one f = s(t) - u, or half of it where it is in one segment of two. With the
sine taken out of both, the regression of f_hat on -u is the share of the command that does not come through: 0, 1/2
or 1. All windows since the alarm count, each by the error of its share, so that the class is told only if the command
moved otherwise than the fault; what is slow is AMBIGUOUS. A class is withdrawn when the share has come to lie on the
other's side.
"""

import math

from actuators.block import kernel
from fdi.common import bank
from fdi.common.decision import T_HOLD, confirm
from fdi.common.sinusoid import beside
from fdi.common.verdict import AMBIGUOUS, NONE, OFC_LIQUID, OFC_SOLID

NF = 2  # estimates at most
SECOND = 0.4  # of the suspect's amplitude: from there on the other side oscillates as well
# share of the command midway between a liquid OFC, 0, and a solid one of one segment of two, 1/2; what windows that
# overlap and residues that are no noise make of the variance of their mean; how many of its deviations are beyond doubt
CENTRE, ALIKE, SURE = 0.25, 8.0, 2.0
BELOW = 0.99  # r of a fit beyond its threshold that is no oscillation

PARAMS = [
    *bank.PARAMS,
    ("bank_threshold", "f8", (bank.K,)),  # amplitude of f_hat in health [SI unit of f_hat]
    ("bank_share", "f8", (bank.K,), "-"),  # ... plus this share of the command's amplitude
    ("coherence", "f8", "-"),  # least agreement of the two periods
    ("purity", "f8", "-"),  # least share of the window's power that the oscillation explains
    ("hits", "f8", "-"),  # fits in a row that must pass
    ("margin", "f8", "-"),  # how far from CENTRE the share of the command names the class, beyond its error
    ("t_release", "f8", "s"),  # an alarm outlives its cause by this
    ("tau_energy", "f8", "s"),  # memory of the energy that makes an estimate suspect
    ("tau_slow", "f8", "s"),  # lag of the slow part
    ("th_static", "f8"),  # slow part [SI unit of f_hat]
    ("static_share", "f8", "-"),  # ... plus this share of the command's deviation
    ("t_static", "f8", "s"),
]
STATE = [
    *bank.STATE,
    ("slow", "f8", (NF,), "rad"),  # slow part of f_hat [SI unit of f_hat]
    ("energy", "f8", (NF,), "rad2"),  # mean square of the rest
    ("suspect", "f8", "-"),  # index of the estimate in the bank
    ("hit", "f8", (bank.K,), "-"),  # fits in a row that passed
    ("r_ofc", "f8", "-"),  # largest fit over its threshold; below 1 without the shape of an oscillation
    ("ofc_timer", "f8", "s"),  # time for which an oscillation is still held to be there
    ("ofc_class", "f8", "-"),  # its class
    ("most", "f8", "rad"),  # its threshold
    ("both", "f8", "-"),  # 1 while the other estimate oscillates beyond it as well
    ("lost_weight", "f8", "-"),  # sum of the weights of the windows so far
    ("lost_share", "f8", "-"),  # share of the command that does not come through, their mean
    ("timer", "f8", "s"),  # confirmation of the slow test
    ("static", "f8", "-"),  # its alarm
    ("blamed", "f8", "-"),  # index of the estimate that was last beyond it
    ("lost", "f8", "s"),  # time since the estimate was last trusted
]


@kernel
def forget(x, p, dt):
    """Empty the bank while the estimate is not trusted; its slow part goes on, so that one bad sample is no step."""
    for i in range(int(p.nf)):
        x.slow[i] += (1.0 - math.exp(-dt / p.tau_slow)) * (x.f[i] - x.slow[i])
        x.energy[i] = 0.0
    _clear(x)
    x.r = x.r_ofc = 0.0
    x.lost += dt
    if x.lost > T_HOLD:
        x.ofc_timer = x.timer = x.static = 0.0
        x.alarm = x.isolated_part = x.both = 0.0
        x.verdict = NONE


@kernel
def _clear(x):
    """Empty the bank."""
    x.bank_seen[:] = 0.0
    x.hit[:] = 0.0


@kernel
def decide(x, p, dt):
    """Judge the estimates x.f beside the commands x.u less trim; set r, alarm, verdict, isolated_part."""
    if x.lost > 0.0 and x.ofc_timer > 0.0:
        x.ofc_timer = max(x.ofc_timer, T_HOLD)
    x.lost = 0.0
    still = _slow_parts(x, p, dt)
    suspect = int(x.suspect)
    renewed = bank.push(x, p, x.f[suspect], p.unit * x.u[min(suspect, int(p.nu) - 1)])
    x.ofc_timer = max(x.ofc_timer - dt, 0.0)
    if renewed > 0.5:
        _oscillation(x, p)
    x.timer, x.static = confirm(x.timer, x.static, still >= 1.0, dt, p.t_static, p.t_release)
    oscillates = x.ofc_timer > 0.0
    x.both = (1.0 if _other_side(x, p, suspect) else x.both) if oscillates else 0.0
    x.r = max(x.r_ofc, still)
    x.alarm = 1.0 if oscillates or x.static > 0.5 else 0.0
    if x.alarm < 0.5:
        x.verdict, x.isolated_part = NONE, 0.0
        return
    x.verdict = x.ofc_class if oscillates else AMBIGUOUS
    x.isolated_part = 3.0 if x.both > 0.5 else 1.0 + (suspect if oscillates else x.blamed)


@kernel
def _other_side(x, p, suspect):
    """Return whether the side that is not the suspect oscillates as well."""
    other = x.energy[1 - suspect]
    least = max(SECOND * SECOND * x.energy[suspect], 0.5 * x.most * x.most)
    return p.nf > 1.0 and other >= least


@kernel
def _slow_parts(x, p, dt):
    """Advance slow parts, energies and the suspect; return the largest slow part over its threshold."""
    a, b = 1.0 - math.exp(-dt / p.tau_slow), 1.0 - math.exp(-dt / p.tau_energy)
    most, worst, suspect = 0.0, 0, int(x.suspect)
    for i in range(int(p.nf)):
        x.slow[i] += a * (x.f[i] - x.slow[i])
        e = x.f[i] - x.slow[i]
        x.energy[i] += b * (e * e - x.energy[i])
        command = math.fabs(p.unit * x.u[min(i, int(p.nu) - 1)])
        r = math.fabs(x.slow[i]) / (p.th_static + p.static_share * command)
        if r > most:
            most, worst = r, i
    for i in range(int(p.nf)):
        if x.energy[i] > 4.0 * x.energy[suspect]:  # twice the amplitude: noise alone does not change it
            suspect = i
    if suspect != int(x.suspect):
        x.suspect = suspect
        _clear(x)
    if most >= 1.0:  # what passes zero while its alarm is held is not the other one's fault
        x.blamed = worst
    return most


@kernel
def shaped(x, p, k, b):
    """Return whether f_hat + b u has the shape of an oscillation at frequency k; b = 1 where u is cut off (solid)."""
    agreement, purity = bank.character(x, p, k, 1.0, b)
    return agreement >= p.coherence and purity >= p.purity


@kernel
def _oscillation(x, p):
    """Test the renewed fits; hold an oscillation for `t_release` and name its class."""
    x.r_ofc = 0.0
    found, best, level = -1, 0.0, 0.0
    for k in range(bank.K):
        if x.bank_seen[int(p.bank_level[k])] <= p.bank_n[k]:
            continue  # its window is not full since the start
        most = p.bank_threshold[k] + p.bank_share[k] * math.sqrt(bank.mixed(x, k, 0.0, 1.0))
        r = math.sqrt(bank.mixed(x, k, 1.0, 0.0)) / most
        good = r >= 1.0 and (shaped(x, p, k, 0.0) or shaped(x, p, k, 1.0))
        x.r_ofc = max(x.r_ofc, r if good else min(r, BELOW))
        if x.bank_new[k] < 0.5:
            continue
        x.hit[k] = x.hit[k] + 1.0 if good else 0.0
        if x.hit[k] >= p.hits and r > best:
            found, best, level = k, r, most
    if found < 0:
        return
    if x.ofc_timer == 0.0:
        x.ofc_class, x.lost_weight = AMBIGUOUS, 0.0
    x.ofc_timer, x.most = p.t_release, level
    _name(x, p, found)


@kernel
def _name(x, p, k):
    """Name the class of the oscillation at frequency k by the share of the command that does not come through."""
    share, weight = missing(x, p, k)
    x.lost_weight += weight
    if weight > 0.0:
        x.lost_share += (share - x.lost_share) * weight / x.lost_weight
    apart = x.lost_share - CENTRE
    says = OFC_SOLID if apart > 0.0 else OFC_LIQUID
    if x.lost_weight > 0.0 and math.fabs(apart) > p.margin + SURE * math.sqrt(ALIKE / x.lost_weight):
        x.ofc_class = says  # kept while the share lies on its side
    elif x.ofc_class != says:
        x.ofc_class = AMBIGUOUS


@kernel
def missing(x, p, k):
    """Return (share of the command that does not come through, 1 / its variance) by the full window of frequency k."""
    n, j = int(p.bank_n[k]), int(p.bank_level[k])
    first = (int(x.bank_head[j]) + bank.N - n) % bank.N
    f, u = x.bank_ring[0, j], x.bank_ring[1, j]
    ff, fu, uu = beside(f, u, first, n, p.bank_angle[k])
    f1, u1 = 0.0, 0.0
    for m in range(first, first + n):
        f1 += f[m % bank.N] / n
        u1 += u[m % bank.N] / n
    ff, fu, uu = ff - n * f1 * f1, fu - n * f1 * u1, uu - n * u1 * u1  # of two periods the mean is beside the sine
    if uu <= 0.0:
        return 0.0, 0.0
    left = max(ff - fu * fu / uu, 0.01 * ff) / (n - 2.0)
    return -fu / uu, uu / left if left > 0.0 else 0.0
