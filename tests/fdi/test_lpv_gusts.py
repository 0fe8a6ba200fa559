"""lpv_smo in moderate gusts: what one does along the body is taken out, and an oscillation below it is found."""

import numpy as np
import pytest

from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect, fly
from cosim.scenario import load_scenario
from fdi.common.verdict import OFC_LIQUID
from fdi.lpv_smo import lpv_smo
from fdi.lpv_smo.core import learn

ONSET, WIRES = 14.0, sources("lpv_smo")
FIELDS = ("f_hat_elevator", "alarm_elevator", "verdict", "valid", "gust")


@pytest.fixture(scope="module")
def flown():
    fault = {"target": "elevator.all", "kind": "ofc_liquid", "at": "command", "amplitude_deg": 1.0, "frequency_hz": 1.0,
             "start_s": ONSET}  # fmt: skip
    given = ["duration_s=19", "flight.turbulence=moderate", "detectors.enabled=[]"]
    given += [f"faults.0.{k}={v}" for k, v in fault.items()]
    return fly(load_scenario("cruise", given), WIRES.values())


def watched(flown, **changes):
    p = lpv_smo.fitted(site(flown.attrs["dt"]))
    for name, value in changes.items():
        p[name] = value
    return detect(flown, lpv_smo, WIRES, p, FIELDS)


def test_an_oscillation_far_below_the_threshold_of_a_step_is_found_within_four_periods(flown):
    t, log = flown.index.to_numpy(), watched(flown)
    assert not log["alarm_elevator"][t < ONSET].any()
    on = t[(log["alarm_elevator"] > 0.5) & (t >= ONSET)]
    assert len(on) and on[0] - ONSET < 4.0
    assert (log["verdict"][(log["alarm_elevator"] > 0.5)] == OFC_LIQUID).any()


def test_what_a_gust_does_along_the_body_is_taken_out_of_the_elevators_estimate(flown):
    quiet = (flown.index > 9.0) & (flown.index < ONSET)
    with_it, without = (watched(flown, **c)["f_hat_elevator"][quiet] for c in ({}, {"gradient": 0.0}))
    assert np.std(with_it) < 0.8 * np.std(without)


def test_gusts_count_while_nothing_is_said_and_a_larger_one_is_followed_sooner_than_it_is_forgotten(flown):
    early = flown.index < 8.0
    heard, silent, slow = (watched(flown, **c) for c in ({}, {"alpha_max": -1.0}, {"tau_blow": 8.0}))
    assert heard["valid"].any() and not silent["valid"].any()
    assert (silent["gust"] == heard["gust"]).all()
    assert heard["gust"][early].max() > 1.44 * slow["gust"][early].max()


def test_a_stall_is_no_gust_that_hides_faults_afterwards():
    """Beyond the linear lift the estimate of gusts is wrong by 20 deg: soon after it a large fault is found again."""
    at = 71.0
    given = ["duration_s=75", "flight.mass_t=280", "flight.cas_kt=260", "manoeuvre.kind=aoa_protection",
             "detectors.enabled=[]", "faults.0.target=elevator.all", "faults.0.kind=bias", "faults.0.at=command",
             "faults.0.bias_deg=10.0", f"faults.0.start_s={at}"]  # fmt: skip
    slow = fly(load_scenario("cruise", given), WIRES.values())
    t, log = slow.index.to_numpy(), watched(slow)
    on = t[log["alarm_elevator"] > 0.5]
    assert at < on[0] < at + 1.2 and (log["valid"][t > at] > 0.5).all()


@pytest.mark.parametrize(("mach", "slower", "learned"), [(0.88, 0.0, True), (0.88, 2.0, False), (0.5, 2.0, True)])
def test_offsets_are_learned_at_one_speed_where_compressibility_makes_them(mach, slower, learned):
    """A mean over Mach numbers that are passed on the way down from 0.9 holds at none of them [m/s2]."""
    p = lpv_smo.fitted(site(0.005))[0]
    x = lpv_smo.init(lpv_smo.fitted(site(0.005)))[0]
    x.rho[-1], x.calm = mach, 10.0
    for k in range(round(10.0 / 0.005)):
        x.age, x.v_s = k * 0.005, 250.0 - slower * k * 0.005
        learn(x, p, 0.005, 0.01, 0.0, 0.0)
    assert (x.learned > 0.5) == learned


@pytest.mark.parametrize("speed", [40, -40])
def test_a_lateral_gust_in_still_air_is_no_fault(speed):
    given = ["duration_s=20", "flight.mass_t=204.2", "flight.cg_pct=26.8", "flight.altitude_ft=15000"]
    given += ["flight.cas_kt=205", "flight.turbulence=none", "flight.gusts.0.axis=lateral", "flight.gusts.0.shape=ramp"]
    given += ["flight.gusts.0.start_s=14", f"flight.gusts.0.speed_fps={speed}", "flight.gusts.0.gradient_ft=318"]
    flown = fly(load_scenario("cruise", [*given, "detectors.enabled=[]"]), WIRES.values())
    log = detect(flown, lpv_smo, WIRES, lpv_smo.fitted(site(flown.attrs["dt"])), ("alarm", "valid", "f_hat_n_z"))
    blown = flown.index.to_numpy() > ONSET
    assert log["valid"][blown].all() and not log["alarm"].any()
    assert np.abs(log["f_hat_n_z"][blown]).max() < 0.04  # .06 where the wind is taken for a sideslip over the ground
