"""What a run comes to: who alarmed, when, after how many periods, what it isolated, how well it estimated."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.judge import coverage
from cosim.judge.alarms import acts, during
from cosim.judge.detection import ABLE, Watch, last_name, noticed, runs_of, said, valid, validity
from cosim.judge.runs import BLOCK
from cosim.scenario import Scenario
from cosim.table import DASH, Table

__all__ = ["Result", "Watch", "concerns", "errors", "judge", "judged", "largest", "plain"]
SETTLE_S = 8.0  # from when on every detector should be able to judge, or half of a flight that is shorter than 16 s
OF_A_FAULT = (  # what an entry says of the fault that its figures are about (cosim/judge/detection.py)
    *("fault", "detected_at_s", "detection_delay_s", "detection_delay_periods", "isolated", "named_at_s"),
    *("first_verdict", "right", "class_given", "place_given", "place_level", "first_right", "first_sure_wrong"),
    *("time_to_right_s", "right_after_motion_s", "not_excited", "masked"),
    *("class_changes", "ambiguous_s", "alarm_share", "withdrawn_after_s", "withdrawn", "valid_at_fault"),
)


@dataclass
class Result:
    """The outcome of a run; `to_dict` has the keys of `cosim run --json`."""

    log: str | None  # file of the log, None where none was written
    status: str  # "completed", "departed", "diverged" or "interrupted"
    reason: str  # why it ended before its time, "" where it did not
    sim_time_s: float  # flown [s]
    wall_time_s: float  # that it took [s]
    faults: list = field(default_factory=list)  # a dict per fault: kind, target, start_s, its numbers
    detectors: list = field(default_factory=list)  # a dict per detector lane: id, target, alarm, delays [s], names
    extra: dict = field(default_factory=dict)  # what the flight came to, of `cosim run --json`: consequences, notes

    def __repr__(self) -> str:
        rows = [f"  {r['id']:20}{r['target']:24}{'; '.join(filter(None, _told(r)))}" for r in self._shown()]
        quiet = len(self.detectors) - len(rows)
        head = f"Result: {self.status} after {self.sim_time_s:g} s, log {self.log or 'not written'}"
        silent = f"  {quiet} detector lane{'s' * (quiet != 1)} without an alarm"
        return "\n".join([head, *rows, *([silent] if quiet else [])])

    def _repr_html_(self) -> str:
        head = f"{self.status} after {self.sim_time_s:g} s, log {self.log or 'not written'}"
        made = Table(head, "detector", "watches", "alarm", "name", "false alarms", kind="")
        for r in self._shown():
            made.add(r["id"], r["target"], *(text or DASH for text in _told(r)))
        return made._repr_html_()

    def _shown(self):
        return [r for r in self.detectors if r["alarm"]]

    def plot(self) -> Any:
        """Return a plotly figure of the test statistic of every detector lane that alarmed or that a fault concerns, 1
        is the threshold; it is shown in a notebook, `write_html` keeps it. Raises ValueError for a flight without a
        log."""
        if self.log is None:
            raise ValueError("this flight was not logged: fly with log='flight.mcap'")
        from cosim.log import open_log

        shown = [r for r in self.detectors if r["alarm"] or r.get("concerned")] or self.detectors
        log = open_log(self.log)
        topics = dict.fromkeys(f"/detectors/{r['id']}/{r['target'].removeprefix('elevator.')}" for r in shown)
        return log.plot([f"{topic}.r" for topic in topics if topic in log.topics])

    def to_dict(self) -> dict:
        """Return plain data for JSON; numbers that do not exist are None."""
        out = {
            "log": self.log,
            "status": self.status,
            "reason": self.reason,
            "sim_time_s": self.sim_time_s,
            "wall_time_s": self.wall_time_s,
            "realtime_factor": self.sim_time_s / self.wall_time_s if self.wall_time_s > 0 else None,
            "faults": self.faults,
            "detectors": self.detectors,
            **self.extra,
        }
        return plain(out)


def _told(row):
    """Return what a lane said, as words: its alarm, its name, each with its own time, and its false alarms."""
    at, late, named = row["detected_at_s"], row["detection_delay_s"], row["named_at_s"]
    fault = f"fault {row['fault']}" if len(row["by_fault"]) > 1 else "the fault"
    alarm = name = ""
    if at is not None:
        alarm = f"alarm at {at:.2f} s" + (f", {late:.2f} s after {fault}" if late is not None else "")
        name = f"{row['isolated']['class']} at {named:.2f} s" if row["isolated"] else "no name given"
    n = row["false_alarms"]
    return alarm, name, f"{n} false alarm{'s' * (n > 1)}" if n else ""


def plain(value: Any) -> Any:
    """Return `value` as JSON can hold it: NumPy scalars as Python's, NaN and infinities as None."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def judged(scenario: Scenario, achieved: Mapping[str, Mapping] | None = None) -> list[dict]:
    """Return the faults of a scenario as `judge` wants them, their targets by part, cases as in
    cosim/judge/coverage.py. `achieved` (cosim/flight/faults/fault_free_reference.py) tells when each moved its
    segments: `moved_at_s` is {segment: when it was 1 mm of rod away from its twin [s], inf for never}, None where
    nobody looked."""
    out = []
    injections, cases = scenario.injections(), coverage.cases(scenario)
    for i, f in enumerate(scenario.faults):
        mine = [j for j in injections if j.fault == i]
        names = tuple(_target(j, f.target) for j in mine)
        about = {"fault": i, "case": cases[i], "targets": names, "period_s": f.period_s or math.nan}
        times = {"kind": f.kind, "start_s": f.start_s, "end_s": mine[0].end}
        moved = {j.name: (achieved or {}).get(j.name, {}).get("moved_at_s", math.nan) for j in mine}
        told = {segment: math.inf if t is None else t for segment, t in moved.items() if t is None or t == t}
        out.append({**about, **times, "moved_at_s": told or None})
    return out


def _target(j, written):
    if j.place not in ("elevator", "actuator_sensor"):
        return written
    return f"elevator.{j.name}" + (f".{j.sensor}" if j.place == "actuator_sensor" else "")


def concerns(watch: Watch, fault_targets: Iterable[str]) -> bool:
    """Return whether a fault on `fault_targets` is this lane's: on its own actuator; any, for aircraft level."""
    mine = (t == watch.target or t.startswith(watch.target + ".") for t in fault_targets)
    return watch.level != "local" or any(mine)


def judge(watch: Watch, trace: Any, dt: float, faults: Sequence[Mapping]) -> dict:
    """Return one detector's entry of the result.

    `trace` is (ticks, columns); `faults` are those of `judged`: dicts with `fault` (its number), `case`, `kind`,
    `targets` (tuple), `start_s`, `end_s`, `period_s` (nan without one) and perhaps `moved_at_s`. `by_fault` has an
    entry (cosim/judge/detection.py) for each fault that concerns the lane and to which its detector is not blind (to
    all that concern it: for each), between its onset and the next one's; a fault that acts in no tick of the flight
    concerns none. The lane's own figures are those of the fault
    that it noticed first, else of the earliest. Alarm onsets outside every fault that concerns the lane are false
    alarms, `standing_s` is how long its alarm stands there, `exposed_s` how long one would count. `valid_share` counts
    from SETTLE_S on.
    """
    begun = (f for f in faults if acts(f, len(trace), dt))  # others are not there to be noticed
    mine = sorted((f for f in begun if concerns(watch, f["targets"])), key=lambda f: f["start_s"])
    runs = runs_of(watch, trace, mine, dt)
    alarm, false = runs[watch.alarm] > 0.5, ~during(mine, runs.at[:-1], dt)
    rises = runs.onsets(alarm)
    share, why = validity(watch, runs, min(round(SETTLE_S / dt), runs.ticks // 2), runs.ticks)
    entry = {
        "id": watch.id, "level": watch.level, "target": watch.target, "concerned": bool(mine),
        "alarm": bool(len(rises)), **dict.fromkeys(OF_A_FAULT), "by_fault": [],
        "false_alarms": int(np.count_nonzero(~during(mine, rises, dt))),
        "standing_s": float(runs.count(alarm & false) * dt),
        "exposed_s": float(runs.count(valid(watch, runs) & false) * dt), "able": share >= ABLE, "valid_share": share,
        "why_not_valid": why, "estimate_rmse": None, "estimate_bias": None, "step_us": watch.step_us,
        "estimate_max": None, "estimate_unit": None, **largest(watch, trace, dt, faults),
    }  # fmt: skip
    if watch.estimate:
        entry |= errors(watch.estimate.error(trace, dt), watch.estimate.unit)
    if mine:
        sighted = [f for f in mine if coverage.expected(watch.id, f.get("case", "")) != coverage.BLIND] or mine
        for f in sighted:
            until = min((g["start_s"] for g in sighted if g["start_s"] > f["start_s"]), default=math.inf)
            entry["by_fault"].append(noticed(watch, runs, f, until, dt, [g for g in mine if g is not f]))
        seen = [d for d in entry["by_fault"] if d["detected_at_s"] is not None]
        entry |= min(seen, key=lambda d: d["detected_at_s"], default=entry["by_fault"][0])
    elif len(rises):
        s = said(watch, runs)
        given = np.flatnonzero(s.alarm & (s.verdict > 0.5))
        entry["detected_at_s"] = int(rises[0]) * dt
        if len(given):
            spoken = given, runs.at[given], runs.at[given + 1]
            entry |= {"first_verdict": s.name(given[0], watch), **last_name(s, spoken, watch, dt)}
    return entry


def largest(watch: Watch, trace: Any, dt: float, faults: Sequence[Mapping]) -> dict:
    """Return the largest |r| before the first fault of the flight (all of it without one) and from its onset on. Each
    is None where there is none."""
    if watch.r is None:
        return {"r_max_before": None, "r_max_after": None}
    onset = min((round(f["start_s"] / dt) for f in faults), default=len(trace))
    return {"r_max_before": _peak(trace[:onset], watch.r), "r_max_after": _peak(trace[onset:], watch.r)}


def _peak(trace, column):
    """Return the largest magnitude of a column, None where none is finite."""
    blocks = (np.abs(trace[a : a + BLOCK][:, column]) for a in range(0, len(trace), BLOCK))
    found = [(float(np.nanmax(block)), bool(np.isfinite(block).any())) for block in blocks if not np.isnan(block).all()]
    return max(peak for peak, _ in found) if any(finite for _, finite in found) else None


def errors(error: Iterable[NDArray], unit: str) -> dict:
    """Return RMSE, bias (mean) and largest magnitude of an estimation error [unit], told in blocks (n,); {} without a
    sample."""
    n, square, plain, most = 0, 0.0, 0.0, 0.0
    for block in error:
        n += len(block)
        square += float(np.sum(block**2))
        plain += float(np.sum(block))
        most = max(most, float(np.max(np.abs(block), initial=0.0)))
    if not n:
        return {}
    return {
        "estimate_rmse": math.sqrt(square / n), "estimate_bias": plain / n, "estimate_max": most, "estimate_unit": unit,
    }  # fmt: skip
