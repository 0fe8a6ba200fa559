"""The decision: alarm where the evidence of a fault passes its threshold, name what leads in the longest window.

Windows of all lengths are asked in turn. The longest that shows a fault has the most degrees of freedom: its best
hypothesis is the only one that may have a name, as in a short window much explains everything. It has the name where it
leads all other classes by SURE and leaves what health would, or a small share of what is there, in that window or in a
shorter one. Else the alarm is ambiguous. An oscillation that the rules of `iotsekf` have found has its name where that
window bears it out (`swings_valve`).
"""

import math

from actuators.block import kernel
from fdi.common.verdict import AMBIGUOUS, EFFECTIVENESS, JAM_SOLID, NONE, OFC_LIQUID, OFC_SOLID, SENSOR
from fdi.hydraulic import hypotheses
from fdi.isolation import backlash, multiple_models, sums
from fdi.isolation import evidence as ev
from fdi.isolation.filter import N
from fdi.isolation.multiple_models import JOINED, SOFT
from fdi.isolation.sums import OCTAVES

LIQUID, SOLID, OPENED, WEAK, OF_ROD, OF_SURFACE, OF_PRESSURE, OF_LOAD, APART, FREE_FLOAT, DRIVEN = range(1, 12)
CALM = 0.35  # of a threshold: below, nothing speaks for a fault; down to it an alarm stands
CLEAR = 40.0  # evidence of a plain onset
SILENT_PART, SILENT_S = 0.4, 0.4  # of an oscillation's period; of what has no name [s]
AGAINST = -2.0  # evidence of a fault that is no longer there
LEAD = 0.05  # ... and this share of its own evidence: no model is better than that
FULL = 0.9  # of its length, at which the longest window is evaluated for the last time
SURE = 5.0  # odds e^5 against every other class
FAIR, PLAIN = 1.1, 0.08  # times noise; share of what health leaves beyond noise
HELD_S, HELD_WEAK_S = 0.1, 0.5  # a name must stand so long; a loss, whose command may yet be gone [s]
OUTSIDE = 3.0  # standard deviations of the tolerances
UNTAUGHT = 1.5  # thresholds that evidence for other than an oscillation must pass in the first seconds
RELEASE_S = 1.0  # an alarm outlives its evidence by this [s]
RESOLVED = 1.5  # periods of an oscillation that a window resolves
PART = 0.75  # of its period that an oscillation has lasted: before, it is a step
STILL = 0.5e-3  # rod travel of a jam: noise of its sensor [m]
RUBS_MOST, HOLDS_S = 0.6, 2.0  # friction holds no more of the stall force, seldom a rod for longer [s]
JAM_S = 10.0  # so long a jam outlives its last evidence while the rod is still [s]
FROZEN = 20.0  # equal samples in a row that a sensor with noise has not
TURNS = 0.4  # share of steps that turn back, of a sensor with noise: white noise has 2/3, one in a coarse quantum few

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
    ("silent", "f8", (OCTAVES,)),  # time for which an octave that spoke is silent [s]
    ("loud", "f8", (OCTAVES,)),  # ratio that it had, lagged
    ("speaks_timer", "f8", "s"),
    ("speaks", "f8", "-"),  # 1 while evidence stands for a fault
    ("speaking_s", "f8", "s"),  # time for which an alarm has stood
    ("ended", "f8"),  # 1 in the tick in which the evidence says that a fault of the actuator has healed
    ("borne", "f8"),  # 1 where the evidence since the alarm bears out an oscillation of the valve
    ("emptied", "f8"),  # 1 once the windows were emptied at this alarm's onset
    ("candidate", "f8"),
    ("candidate_hz", "f8", "Hz"),  # of an oscillation, else 0
    ("candidate_s", "f8", "s"),
    ("candidate_octave", "f8"),  # that speaks for it
    ("likely_octave", "f8"),  # that spoke last for the class that stands
    ("likely", "f8", "-"),  # class of this module
    ("kind", "f8", "-"),  # the same, of all that tells kinds of fault with one verdict apart
    ("likely_fault", "f8"),  # hypothesis
    ("rod_low", "f8", "m"),  # travel since the onset
    ("rod_high", "f8", "m"),
    ("rod_slow", "f8", "m"),
    ("at_stop", "f8", "-"),  # 1 while the rod is at a stop
    ("same", "f8", (3,)),  # equal samples in a row
    ("turns", "f8", (3,)),  # share of samples whose step goes against the one before, over 1 s
    ("step_last", "f8", (3,)),
    ("last_y", "f8", (3,)),
    *multiple_models.STATE,
    *backlash.STATE,
    ("jam_most", "f8", "-"),  # largest load beyond the model since a jam is declared
    ("jam_s", "f8", "s"),  # since then
    ("likely_hz", "f8", "Hz"),  # of the oscillation that is named
]


@kernel
def class_of(x, h):
    """Return the class that hypothesis `h` belongs to."""
    if h == ev.ADDED:
        return LIQUID
    if h == ev.IN_PLACE:
        return SOLID
    if h == ev.OPEN:
        return OPENED
    if h == ev.SWING_ROD or h == ev.NOISE_ROD:
        return OF_ROD
    if h == ev.SWING_SURFACE or h == ev.NOISE_SURFACE:
        return OF_SURFACE
    if h == ev.SWING_PRESSURE or h == ev.NOISE_PRESSURE or h == ev.OFF_PRESSURE or h == ev.SCALED_PRESSURE:
        return OF_PRESSURE
    if h == ev.SWING_LOAD or h == ev.RUBS:
        return OF_LOAD
    if h == ev.PAIR:
        return APART
    if h == ev.FREE:
        return FREE_FLOAT
    if h == ev.DRIVEN:
        return DRIVEN
    return WEAK


@kernel
def told(x, h):
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
        if class_of(x, h) == mine:
            own = max(own, told(x, h))
        else:
            other = max(other, told(x, h))
    return own, other


@kernel
def hear(x, p, o):
    """Keep what the evaluation of octave `o` says."""
    at_best, ratio = 0, 0.0
    for h in range(ev.HYPOTHESES):
        known = x.blocks > sums.FIRST or h <= ev.SWING_LOAD
        if known or h < ev.NOISE_ROD or h > ev.NOISE_PRESSURE:
            ratio = max(ratio, x.ev[h] / (p.limit[h] if known else UNTAUGHT * p.limit[h]))
        if told(x, h) > told(x, at_best):
            at_best = h
    mine, best = class_of(x, at_best), told(x, at_best)
    second = of_class(x, mine)[1]
    x.own[o], x.own_ratio[o], x.own_class[o], x.own_fault[o] = best, ratio, mine, at_best
    x.own_lead[o] = best - second
    if at_best != ev.SWING_LOAD and best > x.ev[at_best]:
        x.own_hz[o], x.own_fits[o] = x.own_hz[o - 1], x.own_fits[o - 1]
        return
    n, Q, Q0 = x.ev_n, x.ev_Q[at_best], x.ev_Q[ev.HYPOTHESES]
    x.own_hz[o] = x.ev_hz[at_best] if at_best <= ev.SWING_LOAD else 0.0
    fits = Q < FAIR * n + ev.LEAST * math.sqrt(2.0 * n) or Q - n < PLAIN * (Q0 - n)
    x.own_fits[o] = 1.0 if fits else 0.0


@kernel
def forget(x):
    """Forget what windows said: they begin anew."""
    x.row = x.row_last = x.row_age = 0.0
    for o in range(OCTAVES):
        x.own[o] = 0.0
        x.own_ratio[o] = 0.0
        x.own_class[o] = 0.0
        x.own_fits[o] = 0.0
        x.silent[o] = 0.0
        x.loud[o] = 0.0


@kernel
def longest(x):
    """Return the octave of the longest window that shows a fault, -1 where none does."""
    for o in range(OCTAVES - 1, -1, -1):
        if x.own_ratio[o] >= 1.0:
            return o
    return -1


@kernel
def candidate(x):
    """Return the octave of the longest window that speaks for one class, -1 where none does or a longer one that shows
    a fault has another best hypothesis."""
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
def healed(x, p, o, dt):
    """Return whether octave `o`, just evaluated, has been silent for long enough after it spoke."""
    if x.own_ratio[o] >= CALM:
        x.loud[o] = max(x.own_ratio[o], 0.8 * x.loud[o])
        x.silent[o] = 0.0
        return False
    h = int(x.likely_fault)
    loss = x.likely == WEAK or x.likely == FREE_FLOAT  # shows only while the valve is told something
    if x.loud[o] < 1.0 or (loss and x.ev[h] > AGAINST):
        return False
    apart = p.block * dt * sums.apart(o)
    x.silent[o] += apart
    swings = x.likely > 0.5 and h <= ev.SWING_LOAD
    least = SILENT_PART / max(x.likely_hz, 0.05) if swings else (0.0 if x.likely > 0.5 else SILENT_S)
    return x.silent[o] > max(least, 1.5 * apart)


@kernel
def frozen(x, u, dt):
    """Return which sensor, one that had noise, repeats its last value: 1 rod, 2 surface, 3 pressure, 0 none."""
    found = 0.0
    for j in range(3):
        y = u.y_rod if j == 0 else (u.y_surface if j == 1 else u.y_dp)
        valid = u.y_rod_valid if j == 0 else (u.y_surface_valid if j == 1 else u.y_dp_valid)
        x.same[j] = min(x.same[j] + 1.0, 1e6) if valid > 0.5 and y == x.last_y[j] else 0.0
        if valid > 0.5 and math.isfinite(y) and x.same[j] < FROZEN:
            by = y - x.last_y[j]
            x.turns[j] += min(dt, 1.0) * ((1.0 if by * x.step_last[j] < 0.0 else 0.0) - x.turns[j])
            x.step_last[j] = by
        x.last_y[j] = y if math.isfinite(y) else 0.0
        if x.same[j] >= FROZEN and x.turns[j] > TURNS:
            found = j + 1.0
    return found


@kernel
def follow(x, u, own, dt):
    """Follow an alarm, `own` or of the evidence, and the rod meanwhile; keep the class that leads for long enough."""
    jammed = x.likely == OF_LOAD and x.rod_high - x.rod_low < STILL and x.since < JAM_S
    if x.speaks > 0.5 and (jammed or x.at_stop > 0.5):  # what is still says nothing; nor does what is at its stop
        x.speaks_timer = RELEASE_S
    x.speaks = 1.0 if x.speaks_timer > 0.0 else 0.0
    x.jam_s = x.jam_s + dt if x.jam > 0.5 else 0.0
    x.jam_most = max(x.jam_most, math.fabs(x.excess)) if x.jam > 0.5 else 0.0
    alarm = own or x.speaks > 0.5
    x.speaking_s = x.speaking_s + dt if alarm else 0.0
    if u.y_rod_valid > 0.5 and math.isfinite(u.y_rod):
        x.rod_slow += min(dt / 0.02, 1.0) * (u.y_rod - x.rod_slow)
    if not alarm:
        x.likely = x.candidate = x.candidate_s = x.emptied = x.borne = 0.0
        x.rod_low = x.rod_high = x.rod_slow
        x.likely_hz = 0.0
        return
    x.rod_low, x.rod_high = min(x.rod_low, x.rod_slow), max(x.rod_high, x.rod_slow)
    if x.candidate < 0.5:
        return
    x.candidate_s += dt
    if x.candidate != OF_LOAD and x.candidate_hz > 0.0 and x.speaking_s < PART / x.candidate_hz:
        x.candidate_s = 0.0
    slow = x.candidate == WEAK or (x.candidate == OF_PRESSURE and x.candidate_hz == 0.0)
    o = int(x.likely_octave)
    stands = x.likely > 0.5 and x.own_class[o] == x.likely and x.own_ratio[o] >= 1.0
    if x.candidate == x.likely or (not stands and x.candidate_s >= (HELD_WEAK_S if slow else HELD_S)):
        x.likely, x.likely_octave = x.candidate, x.candidate_octave


@kernel
def merge(x, freeze, asked):
    """Write alarm, verdict and culprit: those of the tests of `iotsekf`, which x.alarm, x.verdict and x.culprit hold,
    and what leads by evidence where they have no name or ask no more than whether something swings or is still. Where
    evidence is `asked` it has to bear out an oscillation before it has a name."""
    if freeze > 0.5:
        x.alarm, x.verdict, x.culprit = 1.0, SENSOR, freeze
        x.rival_s = -1.0  # its last value shows nothing of the actuator: the models begin anew
        x.shown[SOFT] = x.shown[JOINED] = 0.0
        return
    if x.speaks < 0.5 and x.alarm < 0.5:
        return
    x.alarm = 1.0
    swings, moved = x.verdict == OFC_LIQUID or x.verdict == OFC_SOLID, x.rod_high - x.rod_low >= STILL
    if x.verdict == NONE:
        x.verdict = AMBIGUOUS
    shown = max(x.shown[SOFT], x.shown[JOINED]) > 0.5
    if x.loose > 0.5 or (of_actuator(x) and shown and x.jam < 0.5):
        x.verdict, x.culprit = EFFECTIVENESS, 0.0
        return
    if x.likely == OF_PRESSURE and (swings or x.verdict == AMBIGUOUS) and x.sensor < 0.5:
        x.verdict, x.culprit = SENSOR, 3.0
    elif swings and asked and x.borne < 0.5:
        x.verdict = AMBIGUOUS
    elif x.verdict == JAM_SOLID and (x.likely == WEAK or x.likely == OF_LOAD) and moved:
        x.verdict = EFFECTIVENESS
    elif x.verdict == JAM_SOLID and x.jam_most < RUBS_MOST and (x.jam_s < HOLDS_S or moved):
        x.verdict = AMBIGUOUS
    elif x.verdict != AMBIGUOUS:
        return
    elif x.sensor > 0.5 and x.likely != OF_ROD and (x.likely != OF_SURFACE or x.backlash_suspected > 0.5):
        return
    elif x.likely == LIQUID and x.proof > -hypotheses.DOUBT:
        x.verdict = OFC_LIQUID
    elif x.likely == SOLID and x.sure[1] > 0.0:
        x.verdict = OFC_SOLID
    elif (x.likely == WEAK and x.dp_out < 0.5) or (x.likely == OF_LOAD and moved):
        x.verdict = EFFECTIVENESS
    elif x.likely == OF_ROD or x.likely == OF_SURFACE:
        x.verdict, x.culprit = SENSOR, x.likely - OF_ROD + 1.0


@kernel
def of_actuator(x):
    """Return whether nothing says that the fault is of a sensor. The evidence of a pressure sensor knows no model of
    joined chambers: while these lead, they outrank it."""
    pressure = x.likely == OF_PRESSURE or x.candidate == OF_PRESSURE
    return x.sensor < 0.5 and x.verdict != SENSOR and (not pressure or x.rival_lead[JOINED] > multiple_models.SURE)


@kernel
def conclude(x, freeze, asked):
    """Write alarm, verdict and culprit (`merge`), and which kind of fault a loss of effectiveness is."""
    merge(x, freeze, asked)
    x.kind = x.likely
    if x.loose > 0.5:
        x.kind = APART
    elif x.verdict == EFFECTIVENESS and max(x.shown[SOFT], x.shown[JOINED]) > 0.5:
        x.kind = FREE_FLOAT if x.shown[JOINED] > 0.5 else WEAK


@kernel
def inside(x, p):
    """Return whether what the flight has taught is within OUTSIDE of the tolerances: beyond, the model is another's."""
    for i in range(N):
        if math.fabs(x.mu[i] - p.prior_mean[i]) > OUTSIDE * p.prior_sd[i]:
            return False
    return True


@kernel
def swings_valve(x, o, top, span):
    """Return whether octave `top`, the longest that shows a fault, of `span` [s], bears out an oscillation of the valve
    that the rules have found; octave `o` has just been evaluated. A loss leaves a share of the command, as one in place
    does, and none of one added."""
    fits = x.own_fits[top] > 0.5 and not (x.own_class[top] == WEAK and x.named == OFC_LIQUID)
    if fits and x.own_class[top] != LIQUID and x.own_class[top] != SOLID:
        return False
    if o == top and max(told(x, ev.ADDED), told(x, ev.IN_PLACE)) > of_class(x, OF_PRESSURE)[0]:
        return True
    if fits or span * x.ofc_hz < RESOLVED:
        return False
    for o in range(OCTAVES):
        if x.own_ratio[o] >= 1.0 and x.own_class[o] == OF_PRESSURE:
            return False
    return True  # a large one, to which no hypothesis is close: evidence has no say


@kernel
def judge(x, p, o, dt):
    """Take the evaluation of octave `o`; return whether all windows are to begin anew."""
    hear(x, p, o)
    x.evidence = 0.0
    for i in range(OCTAVES):
        x.evidence = max(x.evidence, x.own_ratio[i])
    if x.own_ratio[o] >= CALM:
        x.since = 0.0
    if x.own_ratio[o] >= (1.0 if x.speaks < 0.5 else CALM) and (inside(x, p) or x.speaks > 0.5):
        x.speaks_timer = RELEASE_S
    top, c = longest(x), candidate(x)
    if top >= 0 and swings_valve(x, o, top, p.length[top] * p.block * dt):
        x.borne = 1.0
    against = c >= 0 and (x.own_class[c] == OF_PRESSURE or (x.own_class[c] == WEAK and x.named != OFC_LIQUID))
    if against and x.own_fits[top] > 0.5:  # where nothing fits the longest window a short one has no say
        x.borne = 0.0
    if o == OCTAVES - 1:
        in_a_row(x, p)
    if c < 0 and x.row > 0.0 and x.row + x.row_last > SURE and x.alarm > 0.5:
        x.candidate_s *= 1.0 if x.candidate == LIQUID else 0.0
        x.candidate, x.candidate_hz, x.candidate_octave = LIQUID, 0.0, OCTAVES - 1.0
    elif c < 0:
        x.candidate = x.candidate_s = 0.0
    else:
        if x.candidate != x.own_class[c]:
            x.candidate_s = 0.0
        x.candidate, x.candidate_hz, x.candidate_octave = x.own_class[c], x.own_hz[c], float(c)
        if x.candidate == x.likely or x.likely == 0.0:
            x.likely_fault, x.likely_hz = x.own_fault[c], x.own_hz[c]
    if x.own[o] > CLEAR and x.own_ratio[o] >= 1.0 and x.emptied < 0.5:
        x.emptied = 1.0
        return True
    if x.speaks < 0.5 or not healed(x, p, o, dt):
        return False
    h = x.likely_fault  # a small oscillation added to a quiet command may be silent and come again
    x.ended = 1.0 if h == ev.IN_PLACE or h > ev.SWING_LOAD else 0.0
    if longest(x) == OCTAVES - 1 and x.own_ratio[OCTAVES - 2] < 1.0:  # only the longest window shows the fault
        again = (sums.YOUNG * p.length[OCTAVES - 1] + sums.apart(OCTAVES - 1)) * p.block * dt
        x.speaks_timer = max(x.speaks_timer, again)
    return True
