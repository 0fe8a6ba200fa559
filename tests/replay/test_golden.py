"""Golden flights: the recorded ones replay bit for bit, their faults trip alarms, their numbers are as reviewed."""

import shutil
import subprocess

import pytest
from fingerprint import fingerprint
from golden import FLIGHTS, FOLDER, fly
from mcap.reader import NonSeekingReader

from cosim.log import open_log
from cosim.replay import replay

flown = pytest.mark.parametrize("name", FLIGHTS)


def test_every_golden_flight_is_there():
    assert {p.stem for p in FOLDER.glob("*.mcap")} == set(FLIGHTS)


@flown
def test_a_golden_flight_replays_bit_for_bit_and_alarms(name):
    path, ids = FOLDER / f"{name}.mcap", FLIGHTS[name].detectors
    r = replay(path, detectors=ids)
    assert r.exact, f"{r.differences[:5]}: meant? `python tests/helpers/golden.py` writes them anew"
    assert {d["id"] for d in r.detectors} == set(ids)
    for d in r.detectors:
        if d["id"] in FLIGHTS[name].alarmed and d["replayed"]["concerned"]:
            assert d["replayed"]["detected_at_s"] is not None, d["id"]
            assert d["replayed"]["isolated"] is not None, d["id"]
    assert replay(path, detectors=ids, start_s=2.7).exact


@flown
def test_readers_that_are_not_ours_accept_a_golden_flight(name):
    path = FOLDER / f"{name}.mcap"
    with path.open("rb") as file:
        count = sum(1 for _ in NonSeekingReader(file, validate_crcs=True).iter_messages(log_time_order=False))
    assert count == sum({t.channel: t.rows for t in open_log(path).topics.values()}.values())
    if shutil.which("rerun"):
        told = subprocess.run(["rerun", "mcap", "check", str(path)], capture_output=True, text=True)
        assert told.returncode == 0, told.stdout + told.stderr


@flown
def test_the_fingerprint_is_that_of_the_log(name):
    path = FOLDER / f"{name}.mcap"
    assert path.with_suffix(".txt").read_text() == fingerprint(open_log(path))
    assert path.stat().st_size < 900_000 and path.with_suffix(".txt").stat().st_size < 20_000
    assert open_log(path).complete


def test_the_command_writes_a_flight_that_replays(tmp_path):
    first, second = (fly("ema-position-bias", tmp_path / n) for n in ("a", "b"))
    assert first.read_bytes() == second.read_bytes()
    assert replay(first).exact
