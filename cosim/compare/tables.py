"""Tables of a comparison, the same in terminal, page and README: one Column per figure."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import pandas as pd

from cosim.compare import metrics, stats
from cosim.judge import coverage
from cosim.judge.lanes import seconds
from cosim.judge.naming import LEVELS
from cosim.replay.recording import finite
from cosim.table import DASH, Cell, Column, Table, number, of, share


def _count(key: str, bad: bool = False) -> Callable:
    """Return what takes a count over faults; a dash for a detector without any."""
    return lambda d: DASH if not d["designed"] else Cell(d[key], "bad" if bad and d[key] else "")


def _time(key: str) -> Callable:
    """Return what takes a median time; where fewer than half have one there is none."""
    return lambda d: (seconds(d[key]) if finite(d.get(key)) else metrics.FEWER) if d["designed"] else DASH


def _interval(low: str, high: str, shown: Callable = number) -> Callable:
    return lambda d: DASH if d.get(high) is None else f"{shown(d[low])} to {shown(d[high])}"


def _free(d: dict) -> Cell | str:
    n, flights = d["fault_free_alarmed"], d["fault_free_runs"]
    return Cell(f"{n}/{flights}", "bad" if n else "") if flights else DASH


NAME = Column("detector", lambda d: Cell(d["id"], "code"), right=False)
GROUP = Column("draws on", lambda d: d.get("group") or stats.draws_on(d["id"], d["level"]), rank=5, right=False)
COUNTS = (
    Column("faults", _count("designed")),
    Column("seen", _count("detected")),
    Column("95 % bounds", lambda d: _interval("detection_low", "detection_high", share)(d) if d["designed"] else DASH,
           doc="exact, of the share seen", rank=6),
    Column("right name", _count("named"), doc="class and part, last; ambiguous is no name"),
    Column("ambiguous", _count("ambiguous"), rank=3),
    Column("wrong name", _count("misnamed", bad=True), rank=1),
    Column("not valid", lambda d: Cell(d["not_valid"], "", d.get("why_not_valid") or "") if d["designed"] else DASH,
           doc="missed, and could not judge", rank=4),
    Column("not excited", _count("not_excited"), doc="a jam or runaway that never moved the rod 1 mm from where it "
           "would be", rank=6),
    Column("missed", _count("missed"), rank=6),
    Column("first alarm", _time("delay_s"), "s", metrics.MEDIAN),
    Column("right name after", _time("right_s"), "s", "the same of the first right name"),
)  # fmt: skip
MOTION = Column("of motion", lambda d: seconds(d["motion_s"]), "s",
                "right name, from when a jammed or running rod is 1 mm from where it would be", 6)  # fmt: skip
RATE = (
    Column("false alarms", "false_alarms", doc="of all flights, healthy times and parts of faulty ones included",
           rank=3),
    Column("hours judged", lambda d: number(d["hours"]), "h", "in which an alarm would count: valid, and no fault "
           "there that concerns it; mean over its lanes", 3),
    # a rate is left out before its bound: 0 of a few hours says little
    Column("false alarm rate", lambda d: number(d["false_alarms_per_hour"]), "1/h", "per hour judged", 3),
    Column("upper bound", lambda d: number(d["false_alarms_per_hour_high"]), "1/h", "of false alarms per hour judged, "
           "exact, 95 %"),
)  # fmt: skip
FREE = Column("fault-free flights with an alarm", _free, rank=2)
VALID = Column("valid", lambda d: share(d["availability"]), doc="share of all flights, from 8 s on", rank=4)
STANDING = Column("standing alarm", lambda d: number(d["standing_s"]), "s", "alarm without a fault, from 2 s after it "
                  "has healed", 6)  # fmt: skip
STEP = Column("step", lambda d: number(d.get("step_us"), 2), "µs", "time per step and lane", 5)
ANYWAY = Column("without the fault", lambda d: DASH if d["alarms_anyway"] is None else share(d["alarms_anyway"]),
                doc="of such flights without a fault alarm, too")  # fmt: skip
OF = "Over the faults that it was designed for, on parts that it watches."
FRONT = ("faults", "seen", "right name", "wrong name", "first alarm")


def detectors(each: Iterable[dict]) -> Table:
    """Return the Table of all detectors, over what each was designed for."""
    known = {column.name: column for column in COUNTS}
    columns = (NAME, *(known[name] for name in FRONT), ANYWAY, RATE[-1])
    return of(columns, each, lambda d: "" if d["detected"] else "muted", caption=OF)


def quiet(each: Iterable[dict]) -> Table:
    """Return the Table of what each detector does without a fault, and what it costs."""
    columns = (
        NAME, Column(VALID.name, VALID.get, doc=VALID.doc),
        FREE, Column("at most", lambda d: share(d["false_alarm_high"]) if d["fault_free_runs"] else DASH,
                     doc="of all such flights, 95 %"),
        *RATE[:-1], Column("95 % bounds", _interval("false_alarms_per_hour_low", "false_alarms_per_hour_high")),
        STANDING, STEP,
    )  # fmt: skip
    return of(columns, each)


def _right_at(level, d):
    return str(d["place_levels"][level])


FINEST = "the finest level at which the place is right, as in the next columns"


def names(each: Iterable[dict]) -> Table:
    """Return the Table of the names given to every fault that a detector alarmed on, designed for or not."""
    columns = (
        NAME, GROUP, Column("alarmed on", "alarmed_on", doc="faults, designed for or not"),
        Column("class right", "class_right"), Column("class wrong", "class_wrong", doc="ambiguous is neither", rank=1),
        *(Column(f"right {level}", partial(_right_at, level), doc="" if i else FINEST)
          for i, level in enumerate(LEVELS[1:])),
        Column("place wrong", "place_wrong", rank=1), Column("wrong name", "name_wrong", doc="class or place"),
    )  # fmt: skip
    return of(columns, each)


def after(each: Iterable[dict]) -> Table:
    """Return the Table of what becomes of alarms: names that change, alarms that fall early or never."""
    healed = lambda key: lambda d: d[key] if d["healed"] else DASH  # noqa: E731
    columns = (
        NAME, Column("seen", "detected"),
        Column("first name not wrong", "first_fair"), Column("changed often", "changed_often",
                                                                      doc="more than one change of class"),
        Column("ambiguous", lambda d: number(d["ambiguous_s"]), "s"),
        Column("held", "held", doc=f"the alarm stands {stats.HELD:.0%} of the time from its rise to the fault's end"),
        Column("healed", healed("healed"), doc="the fault ended while the alarm could be watched"),
        Column("withdrawn", healed("withdrawn"), doc="then the alarm ended, too"),
        Column("after", lambda d: seconds(d["withdrawn_after_s"]) if d["healed"] else DASH, "s", "median, counted to "
               "the last alarm"),
    )  # fmt: skip
    return of(columns, [d for d in each if d["detected"]], caption="Of the faults that it was designed for and saw.")


def families(found: Iterable[dict], kind: str = "kind of fault") -> Table:
    """Return the Table of detectors by kind of fault, a line for each pair that has a fault."""
    last: list = [None]

    def head(d):
        new, last[0] = d["family"] != last[0], d["family"]
        return Cell(d["family"], "bold") if new else ""

    return of((Column(kind, head, right=False), NAME, *COUNTS, MOTION), found, keys=2, caption="Columns as above.")


def fit(d: dict | None, best: float | None = None) -> Any:
    """Return a fitted size with its bounds, or what the flights say where no curve can be fitted."""
    if d is None or not (d.get("n") or d.get("designed") or d.get("not_valid")):
        return "blind" if d and d.get("blind") else DASH
    told = f"; {d['not_valid']} not valid" if d.get("not_valid") and "n" in d else ""
    seen, flights = d.get("seen", d.get("detected")), d.get("n", d.get("designed"))
    if d["a90"] is None:
        return f"{d['note']} ({seen}/{flights}{told})" if flights else f"not valid ({d['not_valid']})"
    ends = ["?" if d[k] is None else number(d[k], 2) for k in ("low", "a90_95")]
    said = f"{number(d['a90'], 2)} ({ends[0]} to {ends[1]}){told}"
    return Cell(said, "bold") if best is not None and d["a90_95"] == best else said


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
        own = [d for d in found if d["family"] == family]
        hz = sorted({d["frequency_hz"] for d in own})
        made = Table("", "draws on", *(Column(f"{f:g} Hz", rank=1 + i % 4) for i, f in enumerate(hz)), kind="fits")
        cells = {(d["group"], d["frequency_hz"]): d for d in own}
        for group in dict.fromkeys(d["group"] for d in own):
            made.add(group, *(fit(cells.get((group, f))) for f in hz))
        out[family] = made
    return out


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
    runs: dict = {}
    for r in rows.to_dict("records"):
        runs.setdefault(r["run"], []).append(r)
    for own in runs.values():
        r, fault = own[0], isinstance(own[0]["case"], str)
        seen = sorted((x for x in own if x["detected"]), key=lambda x: x["delay_s"])
        peak = f"{number(r['rod_mm'])} mm peak" if finite(r["rod_mm"]) else DASH
        size = f"{number(r['amplitude_mm'])} mm" if finite(r["amplitude_mm"]) else peak
        made.add(
            Cell(r["run"], "code"), coverage.label(r["case"]) if fault else "no fault", r["target"] if fault else DASH,
            number(r["frequency_hz"]), size, f"{r['manoeuvre'].replace('_', ' ')}, {r['turbulence']}",
            ", ".join(f"{x['id']} {seconds(x['delay_s'])}" for x in seen) or DASH,
        )  # fmt: skip
    return made


def by_level(found: Iterable[dict]) -> Table:
    """Return the Table *fault by level* of `cosim.compare.stats.by_level`."""
    found = list(found)
    columns = [
        Column("kind of fault", lambda d: Cell(d["family"], "bold"), right=False),
        Column("faults"),
        Column("local only", "local", doc="only detectors of one actuator alarmed"),
        Column("aircraft only", "aircraft", doc="only detectors of the whole aircraft alarmed"),
        Column("both"),
        Column("nobody"),
    ]
    joint = (
        Column("joint", doc="the joint verdict alarmed"),
        Column("its place right", "right", doc="valve, command, surface or sensor of the segment, sensor, engine"),
        Column("coarser", "coarse", doc="right by segment, side or axis"),
        Column("not given", "open", doc="a set that holds it, or no place"),
        Column("wrong", lambda d: Cell(d["wrong"], "bad" if d["wrong"] else "muted")),
    )  # fmt: skip
    return of([*columns, *(joint if any(d["joint"] for d in found) else ())], found)


def predictive(found: Iterable[dict]) -> Table:
    """Return the Table of predictive values, from `cosim.compare.Comparison.predictive`."""
    columns = (
        NAME, Column("fault rate", lambda d: number(d["fault_rate"]), "per flight h"),
        Column("of its alarms true", lambda d: share(d["value"]), doc="behind so many alarms there is a fault"),
        Column("at least", lambda d: share(d["low"]), doc="95 %"), Column("at most", lambda d: share(d["high"])),
    )  # fmt: skip
    return of(columns, found, keys=2, title="What an alarm is worth", caption="Faults in the mix of kinds and sizes of "
              "these flights, those it was designed for; a first alarm of each fault, every false one.")  # fmt: skip
