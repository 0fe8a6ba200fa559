"""A flight by hand, or live, killed before it writes its log: what was flown comes back, with what was injected."""

import functools
import os
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

import cosim
from cosim.cli.commands import app
from cosim.errors import OutputError
from cosim.files import TAKEN
from cosim.flight.interactive import journal, stepping
from cosim.flight.interactive.live import fly_live
from cosim.replay import replay
from cosim.scenario import parse
from cosim.scenario.user_parts import identity

BY_HAND = """
import os, signal, sys, time
import cosim
flight = cosim.Flight(cosim.load_scenario("cruise", ["duration_s=20"]), log=sys.argv[1])
flight.step(200)
fault = flight.inject(target="elevator.left_inner", kind="ofc_liquid", amplitude_mm=8.0, frequency_hz=2.0)
flight.step(300)
flight.heal(fault)
time.sleep(0.6)
flight.step(100)
os.kill(os.getpid(), signal.SIGKILL)
"""
runner = CliRunner()


def scenario_of(log: Path):
    return parse(tomllib.loads(cosim.open_log(log).attachments["scenario.toml"].decode()))


def recovered(log: Path):
    found = runner.invoke(app, ["recover", str(log)])
    assert found.exit_code == 0, found.output
    assert not journal.beside(log).exists()
    return scenario_of(log), len(cosim.open_log(log).array("/truth/aircraft"))


def test_a_flight_by_hand_that_is_killed_comes_back(tmp_path):
    log = tmp_path / "flight.mcap"
    ended = subprocess.run([sys.executable, "-c", BY_HAND, log], timeout=300)
    assert ended.returncode == -signal.SIGKILL and not log.exists()
    scenario, ticks = recovered(log)
    [fault] = scenario.faults
    assert (fault.target, fault.start_s, fault.end_s) == ("elevator.left_inner", 1.0, 2.5)
    assert 500 <= ticks <= 600 and replay(log).exact


def test_a_live_flight_that_is_killed_comes_back(tmp_path):
    log = tmp_path / "live.mcap"
    command = [sys.executable, "-m", "cosim", "run", "liquid-ofc", "--live", "--port", "0", "-o", log]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as live:
        end = time.monotonic() + 300
        while not journal.beside(log).is_file() and time.monotonic() < end:
            time.sleep(0.1)
        time.sleep(1.5)
        os.kill(live.pid, signal.SIGKILL)
    assert not log.exists()
    scenario, ticks = recovered(log)
    assert ticks >= 100 and [f.kind for f in scenario.faults] == ["ofc_liquid"]


def test_a_flight_that_ends_leaves_only_its_log(tmp_path):
    log = tmp_path / "flight.mcap"
    with cosim.Flight(cosim.load_scenario("cruise", ["duration_s=1"]), log=log) as flight:
        flight.step(100)
        assert journal.beside(log).is_file()
    assert os.listdir(tmp_path) == ["flight.mcap"]


def test_an_earlier_log_of_the_same_name_stays(tmp_path):
    log = tmp_path / "flight.mcap"
    log.write_bytes(b"of another flight")
    journal.beside(log).write_text(cosim.load_scenario("cruise", ["duration_s=0.5"]).expanded_toml())
    assert runner.invoke(app, ["recover", str(log)]).exit_code == 0
    assert log.read_bytes() == b"of another flight"
    assert len(cosim.open_log(tmp_path / "flight.recovered.mcap").array("/truth/aircraft")) == 100


def test_a_journal_that_a_kill_left_is_not_written_over(tmp_path):
    log = tmp_path / "flight.mcap"
    cruise = cosim.load_scenario("cruise", ["duration_s=0.5"])
    journal.beside(log).write_text(cruise.expanded_toml())
    for more in ([], ["--live", "--port", "0"]):
        told = runner.invoke(app, ["run", "cruise", *more, "-o", str(log)])
        assert told.exit_code == 2 and f"`cosim recover {log}`" in told.stderr
    with pytest.raises(OutputError, match="cosim recover"):
        cosim.Flight(cruise, log=log)
    with pytest.raises(OutputError, match="cosim recover"):
        fly_live(cruise, port=0, log=log)
    assert journal.beside(log).read_text() == cruise.expanded_toml() and not log.exists()


def test_nobody_else_writes_the_log_of_a_flight_in_the_air(tmp_path):
    log = tmp_path / "flight.mcap"
    with cosim.Flight(cosim.load_scenario("cruise", ["duration_s=1"]), log=log) as flight:
        for side in ("left", "right"):
            flight.step(60)
            for command in (["run", "cruise", "-o"], ["recover"]):
                told = runner.invoke(app, [*command, str(log)])
                assert told.exit_code == 2 and TAKEN in told.stderr
            with pytest.raises(OutputError, match=TAKEN):
                cosim.Flight("cruise", log=log)
            flight.inject(target=f"elevator.{side}_inner", kind="jam_solid")
    assert os.listdir(tmp_path) == ["flight.mcap"] and len(scenario_of(log).faults) == 2


def test_code_that_a_journal_names_runs_only_with_trust(tmp_path):
    """It lies beside a log, and may come from another user; its name and digest are told."""
    log, ran = tmp_path / "x.mcap", tmp_path / "ran"
    code = tmp_path / "law.py"
    code.write_text(
        "from pathlib import Path\nPath(__file__).with_name('ran').touch()\n"
        "class Law:\n    def __init__(self, dt, start): pass\n    def update(self, t, y, ask): return {}\n"
    )
    scenario = cosim.load_scenario("cruise", ["duration_s=0.1", f"law.file={code}"])
    journal.beside(log).write_text(scenario.expanded_toml())
    told = runner.invoke(app, ["recover", str(log)])
    assert told.exit_code == 2 and "names code: law.py, sha256 unknown. Read it, then add --trust" in told.stderr
    assert not ran.exists() and not log.exists()
    done = runner.invoke(app, ["recover", str(log), "--trust"])
    assert done.exit_code == 0 and ran.exists() and log.exists()
    sha256 = identity(code).sha256
    assert f"runs code: law.py, sha256 {sha256}" in done.stderr.splitlines()[0]
    ran.unlink()
    for command in (["info"], ["info", "--scenario"], ["recover", "-o", str(tmp_path / "whole.mcap")], ["replay"]):
        assert runner.invoke(app, [command[0], str(log), *command[1:]]).exit_code == 0
    assert not ran.exists() and str(tmp_path).encode() not in log.read_bytes()


def test_a_flight_names_the_code_that_it_runs_first(tmp_path):
    code = tmp_path / "law.py"
    code.write_text("class Law:\n    def __init__(self, dt, start): pass\n    def update(self, t, y, ask): return {}\n")
    (tmp_path / "own.toml").write_text(
        cosim.load_scenario("cruise", ["duration_s=0.1"]).expanded_toml().replace("[law]", '[law]\nfile = "law.py"')
    )
    done = runner.invoke(app, ["run", str(tmp_path / "own.toml"), "-o", str(tmp_path / "x.mcap")])
    assert done.exit_code == 0, done.output
    assert done.stderr.splitlines()[0] == f"runs code: law.py, sha256 {identity(code).sha256}"


def interrupt(t, whole):
    if t > 0.2:
        raise KeyboardInterrupt


def test_a_recovery_that_is_interrupted_keeps_the_journal_and_writes_nothing(tmp_path):
    log = tmp_path / "flight.mcap"
    journal.beside(log).write_text(cosim.load_scenario("cruise", ["duration_s=20"]).expanded_toml())
    with pytest.raises(KeyboardInterrupt):
        journal.recover(log, log, progress=interrupt)
    assert os.listdir(tmp_path) == ["flight.mcap.flown.toml"]


def test_a_flight_whose_log_is_interrupted_keeps_its_journal(tmp_path, monkeypatch):
    log = tmp_path / "flight.mcap"
    flight = cosim.Flight(cosim.load_scenario("cruise", ["duration_s=20"]), log=log)
    flight.step(400)
    monkeypatch.setattr(stepping, "simulate", functools.partial(stepping.simulate, progress=interrupt))
    assert flight.result().status == "interrupted"
    assert journal.beside(log).is_file()
