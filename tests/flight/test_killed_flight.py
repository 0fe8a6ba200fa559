"""A flight by hand, or live, killed before it writes its log: what was flown comes back, with what was injected."""

import os
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

from typer.testing import CliRunner

import cosim
from cosim.cli.commands import app
from cosim.flight import journal
from cosim.replay import replay
from cosim.scenario import parse

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
