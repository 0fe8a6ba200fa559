"""`joint`: what the tokens of the other detectors say together, with what is not there counting as not there."""

import itertools

import numpy as np
import pytest

from cosim.judge import coverage
from cosim.scenario.catalog import ACTUATOR_SENSORS, ELEVATOR_KINDS, SENSORS
from fdi import registry
from fdi.common import verdict
from fdi.isolation import decide
from fdi.joint import hypotheses as table
from fdi.joint import joint, likelihood

DT = 0.1
MIXED = {"left_outer": "hydraulic", "left_inner": "hydraulic", "right_inner": "ema", "right_outer": "ema"}
HYDRAULIC = dict.fromkeys(MIXED, "hydraulic")
AIRCRAFT = "aircraft"
VALVE = ("iotsekf", "left_inner", "ofc_liquid", "", 1.0)


def heard(*said, technology=MIXED, without=(), until=8.0, finer=(), **how):
    """Return the STATE log of lanes that alarm from a time [s] until 8 s or `until`: (detector, lane, class,
    isolated part, from when); `finer` are (detector, lane, output, value)."""
    p = joint.params(technology, **how)
    u, here = np.zeros((1, round(10.0 / DT)), joint.INPUTS), table.segments(technology)
    for i, (detector, lane) in enumerate(table.LANES):
        flies = lane == AIRCRAFT or here.get(lane) in registry.record(detector).technologies
        u["valid"][0, :, i] = flies and detector not in without
    for detector, lane, class_, isolated_part, start in said:
        i, k = table.LANES.index((detector, lane)), slice(round(start / DT), round(until / DT))
        u["alarm"][0, k, i], u["verdict"][0, k, i] = 1.0, verdict.code(class_)
        u["isolated_part"][0, k, i] = registry.module(detector).ISOLABLE_PARTS.index(isolated_part)
    for detector, lane, output, value in finer:
        u["finer"][0, :, joint.FINER.index((table.LANES.index((detector, lane)), detector, output))] = value
    log = np.zeros(u.shape, joint.STATE)
    joint.rollout(joint.init(p), u, p, DT, log)
    return log[0]


def name(log, at=7.0):
    """Return (class, isolated_part) at a time [s]."""
    k = round(at / DT)
    return verdict.class_name(log["verdict"][k]), joint.ISOLABLE_PARTS[int(log["isolated_part"][k])]


@pytest.mark.parametrize("technology", [
    HYDRAULIC, dict.fromkeys(MIXED, "ema"), MIXED, {"left": "hydraulic", "right": "ema"},
    {"left_outer": "ema", "left_inner": "hydraulic", "right_inner": "hydraulic", "right_outer": "ema"},
])  # fmt: skip
def test_every_kind_on_one_segment_a_side_and_all_has_a_hypothesis_and_so_have_sensors_engines_and_surfaces(technology):
    found = table.hypotheses(technology)
    reached = {(h.segments, h.key.partition(".")[2]) for h in found if h.segments}
    here = table.segments(technology)
    groups = [(s,) for s in here] + [own for side in ("left", "right") if len(
        own := tuple(s for s in here if s.startswith(side))) > 1] + [tuple(here)]  # fmt: skip
    for own, (kind, one), at in itertools.product(groups, ELEVATOR_KINDS.items(), ("valve", "command", "sensor")):
        if not {here[s] for s in own} <= set(one.technologies) or at not in (one.at or ("valve",)):
            continue
        cases = {coverage.case_of(kind, f"elevator.{s}", here, at) for s in own}
        kinds = {table.SAME.get(c.partition(".")[2], c.partition(".")[2]) for c in cases}
        if kind != "runaway" or len(kinds) == 1:  # of mixed technologies a runaway of the valve is one of the command
            assert all((own, k) in reached for k in kinds), (own, kind, at)
    names = {h.names[0] for h in found}
    assert {*SENSORS, *table.ENGINES, *table.OTHERS} <= names
    for s, t in here.items():
        sensors = {h.names[0].removesuffix("_sensor").rpartition("_")[2] for h in found if h.segments == (s,)
                   and h.verdict == "sensor"}  # fmt: skip
        assert sensors == set(table.SENSORS[t]) and sensors <= set(ACTUATOR_SENSORS)


@pytest.mark.parametrize("rates", [None, ({}, {})], ids=["stored", "none"])
@pytest.mark.parametrize("technology", [HYDRAULIC, MIXED, {"left": "hydraulic", "right": "ema"}, {"left": "simple"}])
def test_a_likelihood_is_a_distribution_over_tokens_and_every_place_is_as_likely_before(technology, rates):
    p, found = joint.params(technology, rates=rates), table.hypotheses(technology)
    sums = p["p_token"][0].sum(axis=-1)
    assert np.all((np.abs(sums - 1.0) < 1e-9) | (sums == 0.0)) and p["p_token"].min() >= 0.0
    prior = p["prior"][0][: len(found)]
    single = {h.names for h in found if len(h.segments) < 2 or "@command" in h.key}
    places = [sum(w for w, h in zip(prior, found) if h.names == n and len(h.segments) < 2) for n in single]
    assert prior.sum() == pytest.approx(1.0) and np.ptp([w for w in places if w]) < 1e-12


def test_a_filter_places_an_oscillation_in_the_valve_and_monitors_alone_in_the_command():
    assert name(heard(VALVE)) == ("ofc_liquid", "elevator_left_inner_valve")
    said = [("ofc_monitor", s, "ofc_liquid", "", 1.0) for s in ("left_inner", "left_outer")]
    command = heard(*said, ("rfafe", AIRCRAFT, "ofc_liquid", "elevator_left", 2.0), technology=HYDRAULIC)
    assert name(command) == ("ofc_liquid", "elevator_left_command")
    assert command["p"][70] >= joint.SURE


def test_several_jammed_elevators_are_no_runaway_of_their_command():
    jam = [("iotsekf", s, "jam_solid", "", 1.0) for s in HYDRAULIC]
    jam += [("position_monitor", s, "ambiguous", "", 1.5) for s in HYDRAULIC]
    assert name(heard(*jam, technology=HYDRAULIC)) == ("jam_solid", "elevator_surface")
    ema = [("ema_kalman_flight", s, "jam_solid", "", 1.0) for s in ("right_inner", "right_outer")]
    mixed = heard(*(one for one in jam if one[1].startswith("left")), *ema)
    assert name(mixed) == ("jam_solid", "elevator_surface")


def test_an_ambiguous_alarm_of_one_filter_is_no_sure_name():
    said = ("iotsekf", "left_inner", "ambiguous", "", 1.0)
    assert name(heard(said)) == ("ambiguous", "elevator_left_inner")
    of_backlash = heard(said, ("rtsekf_flight", "left_inner", "ambiguous", "", 1.0),
                        finer=[("iotsekf", "left_inner", "kind", decide.GAP)])  # fmt: skip
    assert name(of_backlash)[0] in ("ambiguous", "sensor")  # it has not said so surely


def test_it_alarms_with_the_first_alarm_names_what_it_has_weighed_and_ends_with_the_last_alarm():
    log = heard(VALVE, ("rfafe", AIRCRAFT, "ambiguous", "elevator_left", 2.0))
    on = np.arange(100) * DT
    assert np.array_equal(log["alarm"] > 0.5, (on >= 1.0 - 1e-9) & (on < 8.0 - 1e-9))
    assert name(log, 1.1) == ("ambiguous", "") and name(log, 1.0 + joint.EVERY + DT)[1] == "elevator_left_inner_valve"
    assert not log["verdict"][80:].any() and not log["isolated_part"][80:].any() and not log["p"][80:].any()
    assert log["valid"].all() and not heard()["alarm"].any()


def test_an_alarm_of_a_lane_that_is_not_valid_is_not_heard_but_one_that_made_it_so_is():
    p, i = joint.params(MIXED), table.LANES.index(("ema_kalman_flight", "right_inner"))
    u = np.zeros((1, 80), joint.INPUTS)
    u["alarm"][0, 10:, i], u["verdict"][0, 10:, i] = 1.0, verdict.code("sensor")
    u["isolated_part"][0, 10:, i] = registry.module("ema_kalman_flight").ISOLABLE_PARTS.index("velocity")
    logs = []
    for until in (0, 15):  # never valid; valid until it has named the sensor that it has lost
        u["valid"][0, :, i] = np.arange(80) < until
        logs.append(np.zeros(u.shape, joint.STATE))
        joint.rollout(joint.init(p), u, p, DT, logs[-1])
    assert not logs[0]["alarm"].any() and logs[1]["alarm"][0, 10:].all()
    assert name(logs[1][0]) == ("sensor", "elevator_right_inner_velocity_sensor")


def test_a_detector_that_does_not_fly_is_no_silence():
    jam = ("iotsekf", "left_inner", "jam_solid", "", 1.0)
    kinds = [(h.segments, h.case) for h in table.hypotheses(MIXED)]
    odds = []
    for without in ((), ("ofc_monitor", "position_monitor")):
        w = heard(jam, without=without)["weight"][70]
        swings, stands = (w[kinds.index((("left_inner",), f"hydraulic.{k}"))] for k in ("ofc_solid", "jam_solid"))
        odds.append(swings / stands)
    assert odds[0] != pytest.approx(odds[1])


def test_a_pair_of_sensors_that_one_equation_has_stays_open():
    either = ("kinematic", AIRCRAFT, "sensor", "q or theta", 1.0)
    assert name(heard(either)) == ("sensor", "q or theta")
    assert name(heard(("kinematic", AIRCRAFT, "sensor", "tas", 1.0))) == ("sensor", "tas")


def test_what_a_filter_tells_beyond_the_class_tells_the_valve_from_the_surface():
    said = ("iotsekf", "left_inner", "effectiveness", "", 1.0)
    words = {decide.WEAK: "valve", decide.OF_LOAD: "surface"}
    for value, part in words.items():
        log = heard(said, finer=[("iotsekf", "left_inner", "kind", value)])
        assert name(log) == ("effectiveness", f"elevator_left_inner_{part}")


def test_a_segment_that_only_the_positions_of_the_elevators_show_is_told_from_its_side():
    said = ("rfafe", AIRCRAFT, "ofc_liquid", "elevator_right", 1.0)
    segment = "elevator_right_inner"  # the rates decide whether what is inside it is told, too
    assert name(heard(said, finer=[("rfafe", AIRCRAFT, "segment", 3)]))[1] in (segment, f"{segment}_command")
    assert name(heard(said))[1] in ("elevator_right", "elevator_right_command")


def test_a_segment_of_two_is_named_as_this_aircraft_calls_it():
    assert name(heard(VALVE, technology={"left": "hydraulic", "right": "ema"}))[1] == "elevator_left_valve"


def test_left_and_right_are_alike():
    left, right = (heard(("iotsekf", f"{side}_outer", "ofc_liquid", "", 1.0),
                         ("rfafe", AIRCRAFT, "ofc_liquid", f"elevator_{side}", 2.0), technology=HYDRAULIC)
                   for side in ("left", "right"))  # fmt: skip
    assert name(right)[1] == table.mirrored(name(left)[1]) == "elevator_right_outer_valve"
    assert right["p"][70] == pytest.approx(left["p"][70], abs=0.01)
    assert table.mirrored("elevator_left and elevator_right") == "elevator_left and elevator_right"
    there = table.turned("elevator_right_outer", ("right_outer",))
    assert there == "elevator_left_inner" and table.turned(there, ("right_outer",)) == "elevator_right_outer"


def test_counts_move_what_the_record_says_by_their_number_of_flights():
    h = next(h for h in table.hypotheses(MIXED) if h.names[0] == "alpha")
    wrong = likelihood.tokens("lpv_smo").index(("sensor", "n_z", ""))
    p = []
    for flights in (0.0, 3.0, 300.0):
        rates = {"lpv_smo": {"sensor.alpha": {"sensor|n_z|": flights}}} if flights else {}
        p.append(likelihood.likelihood("lpv_smo", h, rates, likelihood.pooled("lpv_smo", {}))[wrong])
    assert p[0] < 0.05 < p[1] < 0.9 < p[2] < 1.0
