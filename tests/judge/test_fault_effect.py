"""What a fault does: to its elevator, on differences made by hand and in flight, to the aircraft, and to estimates."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from flown import achieved
from hypothesis import given
from hypothesis import strategies as st

from actuators.constants import M_S_PER_KT
from cosim.flight.build import build
from cosim.flight.faults import fault_free_reference
from cosim.flight.simulate import simulate
from cosim.judge.detection import JudgedLane
from cosim.judge.estimation import Estimate, plan
from cosim.judge.fault_effect import CONSEQUENCES, NAMES, consequences, largest, moved, sine
from cosim.judge.result import judge, judged
from cosim.judge.row import rows
from cosim.scenario import load_scenario

DT = 0.005
T = np.arange(2000) * DT


def fault(**more):
    return SimpleNamespace(**({"start": 2.0, "end": math.inf, "ramp": 0.0, "omega": math.nan, "shape": "sine"} | more))


def effect(rod, surface=None, travel=0.7, **more):
    return moved(np.column_stack([rod, rod / 0.3 if surface is None else surface]), [fault(**more)], DT, travel)


@given(st.floats(0.1, 9.0), st.floats(0.5, 60.0), st.floats(-math.pi, math.pi), st.floats(-1, 1), st.floats(-1, 1))
def test_a_sine_is_found_beside_a_constant_and_a_slope(size, w, phase, level, slope):
    y = size * np.cos(w * T + phase) + level + slope * T
    assert abs(sine(T, y, w) - size * np.exp(1j * phase)) < 1e-6


def test_peak_and_amplitude_and_when_it_had_moved_a_millimetre():
    w = 2 * math.pi
    found = effect(np.where(T >= 2.0, 0.004 * np.sin(w * (T - 2.0)), 0.0), omega=w, travel=math.radians(40.0))
    assert found["rod_mm"] == pytest.approx(4.0, rel=1e-3) and found["amplitude_mm"] == pytest.approx(4.0, rel=1e-6)
    assert found["surface_deg"] == pytest.approx(math.degrees(0.004 / 0.3), rel=1e-3)
    assert found["travel_pct"] == pytest.approx(found["surface_deg"] / 0.4)
    assert found["moved_at_s"] == pytest.approx(2.0 + math.asin(0.25) / w, abs=DT)


def test_a_fault_that_moves_too_little_has_no_time_and_one_too_short_no_amplitude():
    assert effect(np.where(T >= 2.0, 9e-4, 0.0))["moved_at_s"] is None
    short = effect(0.0 * T, omega=2 * math.pi, end=3.0)
    assert short["amplitude_mm"] is None and short["rod_mm"] == 0.0
    assert effect(np.sin(8 * T), omega=2 * math.pi, ramp=7.5)["amplitude_mm"] is None
    assert largest(None) == dict.fromkeys(NAMES) and largest({"a": short})["rod_mm"] == 0.0


def test_what_moves_within_a_second_after_healing_counts_and_a_lost_rod_is_told_by_its_surface():
    late = np.where((T > 4.5) & (T < 4.7), 0.003, 0.0)
    found = [effect(late + np.where(T > t, 0.009, 0.0), end=4.0)["rod_mm"] for t in (4.9, 5.1)]
    assert found == pytest.approx([9.0, 3.0])
    rod = np.where(T >= 3.0, 9e-4 * (T - 2.0), 0.0)  # 1 mm at 3.111 s; the surface's angle is three times as large
    lost = effect(np.where(T < 1.0, np.nan, rod), rod / 0.3)
    assert [d["moved_at_s"] for d in (effect(rod), lost)] == pytest.approx([3.115, 3.115]) and lost["rod_mm"]


def test_excursions_of_the_aircraft_count_from_the_onset_on():
    one, hinge = np.ones(100), np.zeros((4, 100))
    m = {"nz": one.copy(), "h": 6000 * one, "phi": 0 * one, "cas": 100 * one, "alpha": 0.03 * one}

    def found(onset):
        return consequences({n: v[onset:] for n, v in m.items()}, hinge[:, onset:], 0.1, (50.0, 200.0))

    assert list(found(40)) == list(CONSEQUENCES) and list(found(40).values()) == [1.0, 1.0, *[0.0] * 6]
    m["nz"][10], m["nz"][50], m["nz"][60] = 5.0, 2.6, -1.5
    m["h"][70:], m["phi"][80] = 5900.0, np.radians(-70.0)
    m["cas"][90], m["cas"][91] = 100 - 5 * M_S_PER_KT, 100 + 3 * M_S_PER_KT
    hinge[0, 20], hinge[2, 95] = 1e5, -2000.0
    # 0.3 s outside: two load factors and a bank
    assert list(found(40).values()) == pytest.approx([-1.5, 2.6, 100.0, 70.0, 5.0, 3.0, 2000.0, 0.3])
    assert found(100) is None


def test_a_lane_that_met_two_faults_has_two_rows_and_counts_its_false_alarms_once():
    two = ["faults.1.target=elevator.left_inner.rod", "faults.1.kind=bias", "faults.1.start_s=20",
           "faults.1.path=monitor", "faults.1.bias_mm=2"]  # fmt: skip
    at = {n: i for i, n in enumerate(("alarm", "verdict", "isolated_part", "r", "valid"))}
    history = np.zeros((300, 5))
    history[:, 4] = 1.0
    for span, said in ((slice(50, 55), (1, 1, 0)), (slice(125, 180), (1, 1, 0)), (slice(205, 300), (1, 6, 1))):
        history[span, :3] = said  # the first is a false alarm
    lane = JudgedLane("iotsekf", "local", "elevator.left_inner", ("", "rod"), at)
    entry = judge(lane, history, 0.1, judged(load_scenario("liquid-ofc", two)))
    about = {"status": "completed", "reason": "", "sim_time_s": 30.0, "achieved": None}
    found = rows("r", about | {"detectors": [entry]})
    assert [(r["lane"], r["fault"], r["isolated_class"], r["right"]) for r in found] == [
        (0, 0, "ofc_liquid", True), (0, 1, "sensor", True)]  # fmt: skip
    assert [r["false_alarms"] for r in found] == [1, 0] and [r["standing_s"] for r in found] == [0.5, 0.0]


def test_error_of_an_estimate_counts_settled_ticks_only_after_the_ramp_and_three_periods():
    history = np.zeros((50, 2), np.float32)
    history[:, 0], history[30:, 1] = 1.5, 1.0
    estimate = Estimate(0, (1,), lambda v, dt, kept: v[0], "m", start=2.0, end=4.0)
    assert np.concatenate([*estimate.error(history, 0.1)]).tolist() == [1.5] * 10 + [0.5] * 10
    at = dict.fromkeys(("alarm", "verdict", "isolated_part"), 1)
    entry = judge(JudgedLane("x", "local", "aircraft", ("",), at, estimate), history, 0.1, [])
    told = [entry[f"estimate_{n}"] for n in ("rmse", "bias", "max", "unit")]
    assert told == [pytest.approx(math.sqrt(1.25)), 1.0, 1.5, "m"]
    made = plan(load_scenario("liquid-ofc", ["faults.0.ramp_s=5"]), "iotsekf", "left_inner", lambda name: 0)
    assert made is not None and made.start == pytest.approx(12.0 + 5.0 + 3.0)


# -- in flight ---------------------------------------------------------------------------------------------------------


def flight(name, **more):
    return load_scenario(name, [f"{k}={v}" for k, v in more.items()])


@pytest.mark.parametrize(
    "name, detector, target, unit, size, share",
    [
        ("alwi14-simultaneous", "lpv_smo", "aircraft", "rad", math.radians(3), 0.35),
        ("ema-position-bias", "ema_kalman_flight", "elevator.right_inner", "m", 5e-3, 0.2),
        # 8 mm at 1 Hz is about this rod speed, and 1 of u is 1 m/s: the scale of the truth
        ("liquid-ofc", "iotsekf", "elevator.left_inner", "u", 8e-3 * 2 * math.pi, 0.15),
        ("thrust-loss", "control_redundancy", "aircraft", "fraction", 0.25, 0.1),
    ],
)
def test_estimates_are_of_the_size_of_their_fault(name, detector, target, unit, size, share):
    found = {d["target"]: d for d in simulate(load_scenario(name), timed=False).detectors if d["id"] == detector}
    own = found.pop(target)
    assert own["estimate_unit"] == unit and own["estimate_rmse"] < share * size
    assert all(d["estimate_rmse"] is None for d in found.values())


def test_achieved_amplitude_is_the_rod_s_own_oscillation_told_apart_from_gusts_that_are_larger():
    """In still air the linear loop puts it near 8 mm; 5.24 mm of rod are a degree."""
    about = {"duration_s": 10, "faults.0.start_s": 2}
    entry = achieved(flight("liquid-ofc", **about, **{"flight.turbulence": '"none"'}))["left_inner"]
    assert entry["amplitude_mm"] == pytest.approx(8.0, rel=0.15) and entry["rod_mm"] >= entry["amplitude_mm"] * 0.98
    assert entry["amplitude_deg"] == pytest.approx(entry["amplitude_mm"] / 5.24, rel=0.02)
    still, rough = (
        achieved(flight("liquid-ofc", **about, **{"faults.0.amplitude_mm": 0.5, "flight.turbulence": air}))
        for air in ("none", "moderate")
    )
    assert rough["left_inner"]["amplitude_mm"] == pytest.approx(still["left_inner"]["amplitude_mm"], rel=0.25)


def test_runs_that_differ_in_their_fault_share_their_reference_and_other_faults_need_none():
    fault_free_reference._positions.clear()
    for name in ("thrust-loss", "ema-current-bias"):  # another part, and one that a monitor alone reads
        assert achieved(flight(name, duration_s=2, **{"faults.0.start_s": 1})) == {}
    assert not fault_free_reference._positions
    for hz in (1, 2):
        achieved(flight("liquid-ofc", duration_s=2, **{"faults.0.start_s": 1, "faults.0.frequency_hz": hz}))
    assert len(fault_free_reference._positions) == 1


def test_a_reference_that_is_interrupted_is_none(monkeypatch):
    fault_free_reference._positions.clear()
    setup = build(flight("liquid-ofc", duration_s=2, **{"faults.0.start_s": 1}))
    monkeypatch.setattr("cosim.flight.fly.advance", lambda *about: (3, "interrupted", ""))
    with pytest.raises(KeyboardInterrupt):
        fault_free_reference.displacement(setup, np.zeros((3, len(setup.trace.index))))
    assert not fault_free_reference._positions
