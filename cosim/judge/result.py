"""What a run comes to: who alarmed, when, after how many periods, what it isolated, how well it estimated."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.judge import coverage
from cosim.judge.alarms import acts, during
from cosim.judge.detection import ABLE, NO_FAULT, UNSEEN, Heard, JudgedLane, Runs, Said, noticed
from cosim.judge.lanes import table
from cosim.scenario import Scenario

__all__ = ["Errors", "JudgedLane", "Result", "concerns", "entry_of", "judge", "judged", "plain"]
SETTLE_S = 8.0  # from when on every detector should be able to judge, or half of a flight that is shorter than 16 s
OF_A_FAULT = ("fault", *UNSEEN, "masked", "not_excited", "valid_at_fault")  # what figures are about one fault


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
    extra: dict = field(default_factory=dict)  # of `cosim run --json`: consequences, notes

    def __repr__(self) -> str:
        loud = [lane for lane in self.detectors if lane["alarm"]]
        quiet = f"{len(self.detectors) - len(loud)} of {len(self.detectors)} detector lanes without an alarm"
        head = f"Result: {self.status} after {self.sim_time_s:g} s, log {self.log or 'not written'}; {quiet}"
        return "\n".join([head, table(loud).upto(2).markdown()] if loud else [head])

    def to_dict(self) -> dict:
        """Return plain data for JSON; numbers that do not exist are None."""
        faster = self.sim_time_s / self.wall_time_s if self.wall_time_s > 0 else None
        about = {k: v for k, v in vars(self).items() if k != "extra"}
        return plain({**about, "realtime_factor": faster, **self.extra})


def plain(value: Any) -> Any:
    """Return `value` as JSON can hold it: NumPy scalars as Python's, NaN and infinities as None."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def judged(scenario: Scenario, achieved: Mapping[str, Mapping] | None = None) -> list[dict]:
    """Return the faults of a scenario as `judge` wants them, their targets by part, cases as in
    cosim/judge/coverage.py. `achieved` (cosim/flight/faults/fault_free_reference.py) tells when each moved its
    segments: `moved_at_s` is {segment: when it was 1 mm of rod from where it would be [s], inf for never}, None where
    nobody looked."""
    out, cases, injections = [], coverage.cases(scenario), scenario.injections()
    for i, f in enumerate(scenario.faults):
        mine = [j for j in injections if j.fault == i]
        times = {j.name: (achieved or {}).get(j.name, {}).get("moved_at_s", math.nan) for j in mine}
        moved = {segment: math.inf if t is None else t for segment, t in times.items() if t is None or t == t}
        out.append({"fault": i, "case": cases[i], "kind": f.kind, "targets": tuple(_target(j, f.target) for j in mine),
                    "start_s": f.start_s, "end_s": mine[0].end, "period_s": f.period_s or math.nan,
                    "moved_at_s": moved or None})  # fmt: skip
    return out


def _target(j, written):
    if j.place not in ("elevator", "actuator_sensor"):
        return written
    return f"elevator.{j.name}" + (f".{j.sensor}" if j.place == "actuator_sensor" else "")


def concerns(lane: Any, fault_targets: Iterable[str]) -> bool:
    """Return whether a fault on `fault_targets` is this lane's: on its own actuator; any, for aircraft level. Of the
    lane `level` and `target` are read."""
    mine = (t == lane.target or t.startswith(lane.target + ".") for t in fault_targets)
    return lane.level != "local" or any(mine)


def judge(lane: JudgedLane, trace: NDArray, dt: float, faults: Sequence[Mapping]) -> dict:
    """Return one detector's entry of the result, of a whole `trace` (ticks, columns), with the error of its estimate;
    see `entry_of`."""
    entry = entry_of(Said(lane, dt, faults).add(trace), dt, faults)
    if lane.estimate:
        sums = Errors()
        for error in lane.estimate.error(trace, dt):
            sums.add(error)
        entry |= sums.entry(lane.estimate.unit)
    return entry


def entry_of(told: Said, dt: float, faults: Sequence[Mapping]) -> dict:
    """Return one detector's entry of the result.

    `faults` are those of `judged`: dicts with `fault` (its number), `case`, `kind`,
    `targets` (tuple), `start_s`, `end_s`, `period_s` (nan without one) and perhaps `moved_at_s`. `by_fault` has an
    entry (cosim/judge/detection.py) for each fault that concerns the lane and to which its detector is not blind (to
    all that concern it: for each), between its onset and the next one's; a fault that acts in no tick of the flight
    concerns none. The lane's own figures are those of the fault that it noticed first, else of the earliest. Alarm
    onsets outside every fault that concerns the lane are false alarms, `standing_s` is how long its alarm stands there,
    `exposed_s` how long one would count. `valid_share` counts from SETTLE_S on.
    """
    lane = told.lane
    begun = (f for f in faults if acts(f, told.ticks, dt))  # others are not there to be noticed
    mine = sorted((f for f in begun if concerns(lane, f["targets"])), key=lambda f: f["start_s"])
    runs = Runs(told, mine, dt)
    heard = Heard(runs, NO_FAULT, (), dt)
    healthy = ~during(mine, runs.first, dt)
    before, after = (peak if math.isfinite(peak) else None for peak in told.peaks)
    share, why = runs.validity(min(round(SETTLE_S / dt), runs.ticks // 2), runs.ticks)
    entry: dict[str, Any] = {
        "id": lane.id, "level": lane.level, "target": lane.target, "concerned": bool(mine),
        "alarm": bool(len(heard.rises)), **dict.fromkeys(OF_A_FAULT), "by_fault": [],
        "false_alarms": int(np.count_nonzero(~during(mine, heard.rises, dt))),
        "standing_s": float(runs.count(heard.alarm & healthy) * dt),
        "exposed_s": float(runs.count(runs.valid & healthy) * dt), "able": share >= ABLE, "valid_share": share,
        "why_not_valid": why, "estimate_rmse": None, "estimate_bias": None, "step_us": lane.step_us,
        "estimate_max": None, "estimate_unit": None, "r_max_before": before, "r_max_after": after,
    }  # fmt: skip
    if mine:
        sighted = [f for f in mine if coverage.expected(lane.id, f.get("case", "")) != coverage.BLIND] or mine
        for f in sighted:
            until = min((g["start_s"] for g in sighted if g["start_s"] > f["start_s"]), default=math.inf)
            entry["by_fault"].append(noticed(runs, f, until, dt, [g for g in mine if g is not f]))
        seen = [d for d in entry["by_fault"] if d["detected_at_s"] is not None]
        entry |= min(seen, key=lambda d: d["detected_at_s"], default=entry["by_fault"][0])
    elif len(heard.rises):
        entry["detected_at_s"] = int(heard.rises[0]) * dt
        words = heard.given(0, runs.ticks)
        entry |= heard.verdicts(words) if words else {}
    return entry


class Errors:
    """Sums over the errors of an estimate, in blocks that follow one another."""

    def __init__(self) -> None:
        self.sums, self.largest = np.zeros(3), 0.0  # number, sum, sum of squares

    def add(self, error: NDArray) -> None:
        """Take more errors (n,)."""
        self.sums += len(error), np.sum(error), np.sum(error**2)
        self.largest = max(self.largest, float(np.max(np.abs(error), initial=0.0)))

    def entry(self, unit: str) -> dict:
        """Return RMSE, bias (mean) and largest magnitude [unit]; {} without a sample."""
        n, total, squares = self.sums.tolist()
        if not n:
            return {}
        return {"estimate_rmse": math.sqrt(squares / n), "estimate_bias": total / n, "estimate_max": self.largest,
                "estimate_unit": unit}  # fmt: skip
