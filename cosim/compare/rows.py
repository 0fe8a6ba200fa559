"""Rows of a comparison: one per run and detector, from a campaign's rows per lane, or from logs.

run, title, case, kind, target     the flight and its fault, case as in cosim/judge/coverage.py; null when fault-free
                                   of several faults the one that the detector noticed first, else the earliest
frequency_hz, amplitude_mm, rod_mm, surface_deg     of an oscillation; achieved, against the twin flight
hours                              flown
id, level, lanes                   detector; how many actuators it watches
word                               designed, may, blind: how it stands to the case
concerned                          it has a lane on the faulty part (aircraft level: always, when there is a fault)
idle                               its statistic never left zero: it never judged
detected, delay_s, delay_periods, class    of the first lane that noticed
outcome                            named, seen, misnamed, missed, quiet, bonus (cosim/judge/coverage.py), idle, or
                                   echo: it alarms in this manoeuvre without a fault as well; null when fault-free
false_alarms                       over all lanes
r_fault_free                       largest |r| of a fault-free flight; r_fault: from the onset on, concerned lanes
estimate_rmse, estimate_unit
"""

import json
import tomllib

import numpy as np
import pandas as pd

from cosim.campaign.worker import run_id
from cosim.judge import coverage
from cosim.judge import row as judged
from cosim.judge.achieved import NAMES as ACHIEVED
from cosim.scenario.catalog import DEFAULT_TECHNOLOGY


def tidy(frame, tomls):
    """Return one row per run and detector of `frame` (columns of cosim/campaign), `tomls` {run: scenario}."""
    lanes: dict = {}
    for lane in frame[frame["id"].notna()].to_dict("records"):
        lanes.setdefault((lane["run"], lane["id"]), []).append(lane)
    about = {run: _about(tomls[run]) for run in dict.fromkeys(run for run, _ in lanes)}
    out = [_row(run, detector, found, about[run]) for (run, detector), found in lanes.items()]
    return (
        echoes(pd.DataFrame(out).astype({"concerned": bool, "detected": bool, "idle": bool})) if out else pd.DataFrame()
    )


def echoes(rows):
    """Return rows in which an alarm that the same manoeuvre raises without a fault is no detection, but an "echo".

    That holds for a detector that alarmed in more than half of the fault-free flights with the same manoeuvre.
    """
    free = rows[rows["case"].isna()]
    alarmed = (free["false_alarms"] > 0).groupby([free["id"], free["manoeuvre_key"]]).mean()
    loud = set(alarmed[alarmed > 0.5].index)
    echo = rows["detected"] & np.array([pair in loud for pair in zip(rows["id"], rows["manoeuvre_key"])])
    rows.loc[echo, "outcome"] = "echo"
    rows.loc[echo, ["delay_s", "delay_periods"]] = np.nan
    rows["detected"] &= ~echo
    return rows


def _about(text):
    """Return what a row needs of the scenario."""
    s = tomllib.loads(text)
    faults = s.get("faults", [])
    technology = {k: s.get("elevator", {}).get(k, v) for k, v in DEFAULT_TECHNOLOGY.items()}
    air, manoeuvre = s["flight"].get("turbulence", "none"), s.get("manoeuvre", {}).get("kind", "cruise")
    return {
        "title": s.get("title", ""),
        "faults": len(faults),
        "each": [_fault(f, technology) for f in faults],
        "earliest": min(range(len(faults)), key=lambda i: faults[i]["start_s"], default=None),
        "turbulence": air,
        "manoeuvre": manoeuvre,
        "manoeuvre_key": json.dumps(s.get("manoeuvre", {}), sort_keys=True),
        "seed": s.get("seed", 1),
        "mass_t": s["flight"]["mass_t"],
    }


def _fault(f, technology):
    """Return what a row says of fault `f`, a table of a scenario, or of none."""
    if f is None:
        return {"case": None, "kind": None, "target": None, "frequency_hz": np.nan}
    return {
        "case": coverage.case_of(f["kind"], f["target"], technology, f.get("at", ""), "limit_deg" in f),
        "kind": f["kind"],
        "target": f["target"],
        "frequency_hz": f["frequency_hz"] if f["kind"].startswith("ofc") else np.nan,
    }


def _row(run, detector, lanes, about):
    """Return the row of one detector in one run; `lanes` are its rows per lane as dicts."""
    first, mine = lanes[0], [lane for lane in lanes if lane["concerned"]]
    seen = sorted((lane for lane in mine if _given(lane["delay_s"])), key=lambda lane: lane["detected_at_s"])
    best = seen[0] if seen else {}
    each, earliest = about["each"], about["earliest"]
    met = next((lane["fault"] for lane in (best, *mine) if _given(lane.get("fault"))), earliest)
    about = {k: v for k, v in about.items() if k not in ("each", "earliest")}
    about |= _fault(None, {}) if met is None else each[int(met)]
    fault = met is not None
    judging = mine if fault and mine else lanes
    idle = not seen and not any(_number(lane, key) > 0.0 for lane in judging for key in ("r_max_before", "r_max_after"))
    named = best.get("isolated_class") if _given(best.get("isolated_class")) else None
    how = coverage.outcome(detector, about["case"], bool(seen), named) if fault else None
    estimates = [lane for lane in lanes if _given(lane["estimate_rmse"])]
    return {
        "run": run,
        **about,
        "hours": float(first["sim_time_s"]) / 3600.0,
        "status": first["status"],
        **{k: _number(first, k) for k in ACHIEVED},
        "id": detector,
        "level": first["level"],
        "lanes": len(lanes),
        "word": coverage.expected(detector, about["case"]).word if fault else None,
        "concerned": bool(mine),
        "idle": idle,
        "detected": bool(seen),
        "delay_s": _number(best, "delay_s"),
        "delay_periods": _number(best, "delay_periods"),
        "class": named,
        "outcome": "idle" if idle and how in ("missed", "quiet") else how,
        "false_alarms": sum(int(lane["false_alarms"]) for lane in lanes),
        "r_fault_free": np.nan if fault else _largest(lanes, "r_max_before"),
        "r_fault": _largest(mine, "r_max_after") if fault else np.nan,
        "estimate_rmse": _largest(estimates, "estimate_rmse"),
        "estimate_unit": estimates[0]["estimate_unit"] if estimates else None,
    }


def _given(value):
    """Tell whether a cell holds something: neither None nor NaN."""
    return value is not None and value == value


def _number(row, name):
    value = row.get(name)
    return float(value) if _given(value) else np.nan


def _largest(lanes, name):
    found = [float(lane[name]) for lane in lanes if _given(lane[name])]
    return max(found) if found else np.nan


def of_logs(paths, progress=None):
    """Return (rows per lane with the columns of a campaign, {run: TOML}) of logs written by `cosim run`.

    The judgement is made again from what the detectors put out; achieved amplitudes need the flight and its twin flown
    again, where a fault acts on an elevator. Raises LogError.
    """
    from cosim.flight.twin import achieved, faulted
    from cosim.replay.recording import Flown

    rows, tomls = [], {}
    for i, path in enumerate(paths):
        flown = Flown(path)
        run = run_id(flown.scenario)
        while run in tomls:  # the same flight twice, or another version's
            run += "'"
        tomls[run] = flown.toml
        result = {
            "status": (flown.log.result or {}).get("status", "cut"),
            "reason": "",
            "sim_time_s": flown.end - flown.t0 + flown.dt,
            "achieved": achieved(flown.scenario) if faulted(flown.scenario) else None,
            "detectors": [lane.entry for lane in flown.lanes],
        }
        rows += judged.rows(run, result)
        if progress:
            progress(i + 1, len(paths))
    return pd.DataFrame(rows), tomls


def of_campaign(folder):
    """Return (rows per lane, timing, {run: TOML}) of a campaign's folder. Raises CampaignError."""
    from cosim.campaign.store import load

    frame, timing = load(folder)
    about = pd.read_parquet(f"{folder}/scenarios.parquet")
    return frame, timing, dict(zip(about["run"], about["toml"]))


def of_result(result, scenarios):
    """Return (rows per lane, timing, {run: TOML}) of a CampaignResult of `scenarios`."""
    return result.frame, result.timing, {run_id(s): s.expanded_toml() for s in scenarios}
