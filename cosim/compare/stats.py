"""What a comparison says: pure functions of its rows (cosim/compare/rows.py). Intervals are exact, at 95 %."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict

import numpy as np
import pandas as pd

from cosim.compare import metrics, pod
from cosim.compare.rows import FAMILIES
from cosim.judge.coverage import BLIND, DESIGNED, MAY, UNDECLARED, group
from cosim.judge.naming import AXIS, CHANNEL, LEVELS, RIGHT, WRONG
from fdi.common.record import GROUPS
from fdi.registry import SHIPPED, find

FREQUENCIES = 8
HELD = 0.95  # share of the time from the alarm to the fault's end in which an alarm that is held stands
GROUPED = (
    "run", "case", "frequency_hz", "amplitude_mm", "target", "family", "group", "able", "seen", "named",
    "delay_s", "first",
)  # fmt: skip
PER_HOUR = ("false_alarms_per_hour", "false_alarms_per_hour_low", "false_alarms_per_hour_high")
PER_FLIGHT = ("false_alarm_probability", "false_alarm_low", "false_alarm_high")
FEW = 3  # inputs that are named one by one
CREDIBLE = 0.5  # a detector that cries in more than half of the fault-free flights tells nothing by alarming


def outcomes(rows: pd.DataFrame) -> pd.Series:
    """Return one word per row of a fault: named, ambiguous or misnamed when it was seen, else not_valid (it could not
    judge), masked (by the alarm of an earlier fault), not_excited (it never showed) or missed. Every row has one: they
    add up to the flights."""
    unseen = np.select([rows[word] for word in UNSEEN], UNSEEN, "missed")
    return rows["outcome"].where(rows["detected"], unseen)


UNSEEN = ("not_valid", "masked", "not_excited")
WORDS = ("named", "ambiguous", "misnamed", *UNSEEN, "missed")


def score(rows: pd.DataFrame) -> dict:
    """Return what came of the faults `rows`: counts that add up to `designed`, and times [s]; a fault that was missed,
    or never named right, counts as an endless time. Flights in which the detector could not judge stay in.
    `first_fair`: the first name with a class was not wrong; `held`: the alarm stood HELD of the time or more;
    `changed_often`: more than one change of class; `motion_s`: right name, from when the rod had moved 1 mm."""
    came, n = outcomes(rows), len(rows)
    seen = int(rows["detected"].sum())
    p, low, high = metrics.proportion(seen, n)
    why = rows.loc[rows["not_valid"], "why_not_valid"].dropna()
    out = {
        "designed": n,
        "detected": seen,
        **{word: int((came == word).sum()) for word in WORDS},
        "detection_probability": p,
        "detection_low": low,
        "detection_high": high,
        "why_not_valid": why.mode().iloc[0] if len(why) else None,
        "first_fair": int((rows["detected"] & ~rows["first_sure_wrong"]).sum()),
        "changed_often": int((rows["class_changes"] > 1).sum()),
        "held": int((rows["alarm_share"] >= HELD).sum()),
        "ambiguous_s": float(rows["ambiguous_s"].sum()),
        "withdrawn": int((rows["withdrawn"] == True).sum()),  # noqa: E712
        "healed": int(rows["withdrawn"].notna().sum()),
    }
    excited = rows[~rows["not_excited"]]
    for name, late in (("delay_s", rows["delay_s"]), ("right_s", rows["time_to_right_s"]),
                       ("motion_s", excited["right_after_motion_s"])):  # fmt: skip
        late = metrics.delays(late.to_numpy(float)) if len(late) else None
        for word, field in (("", "median"), ("_low", "median_low"), ("_high", "median_high"), ("_p95", "p95"),
                            ("_max", "largest")):  # fmt: skip
            out[name + word] = late and getattr(late, field)
    gone = rows.loc[rows["withdrawn"].notna(), "withdrawn_after_s"]
    out["withdrawn_after_s"] = metrics.delays(gone.to_numpy()).median if len(gone) else None
    return out


def designed_for(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of faults that a detector was designed for, on a part that it watches."""
    return rows[(rows["word"] == DESIGNED) & rows["concerned"]]


def names(rows: pd.DataFrame) -> dict:
    """Return how the faults `rows` that were detected were named, designed for or not: counts of class and place right
    and wrong, of places right by their finest level, and of names with either wrong."""
    seen = rows[rows["detected"] & rows["concerned"]]
    wrong = (seen["class_given"] == WRONG) | (seen["place_given"] == WRONG)
    return {
        "alarmed_on": len(seen),
        "class_right": int((seen["class_given"] == RIGHT).sum()),
        "class_wrong": int((seen["class_given"] == WRONG).sum()),
        "place_right": int((seen["place_given"] == RIGHT).sum()),
        "place_wrong": int((seen["place_given"] == WRONG).sum()),
        "place_levels": {n: int((seen["place_level"] == n).sum()) for n in LEVELS[1:]},
        "name_wrong": int(wrong.sum()),
    }


def detectors(rows: pd.DataFrame, timing: pd.DataFrame | None = None) -> list[dict]:
    """Return a dict per detector: `score` over what it was designed for, false alarms and standing alarms over all;
    `hours` are those in which a false alarm would count."""
    cost = {} if timing is None else timing[timing["id"].notna()].groupby("id")["step_us"].median().to_dict()
    out = []
    for name, own in rows.groupby("id", sort=False):
        free = own[own["case"].isna()]
        alarmed = int((free["false_alarms"] > 0).sum())
        alarms, hours = int(own["false_alarms"].sum()), float(own["hours"].sum())
        per_hour = metrics.rate(alarms, hours) if hours > 0.0 else metrics.UNKNOWN
        per_flight = metrics.proportion(alarmed, len(free))
        may = own[(own["word"] == MAY) & own["concerned"]]
        anyway = float(designed_for(own)["alarms_anyway"].mean())
        told = {
            "availability": float(own["valid_share"].mean()), "standing_s": float(own["standing_s"].sum()),
            "alarms_anyway": None if math.isnan(anyway) else anyway,
            "misnamed_all": int((own["outcome"] == "misnamed").sum()), "seen_of_may": int(may["detected"].sum()),
            "may": len(may), "unexpected": int((own["outcome"] == "bonus").sum()), "false_alarms": alarms,
            **dict(zip(PER_HOUR, per_hour)), "hours": hours, "fault_free_runs": len(free),
            "fault_free_alarmed": alarmed, **dict(zip(PER_FLIGHT, per_flight)),
            "credible": not (len(free) and per_flight.value > CREDIBLE), "step_us": cost.get(name),
        }  # fmt: skip
        out.append({"id": name, "level": own["level"].iloc[0], **score(designed_for(own)), **names(own), **told})
    return out


def families(rows: pd.DataFrame) -> list[dict]:
    """Return {id, family, **score} of every detector and kind of fault that it was designed for, kinds in order."""
    own = designed_for(rows)
    pairs = {pair: part for pair, part in own.groupby(["family", "id"], sort=False)}
    order = [(f, name) for f in FAMILIES for name in dict.fromkeys(rows["id"]) if (f, name) in pairs]
    return [{"id": name, "family": f, **score(pairs[f, name])} for f, name in order]


def maxima(rows: pd.DataFrame) -> dict[str, tuple]:
    """Return {detector: (largest |r| of fault-free flights, of designed-for faults from the onset on)}, run by run."""
    out = {}
    for name, own in rows.groupby("id", sort=False):
        hit = own[(own["word"] == DESIGNED) & own["concerned"] & ~own["not_valid"]]["r_fault"].dropna().to_numpy()
        out[name] = own[own["case"].isna()]["r_fault_free"].dropna().to_numpy(), hit
    return out


def coverage_matrix(rows: pd.DataFrame) -> dict[str, dict]:
    """Return {case: {detector: {word, runs, detected, lane, outcomes}}} of the faulty flights."""
    out: dict = {}
    for (case, name), own in rows[rows["case"].notna()].groupby(["case", "id"], sort=False):
        counts = {"runs": len(own), "detected": int(own["detected"].sum()), "lane": bool(own["concerned"].any())}
        told = {"word": own["word"].iloc[0], "outcomes": own["outcome"].value_counts().to_dict()}
        out.setdefault(case, {})[name] = counts | told
    return out


def confusion(rows: pd.DataFrame, detector: str) -> pd.DataFrame:
    """Return a frame: rows are kinds of fault that a lane of `detector` met, and "no fault"; columns what it said."""
    own = rows[(rows["id"] == detector) & (rows["concerned"] | rows["case"].isna())]
    truth = own["case"].fillna("no fault")
    said = own["isolated_class"].where(own["detected"], "none").fillna("none")
    said = said.where(own["case"].notna() | (own["false_alarms"] == 0), "false alarm")
    return pd.crosstab(truth, said)


def draws_on(name: str, level: str) -> str:
    """Return what a detector draws on, in words: of one whose record names no group its inputs, or how many."""
    own = getattr(find(name.partition(" ")[0]), "inputs", None)  # also of "name (campaign)"
    if not own or group(name, level) != f"{level} level":
        return group(name, level)
    inputs = sorted(set(own.values()))
    return ", ".join(inputs) if len(inputs) <= FEW else f"{len(inputs)} signals, {level}"


def groups(rows: pd.DataFrame) -> dict[str, list[str]]:
    """Return {group: [detectors]}: what detectors draw on, known groups first."""
    level = dict(zip(rows["id"], rows["level"]))
    out: dict = {}
    for name in sorted(level, key=lambda n: (*SHIPPED, n.partition(" ")[0]).index(n.partition(" ")[0])):
        out.setdefault(draws_on(name, level[name]), []).append(name)
    return dict(sorted(out.items(), key=lambda item: (*GROUPS, item[0]).index(item[0])))


def by_group(rows: pd.DataFrame, stats: list[dict]) -> pd.DataFrame:
    """Return one row per faulty flight and group: whether a credible detector saw the fault.

    An alarm of a detector that is blind to the case by structure was caused by something else and does not count.
    Columns as GROUPED: able (some detector could see it), first (who noticed first).
    """
    members, credible = groups(rows), [d["id"] for d in stats if d["credible"]]
    of = {name: g for g, names in members.items() for name in names}
    own = rows[rows["case"].notna()]
    own = own.assign(group=pd.Categorical(own["id"].map(of), list(members)))
    own["able"] = own["id"].isin(credible) & own["concerned"] & ~own["not_valid"] & _could(own)
    own["seen"] = own["able"] & own["detected"]
    own["named"] = own["seen"] & (own["outcome"] == "named")
    keys = ["group", "run", "fault"]
    first = own[own["seen"]].sort_values("delay_s", kind="stable").drop_duplicates(keys).set_index(keys)
    first = first[["delay_s", "id"]].rename(columns={"id": "first"})
    found = own.groupby(keys, sort=False, observed=True)
    about = found[["case", "frequency_hz", "amplitude_mm", "target", "family"]].first()
    out = about.join(found[["able", "seen", "named"]].any()).join(first).reset_index()
    return out.sort_values("group", kind="stable", ignore_index=True)[list(GROUPED)].astype({"group": str})


def _could(rows):
    """Return whether a detector could see each case: what it does not declare, only where it did."""
    return (rows["word"] != BLIND) & ((rows["word"] != UNDECLARED) | rows["detected"])


def by_level(rows: pd.DataFrame, stats: list[dict]) -> list[dict]:
    """Return {family, faults, local, aircraft, both, nobody, joint, right, coarse, open, wrong} of each kind of fault.

    How many faults credible detectors of the local level alone saw, of the aircraft's alone, of both, none; of
    detectors that read both levels how many one saw, gave the place of at the finest level that it names, at a coarser
    one, as a set or not at all, and wrongly.
    """
    own = rows[rows["case"].notna() & rows["concerned"] & rows["id"].isin([d["id"] for d in stats if d["credible"]])]
    sees = own["detected"] & _could(own)
    keys = ["family", "run", "fault"]
    found = pd.DataFrame({level: sees.where(own["level"] == level, False) for level in ("local", "aircraft", "both")})
    found = found.groupby([own[key] for key in keys]).any().rename(columns={"both": "joint"})
    joint = own[(own["level"] == "both") & own["detected"]].drop_duplicates(keys).set_index(keys)
    found["place"] = pd.Series({at: place_word(row) for at, row in joint.iterrows()}, dtype=object)
    found["place"] = found["place"].where(found["joint"])
    local, aircraft = found["local"], found["aircraft"]
    found["level"] = np.select([local & aircraft, local, aircraft], ["both", "local", "aircraft"], "nobody")
    out = []
    for name in (f for f in FAMILIES if (own["family"] == f).any()):
        part = found.loc[name]
        counts = {word: int((part["level"] == word).sum()) for word in ("local", "aircraft", "both", "nobody")}
        places = {word: int((part["place"] == word).sum()) for word in ("right", "coarse", "open", "wrong")}
        out.append({"family": name, "faults": len(part), **counts, "joint": int(part["joint"].sum()), **places})
    return out


def place_word(row: Mapping) -> str:
    """Return "right", "coarse", "open" or "wrong" of the place that a row's last name gives (`by_level`)."""
    if row["place_given"] != RIGHT:
        return "wrong" if row["place_given"] == WRONG else "open"
    # detectors that a joint one reads seldom tell which engine it is
    fine = row["place_level"] == CHANNEL or (row["place_level"] == AXIS and row["case"] == "engine")
    return "right" if fine else "coarse"


def bands(hz: pd.Series) -> pd.Series:
    """Return frequencies [Hz] as they are, those of more than FREQUENCIES as octaves around 0.5, 1, 2, ... Hz."""
    return hz if hz.nunique() <= FREQUENCIES else 2.0 ** np.round(np.log2(hz))


def cells(rows: pd.DataFrame) -> Iterator[tuple]:
    """Yield ((family, group, frequency [Hz]), rows) of the oscillations in `rows`; more than FREQUENCIES frequencies
    are taken together in octaves around 0.5, 1, 2, ... Hz."""
    own = rows[rows["frequency_hz"].notna() & (rows["amplitude_mm"] > 0.0)]
    yield from own.groupby([own["family"], own["group"], bands(own["frequency_hz"].astype(float))], sort=True)


def sizes(grouped: pd.DataFrame) -> list[dict]:
    """Return {group, family, frequency_hz, not_valid, **Pod} by group, kind and frequency [mm of rod].

    Flights in which no detector of the group could judge are counted in `not_valid` and not in the fit.
    """
    out = []
    for (family, group_, band), part in cells(grouped):
        could = part[part["able"]]
        about = {"group": group_, "family": family, "frequency_hz": float(band), "not_valid": len(part) - len(could)}
        out.append({**about, **asdict(pod.fit(could["amplitude_mm"], could["seen"]))})
    return out
