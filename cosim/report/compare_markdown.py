"""The results of a campaign as a table and a picture for README.md."""

from pathlib import Path

from cosim.compare import Comparison, stats, tables
from cosim.errors import OutputError
from cosim.files import regular, replace_text
from cosim.report import markdown as readme
from cosim.scenario.catalog import SEGMENTS

PICTURE = "cosim/campaigns/aircraft-vs-local.svg"
LEGEND = b"share of flights seen"  # by which a picture of ours is known

DETAILS = "cosim/compare/README.md"
FRONT = 4  # rank of the columns of the front page; DETAILS has all


def write(found: Comparison, path: str | Path) -> None:
    """Write table and picture of a Comparison into the README at `path`, between its markers, and what each level sees
    of which oscillation into cosim/compare/README.md beside it, where there is one. Flights with a detector of both
    levels fill the table of faults by level instead. Raises OutputError, see `targets`."""
    from cosim.report.compare_picture import render

    table, picture, *details = targets(path)
    if (found.rows["level"] == "both").any():
        levels = f"{found.runs} flights:\n\n{tables.by_level(found.levels).markdown()}"
        readme.save(table, readme.put(readme.read(table), "levels", levels, table))
        return
    made = markdown(found, FRONT)
    pages = {table: readme.put(readme.read(table), "compare", made, table)}
    for page in details:
        text = readme.put(readme.read(page), "smallest", smallest(found), page)
        if readme.markers("compare")[0] in text:
            text = readme.put(text, "compare", markdown(found).partition("\n\n")[2], page)
        pages[page] = text
    alone = found.rows["target"].fillna("").str.removeprefix("elevator.").isin(SEGMENTS)
    drawn = render(found.rows[alone], stats.equal_thresholds(found.rows))
    for page, text in pages.items():
        readme.save(page, text)
    replace_text(picture, drawn)


def targets(path: str | Path) -> list[Path]:
    """Return the files that `write` would write: the README at `path`, its picture, and DETAILS where it is there.
    Raises OutputError where one of them lacks its markers, or what stands in the picture's place is a foreign file:
    neither ours nor shown by the README's table."""
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


def markdown(found: Comparison, rank: int = 9) -> str:
    """Return the counts of every detector as Markdown, columns up to `rank`, the picture above them."""
    rows = found.rows
    head = (
        f"{found.runs} flights, {int(rows[rows['case'].isna()]['run'].nunique())} of them without a fault. "
        f"![Share of oscillations seen over achieved amplitude and frequency]({PICTURE})"
    )
    return f"{head}\n\n{tables.detectors(found.detectors).upto(rank).markdown()}"


def smallest(found: Comparison) -> str:
    """Return how large an oscillation must be for each level, liquid and solid, of one segment and several, as
    Markdown."""
    what = "mm of rod at which 90 % are seen, its lower bound and a90/95; ?: outside the sizes flown"
    return "\n\n".join(f"{family}: {what}\n\n{made.markdown()}" for family, made in tables.sizes(found.sizes).items())
