"""What each detector is expected to say of each case: it follows from what it reads."""

import fnmatch

import pytest

from cosim.campaign.inventory import builtin_names
from cosim.judge import coverage
from cosim.scenario import catalog as c
from cosim.scenario import load_scenario
from fdi import registry
from fdi.common.verdict import NAMES


def all_cases():
    """Return every case that a scenario can make."""
    out = {"aileron", "rudder", "stabiliser", "engine"} | {f"sensor.{s}" for s in c.SENSORS}
    for tech in c.TECHNOLOGIES:
        own = {seg: tech for seg in c.SEGMENTS}
        for kind, spec in c.ELEVATOR_KINDS.items():
            if tech in spec.technologies:
                out |= {coverage.case_of(kind, "elevator.left_inner", own, at) for at in spec.at or ("",)}
        out |= {coverage.case_of("bias", f"elevator.left_inner.{s}", own) for s in c.TECHNOLOGIES[tech].own_sensors}
    return out


# -- expectations ------------------------------------------------------------------------------------------------------


def test_every_detector_has_an_expectation_and_every_pattern_a_case():
    cases = all_cases()
    for detector, own in registry.records().items():
        assert own.group and own.blind and own.designed_for and own.summary and own.id == detector
        for pattern, classes in {**own.designed_for, **own.may_see}.items():
            assert any(fnmatch.fnmatchcase(case, pattern) for case in cases), (detector, pattern)
            assert set(classes) <= set(NAMES), (detector, pattern)


def test_every_builtin_fault_makes_a_case_that_some_detector_or_none_is_said_to_see():
    known = all_cases()
    for name in builtin_names():
        for case in coverage.cases(load_scenario(name)):
            assert case in known, (name, case)
            assert coverage.label(case)


@pytest.mark.parametrize(
    "detector, case, word",
    [
        ("iotsekf", "hydraulic.ofc_liquid", "designed"),
        ("iotsekf", "hydraulic.ofc_liquid@command", "blind"),  # enters before the valve command that the filter takes
        ("rtsekf_flight", "hydraulic.runaway", "blind"),  # it must stay quiet
        ("rtsekf_flight", "hydraulic.rod", "designed"),
        ("rfafe", "sensor.alpha", "blind"),  # no airframe output contributes
        ("lpv_smo", "sensor.alpha", "designed"),
        ("control_redundancy", "aileron", "blind"),  # invisible to forces on a transport
        ("control_redundancy", "engine", "designed"),
        ("ema_kalman_flight", "ema.runaway@command", "blind"),
        ("position_monitor", "hydraulic.ofc_liquid@command", "may"),
        ("ofc_monitor", "ema.ofc_liquid", "blind"),
        ("another", "engine", "undeclared"),
    ],
)
def test_expectations_follow_from_what_a_detector_reads(detector, case, word):
    assert coverage.expected(detector, case) == word


def test_local_detectors_expect_nothing_of_another_technology():
    hydraulic, ema = ("iotsekf", "rtsekf", "rtsekf_flight", "ofc_monitor"), ("ema_kalman", "ema_kalman_flight")
    for detector in (*hydraulic, *ema):
        own = "hydraulic." if detector in hydraulic else "ema."
        others = [case for case in all_cases() if not case.startswith(own)]
        assert {coverage.expected(detector, case) for case in others} == {"blind"}


def test_case_tells_places_of_entry_apart():
    tech = c.DEFAULT_TECHNOLOGY
    assert coverage.case_of("ofc_liquid", "elevator.left", tech, "valve") == "hydraulic.ofc_liquid"
    assert coverage.case_of("ofc_liquid", "elevator.right", tech, "command") == "ema.ofc_liquid@command"
    assert coverage.case_of("runaway", "elevator.left_inner", tech, "valve", limit=True) == "hydraulic.runaway@command"
    assert coverage.case_of("runaway", "elevator.right_inner", tech, "valve") == "ema.runaway@command"
    assert coverage.case_of("bias", "elevator.left_inner.rod", tech) == "hydraulic.rod"
    assert coverage.case_of("bias", "sensor.alpha", tech) == "sensor.alpha"
    assert coverage.case_of("thrust_loss", "engine.2", tech) == "engine"
