"""What a comparison says: pure functions of its rows (cosim/compare/rows.py). Intervals are exact, at 95 %."""

import math

import numpy as np
import pandas as pd

from cosim.compare import metrics
from cosim.judge.coverage import BLIND, DESIGNED, MAY, group
from fdi.common.record import GROUPS
from fdi.registry import SHIPPED

SEEN = 0.95  # share of the larger oscillations that a level has to see
FREQUENCIES = 8
ALPHA = 0.05  # run-level false-alarm probability at which detectors are set side by side
GROUPED = (
    "run",
    "case",
    "frequency_hz",
    "amplitude_mm",
    "target",
    "group",
    "able",
    "seen",
    "named",
    "delay_s",
    "first",
)
CREDIBLE = 0.5  # a detector that cries in more than half of the fault-free flights tells nothing by alarming


def delays(rows):
    """Return the Delays of rows (missed ones are NaN), or None without any."""
    return metrics.delays(rows["delay_s"].to_numpy()) if len(rows) else None


def detectors(rows, timing=None):
    """Return a list of dicts, one per detector: what it saw of what it was designed for, how soon, at what price."""
    cost = {} if timing is None else timing[timing["id"].notna()].groupby("id")["step_us"].median().to_dict()
    out = []
    for name, own in rows.groupby("id", sort=False):
        free = own[own["case"].isna()]
        designed = own[(own["word"] == DESIGNED) & own["concerned"] & ~own["idle"]]
        seen = designed[designed["detected"]]
        alarmed = int((free["false_alarms"] > 0).sum())
        per_hour = metrics.rate(int(own["false_alarms"].sum()), float(own["hours"].sum()))
        late = delays(designed)
        p, low, high = metrics.proportion(len(seen), len(designed))
        pf, f_low, f_high = metrics.proportion(alarmed, len(free))
        out.append(
            {
                "id": name,
                "level": own["level"].iloc[0],
                "designed": len(designed),
                "detected": len(seen),
                "missed": len(designed) - len(seen),
                "detection_probability": p,
                "detection_low": low,
                "detection_high": high,
                "named": int((designed["outcome"] == "named").sum()),
                "misnamed": int((own["outcome"] == "misnamed").sum()),
                "idle": int(own["idle"].sum()),
                "seen_of_may": int((own["detected"] & (own["word"] == MAY) & own["concerned"]).sum()),
                "may": int(((own["word"] == MAY) & own["concerned"]).sum()),
                "unexpected": int((own["outcome"] == "bonus").sum()),
                "delay_s": late and late.median,  # a missed fault counts as an endless delay
                "delay_s_low": late and late.median_low,
                "delay_s_high": late and late.median_high,
                "delay_s_p95": late and late.p95,
                "delay_s_max": late and late.largest,
                "false_alarms": int(own["false_alarms"].sum()),
                "false_alarms_per_hour": per_hour[0],
                "false_alarms_per_hour_low": per_hour[1],
                "false_alarms_per_hour_high": per_hour[2],
                "fault_free_runs": len(free),
                "fault_free_alarmed": alarmed,
                "false_alarm_probability": pf,
                "false_alarm_low": f_low,
                "false_alarm_high": f_high,
                "credible": not (len(free) and pf > CREDIBLE),
                "step_us": cost.get(name),
            }
        )
    return out


def equal_thresholds(rows, alpha=ALPHA):
    """Return {detector: (multiplier c of its threshold, crossings k, flights n, upper bound)} at one probability.

    c is the smallest at which at most floor(alpha n) of the n fault-free flights reach |r| >= c; None where it
    never judged in them.
    """
    out = {}
    for name, own in rows[rows["case"].isna()].groupby("id", sort=False):
        peak = own["r_fault_free"].dropna().to_numpy()
        allowed = math.floor(alpha * len(peak) + 1e-9)
        judged = len(peak) and peak.max() > 0.0
        at, bound = metrics.threshold(peak, alpha) if judged else (None, 1.0)
        out[name] = (at, allowed, len(peak), bound)
    return out


def maxima(rows):
    """Return {detector: (largest |r| of fault-free flights, of designed-for faults from the onset on)}, run by run."""
    out = {}
    for name, own in rows.groupby("id", sort=False):
        hit = own[(own["word"] == DESIGNED) & own["concerned"] & ~own["idle"]]["r_fault"].dropna().to_numpy()
        out[name] = own[own["case"].isna()]["r_fault_free"].dropna().to_numpy(), hit
    return out


def coverage_matrix(rows):
    """Return {case: {detector: {word, runs, detected, outcomes, idle}}} of the faulty flights."""
    out: dict = {}
    for (case, name), own in rows[rows["case"].notna()].groupby(["case", "id"], sort=False):
        cell = {
            "word": own["word"].iloc[0],
            "runs": len(own),
            "detected": int(own["detected"].sum()),
            "lane": bool(own["concerned"].any()),
            "outcomes": own["outcome"].value_counts().to_dict(),
            "delay_s": float(own["delay_s"].min()) if own["detected"].any() else None,
        }
        out.setdefault(case, {})[name] = cell
    return out


def confusion(rows, detector):
    """Return a frame: rows are kinds of fault that a lane of `detector` met, and "no fault"; columns what it said."""
    own = rows[(rows["id"] == detector) & (rows["concerned"] | rows["case"].isna())]
    truth = own["case"].fillna("no fault")
    said = own["class"].where(own["detected"], "none").fillna("none")
    said = said.where(own["case"].notna() | (own["false_alarms"] == 0), "false alarm")
    return pd.crosstab(truth, said)


def groups(rows):
    """Return {group: [detectors]}: what detectors draw on, known groups first."""
    level = dict(zip(rows["id"], rows["level"]))
    out: dict = {}
    for name in sorted(level, key=lambda n: (*SHIPPED, n).index(n)):
        out.setdefault(group(name, level[name]), []).append(name)
    return dict(sorted(out.items(), key=lambda item: (*GROUPS, item[0]).index(item[0])))


def by_group(rows, stats):
    """Return one row per faulty flight and group: whether a credible detector saw the fault.

    An alarm of a detector that is blind to the case by structure was caused by something else and does not count.
    Columns run, case, frequency_hz, amplitude_mm, target, group, able (some detector could see it), seen, named,
    delay_s, first (who noticed first).
    """
    credible = {d["id"] for d in stats if d["credible"]}
    member = {name: g for g, names in groups(rows).items() for name in names}
    found: dict = {g: {} for g in groups(rows)}
    for row in rows[rows["case"].notna()].to_dict("records"):
        found[member[row["id"]]].setdefault(row["run"], []).append(row)
    return pd.DataFrame(
        [_of_group(g, own, credible) for g, runs in found.items() for own in runs.values()], columns=GROUPED
    )


def _of_group(name, own, credible):
    """Return the row of one group in one flight; `own` are the rows of its detectors as dicts."""
    able = [r for r in own if r["id"] in credible and r["concerned"] and r["word"] != BLIND and not r["idle"]]
    seen = sorted((r for r in able if r["detected"]), key=lambda r: r["delay_s"])
    first = seen[0] if seen else {}
    return {
        **{k: own[0][k] for k in ("run", "case", "frequency_hz", "amplitude_mm", "target")},
        "group": name,
        "able": bool(able),
        "seen": bool(seen),
        "named": any(r["outcome"] == "named" for r in seen),
        "delay_s": first.get("delay_s", math.nan),
        "first": first.get("id"),
    }


def smallest(grouped, name):
    """Return {frequency [Hz]: smallest achieved amplitude [mm] from which on group `name` saw the others, or None}.

    All of them in a band with fewer than 20 flights, else SEEN of them. More than FREQUENCIES different frequencies are
    taken together in octaves around 0.5, 1, 2, ... Hz.
    """
    own = grouped[(grouped["group"] == name) & grouped["frequency_hz"].notna() & grouped["amplitude_mm"].notna()]
    hz = own["frequency_hz"].astype(float)
    if hz.nunique() > FREQUENCIES:
        hz = 2.0 ** np.round(np.log2(hz))
    out = {}
    for band, part in own.groupby(hz):
        part = part.sort_values("amplitude_mm", ascending=False)
        seen = part["seen"].to_numpy(bool)
        good = seen & (np.cumsum(seen) / np.arange(1, len(seen) + 1) >= SEEN)
        out[float(band)] = float(part["amplitude_mm"].to_numpy()[good][-1]) if good.any() else None
    return out
