"""What a run comes to: who alarmed, when, after how many periods, what it isolated, how well it estimated."""

import html
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cosim.judge import coverage
from cosim.judge.alarms import GRACE_S, detection, faulty, onsets
from fdi.common.verdict import NAMES


@dataclass(frozen=True)
class Watch:
    """One detector lane as the result sees it: names, and the positions of its verdict fields in the history."""

    id: str
    level: str  # "local" or "aircraft"
    target: str  # "elevator.left_inner" or "aircraft"
    culprits: tuple  # names of the parts it can blame, first is ""
    alarm: int  # columns of the history
    verdict: int
    culprit: int
    r: int | None = None
    estimate: object | None = None  # cosim.judge.estimation.Estimate of a fault that the lane estimates
    step_us: float = math.nan


@dataclass
class Result:
    """The outcome of a run; `to_dict` has the keys of `cosim run --json`."""

    log: str | None
    status: str  # "completed", "departed", "diverged" or "interrupted"
    reason: str
    sim_time_s: float
    wall_time_s: float
    faults: list = field(default_factory=list)
    detectors: list = field(default_factory=list)
    extra: dict = field(default_factory=dict)

    def __repr__(self) -> str:
        rows = [f"  {r['id']:20}{r['target']:24}{_told(r)}" for r in self._shown()]
        quiet = len(self.detectors) - len(rows)
        head = f"Result: {self.status} after {self.sim_time_s:g} s, log {self.log or 'not written'}"
        return "\n".join([head, *rows, *([f"  {quiet} detector lanes stayed quiet"] if quiet else [])])

    def _repr_html_(self) -> str:
        rows = (f"<tr><td>{r['id']}<td>{r['target']}<td>{_told(r)}</tr>" for r in self._shown())
        head = f"<b>{self.status}</b> after {self.sim_time_s:g} s, log {html.escape(self.log or 'not written')}"
        return f"<div>{head}<table><tr><th>detector<th>watches<th>alarm</tr>{''.join(rows)}</table></div>"

    def _shown(self):
        return [r for r in self.detectors if r["alarm"]]

    def plot(self) -> Any:
        """Return a plotly figure of the test statistic of every detector lane that alarmed or that a fault concerns, 1
        is the threshold; it is shown in a notebook, `write_html` keeps it.

        Raises ValueError for a flight without a log.
        """
        if self.log is None:
            raise ValueError("this flight was not logged: fly with log='flight.mcap'")
        from cosim.log import open_log

        shown = [r for r in self.detectors if r["alarm"] or r.get("concerned")] or self.detectors
        log = open_log(self.log)
        return log.plot([f"{t}.r" for t in dict.fromkeys(_topic(r) for r in shown) if t in log.topics])

    def to_dict(self):
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
    """Return what a lane said, as words."""
    late = row["detection_delay_s"]
    when = f"{row['detected_at_s']:.2f} s" if row["detected_at_s"] is not None else ""
    found = row["isolated"]["class"] if row["isolated"] else "no name"
    false = f", {row['false_alarms']} false" if row["false_alarms"] else ""
    return f"{found} at {when}" + (f", {late:.2f} s after the fault" if late is not None else "") + false


def _topic(row):
    return f"/detectors/{row['id']}/{row['target'].removeprefix('elevator.')}"


def plain(value):
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


def judged(scenario):
    """Return the faults of a scenario as `judge` wants them, their targets by part, cases as in
    cosim/judge/coverage.py.
    """
    out = []
    injections, cases = scenario.injections(), coverage.cases(scenario)
    for i, f in enumerate(scenario.faults):
        mine = [j for j in injections if j.fault == i]
        names = tuple(_target(j, f.target) for j in mine)
        about = {"fault": i, "case": cases[i], "targets": names, "period_s": f.period_s or math.nan}
        out.append({**about, "start_s": f.start_s, "end_s": mine[0].end})
    return out


def _target(j, written):
    if j.place not in ("elevator", "actuator_sensor"):
        return written
    return f"elevator.{j.name}" + (f".{j.sensor}" if j.place == "actuator_sensor" else "")


def concerns(watch, fault_targets):
    """Return whether a fault on `fault_targets` is this lane's: on its own actuator; any, for aircraft level."""
    mine = (t == watch.target or t.startswith(watch.target + ".") for t in fault_targets)
    return watch.level == "aircraft" or any(mine)


def judge(watch, history, dt, faults):
    """Return one detector's entry of the result.

    `history` is (ticks, columns); `faults` a list of dicts with `fault` (its number), `case`, `targets` (tuple),
    `start_s`, `end_s` and `period_s` (nan without one). `by_fault` has an entry for each fault that concerns the lane
    and to which its detector is not blind (to all that concern it: for each): detected is what alarms first between
    its onset and the next one's, named what was said until then. The lane's own figures are those of the fault that
    it noticed first, else of the earliest. Alarm onsets outside every fault that concerns the lane are false.
    """
    alarm, verdict, culprit = (history[:, c] for c in (watch.alarm, watch.verdict, watch.culprit))
    mine = sorted((f for f in faults if concerns(watch, f["targets"])), key=lambda f: f["start_s"])
    rises = onsets(alarm)
    entry = {
        "id": watch.id,
        "level": watch.level,
        "target": watch.target,
        "concerned": bool(mine),
        "alarm": bool(len(rises)),
        "fault": None,
        "detected_at_s": None,
        "detection_delay_s": None,
        "detection_delay_periods": None,
        "isolated": None,
        "by_fault": [],
        "false_alarms": int(np.count_nonzero(~faulty(mine, len(alarm), dt)[rises])),
        "estimate_rmse": None,
        "estimate_bias": None,
        "step_us": watch.step_us,
        "estimate_max": None,
        "estimate_unit": None,
        **largest(watch, history, dt, faults),
    }
    if watch.estimate:
        entry |= errors(watch.estimate.error(history, dt), watch.estimate.unit)
    if mine:
        sighted = [f for f in mine if coverage.expected(watch.id, f.get("case", "")).word != coverage.BLIND] or mine
        entry["by_fault"] = [_detection(watch, f, sighted, dt, alarm, verdict, culprit) for f in sighted]
        noticed = [d for d in entry["by_fault"] if d["detected_at_s"] is not None]
        entry |= min(noticed, key=lambda d: d["detected_at_s"], default=entry["by_fault"][0])
    elif len(rises):
        all_ticks = np.flatnonzero(alarm > 0.5)
        entry["detected_at_s"] = int(all_ticks[0]) * dt
        entry["isolated"] = named(watch, verdict[all_ticks], culprit[all_ticks])
    return entry


def _detection(watch, fault, faults, dt, alarm, verdict, culprit):
    """Return when and as what a lane noticed `fault`, one of `faults`: None where it did not."""
    starts = [f["start_s"] for f in faults if f["start_s"] > fault["start_s"]]
    last = min(fault["end_s"] + GRACE_S, min(starts, default=math.inf)) / dt
    end = math.ceil(last) if math.isfinite(last) else len(alarm)
    out = dict.fromkeys(("detected_at_s", "detection_delay_s", "detection_delay_periods", "isolated"))
    k = detection(alarm, round(fault["start_s"] / dt), end)
    if k is not None:
        healed = math.ceil(fault["end_s"] / dt) if math.isfinite(fault["end_s"]) else end
        # what it says while the fault's effect decays is no name of the fault
        seen = k + np.flatnonzero(alarm[k : max(k + 1, min(end, healed))] > 0.5)
        delay = k * dt - fault["start_s"]
        out = {
            "detected_at_s": k * dt,
            "detection_delay_s": delay,
            "detection_delay_periods": delay / fault["period_s"],
            "isolated": named(watch, verdict[seen], culprit[seen]),
        }
    return {"fault": fault.get("fault"), **out}


def largest(watch, history, dt, faults):
    """Return the largest |r| before the first fault of the flight (all of it without one) and from its onset on.

    Each is None where there is none.
    """
    if watch.r is None:
        return {"r_max_before": None, "r_max_after": None}
    r = np.abs(history[:, watch.r])
    onset = min((round(f["start_s"] / dt) for f in faults), default=len(r))
    parts = {"r_max_before": r[:onset], "r_max_after": r[onset:]}
    return {name: float(np.nanmax(part)) if np.isfinite(part).any() else None for name, part in parts.items()}


def errors(error, unit):
    """Return RMSE, bias (mean) and largest magnitude of an estimation error [unit], None without a sample."""
    if not len(error):
        return {}
    return {
        "estimate_rmse": float(np.sqrt(np.mean(error**2))),
        "estimate_bias": float(np.mean(error)),
        "estimate_max": float(np.max(np.abs(error))),
        "estimate_unit": unit,
    }


def named(watch, verdict, culprit):
    """Return {class, target}: the last verdict that was held while the alarm stood."""
    given = np.flatnonzero(verdict > 0.5)
    if not len(given):
        return None
    i = given[-1]
    part = watch.culprits[int(culprit[i])] if 0 <= int(culprit[i]) < len(watch.culprits) else ""
    target = watch.target if not part else (part if watch.level == "aircraft" else f"{watch.target}.{part}")
    return {"class": NAMES[int(verdict[i])], "target": target}
