"""Rows of a comparison: one per run, detector and fault, from a campaign's rows per lane, or from logs.

run, fault                         the flight, and the number of a fault of it; null without one
title, case, kind, target          the flight and a fault of it, case as in cosim/judge/coverage.py; null without one
family                             the kind of fault in the tables: FAMILIES
frequency_hz, amplitude_mm, rod_mm, surface_deg     of an oscillation; achieved, against the flight without it
hours                              in which a false alarm would count (`exposed_s` of cosim/judge/row.py), mean over its
                                   lanes; null on the rows of a flight's further faults
id, level, lanes                   detector; how many actuators it watches
word                               designed, may, blind: how it stands to the case
concerned                          it has a lane on the faulty part (aircraft level: always, when there is a fault)
not_valid                          it could not judge; why_not_valid says why, valid_share how much of a
                                   flight it was valid
detected, delay_s, delay_periods, isolated_class     of the first lane that noticed, and of that lane:
first_verdict, right, class_given, place_given, place_level, first_right, first_sure_wrong, time_to_right_s,
right_after_motion_s, not_excited, masked, class_changes, ambiguous_s, alarm_share, withdrawn, withdrawn_after_s: as
cosim/judge/detection.py
outcome                            a word of cosim.judge.naming.outcome; null when fault-free
alarms_anyway                      share of the flights without a fault and with the same manoeuvre in which it alarms
false_alarms, standing_s           over all lanes
r_fault_free                       largest |r| of a fault-free flight; r_fault: from the onset on, concerned lanes
estimate_rmse, estimate_unit
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from cosim.campaign.worker import run_id
from cosim.judge import coverage
from cosim.judge import row as judged
from cosim.judge.fault_effect import NAMES as ACHIEVED
from cosim.judge.naming import NOT_GIVEN, outcome
from cosim.replay import log_schema
from cosim.replay.detector_replay import tell
from cosim.scenario import Scenario, parse
from cosim.texts import toml

FAMILIES = (
    *("liquid OFC, one segment", "liquid OFC, several", "solid OFC, one segment", "solid OFC, several"),
    *("jam or runaway", "other actuator fault", "actuator's sensor", "aircraft's sensor", "engine or other surface"),
)
NUMBERS = (  # of the lane that noticed first
    *("delay_s", "delay_periods", "time_to_right_s", "right_after_motion_s", "class_changes", "ambiguous_s"),
    *("alarm_share", "withdrawn_after_s"),
)


def family(kind: str, target: str, segments: tuple) -> str:
    """Return the word of FAMILIES for a fault as a scenario writes it; `segments` are the elevator's."""
    place, *rest = target.split(".")
    if place == "sensor":
        return "aircraft's sensor"
    if place != "elevator":
        return "engine or other surface"
    if len(rest) > 1 or kind == "jam_liquid":
        return "actuator's sensor"
    if kind.startswith("ofc"):
        many = "one segment" if rest[0] in segments else "several"
        return f"{kind.removeprefix('ofc_')} OFC, {many}"
    return "jam or runaway" if kind.startswith(("jam", "runaway")) else "other actuator fault"


def tidy(frame: pd.DataFrame, tomls: Mapping[str, str]) -> pd.DataFrame:
    """Return the rows of `frame` (columns of cosim/campaign), `tomls` {run: scenario}; an empty frame without any."""
    lanes: dict = {}
    for lane in frame[frame["id"].notna()].to_dict("records"):
        given = {k: v for k, v in lane.items() if v is not None and v == v}  # without cells that hold nothing
        lanes.setdefault((lane["run"], lane["id"]), []).append({"able": "able" not in lane, **given})
    about = {run: _about(tomls[run]) for run in dict.fromkeys(run for run, _ in lanes)}
    out = []
    for (run, detector), found in lanes.items():
        met = sorted({int(lane["fault"]) for lane in found if "fault" in lane}) or [_earliest(about[run], found[0])]
        for i, fault in enumerate(met):
            own = [lane for lane in found if lane.get("fault", fault) == fault]
            out.append(_row(run, detector, own, found if i == 0 else [], about[run], fault))
    if not out:
        return pd.DataFrame()
    return with_alarms_anyway(pd.DataFrame(out).astype({"concerned": bool, "detected": bool, "not_valid": bool}))


def with_alarms_anyway(rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows with the column `alarms_anyway`; null where no flight without a fault has the manoeuvre."""
    free = rows[rows["case"].isna()]
    share = (free["false_alarms"] > 0).groupby([free["id"], free["manoeuvre_key"]]).mean()
    share = share.rename_axis(["id", "manoeuvre_key"]).rename("alarms_anyway").reset_index()
    return rows.merge(share, on=["id", "manoeuvre_key"], how="left")


def flown(text: str) -> Scenario:
    """Return the Scenario of a run's TOML, its detectors left out: guests need not be known to this process."""
    tables = toml(text, place="scenario")
    return parse({k: v for k, v in tables.items() if k != "detectors"}, place="scenario")


def flight(text: str) -> str:
    """Return what tells a flight from others: a digest of its scenario, from TOML, without the detectors."""
    return hashlib.sha256(flown(text).expanded_toml().encode()).hexdigest()[:16]


def _about(text):
    s = flown(text)
    cases = coverage.cases(s)
    return {
        "title": s.title, "faults": len(s.faults),
        "each": [_fault(f, case, s.aircraft.segments) for f, case in zip(s.faults, cases)],
        "starts": [f.start_s for f in s.faults],
        "turbulence": s.flight.turbulence, "manoeuvre": s.manoeuvre.kind,
        "manoeuvre_key": s.manoeuvre.model_dump_json(), "seed": s.seed, "mass_t": s.flight.mass_t,
    }  # fmt: skip


def _earliest(about, lane):
    """Return the number of the fault that began first before the flight of `lane` ended, None without one."""
    begun = [i for i, start in enumerate(about["starts"]) if start < lane["sim_time_s"]]
    return min(begun, key=lambda i: about["starts"][i], default=None)


def _fault(f, case, segments):
    if f is None:
        return {"case": None, "kind": None, "target": None, "family": None, "frequency_hz": np.nan}
    swings = f.kind.startswith("ofc")
    about = {"case": case, "kind": f.kind, "target": f.target, "family": family(f.kind, f.target, segments)}
    return about | {"frequency_hz": (f.model_extra or {})["frequency_hz"] if swings else np.nan}


def _row(run, detector, lanes, whole, about, fault):
    """Return the row of one detector, run and fault (its number, or None without one).

    `lanes` are the rows per lane of that fault, {column: what it holds}; `whole` all rows of the detector in the run,
    for what is counted once in a flight, empty on the rows of its further faults.
    """
    first, mine, n = lanes[0], [lane for lane in lanes if lane["concerned"]], len({lane.get("lane") for lane in whole})
    seen = sorted((lane for lane in mine if "delay_s" in lane), key=lambda lane: _number(lane, "detected_at_s"))
    best = seen[0] if seen else {}
    told = best or next(iter(mine), {})
    each = about["each"][fault] if fault is not None else _fault(None, None, ())
    able = any(lane["able"] for lane in mine or lanes)
    given = {k: best.get(k, NOT_GIVEN) for k in ("class_given", "place_given")}
    how = None
    if fault is not None:
        how = outcome(detector, each["case"], seen=bool(seen), class_=given["class_given"],
                      place=given["place_given"], able=able, masked=bool(told.get("masked")))  # fmt: skip
    return {
        "run": run, "fault": fault, **{k: v for k, v in about.items() if k not in ("each", "starts")}, **each,
        "hours": sum(_number(lane, "exposed_s") for lane in whole) / n / 3600.0 if n else np.nan,
        "status": first["status"], **{k: _number(first, k) for k in ACHIEVED}, "id": detector, "level": first["level"],
        "lanes": len(lanes), "word": coverage.expected(detector, each["case"]) if fault is not None else None,
        "concerned": bool(mine), "not_valid": not seen and not able,
        "why_not_valid": next((lane["why_not_valid"] for lane in mine or lanes if "why_not_valid" in lane), None),
        "valid_share": float(np.mean([_number(lane, "valid_share") for lane in lanes])), "detected": bool(seen),
        "isolated_class": best.get("isolated_class"), "first_verdict": best.get("first_verdict"),
        "right": bool(best.get("right")), **given, "place_level": best.get("place_level", ""),
        "first_right": bool(best.get("first_right")), "first_sure_wrong": bool(best.get("first_sure_wrong")),
        **{k: bool(told.get(k)) for k in ("not_excited", "masked")}, "withdrawn": best.get("withdrawn"),
        **{k: _number(best, k) for k in NUMBERS}, "outcome": how,
        "false_alarms": sum(int(lane["false_alarms"]) for lane in whole),
        "standing_s": float(sum(_number(lane, "standing_s") for lane in whole)),
        "r_fault_free": np.nan if fault is not None else _largest(lanes, "r_max_before"),
        "r_fault": _largest(mine, "r_max_after") if fault is not None else np.nan,
        "estimate_rmse": _largest(lanes, "estimate_rmse"),
        "estimate_unit": next((lane.get("estimate_unit") for lane in lanes if "estimate_rmse" in lane), None),
    }  # fmt: skip


def _number(row, name):
    return float(row.get(name, np.nan))


def _largest(lanes, name):
    return max((float(lane[name]) for lane in lanes if name in lane), default=np.nan)


def of_logs(
    paths: Sequence[str | Path], progress: Callable[[int, int], None] | None = None, guests: Iterable = ()
) -> tuple[pd.DataFrame, dict[str, str]]:
    """Return (rows per lane with the columns of a campaign, {run: TOML}) of logs written by `cosim run`.

    A flight that several logs hold, whatever detectors flew in it, is one run, and each detector in it counts once, by
    the first of its logs; `attrs["again"]` of the rows names the others. The judgement is made again from what the
    detectors put out; achieved amplitudes need the flight flown again, with and without its faults, where
    one acts on an elevator, without the detectors; where user files flew they are what the log says. `guests` are made
    guests, run on each flight. Raises LogError.
    """
    from cosim.flight.faults.fault_free_reference import achieved, faulted, unwatched
    from cosim.replay.recording import LoggedFlight

    rows: list[dict] = []
    tomls: dict[str, str] = {}
    first: dict[str, tuple[str, str, set]] = {}  # flight -> (run, its first log, detectors that are counted)
    again: list[str] = []
    for i, path in enumerate(paths):
        flown = LoggedFlight(path, guests)
        key, ids = flight(flown.toml), {lane.id for lane in flown.lanes}
        run, name, counted = first.setdefault(key, (run_id(flown.scenario), Path(path).name, set()))
        if run in tomls:
            again.append(f"{Path(path).name} of {name}")
        tomls.setdefault(run, flown.toml)
        if all(key.startswith("detectors.") for key in flown.scenario.user_parts):  # a log never has any code run
            bare = unwatched(flown.scenario)  # detectors move nothing
            flown.achieved = achieved(bare) if faulted(bare) else None
        result = {
            "status": (flown.log.result or {}).get("status", "cut"),
            "reason": "",
            "sim_time_s": flown.end - flown.t0 + flown.dt,
            "achieved": flown.achieved,
            "detectors": [lane.entry for lane in flown.lanes if lane.id not in counted],
        }
        if ids - counted or not ids:
            rows += judged.rows(run, result)
        counted |= ids
        if progress:
            progress(i + 1, len(paths))
    frame = pd.DataFrame(rows)
    frame.attrs["again"] = again
    return frame, tomls


def of_campaign(folder: str | Path) -> tuple:
    """Return (rows per lane, timing, {run: TOML}, title) of a campaign's folder. Raises CampaignError."""
    from cosim.campaign.store import load

    frame, timing, tomls, about = load(folder)
    for entry in log_schema.guests(json.dumps(about.get("guests", [])).encode(), str(folder)):
        tell(entry)
    return frame, timing, tomls, str(about.get("title", ""))
