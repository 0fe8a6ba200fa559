"""The rows of a run: one per detector lane, from the plain data of its result."""

from collections.abc import Mapping

from cosim.judge.achieved import largest

SAME = (  # named alike in the result and in the row
    *("id", "level", "target", "concerned", "alarm", "detected_at_s", "fault", "false_alarms"),
    *("r_max_before", "r_max_after", "estimate_rmse", "estimate_bias", "estimate_max", "estimate_unit"),
)


def rows(run: str, result: Mapping) -> list[dict]:
    """Return the rows of run `run` from `result`, the plain data of `cosim.judge.result.Result.to_dict`.

    A run without a detector has one row. Columns: cosim/campaign/store.py.
    """
    about = {"run": run, "status": result["status"], "error": result["reason"], "sim_time_s": result["sim_time_s"]}
    about |= largest(result["achieved"])
    lanes = [lane(d) for d in result["detectors"]] or [{}]
    return [{**about, "lane": i, **own} for i, own in enumerate(lanes)]


def lane(entry: Mapping) -> dict:
    """Return what a row says of one detector lane from its entry of the result (cosim.judge.result.judge)."""
    said = entry["isolated"] or {}
    return {k: entry[k] for k in SAME} | {
        "delay_s": entry["detection_delay_s"],
        "delay_periods": entry["detection_delay_periods"],
        "isolated_class": said.get("class"),
        "isolated_target": said.get("target"),
    }
