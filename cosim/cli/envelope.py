"""The command that maps the envelope."""

from pathlib import Path
from typing import Annotated, Any

from rich.console import Group
from rich.text import Text

from cosim.cli import tables
from cosim.cli.app import answer, app, err
from cosim.cli.output import JsonOption, OverwriteOption, WorkersOption, option, output_option, reserve
from cosim.files import columns, replace


@app.command()
def envelope(
    output: Annotated[Path, output_option("DIR", "Folder of page and table.")] = Path("logs/envelope"),
    flown: Annotated[Path | None, option("DIR", "A campaign: where detectors judge, see.")] = None,
    overwrite: OverwriteOption = False,
    workers: WorkersOption = None,
    json_: JsonOption = False,
) -> None:
    """Map where the aircraft trims and where its actuators stall.

    Over mass, CG, altitude and speed; where it does not trim, it says why. With --flown also where detectors are
    valid and how much they see, by kind of fault, in detectors.csv.
    """
    from cosim.campaign.envelope import summary, trim_map

    paths = {"report": output / "envelope.html", "table": output / "envelope.csv"}
    from cosim.report.page import PAGE

    signs = {"report": PAGE, "table": columns("mass_t", "cg_pct")}
    for key, path in paths.items():
        reserve(path, signs[key])
    seen, more = _seen(flown, output / "detectors.csv") if flown else (None, {})
    with tables.progress(err, "trimming", unit="points", waiting="preparing the workers") as progress:
        trims = trim_map(workers=workers, progress=progress)
    from cosim.report import envelope_report

    found = summary(trims)
    envelope_report(trims, found, paths["report"])
    replace(paths["table"], lambda part: trims.to_csv(part, index=False, float_format="%.6g"), signs["table"])
    found |= {key: str(path) for key, path in paths.items()} | more
    answer(json_, found, lambda _: Group(shown(found), *([seen] if seen else [])))


def _seen(flown, path):
    """Write where the detectors of a campaign judge and see; return the Table of where they do least, {"detectors":
    path}."""
    from cosim.compare import CompareError, read
    from cosim.compare.over_envelope import over_envelope, weakest

    sign = columns("id", "family")
    reserve(path, sign)
    frame, _, tomls, source = read([flown])
    found = over_envelope(frame, tomls, source)
    if found.empty:
        raise CompareError("has no fault that a detector is designed for", place=source)
    replace(path, lambda part: found.to_csv(part, index=False, float_format="%.6g"), sign)
    return weakest(found), {"detectors": str(path)}


def shown(found: dict[str, Any]) -> Group:
    """Return the table of an envelope from its plain data."""
    from cosim.campaign.envelope import masses

    why = ", ".join(f"{n} {name}" for name, n in found["reasons"].items())
    lines = [f"{found['trimmed']} of {found['points']} points trim; the others: {why}"]
    for technology, ways in found["stalls"].items():
        said = [f"{way} everywhere" if at["from_kt"] is None else
                f"{way} below {at['from_kt']:.0f} kt CAS (beyond: {abs(at['reach_deg']):.1f} deg at worst)"
                for way, at in ways.items()]  # fmt: skip
        lines.append(f"{technology}: full elevator {', '.join(said)}")
    lines += [f"{key:<11}{found[key]}" for key in ("report", "table", "detectors") if key in found]
    return Group(masses(found), *(Text(line) for line in lines))
