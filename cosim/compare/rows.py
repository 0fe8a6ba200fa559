"""Rows of a comparison: one per run, detector and fault, from a campaign's rows per lane, or from logs.

run, fault                         the flight, and the number of a fault of it; null without one
case, kind, target                 of the fault, case as in cosim/judge/coverage.py; null without one
turbulence, manoeuvre              of the flight
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
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from cosim.campaign.store import load
from cosim.campaign.worker import FAILED, run_id
from cosim.errors import CosimError
from cosim.judge import coverage
from cosim.judge import row as judged
from cosim.judge.fault_effect import NAMES as ACHIEVED
from cosim.judge.naming import NOT_GIVEN, outcome
from cosim.replay.detector_replay import tell
from cosim.scenario import Scenario, parse
from cosim.texts import toml

FAMILIES = (
    *("liquid OFC, one segment", "liquid OFC, several", "solid OFC, one segment", "solid OFC, several"),
    *("jam or runaway", "other actuator fault", "actuator's sensor", "aircraft's sensor", "engine or other surface"),
)
LANE, KEY = ["run", "id"], ["run", "id", "fault"]
AGAIN, CUT = "the same flight again, counted once", "ends early, judged up to there"
NO_FAULT = -1  # as a number of a fault while rows are made: pandas groups by no null
OF_FIRST = {  # column of the lane that noticed first -> what stands there where none did
    **dict.fromkeys(("isolated_class", "first_verdict", "withdrawn", "delay_s", "delay_periods", "time_to_right_s",
                     "right_after_motion_s", "class_changes", "ambiguous_s", "alarm_share", "withdrawn_after_s")),
    **dict.fromkeys(("right", "first_right", "first_sure_wrong"), False),
    **{"class_given": NOT_GIVEN, "place_given": NOT_GIVEN, "place_level": ""},
}  # fmt: skip


def family(kind: str, target: str, segments: tuple) -> str:
    """Return the word of FAMILIES for a fault as a scenario writes it; `segments` are the elevator's."""
    place, *rest = target.split(".")
    if place != "elevator":
        return "aircraft's sensor" if place == "sensor" else "engine or other surface"
    if len(rest) > 1 or kind == "jam_liquid":
        return "actuator's sensor"
    if kind.startswith("ofc"):
        return f"{kind.removeprefix('ofc_')} OFC, {'one segment' if rest[0] in segments else 'several'}"
    return "jam or runaway" if kind.startswith(("jam", "runaway")) else "other actuator fault"


def tidy(frame: pd.DataFrame, tomls: Mapping[str, str], source: str = "") -> pd.DataFrame:
    """Return the rows of `frame` (columns of cosim/campaign), `tomls` {run: scenario}. Raises CosimError, which names
    their `source`, without a detector."""
    lanes = frame.loc[frame["id"].notna(), [f.name for f in judged.FIELDS]]
    if lanes.empty:
        raise CosimError("no flight has a detector to compare", place=source)
    flights = {run: flown(tomls[run]) for run in lanes["run"].unique()}
    rows = _grouped(_with_each_fault(lanes, flights)).reset_index()
    once = ~rows.duplicated(LANE)  # the row on which what is of a whole flight stands
    whole, flight = lanes.groupby(LANE), rows[LANE].agg(tuple, axis=1)
    rows["hours"] = flight.map(whole["exposed_s"].sum() / whole["lane"].nunique(dropna=False) / 3600.0).where(once)
    for name in ("false_alarms", "standing_s"):
        rows[name] = flight.map(whole[name].sum()).where(once, 0)
    rows = rows.merge(_faults(flights), on=["run", "fault"])
    rows["fault"] = rows["fault"].where(rows["case"].notna())
    rows["r_fault_free"] = rows["r_fault_free"].where(rows["case"].isna())
    pairs = list(zip(rows["id"], rows["case"]))
    words = {pair: coverage.expected(*pair) for pair in {*pairs} if isinstance(pair[1], str)}
    rows["word"] = [words.get(pair) for pair in pairs]
    rows["outcome"] = [
        outcome(r.id, r.case, seen=r.detected, class_=r.class_given, place=r.place_given, able=not r.not_valid,
                masked=r.masked) if isinstance(r.case, str) else None for r in rows.itertuples()
    ]  # fmt: skip
    return with_alarms_anyway(rows.astype({"false_alarms": int}))


def _with_each_fault(lanes, flights):
    """Return the rows per lane, sorted by flight, detector and fault. A lane that no fault concerns stands beside each
    that its detector could notice elsewhere, else beside the earliest that began, else beside NO_FAULT."""
    lanes = lanes.assign(order=lanes.groupby(LANE, sort=False).ngroup())
    concerned = lanes[lanes["fault"].notna()]
    others = lanes[lanes["fault"].isna()].drop(columns="fault")
    others = others.merge(concerned[KEY].drop_duplicates(), on=LANE, how="left")
    time = lanes.groupby("run")["sim_time_s"].first()
    earliest = others["run"].map({run: _earliest(s.faults, time[run]) for run, s in flights.items()})
    others["fault"] = others["fault"].fillna(earliest)
    both = pd.concat([concerned, others]) if len(concerned) else others
    return both.sort_values(["order", "fault"], kind="stable").astype({"fault": int, "concerned": bool, "able": bool})


def _earliest(faults, end):
    """Return the number of the fault that began first before the `end` of a flight [s], NO_FAULT without one."""
    begun = [i for i, f in enumerate(faults) if f.start_s < end]
    return min(begun, key=lambda i: faults[i].start_s, default=NO_FAULT)


def _grouped(lanes):
    """Return a row per flight, detector and fault: what is of all of its lanes, of those that the fault concerns, and
    of the one that noticed first."""
    each, mine = lanes.groupby(KEY, sort=False), lanes[lanes["concerned"]]
    asked = lanes[lanes["concerned"] | ~each["concerned"].transform("any")].groupby(KEY, sort=False)
    rows = each[["status", *ACHIEVED, "level", "estimate_unit"]].first()
    rows = rows.assign(lanes=each.size(), concerned=each["concerned"].any(), valid_share=each["valid_share"].mean())
    rows[["r_fault_free", "estimate_rmse"]] = each[["r_max_before", "estimate_rmse"]].max()
    rows["r_fault"] = mine.groupby(KEY)["r_max_after"].max()
    first = mine.assign(late=mine["detected_at_s"].where(mine["delay_s"].notna()))
    first = first.sort_values("late", kind="stable").drop_duplicates(KEY).set_index(KEY)
    rows = rows.join(first[[*OF_FIRST, "masked", "not_excited"]])
    rows["detected"] = rows["delay_s"].notna()
    for name, otherwise in OF_FIRST.items():
        rows[name] = rows[name].where(rows["detected"], otherwise)
    flags = dict.fromkeys(("right", "first_right", "first_sure_wrong", "masked", "not_excited"), bool)
    rows[[*flags]] = rows[[*flags]].astype(object).fillna(False).astype(flags)
    rows["not_valid"] = ~rows["detected"] & ~asked["able"].any()
    return rows.assign(why_not_valid=asked["why_not_valid"].first())


def with_alarms_anyway(rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows with the column `alarms_anyway`; null where no flight without a fault has the manoeuvre."""
    free = rows[rows["case"].isna()]
    share = (free["false_alarms"] > 0).groupby([free["id"], free["manoeuvre_key"]]).mean()
    return rows.join(share.rename("alarms_anyway"), on=["id", "manoeuvre_key"])


def flown(text: str) -> Scenario:
    """Return the Scenario of a run's TOML, its detectors left out: user detectors need not be known to this process."""
    tables = toml(text, place="scenario")
    return parse({k: v for k, v in tables.items() if k != "detectors"}, place="scenario")


def flight(text: str) -> str:
    """Return what tells a flight from others: a digest of its scenario, from TOML, without the detectors."""
    return hashlib.sha256(flown(text).expanded_toml().encode()).hexdigest()[:16]


def _faults(flights):
    """Return what a row says of each flight and fault, NO_FAULT among them."""
    out = []
    for run, s in flights.items():
        about = {"run": run, "turbulence": s.flight.turbulence, "manoeuvre": s.manoeuvre.kind,
                 "manoeuvre_key": s.manoeuvre.model_dump_json()}  # fmt: skip
        out.append(about | {"fault": NO_FAULT})
        out += [
            about | {"fault": i, "case": case, "kind": f.kind, "target": f.target,
                     "family": family(f.kind, f.target, s.aircraft.segments),
                     "frequency_hz": f.model_extra["frequency_hz"] if f.kind.startswith("ofc") else np.nan}
            for i, (f, case) in enumerate(zip(s.faults, coverage.cases(s)))
        ]  # fmt: skip
    types = dict.fromkeys(("case", "kind", "target", "family"), "str") | {"frequency_hz": float}
    return pd.DataFrame(out).reindex(columns=[*out[0], *types]).astype(types)


def of_logs(
    paths: Sequence[str | Path], progress: Callable[[int, int], None] | None = None, user_detectors: Iterable = ()
) -> tuple[pd.DataFrame, dict[str, str], dict[str, list[str]]]:
    """Return (rows per lane with the columns of a campaign, {run: TOML}, notes) of logs written by `cosim run`.

    A flight that several logs hold, whatever detectors flew in it, is one run, and each detector in it counts once, by
    the first of its logs; `notes` {sentence: names} tell of the others, and of logs that end before their flight. The
    judgement is made again from what the detectors put out; achieved amplitudes need the flight flown again, with and
    without its faults, where one acts on an elevator, without the detectors; where user files flew they are what the
    log says. `user_detectors` are made ones, run on each flight. Raises LogError.
    """
    from cosim.flight.faults.fault_free_reference import faulted, unwatched
    from cosim.flight.simulate import simulate
    from cosim.replay.recording import LoggedFlight

    rows: list[dict] = []
    tomls: dict[str, str] = {}
    first: dict[str, tuple[str, str, set]] = {}  # flight -> (run, its first log, detectors that are counted)
    notes: dict[str, list[str]] = {AGAIN: [], CUT: []}
    for i, path in enumerate(paths):
        flown = LoggedFlight(path, user_detectors)
        run, name, counted = first.setdefault(flight(flown.toml), (run_id(flown.scenario), Path(path).name, set()))
        notes[AGAIN] += [f"{Path(path).name} of {name}"] if run in tomls else []
        status = (flown.log.result or {}).get("status", "cut")
        notes[CUT] += [Path(path).name] * (status in ("cut", "interrupted") or flown.n < flown.log.n_ticks)
        tomls.setdefault(run, flown.toml)
        if all(key.startswith("detectors.") for key in flown.scenario.user_parts):  # a log never has any code run
            bare = unwatched(flown.scenario)  # detectors move nothing
            flown.achieved = simulate(bare, achieved=True).extra["achieved"] if faulted(bare) else None
        new = [lane.entry for lane in flown.lanes if lane.id not in counted]
        rows += judged.rows(run, {
            "status": status, "reason": "", "achieved": flown.achieved,
            "sim_time_s": flown.end - flown.t0 + flown.dt, "detectors": new,
        })  # fmt: skip
        counted |= {lane.id for lane in flown.lanes}
        if progress:
            progress(i + 1, len(paths))
    return pd.DataFrame(rows), tomls, notes


def of_campaign(folder: Path) -> tuple[pd.DataFrame, pd.DataFrame, int, int, str, dict[str, str]]:
    """Return (rows, timing, flights, runs without one, title, {run: TOML}) of a campaign's folder. Raises
    CampaignError."""
    frame, timing, tomls, about = load(folder)
    for entry in about.get("user_detectors", []):
        tell(entry)
    status = frame.drop_duplicates("run")["status"]
    failed, title = int(status.isin(FAILED).sum()), str(about.get("title", ""))
    return tidy(frame, tomls, str(folder)), timing, len(status), failed, title, tomls
