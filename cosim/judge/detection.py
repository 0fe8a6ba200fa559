"""Detection of one fault by one detector lane: when, under which name, whether that was right, when the alarm ended."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.judge.alarms import GRACE_S, during, span
from cosim.judge.naming import BOTH, NOT_GIVEN, RIGHT, Name, alike, blames, members_of, name_of, parts_of
from cosim.judge.runs import Runs
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


def runs_of(watch: Watch, trace: Any, faults: Sequence[Mapping], dt: float) -> Runs:
    """Return the Runs of a lane in `trace` (ticks, columns), cut where one of `faults` begins or ends."""
    columns = watch.alarm, watch.verdict, watch.culprit, watch.valid, watch.why, watch.second, watch.verdict_2
    own = [c for c in (*columns, *dict(watch.alarms).values()) if c is not None]
    return Runs(trace, own, [k for f in faults for k in span(f, dt) if k is not None])


@dataclass(frozen=True)
class Said:
    """What a lane says of one fault, by runs: alarm, class codes, indices into `parts`."""

    alarm: NDArray[np.bool_]
    verdict: NDArray
    part: NDArray
    parts: tuple

    def blamed(self, run: int) -> str:
        """Return the name of the part that is blamed in a run, "" without one."""
        i = self.part[run]
        return self.parts[int(i)] if 0 <= i < len(self.parts) else ""

    def name(self, run: int, watch: Watch) -> dict | None:
        """Return {class, target} of a run, None where it names no class."""
        if self.verdict[run] < 0.5:
            return None
        part = self.blamed(run)
        target = watch.target if not part else part if watch.level != "local" else f"{watch.target}.{part}"
        return {"class": code.class_name(self.verdict[run]), "target": target}


def said(watch: Watch, runs: Runs, fault: Mapping | None = None, others: Sequence[Mapping] = ()) -> Said:
    """Return what a lane says of `fault`.

    Where the lane has an alarm for each part, it blames those of the fault's parts whose alarms are up, and every other
    one that is up and is no part of the `others`; its alarm is up for the fault while there is one of these. The class
    is the lane's while its culprit is one of the fault's parts, or names one beside others, else that of the kind of
    part.
    """
    alarm, verdict, part = (runs[c] for c in (watch.alarm, watch.verdict, watch.culprit))
    own = dict(watch.alarms)
    if fault is not None and watch.second is not None:
        return _two(watch, runs, fault, others)
    if not own or fault is None:
        return Said(alarm > 0.5, verdict, part, watch.culprits)
    up = [runs[c] > 0.5 for c in own.values()]
    patterns, which = _distinct(up)
    mine = members_of(own, fault, watch.level)
    theirs = {c for f, *_ in alike(others) for c in members_of(own, f, watch.level)} - set(mine)
    blamed = [BOTH.join(c for c, there in zip(own, pattern) if there and c not in theirs) for pattern in patterns.T]
    met = np.array([bool(set(mine) & set(names.split(BOTH))) for names in blamed])[which]
    first = np.isin(part, [i for i, c in enumerate(watch.culprits) if set(mine) & set(c.split(BOTH))])
    kind = {"sensor": code.SENSOR, "engine": code.THRUST}.get(fault["targets"][0].split(".")[0], code.AMBIGUOUS)
    verdict = np.where(met & ~first, kind, verdict)
    some = np.array([bool(names) for names in blamed])[which]
    part = np.where(some, len(watch.culprits) + which, part)
    return Said(some | ((alarm > 0.5) & ~np.any(up, axis=0)), verdict, part, (*watch.culprits, *blamed))


def _distinct(rows):
    """Return (the different columns of `rows` (rows, n), index of that of each (n,))."""
    different, which = np.unique(np.stack(rows), axis=1, return_inverse=True)
    return different, which.ravel()


def _two(watch, runs, fault, others):
    """Return what a lane that names one part or two says of `fault`: of these, without the parts of the `others`. The
    class is that of the name which is left; with both left, or none, that of the first."""
    columns = watch.verdict, watch.culprit, watch.verdict_2, watch.second
    told, which = _distinct([runs[c] for c in columns])
    parts, verdicts, different = [], [], [f for f, *_ in alike(others)]
    for first, i, other, j in told.T:
        names = {watch.culprits[int(k)]: c for k, c in ((i, first), (j, other)) if 0 < k < len(watch.culprits)}
        mine = members_of(names, fault, watch.level)
        theirs = {p for f in different for p in members_of(names, f, watch.level)} - set(mine)
        left = [p for p in names if p not in theirs] or list(names)
        parts.append(BOTH.join(left))
        verdicts.append(next((names[p] for p in (*mine, *left)), first))
    return Said(runs[watch.alarm] > 0.5, np.array(verdicts)[which], which.astype(float), tuple(parts))


def noticed(watch: Watch, runs: Runs, fault: Mapping, until: float, dt: float, others: Sequence[Mapping] = ()) -> dict:
    """Return what the lane made of `fault` before the next one begins at `until` [s]; times [s], None for never.

    It noticed when its alarm rose or, while one stands on account of earlier ones of the `others`, when its name came
    to this fault: the right one, or its place with the class not given. An alarm that rises while several faults are
    there is that of the latest, unless it blames a part of an earlier one and none of the latest: then it is the
    earlier one's, after `until`, too. `masked` tells that it did not notice and could not alarm anew: the alarm of an
    earlier fault of the same part stood from before the onset to the end of the fault, or of the flight.

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
    ticks, start, end = runs.ticks, fault["start_s"], fault["end_s"]
    first = round(start / dt)
    healed, last = (_tick(t, dt, ticks) for t in (min(end, until), min(end + GRACE_S, until)))
    s = said(watch, runs, fault, others)
    lane = _Lane(watch, runs, s, dt, others)
    earlier = [f for f in others if f["start_s"] < start]
    renamed = lane.renamed(fault, first, healed)
    rises = runs.onsets(s.alarm)
    rises = rises[~_returned(rises, runs.ends(s.alarm), first, earlier, dt)]
    inside = rises[(rises >= first) & (rises < last)]
    own = [i for i in inside if not lane.blamed(i, earlier, fault)]
    if len(own) < len(inside) and renamed is None:  # one that rose for an earlier fault may come to this one's name
        renamed = lane.first_right(fault, int(inside[0]), healed)
    k = min((i for i in (*own[:1], renamed) if i is not None), default=None)
    if k is None:
        later = [f for f in others if f["start_s"] > start]
        k = lane.late(rises[rises >= max(first, last)], fault, later)
        if k is not None:
            until = math.inf
            healed, last = (_tick(t, dt, ticks) for t in (end, end + GRACE_S))
            # from the first right name of a later one on it speaks of that one
            changed = (lane.first_right(f, k, healed) for f, *_ in alike(later))
            healed = last = min((i for i in changed if i is not None), default=healed)
    out: dict[str, Any] = dict.fromkeys(
        ("detected_at_s", "detection_delay_s", "detection_delay_periods", "isolated", "named_at_s", "first_verdict",
         "time_to_right_s", "right_after_motion_s", "alarm_share", "withdrawn_after_s", "withdrawn")
    )  # fmt: skip
    out |= {"right": False, "first_right": False, "first_sure_wrong": False, "class_changes": 0, "ambiguous_s": 0.0}
    out |= {"class_given": NOT_GIVEN, "place_given": NOT_GIVEN, "place_level": ""}
    moved = _moved_at(watch, fault)
    out["masked"] = k is None and lane.masked(fault, first, healed)
    out["not_excited"] = None if moved is None or fault.get("kind") not in MOVES else math.isinf(moved)
    if k is not None:
        late = max(0.0, k * dt - start)  # an onset lies within a tick
        out |= {
            "detected_at_s": k * dt,
            "detection_delay_s": late,
            "detection_delay_periods": late / fault["period_s"],
            **lane.named(fault, k, max(k + 1, min(last, healed))),
            **lane.withdrawn(end, healed, _tick(until, dt, ticks)),
        }
    stop = max(first + 1, healed if k is None else k)
    share, why = validity(watch, runs, first, stop)
    able = k is not None or share >= ABLE
    out |= {"able": able, "valid_at_fault": share, "why_not_valid": None if able else why}
    return {"fault": fault.get("fault"), **out}


def _tick(t, dt, ticks):
    return ticks if math.isinf(t) else min(ticks, math.ceil(t / dt))


def _returned(rises, falls, first, earlier, dt):
    """Return (len(rises),): whether an alarm at or after tick `first` is one that stood before it without a fault: it
    rises less than GAP_S after the one before has fallen. `earlier` are the faults whose alarms those before may be."""
    begins = rises.copy()
    for i in range(1, len(rises)):
        if (rises[i] - falls[i - 1]) * dt < GAP_S:
            begins[i] = begins[i - 1]
    return (rises >= first) & (begins < first) & ~during(earlier, begins, dt)


def name_at_end(verdict: NDArray, part: NDArray, first: NDArray, stop: NDArray, dt: float) -> int | None:
    """Return the index of the last run with the name at the end, of n > 0 runs with a name, each of the ticks first <=
    k < stop: the name that stands for at least half of the last LAST_S, None where no name does."""
    begin = math.floor(stop[-1] - 1 - LAST_S / dt) + 1
    length = np.maximum(stop - np.maximum(first, begin), 0)
    names, which = _distinct([verdict, part])
    counts = np.bincount(which, length, names.shape[1])
    if 2 * counts.max() < length.sum():
        return None
    return int(np.flatnonzero(which == np.argmax(counts))[-1])


def last_name(s: Said, given: tuple[NDArray, NDArray, NDArray], watch: Watch, dt: float) -> dict:
    """Return the name at the end of n > 0 runs with a name, `given` as Runs.inside does, and when the lane first said
    it [s]."""
    run, first, stop = given
    last = name_at_end(s.verdict[run], s.part[run], first, stop, dt)
    if last is None:
        return {"isolated": None, "named_at_s": None}
    same = (s.verdict[run] == s.verdict[run[last]]) & (s.part[run] == s.part[run[last]])
    return {"isolated": s.name(run[last], watch), "named_at_s": float(first[np.argmax(same)] * dt)}


@dataclass(frozen=True)
class _Lane:
    """What a lane says of one fault, beside the `others`; ticks are `dt` [s] apart."""

    watch: Watch
    runs: Runs
    said: Said
    dt: float
    others: Sequence[Mapping]

    def given(self, first: int, stop: int) -> tuple[NDArray, NDArray, NDArray]:
        """Return those of Runs.inside in which an alarm stands with a name."""
        run, a, b = self.runs.inside(first, stop)
        there = self.said.alarm[run] & (self.said.verdict[run] > 0.5)
        return run[there], a[there], b[there]

    def named(self, fault: Mapping, k: int, end: int) -> dict:
        """Return what was said while the alarm stood from tick `k` to `end`: what is said of a decay is no name."""
        s, watch, dt = self.said, self.watch, self.dt
        out: dict[str, Any] = {"alarm_share": self.runs.count(s.alarm, k, end) / (end - k)}
        run, first, stop = self.given(k, end)
        names, which = self.names(fault, run)
        own = np.array([not n.elsewhere for n in names], bool)[which]  # what names another fault alone is of that one
        run, first, stop, which = run[own], first[own], stop[own], which[own]
        if not len(run):
            return out
        codes, at = s.verdict[run], name_at_end(s.verdict[run], s.part[run], first, stop, dt)
        last = Name(NOT_GIVEN, NOT_GIVEN, "") if at is None else names[which[at]]
        unsure = codes == code.AMBIGUOUS
        sure = which[~unsure]
        out |= {
            **last_name(s, (run, first, stop), watch, dt), "first_verdict": s.name(run[0], watch),
            "class_changes": int(np.count_nonzero(np.diff(codes))),
            "ambiguous_s": float((stop - first)[unsure].sum() * dt), "right": last.right, "class_given": last.class_,
            "place_given": last.place, "place_level": last.level, "first_right": names[which[0]].right,
            "first_sure_wrong": bool(len(sure)) and names[sure[0]].wrong,
        }  # fmt: skip
        at = self.first_right(fault, k, end)
        if at is None and last.right:  # right at the end without ever standing for long
            at = round(out["named_at_s"] / dt)
        if at is not None:
            out["time_to_right_s"] = max(0.0, at * dt - fault["start_s"])
            moved = _moved_at(watch, fault)
            if moved is not None and math.isfinite(moved):
                out["right_after_motion_s"] = max(0.0, at * dt - moved)
        return out

    def names(self, fault: Mapping, run: NDArray) -> tuple[list[Name], NDArray]:
        """Return (the different Names of `fault` that are said in these runs, index of that of each (n,)). Of the
        `others`, those count that are there then."""
        if not len(run):
            return [], run
        s, at = self.said, self.runs.at[run]
        groups = alike(self.others)
        keys, which = _distinct([s.verdict[run], s.part[run], *(during(group, at, self.dt) for group in groups)])
        names = []
        for c, p, *there in keys.T:
            part = s.parts[int(p)] if 0 <= p < len(s.parts) else ""
            met = [group[0] for group, here in zip(groups, there) if here]
            names.append(name_of(fault, self.watch.level, code.class_name(c), part, met))
        return names, which

    def blamed(self, k: int, faults: Sequence[Mapping], instead: Mapping) -> bool:
        """Return whether what is said at tick `k` names a part of one of `faults` that is there then, none of
        `instead`."""
        part = self.said.blamed(self.runs.of(k))
        if not part or blames(part, instead, self.watch.level):
            return False
        there = (f for f in faults if during([f], k, self.dt))
        return any(blames(part, f, self.watch.level) for f in there)

    def late(self, rises: NDArray, fault: Mapping, later: Sequence[Mapping]) -> int | None:
        """Return the first of the ticks `rises`, after the onset of `later` faults, at which the alarm that rises is
        that of `fault` alone; None without one."""
        begun = [(min(f["start_s"] for f in group), group[0]) for group in alike(later)]
        for k in rises[during([fault], rises, self.dt)]:
            there = [f for start, f in begun if start <= k * self.dt]
            if there and all(self.blamed(k, [fault], f) for f in there):
                return int(k)
        return None

    def stands(self, earlier: Sequence[Mapping], first: int) -> bool:
        """Return whether an alarm that rose for one of the `earlier` faults stands when another begins at `first`."""
        if not earlier or not 0 < first < self.runs.ticks or not self.said.alarm[self.runs.of(first - 1)]:
            return False
        rose = self.runs.onsets(self.said.alarm)
        return bool(during(earlier, rose[rose < first][-1], self.dt))

    def masked(self, fault: Mapping, first: int, stop: int) -> bool:
        """Return whether the alarm of an earlier fault of the same part stands in all ticks first <= k < stop."""
        earlier = [f for f in self.others if f["start_s"] < fault["start_s"] and parts_of(f) & parts_of(fault)]
        return self.stands(earlier, first) and self.runs.count(self.said.alarm, first, stop) == stop - first

    def renamed(self, fault: Mapping, first: int, healed: int) -> int | None:
        """Return the tick at which the name of an alarm that stands on account of an earlier fault comes to this one:
        the right one, or its place where the class is not given and the place was another before. None where it does
        not, or had that name before: it may be the earlier fault's."""
        if not self.stands([f for f in self.others if f["start_s"] < fault["start_s"]], first):
            return None
        (before,), _ = self.names(fault, self.runs.of(np.array([first - 1])))

        def of_it(name: Name) -> bool:
            return name.right or (name.class_ == NOT_GIVEN and name.place == RIGHT != before.place)

        at = self.first_right(fault, first - 1, healed, of_it)
        return None if at == first - 1 else at

    def first_right(
        self, fault: Mapping, first: int, end: int, right: Callable[[Name], bool] = lambda name: name.right
    ) -> int | None:
        """Return the first tick in [first, end) from which an alarm has the `right` name of `fault` for HOLD_S, else
        None."""
        run, a, b = self.given(first, end)
        names, which = self.names(fault, run)
        good = np.array([right(n) for n in names], bool)[which]
        a, b = a[good], b[good]
        apart = np.append(True, a[1:] != b[:-1])  # one begins where the last one ends: the same stretch
        for begin, stop in zip(a[apart], b[np.append(apart[1:], True)]) if len(a) else ():
            if (stop - begin) * self.dt >= HOLD_S - 1e-9:
                return int(begin)
        return None

    def withdrawn(self, end_s: float, healed: int, until: int) -> dict:
        """Return how the alarm ended once the fault had healed at `end_s` [s], tick `healed`, before tick `until`."""
        if math.isinf(end_s) or healed >= until:
            return {}
        run, _, stop = self.runs.inside(healed, until)
        last = stop[self.said.alarm[run]]
        gone = not len(last) or last[-1] < until
        after = 0.0 if not len(last) else max(0.0, int(last[-1]) * self.dt - end_s)
        return {"withdrawn": bool(gone), "withdrawn_after_s": after if gone else None}


def _moved_at(watch, fault):
    """Return when the fault had moved the lane's rod by 1 mm [s], inf for never, None where nobody looked."""
    when = fault.get("moved_at_s")
    if when is None or not when:
        return None
    own = [t for seg, t in when.items() if watch.level != "local" or watch.target == f"elevator.{seg}"]
    return max(fault["start_s"], min(own)) if own else None


def valid(watch: Watch, trace: Any) -> NDArray[np.bool_]:
    """Return (ticks,), of a trace, or (runs,), of Runs: whether the lane calls itself valid; always, where it does not
    say."""
    if watch.valid is None:
        return np.ones(len(trace), bool)
    return (trace[watch.valid] if isinstance(trace, Runs) else trace[:, watch.valid]) > 0.5


def validity(watch: Watch, runs: Runs, first: int, stop: int) -> tuple[float, str | None]:
    """Return (share of the ticks first <= k < stop in which the lane called itself valid, its most frequent reason in
    the others)."""
    run, a, b = runs.inside(first, stop)
    if watch.valid is None or not len(run):
        return 1.0, None
    down, length = ~valid(watch, runs)[run], b - a
    share = 1.0 - float(length[down].sum()) / int(length.sum())
    if watch.why is None or not down.any():
        return share, None
    codes = runs[watch.why][run]
    told = down & (codes > 0.5)
    if not told.any():
        return share, None
    return share, reason.words(float(np.bincount(codes[told].astype(int), length[told]).argmax()))
