"""The airframe form away from the point of its design: what it learns, what it takes out, and that a fault stays."""

import numpy as np
import pytest

from actuators.constants import RAD_PER_DEG
from cosim import load_scenario
from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect, fly
from fdi.common.why import BANK, NOT_READY, VALID
from fdi.rfafe import rfafe_airframe

FAR = ("flight.mass_t=330", "flight.cg_pct=27", "flight.altitude_ft=12000", "flight.cas_kt=225", "seed=700001")
ONSET = 20.0


def flown(*changes, p=None, fields=("f", "free", "theta", "alarm", "valid", "why")):
    scenario = load_scenario("cruise", ["detectors.enabled=[]", *FAR, *changes])
    frame = fly(scenario, sources("rfafe_airframe").values())
    p = rfafe_airframe.DETECTOR.fit(site(0.005, "", scenario.elevator.technology)) if p is None else p
    return frame.index.to_numpy(), detect(frame, rfafe_airframe, sources("rfafe_airframe"), p, fields)


def oscillation(hz, size):
    given = {"target": "elevator.all", "kind": "ofc_liquid", "at": "command", "amplitude_deg": size, "frequency_hz": hz,
             "start_s": ONSET}  # fmt: skip
    return [f"faults.0.{k}={v}" for k, v in given.items()]


def rms(x):
    return float(np.sqrt(np.mean((x - x.mean()) ** 2)))


def test_gusts_are_learned_and_taken_out_of_what_is_judged():
    t, log = flown("duration_s=30", "flight.turbulence=moderate")
    before, after = (np.convolve(np.ones(20) / 20, log[n][t > 10.0, 0], "valid") for n in ("f", "free"))
    assert rms(after) < 0.4 * rms(before)
    assert not log["alarm"].any()


@pytest.mark.parametrize("hz", (0.5, 1.0))
def test_one_degree_of_all_elevators_is_found_in_moderate_gusts(hz):
    t, log = flown("duration_s=28", "flight.turbulence=moderate", *oscillation(hz, 1.0))
    on = t[log["alarm"] > 0.5]
    assert ONSET < on[0] < ONSET + 7.0
    assert np.ptp(log["theta"][t > 10.0], axis=0).max() == 0.0  # a fault that comes later is not learned


@pytest.mark.parametrize("seed", (700101, 700108))
def test_friction_that_makes_command_and_elevators_swing_in_still_air_is_no_oscillation(seed):
    """Light and fast, all hydraulic: 0.03 deg at 0.9 Hz, which the limit's constant was below."""
    light = ("flight.mass_t=218", "flight.altitude_ft=28800", "flight.cas_kt=310", "flight.turbulence=none")
    hydraulic = [f"elevator.{s}=hydraulic" for s in ("left_outer", "left_inner", "right_inner", "right_outer")]
    _, log = flown(*light, *hydraulic, f"seed={seed}", "duration_s=30")
    assert log["valid"][-1] > 0.5 and not log["alarm"].any()
    _, log = flown(*light, *hydraulic, f"seed={seed}", "duration_s=28", *oscillation(1.0, 0.5))
    assert log["alarm"].any()


def test_nothing_is_said_while_it_learns_or_beyond_the_linear_angles():
    p = rfafe_airframe.DETECTOR.fit(site(0.005, "", load_scenario("cruise").elevator.technology))
    t, log = flown("duration_s=12", p=p)
    assert (log["why"][(t > 1.5) & (t < 8.5)] == NOT_READY).all() and log["valid"][t > 9.5].all()
    p["alpha_max"] = 0.5 * RAD_PER_DEG
    _, log = flown("duration_s=3", p=p)
    assert not log["valid"].any()


def test_a_design_of_ones_own_is_not_corrected():
    assert rfafe_airframe.params()["t_learn"][0] > 0.0
    assert rfafe_airframe.params(stored="rfafe_airframe")["t_learn"][0] == 0.0


def test_learned_terms_grow_with_dynamic_pressure():
    """The same motion at twice the speed: stiffness counts four times, damping twice."""
    p = rfafe_airframe.params()
    p["t_learn"], p["spread"] = 0.2, 1e-9  # nothing is learned: theta is the prior
    u = np.zeros((1, 4000), rfafe_airframe.INPUTS)
    for name in ("tas", "alpha", "q", "theta"):
        u[f"{name}_valid"] = 1.0
    u["tas"] = 100.0
    u["tas"][:, 2000:] = 200.0
    u["alpha"][:, 2000:] = 0.02
    x, log = rfafe_airframe.init(p), np.zeros((1, 4000), rfafe_airframe.STATE)
    rfafe_airframe.rollout(x, u, p, 0.005, log)
    last, own = log[0, -1], p["own"][0]
    assert last["speed"] == pytest.approx(100.0, abs=0.1)
    expected = ((own[0] + last["theta"][0]) * 4.0 - own[0]) * last["lagged"][0]
    assert last["f"][0] - last["free"][0] == pytest.approx(expected, rel=1e-6)


def test_it_is_valid_again_after_a_steep_turn_and_finds_an_oscillation_then():
    given = {"kind": "coordinated_turn", "bank_deg": 60, "start_s": 11, "duration_s": 22}
    turn = [f"manoeuvre.{k}={v}" for k, v in given.items()]
    late = [text.replace(f"start_s={ONSET}", "start_s=48.0") for text in oscillation(1.0, 1.5)]
    t, log = flown("duration_s=56", "flight.cas_kt=260", "flight.turbulence=light", *turn, *late)
    assert (log["why"][(t > 29.0) & (t < 40.0)] == BANK).all() and (log["why"][(t > 46.0) & (t < 48.0)] == VALID).all()
    on = t[log["alarm"] > 0.5]
    assert 48.0 < on[0] < 54.0


def test_a_turn_at_30_degrees_of_bank_is_within_its_range():
    t, log = flown("duration_s=30", "flight.turbulence=light", "flight.bank_deg=30")
    assert set(log["why"][t > 10.0]) == {VALID} and not log["alarm"].any()
