"""The results of a campaign as a table and a picture for README.md."""

from collections.abc import Sequence
from pathlib import Path

from cosim.compare import Comparison, metrics, stats
from cosim.errors import OutputError
from cosim.files import regular, replace_text
from cosim.judge import coverage
from cosim.report import markdown as readme
from cosim.report.compare_tables import size
from cosim.scenario.catalog import SEGMENTS

PICTURE = "cosim/campaigns/aircraft-vs-local.svg"
LEGEND = b"share of flights seen"  # by which a picture of ours is known

COLUMNS = (
    *("detector", "draws on", "valid", "flights", "seen", "right name", "ambiguous", "wrong name", "not valid"),
    *("not excited", "first alarm, s", "right name after, s", "standing alarm, s", "false alarms"),
    *("fault-free flights with an alarm", "µs per step"),
)
DETAILS = "cosim/compare/README.md"
IN_DETAIL = ("not valid", "not excited", "standing alarm, s")  # columns of DETAILS alone


def write(found: Comparison, path: str | Path) -> None:
    """Write table and picture of a Comparison into the README at `path`, between its markers, and what each level sees
    of which oscillation into cosim/compare/README.md beside it, where there is one. Raises OutputError, see `targets`.
    """
    from cosim.report.compare_picture import render

    table, picture, *details = targets(path)
    made = markdown(found, [c for c in COLUMNS if c not in IN_DETAIL])
    pages = {table: readme.put(readme.read(table), "compare", made, table)}
    for page in details:
        text = readme.put(readme.read(page), "smallest", smallest(found), page)
        if readme.markers("compare")[0] in text:
            text = readme.put(text, "compare", markdown(found).partition("\n\n")[2], page)
        pages[page] = text
    drawn = render(_one_segment(found.rows), stats.equal_thresholds(found.rows))
    for page, text in pages.items():
        readme.save(page, text)
    replace_text(picture, drawn)


def targets(path: str | Path) -> list[Path]:
    """Return the files that `write` would write: the README at `path`, its picture, and DETAILS where it is there.

    Raises OutputError where one of them lacks its markers, or what stands in the picture's place is none of
    ours, nor shown by the README's table: it is somebody else's.
    """
    path = Path(path)
    picture, details = path.parent / PICTURE, path.parent / DETAILS
    text = readme.read(path)
    readme.put(text, "compare", "", path)
    regular(picture, OutputError)
    shown = PICTURE in (readme.part(text, "compare") or "")
    if picture.exists() and not shown and LEGEND not in picture.read_bytes()[:1000]:
        raise OutputError(f"is there already and no picture of the table in {path.name}", place=str(picture),
                          remedy="Move it away")  # fmt: skip
    if not details.is_file():
        return [path, picture]
    text = readme.read(details)
    readme.put(text, "smallest", "", details)
    if readme.markers("compare")[0] in text:
        readme.put(text, "compare", "", details)
    return [path, picture, details]


def markdown(found: Comparison, columns: Sequence[str] = COLUMNS) -> str:
    """Return the counts of every detector as Markdown, the picture above them."""
    rows = found.rows
    lines = [
        f"{found.runs} flights, {int(rows[rows['case'].isna()]['run'].nunique())} of them without a fault. "
        f"![Share of oscillations seen over achieved amplitude and frequency]({PICTURE})",
        "",
        f"| {' | '.join(columns)} |",
        f"|{'---|' * len(columns)}",
    ]
    for d in found.detectors:
        many = "designed", "detected", "named", "ambiguous", "misnamed", "idle", "not_excited"
        cells = [
            f"`{d['id']}`",
            coverage.group(d["id"], d["level"]),
            f"{d['availability']:.0%}" if d["availability"] == d["availability"] else "–",
            *(str(d[k]) if d["designed"] else "–" for k in many),
            *(_number(d[k]) for k in ("delay_s", "right_s", "standing_s")),
            metrics.rate_words(d["false_alarms"], d["hours"]),
            f"{d['fault_free_alarmed']}/{d['fault_free_runs']}",
            _number(d["step_us"]),
        ]
        told = dict(zip(COLUMNS, cells, strict=True))
        lines.append(f"| {' | '.join(told[c] for c in columns)} |")
    return "\n".join(lines)


def smallest(found: Comparison) -> str:
    """Return how large an oscillation must be for each level, liquid and solid, of one segment and several, as
    Markdown."""
    sized = found.sizes
    lines = []
    for family in dict.fromkeys(d["family"] for d in sized):
        own = [d for d in sized if d["family"] == family]
        hz = sorted({d["frequency_hz"] for d in own})
        cells = {(d["group"], d["frequency_hz"]): size(d) for d in own}
        what = "mm of rod at which 90 % are seen, its lower bound and a90/95; ?: outside the sizes flown"
        lines += ["", f"{family}: {what}", ""]
        lines += [f"| draws on | {' | '.join(f'{f:g} Hz' for f in hz)} |", f"|---|{'---|' * len(hz)}"]
        lines += [f"| {g} | {' | '.join(cells.get((g, f), '–') for f in hz)} |"
                  for g in dict.fromkeys(d["group"] for d in own)]  # fmt: skip
    return "\n".join(lines).strip("\n")


def _one_segment(rows):
    return rows[rows["target"].fillna("").str.removeprefix("elevator.").isin(SEGMENTS)]


def _number(value):
    return "–" if value is None or value != value or value == float("inf") else f"{value:.2g}"
