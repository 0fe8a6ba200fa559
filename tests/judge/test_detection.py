"""What a lane made of a fault, on histories made by hand, and what must hold for any history."""

import math
import time
from itertools import cycle, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.judge.alarms import GRACE_S, acts, during
from cosim.judge.detection import JudgedLane, Said
from cosim.judge.lanes import entries
from cosim.judge.result import Result, entry_of, judge
from fdi.common import verdict as v
from fdi.common import why

DT = 0.1
FIELDS = ("alarm", "verdict", "isolated_part", "r", "valid", "why")
OFC = {"fault": 0, "case": "hydraulic.ofc_liquid", "kind": "ofc_liquid", "targets": ("elevator.left_inner",),
       "start_s": 2.0, "end_s": math.inf, "period_s": 0.5}  # fmt: skip
JAM = OFC | {"fault": 1, "case": "hydraulic.jam_solid", "kind": "jam_solid", "start_s": 5.0}
ROD = OFC | {"fault": 1, "case": "hydraulic.rod", "kind": "bias", "targets": ("elevator.left_inner.rod",),
             "start_s": 5.0}  # fmt: skip


def lane_of(name="iotsekf", level="local", parts=("", "rod"), target="elevator.left_inner", more=(), fields=FIELDS):
    return JudgedLane(name, level, target, parts, {n: i for i, n in enumerate((*fields, *more))})


LANE = lane_of()


def sensor(name, start_s, fault=0):
    return OFC | {"fault": fault, "case": f"sensor.{name}", "kind": "bias", "targets": (f"sensor.{name}",),
                  "start_s": start_s}  # fmt: skip


def flown(*said, ticks=100, valid=1.0, reason=0.0, more=0):
    """Return a history in which the alarm stands with a class, and perhaps a part, over [(first, last, class), ...]."""
    rows = np.zeros((ticks, len(FIELDS) + more))
    rows[:, 4], rows[:, 5] = valid, reason
    for first, last, *words in said:
        rows[first:last, 0] = 1.0
        rows[first:last, 1 : 1 + len(words)] = words
    return rows


def by_fault(rows, *faults, lane=LANE):
    return judge(lane, rows, DT, faults)["by_fault"]


Y, W, N = "right", "wrong", "not given"
ONE = {  # behaviour: (history, fault, what the entry says)
    "delay in seconds and periods": (flown((25, 100, v.OFC_LIQUID)), OFC, {
        "detected_at_s": 2.5, "detection_delay_s": 0.5, "detection_delay_periods": 1.0, "false_alarms": 0,
        "isolated": {"class": "ofc_liquid", "target": "elevator.left_inner"}}),
    "first, right and last name have their own times": (
        flown((23, 26, v.AMBIGUOUS), (26, 40, v.OFC_SOLID), (40, 100, v.OFC_LIQUID)), OFC, {
            "first_verdict": {"class": "ambiguous", "target": "elevator.left_inner"}, "right": True,
            "detection_delay_s": 0.3, "time_to_right_s": 2.0, "class_changes": 2, "ambiguous_s": 0.3,
            "first_sure_wrong": True, "first_right": False, "named_at_s": 4.0}),
    "the name at the end is that of the last second": (
        flown((23, 92, v.OFC_SOLID), (92, 100, v.OFC_LIQUID)), OFC,
        {"isolated": {"class": "ofc_liquid", "target": "elevator.left_inner"}}),
    "an onset within a tick has no delay": (
        flown((20, 100, v.OFC_LIQUID)), OFC | {"start_s": 2.04}, {"detection_delay_s": 0.0}),
    "ambiguous is never right": (
        flown((23, 100, v.AMBIGUOUS)), OFC, {"time_to_right_s": None, "right": False, "detection_delay_s": 0.3}),
    "a right name that is given up": (
        flown((23, 30, v.OFC_LIQUID), (30, 100, v.RUNAWAY)), OFC, {"time_to_right_s": 0.3, "right": False}),
    "a right name that does not stand for half a second": (
        flown((23, 27, v.OFC_LIQUID), (27, 100, v.RUNAWAY)), OFC, {"time_to_right_s": None, "first_right": True}),
    "an alarm that stood before is false and no detection": (
        flown((10, 100, v.OFC_LIQUID)), OFC, {"detection_delay_s": None, "false_alarms": 1, "alarm": True}),
    "nor is its return within half a second": (
        flown((10, 22, v.OFC_LIQUID), (26, 100, v.OFC_LIQUID)), OFC, {"detection_delay_s": None}),
    "one that falls and rises later detects": (
        flown((10, 22, v.OFC_LIQUID), (30, 100, v.OFC_LIQUID)), OFC, {"detection_delay_s": 1.0, "false_alarms": 1}),
    "withdrawal counts to the last alarm": (
        flown((23, 45, v.OFC_LIQUID), (50, 55, v.OFC_LIQUID)), OFC | {"end_s": 4.0},
        {"withdrawn": True, "withdrawn_after_s": 1.5, "standing_s": 0.0, "false_alarms": 0}),
    "what stands too long is standing": (
        flown((23, 100, v.OFC_LIQUID)), OFC | {"end_s": 4.0}, {
            "withdrawn": False, "withdrawn_after_s": None, "false_alarms": 0, "standing_s": 10.0 - 4.0 - GRACE_S}),
    "an alarm within 2 s of the end is no false one": (
        flown((44, 46)), OFC | {"end_s": 2.5}, {"false_alarms": 0, "detection_delay_s": 2.4}),
    "a later one is": (flown((46, 50)), OFC | {"end_s": 2.5}, {"false_alarms": 1, "detection_delay_s": None}),
    "what is said of a decay is no name": (
        flown((25, 40, v.OFC_LIQUID), (40, 60, v.JAM_SOLID)), OFC | {"end_s": 3.8},
        {"isolated": {"class": "ofc_liquid", "target": "elevator.left_inner"}}),
    "gaps count in the share of time in alarm": (flown((20, 60, 1.0), (80, 100, 1.0)), OFC, {"alarm_share": 0.75}),
    "a lane that could not judge says why": (
        flown(valid=0.0, reason=why.BOX_MASS), OFC, {
            "able": False, "valid_at_fault": 0.0, "why_not_valid": "outside its box (mass)", "valid_share": 0.0}),
    "one that noticed could judge": (
        flown((23, 100, 1.0), valid=0.0, reason=why.BOX_MASS), OFC, {"able": True, "why_not_valid": None}),
    "a fault elsewhere makes a local alarm false": (
        flown((25, 30)), OFC | {"targets": ("elevator.right_inner",)}, {
            "concerned": False, "false_alarms": 1, "detected_at_s": 2.5, "by_fault": []}),
    "a fault in no tick concerns nobody": (flown(), OFC | {"start_s": 3.01, "end_s": 3.02}, {"concerned": False}),
    "nor one that begins after the end": (flown(), OFC | {"start_s": 9.97}, {"concerned": False, "by_fault": []}),
    "one of a tick does": (flown(), OFC | {"start_s": 3.01, "end_s": 3.11}, {"concerned": True}),
    "a jam that showed counts from motion": (
        flown((53, 100, v.JAM_SOLID)), JAM | {"moved_at_s": {"left_inner": 5.2, "right_inner": 1.0}},
        {"not_excited": False, "right_after_motion_s": 0.1, "time_to_right_s": 0.3}),
    "one that never moved the rod is not excited": (
        flown(), JAM | {"moved_at_s": {"left_inner": math.inf}}, {"not_excited": True}),
    "nobody looked": (flown(), JAM | {"moved_at_s": None}, {"not_excited": None}),
}  # fmt: skip


@pytest.mark.parametrize("name", ONE)
def test_of_one_fault(name):
    rows, fault, says = ONE[name]
    entry = judge(LANE, rows, DT, [fault])
    assert {key: entry[key] for key in says} == {
        key: pytest.approx(value) if isinstance(value, float) else value for key, value in says.items()}  # fmt: skip


def test_time_in_which_an_alarm_would_be_false_is_valid_time_without_a_fault_of_the_lane_and_2_s_after():
    rows, healed = flown(), OFC | {"start_s": 5.0, "end_s": 6.0}
    rows[:30, 4] = 0.0
    other = lane_of(target="elevator.right_inner")
    each = ((LANE, []), (LANE, [healed]), (LANE, [healed | {"end_s": math.inf}]), (other, [healed]),
            (lane_of(fields=FIELDS[:4]), []))  # fmt: skip
    assert [judge(lane, rows, DT, faults)["exposed_s"] for lane, faults in each] == pytest.approx([7, 4, 2, 7, 10])


def test_the_largest_statistic_is_split_at_the_first_fault_and_holds_numbers_only():
    rows = flown()
    rows[:20, 3], rows[20:, 3] = -0.5, 3.0
    entry = judge(LANE, rows, DT, [OFC | {"targets": ("engine.1",)}])
    assert (entry["r_max_before"], entry["r_max_after"]) == (0.5, 3.0)
    rows[:, 3] = np.nan
    assert judge(LANE, rows, DT, [])["r_max_before"] is judge(LANE, rows, DT, [])["r_max_after"] is None
    rows[3, 3] = 0.25
    assert judge(LANE, rows, DT, [])["r_max_before"] == 0.25


def test_a_result_tells_the_time_of_the_alarm_and_that_of_the_name_apart_and_leaves_no_place_empty():
    named = judge(LANE, flown((23, 26, v.AMBIGUOUS), (26, 100, v.OFC_LIQUID)), DT, [OFC])
    only_false = judge(LANE, flown((3, 5)), DT, [OFC])
    healthy = judge(LANE, flown((3, 5), (7, 9, v.JAM_SOLID)), DT, [])
    shown = Result(None, "completed", "", 10.0, 1.0, detectors=[named, only_false, healthy])
    assert [line.split(" | ")[2:] for line in repr(shown).splitlines()[3:]] == [
        ["0.30", "0.60", "ofc_liquid", "0", "2.30 |"],
        ["–", "–", "–", "**1**", "– |"],
        ["–", "–", "jam_solid", "**2**", "0.30 |"],
    ]


# -- several faults ----------------------------------------------------------------------------------------------------


def test_each_of_several_faults_has_its_own_delay_and_name_and_the_entry_is_of_the_first_that_was_noticed():
    rows = flown((22, 30, v.OFC_LIQUID), (55, 100, v.JAM_SOLID))
    entry = judge(LANE, rows, DT, [OFC, JAM])
    said = [(d["fault"], d["detection_delay_s"], d["isolated"]["class"]) for d in entry["by_fault"]]
    assert said == [(0, pytest.approx(0.2), "ofc_liquid"), (1, pytest.approx(0.5), "jam_solid")]
    assert (entry["fault"], entry["isolated"]["class"], entry["false_alarms"]) == (0, "ofc_liquid", 0)
    late = judge(LANE, flown((53, 100, v.JAM_SOLID)), DT, [OFC, JAM])
    assert (late["fault"], late["by_fault"][0]["detected_at_s"]) == (1, None)
    surface = JAM | {"case": "hydraulic.surface"}  # which ofc_monitor does not read
    blind = judge(lane_of("ofc_monitor"), flown((53, 100)), DT, [OFC, surface])
    assert [d["fault"] for d in blind["by_fault"]] == [0] and blind["detection_delay_s"] == pytest.approx(3.3)


def test_a_second_fault_is_seen_when_a_standing_alarm_takes_its_name_and_a_false_alarm_cannot():
    rows = flown((23, 56, v.OFC_LIQUID), (56, 100, v.SENSOR, 1))
    first, second = by_fault(rows, OFC, ROD)
    assert (first["isolated"]["class"], first["time_to_right_s"]) == ("ofc_liquid", pytest.approx(0.3))
    assert second["detection_delay_s"] == pytest.approx(0.6)
    assert second["isolated"]["target"] == "elevator.left_inner.rod"
    assert by_fault(rows, ROD)[0]["detection_delay_s"] is None  # the alarm stood without a fault
    same = OFC | {"fault": 1, "start_s": 5.0}  # the same name again may be the first fault's
    assert by_fault(flown((23, 100, v.OFC_LIQUID)), OFC, same)[1]["detected_at_s"] is None


def test_a_standing_alarm_whose_place_comes_to_the_second_fault_has_seen_it_and_other_parts_mask_nothing():
    lane = lane_of("own", "aircraft", ("", "alpha", "q"), "aircraft")
    alpha, q = sensor("alpha", 2.0), sensor("q", 5.0, 1)
    missed = by_fault(flown((23, 100, v.SENSOR, 1)), alpha, q, lane=lane)[1]
    assert missed["detected_at_s"] is None and not missed["masked"]
    seen = by_fault(flown((23, 56, v.SENSOR, 1), (56, 100, v.AMBIGUOUS, 2)), alpha, q, lane=lane)[1]
    assert (seen["detected_at_s"], seen["class_given"], seen["place_given"]) == (pytest.approx(5.6), N, Y)


def test_a_second_fault_of_the_part_whose_alarm_stands_all_the_time_is_masked_and_not_missed():
    jam = JAM | {"end_s": 9.0}
    stands = flown((23, 100, v.OFC_LIQUID))
    said = entries([judge(LANE, stands, DT, [OFC, jam])], ["hydraulic.ofc_liquid"] * 2)
    assert [(e["masked"], e["outcome"]) for e in said] == [(False, "named"), (True, "masked")]
    assert by_fault(flown((23, 95, v.OFC_LIQUID)), OFC, jam)[1]["masked"]  # withdrawn after the fault's end
    for rows in (flown((23, 80, v.OFC_LIQUID)), flown((23, 45, v.OFC_LIQUID)), flown()):  # it could have risen
        assert not by_fault(rows, OFC, jam)[1]["masked"]
    assert not any(d["masked"] for d in by_fault(flown((3, 100, v.OFC_LIQUID)), OFC, jam))  # a false alarm masks none
    stands[60:, 1] = v.JAM_SOLID  # its name comes to the second fault
    second = by_fault(stands, OFC, jam)[1]
    assert (second["masked"], second["right"], second["detected_at_s"]) == (False, True, pytest.approx(6.0))


AIRFRAME = lane_of("lpv_smo", "aircraft", ("", "elevator_left", "alpha"), "aircraft")
LEFT_JAM, ALPHA = JAM | {"fault": 0, "start_s": 1.0}, sensor("alpha", 3.0, 1)


@pytest.mark.parametrize(
    "said, end_s, delays, parts",
    [
        # an alarm that blames an earlier fault which is still there is that one's, also if it rises again
        (((15, 20, 4, 1), (35, 100, 4, 1)), math.inf, (0.5, None), ("elevator_left", None)),
        (((35, 100, 4, 1),), math.inf, (2.5, None), ("elevator_left", None)),
        (((35, 100, 4, 1),), 0.5, (None, 0.5), (None, "elevator_left")),  # healed for long
        (((35, 38, 4, 1), (38, 100, 6, 2)), math.inf, (2.5, 0.8), ("elevator_left", "alpha")),  # comes to the latest
        (((35, 100, 6, 2),), math.inf, (None, 0.5), (None, "alpha")),
        (((35, 100, 9, 0),), math.inf, (None, 0.5), (None, "aircraft")),  # no part is blamed
    ],
)
def test_whose_an_alarm_is_that_rises_while_two_faults_are_there(said, end_s, delays, parts):
    found = by_fault(flown(*said), LEFT_JAM | {"end_s": 1.0 + end_s}, ALPHA, lane=AIRFRAME)
    assert [d["detection_delay_s"] for d in found] == [d and pytest.approx(d) for d in delays]
    assert tuple(d["isolated"] and d["isolated"]["target"] for d in found) == parts


@pytest.mark.parametrize("starts", [(2.0, 2.5), (2.5, 2.0)])
def test_a_name_of_one_part_never_stands_in_the_row_of_another_fault(starts):
    lane = lane_of("own", "aircraft", ("", "elevator_left", "engine_2"), "aircraft")
    engine = {"fault": 1, "case": "engine", "kind": "thrust_loss", "targets": ("engine.2",)}
    faults = [OFC | {"start_s": starts[0]}, OFC | engine | {"start_s": starts[1]}]
    for said in (((30, 60, v.THRUST, 2), (60, 100, v.OFC_LIQUID, 1)), ((30, 60, v.OFC_LIQUID, 1), (60, 100, 8, 2))):
        found = {d["fault"]: d for d in by_fault(flown(*said), *faults, lane=lane)}
        assert all(found[i]["isolated"] is None or (found[i]["isolated"]["target"], found[i]["right"]) == (part, True)
                   for i, part in enumerate(("elevator_left", "engine_2")))  # fmt: skip
        assert any(d["isolated"] for d in found.values())


def test_three_simultaneous_faults_are_each_named_by_the_alarm_of_their_part():
    parts = ("", "elevator", "n_z", "alpha")
    smo = lane_of("lpv_smo", "aircraft", parts, "aircraft", [f"alarm_{p}" for p in parts[1:]])
    rows = flown((24, 100, v.SENSOR, 2), more=3)  # the summary: n_z, declared first
    rows[26:, 6], rows[24:, 7], rows[28:, 8] = 1.0, 1.0, 1.0
    bias = OFC | {"case": "hydraulic.bias@command", "kind": "bias"}
    faults = [bias, sensor("n_z", 2.0, 1), sensor("alpha", 2.0, 2)]
    found = by_fault(rows, *faults, lane=smo)
    assert [d["detection_delay_s"] for d in found] == pytest.approx([0.6, 0.4, 0.8])
    assert [d["isolated"]["target"] for d in found] == ["elevator", "n_z", "alpha"]
    assert [(d["class_given"], d["place_given"], d["place_level"]) for d in found] == [
        (N, Y, "axis"), (Y, Y, "channel"), (Y, Y, "channel")]  # fmt: skip
    (alone,) = by_fault(rows, faults[1], lane=smo)  # elevator and alpha are accused without a fault
    assert (alone["place_given"], alone["isolated"]["target"]) == (W, "elevator and n_z and alpha")
    one_slot = lane_of("lpv_smo", "aircraft", parts, "aircraft")
    assert [d["right"] for d in by_fault(rows, *faults, lane=one_slot)] == [False, True, False]


@pytest.mark.parametrize("before", [0, 63, 64, 200])
def test_a_name_is_judged_beside_any_number_of_faults(before):
    """What names another fault alone says nothing of this one, however many stand between the two in the scenario."""
    early = [JAM | {"fault": 2 + i, "start_s": 0.0, "end_s": 0.1 + 1e-3 * i} for i in range(before)]
    rows = flown((45, 60, v.JAM_SOLID), (60, 100, v.SENSOR, 1))
    found = by_fault(rows, JAM | {"fault": 0, "start_s": 4.0}, *early, ROD | {"start_s": 1.0})
    mine = next(d for d in found if d["fault"] == 0)
    assert mine["right"] and mine["isolated"]["class"] == "jam_solid" and mine["class_changes"] == 0


def test_three_hundred_faults_in_one_flight_are_judged_in_seconds():
    rng, rows = np.random.default_rng(1), flown(ticks=3000)
    for k in range(0, 3000, 8):
        rows[k : k + 8, :3] = rng.random() < 0.6, rng.integers(1, 9), rng.integers(0, 2)
    faults = [kind | {"fault": i, "start_s": 0.9 * i} for i, kind in zip(range(300), cycle((OFC, JAM, ROD)))]
    begin = time.process_time()
    assert len(by_fault(rows, *faults)) == 300
    assert time.process_time() - begin < 15.0


def test_a_detector_written_to_be_credited_by_chance_scores_nothing():
    """A standing alarm that flickers at the onset, names in turn, a class without a part, every part accused."""
    dt, fault = 0.01, OFC | {"end_s": 8.0}
    flicker = flown((0, 1000, v.OFC_LIQUID), ticks=1000)
    flicker[::10, 0] = 0.0  # down for 10 ms in every 100
    assert judge(LANE, flicker, dt, [fault])["detected_at_s"] is None
    turn = flown((230, 1000, v.OFC_SOLID), ticks=1000)
    turn[230:, 1] = 1.0 + np.arange(770) % 8  # every class for 10 ms
    turn[799, 1] = v.OFC_LIQUID  # and the right one last
    e = judge(LANE, turn, dt, [fault])
    assert e["detected_at_s"] is not None and e["time_to_right_s"] is None and not e["right"]
    everybody = lane_of("own", "aircraft", ("", "q", "theta"), "aircraft", ("alarm_q", "alarm_theta"))
    rows = flown((250, 1000, v.SENSOR, 1), ticks=1000, more=2)
    rows[250:, 6:] = 1.0
    e = judge(everybody, rows, dt, [sensor("q", 2.0)])
    assert e["place_given"] == W and not e["right"]
    rows[:, 2], rows[:, 6:] = 0.0, 0.0  # a class without a part
    e = judge(everybody, rows, dt, [sensor("q", 2.0)])
    assert e["place_given"] == N and not e["right"]


# -- of any history ----------------------------------------------------------------------------------------------------

alarms = st.lists(st.booleans(), min_size=1, max_size=80).map(lambda x: np.array(x, float))
times = st.floats(0.0, 8.0)


@given(alarms, times, times)
def test_every_onset_is_either_false_or_within_a_fault_and_standing_never_exceeds_the_alarm(alarm, a, b):
    fault = OFC | {"start_s": min(a, b + 0.1), "end_s": max(a, b + 0.1)}
    rows = flown(ticks=len(alarm))
    rows[:, 0] = alarm
    e = judge(LANE, rows, DT, [fault])
    own = [fault] if acts(fault, len(alarm), DT) else []  # a short one may be in no tick
    true = during(own, np.arange(len(alarm)), DT)
    rises = [k for k in range(len(alarm)) if alarm[k] and (k == 0 or not alarm[k - 1])]
    assert e["false_alarms"] == sum(not true[k] for k in rises)
    assert e["standing_s"] == pytest.approx((alarm * ~true).sum() * DT)


@given(alarms, st.lists(st.sampled_from([0.0, 1.0, 2.0, 9.0]), min_size=80, max_size=80), times)
def test_times_are_in_order_whatever_is_said(alarm, codes, start):
    rows = flown(ticks=len(alarm))
    rows[:, 0], rows[:, 1] = alarm, codes[: len(alarm)]
    e = judge(LANE, rows, DT, [OFC | {"start_s": start}])
    delay, right = e["detection_delay_s"], e["time_to_right_s"]
    assert delay is None or delay >= 0.0
    assert right is None or (delay is not None and right >= delay - 1e-9)
    assert not e["right"] or right is not None
    assert e["alarm_share"] is None or 0.0 < e["alarm_share"] <= 1.0


@given(st.lists(st.integers(0, 100), max_size=4))
def test_what_comes_in_blocks_is_judged_as_the_whole_and_its_spans_are_half_open(cuts):
    rows, faults = flown((3, 5), (23, 40, v.OFC_SOLID), (40, 100, v.OFC_LIQUID)), [OFC, JAM]
    rows[:, 3] = np.linspace(-1, 0.5, 100)
    told = Said(LANE, DT, faults)
    for a, b in pairwise([0, *sorted(cuts), 100]):
        told.add(rows[a:b])
    same = {"step_us": pytest.approx(math.nan, nan_ok=True)}
    assert entry_of(told, DT, faults) == judge(LANE, rows, DT, faults) | same
    assert told.spans("alarm") == [(3, 5), (23, 100)] and len(told.first) == 5
