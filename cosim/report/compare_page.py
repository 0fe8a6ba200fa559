"""The page of a comparison: summary, levels, coverage, maps, delays, false alarms, confusion, sweeps, cost, flights."""

from pathlib import Path
from typing import Any

from cosim.compare import Comparison, stats, tables
from cosim.compare.metrics import proportion
from cosim.files import columns, replace
from cosim.judge import coverage
from cosim.report import compare_matrices as matrices
from cosim.report import compared
from cosim.report.compare_words import summary, versus
from cosim.report.maps import MANY, maps
from cosim.report.page import PAGE, page, write

TITLES = ("Detectors on the same flights", "Two campaigns side by side")
ROWS = columns("run", "fault")  # the sign of tables of ours
SIGNS = {"compare.parquet": ROWS, "compare.csv": ROWS, "compare.html": PAGE}


def comparison_report(found: Comparison, output: str | Path) -> Path:
    """Write the report of a cosim.compare.Comparison to the file `output`; returns its Path. Raises OutputError."""
    return write(output, render(found))


def write_comparison(found: Comparison, out: str | Path) -> None:
    """Write a cosim.compare.Comparison into folder `out`: compare.parquet, compare.csv and compare.html.

    Notes the paths in `found`. Raises OutputError.
    """
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
        "compare.html",
        title=found.title or TITLES[found.two],
        subtitle=f"{found.runs} flights, {found.source}; {free} of them fault-free{lost}",
        figures=list(made.values()),
        chips=[(d["id"], d["level"], d["detected"] > 0) for d in each],
        summary=versus(found.pairs, each) if found.two else summary(rows, each, grouped, sized),
        levels=None if found.two else matrices.levels(grouped),
        pairs=tables.pairs(found.pairs) if found.pairs else None,
        detectors=tables.detectors(each),
        quiet=tables.quiet(each),
        names=tables.names(each),
        after=tables.after(each),
        families=tables.families(found.families),
        sizes=tables.sizes(sized),
        sizes_told=tables.SIZES,
        levels_key=matrices.LEVELS_KEY,
        matrix_key=matrices.KEY,
        names_key=matrices.NAMES_KEY,
        remarks=[(d["id"], coverage.remark(d["id"])) for d in each if coverage.remark(d["id"])],
        matrix=matrices.matrix(rows),
        confusions=matrices.confusions(rows),
        flights=tables.flights(rows),
        as_shipped=_as_shipped(rows, each, free),
        equal_told=_equal(equal),
        **made,
    )


def _as_shipped(rows, each, free):
    n = sum(d["fault_free_alarmed"] == 0 for d in each)
    bound = proportion(0, free).high
    told = (
        f"{n} of {len(each)} detectors raised no alarm in the {free} fault-free flights, which bounds their "
        f"false-alarm probability per flight below {bound:.0%} (95 %)."
        if free
        else ""
    )
    many = rows[rows["frequency_hz"].notna() & rows["concerned"]].groupby("id").size().max() >= MANY
    shown = (
        "Each cell holds flights seen / flights flown, bright where all were seen, the same flights in every panel"
        if many
        else "Each mark is one flight, the same in every panel (diamonds: both segments of a side, drawn to the "
        "right)"
    )
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
