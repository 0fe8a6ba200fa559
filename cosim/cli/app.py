"""The command line without its commands: consoles, what becomes of errors, options that commands share.

Exit status: 0 good (an alarm or a departed flight is a result), 1 a difference or a failed criterion, 2 bad input,
130 interrupted.
With --json one JSON object goes to standard output and nothing else; what goes wrong is one line on standard error.
"""

import errno
import json
import logging
import os
import re
import sys
import traceback
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any, cast

import typer
from rich.console import Console
from rich.markup import escape
from typer.core import TyperArgument, TyperCommand, TyperGroup

from cosim.errors import CosimError, shortened
from cosim.files import marked, replace_text

for _width in ("COLUMNS", "TERMINAL_WIDTH"):  # rich's and typer's; 0 would print nothing, 10^20 for ever
    if not re.fullmatch("[1-9][0-9]{0,3}", os.environ.get(_width, "")):
        os.environ.pop(_width, None)
TOLD = "COLUMNS" in os.environ
_asked = os.environ.get("COMP_WORDS") and re.fullmatch("[0-9]{1,4}", os.environ.get("COMP_CWORD", ""))
if os.environ.get("_COSIM_COMPLETE") == "complete_bash" and not _asked:
    del os.environ["_COSIM_COMPLETE"]  # no shell asks for completions: it would say of which words
WIDE = None if sys.stdout.isatty() or TOLD else 110  # a pipe has no width: do not fold its tables


# of a title or a name from a foreign file: what would steer the terminal, or turn the direction of reading
_STEERING = dict.fromkeys({*range(32), *range(127, 160), 0x61C, 0x200E, 0x200F, *range(0x2028, 0x202F),
                           *range(0x2066, 0x206A)} - {ord("\t"), ord("\n")}, "?")  # fmt: skip


class _Whole(Console):
    """A console that cuts nothing off: a path or a command that is longer than the terminal stays whole. What is
    printed does not steer the terminal, only what rich adds does."""

    def print(self, *objects, **how):
        super().print(*objects, **{"crop": False, "emoji": False, **how})

    def render(self, renderable, options=None):
        for part in super().render(renderable, options):
            yield part if part.control else part._replace(text=part.text.translate(_STEERING))


out, err = _Whole(width=WIDE), _Whole(stderr=True)


_Usage = cast(type[Exception], typer.BadParameter.__mro__[2])  # of all that typer refuses; it exports no name for it


class _Told(logging.Handler):
    """Print what the library tells of: whose code runs."""

    def emit(self, record):
        err.print(escape(_line(record.getMessage())), soft_wrap=True, highlight=False)


class _Group(TyperGroup):
    """Every error of a user becomes one line on standard error and exit status 2; Ctrl-C becomes 130."""

    def make_context(self, *args, **extra):
        try:
            return super().make_context(*args, **extra)
        except _Usage as error:
            if type(error).__name__ == "NoArgsIsHelpError":
                raise
            _say(_usage(error))
            raise typer.Exit(2) from None

    def invoke(self, ctx):
        log = logging.getLogger("cosim")
        log.setLevel(logging.INFO)
        if not any(isinstance(handler, _Told) for handler in log.handlers):
            log.addHandler(_Told())
        try:
            try:
                return super().invoke(ctx)
            finally:
                sys.stdout.flush()  # a full disk behind it is told here, not by the interpreter's end
        except _Usage as error:
            text = _usage(error)
        except CosimError as error:
            *before, text = (one.line for one in error.every)
            for one in before[:MOST]:
                _say(one)
            if before[MOST:]:
                _say(f"{len(before) - MOST} more mistakes, and the last:")
        except BrokenPipeError:
            raise  # the reader of a pipe went away: click ends quietly
        except OSError as error:
            said = NO_FILE if error.errno == errno.ENAMETOOLONG else error.strerror or error
            text = f"{error.filename or _stream(error)}: {said}".removeprefix(": ")
            text = text if _somewhere() else "the current folder has been removed. Change to another one"
        except MemoryError:
            text = "this machine gives no more memory. Close other programs, or raise the limit (ulimit -v)"
        except RuntimeError as error:
            if "start new thread" not in str(error):
                raise
            text = "this machine gives no more threads. Close other programs, or raise the limit (ulimit -u)"
        except KeyboardInterrupt:
            err.print("[yellow]interrupted[/]")
            ctx.exit(130)
        _say(text)
        ctx.exit(2)


def _stream(error):
    """Return "standard output" where that is what takes nothing more, and let what is left of it go."""
    last = Path(traceback.extract_tb(error.__traceback__)[-1].filename)
    if last.parent != Path(__file__).parent and "rich" not in last.parts:
        return ""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return "standard output"


def _somewhere():
    """Tell whether there is a current folder: it may have been removed under the command."""
    try:
        return bool(os.getcwd())
    except OSError:
        return False


def _usage(error):
    """Return one line of what typer refuses: an unknown option, a value out of its range, an argument missing."""
    ctx = getattr(error, "ctx", None)
    path = ctx.command_path if ctx else "cosim"
    said = " ".join(error.format_message().split()).rstrip(".")
    stop = "" if said.endswith("?") else "."
    return f"{path}: {said.replace('Input should be', 'must be')}{stop} `{path} -h` says what there is"


def _say(text):
    err.print(f"[bold red]error:[/] {escape(_line(text))}", soft_wrap=True, highlight=False)


def _line(text):
    return shortened(text.replace("\r", r"\r").replace("\n", r"\n"))


class _Command(TyperCommand):
    """A command whose help has whole paragraphs, and no names of Python's types."""

    def __init__(self, *args, **how):
        super().__init__(*args, **how)
        self.help = "\n\n".join(" ".join(part.split()) for part in (self.help or "").split("\n\n"))

    def get_params(self, ctx):
        params = super().get_params(ctx)
        for param in params:
            flag = getattr(param, "is_flag", False) or "--help" in param.opts
            kind = getattr(param, "display_type", None)
            if flag or isinstance(param, TyperArgument):
                vars(param)["display_type_rich"] = lambda ctx: None
            elif param.metavar is None and kind and kind(ctx).startswith(("<int", "<float")):
                param.metavar = "N"
        return params

    def collect_usage_pieces(self, ctx):
        return [piece.replace("{", "").replace("}", "") for piece in super().collect_usage_pieces(ctx)]


class _App(typer.Typer):
    """The commands of the command line, each a _Command."""

    def command(self, name=None, **how):
        return super().command(name, **{"cls": _Command, **how})


app = _App(
    cls=_Group,
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

LAYOUT = marked(b"{", b'"content"', b'"type": "tabs"')  # the sign of our layouts
NO_FILE = "there is no such file, and its name is longer than a file's may be"
MOST = 20  # mistakes of one file that are told before the last
LIVE_PORT = 8765  # that Foxglove asks for by default


def _version(wanted: bool):
    if wanted:
        from importlib.metadata import version

        print(f"cosim {version('cosim-fdi')}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
):
    """Fly a transport aircraft with physical elevator actuators, break something, and see which fault detector notices.

    Start with [b]cosim run[/]; [b]cosim list[/] shows what there is to fly.
    """


def answer(json_: bool, found: dict, shown: Callable[[dict], Any]) -> None:
    """Print `found` as one JSON object, or what `shown` makes of it for a reader."""
    print(json.dumps(found, allow_nan=False)) if json_ else out.print(shown(found))


def served(server: Any, layout: Path | None = None) -> None:
    """Say where Foxglove finds a flight, and write its `layout` for that flight."""
    if layout:
        replace_text(layout, server.layout.decode(), LAYOUT)
        err.print(f"layout {layout}: in Foxglove, Import from file", highlight=False, soft_wrap=True)
    err.print(f"in Foxglove: Open connection, {server.steer_url or server.url}", highlight=False, soft_wrap=True)
    if server.steer_url:
        err.print(f"to watch only: {server.url}", highlight=False, soft_wrap=True)


def only_with(partner: str, given: Any, **options: Any) -> None:
    """Refuse `options` {name: value, None where it is left out} that do nothing unless option `partner` is given."""
    for name, value in options.items():
        if value is not None and not given:
            raise CosimError(f"does nothing without {partner}", place=f"--{name.replace('_', '-')}")


def notes(lines: Iterable[str]) -> None:
    """Print lines that are worth knowing and no errors."""
    for line in lines:
        err.print(f"[yellow]note:[/] {escape(_line(line))}", soft_wrap=True, highlight=False)
