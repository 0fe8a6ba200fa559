"""The rows of a run, one per detector lane and fault: their schema, and how they are made from its result.

FIELDS is the one place where a column has its name, unit and meaning: Parquet files carry them as metadata, the
README of campaigns has them as a table, comparison takes the names from here.
"""

from collections.abc import Mapping
from typing import NamedTuple

from cosim.judge.fault_effect import CONSEQUENCES, largest
from cosim.judge.fault_effect import NAMES as ACHIEVED


class Field(NamedTuple):
    """A column of a row: its name, type (of Arrow), unit ("" for words and counts) and meaning; `key` is where `cosim
    run --json` has it where that is another name."""

    name: str
    type: str
    unit: str
    meaning: str
    key: str = ""


FIELDS = (
    Field("run", "string", "", "hash of the expanded scenario and the user's files in it"),
    Field("lane", "int32", "", "position of the lane in the run"),
    Field("status", "string", "", "completed, departed, diverged, infeasible (no trim), error, crashed (process died)"),
    Field("error", "string", "", "text of an error, why a flight departed, what user parts did wrong", "reason"),
    Field("sim_time_s", "double", "s", "flown time"),
    Field("id", "string", "", "detector"),
    Field("level", "string", "", "local, aircraft or both"),
    Field("target", "string", "", "what the lane watches: elevator.left_inner, aircraft"),
    Field("concerned", "bool", "", "a fault that began is this lane's: on its own actuator; aircraft level: any"),
    Field("alarm", "bool", "", "any alarm in the run"),
    Field("detected_at_s", "double", "s", "first alarm that rises after the onset; of a healthy lane the first alarm"),
    Field("delay_s", "double", "s", "from the onset; null when missed or not concerned", "detection_delay_s"),
    Field("delay_periods", "double", "periods", "the same in periods of the oscillation", "detection_delay_periods"),
    Field("fault", "int32", "", "number of the fault that the figures are about"),
    Field("first_verdict", "string", "", "class that was said first", "first_verdict.class"),
    Field("isolated_class", "string", "", "class that stood for half of the last 1 s of the alarm", "isolated.class"),
    Field("isolated_target", "string", "", "part that this name blames", "isolated.target"),
    Field("right", "bool", "", "class and place of that name are right"),
    Field("first_right", "bool", "", "the first name was right in class and part"),
    Field("class_given", "string", "", "class of that name: right, wrong, not given (cosim/judge/naming.py)"),
    Field("place_given", "string", "", "place of that name: right, wrong, not given"),
    Field("place_level", "string", "", "finest level of a right place: axis, side, segment, channel, or set"),
    Field("first_sure_wrong", "bool", "", "the first name with a class was wrong"),
    Field("time_to_right_s", "double", "s", "from the onset to the first right name; ambiguous is no name"),
    Field("right_after_motion_s", "double", "s", "the same from when the rod is 1 mm from where it would be"),
    Field("not_excited", "bool", "", "a jam or runaway that never moved the rod so far"),
    Field("masked", "bool", "", "not seen: the alarm of an earlier fault of the same part stood all the time"),
    Field("class_changes", "int32", "", "changes of class while the alarm stood"),
    Field("ambiguous_s", "double", "s", "time called ambiguous while the alarm stood"),
    Field("alarm_share", "double", "-", "share of the time from the alarm to the fault's end in which it stands"),
    Field("withdrawn_after_s", "double", "s", "end of the last alarm after the fault has healed; null: never healed"),
    Field("withdrawn", "bool", "", "that end was seen"),
    Field("able", "bool", "", "false: missed, and was not valid enough to judge"),
    Field("valid_at_fault", "double", "-", "share of the fault's time in which the lane was valid"),
    Field("valid_share", "double", "-", "share of the flight, from 8 s on, in which the lane calls itself valid"),
    Field("why_not_valid", "string", "", "its most frequent reason (fdi/common/why.py), where that matters"),
    Field("false_alarms", "int32", "", "alarms that rise outside every fault that concerns the lane, and 2 s after it"),
    Field("standing_s", "double", "s", "time for which an alarm stands there"),
    Field("exposed_s", "double", "s", "time in which one would count: valid, and no fault that concerns the lane"),
    Field("r_max_before", "double", "-", "largest |r| before the first fault; over all of a fault-free flight"),
    Field("r_max_after", "double", "-", "largest |r| from that onset on; 1 is the threshold"),
    Field("estimate_rmse", "double", "estimate_unit", "error of the estimate after settling (judge/estimation.py)"),
    Field("estimate_bias", "double", "estimate_unit", "mean of that error"),
    Field("estimate_max", "double", "estimate_unit", "largest magnitude of that error"),
    Field("estimate_unit", "string", "", "unit of these three"),
    Field("rod_mm", "double", "mm", "achieved peak of the rod against the same flight without faults"),
    Field("surface_deg", "double", "deg", "the same of the surface"),
    Field("travel_pct", "double", "%", "the same, of the travel"),
    Field("amplitude_mm", "double", "mm", "achieved amplitude of an oscillation of the rod, by least squares"),
    Field("amplitude_deg", "double", "deg", "the same of the surface"),
    Field("nz_min_g", "double", "g", "smallest load factor from the first onset on"),
    Field("nz_max_g", "double", "g", "largest load factor from there on"),
    Field("altitude_lost_m", "double", "m", "largest loss of altitude from there on"),
    Field("bank_deg", "double", "deg", "largest change of bank from there on"),
    Field("speed_lost_kt", "double", "kt", "largest loss of calibrated airspeed from there on"),
    Field("speed_gained_kt", "double", "kt", "largest gain of it"),
    Field("hinge_max_nm", "double", "N m", "largest hinge moment of a segment from there on"),
    Field("outside_s", "double", "s", "time outside the envelope from there on"),
)
ONCE = {  # on the first of a lane's rows only, so that sums over rows count nothing twice -> what stands on the others
    **{"false_alarms": 0, "standing_s": 0.0, "exposed_s": 0.0, "r_max_before": None, "r_max_after": None},
    **dict.fromkeys(("estimate_rmse", "estimate_bias", "estimate_max", "estimate_unit")),
}
ELSEWHERE = {"run", "lane", "status", "error", "sim_time_s", *ACHIEVED, *CONSEQUENCES}  # of the run, not of a lane
OF_A_LANE = [f for f in FIELDS if f.name not in ELSEWHERE]


def rows(run: str, result: Mapping) -> list[dict]:
    """Return the rows of run `run` from `result`, the plain data of `cosim.judge.result.Result.to_dict`. One per
    detector lane and fault that it could notice; a run without a detector has one row. Columns: FIELDS."""
    said = "; ".join(filter(None, (result["reason"], *result.get("notes", ()))))
    about = {"run": run, "status": result["status"], "error": said, "sim_time_s": result["sim_time_s"]}
    about |= largest(result["achieved"])
    about |= dict.fromkeys(CONSEQUENCES) | (result.get("consequences") or {})
    lanes = [{"lane": i, **own} for i, entry in enumerate(result["detectors"]) for own in lane(entry)]
    return [{**about, **own} for own in lanes or [{"lane": 0}]]


def lane(entry: Mapping) -> list[dict]:
    """Return what rows say of one detector lane, from its entry of the result (cosim.judge.result.judge)."""
    out = []
    for i, fault in enumerate(sorted(entry["by_fault"], key=lambda f: f["fault"] or 0) or [{}]):
        e = {**entry, **fault, **{k: entry[k] for k in ONCE}}
        out.append({f.name: _at(e, f.key or f.name) for f in OF_A_LANE} | (ONCE if i else {}))
    return out


def _at(entry, key):
    """Return the value of a key of an entry; behind a point that of a dict in it, None where there is none."""
    name, _, inner = key.partition(".")
    return (entry[name] or {}).get(inner) if inner else entry[name]
