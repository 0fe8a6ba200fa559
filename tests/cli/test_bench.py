"""`cosim bench --compare` puts two states of the code beside each other and refuses what is no outcome of it."""

import json
import sys

import pytest
from rich.console import Console

from cosim import bench, load_scenario
from cosim.bench import worker_mb
from cosim.bench.ticks import ELEVEN, measure
from cosim.cli.bench import compared, read_bench
from cosim.errors import CosimError
from fdi import registry


def test_the_cases_are_ratios_to_one_flight_without_anything(tmp_path):
    told = []
    rows, rate = measure(tmp_path, 1, told.append)
    assert told == [1]
    by = {row["name"]: row for row in rows}
    assert by["bare"]["against"] == "B747" and by["lockstep"]["against"] == "bare"
    assert 1.0 < by["lockstep"]["ratio"] < by["detectors"]["ratio"]
    with_log, without = by["detectors, log"]["ratio"], by["detectors"]["ratio"]
    assert 0.0 < by["the log of detectors alone"]["ratio"] == pytest.approx(with_log - without, abs=0.5)
    assert set(ELEVEN) < set(registry.SHIPPED) and len(ELEVEN) == 11
    assert rate["lockstep"] > rate["with_detectors"] > 0


def test_two_states_stand_beside_each_other(tmp_path):
    def outcome(ratio):
        case = {"name": "lockstep", "ratio": ratio, "against": "bare"}
        detectors = [{"id": "rfafe", "batch_us": 0.3}]
        return {"cases": [case], "startup": {"run_s": 2.0}, "detectors": detectors, "peak_mb": None, "recorded": None}

    path = tmp_path / "before.json"
    path.write_text(json.dumps(outcome(6.0)))
    console = Console(width=120)
    with console.capture() as shown:
        console.print(compared(read_bench(path), outcome(3.0)))
    line = next(x for x in shown.get().splitlines() if "lockstep" in x)
    assert [x for x in line.split() if x[0].isdigit()] == ["6", "3", "0.5"]
    assert "rfafe, batch [us per step]" in shown.get()  # its unit is no markup


def test_the_memory_of_a_worker_is_its_own(monkeypatch):
    small = "import resource; print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    monkeypatch.setattr(sys.modules[worker_mb.__module__], "_WORKER", small)
    held = bytearray(400_000_000)
    held[::4096] = b"x" * len(held[::4096])  # of the process that measures
    assert 0 < worker_mb() < 100


def test_every_detector_of_a_flight_has_its_cost_live_and_in_batch(monkeypatch):
    monkeypatch.setattr(bench, "SAMPLE_TICKS", 100)
    scenario = load_scenario("liquid-ofc")
    found = {d["id"]: d for d in bench._detectors(scenario)}
    assert set(found) == set(scenario.running) and found["iotsekf"]["lanes"] == 2
    assert all(d["live_us"] > 0.0 and d["batch_us"] > 0.0 for d in found.values())


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"cases": 1}'])
def test_another_file_is_refused(tmp_path, text):
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(CosimError, match="no outcome"):
        read_bench(path)
