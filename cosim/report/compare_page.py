"""The page of a comparison: summary, levels, coverage, maps, delays, false alarms, confusion, sweeps, cost, flights."""

from pathlib import Path

from cosim.compare import stats
from cosim.compare.metrics import proportion
from cosim.files import replace
from cosim.report import compare_tables as tables
from cosim.report import compared
from cosim.report.compare_words import summary
from cosim.report.maps import MANY, maps
from cosim.report.page import drawing, page, text, write


def comparison_report(found, output):
    """Write the report of a cosim.compare.Comparison to the file `output`; returns its Path. Raises OutputError."""
    return write(output, render(found))


def write_comparison(found, out):
    """Write a cosim.compare.Comparison into folder `out`: compare.parquet, compare.csv and compare.html.

    Notes the paths in `found`. Raises OutputError.
    """
    out = Path(out)
    replace(out / "compare.parquet", lambda part: found.rows.to_parquet(part, index=False))
    replace(out / "compare.csv", lambda part: found.rows.to_csv(part, index=False))
    found.table, found.report = out / "compare.parquet", comparison_report(found, out / "compare.html")


def render(found):
    """Return the page as HTML text."""
    rows, each = found.rows, found.detectors
    grouped, equal = stats.by_group(rows, each), stats.equal_thresholds(rows)
    made = {
        "maps": maps(rows),
        "equal": maps(rows, equal) if equal else None,
        "delays": compared.delays(rows),
        "false": compared.false_alarms(each),
        "sweeps": compared.sweeps(rows),
        "roc": compared.roc(rows) if equal else None,
        "cost": compared.cost(each),
    }
    free = rows[rows["case"].isna()]["run"].nunique()
    sections = [
        ("Which level sees what", tables.levels(grouped), ""),
        ("The detectors", tables.detectors(each), ""),
        ("Coverage: fault kind by detector", tables.matrix(rows), ""),
        (
            "Oscillations over achieved amplitude and frequency, thresholds as shipped",
            made["maps"],
            _as_shipped(rows, each, free),
        ),
        ("The same at one false-alarm probability", made["equal"], _equal(equal)),
        ("How soon", made["delays"], ""),
        ("False alarms", made["false"], ""),
        ("What they called it", tables.confusions(rows), ""),
        ("Threshold sweeps", made["sweeps"], ""),
        ("Faults against false alarms", made["roc"], ""),
        ("Cost", made["cost"], ""),
        ("The flights", tables.flights(rows), ""),
    ]
    body = [
        f"<h2>{title}</h2>{f'<p class=muted>{told}</p>' if told else ''}{drawing(it) if hasattr(it, 'plain') else it}"
        for title, it, told in sections
        if it
    ]
    chips = [(d["id"], d["level"], d["detected"] > 0) for d in each]
    subtitle = f"{found.runs} flights, {found.source}; {free} of them fault-free" + (
        f"; {found.failed} could not be flown" if found.failed else ""
    )
    return page(
        title="Aircraft-level against local diagnosis, on the same flights",
        subtitle=subtitle,
        summary=summary(rows, each, grouped, equal),
        body="".join(body),
        figures=[f for f in made.values() if f],
        chips=chips,
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
        f"before confirmation): {text(each)}. An oscillation counts as seen when |r| reaches the scaled "
        f"threshold after its onset."
    )
