"""Command and environment of a Python subprocess: no library is imported from the current folder; what crashes, ends or
hangs there is an error here.
"""

import contextlib
import errno
import faulthandler
import importlib
import json
import logging
import os
import queue
import re
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).resolve().parent.parent


def command(code: str) -> list[str]:
    """Return the command line that runs `code`; -P keeps the current folder from the path."""
    return [sys.executable, "-P", "-c", code]


def surroundings(**more: str) -> dict[str, str]:
    """Return the environment of such a process, with `more`: our packages are found wherever this one found them."""
    paths = (str(_ROOT), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep)))
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), **more}


MEMORY_BYTES = 2 << 30  # that a call may take beyond what its imports hold: what a machine of today can spare
CLOSED = 74  # exit status of a call whose way back was closed
_SERVE = "import sys; from actuators.subprocess_env import serve; serve(*sys.argv[1:])"


class Lost(Exception):
    """A call whose process ended, or was ended, without an answer; the text says how."""


def call(
    function: str, *arguments: Any, patience_s: float, progress: Callable[[float, float], None] | None = None,
    logged: bool = True,
) -> Any:  # fmt: skip
    """Return module:function(*arguments, tell=, hangs=, trace=) run in a process of its own; arguments and answer are
    JSON.

    The function calls `tell(done, total, words)` as it goes on, where `words` name what it does next, and
    `hangs(text)`, which ends the process; `trace` is a file for `faulthandler`. What it logs under "cosim" is
    `logged` here. Raises Lost when the process ends without an answer, or is silent for `patience_s` [s].
    """
    with tempfile.TemporaryDirectory() as folder:
        trace = os.path.join(folder, "trace")
        words = [*command(_SERVE), function, json.dumps(arguments), trace]
        pipe = subprocess.PIPE
        with subprocess.Popen(words, env=surroundings(), text=True, stdin=pipe, stdout=pipe) as process:
            try:
                return _answer(process, trace, patience_s, progress, logged)
            finally:
                process.kill()


def _answer(process, trace, patience_s, progress, logged):
    """Return what the process answers; its last words say what it was doing when it was lost."""
    lines: queue.SimpleQueue = queue.SimpleQueue()
    threading.Thread(target=_read, args=(process.stdout, lines), daemon=True).start()
    doing = "while it was loaded"
    while True:
        try:
            line = lines.get(timeout=patience_s)
        except queue.Empty:
            raise Lost(f"has not come back for {patience_s:g} s {doing}") from None
        if line is None:
            raise Lost(f"{_end(process, trace)} {doing}")
        with contextlib.suppress(ValueError):
            kind, told = json.loads(line)
            if kind == "answer":
                return told
            if kind == "lost":
                raise Lost(f"{told} {doing}")
            if kind == "log" and logged:
                logging.getLogger("cosim").info("%s", told)
            if kind == "doing":
                doing = told[2]
                if progress:
                    progress(told[0], told[1])


def _read(stream, lines):
    with contextlib.suppress(ValueError, OSError):
        for line in stream:
            lines.put(line)
    lines.put(None)


def _end(process, trace):
    """Return how a process ended that did not answer, with the line of Python that it was in where that is known."""
    try:
        status = process.wait(2.0)
    except subprocess.TimeoutExpired:
        status = CLOSED
    if status == CLOSED:
        return "closed files of its process that are not its own"
    text = Path(trace).read_text(errors="replace") if os.path.exists(trace) else ""
    where = _line_of(text)
    if "Timeout" in text:
        return f"does not come back{where}"
    if status < 0:
        name = signal.Signals(-status).name if -status in list(signal.Signals) else f"signal {-status}"
        return f"was ended by the system, perhaps for its memory ({name})," if name == "SIGKILL" else (
            f"crashed its process with {name}{where}")  # fmt: skip
    return f"ended its process with exit status {status}"


def _line_of(trace):
    """Return the first line of a `faulthandler` trace that is neither Python's nor ours, in brackets, or ""."""
    alone = trace.rpartition("Current thread" if "Current thread" in trace else "Thread 0x")[2]
    lines = re.findall(r'File "([^"]+)", line (\d+) in', alone)
    python = os.path.dirname(os.__file__) + os.sep
    theirs = [(path, n) for path, n in lines if not path.startswith((python, str(_ROOT), "<"))]
    return f" ({os.path.basename(theirs[0][0])}:{theirs[0][1]})" if theirs else ""


def serve(function: str, arguments: str, trace: str) -> None:
    """Answer one `call` on standard output, as its process: what the function prints goes to standard error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the caller's to handle
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    held = open(trace, "w")
    faulthandler.enable(held)
    threading.Thread(target=_end_with_caller, daemon=True).start()
    one = threading.Lock()

    def say(kind: str, told: Any) -> None:
        with one:
            print(json.dumps((kind, told), allow_nan=False), file=answers, flush=True)

    class Handler(logging.Handler):
        def emit(self, record):
            say("log", record.getMessage())

    log = logging.getLogger("cosim")
    log.setLevel(logging.INFO)
    log.addHandler(Handler())
    module, _, name = function.partition(":")
    work = getattr(importlib.import_module(module), name)
    _bounded()

    def hangs(text: str) -> None:
        say("lost", text)
        os._exit(0)

    try:
        say("answer", work(*json.loads(arguments), tell=lambda *told: say("doing", told), hangs=hangs, trace=held))
    except MemoryError:
        hangs(f"takes more than {MEMORY_BYTES >> 20} MB of memory")
    except OSError as error:
        if error.errno != errno.EBADF:
            raise
        os._exit(CLOSED)
    os._exit(0)  # threads that the function started do not keep it


def _bounded():
    """Bound what memory this process may take from now on, where the system can."""
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + MEMORY_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _end_with_caller():
    """End this process when the one that called it has ended, killed perhaps."""
    with contextlib.suppress(OSError):
        if os.read(0, 1) == b"":
            os._exit(1)
