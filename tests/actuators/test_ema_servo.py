"""The servo of the electromechanical actuator: tracking, load, limits, command faults, lost samples, linear model."""

import math

import numpy as np
import pytest
from actuator_loops import DT, between, fly_ema, liquid, predicted, solid, step, there_and_back
from servo_loops import ema_loop

from actuators.ema import actuator as ema
from actuators.ema import jay
from actuators.ema import servo as ema_servo

SMOOTH = {"T_c": 0.0, "T_s": 0.0}


def test_motor_follows_the_reference():
    """Smooth, no load, no noise: 0.1 degree in a 3 degree step."""
    log, s = fly_ema(step(3.0), noise=0.0, actuator=ema.params(**SMOOTH))
    assert np.degrees(np.abs(log["motor"] / 600 - s["r"])).max() < 0.1
    assert np.degrees(np.abs(log["delta"][500:] - math.radians(3.0))).max() < 0.01


def test_surface_error_is_the_springs():
    """The position sensor sits at the screw: against the load the surface lags by hm / l^2 K_s, 0.08 degree here."""
    log, _ = fly_ema(step(3.0, 6.0), hm0=-2500.0, hmd=-15e3)
    hm = -2500.0 - 15e3 * math.radians(3.0)
    assert np.degrees((log["motor"] / 600)[-200:].mean()) == pytest.approx(3.0, abs=0.02)
    assert np.degrees(log["delta"][-200:].mean()) == pytest.approx(3.0 + math.degrees(hm / 2.4e6), abs=0.02)


@pytest.mark.parametrize("delta", [-15.0, 0.0, 10.0])
def test_holds_the_hydraulic_stall_load(delta):
    """10.5 kN m, two thirds of this actuator's stall, put on at 1 s and held by the integrator."""

    def load(k, u, w):
        u["hm0"] = -10.5e3 * min(max(k - 200, 0) / 100, 1.0)

    command = np.full(1200, math.radians(delta))
    log, _ = fly_ema(command, start=math.radians(delta), faults=load)
    assert np.degrees(np.abs(log["motor"] / 600 - command)[-300:]).max() < 0.1


def test_noise_reaches_the_surface_as_little():
    log, _ = fly_ema(np.zeros(2000), actuator=ema.params(**SMOOTH))
    assert np.degrees(log["delta"][400:].std()) < 0.02
    assert log["i"].std() < 3.0


def test_does_not_hunt_across_the_friction():
    """Without noise everything comes to rest, loaded or not, and stays."""
    log, _ = fly_ema(step(3.0, 8.0), noise=0.0, hm0=-1000.0, hmd=-15e3)
    assert np.degrees(np.ptp(log["delta"][-400:])) < 1e-6


def test_full_travel_and_back_without_windup():
    log, _ = fly_ema(there_and_back(), hmd=-15e3)
    assert np.degrees((log["motor"] / 600).min()) == pytest.approx(-22.9, abs=0.1)
    assert np.degrees((log["motor"] / 600)[-1]) == pytest.approx(16.9, abs=0.1)
    left = np.flatnonzero(np.degrees(log["delta"][1000:]) > -22.2)[0] * DT
    assert left < 0.15


def test_recovers_from_a_long_jam():
    log, s = fly_ema(step(5.0, 6.0, at=1.2), faults=between(1.0, 3.0, jam=1.0))
    assert np.abs(s["i_d"]).max() <= 43.75 * (1 + 1e-9)
    assert np.degrees(np.abs(log["delta"][300:600])).max() < 0.1
    assert np.degrees(log["delta"][600:]).max() < 7.0
    assert np.degrees(np.abs(log["delta"][-200:] - math.radians(5.0))).max() < 0.05


def test_runaway_at_its_rate_to_the_stop():
    def runaway(k, u, w):
        w["s_rate"], w["f_rate"] = (1.0, math.radians(20.0)) if k >= 200 else (0.0, 0.0)

    log, _ = fly_ema(np.zeros(600), hmd=-15e3, faults=runaway)
    rate = np.degrees(log["delta"][300] - log["delta"][240]) / (60 * DT)
    assert rate == pytest.approx(20.0, rel=0.03)
    assert np.degrees(log["motor"][-1] / 600) == pytest.approx(17.0, abs=0.05)


def test_command_faults_add_and_replace():
    for fault, end in ((liquid, 4.0), (solid, -2.0)):
        log, _ = fly_ema(step(3.0), faults=fault)
        assert np.degrees(log["delta"][-1]) == pytest.approx(end, abs=0.05)


def test_given_position_replaces_the_sensor():
    """Reconfiguration: with the sensor 5 degrees off, the loop on the given position stays where it should."""

    def wrong(k, u, w):
        w["pos_fb"], w["pos_use"] = float(w["pos_meas"][0, 0]), 1.0
        w["pos_meas"] += 0.15 * math.radians(5.0)

    log, _ = fly_ema(step(3.0), faults=wrong)
    assert np.degrees(log["delta"][-1]) == pytest.approx(3.0, abs=0.05)


def test_lost_samples_are_bridged():
    """A servo that stood still for the 0.1 s without a sample would be off by 0.08 degrees, that of a held command."""
    rng = np.random.default_rng(0)

    def lose(k, u, w):
        for meas, flag in (("pos_meas", "pos_valid"), ("vel_meas", "vel_valid")):
            w[flag] = 1.0
            if rng.random() < 0.2 or 600 <= k < 620:
                w[meas], w[flag] = np.nan, 0.0

    command = step(3.0) + math.radians(0.5) * np.sin(3 * np.arange(800) * DT)
    log, s = fly_ema(command, hm0=-1000.0, hmd=-15e3, faults=lose)
    good, _ = fly_ema(command, hm0=-1000.0, hmd=-15e3)
    assert np.all(np.isfinite(s["u"]))
    assert np.degrees(np.abs(log["delta"] - good["delta"])).max() < 0.05


def test_linear_model_predicts_the_flown_response():
    load = {"hm0": -1000.0, "hmd": -15e3}
    m = ema_loop(**load)
    command = step(0.2, 2.0)
    # at rest the screw is ahead of the surface by the wound spring, and the servo commands the screw
    p = ema.params(**SMOOTH)
    ahead = ema.init_at(p, 0.0, -1000.0, -15e3)["motor"][0] / 600
    log, _ = fly_ema(command + ahead, noise=0.0, actuator=p, control=ema_servo.params(dead=0.0), **load)
    assert np.abs(predicted(m, command) - log["delta"]).max() < 0.01 * math.radians(0.2)


@pytest.mark.parametrize("hmd", [0.0, -15e3, -26e3, 5e3])
def test_loop_is_stable_over_hinge_stiffness_and_parameters(hmd):
    for off in ({}, {"J_M": 0.003}, {"J_M": 0.002}, {"K_T": 0.4, "K_B": 0.4}, {"K_s": 5e7}, {"R": 0.5}):
        m = ema_loop(hmd=hmd, hm0=-1000.0, actuator=ema.params(**off))
        assert np.abs(np.linalg.eigvals(m.A)).max() < math.exp(-2 * DT)


def test_lead_in_the_compensator_is_refused():
    with pytest.raises(ValueError, match="without lead"):
        ema_servo.params(symbols={"a": 45.0})
    assert jay.values("elevator")["a"] == jay.values("elevator")["b"]
