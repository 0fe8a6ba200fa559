"""The page of a comparison, with its matrices: fault by detector, what each detector called it."""

from pathlib import Path

import pandas as pd

from cosim.compare import Comparison, stats, tables
from cosim.files import PAGE, columns, replace
from cosim.judge import coverage
from cosim.report import compared
from cosim.report.page import page, write
from cosim.table import Cell, Column, Table

CALLED = "Rows: what was broken on a part that the detector watches; columns: what it said last while its alarm stood."
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
    free = rows[rows["case"].isna()]["run"].nunique()
    lost = f"; {found.failed} could not be flown" if found.failed else ""
    fitted = any(d["a90"] is not None for d in found.sizes)  # else no curve says how large
    of_size = [item for pair in tables.sizes(found.sizes if fitted else []).items() for item in pair]
    matrix_, confused = matrix(rows), confusions(rows)
    sections: list[tuple[str, list]] = [
        ("Which level sees what", [tables.by_level(found.levels)]),
        ("Flight by flight", [tables.pairs(found.pairs)]),
        ("The detectors", [tables.detectors(each)]),
        ("After the alarm", [tables.after(each)]),
        ("By kind of fault", [tables.families(found.families)]),
        ("How large an oscillation must be", [*of_size, tables.SIZES] if of_size else []),
        ("Coverage: fault kind by detector", [KEY, matrix_] if matrix_ else []),
        ("Oscillations over achieved amplitude and frequency", [compared.maps(rows)]),
        ("How soon", [compared.delays(rows)]),
        ("Without a fault", [tables.quiet(each)]),
        ("What they called it", [CALLED, NAMES_KEY, *confused] if confused else []),
        ("Faults against false alarms", [compared.roc(rows, each)]),
        ("The flights", [{"title": f"{found.runs} flights, and who noticed", "content": tables.flights(rows)}]),
    ]
    return page(
        title=found.title or TITLES[found.two], summary=[("In short", [found.headline])], sections=sections,
        subtitle=f"{found.runs} flights, {found.source}; {free} of them fault-free{lost}",
        chips=[(d["id"], d["level"], d["detected"] > 0) for d in each],
    )  # fmt: skip


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
NAMES_KEY = (("c-seen", "n", "right name"), ("c-quiet", "n", "ambiguous, or no alarm though not designed for it"),
             ("c-wrong", "n", "another name"),
             ("c-missed", "n", "missed though designed for it, or a false alarm"))  # fmt: skip


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
    for case in sorted({case for case, _ in found}, key=_order):
        head = coverage.label(case).split(":")[0] if "." in case else "other effectors"
        head = "aircraft sensors" if case.startswith("sensor") else head
        row = [_cell(n, found.get((case, n))) for n in names]
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


def confusions(rows: pd.DataFrame) -> list[Table]:
    """Return a confusion matrix per detector, whose name heads it; rows are faults, columns what it said last."""
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
        made = Table("", name, *heads, kind="matrix")
        made.caption = f"{rest} further kind{'s' * (rest > 1)} of fault: never an alarm." if rest else ""
        for case in sorted(counts.index, key=lambda c: _order(c) if c != "no fault" else (99, "")):
            cells = [(int(counts.loc[case, c]), c) for c in columns]
            made.add(case if case == "no fault" else coverage.label(case),
                     *(Cell(n or "", _shade(n, c, case, name)) for n, c in cells))  # fmt: skip
        out.append(made)
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
