"""Commands in processes of their own, quickly: one interpreter loads everything and forks for each."""

import json
import os
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass

_SERVER = """
import json, os, signal, sys, time
import cosim, cosim.cli.commands, cosim.compare, cosim.report, cosim.replay.map, cosim.campaign.engine
import pandas, pyarrow.parquet
from cosim.cli import main
cosim.simulate(cosim.load_scenario("liquid-ofc", ["duration_s=0.1"]), timed=False, achieved=True)
print("ready", flush=True)
for line in sys.stdin:
    told = json.loads(line)
    pid = os.fork()
    if not pid:
        os.setsid()
        out = os.open(told["out"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        to = os.open(told["to"], os.O_WRONLY) if told["to"] else out
        for number, to in ((0, os.open(os.devnull, os.O_RDONLY)), (1, to), (2, out)):
            os.dup2(to, number)
        os.chdir(told["cwd"])
        os.environ.update(told["env"])
        sys.argv = ["cosim", *told["args"]]
        try:
            exec(told["first"])
            main()
            status = 0
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else int(end.code is not None)
        except BaseException:
            import traceback
            traceback.print_exc()
            status = 1
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    print(pid, flush=True)
    begun = time.monotonic()
    _, status, used = os.wait4(pid, 0)
    print(json.dumps([os.waitstatus_to_exitcode(status), time.monotonic() - begun, used.ru_utime + used.ru_stime,
                      used.ru_maxrss * 1024]), flush=True)
"""


@dataclass
class Done:
    """How a command ended: exit status (negative: the signal), seconds, of the processor, largest memory, its words."""

    status: int
    wall_s: float
    cpu_s: float
    largest: int
    said: str


@contextmanager
def commands(folder):
    """Yield command(*args, kill=(signal, after_s)): run `cosim args` in `folder` and return Done."""
    env = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-W", "ignore", "-c", _SERVER], env=env, **pipes) as server:
        assert server.stdout.readline() == "ready\n"
        out = folder / ".said"

        def command(*args, kill=None, env=None, first="", to=""):
            """`env` more variables, `first` Python code that runs before, `to` a file for what is printed."""
            told = {"args": [str(a) for a in args], "cwd": str(folder), "out": str(out), "env": env or {},
                    "first": first, "to": to}  # fmt: skip
            server.stdin.write(json.dumps(told) + "\n")
            server.stdin.flush()
            pid = int(server.stdout.readline())
            if kill:
                time.sleep(kill[1])
                try:
                    os.kill(pid, kill[0])
                except ProcessLookupError:
                    pass
            return Done(*json.loads(server.stdout.readline()), out.read_text(errors="replace") if out.exists() else "")

        yield command
        server.stdin.close()
