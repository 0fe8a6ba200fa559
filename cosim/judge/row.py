"""The rows of a run: one per detector lane and fault, from the plain data of its result."""

from collections.abc import Mapping

from cosim.judge.consequences import NAMES as CONSEQUENCES
from cosim.judge.fault_effect import largest

LANE = ("id", "level", "target", "concerned", "alarm", "valid_share", "why_not_valid", "able")
ONCE = {  # on the first of a lane's rows only, so that sums over rows count nothing twice -> what stands on the others
    **{"false_alarms": 0, "standing_s": 0.0, "exposed_s": 0.0, "r_max_before": None, "r_max_after": None},
    **dict.fromkeys(("estimate_rmse", "estimate_bias", "estimate_max", "estimate_unit")),
}
FAULT = (
    *("fault", "detected_at_s", "right", "class_given", "place_given", "place_level", "first_right"),
    *("first_sure_wrong", "time_to_right_s", "right_after_motion_s", "not_excited"),
    *("class_changes", "ambiguous_s", "alarm_share", "withdrawn_after_s", "withdrawn", "valid_at_fault"),
)


def rows(run: str, result: Mapping) -> list[dict]:
    """Return the rows of run `run` from `result`, the plain data of `cosim.judge.result.Result.to_dict`.

    One per detector lane and fault that it could notice; a run without a detector has one row. Columns:
    cosim/campaign/__init__.py.
    """
    about = {"run": run, "status": result["status"], "error": result["reason"], "sim_time_s": result["sim_time_s"]}
    about |= largest(result["achieved"])
    about |= dict.fromkeys(CONSEQUENCES) | (result.get("consequences") or {})
    lanes = [{"lane": i, **own} for i, entry in enumerate(result["detectors"]) for own in lane(entry)]
    return [{**about, **own} for own in lanes or [{"lane": 0}]]


def lane(entry: Mapping) -> list[dict]:
    """Return what rows say of one detector lane, from its entry of the result (cosim.judge.result.judge)."""
    out = []
    for i, fault in enumerate(sorted(entry["by_fault"], key=lambda f: f["fault"] or 0) or [{}]):
        e = {**entry, **fault}
        once = ONCE if i else {k: entry[k] for k in ONCE}
        first, last = (e[k] or {} for k in ("first_verdict", "isolated"))
        out.append({k: e[k] for k in (*LANE, *FAULT)} | once | {
            "delay_s": e["detection_delay_s"],
            "delay_periods": e["detection_delay_periods"],
            "first_verdict": first.get("class"),
            "isolated_class": last.get("class"),
            "isolated_target": last.get("target"),
        })  # fmt: skip
    return out
