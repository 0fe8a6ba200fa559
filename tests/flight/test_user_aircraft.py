"""An aircraft is a folder: a copy of a shipped one flies, bit for bit, with no other file touched."""

import shutil

import numpy as np
import pytest

import cosim
from cosim.errors import ScenarioError
from cosim.flight.plant.force_model import force_model
from cosim.scenario.aircraft import load_aircraft

SEEN = ["truth.aircraft.de_li", "truth.aircraft.q", "sensors.left_inner_rod.y_obs", "sensors.left_inner_pressure.y_obs"]


@pytest.fixture
def folder(tmp_path):
    own = shutil.copytree(load_aircraft().folder, tmp_path / "own")
    (own / "transport.xml").rename(own / "own.xml")
    return own


def test_a_copied_aircraft_flies_like_its_template(folder):
    keys = ["duration_s=1.5", "faults.0.start_s=0.5", "detectors.enabled=[]", "elevator.feedback=measured"]
    own, template = (cosim.fly(cosim.load_scenario("liquid-ofc", [*keys, *more]), SEEN).to_numpy()
                     for more in ([f"flight.aircraft={folder}"], []))  # fmt: skip
    np.testing.assert_array_equal(own, template)


def test_an_edited_folder_is_read_again_in_the_same_process_and_a_wrong_one_refused(folder):
    first, model = load_aircraft(str(folder)), force_model(folder)
    assert load_aircraft(str(folder)) is first and force_model(folder) is model
    record, aero = folder / "aircraft.toml", folder / "aerodynamics.xml"
    record.write_text(record.read_text().replace(f'title = "{first.title}"', 'title = "Another"'))
    aero.write_text(aero.read_text().replace("<v> -0.02", "<v> -0.03"))
    assert load_aircraft(str(folder)).title == "Another" and force_model(folder) is not model
    text = record.read_text()
    record.write_text(text.replace("engines = 4", "engines = 40"))
    with pytest.raises(ScenarioError, match=r"own/aircraft\.toml:\d+: engines"):
        cosim.load_scenario("cruise", [f"flight.aircraft={folder}"])
    record.write_text(text)
    (folder / "own.xml").unlink()
    with pytest.raises(ScenarioError, match=r"own: there is no own\.xml, its JSBSim model"):
        load_aircraft(str(folder))
    with pytest.raises(ScenarioError, match=r"'transprt' is no aircraft.*Did you mean 'transport'"):
        load_aircraft("transprt")
