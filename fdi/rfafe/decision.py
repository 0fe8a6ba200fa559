"""From the estimates f_hat to an alarm: an oscillation by the frequency bank, anything else by its slow part.

Each estimate goes through the bank beside the command (fdi/common/bank.py) and is judged alone. An oscillation is an
amplitude beyond threshold + share |command| that keeps its phase over both periods and explains its window, of f_hat or
of f_hat + u, for several fits in a row. The slow part must stay beyond its own threshold + share |command| for a
confirmation time.

The bank goes from 0.5 to 10.6 Hz: a slower oscillation is found only by what its slow part exceeds.

While the estimate is not trusted an alarm stands, for T_HOLD at most: so long a restart takes. After the restart an
oscillation has the same time to be found again.

Class. A liquid OFC is f = s(t), a solid one f = s(t) - u, or half of it where it is in one segment of two. With the
sine taken out of both, the regression of f_hat on -u is the share of the command that does not come through: 0, 1/2
or 1. All windows since the alarm count, of either side, each by the error of its share, so that the class is told only
if the command moved otherwise than the fault; what is slow is AMBIGUOUS.
"""

import math

from actuators.block import kernel
from fdi.common import bank
from fdi.common.decision import T_HOLD, confirm
from fdi.common.sinusoid import beside
from fdi.common.verdict import AMBIGUOUS, NONE, OFC_LIQUID, OFC_SOLID

NF = 2  # estimates at most; the command is the bank's signal behind them
# Share of the command midway between a liquid OFC, 0, and a solid one of one segment of two, 1/2; what windows that
# overlap and residues that are no noise make of the variance of their mean; how many of its deviations are beyond
# doubt; what the bank's sine leaves of an oscillation of another frequency or shape, over its amplitude
CENTRE, TAU, SURE, UNLIKE, FULL = 0.25, 0.5, 2.0, 0.05, 12.0
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
    ("tau_energy", "f8", "s"),  # memory of the energies that name the segment
    ("tau_slow", "f8", "s"),  # lag of the slow part
    ("th_static", "f8"),  # slow part [SI unit of f_hat]
    ("static_share", "f8", "-"),  # ... plus this share of the command's deviation
    ("t_static", "f8", "s"),
]
STATE = [
    *bank.state(NF + 1),
    ("slow", "f8", (NF,), "rad"),  # slow part of f_hat [SI unit of f_hat]
    ("hit", "f8", (NF, bank.K), "-"),  # fits in a row that passed
    ("ratio", "f8", (NF, bank.K), "-"),  # fits over their thresholds; below 1 without the shape of an oscillation
    ("r_ofc", "f8", "-"),  # the largest of them
    ("ofc_timer", "f8", (NF,), "s"),  # time for which an oscillation is still held to be there
    ("ofc_class", "f8", "-"),  # its class
    ("moments", "f8", (NF, 6)),
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
        x.ofc_timer[i] = T_HOLD if x.ofc_timer[i] > 0.0 else 0.0
    x.bank_seen[:] = 0.0
    x.hit[:] = 0.0
    x.ratio[:] = 0.0
    x.r = x.r_ofc = 0.0
    x.lost += dt
    if x.lost > T_HOLD:
        x.ofc_timer[:] = 0.0
        x.timer = x.static = x.alarm = x.isolated_part = 0.0
        x.verdict = NONE


@kernel
def decide(x, p, dt):
    """Judge the estimates x.f beside the commands x.u less trim; set r, alarm, verdict, isolated_part."""
    x.lost = 0.0
    still = _slow_parts(x, p, dt)
    command = 0.5 * p.unit * (x.u_late[0] + x.u_late[int(p.nu) - 1])
    if bank.push(x, p, (x.f[0], x.f[1], command)) > 0.5:
        x.r_ofc = 0.0
        for i in range(int(p.nf)):
            _oscillation(x, p, i)
    x.timer, x.static = confirm(x.timer, x.static, still >= 1.0, dt, p.t_static, p.t_release)
    x.r = max(x.r_ofc, still)
    x.isolated_part, x.verdict = 0.0, x.ofc_class
    for i in range(int(p.nf)):
        x.isolated_part += 1.0 + i if x.ofc_timer[i] > 0.0 else 0.0
        x.ofc_timer[i] = max(x.ofc_timer[i] - dt, 0.0)
    if x.isolated_part == 0.0:
        x.verdict, x.isolated_part = (AMBIGUOUS, 1.0 + x.blamed) if x.static > 0.5 else (NONE, 0.0)
    x.alarm = 1.0 if x.isolated_part > 0.0 else 0.0


@kernel
def _slow_parts(x, p, dt):
    """Advance slow parts; return the largest over its threshold."""
    most, worst = 0.0, 0
    for i in range(int(p.nf)):
        x.slow[i] += (1.0 - math.exp(-dt / p.tau_slow)) * (x.f[i] - x.slow[i])
        r = math.fabs(x.slow[i]) / (p.th_static + p.static_share * math.fabs(p.unit * x.u[i]))
        if r > most:
            most, worst = r, i
    if most >= 1.0:  # what passes zero while its alarm is held is not the other one's fault
        x.blamed = worst
    return most


@kernel
def shaped(x, p, i, k, b):
    """Return whether f_hat + b u of estimate i has the shape of an oscillation at frequency k; b = 1 where u is cut off
    (solid)."""
    agreement, purity = bank.character(x, p, k, i, b)
    return agreement >= p.coherence and purity >= p.purity


@kernel
def _oscillation(x, p, i):
    """Test the renewed fits of estimate i; hold an oscillation for `t_release` and name its class."""
    found, best = -1, 0.0
    for k in range(bank.K):
        if x.bank_new[k] > 0.5:
            r = bank.amplitude(x, k, i) / (p.bank_threshold[k] + p.bank_share[k] * bank.amplitude(x, k, NF))
            good = r >= 1.0 and (shaped(x, p, i, k, 0.0) or shaped(x, p, i, k, 1.0))
            x.ratio[i, k] = r if good else min(r, BELOW)
            x.hit[i, k] = x.hit[i, k] + 1.0 if good else 0.0
            if x.hit[i, k] >= p.hits and r > best:
                found, best = k, r
        x.r_ofc = max(x.r_ofc, x.ratio[i, k])
    if found < 0:
        return
    if x.ofc_timer[0] + x.ofc_timer[1] == 0.0:
        x.moments[:] = 0.0
        x.ofc_class = AMBIGUOUS
    x.ofc_timer[i] = p.t_release
    _name(x, p, i, found)


@kernel
def _name(x, p, i, k):
    """Name the class of the oscillation at frequency k by the share of the command that does not come through."""
    if x.hit[i, k] < FULL:
        return
    gather(x, p, i, k)
    share, weight = 0.0, 1e-12
    for j in range(int(p.nf)):
        m = x.moments[j]
        if m[0] <= 0.0:
            continue
        uu, fu, ff = m[5] - m[2] * m[2] / m[0], m[4] - m[1] * m[2] / m[0], m[3] - m[1] * m[1] / m[0]
        if uu <= 0.0:
            continue
        unlike = UNLIKE * bank.amplitude(x, k, j)
        w = uu / (TAU * (max(ff - fu * fu / uu, 0.0) / m[0] + unlike * unlike))
        share += -fu / uu * w
        weight += w
    x.lost_weight, x.lost_share = weight, share / weight
    apart = x.lost_share - CENTRE
    x.ofc_class = OFC_SOLID if apart > 0.0 else OFC_LIQUID
    if math.fabs(apart) < p.margin + SURE / math.sqrt(weight):
        x.ofc_class = AMBIGUOUS


@kernel
def gather(x, p, i, k):
    """Add the full window of frequency k, less its sine, to the moments of estimate i and the command."""
    n, j = int(p.bank_n[k]), int(p.bank_level[k])
    first = (int(x.bank_head[j]) + bank.N - n) % bank.N
    f, u, m = x.bank_ring[i, j], x.bank_ring[NF, j], x.moments[i]
    w = p.bank_stride[k] * p.bank_block[j] * 0.005
    ff, fu, uu = beside(f, u, first, n, p.bank_angle[k])
    for s in range(first, first + n):
        m[1] += w * f[s % bank.N] / n
        m[2] += w * u[s % bank.N] / n
    m[0] += w
    m[3] += w * ff / n
    m[4] += w * fu / n
    m[5] += w * uu / n
