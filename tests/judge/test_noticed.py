"""What a lane made of a fault, on histories made by hand, and what must hold for any history."""

import math
import re
import time
from itertools import cycle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.judge.alarms import GRACE_S, acts, detection, faulty, onsets
from cosim.judge.detection import watch_of
from cosim.judge.lanes import entries
from cosim.judge.result import Result, judge
from fdi.common import verdict as v
from fdi.common import why

DT = 0.1
FIELDS = ("alarm", "verdict", "culprit", "r", "valid", "why")
LANE = watch_of("iotsekf", "local", "elevator.left_inner", ("", "rod"), {n: i for i, n in enumerate(FIELDS)})
OFC = {"fault": 0, "case": "hydraulic.ofc_liquid", "kind": "ofc_liquid", "targets": ("elevator.left_inner",),
       "start_s": 2.0, "end_s": math.inf, "period_s": 0.5}  # fmt: skip


def flown(*said, ticks=100, valid=1.0, reason=0.0):
    """Return a history in which the alarm stands with a class over [(first, last, class), ...]."""
    rows = np.zeros((ticks, len(FIELDS)))
    rows[:, 4], rows[:, 5] = valid, reason
    for first, last, code in said:
        rows[first:last, 0], rows[first:last, 1] = 1.0, code
    return rows


def test_the_first_name_the_right_name_and_the_last_have_their_own_times():
    e = judge(LANE, flown((23, 26, v.AMBIGUOUS), (26, 40, v.OFC_SOLID), (40, 100, v.OFC_LIQUID)), DT, [OFC])
    assert (e["first_verdict"]["class"], e["isolated"]["class"]) == ("ambiguous", "ofc_liquid")
    assert e["detection_delay_s"] == pytest.approx(0.3) and e["time_to_right_s"] == pytest.approx(2.0)
    assert (e["class_changes"], e["ambiguous_s"], e["right"]) == (2, pytest.approx(0.3), True)


def test_the_name_at_the_end_is_that_of_the_last_second_however_long_another_stood():
    e = judge(LANE, flown((23, 92, v.OFC_SOLID), (92, 100, v.OFC_LIQUID)), DT, [OFC])
    assert e["isolated"]["class"] == "ofc_liquid"


def test_an_alarm_in_the_tick_of_the_onset_has_no_delay():
    fault = OFC | {"start_s": 2.04}  # acts in tick 20, which begins at 2.0 s
    e = judge(LANE, flown((20, 100, v.OFC_LIQUID)), DT, [fault])
    assert (e["detection_delay_s"], e["detection_delay_periods"]) == (0.0, 0.0)


def test_a_result_tells_the_time_of_the_alarm_and_that_of_the_name_apart_and_leaves_no_place_empty():
    named = judge(LANE, flown((23, 26, v.AMBIGUOUS), (26, 100, v.OFC_LIQUID)), DT, [OFC])
    only_false = judge(LANE, flown((3, 5, v.NONE)), DT, [OFC])
    healthy = judge(LANE, flown((3, 5, v.NONE), (7, 9, v.JAM_SOLID)), DT, [])
    shown = Result(None, "completed", "", 10.0, 1.0, detectors=[named, only_false, healthy])
    told = [line.split("elevator.left_inner")[1].strip() for line in repr(shown).splitlines()[1:]]
    assert told == [
        "alarm at 2.30 s, 0.30 s after the fault; ofc_liquid at 2.60 s",
        "1 false alarm",
        "alarm at 0.30 s; jam_solid at 0.70 s; 2 false alarms",
    ]
    cells = [re.findall("<td>([^<]*)", row)[2:] for row in shown._repr_html_().split("<tr>")[2:]]
    assert [[c for c in row if c != "–"] for row in cells] == [line.split("; ") for line in told]
    assert all(text.strip() for row in cells for text in row)


def test_ambiguous_is_never_right_and_a_right_name_that_is_given_up_is_not_right_at_the_end():
    e = judge(LANE, flown((23, 100, v.AMBIGUOUS)), DT, [OFC])
    assert e["time_to_right_s"] is None and not e["right"] and e["detection_delay_s"] is not None
    e = judge(LANE, flown((23, 30, v.OFC_LIQUID), (30, 100, v.RUNAWAY)), DT, [OFC])
    assert e["time_to_right_s"] == pytest.approx(0.3) and not e["right"]


def test_withdrawal_counts_to_the_last_alarm_and_what_stands_too_long_is_standing():
    healed = {**OFC, "end_s": 4.0}
    e = judge(LANE, flown((23, 45, v.OFC_LIQUID), (50, 55, v.OFC_LIQUID)), DT, [healed])
    assert e["withdrawn"] is True and e["withdrawn_after_s"] == pytest.approx(1.5) and e["standing_s"] == 0.0
    e = judge(LANE, flown((23, 100, v.OFC_LIQUID)), DT, [healed])
    assert e["withdrawn"] is False and e["withdrawn_after_s"] is None
    assert e["false_alarms"] == 0 and e["standing_s"] == pytest.approx(10.0 - 4.0 - GRACE_S)
    assert judge(LANE, flown((23, 100, v.OFC_LIQUID)), DT, [OFC])["withdrawn"] is None  # it never heals


def test_share_of_the_time_that_an_alarm_stands_counts_its_gaps():
    assert judge(LANE, flown((20, 60, 1.0), (80, 100, 1.0)), DT, [OFC])["alarm_share"] == pytest.approx(0.75)


def test_a_lane_that_could_not_judge_says_why_and_one_that_noticed_could():
    away = flown(valid=0.0, reason=why.BOX_MASS)
    e = judge(LANE, away, DT, [OFC])
    assert (e["able"], e["valid_at_fault"], e["why_not_valid"]) == (False, 0.0, "outside its box (mass)")
    assert e["valid_share"] == 0.0
    seen = flown((23, 100, 1.0), valid=0.0, reason=why.BOX_MASS)
    assert judge(LANE, seen, DT, [OFC])["able"] is True
    assert judge(LANE, flown(), DT, [OFC])["able"] is True and judge(LANE, flown(), DT, [OFC])["why_not_valid"] is None


def test_a_jam_that_never_showed_is_not_excited_and_the_right_name_counts_from_motion():
    jam = {**OFC, "case": "hydraulic.jam_solid", "kind": "jam_solid", "moved_at_s": {"left_inner": 5.0}}
    e = judge(LANE, flown((53, 100, v.JAM_SOLID)), DT, [jam])
    assert (e["not_excited"], e["right_after_motion_s"]) == (False, pytest.approx(0.3))
    still = {**jam, "moved_at_s": {"left_inner": math.inf}}
    assert judge(LANE, flown(), DT, [still])["not_excited"] is True
    assert judge(LANE, flown(), DT, [{**jam, "moved_at_s": None}])["not_excited"] is None  # nobody looked


def test_a_second_fault_is_seen_when_a_standing_alarm_takes_its_name_and_a_false_alarm_cannot():
    rod = {**OFC, "fault": 1, "case": "hydraulic.rod", "targets": ("elevator.left_inner.rod",), "start_s": 5.0}
    rows = flown((23, 100, v.OFC_LIQUID))
    rows[56:, 1], rows[56:, 2] = v.SENSOR, 1.0
    first, second = judge(LANE, rows, DT, [OFC, rod])["by_fault"]
    assert (first["isolated"]["class"], first["time_to_right_s"]) == ("ofc_liquid", pytest.approx(0.3))
    assert (second["detection_delay_s"], second["isolated"]["target"]) == (
        pytest.approx(0.6), "elevator.left_inner.rod")  # fmt: skip
    assert judge(LANE, rows, DT, [rod])["detection_delay_s"] is None  # the alarm stood without a fault
    same = {**OFC, "fault": 1, "start_s": 5.0}  # the same name again may be the first fault's
    assert judge(LANE, flown((23, 100, v.OFC_LIQUID)), DT, [OFC, same])["by_fault"][1]["detected_at_s"] is None


def test_a_second_fault_of_the_part_whose_alarm_stands_all_the_time_is_masked_and_not_missed():
    jam = {**OFC, "fault": 1, "case": "hydraulic.jam_solid", "kind": "jam_solid", "start_s": 5.0, "end_s": 9.0}
    stands = flown((23, 100, v.OFC_LIQUID))
    _, second = judge(LANE, stands, DT, [OFC, jam])["by_fault"]
    assert second["masked"] and second["detected_at_s"] is None
    (told,) = [e for e in entries([judge(LANE, stands, DT, [OFC, jam])], ["hydraulic.ofc_liquid"] * 2) if e["fault"]]
    assert told["outcome"] == "masked"
    withdrawn = flown((23, 95, v.OFC_LIQUID))  # after the fault's end
    assert judge(LANE, withdrawn, DT, [OFC, jam])["by_fault"][1]["masked"]
    for rows in (flown((23, 80, v.OFC_LIQUID)), flown((23, 45, v.OFC_LIQUID)), flown()):  # it could have risen
        assert not judge(LANE, rows, DT, [OFC, jam])["by_fault"][1]["masked"]
    early = judge(LANE, flown((3, 100, v.OFC_LIQUID)), DT, [OFC, jam])["by_fault"]  # a false alarm masks nothing
    assert not any(d["masked"] for d in early)
    stands[60:, 1] = v.JAM_SOLID  # its name comes to the second fault
    _, second = judge(LANE, stands, DT, [OFC, jam])["by_fault"]
    assert (second["masked"], second["right"], second["detected_at_s"]) == (False, True, pytest.approx(6.0))


def test_a_standing_alarm_whose_place_comes_to_the_second_fault_has_seen_it_and_other_parts_mask_nothing():
    parts = ("", "alpha", "q")
    lane = watch_of("own", "aircraft", "aircraft", parts, {n: i for i, n in enumerate(FIELDS)})
    alpha, q = ({**OFC, "fault": i, "case": f"sensor.{n}", "kind": "bias", "targets": (f"sensor.{n}",)}
                for i, n in enumerate(parts[1:]))  # fmt: skip
    rows = flown((23, 100, v.SENSOR))
    rows[:, 2] = 1.0
    missed = judge(lane, rows, DT, [alpha, q | {"start_s": 5.0}])["by_fault"][1]
    assert missed["detected_at_s"] is None and not missed["masked"]
    rows[56:, 1], rows[56:, 2] = v.AMBIGUOUS, 2.0
    seen = judge(lane, rows, DT, [alpha, q | {"start_s": 5.0}])["by_fault"][1]
    assert (seen["detected_at_s"], seen["class_given"], seen["place_given"]) == (
        pytest.approx(5.6), "not given", "right")  # fmt: skip


def test_three_hundred_faults_in_one_flight_are_judged_in_seconds():
    rng = np.random.default_rng(1)
    rows = flown(ticks=3000)
    for k in range(0, 3000, 8):
        rows[k : k + 8, :3] = rng.random() < 0.6, rng.integers(1, 9), rng.integers(0, 2)
    kinds = (("ofc_liquid", "ofc_liquid", ""), ("jam_solid", "jam_solid", ""), ("rod", "bias", ".rod"))
    faults = [{**OFC, "fault": i, "case": f"hydraulic.{c}", "kind": k, "targets": (OFC["targets"][0] + sensor,),
               "start_s": 0.9 * i} for i, (c, k, sensor) in zip(range(300), cycle(kinds))]  # fmt: skip
    begin = time.process_time()
    assert len(judge(LANE, rows, DT, faults)["by_fault"]) == 300
    assert time.process_time() - begin < 15.0


def test_three_simultaneous_faults_are_each_named_by_the_alarm_of_their_part():
    fields = (*FIELDS, "alarm_elevator", "alarm_n_z", "alarm_alpha")
    smo = watch_of("lpv_smo", "aircraft", "aircraft", ("", "elevator", "n_z", "alpha"),
                   {n: i for i, n in enumerate(fields)})  # fmt: skip
    rows = np.zeros((100, len(fields)))
    rows[:, 4] = 1.0
    rows[24:, 0], rows[24:, 1], rows[24:, 2] = 1.0, v.SENSOR, 2.0  # the summary: n_z, declared first
    rows[24:, 7], rows[26:, 6], rows[28:, 8] = 1.0, 1.0, 1.0
    at = {"start_s": 2.0, "end_s": math.inf, "period_s": math.nan}
    faults = [
        {"fault": 0, "case": "hydraulic.bias@command", "kind": "bias", "targets": ("elevator.left_inner",), **at},
        {"fault": 1, "case": "sensor.n_z", "kind": "bias", "targets": ("sensor.n_z",), **at},
        {"fault": 2, "case": "sensor.alpha", "kind": "bias", "targets": ("sensor.alpha",), **at},
    ]
    found = judge(smo, rows, DT, faults)["by_fault"]
    assert [d["detection_delay_s"] for d in found] == pytest.approx([0.6, 0.4, 0.8])
    assert [d["isolated"]["target"] for d in found] == ["elevator", "n_z", "alpha"]
    assert [(d["class_given"], d["place_given"], d["place_level"]) for d in found] == [
        ("not given", "right", "axis"), ("right", "right", "channel"), ("right", "right", "channel")]  # fmt: skip
    alone = judge(smo, rows, DT, faults[1:2])["by_fault"][0]  # elevator and alpha are accused without a fault
    assert alone["place_given"] == "wrong" and alone["isolated"]["target"] == "elevator and n_z and alpha"
    one_slot = watch_of("lpv_smo", "aircraft", "aircraft", smo.culprits, {n: i for i, n in enumerate(FIELDS)})
    assert [d["right"] for d in judge(one_slot, rows, DT, faults)["by_fault"]] == [False, True, False]


alarms = st.lists(st.booleans(), min_size=1, max_size=80).map(lambda x: np.array(x, float))
times = st.floats(0.0, 8.0)


@given(alarms)
def test_onsets_are_where_the_alarm_is_up_and_was_not(alarm):
    rises = onsets(alarm)
    assert all(alarm[k] and (k == 0 or not alarm[k - 1]) for k in rises)
    assert len(rises) == sum(alarm[k] and (k == 0 or not alarm[k - 1]) for k in range(len(alarm)))


@given(alarms, st.integers(0, 90), st.integers(0, 90))
def test_a_detection_is_the_first_onset_of_its_window(alarm, first, end):
    k, inside = detection(alarm, first, end), [int(i) for i in onsets(alarm) if first <= i < end]
    assert k == (inside[0] if inside else None)


@given(alarms, times, times)
def test_every_onset_is_either_false_or_within_a_fault_and_standing_never_exceeds_the_alarm(alarm, a, b):
    start, end = sorted((a, b + 0.1))
    fault = {**OFC, "start_s": start, "end_s": end}
    rows = flown(ticks=len(alarm))
    rows[:, 0] = alarm
    e = judge(LANE, rows, DT, [fault])
    true = faulty([fault] if acts(fault, len(alarm), DT) else [], len(alarm), DT)  # a short one may be in no tick
    assert e["false_alarms"] == sum(not true[k] for k in onsets(alarm))
    assert e["standing_s"] + 1e-9 >= 0.0 and e["standing_s"] <= alarm.sum() * DT + 1e-9
    assert e["standing_s"] == pytest.approx((alarm * ~true).sum() * DT)


@given(alarms, st.lists(st.sampled_from([0.0, 1.0, 2.0, 9.0]), min_size=80, max_size=80), times)
def test_times_are_in_order_whatever_is_said(alarm, codes, start):
    rows = flown(ticks=len(alarm))
    rows[:, 0], rows[:, 1] = alarm, np.array(codes[: len(alarm)])
    e = judge(LANE, rows, DT, [{**OFC, "start_s": start}])
    delay, right = e["detection_delay_s"], e["time_to_right_s"]
    assert delay is None or delay >= 0.0
    assert right is None or (delay is not None and right >= delay - 1e-9)
    assert not e["right"] or right is not None
    assert e["alarm_share"] is None or 0.0 < e["alarm_share"] <= 1.0


def test_a_detector_written_to_be_credited_by_chance_scores_nothing():
    """A standing alarm that flickers at the onset, names in turn, a class without a part, every part accused."""
    dt = 0.01
    flicker = flown(ticks=1000)
    flicker[:, 0], flicker[:, 1] = np.arange(1000) % 10 < 9, v.OFC_LIQUID  # always up, 10 ms down in every 100
    fault = {**OFC, "end_s": 8.0}
    assert judge(LANE, flicker, dt, [fault])["detected_at_s"] is None
    turn = flown((230, 1000, v.OFC_SOLID), ticks=1000)
    turn[230:, 1] = 1.0 + np.arange(770) % 8  # every class for 10 ms
    turn[799, 1] = v.OFC_LIQUID  # and the right one last
    e = judge(LANE, turn, dt, [fault])
    assert e["detected_at_s"] is not None and e["time_to_right_s"] is None and not e["right"]
    fields = (*FIELDS, "alarm_q", "alarm_theta")
    all_parts = watch_of("own", "aircraft", "aircraft", ("", "q", "theta"), {n: i for i, n in enumerate(fields)})
    rows = np.zeros((1000, len(fields)))
    rows[250:, 0], rows[250:, 1], rows[250:, 2], rows[250:, 6:] = 1.0, v.SENSOR, 1.0, 1.0
    q = {**OFC, "case": "sensor.q", "kind": "bias", "targets": ("sensor.q",)}
    e = judge(all_parts, rows, dt, [q])
    assert e["place_given"] == "wrong" and not e["right"]
    rows[:, 2], rows[:, 6:] = 0.0, 0.0  # a class without a part
    e = judge(all_parts, rows, dt, [q])
    assert e["place_given"] == "not given" and not e["right"]


def test_a_name_of_one_part_never_stands_in_the_row_of_another_fault():
    parts = ("", "elevator_left", "engine_2")
    single = watch_of("own", "aircraft", "aircraft", parts, {n: i for i, n in enumerate(FIELDS)})
    rows = flown((25, 100, v.THRUST))
    rows[25:, 2] = 2.0
    rows[60:, 1], rows[60:, 2] = v.OFC_LIQUID, 1.0
    engine = {**OFC, "fault": 1, "case": "engine", "kind": "thrust_loss", "targets": ("engine.2",)}
    found = judge(single, rows, DT, [OFC, engine])["by_fault"]
    assert [d["isolated"]["target"] for d in found] == ["elevator_left", "engine_2"]
    assert all(d["right"] for d in found)


def test_a_lane_that_names_two_parts_at_once_is_judged_by_each_with_its_own_class():
    fields = (*FIELDS, "second", "verdict_2")
    culprits = ("", "alpha", "elevator_left_inner_valve", "n_z")
    lane = watch_of("joint", "both", "aircraft", culprits, {n: i for i, n in enumerate(fields)})
    alpha = {"fault": 1, "case": "sensor.alpha", "kind": "bias", "targets": ("sensor.alpha",), "start_s": 5.0,
             "end_s": math.inf, "period_s": math.nan}  # fmt: skip
    rows = np.zeros((100, len(fields)))
    rows[:, 4] = 1.0
    rows[22:, :3] = 1.0, v.OFC_LIQUID, 2.0
    rows[56:, 6:] = 1.0, v.SENSOR
    ofc, second = judge(lane, rows, DT, [OFC, alpha])["by_fault"]
    assert (ofc["right"], ofc["place_level"], ofc["detected_at_s"]) == (True, "channel", pytest.approx(2.2))
    assert (second["right"], second["detected_at_s"]) == (True, pytest.approx(5.6))
    rows[56:, 6] = 3.0  # a healthy sensor beside the valve: nothing was said of alpha, and the valve's name is wrong
    ofc, second = judge(lane, rows, DT, [OFC, alpha])["by_fault"]
    assert second["detected_at_s"] is None and not second["right"]
    assert judge(lane, rows, DT, [OFC])["by_fault"][0]["place_given"] == "wrong"


@pytest.mark.parametrize("before", [0, 62, 63, 64, 200])
def test_a_name_is_judged_beside_any_number_of_faults(before):
    """What names another fault alone says nothing of this one, however many stand between the two in the scenario."""
    jam = OFC | {"fault": 0, "case": "hydraulic.jam_solid", "kind": "jam_solid"}
    early = [jam | {"fault": 1 + i, "start_s": 0.0, "end_s": 0.1 + 1e-3 * i} for i in range(before)]
    rod = {"case": "hydraulic.rod.bias", "kind": "bias", "targets": ("elevator.left_inner.rod",), "start_s": 1.0}
    rod = OFC | rod | {"fault": 1 + before}
    rows = flown((45, 60, v.JAM_SOLID), (60, 100, v.SENSOR))
    rows[60:, 2] = 1.0  # the rod's
    e = judge(LANE, rows, DT, [jam | {"start_s": 4.0}, *early, rod])
    mine = next(d for d in e["by_fault"] if d["fault"] == 0)
    assert mine["right"] and mine["isolated"]["class"] == "jam_solid" and mine["class_changes"] == 0


@pytest.mark.parametrize(("start_s", "end_s"), [(3.01, 3.02), (9.97, math.inf)])
def test_a_fault_that_acts_in_no_tick_is_not_missed(start_s, end_s):
    e = judge(LANE, flown(), DT, [OFC | {"start_s": start_s, "end_s": end_s}])
    assert not e["concerned"] and e["by_fault"] == []
    assert judge(LANE, flown(), DT, [OFC | {"start_s": 3.01, "end_s": 3.11}])["concerned"]
