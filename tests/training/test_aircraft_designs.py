"""Designs and thresholds of another aircraft: who has them flies with them, who has none or others says so."""

import json
import shutil

import numpy as np
import pytest

import cosim
from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import left_out
from cosim.flight.plant import estimate
from cosim.flight.plant.force_model import force_model
from cosim.scenario.aircraft import load_aircraft, load_record
from cosim.training import designs, train_aircraft
from cosim.training.__main__ import main
from cosim.training.flights import fits, fly_level
from fdi import registry
from fdi.common.tuning import thresholds

LEVEL = {"rfafe", "lpv_smo", "control_redundancy"}
TWIN = load_aircraft("narrowbody")
POINT = ["flight.mass_t=64", "flight.altitude_ft=20000", "flight.cas_kt=280"]


@pytest.fixture
def copied(tmp_path):
    """Copy the narrow-body into a folder of its own, with its designs."""
    folder = shutil.copytree(TWIN.folder, tmp_path / "mine")
    (folder / "narrowbody.xml").rename(folder / "mine.xml")
    return folder


def flown(aircraft, *changes):
    return cosim.load_scenario("cruise", [f"flight.aircraft={aircraft}", *POINT, *changes])


def test_a_folder_with_designs_flies_with_them(copied):
    assert left_out(flown(copied)) == {} and not any(designs.check(str(copied)).values())


def test_a_folder_without_says_so_with_the_command(copied):
    shutil.rmtree(copied / "thresholds")
    found = left_out(flown(copied))
    assert set(found) == LEVEL
    assert found["lpv_smo"] == f"no design for mine (`python -m cosim.training all --aircraft {copied}`)"


def test_designs_of_other_numbers_are_not_flown_with(copied):
    text = (copied / "aerodynamics.xml").read_text()
    (copied / "aerodynamics.xml").write_text(text.replace("5.", "5.1", 1))
    found = left_out(flown(copied))
    assert set(found) == LEVEL and "of other numbers than mine has" in found["rfafe"]


def test_a_copy_named_as_the_default_aircraft_is_not_taken_for_it(tmp_path):
    folder = shutil.copytree(load_aircraft().folder, tmp_path / "transport")
    s = cosim.load_scenario("cruise", [f"flight.aircraft={folder}"])
    assert set(left_out(s)) == LEVEL


def test_a_twin_has_all_of_its_thrust_and_elevator_in_the_force_model():
    model, four = force_model(TWIN.folder), force_model()
    assert model.engine.shape == four.engine.shape == (4, 3)
    sea_level = np.interp(101325.0, model.thrust_p, model.mil[0])
    assert 4 * sea_level == pytest.approx(2 * 111200.0, rel=0.01)  # static take-off thrust
    np.testing.assert_allclose(model.engine[:, 1].sum(), 0.0, atol=1e-9)
    np.testing.assert_array_equal(model.structure(), four.structure())


def test_own_thresholds_replace_those_fields_that_they_have():
    base, mine = thresholds("kinematic"), thresholds("kinematic", "flight", TWIN.folder)
    assert base.keys() == mine.keys() and base["threshold"] != mine["threshold"]
    of_row = [thresholds("control_redundancy", "flight", folder) for folder in (None, TWIN.folder)]
    assert of_row[0]["rel"] == of_row[1]["rel"] and of_row[0]["threshold"] != of_row[1]["threshold"]
    p = registry.record("kinematic").fit(site(0.005, own=TWIN))
    np.testing.assert_allclose(p["threshold"][0], mine["threshold"])


def test_a_threshold_that_no_detector_has_is_refused(copied):
    (copied / "thresholds" / "kinematic.json").write_text(json.dumps({"flight": {"treshold": 1.0}}))
    with pytest.raises(ValueError, match=r"kinematic has no threshold 'treshold'"):
        thresholds("kinematic", "flight", copied)


def test_training_flights_are_flights_of_that_aircraft():
    flight = train_aircraft.arguments(5, 7, str(TWIN.folder))
    low, high = TWIN.mass.mass_t
    assert low <= flight["flight"]["mass_t"] <= high and len(flight["technology"]) == len(TWIN.segments)
    assert flight == train_aircraft.arguments(5, 7, str(TWIN.folder))


def test_three_engines_leave_out_who_reads_four_and_train_the_others(copied, capsys):
    (copied / "aircraft.toml").write_text((copied / "aircraft.toml").read_text().replace("engines = 2", "engines = 3"))
    for file, text in estimate.build(load_record(str(copied)), copied / "numbers.toml").items():
        (copied / file).write_text(text)
    assert left_out(flown(copied))["control_redundancy"] == "it reads n1_4, the aircraft has 3 engines"
    three = load_aircraft(str(copied))
    assert fits(three) == ("lpv_smo", "kinematic", "rfafe", "rfafe_airframe")
    frame = fly_level(**train_aircraft.arguments(0, 7, str(copied)) | {"duration": 0.5})
    assert main(["all", "--aircraft", str(copied)]) == 2
    assert "3 engines; allowed: 1, 2 or 4" in capsys.readouterr().err
    assert len(frame) == 100 and "control_redundancy" not in designs.check(str(copied))


def test_an_oscillation_is_seen_on_the_twin_by_who_sees_it_on_the_transport():
    fault = ["faults.0.target=elevator.all", "faults.0.kind=ofc_liquid", "faults.0.at=command", "faults.0.start_s=12",
             "faults.0.amplitude_deg=2", "faults.0.frequency_hz=1", "duration_s=24"]  # fmt: skip
    found = {d["id"]: d for d in cosim.simulate(flown("narrowbody", *fault)).detectors if d["target"] == "aircraft"}
    for name in ("rfafe", "lpv_smo"):
        assert found[name]["detection_delay_s"] is not None and found[name]["false_alarms"] == 0, name
