"""What commands share: --json, --workers, and finding out before a flight that its log cannot be written."""

import hashlib
import os
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from cosim.errors import CosimError, OutputError, ScenarioError
from cosim.files import Sign, claim, failed, overwriting

LONGEST = 100  # characters of a log's name
FILES = (".html", ".htm", ".csv", ".parquet", ".json", ".toml", ".mcap", ".md", ".png", ".svg", ".pdf")  # no folder's


def reserve(
    path: str | Path,
    sign: Sign | None,
    *,
    taken: Mapping[str, Iterable[str | Path]] = {},
    endings: Sequence[str] = (),
    log: bool = False,
) -> None:
    """Find out before the work whether `path` can be written, leaving nothing but its folder; see cosim.files.claim.

    `sign` tells the project's own files of this format, `taken` are inputs that must not be overwritten, {what they are
    called: files}; `endings` the suffixes that are possible. A `log` must not be there
    unfinished. Raises
    OutputError.
    """
    path = Path(path)
    if endings and path.suffix not in endings:
        raise OutputError("its ending says no known format", place=str(path), allowed=", ".join(endings))
    for what, files in taken.items():
        if path.exists() and any(Path(file).exists() and path.samefile(file) for file in files):
            raise OutputError(f"is {what} itself, it would be overwritten", place=str(path), remedy="Choose another -o")
    claim(path, sign)
    try:
        folder = Path(os.path.realpath(path)).parent
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise failed(error, path) from None
    if log:
        from cosim.log.log_file import check_no_part

        check_no_part(path)


def log_name(scenario: str, overrides: Iterable[str] = ()) -> str:
    """Return the name of a run's log without its ending: the scenario's, and what was set, so that a variant gets a
    file of its own; a digest of what was set where that is long."""
    told = [re.sub(r"[^A-Za-z0-9._=-]+", "_", text.strip()).strip("_") for text in overrides]
    name = "+".join([Path(scenario).stem, *told])
    if len(name) <= LONGEST:
        return name
    return f"{Path(scenario).stem[:LONGEST]}+{hashlib.sha256(chr(0).join(overrides).encode()).hexdigest()[:8]}"


@contextmanager
def named(scenario: str) -> Iterator[Any]:
    """Put the scenario's name or file before the place of what is found wrong only when it is built."""
    try:
        yield
    except ScenarioError as error:
        if error.place != scenario and not error.place.startswith(f"{scenario}: "):
            error.place = f"{scenario}: {error.place}" if error.place else scenario
        raise


def loaded(scenario: str, overrides: Sequence[str]) -> Any:
    """Return the Scenario of a command; of a campaign's file say which command flies it. Raises CosimError."""
    from cosim.scenario import load_scenario
    from cosim.texts import read, toml

    try:
        return load_scenario(scenario, overrides)
    except CosimError:
        if Path(scenario).is_file() and {"base", "part"} & set(toml(read(scenario), place=scenario)):
            remedy = f"cosim campaign {scenario} flies it"
            raise CosimError("is the file of a campaign, no scenario", place=scenario, remedy=remedy) from None
        raise


def option(metavar: str | None, about: str, *names: str, **more: Any) -> Any:
    """Return an option; without `names` it has that of its parameter."""
    return typer.Option(*names, metavar=metavar, help=about, **more)


def flag(name: str, about: str) -> Any:
    """Return an option without a value."""
    return typer.Option(name, help=about)


def argument(metavar: str, about: str) -> Any:
    """Return an argument."""
    return typer.Argument(metavar=metavar, help=about)


def output_option(metavar: str, about: str) -> Any:
    """Return the option -o of a command: the file or folder (DIR) that it writes."""
    return typer.Option("--output", "-o", metavar=metavar, help=about, callback=_folder if metavar == "DIR" else None)


def _folder(path: Path | None) -> Path | None:
    """Refuse a file, or the name of one, where a folder is written."""
    if path and not path.is_dir() and (path.exists() or path.suffix in FILES):
        other = path.with_suffix("")
        said = "-o takes the folder of what is written, and this is a file's name"
        remedy = "Name a folder" + ("" if other.is_file() else f": -o {other}")
        raise OutputError(said, place=str(path), remedy=remedy)
    return path


def _overwriting(ctx: typer.Context, allowed: bool):
    """Let the command replace foreign files until it ends."""
    ctx.with_resource(overwriting(allowed))


OverwriteOption = Annotated[
    bool,
    typer.Option("--overwrite", callback=_overwriting, help="Replace what is there, even if cosim did not write it."),
]
JsonOption = Annotated[bool, flag("--json", "Print one JSON object and nothing else.")]
WorkersOption = Annotated[int | None, option("N", "Processes. Default: one per core.", min=1)]
ReadmeOption = Annotated[Path | None, option("FILE", "Write the tables between its markers, too.")]
TimeOption = Annotated[str | None, option("COLUMN", "The time column.")]
SpeedOption = Annotated[float | None, option("N", "With --live: N times the clock's. Default: 1.", min=0.01, max=1e3)]
PortOption = Annotated[int | None, option("PORT", "With --live: default 8765, 0 takes a free one.", min=0, max=65535)]
SetOption = Annotated[
    list[str] | None,
    option("KEY=VALUE", "Change a key: [b]--set faults.0.frequency_hz=3[/]. Repeatable.", "--set", "-s"),
]
DetectorOption = Annotated[
    list[Path] | None,
    option("FILE.py", "A detector of your own: a file, or an installed one by name. Its code runs with your rights. "
           "Repeatable."),
]  # fmt: skip
ScenarioArg = Annotated[str, argument("SCENARIO", "Built-in name (see [b]cosim list[/]) or TOML file.")]
CampaignArg = Annotated[str, argument("CAMPAIGN", "Built-in name or file.")]
LogArg = Annotated[Path, argument("LOG", "A log of [b]cosim run[/].")]
