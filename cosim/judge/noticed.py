"""What one detector lane made of one fault: when it noticed, what it said, whether that was right, how it ended."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.judge.alarms import GRACE_S, faulty, onsets
from cosim.judge.naming import BOTH, blames, members_of, right
from fdi.common import verdict as code
from fdi.common import why as reason

ABLE = 0.5  # share of the time in which a lane that missed must have been valid for this to count as a miss
MOVES = ("jam_solid", "jam", "runaway")  # kinds that show only where the rod is not where it should be


@dataclass(frozen=True)
class Watch:
    """One detector lane as the judgement sees it: names, and where its outputs stand in the trace's columns."""

    id: str
    level: str  # "local" or "aircraft"
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


OUTPUTS = ("alarm", "verdict", "culprit", "r", "valid", "why")  # of a detector, as far as it has them


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
        target = watch.target if not part else part if watch.level == "aircraft" else f"{watch.target}.{part}"
        return {"class": code.class_name(self.verdict[k]), "target": target}


def said(watch: Watch, trace: NDArray, targets: Sequence[str] = ()) -> Said:
    """Return what a lane says of a fault on `targets`; `trace` is (ticks, columns).

    Where the lane has an alarm for each part and those of all the fault's parts are up, it names these parts.
    """
    alarm, verdict, part = (trace[:, c] for c in (watch.alarm, watch.verdict, watch.culprit))
    own = dict(watch.alarms)
    mine = members_of(own, targets, watch.level)
    if not mine:
        return Said(alarm > 0.5, verdict, part, watch.culprits)
    each = np.stack([trace[:, own[c]] > 0.5 for c in mine])
    named = each.all(axis=0) & blames(BOTH.join(mine), targets, watch.level)
    first = np.isin(part, [watch.culprits.index(c) for c in mine])
    kind = {"sensor": code.SENSOR, "engine": code.THRUST}.get(targets[0].split(".")[0], code.AMBIGUOUS)
    verdict = np.where(named & ~first, kind, verdict)
    part = np.where(named, len(watch.culprits), part)
    return Said((alarm > 0.5) | each.any(axis=0), verdict, part, (*watch.culprits, BOTH.join(mine)))


def noticed(
    watch: Watch, trace: NDArray, fault: Mapping, until: float, dt: float, others: Sequence[Mapping] = ()
) -> dict:
    """Return what the lane made of `fault` before the next one begins at `until` [s]; times [s], None for never.

    It noticed when its alarm rose or, while one stands on account of earlier ones of the `others`, took this fault's
    right name. An alarm that rises while several faults are there is that of the latest, unless it blames a part of
    an earlier one and none of the latest: then it is the earlier one's, after `until`, too.

    `detection_delay_s` and `time_to_right_s` count from the onset, `right_after_motion_s` from when the fault has moved
    the rod 1 mm from where it would be; `not_excited` tells that a fault of MOVES never did. `isolated` is what was
    said last while the fault was there, `named_at_s` when it was first said, `first_verdict` what was said first;
    `right`, `first_right`: they are.
    `alarm_share` is the share of the time from the alarm to the end of the fault in which the alarm stands;
    `withdrawn_after_s` the time from the end of the fault to that of its last alarm, `withdrawn` whether that end was
    seen. `valid_at_fault` is the share of the fault's time in which the lane called itself valid, until it noticed; one
    that missed with less than ABLE could not judge.
    """
    ticks, start, end = len(trace), fault["start_s"], fault["end_s"]
    first = round(start / dt)
    healed, last = (_tick(t, dt, ticks) for t in (min(end, until), min(end + GRACE_S, until)))
    s = said(watch, trace, fault["targets"])
    earlier = [f for f in others if f["start_s"] < start]
    renamed = _renamed(watch, s, fault, first, healed, dt, earlier)
    rises = onsets(s.alarm)
    inside = rises[(rises >= first) & (rises < last)]
    own = [i for i in inside if not _blamed(watch, s, i, earlier, fault, dt)]
    if len(own) < len(inside) and renamed is None:  # one that rose for an earlier fault may come to this one's name
        renamed = _first_right(watch, s, fault, int(inside[0]), healed)
    k = min((i for i in (*own[:1], renamed) if i is not None), default=None)
    if k is None:
        later = [f for f in others if f["start_s"] > start]
        own = [i for i in rises[rises >= max(first, last)] if _late(watch, s, i, fault, later, dt)]
        if own:
            k, until = own[0], math.inf
            healed, last = (_tick(t, dt, ticks) for t in (end, end + GRACE_S))
            changed = (_first_right(watch, s, f, k, healed) for f in later)  # from there on it speaks of that one
            healed = last = min((i for i in changed if i is not None), default=healed)
    out: dict[str, Any] = dict.fromkeys(
        ("detected_at_s", "detection_delay_s", "detection_delay_periods", "isolated", "named_at_s", "first_verdict",
         "time_to_right_s", "right_after_motion_s", "alarm_share", "withdrawn_after_s", "withdrawn")
    )  # fmt: skip
    out |= {"right": False, "first_right": False, "class_changes": 0, "ambiguous_s": 0.0}
    out["not_excited"] = _not_excited(watch, fault)
    if k is not None:
        out |= {
            "detected_at_s": k * dt,
            "detection_delay_s": k * dt - start,
            "detection_delay_periods": (k * dt - start) / fault["period_s"],
            **_named(watch, s, fault, k, max(k + 1, min(last, healed)), dt),
            **_withdrawn(s.alarm, end, k, healed, _tick(until, dt, ticks), dt),
        }
    stop = max(first + 1, healed if k is None else k)
    out |= _validity(watch, trace[first:stop], seen=k is not None)
    return {"fault": fault.get("fault"), **out}


def _tick(t, dt, ticks):
    return ticks if math.isinf(t) else min(ticks, math.ceil(t / dt))


def _named(watch, s, fault, k, end, dt):
    """Return what was said while the alarm stood from tick `k` to `end`: what is said of a decay is no name."""
    given = k + np.flatnonzero(s.alarm[k:end] & (s.verdict[k:end] > 0.5))
    seen = int(np.count_nonzero(s.alarm[k:end]))
    out = {"alarm_share": seen / (end - k)}
    if not len(given):
        return out
    codes, good = s.verdict[given], _right(watch, s, fault, given)
    out |= {
        **last_name(s, given, watch, dt),
        "first_verdict": s.name(given[0], watch),
        "class_changes": int(np.count_nonzero(np.diff(codes))),
        "ambiguous_s": float(np.count_nonzero(codes == code.AMBIGUOUS) * dt),
        "right": bool(good[-1]),
        "first_right": bool(good[0]),
    }
    if good.any():
        at = float(given[np.argmax(good)] * dt)
        out["time_to_right_s"] = at - fault["start_s"]
        moved = _moved_at(watch, fault)
        if moved is not None and math.isfinite(moved):
            out["right_after_motion_s"] = max(0.0, at - moved)
    return out


def last_name(s: Said, given: NDArray, watch: Watch, dt: float) -> dict:
    """Return the name said last at ticks `given` (n,), n > 0, and when the lane first said it [s]."""
    same = (s.verdict[given] == s.verdict[given[-1]]) & (s.part[given] == s.part[given[-1]])
    return {"isolated": s.name(given[-1], watch), "named_at_s": float(given[np.argmax(same)] * dt)}


def _right(watch, s, fault, ticks):
    """Return (len(ticks),): whether what is said at each of `ticks` is the right name of `fault`."""
    codes, parts = s.verdict[ticks], s.part[ticks]
    good = np.zeros(len(ticks), bool)
    changes = np.concatenate([[0], 1 + np.flatnonzero((np.diff(codes) != 0.0) | (np.diff(parts) != 0.0))])
    said = zip(codes[changes].tolist(), parts[changes].tolist()) if len(codes) else ()
    for c, p in {(c, p) for c, p in said if c > 0.5}:
        part = s.parts[int(p)] if 0 <= p < len(s.parts) else ""
        if right(watch.id, fault.get("case", ""), fault["targets"], watch.level, code.class_name(c), part):
            good |= (codes == c) & (parts == p)
    return good


def _blamed(watch, s, k, faults, instead, dt):
    """Return whether what is said at tick `k` names a part of one of `faults` that is there then, none of `instead`."""
    part = s.parts[int(s.part[k])] if 0 <= s.part[k] < len(s.parts) else ""
    if not part or blames(part, instead["targets"], watch.level):
        return False
    there = (f for f in faults if faulty([f], len(s.alarm), dt)[k])
    return any(blames(part, f["targets"], watch.level) for f in there)


def _late(watch, s, k, fault, later, dt):
    """Return whether the alarm that rises at tick `k`, after the onset of `later` faults, is that of `fault` alone."""
    there = [f for f in later if f["start_s"] <= k * dt]
    return all(_blamed(watch, s, k, [fault], f, dt) for f in there) if there else False


def _renamed(watch, s, fault, first, healed, dt, earlier):
    """Return the tick at which an alarm that stands on account of an `earlier` fault takes the right name of this one.

    None where it does not, or had that name before: it may be the earlier fault's.
    """
    if not earlier or not 0 < first < len(s.alarm) or not s.alarm[first - 1]:
        return None
    rose = onsets(s.alarm)
    if not faulty(earlier, len(s.alarm), dt)[rose[rose < first][-1]]:
        return None
    at = _first_right(watch, s, fault, first - 1, healed)
    return None if at == first - 1 else at


def _first_right(watch, s, fault, first, end):
    """Return the first tick in [first, end) at which an alarm has the right name of `fault`, None without one."""
    ticks = np.arange(first, max(first, end))
    good = _right(watch, s, fault, ticks) & s.alarm[ticks]
    return int(ticks[np.argmax(good)]) if good.any() else None


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
    own = [t for seg, t in when.items() if watch.level == "aircraft" or watch.target == f"elevator.{seg}"]
    return max(fault["start_s"], min(own)) if own else None


def _not_excited(watch, fault):
    moved = _moved_at(watch, fault)
    return None if moved is None or fault.get("kind") not in MOVES else math.isinf(moved)


def _validity(watch, trace, seen):
    share, why = validity(watch, trace)
    able = seen or share >= ABLE
    return {"able": able, "valid_at_fault": share, "why_not_valid": None if able else why}


def valid(watch: Watch, trace: NDArray) -> NDArray[np.bool_]:
    """Return (ticks,): whether the lane calls itself valid; always, where it does not say."""
    return np.ones(len(trace), bool) if watch.valid is None else trace[:, watch.valid] > 0.5


def validity(watch: Watch, trace: NDArray) -> tuple[float, str | None]:
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
