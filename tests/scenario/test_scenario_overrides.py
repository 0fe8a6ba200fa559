"""Overrides of a scenario, and that an expanded one is the same one."""

import tomllib

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scenario_tables import POINT

import cosim
from cosim.errors import ScenarioError
from cosim.scenario import catalog as c
from cosim.scenario import load_scenario, parse
from fdi.registry import SHIPPED


def test_override_replaces_what_it_excludes():
    s = load_scenario(
        "liquid-ofc", ["flight.mach=0.6", "faults.0.amplitude=0.01", "elevator.feedback.left_inner=rtsekf"]
    )
    assert (s.flight.mach, s.flight.cas_kt) == (0.6, None)
    assert s.faults[0].model_extra["amplitude"] == 0.01 and "amplitude_mm" not in s.faults[0].model_extra
    assert (s.elevator.feedback["left_inner"], s.elevator.feedback["left_outer"]) == ("rtsekf", "iotsekf")
    s = load_scenario(
        "solid-ofc", ["manoeuvre.kind=coordinated_turn", "manoeuvre.bank_deg=20", "faults.0.kind=jam_solid"]
    )
    assert (s.manoeuvre.bank_deg, s.manoeuvre.start_s) == (20, 14) and s.faults[0].model_extra == {}


def test_override_appends_a_fault_at_the_next_index():
    keys = ["target=sensor.alpha", "kind=bias", "start_s=3", "bias_deg=1"]
    s = load_scenario("liquid-ofc", [f"faults.1.{k}" for k in keys])
    assert [f.kind for f in s.faults] == ["ofc_liquid", "bias"]
    assert load_scenario("cruise", [f"faults.0.{k}" for k in keys]).faults[0].target == "sensor.alpha"


def test_feedback_is_for_hydraulic_segments_and_brings_its_filter_along():
    s = load_scenario(
        "cruise", ["elevator.feedback=rtsekf_flight", "detectors.enabled=[]", "elevator.reconfigure=true"]
    )
    assert list(s.elevator.feedback.values()) == ["rtsekf_flight", "rtsekf_flight", "measured", "measured"]
    assert s.running == ("rtsekf_flight", "ema_kalman_flight")
    switched = ["elevator.feedback=measured", "detectors.enabled=[]", "elevator.reconfigure=true"]
    assert load_scenario("cruise", switched).running == ("ema_kalman_flight", "rtsekf_flight")
    word_then_one = ["elevator.feedback=measured", "elevator.feedback.left_inner=iotsekf"]
    assert load_scenario("cruise", word_then_one).elevator.feedback["left_outer"] == "measured"
    assert load_scenario("cruise", ["elevator.left_inner=ema"]).elevator.feedback["left_inner"] == "measured"
    assert load_scenario("cruise", ["elevator.right_inner=hydraulic"]).elevator.feedback["right_inner"] == "iotsekf"
    with pytest.raises(ScenarioError, match=r"elevator\.feedback\.right_inner.*right_inner is ema"):
        load_scenario("cruise", ["elevator.feedback.right_inner=iotsekf"])


@st.composite
def faults(draw, index):
    """Any fault that the catalog knows, on a part of its own so that no two conflict."""
    sensor, technology = list(c.SENSORS)[index], "hydraulic" if index < 2 else "ema"
    elevator = {name: kind for name, kind in c.ELEVATOR_KINDS.items() if technology in kind.technologies}
    target, kinds = draw(st.sampled_from([
        (f"sensor.{sensor}", c.sensor_kinds(c.SENSORS[sensor])), (c.SURFACES[index], c.SURFACE_KINDS),
        (f"engine.{index + 1}", c.ENGINE_KINDS), (f"elevator.{c.SEGMENTS[index]}", elevator),
    ]))  # fmt: skip
    name = draw(st.sampled_from(list(kinds)))
    kind = kinds[name]
    out = {"target": target, "kind": name, "start_s": draw(st.floats(0, 100))}
    if kind.at:
        out["at"] = draw(st.sampled_from(kind.at))
    one_of = [k for k in kind.one_of if not name.startswith("ofc") or k.name in c.AMPLITUDES_AT[out["at"]]]
    for key in [*kind.keys, *([draw(st.sampled_from(one_of))] if one_of else [])]:
        out[key.name] = draw(st.floats(key.low, key.high).filter(key.accepts))
    if draw(st.booleans()):
        out["end_s"] = out["start_s"] + draw(st.floats(1.0, 100))
    return out


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_any_scenario_expands_to_an_equal_one(data):
    draw = data.draw
    table = {
        "title": draw(st.text(st.characters(codec="utf-8"), max_size=20)),
        "seed": draw(st.integers(0, 2**31 - 1)),
        "duration_s": draw(st.floats(0.01, 36000)),
        "flight": {**POINT, "mass_t": draw(st.floats(180, 405)), "altitude_ft": draw(st.floats(0, 45000))},
        "faults": [draw(faults(i)) for i in range(draw(st.integers(0, 4)))],
        "elevator": {"feedback": draw(st.sampled_from(c.FEEDBACKS))},
        "detectors": {
            "enabled": draw(st.lists(st.sampled_from(list(SHIPPED)), unique=True)),
            "iotsekf": {"q_fault": 0.5},
        },
        "tolerances": {"aero": {"Cm_alpha": draw(st.floats(0.2, 5.0))}},
    }
    s = parse(table)
    again = parse(tomllib.loads(s.expanded_toml()))
    assert again == s and again.expanded_toml() == s.expanded_toml()
    assert len(again.injections()) >= len(s.faults)


def test_a_title_tells_of_what_flies():
    as_written = cosim.load_scenario("cruise", ["duration_s=5", "seed=3", 'detectors.enabled=["iotsekf"]'])
    assert as_written.title == "Cruise without a fault, in light turbulence"
    keys = ["flight.turbulence=moderate", "faults.0.target=elevator.left_inner", "faults.0.kind=runaway",
            "faults.0.start_s=2", "faults.0.rate_deg_s=20"]  # fmt: skip
    assert cosim.load_scenario("cruise", keys).title == "runaway on elevator.left_inner; moderate turbulence, cruise"
    assert cosim.load_scenario("cruise", [*keys, "title=Mine"]).title == "Mine"
    flight = cosim.Flight(cosim.load_scenario("cruise", ["duration_s=2"]))
    flight.inject(target="elevator.left_inner", kind="jam_solid", start_s=1.0)
    assert flight.scenario.title == "jam_solid on elevator.left_inner; light turbulence, cruise"
