"""Detection of one fault by one detector lane: when, under which name, whether that was right, when the alarm ended."""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.judge.alarms import GRACE_S, during, span
from cosim.judge.naming import BOTH, NOT_GIVEN, RIGHT, Name, alike, blames, members_of, name_of, parts_of
from cosim.judge.store import release
from fdi.common import verdict as code
from fdi.common import why as reason

if TYPE_CHECKING:
    from cosim.judge.estimation import Estimate

HOLD_S = 0.5  # a name counts as given once it has stood so long, or where it is the name at the end
LAST_S = 1.0  # the name at the end is the one that stood longest over this last part of the named time
GAP_S = 0.5  # an alarm that comes back sooner than this is the same alarm
ABLE = 0.5  # share of the time in which a lane that missed must have been valid for this to count as a miss
MOVES = ("jam_solid", "jam", "runaway")  # kinds that show only where the rod is not where it should be
SAID = ("verdict", "isolated_part", "alarm")
OUTPUTS = (*SAID, "r", "valid", "why")
NO_FAULT: Mapping = {"targets": (), "start_s": math.inf, "end_s": math.inf}
BLOCK = 1 << 16  # ticks of a trace that are looked at together
UNSEEN = {
    **dict.fromkeys(("detected_at_s", "detection_delay_s", "detection_delay_periods", "isolated", "named_at_s",
                     "first_verdict", "time_to_right_s", "right_after_motion_s", "alarm_share", "withdrawn_after_s",
                     "withdrawn")),
    "right": False, "first_right": False, "first_sure_wrong": False, "class_changes": 0, "ambiguous_s": 0.0,
    "class_given": NOT_GIVEN, "place_given": NOT_GIVEN, "place_level": "",
}  # fmt: skip


@dataclass(frozen=True)
class JudgedLane:
    """A detector lane as the judgement sees it: names, and where its outputs stand in the columns of a trace."""

    id: str
    level: str  # "local", "aircraft" or "both"
    target: str  # "elevator.left_inner" or "aircraft"
    parts: tuple  # names of the parts that it can blame, first is ""
    at: Mapping[str, int]  # output -> column of the trace; without `valid` it is always valid
    estimate: "Estimate | None" = None  # of a fault
    step_us: float = math.nan

    @property
    def alarms(self) -> dict[str, str]:
        """Return {part: its output} of a lane with an alarm for each part."""
        return code.alarm_fields(self.parts, tuple(self.at))


def outputs_read(parts: tuple, outputs: Sequence[str]) -> list[str]:
    """Return those of a detector's `outputs` that the judgement reads."""
    return [n for n in OUTPUTS if n in outputs] + [*code.alarm_fields(parts, tuple(outputs)).values()]


class Said:
    """What a lane says from tick to tick, in blocks that follow one another: kept where it changes.

    `first` are the ticks at which something of it changes, `rows` (changes, names) what it says from there on. `peaks`
    are the largest |r| before the first of the flight's `faults` and from its onset on, NaN where there is none.
    """

    def __init__(self, lane: JudgedLane, dt: float, faults: Sequence[Mapping]):
        self.lane, self.ticks, self.peaks = lane, 0, [math.nan, math.nan]
        self.names = [n for n in (*SAID, *lane.alarms.values(), "valid", "why") if n in lane.at]
        self._columns = [lane.at[n] for n in self.names]
        self._onset = min((round(f["start_s"] / dt) for f in faults), default=None)
        self._changes: list[tuple[NDArray, NDArray]] = [(np.zeros(0, int), np.zeros((0, len(self.names))))]
        self._last = np.full((1, len(self.names)), math.nan)

    def add(self, trace: NDArray) -> "Said":
        """Take the outputs (ticks, columns) of the next ticks; return itself."""
        for a in range(0, len(trace), BLOCK):
            rows = trace[a : a + BLOCK]
            said = rows[:, self._columns]
            new = (said != np.vstack([self._last, said[:-1]])).any(axis=1)
            self._changes.append((self.ticks + np.flatnonzero(new), said[new]))
            if "r" in self.lane.at:
                r, n = np.abs(rows[:, self.lane.at["r"]]), len(rows)
                cut = n if self._onset is None else min(max(self._onset - self.ticks, 0), n)
                halves = zip((r[:cut], r[cut:]), self.peaks)
                self.peaks = [float(np.fmax.reduce(part, initial=peak)) for part, peak in halves]
            self._last, self.ticks = said[-1:], self.ticks + len(rows)
            release(trace)
        return self

    @property
    def first(self) -> NDArray:
        """Return the ticks at which something changes (changes,)."""
        return np.concatenate([first for first, _ in self._changes])

    @property
    def rows(self) -> NDArray:
        """Return what is said from each of them on (changes, names)."""
        return np.concatenate([rows for _, rows in self._changes])

    def spans(self, name: str) -> list[tuple[int, int]]:
        """Return [(first tick, tick after the last)] of the stretches in which an output is above one half."""
        on = self.rows[:, self.names.index(name)] > 0.5
        edges = np.append(self.first, self.ticks)[np.flatnonzero(np.diff(on, prepend=False, append=False))]
        return list(zip(edges[::2].tolist(), edges[1::2].tolist()))


class Runs:
    """Runs of a lane: run i holds the ticks first[i] <= k < stop[i], in which nothing changes that the lane says."""

    def __init__(self, told: Said, faults: Sequence[Mapping], dt: float):
        """A run begins at each bound of one of the `faults`, too."""
        self.lane, self.ticks, changes = told.lane, told.ticks, told.first
        bounds = [k for f in faults for k in span(f, dt) if k is not None and 0 <= k < self.ticks]
        self.first = np.union1d(changes, np.array(bounds, int))
        self.stop = np.append(self.first[1:], self.ticks)
        rows = told.rows[np.searchsorted(changes, self.first, side="right") - 1]
        values = {"valid": np.ones(len(rows)), "why": np.zeros(len(rows))} | dict(zip(told.names, rows.T))
        self.valid, self.why = values.pop("valid") > 0.5, np.nan_to_num(values.pop("why")).astype(int)
        self.names, self.said = tuple(values), list(zip(*(column.tolist() for column in values.values())))

    def of(self, k: Any) -> Any:
        """Return the run of tick `k`, or of each of several."""
        return np.searchsorted(self.first, k, side="right") - 1

    def inside(self, first: int, stop: int) -> tuple[NDArray, NDArray, NDArray]:
        """Return (runs, first tick of each, tick after each) of the ticks first <= k < stop."""
        a, b = np.maximum(self.first, first), np.minimum(self.stop, stop)
        i = np.flatnonzero(a < b)
        return i, a[i], b[i]

    def count(self, mask: NDArray, first: int = 0, stop: int | None = None) -> int:
        """Return the number of ticks in [first, stop) of the runs in which `mask` (runs,) holds."""
        i, a, b = self.inside(first, self.ticks if stop is None else stop)
        return int((b - a)[mask[i]].sum())

    def validity(self, first: int, stop: int) -> tuple[float, str | None]:
        """Return (share of the ticks first <= k < stop in which the lane called itself valid, its most frequent reason
        in the others)."""
        run, a, b = self.inside(first, stop)
        down, length = ~self.valid[run], b - a
        told = np.bincount(self.why[run][down], length[down])
        why = reason.words(float(told[1:].argmax() + 1)) if told[1:].any() else None
        return float(1.0 - length[down].sum() / max(length.sum(), 1)), why


def noticed(runs: Runs, fault: Mapping, until: float, dt: float, others: Sequence[Mapping] = ()) -> dict:
    """Return what a lane made of `fault` before the next one begins at `until` [s]; times [s], None for never.

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
    heard, start = Heard(runs, fault, others, dt), fault["start_s"]
    first, healed = round(start / dt), heard.tick(min(fault["end_s"], until))
    k, last = heard.alarm_of(first, healed, until), heard.tick(min(fault["end_s"] + GRACE_S, until))
    if k is not None and k >= last:  # after the onset of the next one
        until, last = math.inf, heard.tick(fault["end_s"])
        healed = last
    moved = heard.moved_at
    out = {"fault": fault.get("fault"), **UNSEEN, "masked": k is None and heard.masked(first, healed)}
    out["not_excited"] = None if moved is None or fault.get("kind") not in MOVES else math.isinf(moved)
    if k is not None:
        late = max(0.0, k * dt - start)  # an onset lies within a tick
        out |= {"detected_at_s": k * dt, "detection_delay_s": late,
                "detection_delay_periods": late / fault["period_s"],
                **heard.named(k, max(k + 1, min(last, healed))), **heard.withdrawn(healed, until)}  # fmt: skip
    share, why = runs.validity(first, max(first + 1, healed if k is None else k))
    able = k is not None or share >= ABLE
    return {**out, "able": able, "valid_at_fault": share, "why_not_valid": None if able else why}


class Word(NamedTuple):
    """A class and a part that are named together in the ticks first <= k < stop, and how that stands to a fault."""

    first: int
    stop: int
    said: tuple[float, str]
    name: Name


def name_at_end(words: Sequence[Word], dt: float) -> Word | None:
    """Return the last of n > 0 words with the name at the end: the one that stands for at least half of the last
    LAST_S of their time, None where no name does."""
    begin = math.floor(words[-1].stop - 1 - LAST_S / dt) + 1
    held = dict.fromkeys(sorted({w.said for w in words}), 0)
    for w in words:
        held[w.said] += max(w.stop - max(w.first, begin), 0)
    longest = max(held, key=lambda said: held[said])
    return next(w for w in reversed(words) if w.said == longest) if 2 * held[longest] >= sum(held.values()) else None


def _says(lane, said, fault, mine, theirs):
    """Return (alarm, class code, part) of what a lane says, taken as said of `fault`; `mine` are its parts, `theirs`
    those of the other faults.

    Where the lane has an alarm for each part, it blames those of the fault's parts whose alarms are up, and every other
    one that is up and not `theirs`; its alarm is up for the fault while there is one of these. The class is the lane's
    while its part is one of the fault's, or names one beside others, else that of the kind of part.
    """
    parts = dict(enumerate(lane.parts))
    alarm, verdict, part = said["alarm"] > 0.5, said["verdict"], parts.get(int(said["isolated_part"]), "")
    if not fault["targets"]:
        return alarm, verdict, part
    up = [p for p, output in lane.alarms.items() if said[output] > 0.5]
    blamed = [p for p in up if p not in theirs]
    if mine & set(blamed) and not mine & set(part.split(BOTH)):
        kinds = {"sensor": code.SENSOR, "engine": code.THRUST}
        verdict = kinds.get(fault["targets"][0].split(".")[0], code.AMBIGUOUS)
    return bool(blamed) or (alarm and not up), verdict, BOTH.join(blamed) or part


class Heard:
    """What a lane says of one fault, beside the `others`; of NO_FAULT all that it says. Arrays are over its runs."""

    def __init__(self, runs: Runs, fault: Mapping, others: Sequence[Mapping], dt: float):
        self.runs, self.lane, self.fault, self.others, self.dt = runs, runs.lane, fault, others, dt
        self.groups = alike(others)
        self.there = [during(group, runs.first, dt) for group in self.groups]
        self.earlier = [f for f in others if f["start_s"] < fault["start_s"]]
        self.later = alike(f for f in others if f["start_s"] > fault["start_s"])
        mine = set(members_of(self.lane.parts, fault, self.lane.level))
        theirs = {p for f, *_ in self.groups for p in members_of(self.lane.parts, f, self.lane.level)} - mine
        says = functools.cache(lambda *said: _says(self.lane, dict(zip(runs.names, said)), fault, mine, theirs))
        heard = [says(*said) for said in runs.said]
        self.words = [(verdict, part) for _, verdict, part in heard]  # of each run
        self.alarm = np.array([alarm for alarm, *_ in heard], bool)
        self.rises = runs.first[self.alarm & ~np.append(False, self.alarm[:-1])]

        @functools.cache
        def named(verdict, part, *here):
            met = [group[0] for group, is_here in zip(self.groups, here) if is_here]
            return name_of(fault, self.lane.level, code.class_name(verdict), part, met)

        self._name = named

    def tick(self, t: float) -> int:
        """Return the first tick at or after `t` [s], at most the number of ticks."""
        return self.runs.ticks if math.isinf(t) else min(self.runs.ticks, math.ceil(t / self.dt))

    # -- alarms

    def alarm_of(self, first: int, healed: int, until: float) -> int | None:
        """Return the tick at which the lane noticed the fault, which acts from `first` to `healed`, before the next
        one begins at `until` [s] or, with an alarm that is of this one alone, later; None where it did not."""
        rises = self.rises[(self.rises >= first) & ~self._returned(first)]
        rises = rises[during([self.fault], rises, self.dt)]
        later = [(min(f["start_s"] for f in group), group[0]) for group in self.later]
        own = [k for k in rises if not self.blames(k, self.earlier, self.fault)
               and all(self.blames(k, [self.fault], f) for start, f in later if until <= start <= k * self.dt)]
        before = [k for k in rises if k < self.tick(until)]
        named = self.renamed(first, healed)
        if named is None and before and own[:1] != before[:1]:  # that of an earlier fault may come to this one's name
            named = self.first_right(before[0], healed)
        return min((int(k) for k in (*own[:1], named) if k is not None), default=None)

    def _returned(self, first):
        """Return whether each of the rises from tick `first` on is that of an alarm that stood before without a fault:
        it rises less than GAP_S after the one before has fallen."""
        falls = self.runs.stop[self.alarm & ~np.append(self.alarm[1:], False)]
        apart = np.append(True, (self.rises[1:] - falls[:-1]) * self.dt >= GAP_S)[: len(falls)]
        begins = self.rises[apart][np.cumsum(apart) - 1]
        return (begins < first) & ~during(self.earlier, begins, self.dt)

    def blames(self, k: int, faults: Sequence[Mapping], instead: Mapping) -> bool:
        """Return whether what is said at tick `k` names a part of one of `faults` that is there then, none of
        `instead`."""
        _, part = self.words[self.runs.of(k)]
        if not part or blames(part, instead, self.lane.level):
            return False
        return any(blames(part, f, self.lane.level) for f in faults if during([f], k, self.dt))

    def stands(self, earlier: Sequence[Mapping], first: int) -> bool:
        """Return whether an alarm that rose for one of the `earlier` faults stands when another begins at `first`."""
        if not earlier or not 0 < first < self.runs.ticks or not self.alarm[self.runs.of(first - 1)]:
            return False
        return bool(during(earlier, self.rises[self.rises < first][-1], self.dt))

    def masked(self, first: int, stop: int) -> bool:
        """Return whether the alarm of an earlier fault of the same part stands in all ticks first <= k < stop."""
        same = [f for f in self.earlier if parts_of(f) & parts_of(self.fault)]
        return self.stands(same, first) and self.runs.count(self.alarm, first, stop) == stop - first

    def withdrawn(self, healed: int, until: float) -> dict:
        """Return how the alarm ended once the fault had healed, at tick `healed`, before `until` [s]."""
        end = self.tick(until)
        if math.isinf(self.fault["end_s"]) or healed >= end:
            return {}
        run, _, stop = self.runs.inside(healed, end)
        last = int(max(stop[self.alarm[run]], default=0))
        after = max(0.0, last * self.dt - self.fault["end_s"]) if last < end else None
        return {"withdrawn": last < end, "withdrawn_after_s": after}

    # -- names

    def given(self, first: int, stop: int) -> list[Word]:
        """Return the words of the ticks first <= k < stop in which an alarm stands with a name, as names of the fault.
        Of the others those count that are there then."""
        inside = zip(*self.runs.inside(first, stop))
        return [Word(int(a), int(b), self.words[i], self.name(i)) for i, a, b in inside
                if self.alarm[i] and self.words[i][0] > 0.5]  # fmt: skip

    def name(self, run: int) -> Name:
        """Return how what is said in a run stands to the fault, beside the others that are there."""
        return self._name(*self.words[run], *(there[run] for there in self.there))

    def verdicts(self, words: Sequence[Word]) -> dict:
        """Return the first of n > 0 words, the name at the end, and when the latter was first said [s]."""
        last = name_at_end(words, self.dt)
        at = next((w.first * self.dt for w in words if last and w.said == last.said), None)
        return {"first_verdict": self._verdict(words[0]), "isolated": last and self._verdict(last), "named_at_s": at}

    def _verdict(self, word):
        (verdict, part), whole = word.said, self.lane.target
        target = whole if not part else part if self.lane.level != "local" else f"{whole}.{part}"
        return {"class": code.class_name(verdict), "target": target}

    def first_right(self, first: int, end: int, right: Callable[[Name], bool] = lambda n: n.right) -> int | None:
        """Return the first tick in [first, end) from which an alarm has the `right` name for HOLD_S, else None."""
        begin = stop = -1
        for word in self.given(first, end):
            if right(word.name):
                begin = begin if word.first == stop else word.first  # begins where the last one ends: the same stretch
                stop = word.stop
                if (stop - begin) * self.dt >= HOLD_S - 1e-9:
                    return begin
        return None

    def renamed(self, first: int, healed: int) -> int | None:
        """Return the tick at which the name of an alarm that stands on account of an earlier fault comes to this one:
        the right one, or its place where the class is not given and the place was another before. None where it does
        not, or had that name before: it may be the earlier fault's."""
        if not self.stands(self.earlier, first):
            return None
        before = self.name(self.runs.of(first - 1)).place

        def of_it(name: Name) -> bool:
            return name.right or (name.class_ == NOT_GIVEN and name.place == RIGHT != before)

        at = self.first_right(first - 1, healed, of_it)
        return None if at == first - 1 else at

    def named(self, k: int, end: int) -> dict:
        """Return what was said while the alarm stood from tick `k` to `end`: what is said of a decay is no name."""
        out: dict[str, Any] = {"alarm_share": self.runs.count(self.alarm, k, end) / (end - k)}
        words = [w for w in self.given(k, end) if not w.name.elsewhere]  # else it is said of another fault alone
        if not words:
            return out
        last, sure = name_at_end(words, self.dt), [w for w in words if w.said[0] != code.AMBIGUOUS]
        name = last.name if last else Name(NOT_GIVEN, NOT_GIVEN, "")
        out |= {
            **self.verdicts(words), "right": name.right, "class_given": name.class_, "place_given": name.place,
            "place_level": name.level, "first_right": words[0].name.right,
            "first_sure_wrong": bool(sure) and sure[0].name.wrong,
            "class_changes": sum(a.said[0] != b.said[0] for a, b in pairwise(words)),
            "ambiguous_s": sum(w.stop - w.first for w in words if w.said[0] == code.AMBIGUOUS) * self.dt,
        }  # fmt: skip
        right = self.first_right(k, end)
        if right is None and name.right:  # right at the end without ever standing for long
            right = round(out["named_at_s"] / self.dt)
        if right is not None:
            out["time_to_right_s"] = max(0.0, right * self.dt - self.fault["start_s"])
            if self.moved_at is not None and math.isfinite(self.moved_at):
                out["right_after_motion_s"] = max(0.0, right * self.dt - self.moved_at)
        return out

    @property
    def moved_at(self) -> float | None:
        """Return when the fault had moved the lane's rod by 1 mm [s], inf for never, None where nobody looked."""
        lane, when = self.lane, self.fault.get("moved_at_s") or {}
        own = [t for seg, t in when.items() if lane.level != "local" or lane.target == f"elevator.{seg}"]
        return max(self.fault["start_s"], min(own)) if own else None
