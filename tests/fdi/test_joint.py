"""`joint`: what the tokens of the other detectors say together, with what is not there counting as not there."""

import numpy as np
import pytest

from cosim.scenario.catalog import ELEVATOR_KINDS
from fdi import registry
from fdi.common import verdict
from fdi.isolation import decide
from fdi.joint import joint, places, tables

DT = 0.1
MIXED = {"left_outer": "hydraulic", "left_inner": "hydraulic", "right_inner": "ema", "right_outer": "ema"}
AIRCRAFT = "aircraft"
VALVE = ("iotsekf", "left_inner", "ofc_liquid", "", 1.0)


def heard(*said, technology=MIXED, without=(), duration_s=8.0, finer=(), **how):
    """Return the STATE log of lanes that alarm for good: (detector, lane, class, culprit, from when [s]); `finer` are
    (detector, lane, output, value, from when, until when [s])."""
    p = joint.params(technology, **how)
    u, here = np.zeros((1, round(duration_s / DT)), joint.INPUTS), places.segments(technology)
    for i, (detector, lane) in enumerate(places.LANES):
        flies = lane in places.WIDE or here.get(lane) in registry.record(detector).technologies
        u["valid"][0, :, i] = flies and detector not in without
    for detector, lane, class_, culprit, start in said:
        i, k = places.LANES.index((detector, lane)), round(start / DT)
        u["alarm"][0, k:, i], u["verdict"][0, k:, i] = 1.0, verdict.code(class_)
        u["culprit"][0, k:, i] = registry.module(detector).CULPRITS.index(culprit)
    for detector, lane, output, value, start, end in finer:
        f = joint.FINER.index((places.LANES.index((detector, lane)), detector, output))
        u["finer"][0, round(start / DT) : round(end / DT), f] = value
    x, log = joint.init(p), np.zeros(u.shape, joint.STATE)
    joint.rollout(x, u, p, DT, log)
    return log[0]


def name(log, k=-1):
    """Return (class, culprit, second culprit) of a tick."""
    culprits = (joint.CULPRITS[int(log[field][k])] for field in ("culprit", "second"))
    return (verdict.class_name(log["verdict"][k]), *culprits)


def test_a_filter_that_alarms_places_the_fault_in_the_valve_and_a_monitor_alone_in_the_command_path():
    valve = heard(VALVE, ("ofc_monitor", "left_inner", "ofc_liquid", "", 2.5))
    assert name(valve) == ("ofc_liquid", "elevator_left_inner_valve", "")
    command = heard(
        *(("ofc_monitor", s, "ofc_liquid", "", 1.0) for s in ("left_inner", "left_outer")),
        ("rfafe", AIRCRAFT, "ofc_liquid", "elevator_left", 2.0),
        technology=dict.fromkeys(MIXED, "hydraulic"),
    )  # the monitors of the right side are silent
    assert name(command) == ("ofc_liquid", "elevator_left_command", "")
    assert valve["p"][-1] >= 0.9 and command["p"][-1] >= 0.9


def test_both_sides_named_by_one_witness_weigh_against_the_command_of_one():
    monitors = [("ofc_monitor", s, "ofc_liquid", "", 1.0) for s in ("left_inner", "left_outer")]
    odds = []
    for culprit in ("elevator_left and elevator_right", "elevator_left"):
        log = heard(*monitors, ("rfafe", AIRCRAFT, "ofc_liquid", culprit, 1.0), technology=MIXED)
        w = dict(zip(places.PLACES, log["place_w"][-1], strict=True))
        odds.append(w["elevator_command"] / w["elevator_left_command"])
    assert odds[0] > 1.0 > odds[1]
    assert places.mirrored("elevator_left and elevator_right ofc_solid") == "elevator_left and elevator_right ofc_solid"


def test_a_segment_that_only_the_positions_of_the_elevators_show_is_told_from_its_side():
    said = ("rfafe", AIRCRAFT, "ofc_liquid", "elevator_right", 1.0)
    named = {v: heard(said, finer=[("rfafe", AIRCRAFT, "segment", v, 2.0, 8.0)]) for v in (0, 3, 4)}
    assert name(named[3])[1] == "elevator_right_inner_command" and name(named[4])[1] == "elevator_right_outer_command"
    assert name(named[0])[1] == "elevator_right_command"
    back = heard(said, finer=[("rfafe", AIRCRAFT, "segment", 3, 2.0, 4.0)])
    assert name(back, 35)[1] == "elevator_right_inner_command" and name(back)[1] == "elevator_right_command"
    own = [places.turned(f"elevator_{s} ofc_solid", (s,)) for s in places.SEGMENTS]
    assert set(own) == {"elevator_left_inner ofc_solid"}
    assert places.turned(own[0], ("right_outer",)) == "elevator_right_outer ofc_solid"


def test_nothing_is_said_while_nobody_alarms_and_an_alarm_ends_with_its_last_witness():
    quiet = heard()
    assert not quiet["alarm"].any() and quiet["valid"].all()
    log = heard(VALVE)
    k = int(np.argmax(log["alarm"]))
    assert k == 10 and log["alarm"][k:].all()  # one witness is enough, in the same tick


def test_an_alarm_of_a_lane_that_is_not_valid_is_not_heard_but_one_that_made_it_so_is():
    p, i = joint.params(MIXED), places.LANES.index(("ema_kalman_flight", "right_inner"))
    u = np.zeros((1, 80), joint.INPUTS)
    u["alarm"][0, 10:, i], u["verdict"][0, 10:, i] = 1.0, verdict.code("sensor")
    u["culprit"][0, 10:, i] = registry.module("ema_kalman_flight").CULPRITS.index("velocity")
    logs = []
    for until in (0, 15):  # never valid; valid until it has named the sensor that it has lost
        u["valid"][0, :, i] = np.arange(80) < until
        log = np.zeros(u.shape, joint.STATE)
        joint.rollout(joint.init(p), u, p, DT, log)
        logs.append(log[0])
    assert not logs[0]["alarm"].any() and not logs[0]["p_fault"].any()
    assert logs[1]["alarm"][10:].all() and name(logs[1]) == ("sensor", "elevator_right_inner_velocity_sensor", "")


def test_leakage_is_a_hypothesis_of_its_own_that_only_the_actuators_detectors_see():
    weak = [("iotsekf", "left_inner", "kind", decide.WEAK, 1.0, 8.0)]
    wide = heard(("iotsekf", "left_inner", "effectiveness", "", 1.0), finer=weak)
    assert name(wide)[:2] == ("effectiveness", "elevator_left_inner_valve")  # friction of the surface has its own word
    kinds = [(h.place, h.kind) for h in places.hypotheses(MIXED)]
    leak, rubs = (wide["w"][-1, kinds.index((f"elevator_left_inner_{part}", f"hydraulic.{kind}"))]
                  for part, kind in (("valve", "drive.internal_leakage"), ("surface", "surface.friction")))  # fmt: skip
    assert leak > 5.0 * rubs
    open_ = heard(*((d, "left_inner", "ambiguous", "", 1.0) for d in ("iotsekf", "rtsekf_flight")))
    assert name(open_)[1].startswith("elevator_left_inner") and "sensor" not in name(open_)[1]  # a loose surface
    kinds = {h.kind: h for h in places.hypotheses(MIXED) if h.place == "elevator_left_inner_valve"}
    assert {"hydraulic.drive.internal_leakage", "hydraulic.drive.air_in_oil"} < set(kinds)
    p, found = joint.params(MIXED), places.hypotheses(MIXED)
    prior = p["prior"][0][: len(found)]
    own = [sum(w for w, h in zip(prior, found) if h.place == place) for place in {h.place for h in found}]
    assert np.ptp(own) < 1e-12 and sum(own) == pytest.approx(1.0)  # every place alike, whatever its causes


@pytest.mark.parametrize("detector, lane, output, part", [
    ("iotsekf", "left_inner", "kind", {decide.WEAK: "valve", decide.OF_LOAD: "surface", decide.FREE_FLOAT: "surface"}),
    ("ema_kalman_flight", "right_inner", "hot_friction", {1: "surface"}),
])  # fmt: skip
@pytest.mark.parametrize("rates", ["measured", "none"])
def test_what_a_detector_tells_beyond_the_class_tells_the_valve_from_the_surface(detector, lane, output, part, rates):
    for value, where in part.items():
        class_ = "ambiguous" if value == decide.FREE_FLOAT else "effectiveness"
        said = (detector, lane, class_, "", 1.0)
        log = heard(said, finer=[(detector, lane, output, value, 2.0, 4.0)], rates=rates)  # and stands until it changes
        w = dict(zip(places.PLACES, log["place_w"][-1], strict=True))
        other = {"valve": "surface"}.get(where, "valve" if detector == "iotsekf" else "drive")
        assert w[f"elevator_{lane}_{where}"] > 1.5 * w[f"elevator_{lane}_{other}"]
        before = log[round(1.5 / DT)]
        assert before["word"].max() == 0.0 and log["word"][-1].max() > 0.0
        gone = heard((*said[:2], "jam_solid", "", 1.0), finer=[(detector, lane, output, value, 0.2, 0.6)])
        assert gone["word"].max() == 0.0  # of a time without an alarm


def test_every_word_of_a_record_is_one_of_the_tokens_and_says_kinds_that_there_are():
    for _, detector, output in joint.FINER:
        own = registry.record(detector)
        assert output in registry.module(detector).OUTPUTS
        for kinds in own.finer[output].values():
            assert tables.name(detector, "effectiveness", "", kinds) in tables.names(detector)
            if isinstance(kinds, str):
                assert not kinds or f"{kinds}_command" in places.PLACES
            else:
                assert set(kinds) <= set(ELEVATOR_KINDS)


def test_q_and_theta_stay_open_until_something_tells_them_apart():
    either = ("kinematic", AIRCRAFT, "sensor", "q or theta", 1.0)
    alone = heard(either, without=("lpv_smo",))
    assert name(alone)[:2] == ("sensor", "q or theta") and alone["p"][-1] >= 0.9
    told = heard(either, ("lpv_smo", AIRCRAFT, "ambiguous", "", 2.0))  # which alarms on q, on theta hardly ever
    assert name(told)[1] == "q"


def test_two_faults_are_named_beside_each_other_whichever_came_first():
    other = ("ema_kalman_flight", "right_outer", "ofc_liquid", "", 3.0)
    log = heard(VALVE, ("ofc_monitor", "left_inner", "ofc_liquid", "", 2.0), other)
    assert {*name(log)[1:]} == {"elevator_left_inner_valve", "elevator_right_outer_drive"}
    assert verdict.class_name(log["verdict_2"][-1]) == "ofc_liquid" and log["second"][20] == 0.0


def test_a_detector_that_does_not_fly_is_no_silence():
    """Silence of ofc_monitor speaks against an oscillation; its absence does not."""
    there, gone = (heard(VALVE, without=w) for w in ((), ("ofc_monitor", "rtsekf", "rfafe")))
    assert gone["w"][-1].sum() > there["w"][-1].sum()


@pytest.mark.parametrize("levels, alarms", [("both", True), ("local", True), ("aircraft", False)])
def test_each_level_can_be_listened_to_alone(levels, alarms):
    assert heard(VALVE, levels=levels)["alarm"].any() == alarms


@pytest.mark.parametrize("technology", [
    dict.fromkeys(places.SEGMENTS, "hydraulic"), dict.fromkeys(places.SEGMENTS, "ema"), MIXED,
    {"left": "hydraulic", "right": "ema"}, {**MIXED, "left_outer": "simple"},
])  # fmt: skip
def test_every_mix_of_technologies_has_its_places(technology):
    found, here = places.hypotheses(technology), places.segments(technology)
    assert all(h.place in joint.CULPRITS for h in found)
    assert {s for h in found for s in h.segments} == set(here)
    p = joint.params(technology)
    assert p["prior"].sum() == pytest.approx(1.0)
    assert np.all(p["alarm"] < 1.0) and np.all(p["said"].sum(axis=-1)[:, : int(p["row"].max()) + 1] <= 1.0 + 1e-9)


def test_a_segment_of_two_is_named_as_this_aircraft_calls_it():
    said = VALVE, ("ofc_monitor", "left_inner", "ofc_liquid", "", 2.0)
    assert name(heard(*said, technology={"left": "hydraulic", "right": "ema"}))[1] == "elevator_left_valve"


def test_a_detector_alone_is_believed_if_it_stays_alone_with_faults_more_often_than_it_is_wrong_for_so_long():
    stays = {"rfafe_airframe": 0, "position_monitor": 6, "kinematic": 50}
    rates = {"alone": {d: [n, 600, 0, 0, 0, 0, 200.0] for d, n in stays.items()}}
    quiet = "rfafe_airframe", AIRCRAFT, "ambiguous", "elevator", 1.0
    lanes = [("position_monitor", s, "ambiguous", "", 1.0) for s in ("left_inner", "left_outer")]
    first = "kinematic", AIRCRAFT, "sensor", "tas", 1.0
    lone, later, sure = (heard(*said, rates=rates) for said in ([quiet], lanes, [first]))
    right, wrong = 0.5 * tables.ALONE[AIRCRAFT] / 600.5, 0.5 / (500.0 + 200.0)
    odds = tables.FAULTS * right / wrong
    assert lone["p_fault"][11] == pytest.approx(odds / (1.0 + odds)) and not lone["alarm"].any()
    assert sure["p_fault"][11] > 0.75 and sure["alarm"][10:].all()
    assert int(np.argmax(later["alarm"])) == 50  # two lanes are one detector; few of its false alarms stand for 4 s
    joined = heard(quiet, ("lpv_smo", AIRCRAFT, "ambiguous", "elevator", 3.0), rates=rates)
    assert int(np.argmax(joined["alarm"])) == 30 and joined["alarm"][30:].all()  # with the second witness


def test_names_of_the_first_moments_weigh_as_they_were_counted_then():
    first = [{"ambiguous": 20}] * 2 + [{"sensor rod": 20}] * 2
    other = [{"ambiguous": 1, "jam_solid": 19}] * 4
    seen = {"hydraulic.rod_sensor": {"flights": 20, "said": first, "late": [20] * 9},
            "hydraulic.surface.jam_solid": {"flights": 20, "said": other, "late": [20] * 9}}  # fmt: skip
    log = heard(("iotsekf", "left_inner", "ambiguous", "", 1.0), rates={"seen": {"iotsekf": seen}})
    kinds = [(h.place, h.kind) for h in places.hypotheses(MIXED)]
    rod, jam = (log["w"][:, kinds.index((f"elevator_left_inner_{part}", f"hydraulic.{kind}"))]
                for part, kind in (("rod_sensor", "rod_sensor"), ("surface", "surface.jam_solid")))  # fmt: skip
    assert rod[11] > 5.0 * jam[11] and rod[-1] < 2.0 * jam[-1]  # a sensor would have been named by now


def test_left_and_right_are_alike():
    technology = dict.fromkeys(places.SEGMENTS, "hydraulic")
    how = {"technology": technology, "rates": "none"}  # of a fault of all elevators rfafe names the left side first
    left = heard(VALVE, ("rfafe", AIRCRAFT, "ofc_liquid", "elevator_left", 2.0), **how)
    right = heard(("iotsekf", "right_inner", "ofc_liquid", "", 1.0),
                  ("rfafe", AIRCRAFT, "ofc_liquid", "elevator_right", 2.0), **how)  # fmt: skip
    assert name(right)[1] == places.mirrored(name(left)[1]) == "elevator_right_inner_valve"
    # not to the last digit: of twins the one that comes first in LANES has its own age, the other that of both
    assert right["p"][-1] == pytest.approx(left["p"][-1], abs=0.02)


def test_rates_move_what_records_say_by_their_number_of_flights():
    h = places.Hypothesis("alpha", "sensor", "sensor.alpha")
    counts = {"seen": {"lpv_smo": {"sensor.alpha": {"flights": 30, "said": [{"sensor n_z": 30}] * len(tables.PHASES)}}}}
    kept = tables.keeps("lpv_smo", {})
    before, after = (tables.measured("lpv_smo", h, "hydraulic", kept, rates)[1] for rates in ({}, counts))
    wrong = tables.names("lpv_smo").index("sensor n_z")
    assert before[wrong] < 0.2 and after[wrong] > 0.85
    alarm = tables.measured("lpv_smo", h, "hydraulic", kept, counts)[0]
    before = tables.believed("lpv_smo", h, "hydraulic", kept)[0].mean()
    assert alarm.mean() == pytest.approx((3.0 * before + 30.0) / 33.0)


def test_a_name_that_its_detector_has_never_given_wrongly_is_believed_though_nobody_has_flown_that_kind():
    log = heard(("kinematic", AIRCRAFT, "sensor", "alpha", 1.0))  # rates know a bias of the vane, which it cannot see
    assert name(log) == ("sensor", "alpha", "")


def test_who_would_have_spoken_by_now_counts_as_silent_for_good():
    said = [("position_monitor", "left_inner", "ambiguous", "", 1.0)]
    said += [("rfafe", AIRCRAFT, "ambiguous", "elevator_left", 1.6)]
    log = heard(*said, duration_s=20.0, finer=[("rfafe", AIRCRAFT, "segment", 2, 1.6, 20.0)])
    assert name(log, 20) == ("ambiguous", "elevator_left_inner_command", "")  # iotsekf would have blamed its pressure
    assert name(log) == ("jam_liquid", "elevator_left_inner_command", "")  # ofc_monitor has not come: no oscillation


def test_a_word_that_is_not_said_yet_is_not_denied():
    h = next(h for h in places.hypotheses(MIXED) if h.kind == "ema.surface.effectiveness")
    kept = tables.keeps("ema_kalman_flight", tables.stored())
    said = tables.believed("ema_kalman_flight", h, "ema", kept)[1]
    own = tables.names("ema_kalman_flight")
    assert said.sum() == pytest.approx(1.0) and said.min() > 0.0
    assert kept[2] > 2.0 * kept[1]  # as often as friction was, which has a word: not as often as "ambiguous" is said
    assert said[own.index("effectiveness")] == pytest.approx(kept[2] * kept[0] * (1.0 - kept[1]), rel=0.1)


def test_a_right_class_with_a_right_word_is_a_right_name():
    def kept(token):
        cell = {"flights": 40, "said": [{token: 40}] * 4}
        return tables.keeps("ema_kalman_flight", {"seen": {"ema_kalman_flight": {"ema.drive.effectiveness": cell}}})

    right, wrong = kept("effectiveness loss_of_effectiveness"), kept("effectiveness friction")
    assert right[0] == kept("effectiveness")[0] > 0.95 > 0.4 > wrong[0]
    assert right[2] < kept("effectiveness")[2]


def test_a_second_sensor_that_a_detector_names_beside_the_first_is_another_fault():
    first = ("kinematic", AIRCRAFT, "sensor", "theta", 1.0)
    log = heard(first, ("kinematic", "second", "sensor", "cas", 4.0))
    assert name(log, 35)[1:] == ("theta", "")
    assert set(name(log)[1:]) == {"theta", "cas"}
    three = heard(VALVE, first, ("kinematic", "second", "sensor", "cas", 4.0))
    assert three["alarm"][40:].all()  # more than it can name are no false alarms
