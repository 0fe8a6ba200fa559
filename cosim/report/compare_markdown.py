"""The results of a campaign as a table and a picture for README.md."""

from pathlib import Path

from cosim.compare import Comparison, stats
from cosim.files import replace_text
from cosim.judge import coverage
from cosim.report import markdown as readme
from cosim.scenario.catalog import GROUPS, SEGMENTS

PICTURE = "cosim/campaigns/aircraft-vs-local.svg"


DETAILS = "cosim/compare/README.md"


def write(found: Comparison, path: str | Path) -> None:
    """Write table and picture of a Comparison into the README at `path`, between its markers, and what each level sees
    of which oscillation into cosim/compare/README.md beside it, where that has its markers. Raises OutputError.
    """
    from cosim.report.compare_picture import render

    picture, details = Path(path).parent / PICTURE, Path(path).parent / DETAILS
    equal = stats.equal_thresholds(found.rows)
    replace_text(picture, render(_one_segment(found.rows), equal))
    readme.replace(path, "compare", markdown(found))
    if details.is_file():
        readme.replace(details, "smallest", smallest(found))


def markdown(found: Comparison) -> str:
    """Return the counts of every detector as Markdown, the picture above them."""
    rows = found.rows
    lines = [
        f"{found.runs} flights, {int(rows[rows['case'].isna()]['run'].nunique())} of them without a fault. "
        f"![Share of oscillations seen over achieved amplitude and frequency, a panel per detector]({PICTURE})",
        "",
        "| detector | draws on | seen of designed for | named | median delay, s | fault-free flights with an alarm "
        "| µs per step |",
        "|---|---|---|---|---|---|---|",
    ]
    for d in found.detectors:
        seen = f"{d['detected']}/{d['designed']}" if d["designed"] else "–"
        free = f"{d['fault_free_alarmed']}/{d['fault_free_runs']}"
        lines.append(
            f"| `{d['id']}` | {coverage.group(d['id'], d['level'])} | {seen} | {d['named']} | {_number(d['delay_s'])} "
            f"| {free} | {_number(d['step_us'])} |"
        )
    return "\n".join(lines)


def smallest(found: Comparison) -> str:
    """Return from which amplitude on each level sees an oscillation, of one segment and of several, as Markdown."""
    tables = (("of one segment", _one_segment(found.rows)), ("of several segments", _several(found.rows)))
    return "\n".join(line for words, own in tables for line in _smallest(words, own, found.detectors)).strip("\n")


def _one_segment(rows):
    return rows[rows["target"].fillna("").str.removeprefix("elevator.").isin(SEGMENTS)]


def _several(rows):
    return rows[rows["target"].fillna("").isin([f"elevator.{g}" for g in GROUPS])]


def _smallest(words, rows, detectors):
    """Return the lines of the table of what each level sees of oscillations of these rows; none without them."""
    grouped = stats.by_group(rows, detectors)
    smallest = {name: stats.smallest(grouped, name) for name in stats.groups(rows)}
    hz = sorted({f for found in smallest.values() for f in found})
    if not hz:
        return []
    return [
        "",
        f"Smallest achieved oscillation {words}, in mm of rod, from which on {stats.SEEN:.0%} of the flights are seen:",
        "",
        f"| draws on | {' | '.join(f'{f:g} Hz' for f in hz)} |",
        f"|---|{'---|' * len(hz)}",
        *(f"| {name} | {' | '.join(_number(by_hz.get(f)) for f in hz)} |" for name, by_hz in smallest.items()),
    ]


def _number(value):
    return "–" if value is None or value != value or value == float("inf") else f"{value:.2g}"
