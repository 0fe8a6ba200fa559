"""The quick questions of the study of the aircraft level; the whole is `cosim study aircraft_level`."""

import numpy as np
import pytest

from cosim.papers.studies.aircraft_level import bound, corners, lpv, questions, smallest, uncertain
from cosim.training import train_rfafe
from fdi.common import bank


def test_each_question_has_a_name_of_its_own():
    names = ["lpv", "bound", "uncertain", "corners", "envelope", "smallest", "thresholds"]
    assert [q.name for q in questions()] == names


def test_the_least_oscillation_in_the_pitch_rate_grows_with_frequency():
    least = bound.bound("sun13")
    assert 0.05 < least[bound.HZ.index(2.0)] < 0.2
    assert np.all(np.diff(least[1:]) > 0)


def test_the_least_error_of_an_affine_function_is_that_of_tchebyshev():
    """x^2 on [-1, 1]: the nearest straight line is 1/2, off by 1/2; what is affine is met exactly."""
    low, high = np.array(lpv.design_lpv.BOX).T
    z = np.linspace(-1, 1, 41)
    rho = np.column_stack([0.5 * (low[0] + high[0]) + 0.5 * (high[0] - low[0]) * z, *(np.full(41, x) for x in low[1:])])
    assert lpv.least(rho, z**2) == pytest.approx(0.5, abs=1e-9)
    assert lpv.least(rho, 3.0 - z) == pytest.approx(0.0, abs=1e-9)


def test_only_the_two_control_powers_come_out_as_an_elevator_fault():
    """Cm_de and Cm_ds add and take the stabiliser's share of their 5 %, pitch stiffness next to nothing."""
    nominal = uncertain.errors("E")
    of = {n: uncertain.errors("E", n)[0] - nominal[0] for n in ("Cm_de", "Cm_ds", "Cm_alpha")}
    assert 3.0 < of["Cm_de"] < 5.0 and -5.0 < of["Cm_ds"] < -3.0
    assert abs(of["Cm_alpha"]) < 0.3
    assert abs(nominal[0]) < 5.0 and abs(nominal[1]) < 5.0 and abs(nominal[2]) < 5.0


def test_a_corner_is_flown_and_the_lpv_observer_is_at_home_there_and_at_sun13():
    far = corners.measure("sun13", corners.ANGLE, "none", 1)
    home = corners.measure("D", corners.ANGLE, "none", 1)
    assert far["lpv_smo"][3] == 1.0  # 200 t is within one of its boxes
    assert home["lpv_smo"][0] < 1.0 and home["lpv_smo"][1] == pytest.approx(1.0, abs=0.05)


def test_moments_see_the_aileron_that_forces_do_not():
    came = [smallest.outcome("aileron.both", d)[0] for d in smallest.declared("level", "aileron.both", 6.0, 0)]
    assert came == ["missed", "right"]
    came = [smallest.outcome("engine.all", d)[0] for d in smallest.declared("level", "engine.all", 35.0, 0)]
    assert came[0] == "right"


def test_thresholds_stand_above_what_lasts_and_weigh_what_the_law_answers(monkeypatch):
    shares = len(train_rfafe.SHARES)
    runs, whatever = np.zeros((shares, bank.K)), np.zeros((shares, bank.K))
    runs[:, 0], whatever[:, 1] = np.radians(np.linspace(1.0, 0.1, shares)), np.radians(1.0)
    fits = [({}, {"rfafe": [runs.tolist(), whatever.tolist(), 0.01, 0]})]
    monkeypatch.setattr(train_rfafe, "answers", lambda: {"rfafe": np.full(bank.K, 0.25)})
    made, _ = train_rfafe.fields("rfafe", fits)
    threshold, share = np.degrees(made["bank_threshold"]), made["bank_share"]
    assert threshold[0] == pytest.approx(1.25 * 0.1) and share[0] == 2.0  # 0.125 / (1 - 2 / 4) beats 1.25
    assert threshold[1] == pytest.approx(0.3) and share[1] == 0.0  # not on the shape alone
    assert threshold[2] == pytest.approx(0.05) and made["th_static"] == pytest.approx(0.0125)


def test_a_survey_finds_an_oscillation_and_little_in_health():
    fault = {"target": "elevator.left", "kind": "ofc_liquid", "at": "command", "start_s": 4.0, "amplitude_deg": 1.0,
             "frequency_hz": 2.0}  # fmt: skip
    p = train_rfafe.MODULES["rfafe"].params()
    k = int(np.argmin(abs(bank.frequencies() - 2.0)))
    for faults, low, high in (([fault], 0.8, 1.2), ([], 0.0, 0.06)):
        runs, whatever, _ = train_rfafe.survey(train_rfafe.fly_aircraft(duration=9.0, faults=faults), "rfafe", p)
        assert low <= np.degrees(runs[0, k]) <= high and whatever[0, k] >= runs[0, k]
