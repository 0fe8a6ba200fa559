"""The decision: alarm where the evidence of a fault passes its threshold, name what leads in the longest window.

    threshold   evidence beyond its limit in any window is an alarm, which stands down to CALM of it and RELEASE_S more
    longest     of the windows that show a fault and have a hypothesis that fits the longest has the most degrees of
                freedom: only its best one may have a name, as in a short window much explains everything
    lead        there, or in a shorter window of the same class and frequency, it leads every other class by SURE, and
                leaves what noise does or a small share of what health leaves; an oscillation of the valve, beside which
                health is open to much, of all there is
    passes      of an oscillation of the valve: it is added where the fast part of the command goes on passing, in place
                of the command where none does (`sums`)
    hold        a lead that the longest window does not bear out before a name is given counts for nothing
    end         a window that showed the fault is silent: all begin anew, and the alarm runs out
"""

import math

from actuators.block import kernel
from fdi.isolation import evidence as ev
from fdi.isolation import sums
from fdi.isolation.filter import N
from fdi.isolation.sums import OCTAVES

# from OPENED on they have no name here
OF_VALVE, WEAK, OF_ROD, OF_SURFACE, OF_PRESSURE, OF_LOAD, FREE_FLOAT, OPENED, GAP, DRIVEN = range(1, 11)
CLASS_OF = (  # of the hypotheses of `evidence`, in their order
    OF_VALVE, OF_VALVE, OF_ROD, OF_SURFACE, OF_PRESSURE, OF_LOAD, WEAK, WEAK, WEAK, WEAK, OF_LOAD, OPENED, FREE_FLOAT,
    GAP, OF_PRESSURE, OF_PRESSURE, DRIVEN, OF_ROD, OF_SURFACE, OF_PRESSURE,
)  # fmt: skip
CALM = 0.35  # of a threshold: down to it an alarm stands
CLEAR = 40.0  # evidence of a plain onset, at which all windows begin anew
RELEASE_S = 1.0  # an alarm outlives its evidence by this [s]
SURE, LEAD = 5.0, 0.05  # odds e^5, and this share of its own evidence: no model is better than that
LEAD_SINE = 0.02  # of added over in place, or the other way round: what their model errs by they have in common
FAIR, PLAIN = 1.1, 0.08  # a hypothesis fits that leaves so many times the noise, or this share of what health leaves
PART = 0.75  # of its period that an oscillation has lasted: before, it is a step
SILENT_PART, SILENT_S = 0.4, 0.4  # of an oscillation's period; of any other fault [s]
AGAINST = -2.0  # evidence of a loss that is no longer there
OUTSIDE = 6.0  # standard deviations of the tolerances: beyond, the model is another actuator's
UNTAUGHT = 1.5  # thresholds that evidence for other than an oscillation must pass in the first seconds

STATE = [
    ("own", "f8", (OCTAVES,)),  # evidence of the best hypothesis of every octave at its last evaluation
    ("own_ratio", "f8", (OCTAVES,), "-"),  # largest evidence over its threshold
    ("own_class", "f8", (OCTAVES,)),
    ("own_fault", "f8", (OCTAVES,)),  # its hypothesis
    ("own_lead", "f8", (OCTAVES,)),
    ("own_fits", "f8", (OCTAVES,)),
    ("own_added", "f8", (OCTAVES,)),  # lead of an oscillation that is added over one in place, below 0: the other way
    ("own_hz", "f8", (OCTAVES,), "Hz"),  # of an oscillation, else 0
    ("loud", "f8", (OCTAVES,)),  # largest ratio that it had
    ("evidence", "f8", "-"),  # largest evidence over its threshold
    ("evidence_timer", "f8", "s"),  # until the alarm of the evidence ends
    ("alarm_s", "f8", "s"),  # for which any alarm has stood
    ("emptied", "f8"),  # 1 once the windows were emptied at this alarm's onset
    ("likely", "f8", "-"),  # class that leads, or last did: the one named, once the longest window shows another
    ("named", "f8", "-"),  # class of the verdict that stands
    ("likely_fault", "f8"),  # hypothesis
    ("likely_hz", "f8", "Hz"),
    ("likely_added", "f8"),  # own_added of the longest window that tells it, kept while none does
    ("named_fault", "f8"),
    ("named_hz", "f8", "Hz"),
]


@kernel
def compare(x, p, o):
    """Keep the best hypothesis of octave `o`, its lead over other classes, and the largest evidence over threshold."""
    best, other, ratio, first = 0, 0.0, 0.0, x.blocks <= sums.FIRST
    for h in range(ev.HYPOTHESES):
        if not (first and h >= ev.NOISE_ROD):
            ratio = max(ratio, x.ev[h] / (p.limit[h] * (UNTAUGHT if first and h >= ev.SWINGS else 1.0)))
        best = h if x.ev[h] > x.ev[best] else best
    for h in range(ev.HYPOTHESES):
        other = max(other, x.ev[h] if CLASS_OF[h] != CLASS_OF[best] else 0.0)
    x.own[o], x.own_ratio[o], x.own_class[o], x.own_fault[o] = x.ev[best], ratio, CLASS_OF[best], best
    x.own_lead[o], x.own_hz[o] = x.ev[best] - other, x.ev_hz[best] if best < ev.SWINGS else 0.0
    added = x.ev[ev.ADDED] - x.ev[ev.IN_PLACE]
    x.own_added[o] = added if best <= ev.IN_PLACE and math.fabs(added) > max(SURE, LEAD_SINE * x.own[o]) else 0.0
    n, Q, Q0 = x.ev_n, x.ev_Q[best], x.ev_E if best <= ev.IN_PLACE else x.ev_Q[ev.HYPOTHESES]
    x.own_fits[o] = 1.0 if Q < FAIR * n + ev.BELOW * math.sqrt(2.0 * n) or Q - n < PLAIN * (Q0 - n) else 0.0


@kernel
def forget(x):
    """Forget what windows showed: they begin anew."""
    x.own[:] = x.own_ratio[:] = x.own_class[:] = x.own_fits[:] = x.own_added[:] = x.loud[:] = 0.0


@kernel
def inside(x, p):
    """Return whether what the flight has taught is within OUTSIDE of the tolerances."""
    for i in range(N):
        if math.fabs(x.mu[i] - p.prior_mean[i]) > OUTSIDE * p.prior_sd[i]:
            return False
    return True


@kernel
def healed(x, p, o, dt):
    """Return whether octave `o`, which showed a fault, shows none over what it takes to show."""
    x.loud[o] = max(x.loud[o], x.own_ratio[o])
    loss = x.likely == WEAK or x.likely == FREE_FLOAT  # shows only while the valve has a command
    if x.own_ratio[o] >= CALM or x.loud[o] < 1.0 or (loss and x.ev[int(x.likely_fault)] > AGAINST):
        return False
    return x.window_age[o] * p.block * dt > (SILENT_PART / x.likely_hz if x.likely_hz > 0.0 else SILENT_S)


@kernel
def nominate(x):
    """Keep the class that leads in the longest window, or in a shorter one where no longer one has another class or an
    oscillation of a lower octave, until the longest shows another; its frequency is that of the longest window."""
    top = -1
    for o in range(OCTAVES):
        top = o if x.own_ratio[o] >= 1.0 and x.own_fits[o] > 0.5 else top
    if top >= 0 and x.own_class[top] != x.likely:
        x.likely, x.likely_fault, x.likely_hz = x.named, x.named_fault, x.named_hz
    elif top >= 0:
        x.likely_hz = x.own_hz[top]
    for o in range(top, -1, -1):
        found, hz, lead = x.own_class[o], x.own_hz[o], 0.0 if x.own_class[o] == OF_LOAD else LEAD * x.own[o]
        shows = x.own_ratio[o] >= 1.0
        if shows and (found != x.own_class[top] or hz > 2.0 * x.own_hz[top] > 0.0):
            return
        if shows and x.own_fits[o] > 0.5 and x.own_lead[o] > max(SURE, lead):
            for shorter in range(o + 1):
                x.likely_added = x.own_added[shorter] if x.own_added[shorter] != 0.0 else x.likely_added
            if found < OPENED and (found == OF_LOAD or hz == 0.0 or x.alarm_s * hz >= PART):
                x.likely, x.likely_fault, x.likely_hz = found, x.own_fault[o], hz
            return


@kernel
def judge(x, p, o, dt):
    """Take the evaluation of octave `o`; return whether all windows are to begin anew."""
    compare(x, p, o)
    x.evidence = 0.0
    for i in range(OCTAVES):
        x.evidence = max(x.evidence, x.own_ratio[i])
    stands = x.evidence_timer > 0.0
    if x.own_ratio[o] >= CALM:
        x.since = 0.0
    if x.own_ratio[o] >= (CALM if stands else 1.0) and (stands or inside(x, p)):
        x.evidence_timer = RELEASE_S
    nominate(x)
    if x.own[o] > CLEAR and x.own_ratio[o] >= 1.0 and x.emptied < 0.5:
        x.emptied = 1.0
        return True
    return x.evidence_timer > 0.0 and healed(x, p, o, dt)
