"""Rates of `joint`: what a flight's key and tokens are, and what is counted of them."""

import numpy as np
import pytest

from cosim.scenario import load_scenario
from cosim.training import train_joint
from fdi import registry
from fdi.common import verdict
from fdi.joint import hypotheses as table

OFC = "faults.0={target='elevator.right_outer',kind='ofc_liquid',amplitude_mm=3,frequency_hz=1,start_s=1}"


@pytest.mark.parametrize("target, kind, more, key", [
    ("elevator.left_inner", "friction", "friction_pct=30", "hydraulic.friction"),
    ("elevator.left_inner", "internal_leakage", "leakage_pct=30", "hydraulic.internal_leakage"),
    ("elevator.left_inner.rod", "bias", "bias_mm=2", "hydraulic.jam_liquid"),
    ("elevator.left", "bias", "bias_deg=2", "side.bias@command"),
    ("elevator.all", "runaway", "rate_deg_s=4,at='command'", "all.runaway@command"),
    ("sensor.q", "bias", "bias_deg_s=1", "sensor.q"),
    ("engine.all", "thrust_loss", "loss_pct=30", "engine.all"),
    ("rudder", "runaway", "rate_deg_s=4", "rudder.runaway"),
])  # fmt: skip
def test_every_fault_has_the_key_of_a_hypothesis(target, kind, more, key):
    scenario = load_scenario("cruise", [f"faults.0={{target='{target}',kind='{kind}',start_s=20,{more}}}"])
    assert train_joint.key_of(scenario)[0] == key
    assert key in {h.key for h in table.hypotheses(scenario.elevator.technology)}


def test_a_flight_counts_once_for_each_lane_that_its_fault_concerns():
    scenario, dt = load_scenario("cruise", [OFC, "duration_s=40", "elevator.right_outer='hydraulic'"]), 0.25
    lanes = [("iotsekf", "right_outer"), ("iotsekf", "left_outer"), ("rfafe", "aircraft")]
    flown = {f: np.zeros(160, int) for f in train_joint.columns(lanes)}
    for lane in lanes:
        flown[*lane, "valid"][:] = 1
    flown["rfafe", "aircraft", "valid"][:] = 0
    flown["iotsekf", "right_outer", "alarm"][8:] = 1  # first alarm at 2 s
    flown["iotsekf", "right_outer", "verdict"][8:12] = int(verdict.AMBIGUOUS)
    flown["iotsekf", "right_outer", "verdict"][12:] = int(verdict.OFC_LIQUID)
    flown["rfafe", "aircraft", "alarm"][24:], flown["rfafe", "aircraft", "verdict"][24:] = 1, int(verdict.OFC_LIQUID)
    flown["rfafe", "aircraft", "isolated_part"][24:] = registry.module("rfafe").ISOLABLE_PARTS.index("elevator_right")
    found = train_joint.said(scenario, flown, dt)
    assert found == [
        ("young", "iotsekf", "hydraulic.ofc_liquid", {"ambiguous||": 0.5, "ofc_liquid||": 0.5}),
        ("later", "iotsekf", "hydraulic.ofc_liquid", {"ofc_liquid||": 1.0}),
        ("young", "rfafe", "hydraulic.ofc_liquid", {}),  # not valid
        ("later", "rfafe", "hydraulic.ofc_liquid", {"ofc_liquid|elevator_left|": 1.0}),  # as on the left
    ]
    counted = train_joint.counted([found, found])
    assert counted["later"]["rfafe"] == {"hydraulic.ofc_liquid": {"ofc_liquid|elevator_left|": 2.0}}
    quiet = {f: np.zeros_like(v) for f, v in flown.items()}
    assert train_joint.said(scenario, quiet, dt) == []
