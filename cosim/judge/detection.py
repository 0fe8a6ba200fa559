"""Detection of one fault by one detector lane: when, under which name, whether that was right, when the alarm ended."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.judge.alarms import GRACE_S, faulty, onsets
from cosim.judge.naming import BOTH, NOT_GIVEN, Name, blames, members_of, name_of
from fdi.common import verdict as code
from fdi.common import why as reason

HOLD_S = 0.5  # a name counts as given once it has stood so long, or where it is the name at the end
LAST_S = 1.0  # the name at the end is the one that stood longest over this last part of the named time
GAP_S = 0.5  # an alarm that comes back sooner than this is the same alarm
ABLE = 0.5  # share of the time in which a lane that missed must have been valid for this to count as a miss
MOVES = ("jam_solid", "jam", "runaway")  # kinds that show only where the rod is not where it should be


@dataclass(frozen=True)
class Watch:
    """One detector lane as the judgement sees it: names, and where its outputs stand in the trace's columns."""

    id: str
    level: str  # "local", "aircraft" or "both"
    target: str  # "elevator.left_inner" or "aircraft"
    culprits: tuple  # names of the parts that it can blame, first is ""
    alarm: int
    verdict: int
    culprit: int
    r: int | None = None
    estimate: Any = None  # cosim.judge.estimation.Estimate of a fault that the lane estimates
    step_us: float = math.nan
    valid: int | None = None  # None: always
    why: int | None = None  # reason of fdi/common/why.py
    alarms: tuple = ()  # ((culprit, column), ...) of a lane with an alarm for each part
    second: int | None = None  # of a lane that names two parts at once: the other one, 0 for none
    verdict_2: int | None = None  # and its class


# of a detector, as far as it has them
OUTPUTS = ("alarm", "verdict", "culprit", "r", "valid", "why", "second", "verdict_2")


def columns(culprits: tuple, outputs: Sequence[str]) -> list[str]:
    """Return those of a detector's `outputs` that the judgement reads."""
    return [n for n in OUTPUTS if n in outputs] + [*code.alarm_fields(culprits, tuple(outputs)).values()]


def watch_of(name: str, level: str, target: str, culprits: tuple, at: Mapping[str, int], **more: Any) -> Watch:
    """Return the Watch of a lane; `at` maps its outputs to columns of the trace."""
    alarms = tuple((c, at[f]) for c, f in code.alarm_fields(culprits, tuple(at)).items())
    return Watch(name, level, target, culprits, alarms=alarms, **{n: at[n] for n in OUTPUTS if n in at}, **more)


@dataclass(frozen=True)
class Said:
    """What a lane says of one fault, over ticks: alarm, class codes, indices into `parts`."""

    alarm: NDArray[np.bool_]
    verdict: NDArray
    part: NDArray
    parts: tuple

    def name(self, k: int, watch: Watch) -> dict | None:
        """Return {class, target} of tick `k`, None where it names no class."""
        if self.verdict[k] < 0.5:
            return None
        i = self.part[k]
        part = self.parts[int(i)] if 0 <= i < len(self.parts) else ""
        target = watch.target if not part else part if watch.level != "local" else f"{watch.target}.{part}"
        return {"class": code.class_name(self.verdict[k]), "target": target}


def said(watch: Watch, trace: Any, fault: Mapping | None = None, others: Sequence[Mapping] = ()) -> Said:
    """Return what a lane says of `fault`; `trace` is (ticks, columns).

    Where the lane has an alarm for each part, it blames those of the fault's parts whose alarms are up, and every other
    one that is up and is no part of the `others`; its alarm is up for the fault while there is one of these. The class
    is the lane's while its culprit is one of the fault's parts, else that of the kind of part.
    """
    alarm, verdict, part = (trace[:, c] for c in (watch.alarm, watch.verdict, watch.culprit))
    own = dict(watch.alarms)
    if fault is not None and watch.second is not None:
        return _two(watch, trace, fault, others)
    if not own or fault is None:
        return Said(alarm > 0.5, verdict, part, watch.culprits)
    up = [trace[:, c] > 0.5 for c in own.values()]
    patterns, which = _distinct(up)
    mine = members_of(own, fault, watch.level)
    theirs = {c for f in others for c in members_of(own, f, watch.level)} - set(mine)
    blamed = [BOTH.join(c for c, there in zip(own, pattern) if there and c not in theirs) for pattern in patterns.T]
    met = np.array([bool(set(mine) & set(names.split(BOTH))) for names in blamed])[which]
    first = np.isin(part, [watch.culprits.index(c) for c in mine])
    kind = {"sensor": code.SENSOR, "engine": code.THRUST}.get(fault["targets"][0].split(".")[0], code.AMBIGUOUS)
    verdict = np.where(met & ~first, kind, verdict)
    some = np.array([bool(names) for names in blamed])[which]
    part = np.where(some, len(watch.culprits) + which, part)
    return Said(some | ((alarm > 0.5) & ~np.any(up, axis=0)), verdict, part, (*watch.culprits, *blamed))


def _distinct(rows):
    """Return (the different columns of `rows` (rows, n), index of that of each (n,)), as np.unique does; memory is that
    of the changes, which are few."""
    new = np.zeros(len(rows[0]), bool)
    new[:1] = True
    for row in rows:
        new[1:] |= row[1:] != row[:-1]
    at = np.flatnonzero(new)
    different, which = np.unique(np.stack([row[at] for row in rows]), axis=1, return_inverse=True)
    return different, np.repeat(which.ravel().astype(np.int32), np.diff(np.append(at, len(new))))


def _two(watch, trace, fault, others):
    """Return what a lane that names one part or two says of `fault`: of these, without the parts of the `others`.

    The class is that of the name which is left; with both left, or none, that of the first.
    """
    columns = watch.verdict, watch.culprit, watch.verdict_2, watch.second
    told, which = np.unique(np.stack([trace[:, c] for c in columns]), axis=1, return_inverse=True)
    parts, verdicts = [], []
    for first, i, other, j in told.T:
        names = {watch.culprits[int(k)]: c for k, c in ((i, first), (j, other)) if 0 < k < len(watch.culprits)}
        mine = members_of(names, fault, watch.level)
        theirs = {p for f in others for p in members_of(names, f, watch.level)} - set(mine)
        left = [p for p in names if p not in theirs] or list(names)
        parts.append(BOTH.join(left))
        verdicts.append(next((names[p] for p in (*mine, *left)), first))
    which = which.ravel()
    return Said(trace[:, watch.alarm] > 0.5, np.array(verdicts)[which], which.astype(float), tuple(parts))


def noticed(
    watch: Watch, trace: Any, fault: Mapping, until: float, dt: float, others: Sequence[Mapping] = ()
) -> dict:
    """Return what the lane made of `fault` before the next one begins at `until` [s]; times [s], None for never.

    It noticed when its alarm rose or, while one stands on account of earlier ones of the `others`, took this fault's
    right name. An alarm that rises while several faults are there is that of the latest, unless it blames a part of
    an earlier one and none of the latest: then it is the earlier one's, after `until`, too.

    An alarm that stood before the onset without a fault is no detection, nor is its return within GAP_S.
    `detection_delay_s` and `time_to_right_s` count from the onset, `right_after_motion_s` from when the fault has moved
    the rod 1 mm from where it would be; `not_excited` tells that a fault of MOVES never did. `isolated` is the name at
    the end: what stood for at least half of the last LAST_S of the time in which the alarm stood with a name while the
    fault was there; `class_given`, `place_given` (right, wrong, not given) and `place_level` are its Name
    (cosim/judge/naming.py), `right` tells that both are right; `named_at_s` when it was first said,
    `first_verdict` what was said first, `first_right` whether that is right, `first_sure_wrong` whether the first name
    with a class is wrong.
    `alarm_share` is the share of the time from the alarm to the end of the fault in which the alarm stands;
    `withdrawn_after_s` the time from the end of the fault to that of its last alarm, `withdrawn` whether that end was
    seen. `valid_at_fault` is the share of the fault's time in which the lane called itself valid, until it noticed; one
    that missed with less than ABLE could not judge.
    """
    ticks, start, end = len(trace), fault["start_s"], fault["end_s"]
    first = round(start / dt)
    healed, last = (_tick(t, dt, ticks) for t in (min(end, until), min(end + GRACE_S, until)))
    s = said(watch, trace, fault, others)
    earlier = [f for f in others if f["start_s"] < start]
    renamed = _renamed(watch, s, fault, first, healed, dt, others)
    rises = onsets(s.alarm)
    rises = rises[~_returned(s.alarm, rises, first, faulty(earlier, ticks, dt), dt)]
    inside = rises[(rises >= first) & (rises < last)]
    own = [i for i in inside if not _blamed(watch, s, i, earlier, fault, dt)]
    if len(own) < len(inside) and renamed is None:  # one that rose for an earlier fault may come to this one's name
        renamed = _first_right(watch, s, fault, int(inside[0]), healed, dt, others)
    k = min((i for i in (*own[:1], renamed) if i is not None), default=None)
    if k is None:
        later = [f for f in others if f["start_s"] > start]
        own = [i for i in rises[rises >= max(first, last)] if _late(watch, s, i, fault, later, dt)]
        if own:
            k, until = own[0], math.inf
            healed, last = (_tick(t, dt, ticks) for t in (end, end + GRACE_S))
            # from the first right name of a later one on it speaks of that one
            changed = (_first_right(watch, s, f, k, healed, dt, others) for f in later)
            healed = last = min((i for i in changed if i is not None), default=healed)
    out: dict[str, Any] = dict.fromkeys(
        ("detected_at_s", "detection_delay_s", "detection_delay_periods", "isolated", "named_at_s", "first_verdict",
         "time_to_right_s", "right_after_motion_s", "alarm_share", "withdrawn_after_s", "withdrawn")
    )  # fmt: skip
    out |= {"right": False, "first_right": False, "first_sure_wrong": False, "class_changes": 0, "ambiguous_s": 0.0}
    out |= {"class_given": NOT_GIVEN, "place_given": NOT_GIVEN, "place_level": ""}
    out["not_excited"] = _not_excited(watch, fault)
    if k is not None:
        out |= {
            "detected_at_s": k * dt,
            "detection_delay_s": k * dt - start,
            "detection_delay_periods": (k * dt - start) / fault["period_s"],
            **_named(watch, s, fault, k, max(k + 1, min(last, healed)), dt, others),
            **_withdrawn(s.alarm, end, k, healed, _tick(until, dt, ticks), dt),
        }
    stop = max(first + 1, healed if k is None else k)
    out |= _validity(watch, trace[first:stop], seen=k is not None)
    return {"fault": fault.get("fault"), **out}


def _tick(t, dt, ticks):
    return ticks if math.isinf(t) else min(ticks, math.ceil(t / dt))


def _returned(alarm, rises, first, earlier, dt):
    """Return (len(rises),): whether an alarm at or after tick `first` is one that stood before it without a fault.

    `earlier` (ticks,) tells where an alarm is that of an earlier fault.
    """
    falls = np.append(1 + np.flatnonzero(~alarm[1:] & alarm[:-1]), len(alarm))
    begins = rises.copy()
    for i in range(1, len(rises)):
        if (rises[i] - falls[i - 1]) * dt < GAP_S:
            begins[i] = begins[i - 1]
    return (rises >= first) & (begins < first) & ~earlier[begins]


def _named(watch, s, fault, k, end, dt, others):
    """Return what was said while the alarm stood from tick `k` to `end`: what is said of a decay is no name."""
    given = k + np.flatnonzero(s.alarm[k:end] & (s.verdict[k:end] > 0.5))
    seen = int(np.count_nonzero(s.alarm[k:end]))
    out = {"alarm_share": seen / (end - k)}
    names, which = _names(watch, s, fault, given, others, dt)
    own = np.array([not n.elsewhere for n in names], bool)[which]  # what names another fault alone is not said of this
    given, which = given[own], which[own]
    if not len(given):
        return out
    codes, at = s.verdict[given], name_at_end(s.verdict, s.part, given, dt)
    last = Name(NOT_GIVEN, NOT_GIVEN, "") if at is None else names[which[at]]
    sure = which[codes != code.AMBIGUOUS]
    out |= {
        **last_name(s, given, watch, dt),
        "first_verdict": s.name(given[0], watch),
        "class_changes": int(np.count_nonzero(np.diff(codes))),
        "ambiguous_s": float(np.count_nonzero(codes == code.AMBIGUOUS) * dt),
        "right": last.right,
        "class_given": last.class_,
        "place_given": last.place,
        "place_level": last.level,
        "first_right": names[which[0]].right,
        "first_sure_wrong": bool(len(sure)) and names[sure[0]].wrong,
    }
    at = _first_right(watch, s, fault, k, end, dt, others)
    if at is None and last.right:  # right at the end without ever standing for long
        at = round(out["named_at_s"] / dt)
    if at is not None:
        out["time_to_right_s"] = at * dt - fault["start_s"]
        moved = _moved_at(watch, fault)
        if moved is not None and math.isfinite(moved):
            out["right_after_motion_s"] = max(0.0, at * dt - moved)
    return out


def name_at_end(verdict: NDArray, part: NDArray, given: NDArray, dt: float) -> int | None:
    """Return the index in `given` (ticks with a name, n > 0) of the last tick with the name at the end: the one that
    stands for at least half of the last LAST_S, None where no name does."""
    tail = given[given > given[-1] - LAST_S / dt]
    pairs, counts = np.unique(np.stack([verdict[tail], part[tail]]), axis=1, return_counts=True)
    if 2 * counts.max() < len(tail):
        return None
    c, p = pairs[:, int(np.argmax(counts))]
    return int(np.flatnonzero((verdict[given] == c) & (part[given] == p))[-1])


def last_name(s: Said, given: NDArray, watch: Watch, dt: float) -> dict:
    """Return the name at the end of ticks `given` (n,), n > 0 (LAST_S), and when the lane first said it [s]."""
    last = name_at_end(s.verdict, s.part, given, dt)
    if last is None:
        return {"isolated": None, "named_at_s": None}
    at = given[last]
    same = (s.verdict[given] == s.verdict[at]) & (s.part[given] == s.part[at])
    return {"isolated": s.name(at, watch), "named_at_s": float(given[np.argmax(same)] * dt)}


def _names(watch, s, fault, ticks, others, dt):
    """Return (the different Names of `fault` that are said at `ticks` (or a slice), index of that at each (n,)).

    Of the `others`, those count that are there at the tick.
    """
    there: Any = np.zeros(len(s.verdict[ticks]), np.int64 if len(others) > 30 else np.int32)
    for i, f in enumerate(others):
        there += faulty([f], len(s.alarm), dt)[ticks].astype(there.dtype) << i
    keys, which = _distinct([s.verdict[ticks], s.part[ticks], there])
    names = []
    for c, p, mask in keys.T:
        part = s.parts[int(p)] if 0 <= p < len(s.parts) else ""
        met = [f for i, f in enumerate(others) if int(mask) >> i & 1]
        names.append(name_of(fault, watch.level, code.class_name(c), part, met))
    return names, which


def _blamed(watch, s, k, faults, instead, dt):
    """Return whether what is said at tick `k` names a part of one of `faults` that is there then, none of `instead`."""
    part = s.parts[int(s.part[k])] if 0 <= s.part[k] < len(s.parts) else ""
    if not part or blames(part, instead, watch.level):
        return False
    there = (f for f in faults if faulty([f], len(s.alarm), dt)[k])
    return any(blames(part, f, watch.level) for f in there)


def _late(watch, s, k, fault, later, dt):
    """Return whether the alarm that rises at tick `k`, after the onset of `later` faults, is that of `fault` alone."""
    there = [f for f in later if f["start_s"] <= k * dt]
    return all(_blamed(watch, s, k, [fault], f, dt) for f in there) if there else False


def _renamed(watch, s, fault, first, healed, dt, others):
    """Return the tick at which an alarm that stands on account of an earlier fault takes the right name of this one.

    None where it does not, or had that name before: it may be the earlier fault's.
    """
    earlier = [f for f in others if f["start_s"] < fault["start_s"]]
    if not earlier or not 0 < first < len(s.alarm) or not s.alarm[first - 1]:
        return None
    rose = onsets(s.alarm)
    if not faulty(earlier, len(s.alarm), dt)[rose[rose < first][-1]]:
        return None
    at = _first_right(watch, s, fault, first - 1, healed, dt, others)
    return None if at == first - 1 else at


def _first_right(watch, s, fault, first, end, dt, others):
    """Return the first tick in [first, end) from which an alarm has the right name of `fault` for HOLD_S, else None."""
    ticks = slice(first, max(first, end))
    names, which = _names(watch, s, fault, ticks, others, dt)
    good = np.array([n.right for n in names], bool)[which] & s.alarm[ticks] & (s.verdict[ticks] > 0.5)
    for begin in onsets(good):
        stop = begin + int(np.argmin(np.append(good[begin:], False)))
        if (stop - begin) * dt >= HOLD_S - 1e-9:
            return first + int(begin)
    return None


def _withdrawn(alarm, end_s, k, healed, until, dt):
    """Return how the alarm that rose at tick `k` ended once the fault had healed at `end_s`, before tick `until`."""
    if math.isinf(end_s) or healed >= until:
        return {}
    high = np.flatnonzero(alarm[healed:until])
    gone = not len(high) or healed + high[-1] + 1 < until
    after = 0.0 if not len(high) else max(0.0, (healed + high[-1] + 1) * dt - end_s)
    return {"withdrawn": bool(gone), "withdrawn_after_s": after if gone else None}


def _moved_at(watch, fault):
    """Return when the fault had moved the lane's rod by 1 mm [s], inf for never, None where nobody looked."""
    when = fault.get("moved_at_s")
    if when is None or not when:
        return None
    own = [t for seg, t in when.items() if watch.level != "local" or watch.target == f"elevator.{seg}"]
    return max(fault["start_s"], min(own)) if own else None


def _not_excited(watch, fault):
    moved = _moved_at(watch, fault)
    return None if moved is None or fault.get("kind") not in MOVES else math.isinf(moved)


def _validity(watch, trace, seen):
    share, why = validity(watch, trace)
    able = seen or share >= ABLE
    return {"able": able, "valid_at_fault": share, "why_not_valid": None if able else why}


def valid(watch: Watch, trace: Any) -> NDArray[np.bool_]:
    """Return (ticks,): whether the lane calls itself valid; always, where it does not say."""
    return np.ones(len(trace), bool) if watch.valid is None else trace[:, watch.valid] > 0.5


def validity(watch: Watch, trace: Any) -> tuple[float, str | None]:
    """Return (share of ticks in which the lane called itself valid, its most frequent reason in the others)."""
    if watch.valid is None or not len(trace):
        return 1.0, None
    down = ~valid(watch, trace)
    share = 1.0 - float(np.count_nonzero(down)) / len(trace)
    if watch.why is None or not down.any():
        return share, None
    codes = trace[down, watch.why]
    codes = codes[codes > 0.5].astype(int)
    return share, reason.words(float(np.bincount(codes).argmax())) if len(codes) else None
