"""What commands share: --json, --workers, and finding out before a flight that its log cannot be written."""

import hashlib
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from cosim.errors import OutputError, ScenarioError
from cosim.files import OTHER, TAKEN, locked

MAGIC = b"\x89MCAP0\r\n"  # how a log begins
LONGEST = 100  # characters of a log's name


def reserve(
    path: str | Path,
    *,
    taken: Mapping[str, Iterable[str | Path]] = {},
    endings: Sequence[str] = (),
    log: bool = False,
) -> None:
    """Make the folder of `path` and open the file for writing once, leaving an existing one as it is.

    `taken` are inputs that must not be overwritten, {what they are called: files}; `endings` the suffixes that are
    possible. What is to become a `log` may take the place of a log alone. Raises OutputError.
    """
    path = Path(path)
    if endings and path.suffix not in endings:
        raise OutputError("its ending says no known format", place=str(path), allowed=", ".join(endings))
    for what, files in taken.items():
        if path.exists() and any(Path(file).exists() and path.samefile(file) for file in files):
            raise OutputError(f"is {what} itself, it would be overwritten", place=str(path), remedy="Choose another -o")
    if path.is_dir():
        raise OutputError(
            "is a folder, not a file", place=str(path), remedy=f"Choose a file: -o {path / 'flight.mcap'}"
        )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        behind, existed = Path(os.path.realpath(path)), path.exists()  # behind a link stands the file that is opened
        with open(path, "ab", opener=_at_once) as file:
            free = locked(file)
            if free and not existed:
                behind.unlink()  # while locked: a run that has opened it meanwhile looks whether it is still there
    except (FileExistsError, NotADirectoryError):
        raise OutputError("its folder is a file", place=str(path), remedy="Choose another place with -o") from None
    except OSError as error:
        raise OutputError(
            f"cannot be written: {error.strerror}", place=str(path), remedy="Choose another place with -o"
        ) from None
    if not free:
        raise OutputError(TAKEN, place=str(path), remedy=OTHER)
    if log and _no_log(path):
        remedy = "Choose another -o, or remove it"
        raise OutputError("holds something that is no log, it would be overwritten", place=str(path), remedy=remedy)


def _no_log(path):
    """Tell whether a file holds anything but a log, be it whole or not."""
    if not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            begin = file.read(len(MAGIC))
    except OSError:  # may be written, not read: nobody knows
        return True
    return begin != MAGIC[: len(begin)]


def _at_once(path, flags):
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0), 0o666)  # a pipe that nobody reads is an error


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


def output_option(metavar: str, about: str) -> Any:
    """Return the option -o of a command: the file or folder that it writes."""
    return typer.Option("--output", "-o", metavar=metavar, help=about)


JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
WorkersOption = Annotated[
    int | None, typer.Option("--workers", min=1, help="Processes. Default: one per core.", show_default=False)
]
ReadmeOption = Annotated[
    Path | None,
    typer.Option("--readme", metavar="FILE", help="Write the tables between its markers, too.", show_default=False),
]
CampaignArg = Annotated[str, typer.Argument(metavar="CAMPAIGN", help="Built-in name or file.", show_default=False)]
DetectorOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--detector",
        metavar="FILE.py",
        help="A detector of your own: a file, or an installed one by name. Its code runs with your rights. Repeatable.",
        show_default=False,
    ),
]
