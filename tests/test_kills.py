"""Commands killed at random moments, by SIGKILL and SIGTERM: no user file is lost, resumes give the same rows.

COSIM_KILLS kills of each command, drawn by COSIM_SEED (`pytest -m slow -s tests/test_kills.py`).
"""

import contextlib
import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import time

import pytest
import strategies
from killed import heeds_ctrl_c

from cosim.files import left_by
from cosim.log import LogError, open_log, recover

KILLS = int(os.environ.get("COSIM_KILLS", "4"))
SHORT = ["-s", "duration_s=3", "-s", "faults.0.start_s=1", "-s", "detectors.enabled=['iotsekf','position_monitor']",
         "-s", "elevator.feedback=measured"]  # fmt: skip
FILE = """
base = "liquid-ofc"
runs = 12
seed = 3
[set]
duration_s = 2.0
"faults.0.start_s" = 1.0
"detectors.enabled" = ["iotsekf"]
"elevator.feedback" = "measured"
[draw]
"flight.mass_t" = { low = 200.0, high = 240.0 }
"""
MINE = b"\x89MCAP0\r\n cosim-log 2 mine"  # a log that a new one may replace
# of each command: its arguments, and the file or folder that it makes
COMMANDS = {
    "run": (["run", "liquid-ofc", *SHORT, "-o", "run.mcap"], "run.mcap"),
    "report": (["report", "flight.mcap", "-o", "page.html"], "page.html"),
    "replay": (["replay", "flight.mcap", "-o", "again.mcap"], "again.mcap"),
    "map": (["replay", "rec.csv", "--map", "map.toml", "-o", "diagnosis.mcap"], "diagnosis.mcap"),
    "recover": (["recover", "cut.mcap", "-o", "recovered.mcap"], "recovered.mcap"),
    "compare": (["compare", "rows", "-o", "page"], "page/compare.html"),
    "campaign": (["campaign", "few.toml", "--workers", "1", "-o", "campaign"], "campaign/runs.parquet"),
}  # fmt: skip
ENDS = 0, 1, 130, -signal.SIGTERM, -signal.SIGINT  # of the last a shell says 130, too


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    """Return a folder with inputs and what each command makes of them, and command(words, signal, after_s)."""
    home = tmp_path_factory.mktemp("kills")

    def command(words, number=None, after=0.0):
        how = {"cwd": home, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "preexec_fn": heeds_ctrl_c}
        with subprocess.Popen([sys.executable, "-m", "cosim", *words], **how) as process:
            if number:
                time.sleep(after)
                process.send_signal(number)
            return process.communicate()[0].decode(), process.returncode

    strategies.write_maps(home)
    strategies.write_whole(home / "rec.csv")
    (home / "few.toml").write_text(FILE)
    for words in (["run", "liquid-ofc", *SHORT, "-o", "flight.mcap"],
                  ["campaign", "few.toml", "--workers", "1", "-o", "rows"]):  # fmt: skip
        assert command(words)[1] == 0
    whole = (home / "flight.mcap").read_bytes()
    (home / "cut.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    return home, command


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_killed_at_random_moments(name, work):
    (home, command), (words, made) = work, COMMANDS[name]
    rng, path = random.Random(f"{name} {os.environ.get('COSIM_SEED', '5')}"), home / made
    begun = time.monotonic()
    assert command(words)[1] in (0, 1)
    took, new = time.monotonic() - begun, path.read_bytes()
    old = new + b"<!-- of yesterday -->" if path.suffix == ".html" else MINE
    inputs = {p: hashlib.sha256(p.read_bytes()).digest() for p in home.glob("*.*") if p.name not in COMMANDS[name][1]}
    for number in rng.choices((signal.SIGKILL, signal.SIGTERM), k=KILLS):
        left_by(path).unlink(missing_ok=True)
        if name == "campaign" and rng.random() < 0.5:  # else the rest of it is flown
            shutil.rmtree(path.parent)
        elif name != "campaign":
            path.write_bytes(old)
        resumed = ["--resume"] * (name == "campaign" and path.parent.exists())
        said, status = command([*words, *resumed], number, rng.uniform(0.0, took))
        assert "Traceback" not in said and (number == signal.SIGKILL or status in ENDS), said
        assert inputs == {p: hashlib.sha256(p.read_bytes()).digest() for p in inputs}
        if name == "campaign":
            assert command([*words, *["--resume"] * path.parent.exists()])[1] == 0 and path.read_bytes() == new
            path.unlink()
        else:  # as it was, or whole; an interrupted flight is a log, a killed one leaves what comes back
            assert path.read_bytes() in (old, new) or (name == "run" and open_log(path).n_ticks)
        if name == "run" and left_by(path).exists():
            with contextlib.suppress(LogError):  # of one without a tick nothing is recovered
                assert recover(left_by(path), home / "out.mcap")["ticks"] % 200 == 0
