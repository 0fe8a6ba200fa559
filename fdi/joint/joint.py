"""One verdict of both levels: where a fault is, by Bayes' rule on what the other detectors say.

Source: ours. The question is that of B. Vanek, A. Edelmayer, Z. Szabo, J. Bokor, Bridging the gap between theory and
practice in LPV fault detection for flight control actuators, Control Engineering Practice 31 (2014) 171-182: what does
diagnosis at aircraft level add to that of the actuators, and how do the two go together.

Every lane of every other detector has a token (fdi/joint/likelihood.py): silence, or what it says now. With h of the
table of fdi/joint/hypotheses.py,

    P(h | tokens) ~ P(h) [(1 - UNLIKE) prod_lanes P(token | h, counts) + UNLIKE prod_lanes P(token | h, record)]

as a fault may be unlike all that were counted, with the mean of the logarithm of the bracket over MEMORY in place of
what it is now, as lanes flicker. The counts are those of a young alarm, and of an older one.

Lanes of one detector that the same fault moves see much the same: of the second, P(token | h) = ALIKE [it says what the
one before it says] + (1 - ALIKE) P(token | h). A lane that does not fly, or is silent and not valid, says nothing. An
alarm that comes while its lane is not valid is not heard, one that came before is.

`joint` alarms while a lane does; what is heard is weighed EVERY so often. The part is the finest name that holds SURE
of the probability, the verdict the class that holds SURE of the probability of that name, else AMBIGUOUS; `p` is the
probability of the isolated_part.
"""

import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record, zero_state
from fdi import registry
from fdi.common.record import Detector
from fdi.common.verdict import AMBIGUOUS, NAMES, NONE, code
from fdi.joint import likelihood
from fdi.joint.hypotheses import ISOLABLE_PARTS, LANES, SEGMENTS, hypotheses, segments

# chosen on the training flights, rates from one half of them and names from the other; SURE on flights of `fault-space`
# and a third of campaign `joint`, too:
SURE = 0.82  # probability from which a place, and in it a class, is named
EVERY, MEMORY = 0.25, 4.0  # what is heard is weighed, and remembered [s]
UNLIKE = 0.1  # probability that a fault is unlike all that were counted: the records speak
ALIKE = 0.9  # how much lanes of one detector on segments that one fault moves have in common [-]
SEVERAL = 0.1  # such a fault, of parts that have no common command, against one of a single part; assumed [-]
# (lane, detector, output) of what tells more than a class; of one lane the first that says anything counts
FINER = [(i, d, output) for i, (d, _) in enumerate(LANES) for output in registry.record(d).finer]
LANE_OF = tuple(i for i, _, _ in FINER)
NL, NF, NC, NN, NLEVEL = len(LANES), len(FINER), len(NAMES), len(ISOLABLE_PARTS), 4
NH, NR, NT = 192, 640, 49  # most hypotheses, rows, tokens
NCUL, NW, NV = 25, 8, 16  # most isolable_parts and words of a detector, values of an output that tells more
PARAMS = dtype([
    ("n_h", "f8"),  # hypotheses
    ("prior", "f8", (NH,)),
    ("names", "f8", (NH, NLEVEL)),  # index into ISOLABLE_PARTS, from the finest, 0 for none
    ("verdict", "f8", (NH,)),  # class code
    ("row", "f8", (NH, NL)),  # of `p_token`
    ("twin", "f8", (NH, NL)),  # 1 + the lane of the same detector before it that the hypothesis moves, 0 for none
    ("p_token", "f8", (3, NR, NT)),  # P(token | row), while the alarm is young, later, and of the record alone
    ("token", "f8", (NL, NW, NC, NCUL)),  # of word, class code and isolated_part
    ("word", "f8", (NF, NV)),  # that a value of an output is
])  # fmt: skip
WORDS = ("alarm", "verdict", "isolated_part", "valid")
INPUTS = dtype([*((n, "f8", (NL,), "-") for n in WORDS), ("finer", "f8", (NF,), "-")])
OUTPUTS = ("r", "alarm", "verdict", "isolated_part", "valid", "p")
STATE = dtype([
    ("r", "f8", "-"),  # lanes that alarm
    ("alarm", "f8", "-"),
    ("verdict", "f8", "-"),
    ("isolated_part", "f8", "-"),  # index into ISOLABLE_PARTS
    ("valid", "f8", "-"),
    ("p", "f8", "-"),  # probability of the isolated_part, 0 while none is named
    ("heard", "f8", (NL,)),  # token of each lane, 0 silent, -1 where it says nothing
    ("since", "f8", "s"),  # the alarm rose
    ("times", "f8"),  # that it was weighed since then
    ("log_mean", "f8", (NH,)),  # of the logarithm of P(tokens | hypothesis), over MEMORY
    ("weight", "f8", (NH,)),  # of each hypothesis
    ("share", "f8", (NN,)),  # of each name
    ("class_share", "f8", (NC,)),  # of each class within the isolated_part
])  # fmt: skip
DETECTOR = Detector(
    id="joint",
    level="both",
    summary="one verdict of both levels by Bayes' rule on what the other detectors say (cf. Vanek14)",
    inputs={f"{word}[{i}]": f"{d}.{lane}.{word}" for i, (d, lane) in enumerate(LANES) for word in WORDS}
    | {f"finer[{f}]": f"{d}.{LANES[i][1]}.{output}" for f, (i, d, output) in enumerate(FINER)},
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
    sizes={"n_h": 1.0, "names": 0.0, "verdict": 0.0, "row": 0.0, "twin": 0.0, "token": 0.0, "word": 0.0},
    any_aircraft=True,
    may_lack=True,
    fit=lambda site: params(site.technologies or {}),
)  # fmt: skip


def params(
    technology: Mapping[str, str] | None = None, rates: likelihood.Rates | None = None, **values: Any
) -> np.ndarray:
    """Return PARAMS for elevator segments {segment: technology}, by default four hydraulic ones; `rates` other than the
    stored ones."""
    technology = dict.fromkeys(SEGMENTS, "hydraulic") if technology is None else technology
    found, here = hypotheses(technology), segments(technology)
    p, n = record(PARAMS, n_h=len(found)), len(found)
    row, p_token = likelihood.rows(found, here, likelihood.stored() if rates is None else rates)
    p_token, where = np.unique(p_token, axis=1, return_inverse=True)
    p["row"][0, :n] = where.ravel()[row.astype(int)]
    p["p_token"][0, :, : p_token.shape[1], : p_token.shape[2]] = p_token
    p["prior"][0, :n] = _prior(found)
    p["names"][0, :n] = [[ISOLABLE_PARTS.index(name) for name in h.names] for h in found]
    p["verdict"][0, :n] = [code(h.verdict) for h in found]
    for i, (detector, lane) in enumerate(LANES):
        isolable_parts = registry.module(detector).ISOLABLE_PARTS
        for w, told in enumerate(likelihood.words(detector)):
            said = [[likelihood.index(detector, v, c, told) for c in isolable_parts] for v in NAMES[1:]]
            p["token"][0, i, w, 1:, : len(isolable_parts)] = said
        before = [k for k in range(i) if LANES[k][0] == detector]
        for h, one in enumerate(found):
            moved = [k for k in before if LANES[k][1] in one.segments and here[LANES[k][1]] == here.get(lane)]
            p["twin"][0, h, i] = 1 + moved[-1] if moved and lane in one.segments else 0
    for f, (_, detector, output) in enumerate(FINER):
        for value, finer in registry.record(detector).finer[output].items():
            p["word"][0, f, value] = likelihood.words(detector).index(likelihood.word(finer))
    for name, value in values.items():
        p[name][0] = value
    return p


def _prior(found):
    """Return P(h): every place alike, a common fault of several segments' parts SEVERAL of that; within a place every
    class, and every kind of a class."""
    kinds = Counter((h.names, h.segments, h.verdict) for h in found)
    classes = Counter((names, own) for names, own, _ in kinds)
    share = [(SEVERAL if len(h.segments) > 1 and "@command" not in h.key else 1.0)
             / (classes[h.names, h.segments] * kinds[h.names, h.segments, h.verdict]) for h in found]  # fmt: skip
    return np.array(share) / sum(share)


init = zero_state(STATE)  # nothing heard


@kernel
def _said(x, u, p, i):
    """Return what lane `i` says: 0 silence, -1 nothing, else its token."""
    able = u.valid[i] > 0.5
    if u.alarm[i] < 0.5 or not (able or x.heard[i] > 0.5):
        return 0.0 if able else -1.0
    c, k, w = int(u.verdict[i]), int(u.isolated_part[i]), 0
    for f in range(NF):
        v = int(u.finer[f])
        if w == 0 and LANE_OF[f] == i and 0 <= v < NV:
            w = int(p.word[f, v])
    if not 0 < c < NC:
        c = int(AMBIGUOUS)
    return p.token[i, w, c, k if 0 <= k < NCUL else 0]


@kernel
def _weigh(x, p):
    """Fill x.weight with P(h) exp(x.log_mean) of every hypothesis, of sum 1; x.log_mean is the mean of
    ln prod P(token | h) over MEMORY."""
    x.times += 1.0
    share, total, age = max(EVERY / MEMORY, 1.0 / x.times), 0.0, 0 if x.since < likelihood.YOUNG else 1
    for h in range(int(p.n_h)):
        like, unlike = 1.0 - UNLIKE, UNLIKE
        for i in range(NL):
            t, j = int(x.heard[i]), int(p.twin[h, i]) - 1
            if t < 0:
                continue
            alike = ALIKE if j >= 0 and x.heard[j] >= 0.0 else 0.0
            same = alike if alike > 0.0 and t == int(x.heard[j]) else 0.0
            like *= same + (1.0 - alike) * p.p_token[age, int(p.row[h, i]), t]
            unlike *= same + (1.0 - alike) * p.p_token[2, int(p.row[h, i]), t]
        x.log_mean[h] += share * (math.log(like + unlike) - x.log_mean[h])
        x.weight[h] = p.prior[h] * math.exp(x.log_mean[h])
        total += x.weight[h]
    for h in range(int(p.n_h)):
        x.weight[h] = x.weight[h] / total if total > 0.0 else p.prior[h]


@kernel
def _name(x, p):
    """Name the finest place that holds SURE, and the class that holds SURE of it."""
    x.isolated_part, x.p, held = 0.0, 0.0, 1.0
    for level in range(NLEVEL):
        x.share[:] = 0.0
        for h in range(int(p.n_h)):
            x.share[int(p.names[h, level])] += x.weight[h]
        for n in range(1, NN):
            if x.isolated_part == 0.0 and x.share[n] >= SURE:
                x.isolated_part, x.p, held = float(n), x.share[n], x.share[n]
    x.class_share[:] = 0.0
    for h in range(int(p.n_h)):
        within = x.isolated_part == 0.0
        for level in range(NLEVEL):
            within = within or p.names[h, level] == x.isolated_part
        if within:
            x.class_share[int(p.verdict[h])] += x.weight[h]
    x.verdict = AMBIGUOUS
    for c in range(NC):
        if x.class_share[c] >= SURE * held:
            x.verdict = float(c)


@kernel
def step(x, u, p, dt):
    """Hear the lanes; weigh all hypotheses EVERY so often while one alarms."""
    x.valid, x.r = 0.0, 0.0
    for i in range(NL):
        x.heard[i] = _said(x, u, p, i)
        x.valid = max(x.valid, 1.0 if u.valid[i] > 0.5 else 0.0)
        x.r += 1.0 if x.heard[i] > 0.0 else 0.0
    if x.r == 0.0:
        x.alarm, x.verdict, x.isolated_part, x.p, x.since, x.times = 0.0, NONE, 0.0, 0.0, 0.0, 0.0
        return
    if x.alarm < 0.5:
        x.alarm, x.verdict = 1.0, AMBIGUOUS
    due = math.floor(x.since / EVERY) < math.floor((x.since + dt) / EVERY)
    x.since += dt
    if due:
        _weigh(x, p)
        _name(x, p)


rollout = entry(step, STATE, INPUTS, PARAMS)
