"""Parameters of one segment's actuator: two spellings, units and ranges, for what flies, what is believed, or both."""

import tomllib

import pytest

import cosim
from cosim.flight.build import build
from cosim.scenario import parse

P_S = "elevator.left_inner.hydraulic.P_s"


def made(*changes):
    return cosim.load_scenario("cruise", ["duration_s=0.1", "detectors.enabled=['iotsekf']", *changes])


def test_one_value_is_for_the_truth_and_for_the_model():
    s = made(f"{P_S}=1.2e7")
    assert s.elevator.technology["left_inner"] == "hydraulic"
    assert s.elevator.parameters["left_inner"].model_dump() == {"truth": {"P_s": 1.2e7}, "model": {"P_s": 1.2e7}}
    assert parse(tomllib.loads(s.expanded_toml())) == s


@pytest.mark.parametrize(
    ("part", "flies", "believed"), [("truth.P_s", 1.2e7, 1.4e7), ("model.P_s", 1.4e7, 1.2e7), ("P_s", 1.2e7, 1.2e7)]
)
def test_truth_and_model_reach_actuator_servo_and_filter(part, flies, believed):
    setup = build(made(f"elevator.left_inner.hydraulic.{part}=1.2e7"))
    blocks = {b.name: b for b in (*setup.loop.actuators, *setup.loop.servos, *setup.loop.detectors)}
    at = setup.loop.bus.lanes["hydraulic"].index("left_inner")
    assert blocks["hydraulic"].p["P_s"][at] == flies
    assert blocks["servo"].p["P_s"][at] == blocks["iotsekf"].p["P_s"][at] == believed
    others = [i for i in range(len(blocks["hydraulic"].p)) if i != at]
    assert (blocks["hydraulic"].p["P_s"][others] == 1.4e7).all()
