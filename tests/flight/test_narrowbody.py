"""The narrow-body: its files are what its numbers make, it trims over its envelope, its modes are those of the
handbooks' formulas, and it flies with two segments and two engines.
"""

import math
import shutil

import pytest
from typer.testing import CliRunner

import cosim
from actuators.constants import G0
from cosim.cli import commands as cli
from cosim.errors import ScenarioError
from cosim.flight.detection.detectors import left_out
from cosim.flight.plant import estimate
from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.plant import Plant
from cosim.flight.plant.point import FlightPoint
from cosim.replay import replay
from cosim.report import flight_report
from cosim.scenario.aircraft import load_aircraft

AIRCRAFT = load_aircraft("narrowbody")
FILE = AIRCRAFT.folder / "numbers.toml"
NUMBERS = estimate.numbers(FILE)


def test_the_files_are_what_the_numbers_make():
    for file, text in estimate.build(AIRCRAFT, FILE).items():
        assert (AIRCRAFT.folder / file).read_text(encoding="utf-8") == text, file


def new(name, folder, *more):
    return CliRunner().invoke(cli.app, ["new", "aircraft", name, "-o", str(folder), *map(str, more)])


def test_a_template_that_is_filled_in_becomes_an_aircraft(tmp_path):
    folder = tmp_path / "mine"
    told = new("mine", tmp_path)
    assert told.exit_code == 0 and f"--numbers{folder}/numbers.toml" in "".join(told.stdout.split())
    assert sorted(p.name for p in folder.iterdir()) == ["aircraft.toml", "numbers.toml"]
    told = new("mine", tmp_path, "--numbers", folder / "numbers.toml")
    assert told.exit_code == 0 and f"--aircraft{folder}" in "".join(told.stdout.split()), told.output
    made = {p.relative_to(folder).as_posix() for p in folder.rglob("*.xml")}
    assert made == {*estimate.build(load_aircraft(str(folder)), FILE)}
    for file in made:
        wanted = (AIRCRAFT.folder / file.replace("mine", "narrowbody")).read_text()
        assert (folder / file).read_text().replace("mine", "narrowbody") == wanted


def test_every_number_of_the_template_is_explained():
    for line in (AIRCRAFT.folder / "aircraft.toml").read_text().splitlines():
        if line.startswith(("tail_arm", "downwash", "station", "reference", "mass_t", "empty", "fuel", "alpha", "J_N")):
            assert "#" in line, line


@pytest.mark.parametrize(
    ("old", "by", "says"),
    [
        ("= 122.4,", "= 0.0,", ":11: wing.area_m2.value = 0.0: is out of range; allowed: above 0 to 3000"),
        ("= 33.91,", "= 300.0,", ":12: wing.span_m.value = 300.0: is out of range; allowed: above 0 to 200"),
        ("= 122.4,", "= nan,", ":11: wing.area_m2.value = nan: is out of range; allowed: above 0 to 3000"),
        ("{ value = 122.4,", "{", ":11: wing.area_m2.value: is missing; allowed: above 0 to 3000"),
        ("oswald =", "oswlad =", ":63: drag.oswlad: unknown key; allowed: friction, wetted, oswald"),
        ("[engine]", "[engi", ": not valid TOML"),
        ("= 122.4,", "= 100.0,", None),  # the loop's geometry is another one
        ("{ value = 33.91,", "{ value = 1.0,", ": the formulas have no value for these"),  # the tail is higher
    ],
)
def test_dimensions_without_an_aircraft_are_named(tmp_path, old, by, says):
    shutil.copy(AIRCRAFT.folder / "aircraft.toml", tmp_path)
    text = FILE.read_text()
    assert old in text
    (tmp_path / "numbers.toml").write_text(text.replace(old, by))
    told = new("mine", tmp_path, "--numbers", tmp_path / "numbers.toml")
    says = (
        f"numbers.toml{says}"
        if says
        else "aircraft.toml: geometry.wing_area_ft2 = 1317.5, numbers.toml makes it 1076.39"
    )
    assert told.exit_code == 2 and says in " ".join(told.stderr.split()), told.output
    assert not (tmp_path / "mine").exists()


def short_period(model, point):
    """Return (natural frequency [rad/s], damping) of the two-state approximation [Nelson] (4.70), (4.71)."""
    record, V, trim = AIRCRAFT, model.trim.tas, dict(zip(model.outputs, model.y0))
    plant = Plant(point)
    plant.trim()
    t = plant.truth()[0]
    c = estimate.coefficients(NUMBERS, float(t.mach))
    S, chord, mass = record.geometry.wing_area_ft2 * 0.3048**2, record.geometry.chord_ft * 0.3048, point.mass
    I = record.mass.gyration2_m2.yy * mass
    CL = mass * G0 / (t.qbar * S)
    Z = -(c["CL_alpha"] + float(estimate.drag(NUMBERS, CL, t.mach))) * t.qbar * S / mass
    Cm_alpha = c["Cm_alpha"] + c["CL_alpha"] * (point.cg - record.geometry.reference_pct / 100.0)
    M = Cm_alpha * t.qbar * S * chord / I
    Mq, Mad = (c[k] * chord / (2.0 * V) * t.qbar * S * chord / I for k in ("Cm_q", "Cm_alphadot"))
    assert trim["nz"] == pytest.approx(1.0, abs=0.01)
    w = math.sqrt(Z * Mq / V - M)
    return w, -(Mq + Mad + Z / V) / (2.0 * w)


@pytest.mark.parametrize("name", AIRCRAFT.points)
def test_short_period_and_phugoid_are_within_15_per_cent_of_the_handbook(name):
    point = FlightPoint.at(**AIRCRAFT.points[name], aircraft="narrowbody")
    model = linearize(point)
    modes = {m.name: m for m in model.modes}
    wn, zeta = short_period(model, point)
    assert modes["short_period"].wn == pytest.approx(wn, rel=0.15)
    assert modes["short_period"].zeta == pytest.approx(zeta, rel=0.15)
    assert modes["phugoid"].wn == pytest.approx(math.sqrt(2.0) * G0 / model.trim.tas, rel=0.15)  # Lanchester
    assert modes["dutch_roll"].zeta > 0.05 and modes["roll"].wn > 1.0


SCENARIO = ["flight.aircraft=narrowbody", "flight.mass_t=64", "flight.altitude_ft=20000", "flight.cas_kt=280",
            "faults.0.target=elevator.left", "faults.0.start_s=4", "faults.0.amplitude=0.02",
            "duration_s=8"]  # fmt: skip


def test_it_flies_with_two_segments_and_two_engines(tmp_path):
    s = cosim.load_scenario("liquid-ofc", SCENARIO)
    assert s.elevator.technology == {"left": "hydraulic", "right": "ema"}
    found = cosim.simulate(s, log=tmp_path / "narrow.mcap")
    assert "Elevator segments" in flight_report(tmp_path / "narrow.mcap", tmp_path / "narrow.html").read_text()
    assert replay(tmp_path / "narrow.mcap").exact
    assert found.status == "completed"
    own = {d["id"]: d for d in found.detectors}
    # its hinge load is large beside its actuator, which the responses of the evidence leave out: no name, no wrong one
    assert own["iotsekf"]["alarm"] and own["iotsekf"]["isolated"]["class"] in ("ofc_liquid", "ambiguous")
    quiet = [d for d in found.detectors if d["target"] == "elevator.right"]
    assert quiet and not any(d["alarm"] for d in quiet)
    assert left_out(s) == {} and {"rfafe", "lpv_smo", "control_redundancy"} <= set(own)


def test_a_target_of_another_aircraft_is_refused():
    with pytest.raises(ScenarioError, match=r"left_inner.*allowed: elevator\.left, elevator\.right"):
        cosim.load_scenario("liquid-ofc", [*SCENARIO, "faults.0.target=elevator.left_inner"])
    with pytest.raises(ScenarioError, match=r"mass_t = 200.*allowed: 48 to 77"):
        cosim.load_scenario("liquid-ofc", [*SCENARIO, "flight.mass_t=200"])
