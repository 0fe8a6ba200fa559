"""One verdict of both levels: where a fault is, by Bayes' rule on what the other detectors say.

Source: ours. The question is that of B. Vanek, A. Edelmayer, Z. Szabo, J. Bokor, Bridging the gap between theory and
practice in LPV fault detection for flight control actuators, Control Engineering Practice 31 (2014) 171-182: what does
diagnosis at aircraft level add to that of the actuators, and how do the two go together.

Every lane of every other detector has a token: silent, or what it says (fdi/joint/tables.py). With h a place and a
class (fdi/joint/places.py),

    P(h | tokens) ~ P(h) sum_v P(v) prod_lanes P(token | h, v)

where v is how large the fault is (small, middling, large) and whether it is like one that rates were measured on. What
a lane says is counted by how long its alarm has stood: the first names are less sure than the last ones.
P(silent | h, v) = 1 - P(alarm | h, v) F(age), F the share of that detector's alarms that come so soon after the first
witness of such a fault. Where one command moves two segments of one technology, detectors of one kind on both part with
(1 - `alike`) of the probability of independent ones, and say the same with `alike`. Of a lane that is silent and not
valid, or of a detector that does not fly, it is 1; an alarm that comes while its lane is not valid is not heard, one
that came before is.

Two faults: P(token | h, h') is that of whichever speaks, 1 - (1 - a)(1 - a') of them alarms. They are tried with one
of the likeliest single ones and any other one, where that single one leaves an alarm unexplained, with the prior of a
second fault `two`. No fault: every alarm is false, with its detector's probability. Of a detector that alone has spoken
counts how often it stays alone with a fault, how often it is wrong without one for so long (fdi.joint.tables.alone).
The alarm: P(a fault) >= 1/2, until it is below `fall` or no lane alarms.

The culprit is the smallest that holds `sure` of the probability: a place, else a set (SETS, "q or theta"), else none;
the verdict is a class that holds `sure_class` of it, else AMBIGUOUS; `p` is what the culprit holds, `second` and
`verdict_2` the other of two faults. Work is done when a token changes or an age passes; otherwise a tick only looks at
its inputs.
"""

import functools
from typing import Any

import numpy as np

from actuators.block import entry, kernel, record
from fdi import registry
from fdi.common.record import Detector, Site
from fdi.common.verdict import AMBIGUOUS, NONE, code
from fdi.joint import tables
from fdi.joint.fields import (
    DETECTOR_OF,
    FINER,
    INPUTS,
    LANE_OF,
    NA,
    NC,
    NCUL,
    NF,
    NG,
    NH,
    NK,
    NL,
    NN,
    NP,
    NQ,
    NR,
    NV,
    NV_F,
    NW,
    PARAMS,
    STATE,
    WORDS,
)
from fdi.joint.places import AIRCRAFT, CULPRITS, LANES, LOCAL, PLACES, SEGMENTS, SETS, WIDE, hypotheses, segments
from fdi.joint.tables import padded

UNEXPLAINED = 0.01  # P(token | h) below which a hypothesis does not explain an alarm
OUTPUTS = ("r", "alarm", "verdict", "culprit", "valid", "p", "second", "verdict_2", "p_2", "p_fault")
_SECOND = {"alarm": "second", "verdict": "verdict_2", "culprit": "second", "valid": "valid"}
_READS = {f"{word}[{i}]": f"{d}.aircraft.{_SECOND[word]}" if lane == "second" else f"{d}.{lane}.{word}"
          for i, (d, lane) in enumerate(LANES) for word in WORDS}  # fmt: skip
_READS |= {f"finer[{f}]": f"{d}.{LANES[i][1]}.{output}" for f, (i, d, output) in enumerate(FINER)}
DETECTOR = Detector(
    id="joint",
    level="both",
    summary="one verdict of both levels by Bayes' rule on what the other detectors say (cf. Vanek14)",
    inputs=_READS,
    group="both levels",
    designed_for={
        **dict.fromkeys(("*.ofc_liquid*",), ("ofc_liquid",)),
        **dict.fromkeys(("*.ofc_solid*",), ("ofc_solid",)),
        **dict.fromkeys(("*.jam_solid", "*.jam"), ("jam_solid",)),
        **dict.fromkeys(("*.runaway*", "ema.hardover"), ("runaway",)),
        "*.jam_liquid": ("sensor",),
        "*.bias@command": ("jam_liquid",),
        **dict.fromkeys((
            "*.loss_of_effectiveness*", "*.free_float", "*.supply_pressure_drop", "*.internal_leakage", "*.air_in_oil",
            "*.friction", "*.backlash", "*.magnet_loss", "*.winding_resistance",
        ), ("effectiveness", "ambiguous")),
        **dict.fromkeys(("*.rod", "*.surface", "*.pressure", "*.position", "*.velocity", "*.current", "sensor.*"),
                        ("sensor",)),
        "engine": ("thrust",), "rudder": ("jam_solid",),
    },
    may_see=dict.fromkeys(("aileron", "stabiliser"), ("jam_solid", "ambiguous")),
    blind="hears the other detectors: what none of them says it does not know",
    sizes={"n_h": 1.0, "n_k": 1.0, "row": 0.0, "place": 0.0, "verdict": 0.0, "token": 0.0, "name_of": 0.0,
           "name_of_set": 0.0, "finer": 0.0, "word": 0.0},
    any_aircraft=True,
    may_lack=True,
    options={"levels": ("both", "local", "aircraft"), "rates": ("measured", "none")},  # the first is the default
    fit=lambda site, levels="both", rates="measured": fitted(site, levels, rates),
)  # fmt: skip


def params(
    technology: Any = None, *, levels: str = "both", rates: str | dict = "measured", **values: Any
) -> np.ndarray:
    """Return PARAMS for elevator segments {segment: technology}, by default four hydraulic ones.

    `levels` names whose lanes are listened to, `rates` "measured" (stored), "none", or counts as those.
    """
    technology = dict(technology or dict.fromkeys(SEGMENTS, "hydraulic"))
    counted = rates if isinstance(rates, dict) else tables.stored() if rates == "measured" else {}
    found, here = hypotheses(technology), segments(technology)
    row, alarm, said, by_age = tables.rows(found, here, counted)
    own = {"both": (*LOCAL, *AIRCRAFT), "local": LOCAL, "aircraft": AIRCRAFT}[levels]
    token, finer, word = np.zeros((NL, NC, NCUL)), np.zeros((NL, NC, NW)), np.zeros((NF, NV_F))
    for i, (detector, _) in enumerate(LANES):
        for out, codes in ((token, tables.codes(detector)), (finer, tables.finer_codes(detector))):
            out[i, :, : codes.shape[1]] = codes
    for f, (_, detector, output) in enumerate(FINER):
        for value, told in registry.record(detector).finer[output].items():
            word[f, value] = tables.words(detector).index(told) if told else -1.0
    size = np.repeat([1.0 - tables.UNSEEN, tables.UNSEEN], 3) / 3.0
    spoken = (size * alarm).reshape(-1, 2, 3).sum(axis=2)
    mean, said_mean = alarm @ size, (spoken[:, :, None, None] * said).sum(axis=1)
    one = np.unique(row[:, [lane == "second" for _, lane in LANES]]).astype(int)  # of one fault no second is named
    alarm[one], said[one] = tables.ELSEWHERE, said[one] > 0.0
    said[one] /= said[one].sum(axis=-1, keepdims=True)
    made = {
        "sure": 0.85, "sure_class": 0.95, "fall": 0.1, "two": 0.1, "none": 0.05, "keep": 5.0, "release": 0.5,
        "n_h": len(found), "n_k": NK, "row": padded(row, (NH, NL)),
        "twin": padded(tables.twins(found, here), (NH, NL)), "alike": 0.8, "prior": padded(tables.prior(found), (NH,)),
        "place": padded(np.array([PLACES.index(h.place) for h in found]), (NH,)), "share": size,
        "verdict": padded(np.array([code(h.verdict) for h in found]), (NH,)),
        "alarm": padded(alarm, (NR, NV)), "said": padded(said, (NR, 2, NQ, NN)), "alarm_mean": padded(mean, (NR,)),
        "said_mean": padded(said_mean, (NR, NQ, NN)), "by_age": padded(by_age, (NR, NA)),
        "false": [tables.false(d) for d, _ in LANES], "alone": tables.alone(counted), "token": token, "finer": finer,
        "word": word, "ages": tables.AGES, "phases": tables.PHASES,
        "use": [float(d in own and (lane in WIDE or lane in here)) for d, lane in LANES],
        "set_of": [[float(p in members) for p in PLACES] for members in SETS.values()],
        "name_of": [CULPRITS.index(p) for p in PLACES], "name_of_set": [CULPRITS.index(n) for n in SETS],
    }  # fmt: skip
    return record(PARAMS, **{**made, **values})


def fitted(site: Site, levels: str = "both", rates: str = "measured") -> np.ndarray:
    """Return PARAMS for a loop."""
    return of_layout(tuple((site.technologies or {}).items()), levels, rates).copy()


@functools.cache
def of_layout(technologies: tuple[tuple[str, str], ...], levels: str, rates: str) -> np.ndarray:
    """Return `params` of segments ((segment, technology), ...); its tables are made once in a process."""
    return params(dict(technologies), levels=levels, rates=rates)


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape: nothing heard."""
    return np.zeros(p.shape, STATE)


@kernel
def _bin(age, p):
    """Return the index of the last of the ages that has passed."""
    b = 0
    for k in range(NA):
        if age >= p.ages[k]:
            b = k
    return b


@kernel
def _token(x, i):
    """Return the token of lane `i`."""
    return min(max(int(x.said[i]), 0), NN - 1)


@kernel
def _told(x, u, p):
    """Keep of every lane the word that it said last while its alarm stands; a part is taken back."""
    for i in range(NL):
        if u.alarm[i] < 0.5:
            x.word[i] = 0.0
    for f in range(NF - 1, -1, -1):
        v, i = int(u.finer[f]), int(LANE_OF[f])
        if 0 <= v < NV_F and p.word[f, v] != 0.0 and u.alarm[i] > 0.5:
            x.word[i] = max(p.word[f, v], 0.0)


@kernel
def _heard(x, u, p, dt):
    """Take the tokens of this tick; return 1 when anything is new, else 0."""
    new, any_on, x.valid = 0, 0, 0.0
    _told(x, u, p)
    for i in range(NL):
        if p.use[i] < 0.5:
            continue
        able = 1.0 if u.valid[i] > 0.5 else 0.0
        if able != x.able[i]:
            x.able[i], new = able, 1
        x.valid = max(x.valid, able)
        if u.alarm[i] > 0.5 and (able > 0.5 or x.said[i] > 0.5):
            any_on = 1
            c, k = int(u.verdict[i]), int(u.culprit[i])
            t = p.token[i, c, k] if 0 < c < NC and 0 <= k < NCUL else 0.0
            if 0 < c < NC and p.finer[i, c, int(x.word[i])] > 0.5:
                t = p.finer[i, c, int(x.word[i])]
            if t < 0.5:  # an alarm without a name
                t = p.token[i, 9, 0]
            if x.said[i] < 0.5:
                x.since[i], x.phase[i] = x.age, 0.0
            x.over[i] = 0.0
            if t != x.said[i]:
                x.said[i], new = t, 1
        elif x.said[i] > 0.5:
            x.over[i] += dt
            if x.over[i] > p.keep:
                x.said[i], new = 0.0, 1
        q = int(x.phase[i]) if x.said[i] > 0.5 else 0
        while x.said[i] > 0.5 and x.over[i] == 0.0 and q + 1 < NQ and x.age - x.since[i] >= p.phases[q + 1]:
            q += 1
        if q != x.phase[i]:
            x.phase[i], new = q, 1
    x.still = 0.0 if any_on else x.still + dt
    return new


@kernel
def _single(x, p):
    """Fill x.w: P(h) sum_v P(v) prod P(token | h, v) of every hypothesis; return its sum."""
    total, b = 0.0, _bin(x.age, p)
    for h in range(int(p.n_h)):
        x.w[h] = 0.0
        for v in range(NV):
            w = p.prior[h] * p.share[v]
            for i in range(NL):
                t = _token(x, i)
                if t == 0 and (p.use[i] < 0.5 or x.able[i] < 0.5):
                    continue
                r, j = int(p.row[h, i]), int(p.twin[h, i]) - 1
                a, s = p.alarm[r, v], p.said[r, v // 3, int(x.phase[i]), t]
                if j >= 0 and p.use[j] > 0.5 and x.able[j] > 0.5:
                    a = 1.0 - (1.0 - p.alike) * (1.0 - a) if x.said[j] > 0.5 else (1.0 - p.alike) * a
                    if x.said[j] > 0.5:
                        s = (1.0 - p.alike) * s + (p.alike if t == _token(x, j) else 0.0)
                w *= a * s if t > 0 else 1.0 - a * p.by_age[r, b]
            x.w[h] += w
        total += x.w[h]
    return total


@kernel
def _unexplained(x, p, h):
    """Return the age at which the first alarm came that hypothesis `h` does not explain, -1 where it explains all."""
    first = -1.0
    for i in range(NL):
        t = _token(x, i)
        explained = t == 0 or p.said_mean[int(p.row[h, i]), int(x.phase[i]), t] >= UNEXPLAINED
        if not explained and (first < 0.0 or x.since[i] < first):
            first = x.since[i]
    return first


@kernel
def _pair(x, p, h, other, b):
    """Return P(tokens | both): of a lane speaks whichever hypothesis makes it; `b` is the age bin of the second."""
    w, b_1 = 1.0, _bin(x.age, p)
    for i in range(NL):
        t = _token(x, i)
        if t == 0 and (p.use[i] < 0.5 or x.able[i] < 0.5):
            continue
        r, r_2 = int(p.row[h, i]), int(p.row[other, i])
        q = int(x.phase[i])
        a, s, a_2, s_2 = p.alarm_mean[r], p.said_mean[r, q, t], p.alarm_mean[r_2], p.said_mean[r_2, q, t]
        if t > 0:
            w *= s * (1.0 - a_2) + s_2 * (1.0 - a) + 0.5 * (s * a_2 + s_2 * a)
        else:
            w *= (1.0 - a * p.by_age[r, b_1]) * (1.0 - a_2 * p.by_age[r_2, b])
    return w


@kernel
def _false(x, p):
    """Return P(tokens | no fault): every alarm is false."""
    w = 1.0
    for i in range(NL):
        if x.said[i] > 0.5:
            w *= p.false[i]
    return w


@kernel
def _likeliest(x, p):
    """Fill x.best with the single hypotheses of the largest weights, in order; return how many there are."""
    count = min(int(p.n_k), NK, int(p.n_h))
    for k in range(count):
        best = -1
        for h in range(int(p.n_h)):
            taken = False
            for j in range(k):
                taken = taken or int(x.best[j]) == h
            if not taken and (best < 0 or x.w[h] > x.w[best]):
                best = h
        x.best[k] = best
    return count


@kernel
def _name(x, p, weights, second):
    """Name the smallest culprit that holds `sure` of the weights of hypotheses, and the class within it."""
    total, top = 0.0, -1
    for i in range(NP):
        x.place_w[i] = 0.0
    for h in range(int(p.n_h)):
        x.place_w[int(p.place[h])] += weights[h]
        total += weights[h]
    for i in range(NP):
        if top < 0 or x.place_w[i] > x.place_w[top]:
            top = i
    culprit, held, g = p.name_of[top], x.place_w[top], -1
    if held < p.sure * total:
        culprit, held = 0.0, total
        for k in range(NG):
            own = 0.0
            for i in range(NP):
                own += p.set_of[k, i] * x.place_w[i]
            if own >= p.sure * total:
                culprit, held, g = p.name_of_set[k], own, k
                break
    for c in range(NC):
        x.class_w[c] = 0.0
    for h in range(int(p.n_h)):
        i = int(p.place[h])
        if (culprit < 0.5) or (g < 0 and i == top) or (g >= 0 and p.set_of[g, i] > 0.5):
            x.class_w[int(p.verdict[h])] += weights[h]
    verdict = AMBIGUOUS
    for c in range(NC):
        if x.class_w[c] >= p.sure_class * held:
            verdict = float(c)
    share = held / total if total > 0.0 else 0.0
    if second > 0.5:
        x.second, x.verdict_2, x.p_2 = culprit, verdict, share
    else:
        x.culprit, x.verdict, x.p = culprit, verdict, share


@kernel
def _conclude(x, p):
    """Weigh one fault, two faults and none, and name what there is."""
    one = (1.0 - p.two) * _single(x, p)
    none = p.none * _false(x, p)
    count, two, lead, lead_w = _likeliest(x, p), 0.0, -1, 0.0
    for k in range(count):
        h = int(x.best[k])
        came = _unexplained(x, p, h)
        if came < 0.0:
            continue
        b, own = _bin(x.age - came, p), 0.0
        for other in range(int(p.n_h)):
            if p.place[other] != p.place[h]:
                own += p.two * p.prior[h] * p.prior[other] * _pair(x, p, h, other, b)
        two += own
        if own > lead_w:
            lead, lead_w = h, own
    x.p_fault = (one + two) / (one + two + none) if one + two + none > 0.0 else 0.0
    voices, who = 0.0, -1
    for i in range(NL):
        if x.said[i] > 0.5:
            first = True  # of its detector, whose lanes are one voice
            for j in range(i):
                first = first and not (x.said[j] > 0.5 and DETECTOR_OF[j] == DETECTOR_OF[i])
            voices += 1.0 if first else 0.0
            who = i if who < 0 or x.phase[i] > x.phase[who] else who
    x.voices = max(x.voices, voices)
    if x.voices < 1.5:
        odds = p.alone[who, int(x.phase[who])]
        x.p_fault = odds / (1.0 + odds)
    x.second, x.verdict_2, x.p_2 = 0.0, NONE, 0.0
    if lead < 0 or two < p.sure * (one + two):
        _name(x, p, x.w, 0.0)
        return
    b = _bin(x.age - _unexplained(x, p, lead), p)
    for pas in range(2):  # the second, beside the first; then which first it is beside that
        top = -1
        for h in range(int(p.n_h)):
            x.other_w[h] = 0.0 if p.place[h] == p.place[lead] else p.prior[h] * _pair(x, p, lead, h, b)
            if top < 0 or x.other_w[h] > x.other_w[top]:
                top = h
        _name(x, p, x.other_w, 1.0 - pas)
        lead = top


@kernel
def step(x, u, p, dt):
    """Hear the lanes; where anything is new, weigh all hypotheses."""
    new = _heard(x, u, p, dt)
    any_token = False
    for i in range(NL):
        any_token = any_token or x.said[i] > 0.5
    if not any_token or x.still > p.release:
        for i in range(NL):
            x.said[i], x.since[i], x.over[i] = 0.0, 0.0, 0.0
        x.age, x.newest, x.bin, x.bin_2, x.voices = 0.0, 0.0, 0.0, 0.0, 0.0
        x.r, x.alarm, x.verdict, x.culprit, x.p, x.p_fault = 0.0, 0.0, NONE, 0.0, 0.0, 0.0
        x.second, x.verdict_2, x.p_2 = 0.0, NONE, 0.0
        return
    if new > 0:
        x.newest = x.age
    b, b_2 = _bin(x.age, p), _bin(x.age - x.newest, p)
    if new > 0 or b != x.bin or b_2 != x.bin_2:
        x.bin, x.bin_2 = b, b_2
        _conclude(x, p)
        x.r = 2.0 * x.p_fault
        x.alarm = 1.0 if x.p_fault >= 0.5 or (x.alarm > 0.5 and x.p_fault >= p.fall) else 0.0
        if x.alarm < 0.5:
            x.verdict, x.culprit, x.second, x.verdict_2 = NONE, 0.0, 0.0, NONE
    x.age += dt


rollout = entry(step, STATE, INPUTS, PARAMS)
