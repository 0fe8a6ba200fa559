"""The plain-language summary of a comparison: which level sees what, how soon, how surely, and where it goes blind."""

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from cosim.compare import metrics, stats
from cosim.compare.metrics import proportion
from cosim.judge import coverage
from cosim.judge.lanes import seconds
from cosim.judge.narrator import listed
from cosim.scenario.catalog import ACTUATOR_SENSORS
from cosim.table import number


def summary(rows: pd.DataFrame, each: list[dict], grouped: pd.DataFrame, sized: list[dict]) -> list[tuple[str, list]]:
    """Return the summary: [(heading, [items])]."""
    parts = []
    if len(grouped):
        parts.append(("Sees", _sees(grouped, stats.groups(rows))))
        ofc = _oscillations(sized)
        if ofc:
            parts.append(("Oscillations", ofc))
        parts.append(("Blind", _blind(grouped)))
        parts.append(("Names", _names(rows, each)))
    parts.append(("False alarms", _false(rows, each)))
    parts.append(("Read with care", _care(rows, each)))
    return parts


def versus(pairs: Sequence[dict], each: Sequence[dict]) -> list[tuple[str, list]]:
    """Return the summary of two campaigns side by side, as `summary`; `pairs` are those of the Comparison."""
    shipped = [p for p in pairs if p["at"] == "shipped"]
    told = []
    for p in (p for p in shipped if p["only_a"] or p["only_b"]):
        sure = "" if p["p"] is None else f", p = {p['p']:.2g} (McNemar)"
        told.append(f"{p['a']} alone in {p['only_a']}, {p['b']} alone in {p['only_b']} of {p['n']} faults{sure}")
    if same := [p["a"].rpartition(" (")[0] for p in shipped if not (p["only_a"] or p["only_b"])]:
        told.append(f"{listed(same)}: the same faults in both")
    counts = [f"{d['id']}: alarmed on {d['alarmed_on']} faults; of {d['designed']} that it was designed for "
              f"{d['detected']} seen, {d['named']} with the right name; {d['false_alarms']} false alarms in "
              f"{d['hours']:.2g} h" for d in each if d["alarmed_on"] or d["designed"] or d["false_alarms"]]  # fmt: skip
    return [("Seen by one", told), ("Each", counts)]


def _sees(grouped, members):
    out: list[str] = []
    first = grouped[grouped["seen"]].groupby("run")["group"].agg(["count", "first"])
    only = first.loc[first["count"] == 1, "first"].value_counts()  # {group: flights in which no other saw the fault}
    for g, own in grouped.groupby("group", sort=False):
        able = own[own["able"]]
        if not len(able):
            out.append(g + ": nothing in these flights that it could see")
            continue
        seen = able[able["seen"]]
        late = metrics.delays(able["delay_s"].to_numpy(float)).median
        soon = f", first alarm after {seconds(late)} s (median)" if np.isfinite(late) else ", half of them or fewer"
        alone = f"; alone in {only[g]}" if g in only else ""
        who = f"{g} ({', '.join(members[g])})"
        out.append(who + f": {len(seen)} of the {len(able)} faulty flights that it can see by structure{soon}{alone}")
    return out


def _oscillations(sized):
    out: list[str] = []
    mine = [d for d in sized if d["family"] == "liquid OFC, one segment"]
    best = {g: min(_needed(d) for d in mine if d["group"] == g) for g in dict.fromkeys(d["group"] for d in mine)}
    for g in sorted(best, key=lambda g: best[g]):
        own = [d for d in mine if d["group"] == g]
        told = [f"{number(d['a90_95'], 2)} mm at {d['frequency_hz']:g} Hz" for d in own if d["a90_95"] is not None]
        told += [f"{d['note']} mm at {d['frequency_hz']:g} Hz" for d in own if d["a90_95"] is None
                 and _needed(d) < math.inf]  # fmt: skip
        never = [f"{d['frequency_hz']:g}" for d in own if d["n"] and not d["seen"]]
        if never:
            told.append(f"none seen at {listed(never)} Hz")
        if told:
            out.append(g + f": {', '.join(told)}")
    if out:
        about = "a90/95, or from where all were seen; the others stand in the table"
        out.insert(0, f"of a liquid one on one segment, achieved at the rod: {about}")
    return out


def _needed(d):
    """Return the amplitude [mm] that is enough: a90/95, the upper of two that part seen and missed, 0 where all were
    seen; inf where the flights do not say."""
    if d["a90_95"] is not None:
        return d["a90_95"]
    if d["note"].startswith("between"):
        return float(d["note"].split()[-1])
    return 0.0 if d["note"].startswith("all seen") else math.inf


def _blind(grouped):
    out = []
    for g, own in grouped.groupby("group", sort=False):
        blind = [c for c, part in own.groupby("case", sort=False) if not part["able"].any()]
        missed = [c for c, part in own.groupby("case", sort=False) if part["able"].any() and not part["seen"].any()]
        said = []
        if blind:
            said.append(f"by structure to {_short(blind)}")
        if missed:
            said.append(f"could have seen, but did not: {_short(missed)}")
        if said:
            out.append(g + f": {'; '.join(said)}")
    nobody = [c for c, part in grouped.groupby("case", sort=False) if not part["seen"].any()]
    if nobody:
        out.append(f"seen by nobody: {_short(nobody)}")
    return out


def _short(cases, most=5):
    names = [coverage.label(c).replace("hydraulic: ", "hydraulic ").replace("ema: ", "EMA ") for c in cases]
    return listed(names) if len(names) <= most else f"{', '.join(names[:most])} and {len(names) - most} more"


def _names(rows, each):
    """Tell what became of the faults that detectors designed for them saw: the sums of the table's columns."""
    seen, named, unsure, wrong = (sum(d[k] for d in each) for k in ("detected", "named", "ambiguous", "misnamed"))
    if not seen:
        return []
    told = (f"of {seen} detections by detectors designed for the fault {named} named it right, {unsure} called it "
            f"ambiguous, {wrong} gave another name")  # fmt: skip
    own = stats.designed_for(rows[rows["detected"] & (rows["outcome"] == "misnamed")])
    parts = (*ACTUATOR_SENSORS, "jam_liquid")
    of_sensor = own["case"].map(lambda case: case.startswith("sensor") or case.split(".", 1)[-1] in parts)
    crossed = own[(own["isolated_class"] == "sensor") != of_sensor.astype(bool)]
    if len(crossed):
        who = ", ".join(f"{n} {k}" for n, k in crossed["id"].value_counts().items())
        told += f"; in {len(crossed)} a sensor fault was called an actuator's, or the reverse ({who})"
    return [told]


def _false(rows, each):
    free = rows[rows["case"].isna()]["run"].nunique()
    loud = [d for d in each if d["fault_free_alarmed"]]
    if not free:
        return ["no fault-free flight was flown: nothing can be said"]
    told = (f"{len(each) - len(loud)} of {len(each)} detectors were quiet in all {free} fault-free flights (below "
            f"{proportion(0, free).high:.0%} per flight, 95 %)")  # fmt: skip
    return ["; ".join([told, *(f"{d['id']} alarmed in {d['fault_free_alarmed']}" for d in loud)])]


def _care(rows, each):
    out: list[str] = []
    runs = rows["run"].nunique()
    if runs < 300:
        flown = rows[rows["case"].notna()].drop_duplicates(["run", "fault"])["case"].value_counts()
        once = int((flown == 1).sum())
        told = f": {once} of {len(flown)} kinds of fault flew once" if once else ""
        out.append(f"{runs} flights are a look, not a proof{told}. `cosim campaign` flies thousands.")
    for d in each:
        if d["not_valid"]:
            why = f": {d['why_not_valid']}" if d["why_not_valid"] else ""
            n, of = d["not_valid"], d["designed"]
            said = f"could not judge {n} of the {of} faults that it was designed for (not valid{why})"
            out.append(f"{d['id']} {said}: they stay in its counts.")
    dull = [d["id"] for d in each if not d["credible"]]
    if dull:
        out.append(f"{listed(dull)}: alarms all the time and therefore tells nothing; left out of the levels.")
    remarks = {d["id"]: coverage.remark(d["id"]) for d in each if d["id"] not in dull}
    return out + [f"{name}: {remark}." for name, remark in remarks.items() if remark]
