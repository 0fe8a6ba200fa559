"""What a run comes to: delays, false alarms, errors of estimates, and how far a fault moved its elevator."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cosim.flight.faults import fault_free_reference
from cosim.flight.faults.fault_free_reference import achieved
from cosim.flight.simulate import simulate
from cosim.judge.estimation import Estimate, plan
from cosim.judge.result import Watch, judge
from cosim.scenario import load_scenario

DT = 0.1
LANE = Watch("x", "local", "elevator.left_inner", ("", "rod"), 0, 1, 2, 3)
FAULT = {"targets": ("elevator.left_inner",), "start_s": 2.0, "end_s": math.inf, "period_s": 0.5}


def lane(alarms, ticks=50, r=None):
    """Return a history in which the alarm stands in the given spans of ticks, with verdict 1 (ofc_liquid)."""
    rows = np.zeros((ticks, 4), np.float32)
    for first, last in alarms:
        rows[first:last, :2] = 1.0
    rows[:, 3] = 0.0 if r is None else r
    return rows


def test_delay_counts_from_the_onset_in_seconds_and_periods():
    entry = judge(LANE, lane([(25, 50)]), DT, [FAULT])
    assert (entry["detected_at_s"], entry["detection_delay_s"], entry["detection_delay_periods"]) == pytest.approx(
        (2.5, 0.5, 1.0)
    )
    assert entry["isolated"] == {"class": "ofc_liquid", "target": "elevator.left_inner"} and entry["false_alarms"] == 0


def test_an_alarm_that_stood_before_the_fault_is_false_and_no_detection():
    entry = judge(LANE, lane([(10, 50)]), DT, [FAULT])
    assert entry["detection_delay_s"] is None and entry["false_alarms"] == 1 and entry["alarm"]


def test_an_alarm_that_falls_and_rises_again_after_the_onset_detects():
    entry = judge(LANE, lane([(10, 22), (30, 50)]), DT, [FAULT])
    assert entry["detection_delay_s"] == pytest.approx(1.0) and entry["false_alarms"] == 1


def test_an_alarm_after_the_fault_has_healed_for_long_is_false():
    healed = {**FAULT, "end_s": 2.5}
    assert judge(LANE, lane([(44, 46)], 60), DT, [healed])["false_alarms"] == 0  # within 2 s of the end
    assert judge(LANE, lane([(46, 50)], 60), DT, [healed])["false_alarms"] == 1


def test_a_fault_elsewhere_makes_a_local_alarm_false():
    entry = judge(LANE, lane([(25, 30)]), DT, [{**FAULT, "targets": ("elevator.right_inner",)}])
    assert not entry["concerned"] and entry["false_alarms"] == 1 and entry["detection_delay_s"] is None


def test_a_fault_that_did_not_begin_before_the_end_concerns_no_lane():
    entry = judge(LANE, lane([(10, 12)]), DT, [{**FAULT, "start_s": 5.0}])  # 50 ticks of 0.1 s
    assert not entry["concerned"] and not entry["by_fault"] and entry["false_alarms"] == 1
    assert judge(LANE, lane([]), DT, [{**FAULT, "start_s": 4.9}])["concerned"]


def several(*starts, **cases):
    """Return faults 0, 1, ... on the lane's actuator at `starts` [s]; `cases` {"of1": case} for a detector's table."""
    return [{**FAULT, "fault": i, "start_s": t, "case": cases.get(f"of{i}", "")} for i, t in enumerate(starts)]


def test_each_of_several_faults_has_its_own_delay_and_verdict():
    history = lane([(12, 20), (35, 50)])
    history[12:20, 1], history[35:, 1] = 4.0, 6.0  # jam_solid, then sensor
    entry = judge(LANE, history, DT, several(1.0, 3.0))
    assert [(d["fault"], d["detection_delay_s"], d["isolated"]["class"]) for d in entry["by_fault"]] == [
        (0, pytest.approx(0.2), "jam_solid"), (1, pytest.approx(0.5), "sensor")]  # fmt: skip
    assert (entry["fault"], entry["isolated"]["class"], entry["false_alarms"]) == (0, "jam_solid", 0)


def test_an_alarm_counts_for_the_latest_fault_that_the_lane_could_notice():
    late = judge(LANE, lane([(33, 50)]), DT, several(1.0, 3.0))
    assert late["fault"] == 1 and late["detection_delay_s"] == pytest.approx(0.3)
    assert late["by_fault"][0]["detected_at_s"] is None
    watch = Watch("ofc_monitor", "local", "elevator.left_inner", ("", "rod"), 0, 1, 2, 3)
    cases = {"of0": "hydraulic.ofc_liquid", "of1": "hydraulic.surface"}  # it reads no surface sensor
    blind = judge(watch, lane([(33, 50)]), DT, several(1.0, 3.0, **cases))
    assert [d["fault"] for d in blind["by_fault"]] == [0] and blind["detection_delay_s"] == pytest.approx(2.3)


AIRFRAME = Watch("x", "aircraft", "aircraft", ("", "elevator_left", "alpha"), 0, 1, 2, 3)


def blamed(part, *spans):
    history = lane(spans)
    history[:, 2] = np.where(history[:, 0] > 0.5, part, 0)
    return history


def elevator_then_alpha():
    targets = ("elevator.left_inner",), ("sensor.alpha",)
    return [{**f, "targets": t} for f, t in zip(several(1.0, 3.0), targets, strict=True)]


def test_an_alarm_that_blames_an_earlier_fault_that_is_still_there_is_that_ones():
    """Whether it rises again or for the first time; one that has healed for long is there no more."""
    again = judge(AIRFRAME, blamed(1, (15, 20), (35, 50)), DT, elevator_then_alpha())["by_fault"]
    assert [d["detection_delay_s"] for d in again] == [pytest.approx(0.5), None]
    late = judge(AIRFRAME, blamed(1, (35, 50)), DT, elevator_then_alpha())["by_fault"]
    assert [d["detection_delay_s"] for d in late] == [pytest.approx(2.5), None]
    assert late[0]["isolated"]["target"] == "elevator_left"
    short = elevator_then_alpha()
    short[0]["end_s"] = 1.2
    healed = judge(AIRFRAME, blamed(1, (35, 50)), DT, short)["by_fault"]
    assert [d["detection_delay_s"] for d in healed] == [None, pytest.approx(0.5)]
    assert not healed[1]["right"]


def test_an_alarm_that_rises_for_an_earlier_fault_may_come_to_the_name_of_the_latest():
    history = blamed(1, (35, 50))
    history[38:, 1], history[38:, 2] = 6.0, 2  # sensor alpha
    faults = elevator_then_alpha()
    faults[0]["case"], faults[1]["case"] = "hydraulic.jam_solid", "sensor.alpha"
    rows = judge(replace(AIRFRAME, id="lpv_smo"), history, DT, faults)["by_fault"]
    assert [d["detection_delay_s"] for d in rows] == [pytest.approx(2.5), pytest.approx(0.8)]
    assert rows[0]["isolated"]["target"] == "elevator_left" and rows[1]["isolated"]["target"] == "alpha"


def test_an_alarm_that_blames_the_latest_fault_or_no_part_is_the_latest_ones():
    for part in (2, 0):
        rows = judge(AIRFRAME, blamed(part, (35, 50)), DT, elevator_then_alpha())["by_fault"]
        assert [d["detection_delay_s"] for d in rows] == [None, pytest.approx(0.5)]


def test_what_is_said_after_a_fault_has_healed_is_not_its_name():
    history = lane([(25, 45)])
    history[40:, 1] = 4.0
    assert judge(LANE, history, DT, [{**FAULT, "end_s": 3.8}])["isolated"]["class"] == "ofc_liquid"


def test_largest_residual_is_split_at_the_first_fault_of_the_flight():
    r = np.r_[np.full(20, -0.5), np.full(30, 3.0)]
    entry = judge(LANE, lane([], r=r), DT, [{**FAULT, "targets": ("engine.1",)}])
    assert (entry["r_max_before"], entry["r_max_after"]) == (0.5, 3.0)
    assert judge(LANE, lane([], r=r), DT, [])["r_max_after"] is None


def test_a_residual_without_a_number_is_not_a_maximum():
    r = np.full(50, np.nan)
    assert judge(LANE, lane([], r=r), DT, [])["r_max_before"] is None
    r[3] = 0.25
    assert judge(LANE, lane([], r=r), DT, [])["r_max_before"] == 0.25


def test_error_of_an_estimate_counts_settled_ticks_only():
    history = np.zeros((50, 2), np.float32)
    history[:, 0], history[30:, 1] = 1.5, 1.0
    told = Estimate(0, (1,), lambda v, dt, held: v[0], "m", start=3.0, end=4.0)
    assert np.concatenate([*told.error(history, DT)]).tolist() == [0.5] * 10
    watch = Watch("x", "local", "elevator.left_inner", ("",), 0, 0, 0, None, told)
    entry = judge(watch, history, DT, [FAULT])
    assert (entry["estimate_rmse"], entry["estimate_bias"], entry["estimate_max"], entry["estimate_unit"]) == (
        0.5, 0.5, 0.5, "m",
    )  # fmt: skip


def test_an_estimate_counts_after_the_ramp_and_three_periods():
    made = plan(load_scenario("liquid-ofc", ["faults.0.ramp_s=5"]), "iotsekf", "left_inner", lambda name: 0)
    assert made is not None and made.start == pytest.approx(12.0 + 5.0 + 3.0)


def flight(name, **more):
    return load_scenario(name, [f"{k}={v}" for k, v in more.items()])


def lanes(result, detector):
    return {d["target"]: d for d in result.detectors if d["id"] == detector}


def test_iotsekf_estimates_the_oscillation_at_the_valve():
    s = flight("liquid-ofc", duration_s=10, **{"faults.0.start_s": 2, "detectors.enabled": '["iotsekf"]'})
    found = lanes(simulate(s, timed=False), "iotsekf")
    faulty, healthy = found["elevator.left_inner"], found["elevator.left_outer"]
    injected = 8e-3 * 2 * math.pi  # 8 mm at 1 Hz is about this rod speed, and 1 of u is 1 m/s: the scale of the truth
    assert faulty["estimate_unit"] == "u" and faulty["estimate_rmse"] < 0.15 * injected
    assert abs(faulty["estimate_bias"]) < 0.05 * injected
    assert healthy["estimate_rmse"] is None


@pytest.mark.parametrize(
    "name, detector, target, unit, size, share",
    [
        ("alwi14-simultaneous", "lpv_smo", "aircraft", "rad", math.radians(3), 0.35),
        ("ema-position-bias", "ema_kalman_flight", "elevator.right_inner", "m", 5e-3, 0.2),
        ("solid-ofc", "iotsekf", "elevator.left_inner", "u", 8e-3 * 2 * math.pi, 0.3),
        ("thrust-loss", "control_redundancy", "aircraft", "fraction", 0.25, 0.1),
    ],
)
def test_estimates_are_of_the_size_of_their_fault(name, detector, target, unit, size, share):
    found = lanes(simulate(load_scenario(name), timed=False), detector)[target]
    assert found["estimate_unit"] == unit and found["estimate_rmse"] < share * size


def test_achieved_amplitude_is_the_rod_s_own_oscillation():
    """Against the log: half the peak-to-peak of the rod in still air, which the linear loop puts near 8 mm."""
    s = flight("liquid-ofc", duration_s=8, **{"faults.0.start_s": 2, "flight.turbulence": '"none"'})
    entry = achieved(s)["left_inner"]
    assert entry["amplitude_mm"] == pytest.approx(8.0, rel=0.15)
    assert entry["rod_mm"] >= entry["amplitude_mm"] * 0.98
    assert entry["amplitude_deg"] == pytest.approx(entry["amplitude_mm"] / 5.24, rel=0.02)  # 5.24 mm per degree
    assert entry["travel_pct"] == pytest.approx(entry["surface_deg"] / 0.4)


def test_amplitude_is_told_apart_from_gusts_that_are_larger():
    still = flight("liquid-ofc", duration_s=10, **{"faults.0.start_s": 2, "faults.0.amplitude_mm": 0.5})
    rough = flight(
        "liquid-ofc",
        duration_s=10,
        **{"faults.0.start_s": 2, "faults.0.amplitude_mm": 0.5, "flight.turbulence": "moderate"},
    )
    a, b = (achieved(s)["left_inner"]["amplitude_mm"] for s in (still, rough))
    assert b == pytest.approx(a, rel=0.25)  # friction and load change with the gusts


def test_a_fault_that_touches_no_elevator_moves_none_and_flies_no_twin():
    fault_free_reference._positions.clear()
    s = flight("thrust-loss", duration_s=2, **{"faults.0.start_s": 1})
    assert achieved(s) == {} and not fault_free_reference._positions


def test_runs_that_differ_in_their_fault_share_their_twin():
    fault_free_reference._positions.clear()
    for hz in (1, 2):
        achieved(flight("liquid-ofc", duration_s=2, **{"faults.0.start_s": 1, "faults.0.frequency_hz": hz}))
    assert len(fault_free_reference._positions) == 1


def test_a_monitor_s_fault_has_no_achieved_amplitude():
    s = flight("ema-current-bias", duration_s=2, **{"faults.0.start_s": 1})
    assert achieved(s) == {}


@pytest.mark.parametrize("onsets", [(2.0, 2.5), (2.5, 2.0)])
@pytest.mark.parametrize("side", ["left", "right"])
def test_with_two_faults_the_name_of_one_part_never_stands_in_the_row_of_the_other(side, onsets):
    """An oscillation of the left elevators beside a fault of a right one, in either order, and both blamed in turn."""
    watch = Watch("rfafe", "aircraft", "aircraft", ("", "elevator_left", "elevator_right"), 0, 1, 2, 3)
    parts = (("elevator.left_inner", "hydraulic.ofc_liquid"), ("elevator.right_inner", "ema.jam_solid"))
    faults = [
        {**FAULT, "fault": i, "targets": (part,), "case": case, "kind": case.split(".")[1], "start_s": start}
        for i, ((part, case), start) in enumerate(zip(parts, onsets))
    ]
    trace = lane([(30, 80)], 80)
    trace[30:55, 2] = 1.0 + (side == "right")
    trace[55:80, 2] = 2.0 - (side == "right")
    by_fault = judge(watch, trace, DT, faults)["by_fault"]
    assert [d["fault"] for d in by_fault] and any(d["isolated"] for d in by_fault)
    for d in by_fault:
        other = "elevator_right" if d["fault"] == 0 else "elevator_left"
        assert other not in str((d["isolated"], d["first_verdict"])), d
