"""Commands killed at random moments, by SIGKILL and SIGTERM: no user file is lost, resumes give the same rows.

COSIM_KILLS kills, drawn by COSIM_SEED, printed by command (`pytest -m slow -s tests/test_kills.py`).
"""

import contextlib
import hashlib
import os
import random
import shutil
import signal
from collections import Counter

import pytest
import strategies
from commands import commands

from cosim.files import left_by
from cosim.log import LogError, open_log, recover

KILLS = int(os.environ.get("COSIM_KILLS", "100"))
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


def _sum(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _beside(home):
    return {p.name for p in home.glob(".*") if p.name != ".said"}


def _timeless(page):
    """Return a page without its row of what a clock measured."""
    return [line for line in page.splitlines() if b"microseconds" not in line]


@pytest.fixture
def work(tmp_path):
    """Return a folder with inputs and what each command makes of them without being killed, and the commands."""
    strategies.write_maps(tmp_path)
    strategies.write_whole(tmp_path / "rec.csv")
    (tmp_path / "few.toml").write_text(FILE)
    with commands(tmp_path) as command:
        yield tmp_path, command


# of each command: its arguments, and the file or folder that it makes
COMMANDS = {
    "run": (["run", "liquid-ofc", *SHORT, "-o", "run.mcap"], "run.mcap"),
    "report": (["report", "flight.mcap", "-o", "page.html"], "page.html"),
    "replay": (["replay", "flight.mcap", "-o", "again.mcap"], "again.mcap"),
    "map": (["replay", "rec.csv", "--map", "map.toml", "-o", "diagnosis.mcap"], "diagnosis.mcap"),
    "recover": (["recover", "cut.mcap", "-o", "recovered.mcap"], "recovered.mcap"),
    "compare": (["compare", "rows", "-o", "page"], "page/compare.html"),
    "campaign": (["campaign", "few.toml", "--workers", "1", "-o", "campaign"], "campaign"),
    "resume": (["campaign", "few.toml", "--workers", "1", "-o", "campaign", "--resume"], "campaign"),
    "reproduce": (["reproduce", "jay", "-o", "."], "reproduce-jay.html"),
}  # fmt: skip
SHARE = {"run": 12, "report": 8, "replay": 8, "map": 8, "recover": 8, "compare": 8, "campaign": 8, "resume": 8,
         "reproduce": 6}  # fmt: skip


@pytest.mark.slow
def test_commands_killed_at_random_moments(work):
    home, command = work
    assert command("run", "liquid-ofc", *SHORT, "-o", "flight.mcap").status == 0
    whole = (home / "flight.mcap").read_bytes()
    (home / "cut.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    assert command("campaign", "few.toml", "--workers", "1", "-o", "rows").status == 0
    inputs = {name: _sum(home / name) for name in ("flight.mcap", "cut.mcap", "rec.csv", "map.toml", "few.toml")}
    rows = _sum(home / "rows" / "runs.parquet")
    took, new = {}, {}
    for name, (args, made) in COMMANDS.items():
        done = command(*args)
        assert (home / made).exists(), (name, done)
        assert done.status in (0, 1), (name, done)
        took[name] = done.wall_s
        new[name] = home / made if (home / made).is_dir() else (home / made).read_bytes()
    content = open_log(home / "run.mcap").result["content"]
    old_page = new["report"] + b"<!-- of yesterday -->"
    rng, ended, lost = random.Random(os.environ.get("COSIM_SEED", "5")), Counter(), Counter()
    for name in (name for name, n in SHARE.items() for _ in range(round(n * KILLS / 100))):
        args, made = COMMANDS[name]
        path = home / made
        left_by(path).unlink(missing_ok=True)
        if name == "campaign":
            shutil.rmtree(path, ignore_errors=True)
        elif name in ("report", "compare"):
            path.write_bytes(old_page)
        elif name not in ("resume", "reproduce"):
            path.write_bytes(MINE)
        number, before = rng.choice((signal.SIGKILL, signal.SIGTERM)), _beside(home)
        done = command(*args, kill=(number, rng.uniform(0.0, took[name])))
        ended[name, done.status] += 1
        assert "Traceback" not in done.said, (name, done)
        assert number == signal.SIGKILL or done.status in (0, 1, 130, -signal.SIGTERM), (name, done)
        if number == signal.SIGTERM:
            assert _beside(home) <= before, name
        lost[name] += len(_beside(home) - before)  # what SIGKILL leaves; the next command that writes there removes it
        assert inputs == {file: _sum(home / file) for file in inputs}, name
        if name in ("campaign", "resume"):
            assert command(*COMMANDS["resume"][0]).status == 0
            assert _sum(path / "runs.parquet") == rows, name
            if rng.random() < 0.5:  # the next resume has something to do
                (path / "runs.parquet").unlink()
        elif name == "run":
            _run(path, done, content, home, command)
        elif name == "reproduce":
            assert _timeless(path.read_bytes()) == _timeless(new[name])
        elif name in ("report", "compare"):
            assert path.read_bytes() in (whole, old_page, new[name]), name
        else:  # as it was, or whole
            assert path.read_bytes() in (MINE, new[name]), name
    print(f"\n{sum(ended.values())} kills: {dict(ended)}; temporary files left by SIGKILL: {dict(lost)}")


def _run(path, done, content, home, command):
    """A killed flight: its old file and a part that comes back; an interrupted or a whole one is a log."""
    if path.read_bytes() != MINE:
        assert done.status or open_log(path).result["content"] == content
    left = left_by(path)
    if left.exists():
        with contextlib.suppress(LogError):  # of one without a tick nothing is recovered
            assert recover(left, home / "out.mcap")["ticks"] % 200 == 0
            told = command("recover", left.name, "-o", "out.mcap")
            assert told.status == 0, told
