"""Which name is right, and what came of a case: truth is the fault's alone, the same for every detector."""

import pytest

from cosim.judge.naming import blames, name_of, outcome

INNER = ("elevator.left_inner",)
LEFT = ("elevator.left_outer", "elevator.left_inner")


def fault(case, *targets, kind=""):
    return {"case": case, "kind": kind, "targets": targets or INNER}


@pytest.mark.parametrize(
    "case, targets, level, verdict, part, class_, place, finest",
    [
        ("hydraulic.ofc_liquid", INNER, "local", "ofc_liquid", "", "right", "right", "segment"),
        ("hydraulic.ofc_liquid", INNER, "local", "ofc_solid", "", "wrong", "right", "segment"),
        ("hydraulic.ofc_liquid", INNER, "local", "ambiguous", "", "not given", "right", "segment"),
        ("hydraulic.ofc_liquid", INNER, "local", "sensor", "rod", "wrong", "wrong", ""),
        ("hydraulic.rod", ("elevator.left_inner.rod",), "local", "sensor", "rod", "right", "right", "channel"),
        ("hydraulic.rod", ("elevator.left_inner.rod",), "local", "sensor", "surface", "right", "wrong", ""),
        ("hydraulic.rod", ("elevator.left_inner.rod",), "local", "sensor", "", "right", "not given", ""),
        # the fault sits in the sensor that closes the loop, though its target is the actuator
        ("hydraulic.jam_liquid", INNER, "local", "sensor", "rod", "right", "right", "channel"),
        ("hydraulic.jam_liquid", INNER, "local", "sensor", "surface", "right", "wrong", ""),
        ("ema.ofc_liquid@sensor", INNER, "local", "sensor", "position", "right", "right", "channel"),
        ("hydraulic.ofc_liquid@sensor", INNER, "local", "ofc_liquid", "", "right", "right", "segment"),
        # an actuator that obeys too little; friction is no jam
        ("hydraulic.supply_pressure_drop", INNER, "local", "effectiveness", "", "right", "right", "segment"),
        ("hydraulic.internal_leakage", INNER, "local", "effectiveness", "", "right", "right", "segment"),
        ("hydraulic.friction", INNER, "local", "jam_solid", "", "wrong", "right", "segment"),
        # a place counts by what it excludes
        ("hydraulic.ofc_liquid", INNER, "aircraft", "ambiguous", "elevator", "not given", "right", "axis"),
        ("hydraulic.ofc_liquid", INNER, "aircraft", "ofc_liquid", "elevator_left", "right", "right", "side"),
        ("hydraulic.ofc_liquid", INNER, "aircraft", "ofc_liquid", "elevator_left_inner", "right", "right", "segment"),
        ("hydraulic.ofc_liquid", INNER, "aircraft", "ofc_liquid", "elevator_right", "right", "wrong", ""),
        ("hydraulic.ofc_liquid", INNER, "aircraft", "ofc_liquid", "", "right", "not given", ""),
        ("hydraulic.ofc_solid", INNER, "aircraft", "ofc_liquid", "elevator", "wrong", "right", "axis"),
        ("sensor.n_z", ("sensor.n_z",), "aircraft", "sensor", "n_z", "right", "right", "channel"),
        ("sensor.n_z", ("sensor.n_z",), "aircraft", "sensor", "alpha", "right", "wrong", ""),
        ("engine", ("engine.2",), "aircraft", "thrust", "engine_2", "right", "right", "channel"),
        ("engine", ("engine.2",), "aircraft", "thrust", "engine_3", "right", "wrong", ""),
        ("engine", ("engine.2",), "aircraft", "thrust", "engine", "right", "right", "axis"),
        # what is wrong inside an actuator, as a detector of both levels names it
        ("hydraulic.ofc_liquid", INNER, "both", "ofc_liquid", "elevator_left_inner_valve", "right", "right", "channel"),
        ("hydraulic.ofc_liquid", INNER, "both", "ofc_liquid", "elevator_left_inner_command", "right", "wrong", ""),
        ("hydraulic.ofc_liquid", INNER, "both", "ofc_liquid", "elevator_left_outer_valve", "right", "wrong", ""),
        ("hydraulic.bias@command", INNER, "both", "ambiguous", "elevator_left_command", "not given", "right", "side"),
        ("hydraulic.ofc_liquid@command", LEFT, "both", "ofc_liquid", "elevator_left_command", "right", "right",
         "channel"),
        ("hydraulic.bias@command", LEFT, "both", "jam_liquid", "elevator_left_inner_command", "right", "wrong", ""),
        ("hydraulic.ofc_liquid@command", LEFT, "both", "ofc_liquid", "elevator_command", "right", "right", "axis"),
        ("ema.ofc_solid", INNER, "both", "ofc_solid", "elevator_left_inner_drive", "right", "right", "channel"),
        ("ema.jam", INNER, "both", "jam_solid", "elevator_left_inner_surface", "right", "right", "channel"),
        ("hydraulic.rod", INNER, "both", "sensor", "elevator_left_inner_rod_sensor", "right", "right", "channel"),
        ("hydraulic.surface", ("elevator.left_inner.surface",), "both", "sensor", "elevator_left_inner_surface_sensor",
         "right", "right", "channel"),
        # a set that holds the right place is no name of it, one that does not is wrong
        ("sensor.q", ("sensor.q",), "both", "sensor", "q or theta", "right", "not given", "set"),
        ("sensor.alpha", ("sensor.alpha",), "both", "sensor", "q or theta", "right", "wrong", ""),
        ("sensor.alpha", ("sensor.alpha",), "both", "sensor", "sensor", "right", "not given", "set"),
        ("engine", ("engine.2",), "both", "sensor", "sensor", "wrong", "wrong", ""),
        # a part that is healthy is accused beside the faulty one
        ("sensor.q", ("sensor.q",), "aircraft", "sensor", "q and theta", "right", "wrong", ""),
    ],
)
def test_class_and_place_are_each_right_wrong_or_not_given(case, targets, level, verdict, part, class_, place, finest):
    found = name_of(fault(case, *targets), level, verdict, part)
    assert (found.class_, found.place, found.level) == (class_, place, finest)
    assert found.right is (class_ == place == "right") and found.wrong is ("wrong" in (class_, place))


def test_a_name_of_another_fault_that_is_there_is_said_of_that_one():
    q, theta, rod = fault("sensor.q", "sensor.q"), fault("sensor.theta", "sensor.theta"), fault("hydraulic.ofc_solid")
    assert name_of(q, "aircraft", "sensor", "q and theta", [theta]).right
    assert name_of(q, "aircraft", "sensor", "theta", [theta]).elsewhere
    assert not name_of(q, "aircraft", "sensor", "theta", [rod]).elsewhere
    assert name_of(rod, "aircraft", "ambiguous", "elevator", [q]).place == "right"
    assert name_of(q, "aircraft", "ambiguous", "elevator", [rod]).elsewhere


def test_a_surface_is_jammed_or_runs_away_by_the_kind_of_its_fault():
    jam, runs = (fault("rudder", "rudder", kind=k) for k in ("jam", "runaway"))
    assert name_of(jam, "aircraft", "jam_solid", "rudder").right
    assert name_of(runs, "aircraft", "jam_solid", "rudder").wrong
    assert name_of(runs, "aircraft", "runaway", "rudder").right


def test_a_side_is_blamed_for_its_own_segments_only():
    left = fault("hydraulic.ofc_solid", "elevator.left_inner", "elevator.left_outer")
    both = fault("hydraulic.ofc_solid", "elevator.left_inner", "elevator.right_inner")
    assert blames("elevator_left", left, "aircraft") and not blames("elevator_left", both, "aircraft")
    assert blames("elevator_left and elevator_right", both, "aircraft")
    assert name_of(both, "aircraft", "ofc_solid", "elevator_left").place == "wrong"  # it excludes the right side


@pytest.mark.parametrize(
    "case, given, word",
    [
        ("hydraulic.ofc_liquid", {"seen": True, "class_": "right", "place": "right"}, "named"),
        ("hydraulic.ofc_liquid", {"seen": True, "class_": "not given", "place": "right"}, "ambiguous"),
        ("hydraulic.ofc_liquid", {"seen": True, "class_": "right"}, "ambiguous"),
        ("hydraulic.ofc_liquid", {"seen": True, "class_": "wrong", "place": "right"}, "misnamed"),
        ("hydraulic.ofc_liquid", {"seen": True, "class_": "right", "place": "wrong"}, "misnamed"),
        ("hydraulic.ofc_liquid", {"seen": False}, "missed"),
        ("hydraulic.ofc_liquid", {"seen": False, "able": False}, "not_valid"),
        ("hydraulic.friction", {"seen": False}, "quiet"),
        ("engine", {"seen": True, "class_": "wrong"}, "bonus"),
    ],
)
def test_outcome_of_iotsekf(case, given, word):
    assert outcome("iotsekf", case, **given) == word
