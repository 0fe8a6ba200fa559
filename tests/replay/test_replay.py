"""Replay: every detector of a log again, bit for bit, from the start and from the middle; a changed bit is found."""

import numpy as np
import pytest

import cosim
from cosim.log import open_log
from cosim.replay import ReplayError, replay
from cosim.replay.write import overlay


@pytest.fixture(scope="module")
def flight(short_log):
    return short_log


@pytest.fixture(scope="module")
def whole(flight):
    """Return the replay of all of it."""
    return replay(flight)


def test_every_detector_replays_bit_for_bit(whole):
    r = whole
    assert r.exact, r.differences
    assert {d["id"] for d in r.detectors} == set(cosim.load_scenario("liquid-ofc").running)
    assert r.values > 1e5


@pytest.mark.parametrize("start", [0.4, 2.0, 3.3, 5.9])
def test_restart_from_the_middle_is_exact(flight, whole, start):
    r = replay(flight, start_s=start)
    assert r.exact, r.differences
    assert r.skipped == 0 and (0 < r.rows < whole.rows or start < 1.0)


def test_a_log_is_written_of_a_whole_replay_alone(flight, tmp_path):
    with pytest.raises(ReplayError, match="begins with the flight"):
        replay(flight, start_s=2.0, output=tmp_path / "w.mcap")


def test_one_ulp_in_one_logged_input_is_found_and_located(flight, tmp_path):
    log = open_log(flight)
    read = {name: np.array(log.array(name)) for name in log.topics}
    column = log.topics["/sensors/left_inner"].fields.index("rod")
    read["/sensors/left_inner"][700, column] = np.nextafter(read["/sensors/left_inner"][700, column], np.inf)
    with overlay(log, [], tmp_path / "ulp.mcap") as written:
        written(read, {}, 0, log.n_ticks)
    r = replay(tmp_path / "ulp.mcap")
    assert not r.exact
    found = {d.field.split("/")[2] for d in r.differences}  # a detector may round the ulp away
    assert found and found <= {"iotsekf", "rtsekf", "rtsekf_flight", "ofc_monitor"}
    assert {d.field.split("/")[3].split(".")[0] for d in r.differences} == {"left_inner"}
    assert r.differences[0].first_tick == 700 and 0 < r.differences[0].max_abs < 1e-6


def test_changed_parameters_are_another_flight_and_are_written_beside_the_old(flight, tmp_path):
    r = replay(flight, overrides={"position_monitor": {"threshold": 0.005}}, output=tmp_path / "w.mcap")
    assert not r.exact
    assert r.changed
    rows = {(d["id"], d["target"]): d for d in r.detectors}
    old, new = (rows["position_monitor", "elevator.left_inner"][k] for k in ("logged", "replayed"))
    assert new["alarm"]
    assert old["detected_at_s"] is None or new["detected_at_s"] <= old["detected_at_s"]
    both = open_log(tmp_path / "w.mcap")
    for topic, changed in (("/detectors/iotsekf/left_inner", False), ("/detectors/position_monitor/left_inner", True)):
        assert (both.array(topic) != both.array(f"/replay{topic}")).any() == changed
    assert both.messages("/fix") == open_log(flight).messages("/fix") != []  # the aircraft's place, as it was
    assert replay(tmp_path / "w.mcap", output=tmp_path / "again.mcap").exact
    assert list(open_log(tmp_path / "again.mcap").topics) == list(both.topics)


def test_nothing_to_compare_is_not_exact(tmp_path):
    path = tmp_path / "bare.mcap"
    cosim.simulate(
        cosim.load_scenario("cruise", ["duration_s=1", "detectors.enabled=[]", "elevator.feedback=measured"]), log=path
    )
    with pytest.raises(ReplayError, match="nothing to compare"):
        replay(path)
