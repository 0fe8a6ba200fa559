"""Scenarios: defaults, built-ins, and their numbers in SI."""

import math
import tomllib

import pytest
from scenario_tables import fault, flight

from cosim.campaign.inventory import inventory
from cosim.errors import CosimError
from cosim.flight.plant.point import FlightPoint
from cosim.scenario import builtin_names, load_scenario, parse
from cosim.scenario import catalog as c
from cosim.scenario.elevator import Elevator
from cosim.scenario.fault import Fault
from cosim.scenario.flight import cas_kt
from cosim.scenario.model import Sensors
from fdi.registry import DEFAULT


def test_default_scenario_is_the_one_of_the_design():
    s = load_scenario()
    assert (s.flight.mass_t, s.flight.cg_pct, s.flight.altitude_ft, s.flight.cas_kt) == (200, 30, 20000, 290)
    assert s.elevator.technology == dict(zip(c.SEGMENTS, ("hydraulic", "hydraulic", "ema", "ema")))
    (f,) = s.faults
    assert (f.target, f.kind, f.start_s) == ("elevator.left_inner", "ofc_liquid", 12.0)
    assert set(s.detectors.enabled) == set(DEFAULT)


@pytest.mark.parametrize("name", builtin_names())
def test_builtin_loads_has_a_title_and_expands_to_itself(name):
    s = load_scenario(name)
    assert s.title
    assert s.warnings() == []
    text = s.expanded_toml()
    assert parse(tomllib.loads(text)) == s
    assert parse(tomllib.loads(text)).expanded_toml() == text


def test_every_kind_of_fault_is_flown_by_a_builtin_and_listed_once():
    flown = [load_scenario(n) for n in builtin_names()]
    assert {f.kind for s in flown for f in s.faults} == set(c.ALL_KINDS)
    listed = {(f["place"], f["kind"]) for f in inventory()["faults"]}
    assert len(listed) == len(inventory()["faults"])


def test_the_listed_keys_are_those_of_a_scenario():
    keys = inventory()["keys"]
    assert set(keys["[elevator]"]) - {"<segment>"} == set(Elevator.model_fields) - set(c.SEGMENTS)
    of_a_kind = {"limit_deg", "chirp_hz_s"}
    assert set(keys["[[faults]], every kind"]) - of_a_kind == set(Fault.model_fields) - {"target", "kind"}
    assert len(keys["amplitude of ofc_liquid, ofc_solid"]) == len(c.AMPLITUDES_AT)
    for key in keys["[sensors], a table per sensor"]:
        name = key.replace("<unit>", inventory()["units"]["alpha"][0])
        where = f"sensors.{name}" if name in Sensors.model_fields else f"sensors.alpha.{name}"
        load_scenario("cruise", [f"{where}={ {'scale': 1, 'noise_scale': 1, 'reconstructed': 'true'}.get(name, 0.01)}"])


def test_names_of_builtins_that_papers_and_pages_use_exist():
    asked = """cruise liquid-ofc solid-ofc liquid-jam solid-jam runaway ema-velocity-bias ema-position-scale
        ema-current-bias alpha-bias alwi14-simultaneous alwi14-simultaneous-literal thrust-loss
        elevator-lock-then-thrust-loss"""
    assert set(asked.split()) <= set(builtin_names())


def test_numbers_come_out_in_si():
    s = flight(
        fault("elevator.left_inner", "ofc_liquid", at="command", amplitude_deg=2.0, frequency_hz=2.0, phase_deg=90.0),
        fault("elevator.right.position", "scale", scale=1.25),
        fault("sensor.cas", "drift", drift_kt_s=1.0, end_s=20.0),
        fault("engine.all", "thrust_loss", loss_pct=25.0),
        fault("elevator.left_outer", "runaway", rate_deg_s=-20.0, limit_deg=-5.0),
        fault("elevator.all", "jam_liquid", bias_deg=1.0),
        fault("aileron.left", "jam"),
        fault("elevator.right", "ofc_solid", at="command", amplitude_travel=0.033, frequency_hz=1.0),
    )
    ofc, scale_i, scale_o, drift, *thrust, runaway = s.injections()[:9]
    jams, travel = s.injections()[9:13], s.injections()[14:]
    assert [j.sensor for j in jams] == ["rod", "rod", "position", "position"]  # that closes the loop
    assert [math.degrees(j.magnitude) for j in travel] == pytest.approx([1.32, 1.32])  # [Sun13], 0.033 of 40 deg
    assert ofc.magnitude == pytest.approx(math.radians(2)) and ofc.unit == "rad"
    assert ofc.omega == pytest.approx(4 * math.pi) and ofc.phase == pytest.approx(math.pi / 2)
    assert ofc.end == math.inf
    assert (scale_i.name, scale_o.name, scale_i.sensor) == ("right_inner", "right_outer", "position")
    assert scale_i.magnitude == 0.25 and scale_i.path == "loop"
    assert (
        drift.magnitude == pytest.approx(1852 / 3600)
        and drift.unit == "m/s/s"
        and drift.path == "all"
        and drift.end == 20
    )
    assert [t.name for t in thrust] == ["1", "2", "3", "4"] and {t.magnitude for t in thrust} == {0.25}
    assert runaway.magnitude == pytest.approx(math.radians(-20)) and runaway.limit == pytest.approx(math.radians(-5))
    point = FlightPoint.of(s)
    assert (point.speed_kind, point.speed) == ("cas", pytest.approx(149.189, abs=1e-3))
    assert point.altitude == pytest.approx(6096)


def test_sensor_settings_in_si():
    s = flight(sensors={"alpha": {"sigma_deg": 0.1, "scale": 1.02, "delay_s": 0.02}, "pressure": {"bias_pct": 1.0}})
    alpha = {"sigma": math.radians(0.1), "scale": 0.02, "delay": 0.02}
    assert s.sensors.setting("alpha") == pytest.approx(alpha)
    assert s.sensors.setting("pressure") == pytest.approx({"bias": 0.01})
    assert s.sensors.setting("q") == {}


def test_the_path_at_the_start_is_told_in_words_with_its_direction():
    told = {"climb_fpm=1000": "climb of 1000 ft/min", "climb_fpm=-1000": "descent of 1000 ft/min",
            "gamma_deg=3": "climb at 3 deg", "gamma_deg=-3": "descent at 3 deg", "turn_deg_s=-1": "turn of -1 deg/s"}
    for key, words in told.items():
        assert load_scenario("cruise", [f"flight.{key}"]).flight.path == words


def test_a_mach_number_or_true_airspeed_is_held_against_the_calibrated_limit():
    """Values of the tables of the standard atmosphere: Mach .8 at 35,000 ft is 272 kt calibrated."""
    assert cas_kt(35000.0, mach=0.8) == pytest.approx(271.9, abs=0.3)
    assert cas_kt(35000.0, tas_kt=461.1) == pytest.approx(271.9, abs=0.3)
    assert cas_kt(45000.0, mach=0.85) == pytest.approx(230.9, abs=0.3)  # above the tropopause, at 14.748 kPa
    assert cas_kt(0.0, mach=0.5) == pytest.approx(cas_kt(0.0, tas_kt=0.5 * 661.47), rel=1e-4)
    for speed in ("flight.mach=0.914", "flight.tas_kt=480"):
        with pytest.raises(CosimError, match=r"calibrated at 360 ft.*up to"):
            load_scenario("cruise", ["flight.mass_t=308", "flight.altitude_ft=360", speed])
    load_scenario("cruise", ["flight.altitude_ft=35000", "flight.mach=0.84"])
