"""What it takes to add an actuator technology or an aircraft: a copy of a shipped folder flies, bit for bit, with no
other file touched but, for a technology, the line that registers it.
"""

import importlib
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import technologies

import actuators.hydraulic.record as shipped
import cosim
from cosim.errors import ScenarioError
from cosim.flight.plant.force_model import force_model
from cosim.scenario import catalog
from cosim.scenario.aircraft import load_aircraft

SHORT = ["duration_s=1.5", "faults.0.start_s=0.5", "detectors.enabled=[]", "elevator.feedback=measured"]
SEEN = ["truth.aircraft.de_li", "truth.aircraft.q", "sensors.left_inner_rod.y_obs", "sensors.left_inner_pressure.y_obs"]


def flown(*changes):
    return cosim.fly(cosim.load_scenario("liquid-ofc", [*SHORT, *changes]), SEEN).to_numpy()


@pytest.fixture
def rig(tmp_path, monkeypatch):
    """Register a throw-away technology: the hydraulic folder under other names."""
    folder = shutil.copytree(Path(shipped.__file__).parent, tmp_path / "rig_folder")
    for path in folder.glob("*.py"):
        text = path.read_text().replace("actuators.hydraulic", "rig_folder")
        for old, new in (("servo", "rig_servo"), ("hydraulic", "rig"), ("valve_command", "rig_command")):
            text = text.replace(f'"{old}"', f'"{new}"')
        path.write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    catalog.register(importlib.import_module("rig_folder.record").TECHNOLOGY)  # the one line
    yield "rig"
    technologies.forget()
    for name in [n for n in sys.modules if n.startswith("rig_folder")]:
        del sys.modules[name]


def test_a_copied_technology_flies_like_its_template(rig):
    own = flown("elevator.left_inner=rig")
    np.testing.assert_array_equal(own, flown())
    s = cosim.load_scenario("cruise", ["elevator.left_inner=rig", "tolerances.rig.P_s=0.9"])
    assert (s.elevator.feedback["left_inner"], s.tolerances.rig) == ("measured", {"P_s": 0.9})
    assert "rig" in catalog.ELEVATOR_KINDS["air_in_oil"].technologies


def test_a_copied_aircraft_flies_like_its_template(tmp_path):
    folder = shutil.copytree(load_aircraft().folder, tmp_path / "own")
    (folder / "transport.xml").rename(folder / "own.xml")
    np.testing.assert_array_equal(flown(f"flight.aircraft={folder}"), flown())


def test_a_record_says_what_is_wrong_with_it(tmp_path):
    folder = shutil.copytree(load_aircraft().folder, tmp_path / "own")
    with pytest.raises(ScenarioError, match=r"own: there is no own\.xml, its JSBSim model"):
        load_aircraft(str(folder))
    record = shutil.copytree(folder, tmp_path / "many") / "aircraft.toml"
    record.write_text(record.read_text().replace("engines = 4", "engines = 40"))
    with pytest.raises(ScenarioError, match=r"many/aircraft\.toml:\d+: engines"):
        load_aircraft(str(record.parent))
    with pytest.raises(ScenarioError, match=r"'transprt' is no aircraft.*Did you mean 'transport'"):
        load_aircraft("transprt")


def test_an_edited_folder_is_read_again_in_the_same_process(tmp_path):
    folder = shutil.copytree(load_aircraft().folder, tmp_path / "own")
    (folder / "transport.xml").rename(folder / "own.xml")
    first, model = load_aircraft(str(folder)), force_model(folder)
    assert load_aircraft(str(folder)) is first and force_model(folder) is model
    record, aero = folder / "aircraft.toml", folder / "aerodynamics.xml"
    record.write_text(record.read_text().replace(f'title = "{first.title}"', 'title = "Another"'))
    aero.write_text(aero.read_text().replace("<v> -0.02", "<v> -0.03"))
    assert load_aircraft(str(folder)).title == "Another"
    assert force_model(folder) is not model
    record.write_text(record.read_text().replace("mass_t", "mas_t"))
    with pytest.raises(ScenarioError, match=r"own/aircraft\.toml:\d+: mass"):
        cosim.load_scenario("cruise", [f"flight.aircraft={folder}"])
