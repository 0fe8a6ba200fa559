"""Control-induced redundancy: families from sparsity, the aircraft's own rows, the talk's scenarios, sensors."""

import dataclasses
import functools
import math
import shutil

import numpy as np
import pytest
from watched import watched as of_flight

import cosim
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import fly, inputs
from cosim.flight.plant.aero_functions import numbers_digest
from cosim.flight.plant.force_model import force_model
from cosim.flight.plant.plant import POINTS, Plant
from cosim.papers.mar10 import flights as mar10_flights
from cosim.papers.mar10 import rows as mar10
from cosim.scenario.aircraft import load_aircraft
from cosim.scenario.load import load_scenario
from fdi.common.verdict import AMBIGUOUS, JAM_SOLID, THRUST
from fdi.common.why import GUSTS
from fdi.control_redundancy import control_redundancy
from fdi.control_redundancy import structure as redundancy_structure
from fdi.control_redundancy.structure import TALK, families, signatures

FOLDER = load_aircraft().folder


def test_slide_10_follows_from_the_pattern_of_slide_7():
    """27 residuals, 8 signatures: 4 + 2 + 1 + 5 x 4."""
    assert signatures(TALK) == mar10.TABLE
    assert sum(signatures(TALK).values()) == 27 and len(signatures(TALK)) == 8


def test_a_transport_has_fewer_signatures():
    """Without side force of the aileron, and without linear drag of aileron and rudder."""
    for pattern, kinds in (
        ([[1, 1, 1, 1], [0, 0, 1, 0], [0, 1, 0, 0]], 6),
        ([[0, 1, 0, 1], [0, 0, 1, 0], [0, 1, 0, 0]], 4),
    ):
        assert len(signatures(np.array(pattern, bool))) == kinds


def test_no_family_repeats_another_and_signatures_are_true():
    rng = np.random.default_rng(0)
    for _ in range(50):
        pattern = rng.random((4, 5)) < 0.5
        G = np.where(pattern, rng.uniform(0.5, 2.0, pattern.shape), 0.0)
        seen = []
        for family in families(pattern):
            c, s = redundancy_structure.combination(G, family)
            np.testing.assert_array_equal(np.abs(s) > 1e-12, np.array(family.signature, bool))
            seen.append(tuple(np.round(c / np.abs(c).max(), 12)))
        assert len(set(seen)) == len(seen)


def now(truth):
    """Return INPUTS (1, 1) of the truth at one moment, commands where the surfaces are."""
    u = np.zeros((1, 1), control_redundancy.INPUTS)
    named = {"n_x": "nx", "n_y": "ny", "n_z": "nz"}
    for name in u.dtype.names:
        u[name] = 1.0 if name.endswith("_valid") else truth[named.get(name, name)]
    return u


def test_the_rows_read_from_the_xml_are_those_that_jsbsim_flies():
    """Random states, surfaces and throttles: forces within 1 mg (thrust over N1)."""
    p = control_redundancy.params(model=force_model(), delay=0, lag=(0, 0, 0, 0), t_mean=0, t_learn=0)
    rng = np.random.default_rng(0)
    plant = Plant(POINTS["A"])
    trim = plant.trim()
    for _ in range(10):
        s = trim.surfaces.copy()
        s[:8] += rng.normal(0, 0.05, 8)
        s[8:12] = np.clip(s[8:12] + rng.normal(0, 0.1, 4), 0, 1)
        plant.place(
            tas=trim.tas * (1 + 0.03 * rng.normal()), alpha=trim.alpha + 0.02 * rng.normal(), theta=trim.theta,
            altitude=trim.altitude, beta=0.03 * rng.normal(), phi=0.1 * rng.normal(),
            p=0.03 * rng.normal(), q=0.03 * rng.normal(), r=0.03 * rng.normal(), surfaces=s,
        )  # fmt: skip
        x, log = control_redundancy.init(p), np.zeros((1, 1), control_redundancy.STATE)
        control_redundancy.rollout(x, now(plant.truth()[0]), p, 0.005, log)
        assert np.abs(x["e"]).max() < 1e-3


def test_a_coefficient_that_changes_in_the_xml_changes_the_rows(tmp_path):
    folder = tmp_path / "transport"
    shutil.copytree(FOLDER, folder)
    path = folder / "aerodynamics.xml"
    text = path.read_text()
    assert numbers_digest(folder) == numbers_digest(FOLDER)
    path.write_text(text.replace("<v> 0.7 </v>", "<v> 0.77 </v>", 1))
    before, after = force_model(), force_model(folder)
    k = before.quantities.index(("lift", "stab"))
    assert after.t_m[k][0, 0] == pytest.approx(1.1 * before.t_m[k][0, 0])
    assert numbers_digest(folder) != numbers_digest(FOLDER)
    path.write_text(text.replace("<v> 0.7 </v>", "<!-- as before --> <v> 0.70 </v>", 1))
    assert numbers_digest(folder) == numbers_digest(FOLDER)


def test_a_form_that_cannot_be_tabulated_is_refused(tmp_path):
    folder = tmp_path / "transport"
    shutil.copytree(FOLDER, folder)
    path = folder / "aerodynamics.xml"
    old = "<p> fcs/stabilizer-pos-rad </p>"
    path.write_text(path.read_text().replace(old, f"<product> {old} {old} </product>", 1))
    with pytest.raises(ValueError, match="not linear in stab"):
        force_model(folder)


@functools.cache
def flight(number):
    return mar10_flights.fly(number, draw=0)


def watched(number):
    flown = flight(number)
    return flown, mar10_flights.detector_log(flown, mar10_flights.detector())


@pytest.mark.parametrize("number", mar10_flights.TRUTH)
def test_the_talks_scenarios_are_isolated_in_order(number):
    flown, log = watched(number)
    found, right = mar10_flights.judge(number, flown, log)
    assert right, found
    last = mar10_flights.TRUTH[number][-1][0]
    assert control_redundancy.ISOLABLE_PARTS[int(log["isolated_part"][-1])] == last


def test_verdicts_and_the_size_of_the_loss():
    flown, log = watched(1)
    assert set(np.unique(log["verdict"])) == {0.0, THRUST}
    assert log["f_hat_thrust"][flown.index > 35].mean() == pytest.approx(-0.25, abs=0.06)  # coefficients off by 5 %
    seen = set(np.unique(watched(2)[1]["verdict"]))
    assert JAM_SOLID in seen and THRUST in seen and seen <= {0.0, JAM_SOLID, AMBIGUOUS, THRUST}


def test_no_decision_before_the_offset_is_learned():
    flown, log = watched(3)
    assert log["valid"][flown.index < 19.9].max() == 0 and log["alarm"][flown.index < 20.0].max() == 0


def lost(sensors):
    """Return the log (tick,) of flight 1 where {sensor: (first, last)} have no measurement."""
    flown, p = flight(1), mar10_flights.detector()
    u = inputs(flown, control_redundancy, mar10_flights.WIRES)
    for name, (first, last) in sensors.items():
        u[name][0, first:last], u[name + "_valid"][0, first:last] = np.nan, 0.0
    u["de_lo"][0, 5000] = np.nan
    log = np.zeros(u.shape, control_redundancy.STATE)
    control_redundancy.rollout(control_redundancy.init(p), u, p, flown.attrs["dt"], log)
    return log[0]


def test_a_dropout_leaves_no_nan():
    log = lost({"n_z": (4200, 4300), "alpha": (4400, 4700), "cas": (100, 120)})
    assert all(np.isfinite(log[name]).all() for name in control_redundancy.OUTPUTS)
    assert log["valid"][4250] == 0 and log["valid"][-1] == 1
    assert control_redundancy.ISOLABLE_PARTS[int(log["isolated_part"][-1])] == "engine"


def test_what_was_declared_is_taken_back_when_nothing_is_measured_for_long():
    log = lost({"beta": (6000, None)})  # from 30 s on; the engines lose thrust at 24 s
    assert log["alarm"][5999:6900].min() == 1.0 and log["alarm"][7010:].max() == 0.0
    assert log["verdict"][-1] == 0.0 and log["valid"][-1] == 0.0


def test_wrong_options_and_a_model_that_does_not_fit_are_refused():
    big = dataclasses.replace(force_model(), mach=np.linspace(0, 1, 200))
    for change, message in (
        ({"t_mean": 0.6}, "at most 0.5"),
        ({"delay": 60}, "at most"),
        ({"model": big}, "mach_grid"),
    ):
        with pytest.raises(ValueError, match=message):
            control_redundancy.params(**{"model": force_model()} | change)


WIRES = sources("control_redundancy")


def cruising(*told):
    return fly(load_scenario("cruise", ["detectors.enabled=[]", "manoeuvre.kind=cruise", *told]), WIRES.values())


SAID = ("valid", "why", "alarm", "learned", "isolated_part", "verdict")
heard = functools.partial(of_flight, control_redundancy, fields=SAID)


@pytest.fixture(scope="module")
def healthy():
    return cruising("duration_s=26", "flight.turbulence=light")


@pytest.mark.parametrize("sensor, error", [("n_x", 0.03), ("n_z", 0.1), ("alpha", 0.035), ("q", math.radians(4.0))])
def test_the_error_of_a_sensor_is_no_effectors(healthy, sensor, error):
    quiet, t, frame = heard(healthy), healthy.index.to_numpy(), healthy.copy()
    assert (quiet["valid"][t > 8.6] == 1.0).all() and not quiet["alarm"].any()
    frame[f"sensors.{sensor}.y_obs"] += np.where(t >= 12.0, error, 0.0)
    log = heard(frame)
    assert log["alarm"].any() and not log["isolated_part"].any()
    assert (log["verdict"][log["alarm"] > 0] == AMBIGUOUS).all()


def test_in_gusts_beyond_those_of_its_training_it_says_nothing_and_why():
    frame = cruising("duration_s=14", "flight.turbulence=moderate")
    assert heard(frame)["valid"][-1] == 1.0
    log = heard(frame, gust_max=0.3)
    assert log["why"][-1] == GUSTS and not log["valid"].any() and not log["alarm"].any() and not log["learned"].any()


HEALS = {
    "an engine": "target='engine.2',kind='thrust_loss',loss_pct=80",
    "a rudder hard over": "target='rudder',kind='runaway',rate_deg_s=3,limit_deg=5",
}


@pytest.mark.parametrize("fault", HEALS.values(), ids=HEALS)
def test_what_would_show_and_does_not_is_over(fault):
    lane = lane_of(f"{fault},start_s=14,end_s=30", 42.0, "flight.turbulence=light")
    assert lane["alarm_share"] > 0.95 and lane["withdrawn_after_s"] < 12.0 and lane["false_alarms"] == 0


def test_a_rudder_that_is_locked_and_asked_for_nothing_is_still_locked():
    lane = lane_of("target='rudder',kind='jam',start_s=14", 45.0, "manoeuvre.kind=yaw_angle", "manoeuvre.start_s=12")
    assert lane["alarm_share"] > 0.95


def lane_of(fault, seconds, *told):
    told = [f"duration_s={seconds}", "detectors.enabled=['control_redundancy']", f"faults=[{{{fault}}}]", *told]
    return cosim.simulate(load_scenario("cruise", told)).to_dict()["detectors"][0]
