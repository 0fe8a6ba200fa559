"""What a comparison says: pure functions of its rows (cosim/compare/rows.py). Intervals are exact, at 95 %."""

import math
from collections.abc import Iterator
from dataclasses import asdict

import numpy as np
import pandas as pd
from scipy.stats import binomtest

from cosim.compare import metrics
from cosim.compare.rows import FAMILIES
from cosim.judge.coverage import BLIND, DESIGNED, MAY, UNDECLARED, group
from cosim.judge.naming import AXIS, CHANNEL, LEVELS, RIGHT, WRONG
from fdi.common.record import GROUPS
from fdi.registry import SHIPPED

FREQUENCIES = 8
HELD = 0.95  # share of the time from the alarm to the fault's end in which an alarm that is held stands
CREDIBLE = 0.5  # a detector that alarms in more than half of the fault-free flights tells nothing by alarming
WORDS = ("named", "ambiguous", "misnamed", "not_valid", "masked", "not_excited", "missed")
TIMES = {"delay_s": "delay_s", "right_s": "time_to_right_s", "motion_s": "right_after_motion_s"}
FAULT = ["run", "fault"]
POINTS = 60  # of a fitted curve
DRAWS = 2000  # of the bootstrap
LEAST = 5  # flights, below which a pair is not tested
CURVES = [
    *("family", "of", "frequency_hz", "amplitude_mm", "pod", "low", "high", "flights", "seen", "a90", "a90_95", "note"),
]  # fmt: skip


def outcomes(rows: pd.DataFrame) -> pd.Series:
    """Return one word of WORDS per row of a fault that the detector was designed for: its outcome, not_excited where
    one that was missed never showed."""
    return rows["outcome"].mask((rows["outcome"] == "missed") & rows["not_excited"], "not_excited")


def score(rows: pd.DataFrame) -> dict:
    """Return what came of the faults `rows`: counts that add up to `designed`, and times [s]; a fault that was missed,
    or never named right, counts as an endless time. Flights in which the detector could not judge stay in.
    `first_fair`: the first name with a class was not wrong; `held`: the alarm stood HELD of the time or more;
    `changed_often`: more than one change of class; `motion_s`: right name, from when the rod had moved 1 mm."""
    n, seen, healed = len(rows), rows["detected"], rows["withdrawn"].notna()
    share = metrics.proportion(int(seen.sum()), n)
    why = rows.loc[rows["not_valid"], "why_not_valid"].mode()
    out = {
        "designed": n,
        "detected": int(seen.sum()),
        **outcomes(rows).value_counts().reindex(WORDS, fill_value=0).to_dict(),
        **dict(zip(("detection_probability", "detection_low", "detection_high"), share)),
        "why_not_valid": why.iloc[0] if len(why) else None,
        "first_fair": int((seen & ~rows["first_sure_wrong"]).sum()),
        "changed_often": int((rows["class_changes"] > 1).sum()),
        "held": int((rows["alarm_share"] >= HELD).sum()),
        "ambiguous_s": float(rows["ambiguous_s"].sum()),
        "withdrawn": int(rows.loc[healed, "withdrawn"].astype(bool).sum()),
        "healed": int(healed.sum()),
    }
    samples = {name: rows[column] for name, column in TIMES.items()}
    samples |= {"motion_s": samples["motion_s"][~rows["not_excited"]], "gone": rows["withdrawn_after_s"][healed]}
    nothing = dict.fromkeys(("median", "low", "high", "p95", "max"))
    late = {name: metrics.delays(s) if len(s) else nothing for name, s in samples.items()}
    out["withdrawn_after_s"] = late.pop("gone")["median"]
    return out | {f"{name}_{k}".removesuffix("_median"): v for name, d in late.items() for k, v in d.items()}


def designed_for(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of faults that a detector was designed for, on a part that it watches."""
    return rows[(rows["word"] == DESIGNED) & rows["concerned"]]


def names(rows: pd.DataFrame) -> dict:
    """Return how the faults `rows` that were detected were named, designed for or not: counts of class and place right
    and wrong, of places right by their finest level, and of names with either wrong."""
    seen = rows[rows["detected"] & rows["concerned"]]
    of = {f"{key}_{word}": seen[f"{key}_given"] == word for key in ("class", "place") for word in (RIGHT, WRONG)}
    return {
        "alarmed_on": len(seen),
        **{key: int(mask.sum()) for key, mask in of.items()},
        "place_levels": {n: int((seen["place_level"] == n).sum()) for n in LEVELS[1:]},
        "name_wrong": int((of["class_wrong"] | of["place_wrong"]).sum()),
    }


def detectors(rows: pd.DataFrame, timing: pd.DataFrame | None = None) -> list[dict]:
    """Return a dict per detector: `score` over what it was designed for, false alarms and standing alarms over all;
    `hours` are those in which a false alarm would count."""
    cost = {} if timing is None else timing[timing["id"].notna()].groupby("id")["step_us"].median().to_dict()
    out = []
    for name, own in rows.groupby("id", sort=False):
        free, designed = own[own["case"].isna()], designed_for(own)
        alarms, hours = int(own["false_alarms"].sum()), float(own["hours"].sum())
        alarmed = int((free["false_alarms"] > 0).sum())
        per_hour = metrics.rate(alarms, hours) if hours > 0.0 else metrics.UNKNOWN
        per_flight = metrics.proportion(alarmed, len(free))
        may = own[(own["word"] == MAY) & own["concerned"]]
        anyway = designed["alarms_anyway"].mean()
        out.append({
            "id": name, "level": own["level"].iloc[0], **score(designed), **names(own),
            "availability": float(own["valid_share"].mean()), "standing_s": float(own["standing_s"].sum()),
            "alarms_anyway": None if math.isnan(anyway) else anyway,
            "misnamed_all": int((own["outcome"] == "misnamed").sum()), "seen_of_may": int(may["detected"].sum()),
            "may": len(may), "unexpected": int((own["outcome"] == "bonus").sum()), "false_alarms": alarms,
            **dict(zip(("false_alarms_per_hour", "false_alarms_per_hour_low", "false_alarms_per_hour_high"), per_hour)),
            "hours": hours, "fault_free_runs": len(free), "fault_free_alarmed": alarmed,
            **dict(zip(("false_alarm_probability", "false_alarm_low", "false_alarm_high"), per_flight)),
            "credible": not (len(free) and per_flight.value > CREDIBLE), "step_us": cost.get(name),
        })  # fmt: skip
    return out


def families(rows: pd.DataFrame) -> list[dict]:
    """Return {id, family, **score} of every detector and kind of fault that it was designed for, kinds in order."""
    pairs = dict(iter(designed_for(rows).groupby(["family", "id"], sort=False)))
    order = [(f, name) for f in FAMILIES for name in rows["id"].unique() if (f, name) in pairs]
    return [{"id": name, "family": f, **score(pairs[f, name])} for f, name in order]


def operating_points(rows: pd.DataFrame) -> pd.DataFrame:
    """Return, of each detector with fault-free flights and faults that it was designed for, a row per threshold,
    falling from inf: detector, threshold, the shares of the fault-free flights and of the faults whose largest |r|
    reaches it, each with its exact interval, and how many there are."""
    out = []
    for name, own in rows.groupby("id", sort=False):
        hit = designed_for(own)
        samples = own["r_fault_free"][own["case"].isna()].dropna(), hit["r_fault"][~hit["not_valid"]].dropna()
        if not all(map(len, samples)):
            continue
        t = np.unique(np.concatenate([*samples, [1.0, np.inf]]))[::-1]
        about = {"detector": name, "threshold": t, "fault_free_flights": len(samples[0]), "faults": len(samples[1])}
        for key, sample in zip(("false_alarm", "detection"), samples):
            reach = len(sample) - np.searchsorted(np.sort(sample), t)
            about |= dict(zip((key, f"{key}_low", f"{key}_high"), metrics.proportion(reach, len(sample))))
        out.append(pd.DataFrame(about))
    return pd.concat(out, ignore_index=True) if out else pd.DataFrame(columns=["detector"])


def pair(rows: pd.DataFrame, a: str, b: str) -> list[dict]:
    """Return what the flights say of detectors `a` and `b`, over the faults that concern both and to which neither is
    blind: n flights, seen by one alone, McNemar's two-sided p, and the share of flights that a sees less that of b,
    with its 95 % interval; [] without such a fault. `rows` are those of cosim/compare/rows.py."""
    use = rows[rows["case"].notna() & rows["concerned"] & (rows["word"] != "blind")]
    seen = use.pivot(index=["run", "fault"], columns="id", values="detected").reindex(columns=[a, b]).dropna()
    more = seen[a].astype(float) - seen[b].astype(float)
    n, only_a, only_b = len(more), int((more > 0).sum()), int((more < 0).sum())
    about: dict = {"a": a, "b": b, "n": n, "only_a": only_a, "only_b": only_b, "p": None, "difference": None,
                   "low": None, "high": None}  # fmt: skip
    if n >= LEAST:
        low, high = bootstrap(more.to_numpy())
        p = float(binomtest(only_a, only_a + only_b).pvalue) if only_a + only_b else 1.0
        about |= {"p": p, "difference": (only_a - only_b) / n, "low": low, "high": high}
    return [about] if n else []


def bootstrap(difference: np.ndarray, confidence: float = 0.95) -> tuple[float, float]:
    """Return the percentile interval of the mean of `difference` (flights,), paired; the same draws every time."""
    drawn = np.random.default_rng(0).integers(0, len(difference), (DRAWS, len(difference)))
    low, high = np.quantile(difference[drawn].mean(axis=1), [(1 - confidence) / 2, (1 + confidence) / 2])
    return float(low), float(high)


def coverage_matrix(rows: pd.DataFrame) -> dict[tuple[str, str], dict]:
    """Return {(case, detector): {word, runs, detected, lane, outcomes}} of the faulty flights."""
    return {
        key: {"word": own["word"].iloc[0], "runs": len(own), "detected": int(own["detected"].sum()),
              "lane": bool(own["concerned"].any()), "outcomes": own["outcome"].value_counts().to_dict()}
        for key, own in rows[rows["case"].notna()].groupby(["case", "id"], sort=False)
    }  # fmt: skip


def confusion(rows: pd.DataFrame, detector: str) -> pd.DataFrame:
    """Return a frame: rows are kinds of fault that a lane of `detector` met, and "no fault"; columns what it said."""
    own = rows[(rows["id"] == detector) & (rows["concerned"] | rows["case"].isna())]
    said = own["isolated_class"].where(own["detected"], "none").fillna("none")
    said = said.where(own["case"].notna() | (own["false_alarms"] == 0), "false alarm")
    return pd.crosstab(own["case"].fillna("no fault"), said)


def groups(rows: pd.DataFrame) -> dict[str, list[str]]:
    """Return {group: [detectors]}: what detectors draw on, known groups and detectors first."""
    level = dict(zip(rows["id"], rows["level"]))
    known = [*SHIPPED, *(name.partition(" ")[0] for name in level)]  # also of "name (campaign)"
    out: dict = {name: [] for name in GROUPS}
    for name in sorted(level, key=lambda n: known.index(n.partition(" ")[0])):
        out.setdefault(group(name, level[name]), []).append(name)
    return {name: ids for name, ids in out.items() if ids}


def by_group(rows: pd.DataFrame, each: list[dict]) -> pd.DataFrame:
    """Return one row per fault and group of detectors: whether a credible one was `able` to see it, and has `seen` it.

    An alarm of a detector that is blind to the case by structure was caused by something else and does not count.
    """
    of = {name: g for g, names in groups(rows).items() for name in names}
    own = rows[rows["case"].notna()]
    able = _credible(own, each) & own["concerned"] & ~own["not_valid"] & _could(own)
    own = own.assign(group=own["id"].map(of), able=able, seen=able & own["detected"])
    found = own.groupby(["group", *FAULT], sort=False)
    about = found[["case", "family", "frequency_hz", "amplitude_mm"]].first()
    return about.join(found[["able", "seen"]].any()).reset_index()


def _credible(rows, each):
    return rows["id"].isin([d["id"] for d in each if d["credible"]])


def _could(rows):
    """Return whether a detector could see each case: what it does not declare, only where it did."""
    return (rows["word"] != BLIND) & ((rows["word"] != UNDECLARED) | rows["detected"])


def by_level(rows: pd.DataFrame, each: list[dict]) -> list[dict]:
    """Return {family, faults, local, aircraft, both, nobody, joint, right, coarse, open, wrong} of each kind of fault.

    How many faults credible detectors of the local level alone saw, of the aircraft's alone, of both, none; of
    detectors that read both levels how many one saw, gave the place of at the finest level that it names, at a coarser
    one, as a set or not at all, and wrongly.
    """
    own = rows[rows["case"].notna() & rows["concerned"] & _credible(rows, each)]
    keys = [own[key] for key in ("family", *FAULT)]
    sees = own["detected"] & _could(own)
    seen = pd.DataFrame({level: sees & (own["level"] == level) for level in ("local", "aircraft", "both")})
    seen = seen.groupby(keys).any()
    told = own["detected"] & (own["level"] == "both")
    seen["place"] = _place_words(own).where(told).groupby(keys).first().where(seen["both"])
    alone = [seen["local"] & seen["aircraft"], seen["local"], seen["aircraft"]]
    seen["who"] = np.select(alone, ["both", "local", "aircraft"], "nobody")

    def counts(words, *among):
        return words.value_counts().reindex(among, fill_value=0).to_dict()

    return [
        {"family": name, "faults": len(part), **counts(part["who"], "local", "aircraft", "both", "nobody"),
         "joint": int(part["both"].sum()), **counts(part["place"], "right", "coarse", "open", "wrong")}
        for name, part in sorted(seen.groupby("family"), key=lambda item: FAMILIES.index(item[0]))
    ]  # fmt: skip


def _place_words(rows):
    """Return "right", "coarse", "open" or "wrong" of the place that each last name gives."""
    # detectors that a joint one reads seldom tell which engine it is
    fine = (rows["place_level"] == CHANNEL) | ((rows["place_level"] == AXIS) & (rows["case"] == "engine"))
    given = rows["place_given"]
    words = np.select([given == WRONG, given != RIGHT, fine], ["wrong", "open", "right"], "coarse")
    return pd.Series(words, rows.index)


def bands(hz: pd.Series) -> pd.Series:
    """Return frequencies [Hz] as they are, those of more than FREQUENCIES as octaves around 0.5, 1, 2, ... Hz."""
    return hz if hz.nunique() <= FREQUENCIES else 2.0 ** np.round(np.log2(hz))


def fits(grouped: pd.DataFrame) -> Iterator[tuple[dict, pd.DataFrame, metrics.Pod]]:
    """Yield ({group, family, frequency_hz, not_valid}, flights in which it could judge, their Pod) of the oscillations
    by kind, group and frequency. Flights in which no detector of the group could judge are counted in `not_valid`."""
    own = grouped[grouped["frequency_hz"].notna() & (grouped["amplitude_mm"] > 0.0)]
    keys = [own["family"], own["group"], bands(own["frequency_hz"].astype(float))]
    for (family, group_, hz), part in own.groupby(keys, sort=True):
        could = part[part["able"]]
        about = {"group": group_, "family": family, "frequency_hz": float(hz), "not_valid": len(part) - len(could)}
        yield about, could, metrics.fit(could["amplitude_mm"], could["seen"])


def sizes(grouped: pd.DataFrame) -> list[dict]:
    """Return {group, family, frequency_hz, not_valid, **Pod} by kind, group and frequency [mm of rod]."""
    return [{**about, **asdict(fit)} for about, _, fit in fits(grouped)]


def curves(grouped: pd.DataFrame) -> pd.DataFrame:
    """Return the fitted curves as a frame: probability of detection `pod` over the achieved amplitude [mm of rod],
    `low` and `high` each with 95 % confidence. A cell without a curve has one row, whose `note` says why."""
    out: list[dict] = []
    for cell, could, f in fits(grouped):
        about = {"family": cell["family"], "of": cell["group"], "frequency_hz": cell["frequency_hz"], "flights": f.n,
                 "seen": f.seen, "a90": f.a90, "a90_95": f.a90_95, "note": f.note}  # fmt: skip
        at = np.geomspace(could["amplitude_mm"].min(), could["amplitude_mm"].max(), POINTS) if f.coefficients else ()
        points = zip(at, *f.at(at)) if f.coefficients else [()]
        out += [about | dict(zip(("amplitude_mm", "pod", "low", "high"), row)) for row in points]
    return pd.DataFrame(out, columns=CURVES)
