"""The table of a flight: a row per detector lane and fault, the same for terminal, page and notebook."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from actuators.constants import DEG_PER_RAD
from cosim.judge import coverage
from cosim.judge.naming import outcome
from cosim.table import DASH, Cell, Column, Table, number, of, share

ALL = 9  # rank of the columns that are shown last
TONES = {"named": "good", "misnamed": "bad", "missed": "bad"}
JUDGED = {
    "not_valid": "not valid", "named": "right", "ambiguous": "seen, not named", "misnamed": "another name",
    "bonus": "not expected", "missed": "missed", "masked": "masked", "quiet": "quiet",
}  # fmt: skip
KEY = (("good", "name", "right"), ("", "name", "ambiguous, or no fault concerns the lane"),
       ("bad", "name", "another name"), ("muted", "row", "no alarm"))  # fmt: skip
SHOWN = {  # unit of an estimate -> shown as, factor
    "u": ("u, share of the valve", 1.0),
    "rad": ("deg", DEG_PER_RAD),
    "rad/s": ("deg/s", DEG_PER_RAD),
    "m": ("mm", 1e3),
    "fraction": ("%", 100.0),
}


def seconds(value: float | None) -> str:
    """Return a time in hundredths of a second, a dash for none, "never" for an endless one."""
    if value is None or math.isnan(value):
        return DASH
    return "never" if math.isinf(value) else f"{value:.2f}"


def part(lane: Mapping[str, Any], entry: Mapping[str, Any] | None = None) -> str:
    """Return which part a lane watches in words; with an entry, what its name says beyond that."""
    name = lane["target"] if entry is None else entry["isolated"]["target"].removeprefix(lane["target"]).strip(".")
    return name.removeprefix("elevator.").replace("_", " ")


def entries(lanes: Iterable[Mapping[str, Any]], cases: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Return one record per lane and fault that it could notice, with its `case` and `outcome` (None without one)."""
    out = []
    for lane in lanes:
        for own in lane.get("by_fault") or [{}]:
            e = {"outcome": None, "case": None, **lane, **own}
            if cases and e.get("fault") is not None:
                e["case"] = cases[e["fault"]]
                e["outcome"] = outcome(e["id"], e["case"], seen=e["detection_delay_s"] is not None, able=e["able"],
                                       masked=e["masked"], class_=e["class_given"], place=e["place_given"])  # fmt: skip
            out.append(e)
    return out


def _name(e):
    """Return the last name; where there is none, that it could not judge and why, or that the fault never showed."""
    if e["isolated"]:
        return Cell(f"{e['isolated']['class']} {part(e, e)}".strip(), TONES.get(e["outcome"], ""))
    if not e.get("able", True):
        return f"not valid: {e.get('why_not_valid') or ''}".removesuffix(": ")
    return "not excited" if e.get("not_excited") else DASH


def _error(key):
    def get(e):
        if e.get(key) is None:
            return DASH
        unit, factor = SHOWN.get(e["estimate_unit"], (e["estimate_unit"], 1.0))
        return f"{e[key] * factor:.3g} {unit.split(',')[0]}"

    return get


COLUMNS = (
    Column("detector", lambda e: Cell(e["id"], "bold"), right=False),
    Column("watches", part, right=False),
    Column("fault", lambda e: DASH if e.get("fault") is None else str(e["fault"])),
    Column("first alarm", lambda e: seconds(e["detection_delay_s"]), "s", "from the fault's onset on"),
    Column("right name", lambda e: seconds(e.get("time_to_right_s")), "s", "first one, from the onset on"),
    Column("last name", _name, right=False),
    Column("outcome", lambda e: Cell(JUDGED.get(e["outcome"], DASH), TONES.get(e["outcome"], "")), right=False),
    Column("false alarms", lambda e: Cell(e["false_alarms"], "bad" if e["false_alarms"] else "muted"), rank=1),
    Column("at", lambda e: seconds(e["detected_at_s"]), "s", "time of the first alarm in the flight", 2),
    Column("delay", lambda e: number(e["detection_delay_periods"], 2), "periods",
           "first alarm in periods of the fault", 3),
    Column("step", lambda e: number(e["step_us"], 2), "µs", "time per step and lane", 4),
    Column("declared", lambda e: coverage.WORDS[coverage.expected(e["id"], e["case"])] if e["case"] else DASH,
           doc="what its record in fdi/ declares for this fault", rank=5, right=False),
    Column("first name", lambda e: e["first_verdict"]["class"] if e.get("first_verdict") else DASH, rank=6,
           right=False),
    Column("valid", lambda e: share(e.get("valid_share")), doc="share of the flight from 8 s on", rank=7),
    Column("standing", lambda e: number(e.get("standing_s")), "s", "alarm without a fault", 8),
    Column("|r| before", lambda e: number(e.get("r_max_before")), doc="largest statistic before the first fault, 1 is "
           "the threshold, before confirmation", rank=9),
    Column("|r| after", lambda e: number(e.get("r_max_after")), doc="the same from its onset on", rank=9),
    Column("RMSE", _error("estimate_rmse"), doc="of the estimate against what was injected, after settling", rank=9),
    Column("bias", _error("estimate_bias"), doc="mean error of the estimate", rank=9),
)  # fmt: skip


def table(lanes: Sequence[Mapping[str, Any]], cases: Sequence[str] = ()) -> Table:
    """Return the Table of lanes (entries of cosim.judge.result.judge); with several faults a row for each that a lane
    could notice. Columns without a figure are left out."""
    records = entries(lanes, cases)
    several = any(len(lane.get("by_fault", ())) > 1 for lane in lanes)
    timed = any(math.isfinite(e["step_us"] or math.nan) for e in records)
    has = {"fault": several, "step": timed, "outcome": bool(cases), "declared": bool(cases)}
    kept = [c for c in COLUMNS if has.get(c.name, True)]
    return of(kept, records, lambda e: "" if e["alarm"] else "muted", keys=2)


def _blamed(v):
    said = v.get("isolated")
    return f"{said['class']} {(said.get('isolated_part') or '').replace('_', ' ')}".strip() if said else DASH


def verdicts(lanes: Sequence[Mapping[str, Any]]) -> Table:
    """Return the Table of what detectors say of a recording, in which nobody knows the faults."""
    columns = (
        Column("detector", lambda v: Cell(v["id"], "bold"), right=False), Column("watches", part, right=False),
        Column("first alarm", lambda v: seconds(v["first_alarm_s"]), "s", "time of the recording"), Column("alarms"),
        Column("last name", _blamed, right=False),
        Column("largest |r|", "r_max", doc="1 is the threshold", rank=2), Column("valid", "valid_pct", "%", rank=1),
    )  # fmt: skip
    return of(columns, lanes, lambda v: "" if v["alarm"] else "muted", keys=2, title="Verdicts")
