"""A flight by hand: what is injected flies, is logged, and replays; the log is that of the scenario it came to."""

import pytest

import cosim
from cosim.errors import ScenarioError
from cosim.flight.simulate import simulate
from cosim.replay import replay

SHORT = ["duration_s=6", "flight.turbulence=light"]
OFC = {"target": "elevator.left_inner", "kind": "ofc_liquid", "amplitude_mm": 8.0, "frequency_hz": 2.0}


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Fly 2 s, break an elevator, fly 2 s, mend it, fly 1 s."""
    path = tmp_path_factory.mktemp("hands") / "flight.mcap"
    seen = []
    with cosim.Flight(cosim.load_scenario("cruise", SHORT), log=path) as flight:
        assert flight.step(400) == 400
        seen.append(flight.signals["truth.aircraft.de_li"])
        fault = flight.inject(**OFC)
        for _ in range(20):
            flight.step(20)
            seen.append(flight.signals["truth.aircraft.de_li"])
        flight.heal(fault)
        flight.step(200)
    return path, flight, seen


def test_what_is_injected_flies_and_is_found(flown):
    _, flight, seen = flown
    assert max(seen) - min(seen) > 0.02 and flight.time == 5.0
    result = flight.result()
    noticed = [d["id"] for d in result.detectors if d["detection_delay_s"] is not None]
    assert "iotsekf" in noticed and result.faults[0]["start_s"] == 2.0
    told = result.to_dict()
    assert told["consequences"]["nz_max_g"] > 1.0 and told["achieved"]["left_inner"]["surface_deg"] > 1.0


def test_the_log_holds_the_fault_replays_and_is_that_of_its_scenario(flown, tmp_path):
    path, flight, seen = flown
    log = cosim.open_log(path)
    de = log.frame("/truth/aircraft")["de_li"].to_numpy()
    assert [de[400 + 20 * i - 1] for i in range(1, 21)] == seen[1:]  # bit for bit what was stepped
    assert replay(path).exact
    simulate(flight.flown(), log=tmp_path / "again.mcap", achieved=True, timed=False)
    assert (tmp_path / "again.mcap").read_bytes() == path.read_bytes()
    active = log.frame("/faults/f0_left_inner")["active"]
    assert active.iloc[399] == 0.0 and active.iloc[400] == 1.0 and active.iloc[800] == 0.0


def test_signals_have_one_value_under_each_name():
    flight = cosim.Flight(cosim.load_scenario("cruise", SHORT))
    assert flight.step(3) == 3 and flight.step(0) == 0
    by = flight.signals
    assert by["n_z"] == by["sensors.n_z.y"] and by["left_inner.rod"] == by["sensors.left_inner_rod.y"]
    for wrong in ("nz", "rod", "truth.aircraft.nzz"):
        with pytest.raises(ScenarioError):
            by[wrong]


def test_a_flight_ends_with_its_scenario_and_refuses_what_cannot_be():
    flight = cosim.Flight(cosim.load_scenario("cruise", ["duration_s=0.1"]))
    with pytest.raises(ScenarioError, match="nothing was flown"):
        flight.result()
    with pytest.raises(ScenarioError, match=r"Did you mean"):
        flight.inject(target="elevator.left_inner", kind="jam_sollid")
    flight.step(10)
    with pytest.raises(ScenarioError, match="has passed"):
        flight.inject(**OFC, start_s=0.0)
    with pytest.raises(ScenarioError, match="no fault of this number"):
        flight.heal(0)
    fault = flight.inject(target="rudder", kind="jam")
    flight.step(2)
    flight.heal(fault)
    with pytest.raises(ScenarioError, match="healed already"):
        flight.heal(fault)
    assert flight.step(1000) == 8 and flight.status == "completed" and flight.step() == 0
    with pytest.raises(ScenarioError, match="completed"):
        flight.inject(**OFC)
    assert "jam on rudder" in repr(flight)


def test_a_flight_that_is_killed_leaves_the_scenario_as_it_was_changed_last(tmp_path):
    log = tmp_path / "flight.mcap"
    flight = cosim.Flight(cosim.load_scenario("cruise", ["duration_s=1"]), log=log)
    flight.step(100)
    fault = flight.inject(**OFC)
    flight.step(50)
    flight.heal(fault)  # killed here
    assert [p.name for p in tmp_path.iterdir()] == ["flight.mcap.flown.toml"]
    cosim.simulate(tmp_path / "flight.mcap.flown.toml", log=tmp_path / "again.mcap", timed=False, achieved=True)
    flight.step(50)
    flight.close()
    assert [f.end_s for f in flight.scenario.faults] == [0.75]
    assert (tmp_path / "again.mcap").read_bytes() == log.read_bytes()
