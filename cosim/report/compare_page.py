"""The page of a comparison, with its matrices: fault by level, fault by detector, what each detector called it."""

from pathlib import Path
from typing import Any

import pandas as pd

from cosim.compare import Comparison, metrics, stats, tables
from cosim.compare.metrics import proportion
from cosim.files import columns, replace
from cosim.judge import coverage
from cosim.judge.lanes import seconds
from cosim.report import compared
from cosim.report.compare_words import summary, versus
from cosim.report.compared import MANY, maps
from cosim.report.page import PAGE, page, write
from cosim.table import Cell, Column, Table

TITLES = ("Detectors on the same flights", "Two campaigns side by side")
ROWS = columns("run", "fault")  # the sign of tables of ours
SIGNS = {"compare.parquet": ROWS, "compare.csv": ROWS, "compare.html": PAGE}


def comparison_report(found: Comparison, output: str | Path) -> Path:
    """Write the report of a cosim.compare.Comparison to the file `output`; returns its Path. Raises OutputError."""
    return write(output, render(found))


def write_comparison(found: Comparison, out: str | Path) -> None:
    """Write a cosim.compare.Comparison into folder `out`: compare.parquet, compare.csv and compare.html. Notes the
    paths in `found`. Raises OutputError."""
    out = Path(out)
    replace(out / "compare.parquet", lambda part: found.rows.to_parquet(part, index=False), ROWS)
    replace(out / "compare.csv", lambda part: found.rows.to_csv(part, index=False), ROWS)
    found.table, found.report = out / "compare.parquet", comparison_report(found, out / "compare.html")


def render(found: Comparison) -> str:
    """Return the page as HTML text."""
    rows, each = found.rows, found.detectors
    grouped, equal = stats.by_group(rows, each), stats.equal_thresholds(rows)
    sized = [] if found.two else found.sizes  # of a level: the two campaigns are none
    made: dict[str, Any] = {
        "maps": maps(rows), "equal": maps(rows, equal) if equal else None, "delays": compared.delays(rows),
        "false_alarms": compared.false_alarms(each), "sweeps": compared.sweeps(rows),
        "roc": compared.roc(rows, each) if equal else None, "cost": compared.cost(each),
    }  # fmt: skip
    free = rows[rows["case"].isna()]["run"].nunique()
    lost = f"; {found.failed} could not be flown" if found.failed else ""
    return page(
        "compare.html", title=found.title or TITLES[found.two],
        subtitle=f"{found.runs} flights, {found.source}; {free} of them fault-free{lost}", figures=list(made.values()),
        chips=[(d["id"], d["level"], d["detected"] > 0) for d in each],
        summary=versus(found.pairs, each) if found.two else summary(rows, each, grouped, sized),
        levels=None if found.two else levels(grouped), pairs=tables.pairs(found.pairs) if found.pairs else None,
        detectors=tables.detectors(each), quiet=tables.quiet(each), names=tables.names(each), after=tables.after(each),
        families=tables.families(found.families), sizes=tables.sizes(sized), sizes_told=tables.SIZES,
        levels_key=LEVELS_KEY, matrix_key=KEY, names_key=NAMES_KEY,
        remarks=[(d["id"], coverage.remark(d["id"])) for d in each if coverage.remark(d["id"])], matrix=matrix(rows),
        confusions=confusions(rows), flights=tables.flights(rows), as_shipped=_as_shipped(rows, each, free),
        equal_told=_equal(equal), **made,
    )  # fmt: skip


def _as_shipped(rows, each, free):
    n, bound = sum(d["fault_free_alarmed"] == 0 for d in each), proportion(0, free).high
    told = (f"{n} of {len(each)} detectors raised no alarm in the {free} fault-free flights, which bounds their "
            f"false-alarm probability per flight below {bound:.0%} (95 %).") * bool(free)  # fmt: skip
    many = rows[rows["frequency_hz"].notna() & rows["concerned"]].groupby("id").size().max() >= MANY
    cells = "Each cell holds flights seen / flights flown, bright where all were seen, the same flights in every panel"
    marks = "Each mark is one flight, the same in every panel (diamonds: both segments of a side, drawn to the right)"
    shown = cells if many else marks
    return f"{shown}; the amplitude is the one achieved at the rod, against the same flight without the fault. {told}"


def _equal(equal):
    if not equal:
        return ""
    _, k, n, bound = next(iter(equal.values()))
    each = ", ".join(f"{name} × {c[0]:.2g}" for name, c in equal.items() if c[0] is not None)
    return (
        f"Every threshold is scaled so that at most {k} of the {n} fault-free flights cross it (run-level "
        f"false-alarm probability {stats.ALPHA:.0%} or less in this sample, below {bound:.0%} at 95 %; "
        f"before confirmation): {each}. An oscillation counts as seen when |r| reaches the scaled "
        f"threshold after its onset."
    )


OUTCOMES = {  # outcome -> symbol, class, meaning
    "named": ("●", "c-seen", "seen and named right"),
    "ambiguous": ("◐", "c-part", "seen, called ambiguous"),
    "misnamed": ("≠", "c-wrong", "seen under another name"),
    "missed": ("✕", "c-missed", "designed for it, and missed"),
    "masked": ("▫", "c-quiet", "masked by the standing alarm of an earlier fault"),
    "quiet": ("·", "c-quiet", "may see it, no alarm"),
    "bonus": ("!", "c-bonus", "alarm though blind: not of the fault itself"),
    "not_valid": ("–", "c-quiet", "not valid: it could not judge"),
}
KEY = [(look, symbol, told) for symbol, look, told in OUTCOMES.values()]
LEVELS_KEY = (("c-seen", "n/n", "all seen"), ("c-part", "k/n", "some seen"), ("c-missed", "0/n", "none seen"),
              ("c-none", "blind", "cannot see it, or none judged"))  # fmt: skip
NAMES_KEY = (("c-seen", "n", "right name"), ("c-quiet", "n", "ambiguous, or no alarm though not designed for it"),
             ("c-wrong", "n", "another name"),
             ("c-missed", "n", "missed though designed for it, or a false alarm"))  # fmt: skip

LEVELS_TOLD = (
    "Flights in which a detector of the group saw the fault, and the time to its first alarm: "
    f"{metrics.MEDIAN}. Detectors that alarm in more than half of the fault-free flights do not count."
)


def levels(grouped: pd.DataFrame) -> Table | None:
    """Return the Table of case x group: flights in which the group saw the fault, and how soon; None without."""
    if grouped.empty:
        return None
    names = list(dict.fromkeys(grouped["group"]))
    made = Table("", "fault", *(Column(n, right=False) for n in names), kind="matrix", caption=LEVELS_TOLD)
    for case, own in sorted(grouped.groupby("case", sort=False), key=lambda pair: _order(pair[0])):
        cells = []
        for g in names:
            part = own[own["group"] == g]
            seen, able = int(part["seen"].sum()), bool(part["able"].any())
            late = seconds(metrics.delays(part["delay_s"].to_numpy(float)).median) if seen else ""
            told = f"{seen}/{len(part)}" + (f", {late}{' s' * (late != 'never')}" if seen else "")
            look = "c-none" if not able else "c-seen" if seen == len(part) else "c-part" if seen else "c-missed"
            who = ", ".join(sorted(set(part["first"].dropna())))
            cells.append(Cell(told if able else "blind", look, f"first: {who}" if who else ""))
        made.add(coverage.label(case), *cells)
    return made


def _order(case):
    heads = ("hydraulic", "ema", "simple", "aileron", "rudder", "stabiliser", "engine", "sensor")
    head = case.split(".")[0]
    return heads.index(head) if head in heads else len(heads), case


def matrix(rows: pd.DataFrame) -> Table | None:
    """Return the coverage matrix: what was expected, what happened; None without a fault."""
    found = stats.coverage_matrix(rows)
    names = [n for group in stats.groups(rows).values() for n in group]
    if not found:
        return None
    made = Table("", "fault", *(Column(n, right=False, detector=n) for n in names), kind="matrix coverage",
                 caption="k/n: flights seen of flights flown; where outcomes differ, the number of each. Bordered: "
                 "designed for. The expectation stands in the record of each detector in fdi/ and was written from the "
                 "equations, not from these flights.")  # fmt: skip
    groups: dict = {}
    for case in sorted(found, key=_order):
        head = coverage.label(case).split(":")[0] if "." in case else "other effectors"
        head = "aircraft sensors" if case.startswith("sensor") else head
        row = [_cell(n, found[case].get(n)) for n in names]
        groups.setdefault(head, []).append((coverage.label(case).split(": ")[-1], *row))
    for head, lines in groups.items():
        made.add(head)
        for line in lines:
            made.add(*line)
    return made


def _cell(name, cell):
    if cell is None:
        return Cell("", "c-none")
    found = sorted(cell["outcomes"].items(), key=lambda pair: -pair[1])
    kinds, first = {o for o, _ in found}, OUTCOMES[found[0][0]]
    if cell["word"] == coverage.BLIND and kinds <= {"quiet", "not_valid"}:
        look, told = "c-none", ""
    elif len(found) == 1:
        look = first[1]
        told = first[0] if kinds <= {"quiet", "not_valid"} else f"{first[0]} {cell['detected']}/{cell['runs']}"
    else:
        wrong = OUTCOMES["misnamed"][1] if "misnamed" in kinds else first[1]
        look = "c-part" if kinds & {"named", "ambiguous"} else wrong
        told = " ".join(f"{OUTCOMES[o][0]}{n}" for o, n in found)
    border = " designed" * (cell["word"] == coverage.DESIGNED and cell["lane"])
    more = f"{coverage.WORDS[cell['word']]}; " + ", ".join(f"{n} {OUTCOMES[o][2]}" for o, n in found)
    return Cell(told, look + border, f"{name}: {more}")


def confusions(rows: pd.DataFrame) -> list[tuple[str, Table]]:
    """Return [(detector, Table)]: one confusion matrix per detector; rows are faults, columns what it said last."""
    out = []
    for name in dict.fromkeys(rows["id"]):
        counts = stats.confusion(rows, name)
        if counts.empty:
            continue
        said = counts.drop(columns="none", errors="ignore").sum(axis=1) > 0
        telling = [c for c in counts.index if c == "no fault" or said[c]
                   or coverage.expected(name, c) == coverage.DESIGNED]  # fmt: skip
        rest, counts = len(counts) - len(telling), counts.loc[telling]
        counts = counts.loc[:, counts.sum() > 0]
        last = [c for c in ("ambiguous", "none", "false alarm") if c in counts.columns]
        columns = [c for c in counts.columns if c not in last] + last
        heads = (Column({"none": "no alarm"}.get(c, c.replace("_", " ")), right=False) for c in columns)
        made = Table("", "fault", *heads, kind="matrix")
        made.caption = f"{rest} further kind{'s' * (rest > 1)} of fault: never an alarm." if rest else ""
        for case in sorted(counts.index, key=lambda c: _order(c) if c != "no fault" else (99, "")):
            cells = [(int(counts.loc[case, c]), c) for c in columns]
            made.add(case if case == "no fault" else coverage.label(case),
                     *(Cell(n or "", _shade(n, c, case, name)) for n, c in cells))  # fmt: skip
        out.append((name, made))
    return out


def _shade(count, said, case, name):
    if not count:
        return "c-none"
    if said == "none":
        return "c-missed" if coverage.expected(name, case) == coverage.DESIGNED else "c-quiet"
    if said == "false alarm":
        return "c-missed"
    right = coverage.true_classes(case)
    return "c-seen" if said in right else "c-quiet" if said == "ambiguous" else "c-wrong"
