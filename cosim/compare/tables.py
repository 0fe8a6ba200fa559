"""Tables of a comparison, the same in terminal and page: one Column per figure."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import pandas as pd

from cosim.compare import metrics, stats
from cosim.judge import coverage
from cosim.judge.lanes import seconds
from cosim.replay.recording import finite
from cosim.table import DASH, Cell, Column, Table, number, of, share


def _only(key: str, shown: Callable[[dict], Any]) -> Callable:
    """Return what takes a cell; a dash for a detector without any of `key`."""
    return lambda d: shown(d) if d[key] else DASH


def _count(key: str, bad: bool = False) -> Callable:
    return _only("designed", lambda d: Cell(d[key], "bad" if bad and d[key] else ""))


def _time(key: str) -> Callable:
    """Return what takes a median time; where fewer than half have one there is none."""
    return _only("designed", lambda d: seconds(d[key]) if finite(d.get(key)) else metrics.FEWER)


def _interval(key: str, shown: Callable = number) -> Callable:
    return lambda d: f"{shown(d[f'{key}_low'])} to {shown(d[f'{key}_high'])}"


NAME = Column("detector", lambda d: Cell(d["id"], "code"), right=False)
COUNTS = (
    Column("faults", _count("designed")),
    Column("seen", _count("detected")),
    Column("95 % bounds", _only("designed", _interval("detection", share)), doc="exact, of the share seen", rank=6),
    Column("right name", _count("named"), doc="class and part, last; ambiguous is no name"),
    Column("ambiguous", _count("ambiguous"), rank=3),
    Column("wrong name", _count("misnamed", bad=True), rank=1),
    Column("not valid", _only("designed", lambda d: Cell(d["not_valid"], "", d.get("why_not_valid") or "")),
           doc="missed, and could not judge", rank=4),
    Column("not excited", _count("not_excited"), doc="a jam or runaway that never moved the rod 1 mm from where it "
           "would be", rank=6),
    Column("missed", _count("missed"), rank=6),
    Column("first alarm", _time("delay_s"), "s", metrics.MEDIAN),
    Column("right name after", _time("right_s"), "s", "the same of the first right name"),
    Column("of motion", lambda d: seconds(d["motion_s"]), "s",
           "right name, from when a jammed or running rod is 1 mm from where it would be", 6),
)  # fmt: skip
FRONT = ("faults", "seen", "right name", "wrong name", "first alarm")
LAST = (
    Column("without the fault", lambda d: DASH if d["alarms_anyway"] is None else share(d["alarms_anyway"]),
           doc="of such flights without a fault alarm, too"),
    # a rate is left out: 0 of a few hours says little
    Column("upper bound", lambda d: number(d["false_alarms_per_hour_high"]), "1/h", "of false alarms per hour judged, "
           "exact, 95 %"),
)  # fmt: skip
QUIET = (
    Column("valid", lambda d: share(d["availability"]), doc="share of all flights, from 8 s on"),
    Column("fault-free flights with an alarm", _only("fault_free_runs", lambda d: Cell(
        f"{d['fault_free_alarmed']}/{d['fault_free_runs']}", "bad" if d["fault_free_alarmed"] else "")), rank=2),
    Column("at most", _only("fault_free_runs", lambda d: share(d["false_alarm_high"])),
           doc="of all such flights, 95 %"),
    Column("false alarms", doc="of all flights, healthy times and parts of faulty ones included", rank=3,
           get="false_alarms"),
    Column("hours judged", lambda d: number(d["hours"]), "h", "in which an alarm would count: valid, and no fault "
           "there that concerns it; mean over its lanes", 3),
    Column("false alarm rate", lambda d: number(d["false_alarms_per_hour"]), "1/h", "per hour judged", 3),
    Column("95 % bounds", _interval("false_alarms_per_hour")),
    Column("standing alarm", lambda d: number(d["standing_s"]), "s", "alarm without a fault, from 2 s after it has "
           "healed", 6),
    Column("step", lambda d: number(d.get("step_us"), 2), "µs", "time per step and lane", 5),
)  # fmt: skip
AFTER = (
    Column("seen", "detected"),
    Column("first name not wrong", "first_fair"),
    Column("changed often", "changed_often", doc="more than one change of class"),
    Column("ambiguous", lambda d: number(d["ambiguous_s"]), "s"),
    Column("held", doc=f"the alarm stands {stats.HELD:.0%} of the time from its rise to the fault's end"),
    Column("healed", _only("healed", lambda d: d["healed"]), doc="the fault ended while the alarm could be watched"),
    Column("withdrawn", _only("healed", lambda d: d["withdrawn"]), doc="then the alarm ended, too"),
    Column("after", _only("healed", lambda d: seconds(d["withdrawn_after_s"])), "s", "median, counted to the last "
           "alarm"),
)  # fmt: skip


def detectors(each: Iterable[dict]) -> Table:
    """Return the Table of all detectors, over what each was designed for."""
    columns = (NAME, *(column for column in COUNTS if column.name in FRONT), *LAST)
    said = "Over the faults that it was designed for, on parts that it watches."
    return of(columns, each, lambda d: "" if d["detected"] else "muted", caption=said)


def quiet(each: Iterable[dict]) -> Table:
    """Return the Table of what each detector does without a fault, and what it costs."""
    return of((NAME, *QUIET), each)


def after(each: Iterable[dict]) -> Table:
    """Return the Table of what becomes of alarms: names that change, alarms that fall early or never."""
    seen = [d for d in each if d["detected"]]
    return of((NAME, *AFTER), seen, caption="Of the faults that it was designed for and saw.")


def families(found: Sequence[dict]) -> Table:
    """Return the Table of detectors by kind of fault, a line for each pair that has a fault."""
    heads = [d["family"] for d in found]
    shown = [{**d, "head": Cell(d["family"] * (d["family"] != last), "bold")} for d, last in zip(found, ["", *heads])]
    kind = Column("kind of fault", "head", right=False)
    return of((kind, NAME, *COUNTS), shown, keys=2, caption="Columns as above.")


SIZES = (
    "Achieved amplitude, mm of rod, at which 90 % are seen (binomial regression on its logarithm), in brackets "
    "its lower bound and a90/95, with which one is on the safe side at 95 %; ?: outside the sizes flown. Where no "
    "curve can be fitted, what the flights say. Not valid: flights in which no detector of the group could judge, "
    "not in the fit."
)


def sizes(found: Sequence[dict]) -> dict[str, Table]:
    """Return {kind of oscillation: Table of a90/95}, from stats.sizes: groups by line, frequencies by column."""
    out = {}
    for family in dict.fromkeys(d["family"] for d in found):
        own = {(d["group"], d["frequency_hz"]): d for d in found if d["family"] == family}
        hz = sorted({f for _, f in own})
        made = Table("", "draws on", *(Column(f"{f:g} Hz", rank=1 + i % 4) for i, f in enumerate(hz)), kind="fits")
        for group in dict.fromkeys(group for group, _ in own):
            made.add(group, *(_size(own.get((group, f))) for f in hz))
        out[family] = made
    return out


def _size(d):
    """Return a fitted size with its bounds, or what the flights say where no curve can be fitted."""
    if d is None or not d["n"]:
        return DASH if d is None or not d["not_valid"] else f"not valid ({d['not_valid']})"
    told = f"; {d['not_valid']} not valid" if d["not_valid"] else ""
    if d["a90"] is None:
        return f"{d['note']} ({d['seen']}/{d['n']}{told})"
    ends = ["?" if d[k] is None else number(d[k], 2) for k in ("low", "a90_95")]
    return f"{number(d['a90'], 2)} ({ends[0]} to {ends[1]}){told}"


def pairs(found: Iterable[dict]) -> Table:
    """Return the Table of detectors compared on the same flights."""

    def more(p):
        return DASH if p["difference"] is None else f"{p['difference']:+.2f} ({p['low']:+.2f} to {p['high']:+.2f})"

    columns = (
        Column("a", right=False), Column("b", right=False), Column("flights", "n"), Column("only a", "only_a"),
        Column("only b", "only_b"),
        Column("p", lambda p: number(p["p"]), doc="exact test of McNemar on the flights that only one of them saw"),
        Column("a sees more", more, doc="mean, 95 % by bootstrap over flights"),
    )  # fmt: skip
    return of(columns, found, keys=2, caption="Faults on parts that both watch, neither blind.")


def flights(rows: pd.DataFrame) -> Table:
    """Return the Table of all flights, and who noticed."""
    made = Table("", "run", "case", "target", "frequency, Hz>", "achieved>", "manoeuvre, air", "noticed by, after s",
                 kind="")  # fmt: skip
    for run, own in rows.groupby("run", sort=False):
        r, seen = own.iloc[0], own[own["detected"]].sort_values("delay_s", kind="stable")
        case, target = (coverage.label(r["case"]), r["target"]) if isinstance(r["case"], str) else ("no fault", DASH)
        peak = f"{number(r['rod_mm'])} mm peak" if finite(r["rod_mm"]) else DASH
        size = f"{number(r['amplitude_mm'])} mm" if finite(r["amplitude_mm"]) else peak
        noticed = ", ".join(f"{name} {seconds(s)}" for name, s in zip(seen["id"], seen["delay_s"])) or DASH
        air = f"{r['manoeuvre'].replace('_', ' ')}, {r['turbulence']}"
        made.add(Cell(run, "code"), case, target, number(r["frequency_hz"]), size, air, noticed)
    return made


def by_level(found: Sequence[dict]) -> Table:
    """Return the Table *fault by level* of `cosim.compare.stats.by_level`."""
    columns = (
        Column("kind of fault", lambda d: Cell(d["family"], "bold"), right=False),
        Column("faults"),
        Column("local only", "local", doc="only detectors of one actuator alarmed"),
        Column("aircraft only", "aircraft", doc="only detectors of the whole aircraft alarmed"),
        Column("both"),
        Column("nobody"),
    )
    joint = (
        Column("joint", doc="the joint verdict alarmed"),
        Column("its place right", "right", doc="valve, command, surface or sensor of the segment, sensor, engine"),
        Column("wrong", lambda d: Cell(d["wrong"], "bad" if d["wrong"] else "muted")),
        Column("coarser", "coarse", doc="right by segment, side or axis"),
        Column("not given", "open", doc="a set that holds it, or no place"),
    )
    return of((*columns, *joint) if any(d["joint"] for d in found) else columns, found)


def predictive(found: Iterable[dict]) -> Table:
    """Return the Table of predictive values, from `cosim.compare.Comparison.predictive`."""
    columns = (
        NAME, Column("fault rate", lambda d: number(d["fault_rate"]), "per flight h"),
        Column("of its alarms true", lambda d: share(d["value"]), doc="behind so many alarms there is a fault"),
        Column("at least", lambda d: share(d["low"]), doc="95 %"), Column("at most", lambda d: share(d["high"])),
    )  # fmt: skip
    return of(columns, found, keys=2, title="What an alarm is worth", caption="Faults in the mix of kinds and sizes of "
              "these flights, those it was designed for; a first alarm of each fault, every false one.")  # fmt: skip
