"""The command line where the surroundings are poor: no home, no output, few letters, a signal that ends it."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from commands import commands
from killed import heeds_ctrl_c

import cosim
from actuators import subprocess_env
from actuators.source_hash import cache_root
from cosim.files import left_by
from cosim.log import recover
from cosim.parts import GuestError, load
from cosim.replay import replay
from cosim.replay.map_draft import draft
from cosim.report import flight_report

COSIM = [sys.executable, "-m", "cosim.cli"]
SHORT = ["run", "cruise", "-s", "duration_s=0.2", "-s", "detectors.enabled=[]", "-s", "elevator.feedback=measured"]


ONE_BY_ONE = """
import json, sys
from cosim.cli import main
for args in json.loads(sys.argv[1]):
    sys.argv = ["cosim", *args]
    try:
        main()
    except SystemExit as end:
        assert not end.code, args
"""


def in_turn(commands, env):
    """Run command lines one after the other in one process; those that fail end it."""
    return subprocess.run([sys.executable, "-c", ONE_BY_ONE, json.dumps(commands)], env=env, capture_output=True)


def run(*args, env=None, **options):
    """Run the command line in a process of its own."""
    return subprocess.run([*COSIM, *args], env=env, capture_output=True, **options)


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """Run a command line in a process of its own that begins with everything loaded."""
    with commands(tmp_path_factory.mktemp("surroundings")) as run_one:
        yield run_one


def test_few_letters_are_no_error(tmp_path):
    told = in_turn([["list", "detectors"], [*SHORT, "-o", str(tmp_path / "a.mcap")]],
                   os.environ | {"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"})  # fmt: skip
    assert told.returncode == 0 and b"Traceback" not in told.stderr, told.stderr.decode()


def test_a_closed_output_is_no_error(tmp_path):
    for closed in (">&-", "2>&-"):
        told = subprocess.run(["sh", "-c", " ".join([*COSIM, "list", "scenarios", closed])], capture_output=True)
        assert told.returncode == 0, closed
    flight = " ".join([*COSIM, *SHORT, "-o", str(tmp_path / "a.mcap"), ">&- 2>&-"])
    assert subprocess.run(["sh", "-c", flight], capture_output=True).returncode == 0
    assert cosim.open_log(tmp_path / "a.mcap").complete


def test_an_interrupt_that_an_import_turns_into_another_error_ends_without_a_word(tmp_path):
    (tmp_path / "rich.py").write_text(
        "class Name:\n    def __set_name__(self, *_): raise KeyboardInterrupt\nclass Interrupted:\n    n = Name()\n"
    )
    there = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, sys.path)])}
    told = run("list", "scenarios", env=there)
    assert told.returncode == 130 and not told.stderr, told.stderr.decode()


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_what_an_interrupt_leaves_half_made_says_nothing(name, tmp_path):
    (tmp_path / "rich.py").write_text(
        "import os, signal\nclass Half:\n    def __init__(self):\n"
        f"        os.kill(os.getpid(), signal.{name})\n        [n for n in range(10**6)]\n"
        "    def __del__(self): self.engine.close()\nHalf()\n"
    )
    there = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, sys.path)])}
    told = run("list", "scenarios", env=there, preexec_fn=heeds_ctrl_c)
    assert told.returncode == 130 and not told.stderr, told.stderr.decode()


def test_what_lies_in_the_current_folder_is_not_taken_for_a_library(tmp_path):
    for name in ("numpy", "tomllib", "rich", "json", "jsbsim", "pydantic"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('not asked for')")
    there = os.environ | {"PYTHONPATH": str(Path(cosim.__file__).parents[1])}
    command = [sys.executable, "-m", "cosim", *SHORT, "-o", "a.mcap"]
    told = subprocess.run(command, env=there, cwd=tmp_path, capture_output=True)
    assert told.returncode == 0, told.stderr.decode()


def test_a_foreign_name_or_title_does_not_steer_the_terminal(tmp_path, command):
    nasty = "title=a\x1b[31mred\x07\x9b2J\u202eback"
    made = command(*SHORT, "-s", nasty, "-o", tmp_path / "a.mcap")
    assert made.status == 0
    for told in (made, command("info", tmp_path / "a.mcap"), command("info", tmp_path / "\x1b]0;mine\x07.mcap")):
        assert told.said and not {"\x1b", "\x07", "\x9b", "\u202e"} & set(told.said), told.said


def test_a_link_to_a_file_that_is_not_there_yet_is_written_through_and_a_hard_links_other_name_stays(tmp_path, command):
    (tmp_path / "link.mcap").symlink_to("behind.mcap")
    assert command(*SHORT, "-o", tmp_path / "link.mcap").status == 0
    assert (tmp_path / "link.mcap").is_symlink() and cosim.open_log(tmp_path / "behind.mcap").complete
    (tmp_path / "kept").write_bytes(b"\x89MCAP0\r\n cosim-log 1 of yesterday")
    os.link(tmp_path / "kept", tmp_path / "b.mcap")
    assert command(*SHORT, "-o", tmp_path / "b.mcap").status == 0
    assert (tmp_path / "kept").read_bytes().endswith(b"of yesterday") and cosim.open_log(tmp_path / "b.mcap").complete


NOBODY = """
import pwd
def unknown(uid): raise KeyError(f"uid not found: {uid}")
pwd.getpwuid = unknown
for name in ("HOME", "USER", "LOGNAME", "XDG_CACHE_HOME"): os.environ.pop(name, None)
"""


def test_a_user_without_name_and_home_flies(tmp_path, command):
    code = f"import os, sys\n{NOBODY}\nfrom cosim.cli import main\nsys.argv[0] = 'cosim'\nmain()"
    env = os.environ | {"NUMBA_CACHE_DIR": str(cache_root().parent)}
    told = subprocess.run([sys.executable, "-c", code, "list", "scenarios"], env=env, capture_output=True)
    assert told.returncode == 0, told.stderr.decode()
    done = command(*SHORT, "-o", tmp_path / "a.mcap", first=NOBODY)
    assert done.status == 0, done.said


def test_a_signal_while_kernels_are_compiled_ends_the_command_and_its_compilers(tmp_path):
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    command = [*COSIM, *SHORT, "-o", str(tmp_path / "a.mcap")]
    with subprocess.Popen(command, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as flight:
        children = Path(f"/proc/{flight.pid}/task/{flight.pid}/children")
        if not children.exists():
            pytest.skip("needs the list of a process's children")
        deadline = time.monotonic() + 60
        while not (compilers := _started_by(flight.pid)) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert compilers
        flight.send_signal(signal.SIGTERM)
        said = flight.stderr.read().decode()
        assert (flight.wait(), "Traceback" in said, "interrupted" in said) == (130, False, True), said
    left = [Path(f"/proc/{pid}/status").read_text() for pid in compilers if Path(f"/proc/{pid}").exists()]
    assert all("Z (zombie)" in status for status in left), left  # ended, if not yet taken note of
    assert len(list(tmp_path.rglob("*.code"))) < 10  # of 19 that it compiles


def _started_by(pid):
    """Return the processes that the threads of a process have started."""
    return [int(n) for p in Path(f"/proc/{pid}/task").glob("*/children") for n in p.read_text().split()]


NO_THREADS = """
import threading
def none_left(self): raise RuntimeError("can't start new thread")
threading.Thread.start = none_left
"""


def test_a_machine_without_further_threads_or_memory_says_so_in_one_line(tmp_path, command):
    cosim.simulate(cosim.load_scenario("cruise", ["duration_s=0.2"]), log=tmp_path / "a.mcap", timed=False)
    no_memory = NO_THREADS.replace('RuntimeError("can\'t start new thread")', "MemoryError")
    for first, says in ((NO_THREADS, "ulimit -u"), (no_memory, "ulimit -v")):
        done = command("replay", tmp_path / "a.mcap", first=first)
        assert done.status == 2 and done.said.count("\n") == 1 and says in done.said, done.said


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_an_output_that_takes_nothing_more_is_named(command):
    for how in ([], ["--json"]):
        done = command("list", "all", *how, to="/dev/full")
        assert done.status == 2 and done.said == "error: standard output: No space left on device\n"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_flight_like_ctrl_c(number, tmp_path):
    log = tmp_path / "x.mcap"
    command = [*COSIM, "run", "cruise", "-s", "duration_s=3000", "-o", log]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as flight:
        deadline = time.monotonic() + 120
        while not (left_by(log).exists() and left_by(log).stat().st_size > 4_000_000) and time.monotonic() < deadline:
            time.sleep(0.05)
        flight.send_signal(number)
        said = flight.stdout.read().decode()
        assert flight.wait() == 130 and "interrupted" in said
    found = cosim.open_log(log)
    assert found.n_ticks > 100 and found.result["status"] == "interrupted"


IN_TURN = """
import json, sys
from typer.testing import CliRunner
from cosim.cli.commands import app
for args in json.loads(sys.argv[1]):
    done = CliRunner().invoke(app, args)
    print(json.dumps([done.exit_code, done.stderr]), flush=True)
"""


def test_what_is_no_regular_file_is_refused_at_once(tmp_path):
    fifo = tmp_path / "fifo.toml"
    os.mkfifo(fifo)
    mapped, recovered = ["replay", fifo, "--map", fifo], ["recover", fifo, "-o", tmp_path / "r.mcap"]
    commands = [["run", fifo], ["campaign", fifo], ["info", fifo], ["report", fifo], mapped, recovered,
                ["replay", fifo], ["info", "/dev/zero"]]  # fmt: skip
    given = json.dumps([[str(word) for word in args] for args in commands])
    told = subprocess.run([sys.executable, "-c", IN_TURN, given], capture_output=True, timeout=120)
    ended = [json.loads(line) for line in told.stdout.splitlines()]
    assert len(ended) == len(commands), told.stderr.decode()
    for args, (status, said) in zip(commands, ended):
        assert status == 2 and said.count("\n") == 1, (args, said)


def test_poor_surroundings_are_told_or_borne(tmp_path):
    plain = run(*SHORT, "-o", str(tmp_path / "a.mcap"), env=os.environ | {"COLUMNS": "-5", "NUMBA_DISABLE_JIT": "1"})
    assert plain.returncode == 0 and b"a.mcap" in plain.stdout, plain
    gone = tmp_path / "gone"
    gone.mkdir()
    command = f"cd {gone}; rmdir {gone}; {' '.join(COSIM)} {' '.join(SHORT)} -o {tmp_path / 'b.mcap'}"
    told = subprocess.run(["sh", "-c", command], capture_output=True, env=os.environ | {"PYTHONPATH": os.getcwd()})
    assert told.returncode == 2 and b"current folder" in told.stderr.splitlines()[-1], told


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere names are Unicode")
def test_names_that_are_not_utf8_are_names(tmp_path):
    """A name is bytes; what cannot take one says so."""
    strange = os.fsdecode(b"a\xffb")
    log = tmp_path / f"{strange}.mcap"
    short = ["duration_s=0.2", "detectors.enabled=['position_monitor']", "elevator.feedback=measured"]
    cosim.simulate(cosim.load_scenario("cruise", short), log=log, timed=False)
    assert replay(log, output=tmp_path / f"{strange}2.mcap").exact
    recover(log, tmp_path / f"{strange}3.mcap")
    assert flight_report(log, tmp_path / f"{strange}.html").stat().st_size > 10_000
    (tmp_path / f"{strange}.csv").write_text("t_s,n_z\n0,1\n0.1,1\n")
    assert "n_z" in draft(tmp_path / f"{strange}.csv")
    with pytest.raises(GuestError, match="not UTF-8"):
        load(tmp_path / f"{strange}.py")


def test_a_width_without_end_is_none():
    listed, helped = ["list", "detectors"], ["-h"]  # beyond memory, beyond the digits that int() reads, no whole number
    for width, args in (("9" * 20, listed), ("9" * 5000, helped), ("1e9", helped), ("0", helped)):
        told = run(*args, env=os.environ | {"COLUMNS": width}, timeout=120)
        assert told.returncode == 0 and b"Traceback" not in told.stderr and len(told.stdout) < 100_000, width


COMPLETE = {"_COSIM_COMPLETE": "complete_bash"}


@pytest.mark.parametrize("poor", [{"TERMINAL_WIDTH": "abc"}, {"TERMINAL_WIDTH": "0"}, {"TERMINAL_WIDTH": "9" * 5000},
                                  COMPLETE, COMPLETE | {"COMP_WORDS": "cosim li", "COMP_CWORD": "x"}])  # fmt: skip
def test_a_variable_of_the_terminal_or_the_shell_that_says_nothing_is_ignored(poor):
    script = "import sys; sys.argv = ['cosim', '-h']; from cosim.cli import main; main()"
    told = subprocess.run(
        subprocess_env.command(script), env=subprocess_env.surroundings(**poor), capture_output=True, text=True
    )
    assert told.returncode == 0 and "linearize" in told.stdout and "Traceback" not in told.stderr, told.stderr


def test_python_without_docstrings_lists_what_there_is():
    told = run("list", "manoeuvres", "--json", env=os.environ | {"PYTHONOPTIMIZE": "2", "PYTHONDONTWRITEBYTECODE": "1"})
    assert told.returncode == 0 and b"Traceback" not in told.stderr, told.stderr.decode()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="of this system's limits")
def test_too_few_addresses_are_one_line_at_once():
    limited = ["sh", "-c", 'ulimit -v 400000; exec "$@"', "sh", *COSIM, "list"]
    told = subprocess.run(limited, capture_output=True, timeout=60)
    assert told.returncode == 2 and told.stderr.count(b"\n") == 1, told.stderr.decode()
    assert b"the limit of 390 MB for addresses is too low; allowed: from 480 MB on" in told.stderr
