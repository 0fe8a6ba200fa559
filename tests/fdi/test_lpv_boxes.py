"""The scheduled observer in flight: boxes and their inequalities, gusts taken out, three verdicts at once, why not."""


import numpy as np
import pytest

from actuators.constants import RAD_PER_DEG
from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect, fly
from cosim.scenario import load_scenario
from fdi.common import why
from fdi.common.verdict import AMBIGUOUS
from fdi.lpv_smo import boxes, lpv_smo, synthesis

WIRES = sources("lpv_smo")
LIGHT = ["flight.mass_t=215", "flight.cg_pct=30", "flight.altitude_ft=15000", "flight.cas_kt=300"]
FAULTS = [
    "faults.0.target=elevator.all", "faults.0.kind=bias", "faults.0.bias_deg=3", "faults.0.start_s=10",
    "faults.1.target=sensor.n_z", "faults.1.kind=bias", "faults.1.bias_g=0.5", "faults.1.start_s=10",
    "faults.1.path=observers",
    "faults.2.target=sensor.alpha", "faults.2.kind=bias", "faults.2.bias_deg=5", "faults.2.start_s=10",
    "faults.2.path=observers",
]  # fmt: skip


def flown(*changes):
    given = [*LIGHT, "detectors.enabled=[]", "duration_s=16", "flight.turbulence=moderate", *changes]
    return fly(load_scenario("cruise", given), WIRES.values())


def watched(frame, **fields):
    p = lpv_smo.fitted(site(frame.attrs["dt"]))
    for name, value in fields.items():
        p[name] = value
    return detect(frame, lpv_smo, WIRES, p)


@pytest.fixture(scope="module")
def faulty():
    return flown(*FAULTS)


def test_every_box_holds_its_inequalities_and_knows_its_model():
    pairs = boxes.load()
    assert len(pairs) <= lpv_smo.NB
    for model, made in pairs[::9]:
        assert synthesis.verify(made)["ok"]
        assert np.array_equal(model.box, made.box)


def test_three_faults_at_once_have_three_names_within_two_seconds_in_moderate_turbulence(faulty):
    log, t = watched(faulty), faulty.index.to_numpy()
    late = t > 12.0
    for name in ("elevator", "n_z", "alpha"):
        assert not log[f"alarm_{name}"][t < 10.0].any()
        assert log[f"alarm_{name}"][late].all(), name
    assert np.array_equal(log["alarm"] > 0, (log["alarm_elevator"] + log["alarm_n_z"] + log["alarm_alpha"]) > 0)
    last = log[-1]
    assert last["f_hat_elevator"] == pytest.approx(3 * RAD_PER_DEG, rel=0.25)
    assert last["f_hat_n_z"] == pytest.approx(0.5, rel=0.1)
    assert last["f_hat_alpha"] == pytest.approx(5 * RAD_PER_DEG, rel=0.1)


def test_a_fault_does_not_raise_its_own_allowance(faulty):
    with_fault = watched(faulty)
    quiet = watched(flown())
    assert with_fault["gust"][-1] == pytest.approx(quiet["gust"][-1], rel=0.3)
    assert not quiet["alarm"].any()


def test_the_state_goes_over_from_box_to_box():
    frame = flown("flight.mass_t=301", "flight.turbulence=light", "sensors.noise_scale=0")  # noise jumps as far
    frame.loc[:12.0, "sensors.mass.y_obs"] = 289e3  # of the lighter boxes
    frame.loc[12.0:, "sensors.mass.y_obs"] = 302e3
    log = watched(frame)
    changed = np.flatnonzero(np.diff(log["box"])) + 1
    assert (log["box"][-1] != log["box"][1500]) and log["valid"][changed[-1]] > 0
    assert not log["alarm"].any()
    for name, small in (("path", 0.01 * RAD_PER_DEG), ("f_hat_elevator", 0.01 * RAD_PER_DEG), ("f_hat_n_z", 0.0006)):
        assert np.abs(np.diff(log[name]))[changed - 1].max() < small, name
    assert np.abs(log["f_hat_elevator"][-1] - log["f_hat_elevator"][changed[-1] - 1]) < 1.0 * RAD_PER_DEG


def test_it_says_why_it_is_silent(faulty):
    log, t = watched(faulty), faulty.index.to_numpy()
    assert np.array_equal(log["valid"] > 0, log["why"] == why.VALID)
    assert (log["why"][t < 7.9] == why.NOT_READY).all()
    lost = faulty.copy()
    lost.attrs = faulty.attrs
    lost.loc[13.0:, "sensors.alpha_ground.valid_obs"] = 0.0
    assert (watched(lost)["why"][t > 13.01] == why.LOST_SENSOR).all()
    heavy = faulty.copy()
    heavy.attrs = faulty.attrs
    heavy["sensors.mass.y_obs"] = 500e3
    assert (watched(heavy)["why"] == why.BOX_MASS).all()
    assert (watched(faulty, bank_max=1e-9)["why"][t > 8.1] == why.BANK).all()


def test_no_box_is_believed_beyond_the_fastest_mach_number_that_one_was_fitted_to():
    frame = flown("flight.altitude_ft=35000", "flight.cas_kt=315", "flight.turbulence=none")
    assert (frame[WIRES["mach"]] > 0.9).all()
    log = watched(frame)
    assert not log["valid"].any() and set(log["why"][frame.index > 8.1]) == {why.BOX_MACH}
    assert not log["learned"].any() and not log["offset"].any()  # nor is anything learned there


def test_an_error_of_the_pitch_rate_is_called_neither_n_z_nor_the_vane():
    frame = flown("flight.turbulence=light")
    frame["sensors.q.y_obs"] += 3.0 * RAD_PER_DEG * (frame.index >= 12.0)
    log = watched(frame)
    said = log[log["alarm"] > 0.5]
    assert len(said) > 300 and not (log["alarm_n_z"] + log["alarm_alpha"]).any()
    assert (said["verdict"] == AMBIGUOUS).all() and not said["culprit"].any()
