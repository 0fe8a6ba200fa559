"""`cosim check`: the shipped aircraft keep the contract, and what is wrong with a copy is named."""

import shutil

import pytest

import cosim
from cosim.errors import ScenarioError
from cosim.flight.check import check
from cosim.scenario.aircraft import bundled, load_aircraft


def wrong(what):
    """Return {point of the contract: what was found} of what is bad."""
    return {f["question"]: f["answer"] for f in check(what)["checks"] if f["result"] == "bad"}


@pytest.mark.parametrize("name", bundled())
def test_a_shipped_aircraft_keeps_the_contract(name):
    found = check(name)["checks"]
    assert wrong(name) == {} and len(found) >= 20
    assert any(f["question"] == "trim" and "000 ft, 290 kt: alpha" in f["answer"] for f in found)


@pytest.mark.parametrize(
    ("file", "old", "new", "point", "says"),
    [
        ("aircraft.toml", "wing_area_ft2 = 1317.5", "wing_area_ft2 = 1400.0", "geometry", "the model has 1317.5"),
        ("aircraft.toml", "engines = 2", "engines = 3", "JSBSim model", "engine[2]"),
        ("aircraft.toml", 'short = "r"', 'short = "x"', "JSBSim model", "x-"),
        ("Systems/surfaces.xml", "fcs/rudder-applied-rad", "fcs/rudder-gone-rad", "JSBSim model", "rudder-applied"),
        ("aircraft.toml", "mass_t = [48.0", "mas_t = [48.0", "record", "mass"),
        ("aircraft.toml", "mach = 0.78", "mach = 0.90", "point cruise", "beyond the aerodynamic data"),
        ("aircraft.toml", "[48.0, 77.0]", "[4.0, 77.0]", "record", "begins at 4 t; allowed: above empty_t"),
        ("aircraft.toml", "[48.0, 77.0]", "[77.0, 48.0]", "record", "mass_t = [77.0, 48.0]: must be [lowest, highest]"),
        ("aircraft.toml", "[17.0, 40.0]", "[-90.0, 40.0]", "record", "cg_pct.0 = -90.0: is out of range; allowed: 0"),
        ("aircraft.toml", "xx = 16.6", "xx = 166.0", "JSBSim model", "radii of gyration of mass.gyration2_m2"),
        ("aircraft.toml", "arm = 0.075", "armm = 0.075", "record", "actuators.hydraulic.armm = 0.075: unknown key"),
        ("aircraft.toml", "arm = 0.075", "arm = -0.075", "record", "actuators.hydraulic.arm = -0.075: is out of range"),
        ("aircraft.toml", 'actuator = "ema"', 'actuator = "steam"', "actuators", "unknown steam; allowed: hydraulic"),
        ("narrowbody.xml", "</fdm_config>", "", "JSBSim model", "XML parse error: no element found"),
        ("narrowbody.xml", "<emptywt unit=\"KG\"> 33000.0", "<emptywt unit=\"KG\"> 3000.0", "JSBSim model",
         "it weighs 40.0 t where the record asks for 70.0 t"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, file, old, new, point, says):
    folder = shutil.copytree(load_aircraft("narrowbody").folder, tmp_path / "narrowbody")
    path = folder / file
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    found = wrong(folder)
    assert says in found[point], found


def test_a_reversed_surface_is_named(tmp_path):
    folder = shutil.copytree(load_aircraft("narrowbody").folder, tmp_path / "narrowbody")
    path = folder / "aerodynamics.xml"
    path.write_text(path.read_text().replace("<p> aero/Cn_dr </p>", "<v> -1.0 </v> <p> aero/Cn_dr </p>"))
    assert wrong(folder).keys() == {"effector dr"}


def test_a_model_that_jsbsim_cannot_read_is_one_line(tmp_path):
    """JSBSim raises, returns false or ends the process, by what is wrong; none of it ends a flight without a word."""
    whole = load_aircraft().folder
    for name, old, new in (("nonsense", "<", "&"), ("cut", "</aerodynamics>", ""), ("property", "aero/", "ae ro/")):
        folder = shutil.copytree(whole, tmp_path / name)
        text = (folder / f"{whole.name}.xml").read_text()
        (folder / f"{name}.xml").write_text(text.replace(old, new) if old in text else "<x>")
        with pytest.raises(ScenarioError, match=rf"{name}\.xml: JSBSim cannot fly the model") as told:
            cosim.linearize(cosim.load_scenario("cruise", [f"flight.aircraft={str(folder)!r}"]))
        assert "\n" not in str(told.value)
