"""The decision: alarm where the evidence of a fault passes its threshold, name what leads in the longest window.

    threshold   evidence beyond its limit in any window is an alarm, which stands down to CALM of it and RELEASE_S more
    longest     of the windows that show a fault the longest has the most degrees of freedom: only its best hypothesis
                may have a name, as in a short window much explains everything
    lead        there, or in a shorter window of the same class, it leads every other class by SURE, and leaves what
                noise does or a small share of what health leaves
    hold        it has done so for HELD_S, an oscillation for PART of its period
    end         windows that showed the fault are silent: all begin anew, and the alarm runs out
"""

import math

from actuators.block import kernel
from fdi.isolation import evidence as ev
from fdi.isolation import sums
from fdi.isolation.filter import N
from fdi.isolation.sums import OCTAVES

LIQUID, SOLID, OPENED, WEAK, OF_ROD, OF_SURFACE, OF_PRESSURE, OF_LOAD, GAP, FREE_FLOAT, DRIVEN = range(1, 12)
CLASS_OF = (  # of the hypotheses of `evidence`, in their order
    LIQUID, SOLID, OF_ROD, OF_SURFACE, OF_PRESSURE, OF_LOAD, WEAK, WEAK, WEAK, WEAK, OF_LOAD, OPENED, FREE_FLOAT,
    OF_ROD, OF_SURFACE, OF_PRESSURE, GAP, OF_PRESSURE, OF_PRESSURE, DRIVEN,
)  # fmt: skip
CALM = 0.35  # of a threshold: down to it an alarm stands
CLEAR = 40.0  # evidence of a plain onset, at which all windows begin anew
RELEASE_S = 1.0  # an alarm outlives its evidence by this [s]
SURE, LEAD = 5.0, 0.05  # odds e^5, and this share of its own evidence: no model is better than that
FAIR, PLAIN = 1.1, 0.08  # a hypothesis fits that leaves so many times the noise, or this share of what health leaves
HELD_S, HELD_WEAK_S = 0.1, 0.5  # a loss is held for longer: its command may yet be gone [s]
PART = 0.75  # of its period that an oscillation has lasted: before, it is a step
SILENT_PART, SILENT_S = 0.4, 0.4  # of an oscillation's period; of what has no name [s]
AGAINST = -2.0  # evidence of a loss that is no longer there
FULL = 0.9  # of its length, at which the longest window is evaluated for the last time
OUTSIDE = 6.0  # standard deviations of the tolerances: beyond, the model is another actuator's
UNTAUGHT = 1.5  # thresholds that evidence for other than an oscillation must pass in the first seconds

STATE = [
    ("own", "f8", (OCTAVES,)),  # evidence of the best hypothesis of every octave at its last evaluation
    ("own_ratio", "f8", (OCTAVES,), "-"),  # largest evidence over its threshold
    ("own_class", "f8", (OCTAVES,)),
    ("own_fault", "f8", (OCTAVES,)),  # its hypothesis
    ("own_lead", "f8", (OCTAVES,)),
    ("own_fits", "f8", (OCTAVES,)),
    ("own_hz", "f8", (OCTAVES,), "Hz"),  # of an oscillation, else 0
    ("row", "f8"),  # lead of an oscillation added, over the longest windows in a row that are over
    ("row_last", "f8"),  # in the last evaluation of the longest window
    ("row_age", "f8"),  # blocks that it had
    ("silent", "f8", (OCTAVES,)),  # time for which an octave that showed a fault is silent [s]
    ("loud", "f8", (OCTAVES,)),  # ratio that it had, lagged
    ("evidence", "f8", "-"),  # largest evidence over its threshold
    ("evidence_timer", "f8", "s"),  # until the alarm of the evidence ends
    ("alarm_s", "f8", "s"),  # for which any alarm has stood
    ("emptied", "f8"),  # 1 once the windows were emptied at this alarm's onset
    ("candidate", "f8"),  # class that leads now
    ("candidate_hz", "f8", "Hz"),  # of an oscillation, else 0
    ("candidate_s", "f8", "s"),
    ("candidate_octave", "f8"),  # that shows it
    ("likely", "f8", "-"),  # class that has led for long enough
    ("likely_octave", "f8"),
    ("likely_fault", "f8"),  # hypothesis
    ("likely_hz", "f8", "Hz"),
]


@kernel
def of_window(x, h):
    """Return the evidence of hypothesis `h`, of an oscillation perhaps in the parts of the window, in any air."""
    if h == ev.ADDED or h == ev.IN_PLACE:
        return x.ev_told[h]
    if h == ev.SWING_LOAD:
        return x.ev[h] + x.ev_air
    return x.ev_told[2] if h == ev.SWING_PRESSURE else x.ev[h]


@kernel
def of_class(x, mine):
    """Return the evidence of the best hypothesis of class `mine`, and of the others or health."""
    own, other = -math.inf, 0.0
    for h in range(ev.HYPOTHESES):
        if CLASS_OF[h] == mine:
            own = max(own, of_window(x, h))
        else:
            other = max(other, of_window(x, h))
    return own, other


@kernel
def compare(x, p, o):
    """Keep the best hypothesis of octave `o`, its lead over other classes, and the largest evidence over threshold."""
    best, ratio, first = 0, 0.0, x.blocks <= sums.FIRST
    for h in range(ev.HYPOTHESES):
        if not (first and ev.NOISE_ROD <= h <= ev.NOISE_PRESSURE):
            late = first and h > ev.SWING_LOAD
            ratio = max(ratio, x.ev[h] / (p.limit[h] * (UNTAUGHT if late else 1.0)))
        if of_window(x, h) > of_window(x, best):
            best = h
    most = of_window(x, best)
    x.own[o], x.own_ratio[o], x.own_class[o], x.own_fault[o] = most, ratio, CLASS_OF[best], best
    x.own_lead[o] = most - of_class(x, CLASS_OF[best])[1]
    if best != ev.SWING_LOAD and most > x.ev[best]:  # in the parts of the window
        x.own_hz[o], x.own_fits[o] = x.own_hz[o - 1], x.own_fits[o - 1]
        return
    n, Q, Q0 = x.ev_n, x.ev_Q[best], x.ev_Q[ev.HYPOTHESES]
    x.own_hz[o] = x.ev_hz[best] if best <= ev.SWING_LOAD else 0.0
    fits = Q < FAIR * n + ev.BELOW * math.sqrt(2.0 * n) or Q - n < PLAIN * (Q0 - n)
    x.own_fits[o] = 1.0 if fits else 0.0


@kernel
def forget(x):
    """Forget what windows showed: they begin anew."""
    x.row = x.row_last = x.row_age = 0.0
    for o in range(OCTAVES):
        x.own[o] = x.own_ratio[o] = x.own_class[o] = x.own_fits[o] = x.silent[o] = x.loud[o] = 0.0


@kernel
def longest(x):
    """Return the octave of the longest window that shows a fault, -1 where none does."""
    for o in range(OCTAVES - 1, -1, -1):
        if x.own_ratio[o] >= 1.0:
            return o
    return -1


@kernel
def leader(x):
    """Return the octave of the longest window in which one class has the lead, -1 where none has or a longer one that
    shows a fault has another best hypothesis."""
    top = longest(x)
    for o in range(top, -1, -1):
        if x.own_ratio[o] < 1.0:
            continue
        if x.own_class[o] != x.own_class[top]:
            return -1
        lead = max(SURE, LEAD * x.own[o]) if x.own_class[o] != OF_LOAD else SURE
        if x.own_fits[o] > 0.5 and x.own_lead[o] > lead:
            return o
    return -1


@kernel
def in_a_row(x, p):
    """Take the evaluation of the longest window: it and those before it have no sample in common, and their evidence
    adds up. A small oscillation added leads that of a pressure sensor by no more than e^3 in one of them. Other classes
    are not asked, as what the model errs by adds up as well."""
    o = OCTAVES - 1
    if x.alarm < 0.5 and x.since > RELEASE_S:
        x.row = x.row_last = x.row_age = 0.0
    elif x.window_age[o] <= x.row_age:
        x.row = x.row + x.row_last if x.row_age > FULL * p.length[o] else 0.0
    own, other = of_class(x, LIQUID)
    x.row_age, x.row_last = x.window_age[o], own - other if x.own_fits[o] > 0.5 else min(own - other, 0.0)


@kernel
def inside(x, p):
    """Return whether what the flight has taught is within OUTSIDE of the tolerances."""
    for i in range(N):
        if math.fabs(x.mu[i] - p.prior_mean[i]) > OUTSIDE * p.prior_sd[i]:
            return False
    return True


@kernel
def healed(x, p, o, dt):
    """Return whether octave `o`, just evaluated, has been silent for long enough after it showed a fault."""
    if x.own_ratio[o] >= CALM:
        x.loud[o] = max(x.own_ratio[o], 0.8 * x.loud[o])
        x.silent[o] = 0.0
        return False
    h = int(x.likely_fault)
    loss = x.likely == WEAK or x.likely == FREE_FLOAT  # shows only while the valve has a command
    if x.loud[o] < 1.0 or (loss and x.ev[h] > AGAINST):
        return False
    apart = p.block * dt * sums.apart(o)
    x.silent[o] += apart
    swings = x.likely > 0.5 and h <= ev.SWING_LOAD
    least = SILENT_PART / max(x.likely_hz, 0.05) if swings else (0.0 if x.likely > 0.5 else SILENT_S)
    return x.silent[o] > max(least, 1.5 * apart)


@kernel
def nominate(x):
    """Write the class that leads now, 0 where none does that has a name."""
    c, row = leader(x), x.row > 0.0 and x.row + x.row_last > SURE and x.alarm > 0.5
    found = x.own_class[c] if c >= 0 else (float(LIQUID) if row else 0.0)
    if found == OPENED or found == GAP or found == DRIVEN:  # they have no name
        found = 0.0
    x.candidate_s *= 1.0 if x.candidate == found else 0.0
    x.candidate, x.candidate_hz = found, x.own_hz[c] if c >= 0 else 0.0
    x.candidate_octave = float(c) if c >= 0 else OCTAVES - 1.0
    if c >= 0 and (found == x.likely or x.likely == 0.0):
        x.likely_fault, x.likely_hz = x.own_fault[c], x.own_hz[c]


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
    if o == OCTAVES - 1:
        in_a_row(x, p)
    nominate(x)
    if x.own[o] > CLEAR and x.own_ratio[o] >= 1.0 and x.emptied < 0.5:
        x.emptied = 1.0
        return True
    if x.evidence_timer == 0.0 or not healed(x, p, o, dt):
        return False
    if longest(x) == OCTAVES - 1 and x.own_ratio[OCTAVES - 2] < 1.0:  # only the longest window shows the fault
        again = (sums.YOUNG * p.length[OCTAVES - 1] + sums.apart(OCTAVES - 1)) * p.block * dt
        x.evidence_timer = max(x.evidence_timer, again)
    return True


@kernel
def hold(x, dt):
    """While an alarm stands, keep the class that has led for long enough."""
    if x.alarm < 0.5:
        x.alarm_s = x.likely = x.candidate = x.candidate_s = x.emptied = x.likely_hz = 0.0
        return
    x.alarm_s += dt
    if x.candidate < 0.5:
        return
    x.candidate_s += dt
    if x.candidate != OF_LOAD and x.candidate_hz > 0.0 and x.alarm_s < PART / x.candidate_hz:
        x.candidate_s = 0.0
    slow = x.candidate == WEAK or (x.candidate == OF_PRESSURE and x.candidate_hz == 0.0)
    o = int(x.likely_octave)
    stands = x.likely > 0.5 and x.own_class[o] == x.likely and x.own_ratio[o] >= 1.0
    if x.candidate == x.likely or (not stands and x.candidate_s >= (HELD_WEAK_S if slow else HELD_S)):
        x.likely, x.likely_octave = x.candidate, x.candidate_octave
