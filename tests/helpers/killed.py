"""kill -9 of writers at chosen moments: one interpreter prepares everything once and forks a writer per kill."""

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from textwrap import indent

_FORK = """
import os, sys
for _ in sys.stdin:
    pid = os.fork()
    if not pid:
{write}
        os._exit(0)
    print(pid, flush=True)
    os.waitpid(pid, 0)
    print("dead", flush=True)
"""


@contextmanager
def killer(prepare, write):
    """Yield kill(wait): fork a writer that runs the source `write`, call wait(), kill -9 it and see it dead.

    `prepare` is source that runs once, before the first fork.
    """
    code = prepare + _FORK.format(write=indent(write, "        "))
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", code], **pipes) as parent:

        def kill(wait):
            parent.stdin.write("go\n")
            parent.stdin.flush()
            pid = int(parent.stdout.readline())
            try:
                wait()
            finally:
                os.kill(pid, signal.SIGKILL)
            assert parent.stdout.readline() == "dead\n"

        yield kill


def grown(path, size=1):
    """Wait until a file holds `size` bytes, at most a minute."""
    end = time.monotonic() + 60
    while not path.exists() or path.stat().st_size < size:
        assert time.monotonic() < end, "the run writes nothing"
        time.sleep(0.002)


def heeds_ctrl_c():
    """Undo in a child, as its `preexec_fn`, what shells do to their jobs: in the background they ignore SIGINT, under
    nohup SIGHUP."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
