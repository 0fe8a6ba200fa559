"""The table of a score: numbers of one detector, by the same functions as a comparison's (cosim/compare/stats.py)."""

from collections.abc import Sequence
from dataclasses import asdict

import pandas as pd

from cosim.compare import pod, stats
from cosim.compare.score.flights import RecordedFlight
from cosim.compare.score.rows import Scored
from cosim.judge import coverage
from fdi import registry

FREE = "no fault"
OF_THE_CLOCK = ("step_us",)  # never the same twice
WHOLE = (  # of cosim.compare.stats.detectors: over all flights
    *("availability", "standing_s", "false_alarms", "false_alarms_per_hour", "false_alarms_per_hour_low"),
    *("false_alarms_per_hour_high", "hours", "fault_free_runs", "fault_free_alarmed", "false_alarm_probability"),
    *("false_alarm_low", "false_alarm_high", "credible", "step_us"),
)


def detector(found: Scored, name: str, flights: Sequence[RecordedFlight]) -> dict:
    """Return the row of detector `name`: what it made of all faults that it is not blind to, of each family, its false
    alarms, cost and log scores.

    A family counts every flight in which it has a lane on the faulty part and is not blind to the fault by its own
    word; one in which it called itself not valid is not seen, here as in the fitted curve: otherwise a detector would
    gain by giving up.
    """
    own = found.rows[found.rows["id"] == name]
    faults = own[own["case"].notna() & own["concerned"]]
    record = registry.find(name)
    whole = stats.detectors(own, found.timing)[0]
    families = [f for f in dict.fromkeys(f.family for f in flights) if f != FREE]
    lines = [_family(faults[faults["part"] == f], f, found.logs, name) for f in families]
    open_to = faults[faults["word"] != coverage.BLIND]
    guest = registry.GUESTS.get(name)
    return {
        "id": name,
        "level": whole["level"],
        "group": stats.draws_on(name, whole["level"]),
        "inputs": sorted(set(record.inputs.values())) if record else [],
        "guest": None if guest is None else {"sha256": guest.sha256},
        "remark": coverage.remark(name),
        **(stats.score(open_to) if len(open_to) else {"designed": 0, "detected": 0}),
        "blind": int(len(faults) - len(open_to)),
        **{k: whole[k] for k in WHOLE},
        **_honest(found.logs[found.logs["id"] == name]),
        "families": lines,
    }


def _family(rows, family, logs, name):
    open_to = rows[rows["word"] != coverage.BLIND]
    out = {"family": family, "flights": len(rows), "blind": int(len(rows) - len(open_to)),
           "seen_though_blind": int(rows[rows["word"] == coverage.BLIND]["detected"].sum()),
           "words": open_to["word"].value_counts().to_dict()}  # fmt: skip
    if not len(open_to):
        return {**out, "designed": 0}
    sized = open_to[open_to["size"] > 0.0]
    units = sized["unit"].unique()
    curve = asdict(pod.fit(sized["size"], sized["detected"])) if len(units) == 1 else {"note": "no size"}
    mine = logs[(logs["id"] == name) & logs["run"].isin(open_to["run"])]
    physics = open_to["bound_mm"].median() if "bound_mm" in open_to else None
    return {
        **out, **stats.score(open_to), "unit": units[0] if len(units) == 1 else "",
        **{k: curve.get(k) for k in ("a90", "low", "a90_95", "note")}, "bound_mm": physics, **_honest(mine),
    }  # fmt: skip


def _honest(logs: pd.DataFrame) -> dict:
    """Return mean log scores over flights, None for a detector that gives no probabilities."""
    out = {}
    for key in ("log_fault", "log_none"):
        each = pd.to_numeric(logs[key]).groupby(logs["run"]).mean().dropna()
        out[key] = float(each.mean()) if len(each) else None
    return out


def differences(table: dict, again: dict, detectors: Sequence[str]) -> list[str]:
    """Return what differs between a stored table and one made again, a sentence each; clocks are left out."""
    out = [f"{k}: {table.get(k)} stored, {again[k]} here" for k in ("benchmark", "flights", "seeds", "content")
           if table.get(k) != again[k]]  # fmt: skip
    stored, fresh = ({d["id"]: d for d in t["detectors"]} for t in (table, again))
    for name in detectors:
        out += [f"{name}: {line}" for line in _differ(stored[name], fresh[name], "")]
    return out


def _differ(a, b, place):
    if isinstance(a, dict) and isinstance(b, dict):
        for key in dict.fromkeys((*a, *b)):
            if key not in OF_THE_CLOCK:
                yield from _differ(a.get(key), b.get(key), f"{place}.{key}" if place else key)
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for i, (x, y) in enumerate(zip(a, b)):
            yield from _differ(x, y, f"{place}[{i}]")
    elif a != b and not (isinstance(a, float) and isinstance(b, float) and abs(a - b) <= 1e-9 * max(abs(a), abs(b))):
        yield f"{place} = {a} stored, {b} here"
