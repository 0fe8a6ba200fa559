"""`joint` in a flight: it steps after what it reads, replays bit for bit, and flies with whatever else flies."""

import pytest

import cosim
from cosim.flight.build import build
from cosim.log import open_log
from cosim.replay import replay
from fdi.joint import hypotheses, joint

OFC = "faults.0={target='elevator.left_inner', kind='ofc_liquid', amplitude_mm=5, frequency_hz=2, start_s=1.5}"
NARROW = {"aircraft": "narrowbody", "mass_t": 60.0, "cg_pct": 25.0, "altitude_ft": 20000.0, "cas_kt": 270.0}
KEYS = ["duration_s=4", OFC, "detectors.enabled=['joint', 'ofc_monitor', 'position_monitor']"]


def test_it_alarms_with_its_first_witness_and_replays_bit_for_bit(tmp_path):
    log = tmp_path / "joint.mcap"
    result = cosim.simulate(cosim.load_scenario("cruise", KEYS), log=log)
    seen = {(d["id"], d["target"]): d["detected_at_s"] for d in result.detectors if d["detected_at_s"] is not None}
    assert seen["joint", "aircraft"] == min(seen.values())
    whole, alone = replay(log), replay(log, detectors=["joint"])
    assert whole.exact and alone.exact
    flown = open_log(log)
    fields = flown.topics["/detectors/joint/aircraft"].fields
    assert set(joint.OUTPUTS) <= set(fields)


@pytest.mark.parametrize("more, lanes", [
    ([f"flight.{k}={v}" for k, v in NARROW.items()], {"left_inner", "right_inner"}),
    ([f"elevator.{s}=ema" for s in hypotheses.SEGMENTS], set(hypotheses.SEGMENTS)),
    ([f"elevator.{s}=simple" for s in hypotheses.SEGMENTS], set()),
])  # fmt: skip
def test_any_aircraft_and_any_mix_of_technologies_is_flown(more, lanes):
    keys = ["detectors.enabled=['joint', 'ofc_monitor', 'ema_kalman_flight', 'kinematic']", *more]
    block = next(d for d in build(cosim.load_scenario("cruise", keys)).loop.detectors if d.name == "joint")
    rows = block.p["row"][0, : int(block.p["n_h"][0])].T  # of a lane that no fault concerns one row for all hypotheses
    concerned = {lane for (_, lane), row in zip(hypotheses.LANES, rows) if len(set(row)) > 1 and lane != "aircraft"}
    assert concerned == lanes


def test_a_flight_without_it_has_none_of_it():
    scenario = cosim.load_scenario("cruise", ['detectors.enabled=["kinematic"]'])
    assert "joint" not in {d.name for d in build(scenario).loop.detectors}
