"""From the estimates f_hat to an alarm: an oscillation by the frequency bank, anything else by its slow part.

Each estimate goes through the bank beside the command (fdi/common/bank.py) and is judged alone. An oscillation is an
amplitude beyond threshold + share |command| that keeps its phase over both periods and explains its window, of f_hat or
of f_hat + u, for several fits in a row. The slow part must stay beyond its own threshold + share |command| for a
confirmation time.

The bank goes from 0.5 to 10.6 Hz: a slower oscillation is found only by what its slow part exceeds.

While the estimate is not trusted an alarm stands, for T_HOLD at most: so long a restart takes. After the restart an
oscillation has the same time to be found again.

The class is left open here, and so is what is slow (fdi/rfafe/segments.py).
"""

import math

from actuators.block import kernel
from fdi.common import bank
from fdi.common.decision import T_HOLD, confirm
from fdi.common.verdict import AMBIGUOUS, NONE

NF = 2  # estimates at most; the command is the bank's signal behind them
BELOW = 0.99  # r of a fit beyond its threshold that is no oscillation

PARAMS = [
    *bank.PARAMS,
    ("bank_threshold", "f8", (bank.K,)),  # amplitude of f_hat in health [SI unit of f_hat]
    ("bank_share", "f8", (bank.K,), "-"),  # ... plus this share of the command's amplitude
    ("coherence", "f8", "-"),  # least agreement of the two periods
    ("purity", "f8", "-"),  # least share of the window's power that the oscillation explains
    ("hits", "f8", "-"),  # fits in a row that must pass
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
    ("ofc_hz", "f8", (NF,), "Hz"),  # its frequency in the bank
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
    for i in range(int(p.nf)):
        x.ofc_timer[i] = max(x.ofc_timer[i] - dt, 0.0)
    command = 0.5 * p.unit * (x.u_late[0] + x.u_late[int(p.nu) - 1])
    if bank.push(x, p, (x.f[0], x.f[1], command)) > 0.5:
        x.r_ofc = 0.0
        for i in range(int(p.nf)):
            _oscillation(x, p, i)
    x.timer, x.static = confirm(x.timer, x.static, still >= 1.0, dt, p.t_static, p.t_release)
    x.r = max(x.r_ofc, still)
    x.isolated_part = 0.0
    for i in range(int(p.nf)):
        x.isolated_part += 1.0 + i if x.ofc_timer[i] > 0.0 else 0.0
    if x.isolated_part == 0.0 and x.static > 0.5:
        x.isolated_part = 1.0 + x.blamed
    x.alarm, x.verdict = (1.0, AMBIGUOUS) if x.isolated_part > 0.0 else (0.0, NONE)


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
def _oscillation(x, p, i):
    """Test the renewed fits of estimate i; hold an oscillation for `t_release`."""
    found, best = -1, 0.0
    for k in range(bank.K):
        if x.bank_new[k] > 0.5:
            r = bank.amplitude(x, k, i) / (p.bank_threshold[k] + p.bank_share[k] * bank.amplitude(x, k, NF))
            # of f_hat, or of f_hat + u where the command is cut off (solid)
            good = r >= 1.0 and (bank.shaped(x, p, k, i, 0.0) or bank.shaped(x, p, k, i, 1.0))
            x.ratio[i, k] = r if good else min(r, BELOW)
            x.hit[i, k] = x.hit[i, k] + 1.0 if good else 0.0
            if x.hit[i, k] >= p.hits and r > best:
                found, best = k, r
        x.r_ofc = max(x.r_ofc, x.ratio[i, k])
    if found < 0:
        return
    x.ofc_timer[i], x.ofc_hz[i] = p.t_release, p.bank_hz[found]
