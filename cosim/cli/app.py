"""The command line without its commands: consoles, what becomes of errors, arguments and options that commands share.

Exit status: 0 good (an alarm or a departed flight is a result), 1 a difference or a failed criterion, 2 bad input,
130 interrupted.
With --json one JSON object goes to standard output and nothing else; what goes wrong is one line on standard error.
"""

import json
import logging
import os
import shlex
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from rich.console import Console
from rich.markup import escape
from rich.text import Text
from typer import Argument, Exit, Option, Typer
from typer.core import TyperArgument, TyperCommand, TyperGroup
from typer.exceptions import TyperException

import cosim
from cosim.errors import CosimError, OutputError, ScenarioError, shortened
from cosim.files import Sign, claim, failed

WIDTH = None if sys.stdout.isatty() or "COLUMNS" in os.environ else 110  # a pipe has no width: do not fold its tables
INTERRUPTED = 130  # exit status after Ctrl-C
MOST = 20  # mistakes of one file that are told before the last


class _Whole(Console):
    """A console that cuts nothing off: a path or a command that is longer than the terminal stays whole."""

    def print(self, *objects, **how):
        super().print(*objects, **{"crop": False, "emoji": False, **how})


out, err = _Whole(width=WIDTH), _Whole(stderr=True)


class _Told(logging.Handler):
    """Print what the library tells of: whose code runs."""

    def emit(self, record):
        _say(record.getMessage(), "")


def _untyped(params):
    """Return parameters without names of Python's types in the help."""
    for param in params:
        if isinstance(param, TyperArgument) or param.is_flag or "--help" in param.opts:
            vars(param)["display_type_rich"] = lambda ctx: None
    return params


class _Group(TyperGroup):
    """Every error of a user becomes one line on standard error and exit status 2; Ctrl-C becomes 130."""

    def get_params(self, ctx):
        return _untyped(super().get_params(ctx))

    def main(self, *args, **how):
        log = logging.getLogger("cosim")
        log.setLevel(logging.INFO)
        log.handlers = [_Told()]
        given = how.pop("args", None)
        how["args"] = list(sys.argv[1:] if given is None else given) or ["-h"]
        try:
            status = super().main(*args, **{**how, "standalone_mode": False})
            if status == INTERRUPTED:
                err.print("[yellow]interrupted[/]")
            sys.exit(status)
        except TyperException as error:
            told = [_usage(error)]
        except CosimError as error:
            told = [one.line for one in error.every]
            if len(told) > MOST + 1:
                told[MOST:-1] = [f"{len(told) - MOST - 1} more mistakes, and the last:"]
        except OSError as error:
            told = [f"{error.filename or 'standard output'}: {error.strerror or error}"]
        for line in told:
            _say(line)
        sys.exit(2)


def _usage(error):
    """Return one line of what typer refuses: an unknown option, a value out of its range, an argument missing."""
    ctx = getattr(error, "ctx", None)
    path = ctx.command_path if ctx else "cosim"
    said = " ".join(error.format_message().split())
    said += "" if said.endswith((".", "?")) else "."
    return f"{path}: {said} `{path} -h` says what there is"


def _say(text, lead="[bold red]error:[/] "):
    text = shortened(text.replace("\r", r"\r").replace("\n", r"\n"))
    err.print(f"{lead}{escape(text)}", soft_wrap=True, highlight=False)


def notes(lines: Iterable[str]) -> None:
    """Print lines that are worth knowing and no errors."""
    for line in lines:
        _say(line, "[yellow]note:[/] ")


class _Command(TyperCommand):
    """A command whose help has whole paragraphs, and no names of Python's types."""

    def __init__(self, *args, **how):
        super().__init__(*args, **how)
        self.help = "\n\n".join(" ".join(part.split()) for part in (self.help or "").split("\n\n"))

    def get_params(self, ctx):
        return _untyped(super().get_params(ctx))

    def collect_usage_pieces(self, ctx):
        return [piece.translate({123: None, 125: None}) for piece in super().collect_usage_pieces(ctx)]


app = Typer(cls=_Group, rich_markup_mode="rich", pretty_exceptions_enable=False,
            context_settings={"help_option_names": ["-h", "--help"]})  # fmt: skip


def command(group: str, name: str | None = None) -> Callable:
    """Make a function a command of a group of `cosim -h`."""
    return app.command(name, cls=_Command, rich_help_panel=group)


@app.callback(invoke_without_command=True)
def _root(version: Annotated[bool, Option("--version", help="Show the version.")] = False):
    """Fly a transport aircraft with physical elevator actuators, break something, and see which fault detector notices.

    Start with [b]cosim run[/]; [b]cosim list[/] shows what there is to fly.
    """
    if version:
        print(f"cosim {cosim.__version__}")
        raise Exit


# -- arguments and options that several commands have

Scenario = Annotated[str, Argument(metavar="SCENARIO", help="Built-in name (see [b]cosim list[/]) or TOML file.")]
Log = Annotated[Path, Argument(metavar="LOG", help="A log of [b]cosim run[/].")]
Json = Annotated[bool, Option("--json", help="Print one JSON object and nothing else.")]
Speed = Annotated[
    float | None, Option(metavar="N", help="With --live: N times the clock's. Default: 1.", min=0.01, max=1e3)
]
Port = Annotated[
    int | None, Option(metavar="PORT", help="With --live: default 8765, 0 takes a free one.", min=0, max=65535)
]
Set = Annotated[
    list[str] | None,
    Option("--set", "-s", metavar="KEY=VALUE",
           help="Change a key: [b]--set faults.0.frequency_hz=3[/]. Repeatable."),
]  # fmt: skip
Detector = Annotated[
    list[Path] | None,
    Option(metavar="FILE.py", help="A detector of your own. Its code runs with your rights. Repeatable."),
]


def output_option(metavar: str, about: str) -> Any:
    """Return the option -o of a command: the file or folder (DIR) that it writes."""
    return Option("--output", "-o", metavar=metavar, help=about)


def only_with(partner: str, given: Any, **options: Any) -> None:
    """Refuse `options` {name: value, None where it is left out} that do nothing unless option `partner` is given."""
    for name, value in options.items():
        if value is not None and not given:
            raise CosimError(f"does nothing without {partner}", place=f"--{name}")


# -- what commands do before the work, and with its result


def reserve(
    path: Path | None, sign: Sign | None, *, log: bool = False, source: Path | None = None, endings: Sequence[str] = ()
) -> None:
    """Find out before the work whether `path`, if any, can be written, leaving nothing but its folder; see
    cosim.files.claim.

    `sign` tells the project's own files of this format, `endings` those that its name may have. A `log` must not be
    there unfinished; the `source` of the work is not written over. Raises CosimError.
    """
    if path is None:
        return
    claim(path, sign)
    if endings and path.suffix not in endings:
        raise CosimError("its ending says no known format", place=str(path), allowed=", ".join(endings))
    if source and source.exists() and path.exists() and path.samefile(source):
        remedy = "Choose another -o"
        raise OutputError("is the log itself, it would be overwritten", place=str(path), remedy=remedy)
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


@contextmanager
def named(scenario: str) -> Iterator[None]:
    """Put the scenario's name or file before the place of what is found wrong only when it is built."""
    try:
        yield
    except ScenarioError as error:
        if error.place != scenario and not error.place.startswith(f"{scenario}: "):
            error.place = f"{scenario}: {error.place}" if error.place else scenario
        raise


def answer(json_: bool, found: dict, shown: Callable[[dict], Any]) -> None:
    """Print `found` as one JSON object, or what `shown` makes of it for a reader."""
    print(json.dumps(found, allow_nan=False)) if json_ else out.print(shown(found))


def word(path: Any) -> str:
    """Return a path as it stands in a command: quoted where it must be."""
    return shlex.quote(str(path))


def whole(text: str) -> Text:
    """Return lines that are not folded: a path or a command that is copied."""
    return Text(text, no_wrap=True, overflow="ignore")
