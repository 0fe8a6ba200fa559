"""How far a fault moved its elevator, on differences made by hand, and the rows that a result becomes."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.judge.detection import watch_of
from cosim.judge.fault_effect import NAMES, largest, moved, sine
from cosim.judge.result import judge, judged
from cosim.judge.row import rows
from cosim.scenario import load_scenario

DT = 0.005
T = np.arange(2000) * DT


def fault(**more):
    return SimpleNamespace(**({"start": 2.0, "end": math.inf, "ramp": 0.0, "omega": math.nan, "shape": "sine"} | more))


def pair(rod):
    return np.column_stack([rod, rod / 0.3])


@given(st.floats(0.1, 9.0), st.floats(0.5, 60.0), st.floats(-math.pi, math.pi), st.floats(-1, 1), st.floats(-1, 1))
def test_a_sine_is_found_beside_a_constant_and_a_slope(size, w, phase, level, slope):
    y = size * np.cos(w * T + phase) + level + slope * T
    assert abs(sine(T, y, w) - size * np.exp(1j * phase)) < 1e-6


def test_peak_and_amplitude_and_when_it_had_moved_a_millimetre():
    w = 2 * math.pi
    rod = np.where(T >= 2.0, 0.004 * np.sin(w * (T - 2.0)), 0.0)
    found = moved(pair(rod), [fault(omega=w)], DT, math.radians(40.0))
    assert found["rod_mm"] == pytest.approx(4.0, rel=1e-3) and found["amplitude_mm"] == pytest.approx(4.0, rel=1e-6)
    assert found["surface_deg"] == pytest.approx(math.degrees(0.004 / 0.3), rel=1e-3)
    assert found["moved_at_s"] == pytest.approx(2.0 + math.asin(0.25) / w, abs=DT)


def test_a_fault_that_moves_too_little_has_no_time_and_one_too_short_no_amplitude():
    assert moved(pair(np.where(T >= 2.0, 9e-4, 0.0)), [fault()], DT, 0.7)["moved_at_s"] is None
    short = moved(pair(0.0 * T), [fault(omega=2 * math.pi, end=3.0)], DT, 0.7)
    assert short["amplitude_mm"] is None and short["rod_mm"] == 0.0
    assert moved(pair(np.sin(8 * T)), [fault(omega=2 * math.pi, ramp=7.5)], DT, 0.7)["amplitude_mm"] is None
    assert largest(None) == dict.fromkeys(NAMES) and largest({"a": short})["rod_mm"] == 0.0


def test_what_moves_within_a_second_after_healing_counts_and_a_lost_rod_is_told_by_its_surface():
    late = np.where((T > 4.5) & (T < 4.7), 0.003, 0.0)
    found = [moved(pair(late + np.where(T > t, 0.009, 0.0)), [fault(end=4.0)], DT, 0.7)["rod_mm"] for t in (4.9, 5.1)]
    assert found == pytest.approx([9.0, 3.0])
    rod = np.where(T >= 3.0, 9e-4 * (T - 2.0), 0.0)  # 1 mm at 3.111 s; the surface's angle is three times as large
    lost = np.column_stack([np.where(T < 1.0, np.nan, rod), rod / 0.3])
    assert [moved(d, [fault()], DT, 0.7)["moved_at_s"] for d in (pair(rod), lost)] == pytest.approx([3.115, 3.115])


def test_a_lane_that_met_two_faults_has_two_rows_and_counts_its_false_alarms_once():
    two = ["faults.1.target=elevator.left_inner.rod", "faults.1.kind=bias", "faults.1.start_s=20",
           "faults.1.path=monitor", "faults.1.bias_mm=2"]  # fmt: skip
    scenario = load_scenario("liquid-ofc", two)
    watch = watch_of("iotsekf", "local", "elevator.left_inner", ("", "rod"),
                     {n: i for i, n in enumerate(("alarm", "verdict", "culprit", "r", "valid"))})  # fmt: skip
    history = np.zeros((300, 5))
    history[:, 4] = 1.0
    history[50:55, :2] = 1.0  # a false alarm
    history[125:180, :2] = 1.0
    history[205:, 0], history[205:, 1], history[205:, 2] = 1.0, 6.0, 1.0
    entry = judge(watch, history, 0.1, judged(scenario))
    found = rows("r", {"status": "completed", "reason": "", "sim_time_s": 30.0, "achieved": None,
                       "detectors": [entry]})  # fmt: skip
    assert [(r["lane"], r["fault"], r["isolated_class"], r["right"]) for r in found] == [
        (0, 0, "ofc_liquid", True), (0, 1, "sensor", True)]  # fmt: skip
    assert [r["false_alarms"] for r in found] == [1, 0] and [r["standing_s"] for r in found] == [0.5, 0.0]
