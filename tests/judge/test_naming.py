"""Which name is right, and what came of a case."""

import pytest

from cosim.judge.naming import blames, outcome, right

SEGMENT = ("elevator.left_inner",)


@pytest.mark.parametrize(
    "detector, case, targets, verdict, culprit, good",
    [
        ("iotsekf", "hydraulic.ofc_liquid", SEGMENT, "ofc_liquid", "", True),
        ("iotsekf", "hydraulic.ofc_liquid", SEGMENT, "ofc_solid", "", False),
        ("iotsekf", "hydraulic.ofc_liquid", SEGMENT, "ambiguous", "", False),
        ("iotsekf", "hydraulic.rod", ("elevator.left_inner.rod",), "sensor", "rod", True),
        ("iotsekf", "hydraulic.rod", ("elevator.left_inner.rod",), "sensor", "surface", False),
        ("iotsekf", "hydraulic.rod", ("elevator.left_inner.rod",), "sensor", "", False),
        ("iotsekf", "hydraulic.jam_liquid", SEGMENT, "sensor", "rod", True),
        ("lpv_smo", "sensor.n_z", ("sensor.n_z",), "sensor", "n_z", True),
        ("lpv_smo", "sensor.n_z", ("sensor.n_z",), "sensor", "alpha", False),
        # a detector that cannot tell the class names the part, and ambiguous without a part is no name
        ("lpv_smo", "hydraulic.bias@command", SEGMENT, "ambiguous", "elevator", True),
        ("lpv_smo", "hydraulic.bias@command", SEGMENT, "ambiguous", "n_z", False),
        ("position_monitor", "hydraulic.free_float", SEGMENT, "ambiguous", "", False),
    ],
)
def test_a_name_is_right_in_class_and_part(detector, case, targets, verdict, culprit, good):
    level = "aircraft" if detector == "lpv_smo" else "local"
    assert right(detector, case, targets, level, verdict, culprit) is good


def test_a_side_is_blamed_for_its_own_segments_only():
    assert blames("elevator_left", ("elevator.left_inner", "elevator.left_outer"), "aircraft")
    assert not blames("elevator_left", ("elevator.left_inner", "elevator.right_inner"), "aircraft")
    assert blames("elevator_left and elevator_right", ("elevator.left_inner", "elevator.right_inner"), "aircraft")
    assert blames("engine_2", ("engine.2",), "aircraft") and not blames("engine_2", ("engine.3",), "aircraft")


@pytest.mark.parametrize(
    "case, given, word",
    [
        ("hydraulic.ofc_liquid", {"seen": True, "is_right": True, "verdict": "ofc_liquid"}, "named"),
        ("hydraulic.ofc_liquid", {"seen": True, "verdict": "ambiguous"}, "ambiguous"),
        ("hydraulic.ofc_liquid", {"seen": True, "verdict": None}, "ambiguous"),
        ("hydraulic.ofc_liquid", {"seen": True, "verdict": "runaway"}, "misnamed"),
        ("hydraulic.ofc_liquid", {"seen": False}, "missed"),
        ("hydraulic.ofc_liquid", {"seen": False, "able": False}, "idle"),
        ("hydraulic.friction", {"seen": False}, "quiet"),
        ("engine", {"seen": True, "verdict": "ofc_liquid"}, "bonus"),
    ],
)
def test_outcome_of_iotsekf(case, given, word):
    assert outcome("iotsekf", case, **given) == word
