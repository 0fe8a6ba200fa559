"""The servos of both technologies: reference model, tracking, load, limits, lost samples, faults, linear model."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from actuator_loops import (
    DT,
    between,
    fly_ema,
    fly_hydraulic,
    liquid,
    predicted,
    solid,
    step,
    there_and_back,
)
from servo_loops import ema_loop, hydraulic_loop

from actuators.common import reference
from actuators.ema import actuator as ema
from actuators.ema import jay
from actuators.ema import servo as ema_servo
from actuators.hydraulic import actuator as hydraulic
from actuators.hydraulic import lu17, servo

SMOOTH = {"F_c": 0.0, "F_s": 0.0}
HYDRAULIC = SimpleNamespace(
    fly=fly_hydraulic, driven=lambda log: log["q_rod"] / 0.3, smooth=hydraulic.params(**SMOOTH), tracks=0.02,
    load=9000.0, holds=0.02, end=0.05, leaves=0.1, over=5.5, loop=hydraulic_loop, margin=4,
    off=[hydraulic.params(**p) for p in ({}, {"M": 2400.0}, {"M": 1600.0}, {"E": 5e8}, {"L": 0.1}, {"P_s": 1.1e7})],
    sensors=(("q_meas", "q_valid"), ("x3_meas", "x3_valid")), control=None, rests=(0.01, 0.0077), ahead=0.0,
)  # fmt: skip
EMA = SimpleNamespace(
    fly=fly_ema, driven=lambda log: log["motor"] / 600, smooth=ema.params(T_c=0.0, T_s=0.0), tracks=0.1,
    load=10.5e3, holds=0.1, end=0.1, leaves=0.15, over=7.0, loop=ema_loop, margin=2,
    off=[ema.params(**p) for p in ({}, {"J_M": 0.003}, {"J_M": 0.002}, {"K_T": 0.4, "K_B": 0.4}, {"K_s": 5e7},
                                   {"R": 0.5})],
    sensors=(("pos_meas", "pos_valid"), ("vel_meas", "vel_valid")), control=ema_servo.params(dead=0.0),
    rests=(0.1, 0.02),
    # at rest the screw is ahead of the surface by the wound spring, and the servo commands the screw
    ahead=ema.init_at(ema.params(T_c=0.0, T_s=0.0), 0.0, -1000.0, -15e3)["motor"][0] / 600,
)  # fmt: skip
both = pytest.mark.parametrize("own", [HYDRAULIC, EMA], ids=["hydraulic", "ema"])


def degrees(values):
    return np.degrees(np.abs(values)).max()


@both
def test_the_drive_follows_the_reference(own):
    """Smooth, no load, no noise, a 3 degree step: a tenth of a millimetre of rod, a tenth of a degree of the motor."""
    log, s = own.fly(step(3.0), noise=0.0, actuator=own.smooth)
    assert degrees(own.driven(log) - s["r"] / (0.3 if own is HYDRAULIC else 1.0)) < own.tracks
    assert degrees(log["delta"][500:] - math.radians(3.0)) < 0.01


@both
@pytest.mark.parametrize("delta", [-15.0, 0.0, 10.0])
def test_no_steady_error_against_a_load_near_the_hydraulic_stall(own, delta):
    """Put on at 1 s: observer or integrator holds it."""

    def load(k, u, w):
        u["hm0"] = -own.load * min(max(k - 200, 0) / 100, 1.0)

    command = np.full(1200, math.radians(delta))
    log, _ = own.fly(command, start=math.radians(delta), faults=load)
    assert degrees((own.driven(log) - command)[-300:]) < own.holds


@both
def test_noise_reaches_the_surface_as_little(own):
    log, _ = own.fly(np.zeros(2000), actuator=own.smooth)
    assert np.degrees(log["delta"][400:].std()) < own.rests[1]


@both
def test_full_travel_and_back_without_windup(own):
    log, _ = own.fly(there_and_back(), hmd=-15e3)
    moved = np.degrees(own.driven(log))
    assert [moved.min(), moved[-1]] == pytest.approx([-22.9, 16.9], abs=own.end)  # 0.1 degrees inside the stops
    assert np.flatnonzero(np.degrees(log["delta"][1000:]) > -22.2)[0] * DT < own.leaves + 0.02


@both
def test_recovers_from_a_long_jam(own):
    """Two seconds jammed against a standing command."""
    log, _ = own.fly(step(5.0, 6.0, at=1.2), faults=between(1.0, 3.0, jam=1.0))
    assert degrees(log["delta"][300:600]) < own.rests[0]
    assert np.degrees(log["delta"][600:]).max() < own.over
    assert degrees(log["delta"][-200:] - math.radians(5.0)) < 0.05


@both
def test_lost_samples_are_bridged(own):
    """One sample in five lost at random, then 0.1 s of everything: NaN never spreads.

    A servo that stood still for that 0.1 s would be off by 0.08 degrees, that of a held command.
    """
    rng = np.random.default_rng(0)

    def lose(k, u, w):
        for meas, flag in own.sensors:
            w[flag] = 1.0
            if rng.random() < 0.2 or 600 <= k < 620:
                w[meas], w[flag] = np.nan, 0.0

    command = step(3.0) + math.radians(0.5) * np.sin(3 * np.arange(800) * DT)
    log, s = own.fly(command, hm0=-1000.0, hmd=-15e3, faults=lose)
    good, _ = own.fly(command, hm0=-1000.0, hmd=-15e3)
    assert np.all(np.isfinite(s["u"])) and degrees(log["delta"] - good["delta"]) < 0.05


@both
def test_command_faults_add_and_replace(own):
    for fault, end in ((liquid, 4.0), (solid, -2.0)):
        assert np.degrees(own.fly(step(3.0), faults=fault)[0]["delta"][-1]) == pytest.approx(end, abs=0.05)


@both
def test_linear_model_predicts_the_flown_response(own):
    """A small step through the sampled linear model and through the smooth nonlinear loop: 1 per cent of the step."""
    load, command = {"hm0": -1000.0, "hmd": -15e3}, step(0.2, 2.0)
    log, _ = own.fly(command + own.ahead, noise=0.0, actuator=own.smooth, control=own.control, **load)
    assert np.abs(predicted(own.loop(**load), command) - log["delta"]).max() < 0.01 * math.radians(0.2)


@both
@pytest.mark.parametrize("hmd", [0.0, -15e3, -26e3, 5e3])
def test_loop_is_stable_over_hinge_stiffness_and_parameters(own, hmd):
    for p in own.off:
        m = own.loop(hmd=hmd, hm0=-1000.0, actuator=p)
        assert np.abs(np.linalg.eigvals(m.A)).max() < math.exp(-own.margin * DT)


# -- the reference model


def run_reference(target, ticks=1000):
    x, p, out = np.zeros(1, servo.STATE), servo.params()[0], np.zeros((ticks, 4))
    for k in range(ticks):
        reference.advance(x[0], DT)
        reference.demand(x[0], target, 1.0, p)
        out[k] = x["r"][0], x["rd"][0], x["rdd"][0], x["rddd"][0]
    return out


def test_reference_is_a_third_order_filter_with_the_stated_poles():
    """Small steps: sampled recurrence of r has the characteristic polynomial of exp(p dt), p = -45 and 45 at 0.8."""
    r = run_reference(1e-4, 60)[:, 0] - 1e-4
    pair = 45 * complex(-0.8, 0.6)
    c = np.real(np.poly(np.exp(np.array([-45, pair, np.conj(pair)]) * DT)))
    assert np.abs(r[3:] + c[1] * r[2:-1] + c[2] * r[1:-2] + c[3] * r[:-3]).max() < 1e-12


@pytest.mark.parametrize("angle", [0.3, 3.0, 10.0, 20.0])
def test_reference_keeps_its_limits_stops_in_time_and_its_derivatives_are_those_of_its_position(angle):
    target, p = 0.3 * math.radians(angle), servo.params()[0]
    out = run_reference(target)
    # velocity runs over by 2 per cent while the acceleration dies away within its jerk limit
    assert np.all(np.abs(out[:, 1:]).max(axis=0) <= [1.02 * p.v_max, p.a_max * (1 + 1e-9), p.j_max * (1 + 1e-9)])
    assert out[:, 0].max() <= 1.004 * target and out[-1, 0] == pytest.approx(target, rel=1e-6)
    for n in range(3):
        taylor = out[:-1, n] + sum(out[:-1, n + m] * DT**m / math.factorial(m) for m in range(1, 4 - n))
        np.testing.assert_allclose(out[1:, n], taylor, rtol=1e-9, atol=1e-12)


# -- the hydraulic one


@pytest.mark.parametrize("seed", range(3))
def test_flies_with_tolerances(seed):
    rng = np.random.default_rng(seed)
    names = ("B", "M", "P_s", "phi_n", "V_m", "E", "L")
    wrong = {n: hydraulic.NOMINAL[n] * (1 + 0.05 * rng.choice([-1, 1])) for n in names}
    log, _ = fly_hydraulic(step(3.0), hm0=-1000.0, hmd=-15e3, actuator=hydraulic.params(**wrong), seed=seed)
    assert degrees((log["delta"] - math.radians(3.0))[700:]) < 0.05


def test_a_nan_without_its_flag_does_no_harm():
    def spoil(k, u, w):
        w["q_meas"] = np.nan if k % 7 == 0 else w["q_meas"]
        w["command"] = np.nan if k % 11 == 0 else w["command"]

    log, s = fly_hydraulic(step(3.0), faults=spoil)
    assert np.all(np.isfinite(s["u"])) and degrees(log["delta"][-1] - math.radians(3.0)) < 0.05


def test_given_estimate_replaces_the_observer():
    """A rod estimate from outside that is 2 mm off moves the rod by 2 mm; a NaN in it falls back to the observer."""

    def biased(k, u, w):
        w["q_use"] = 1.0
        w["q_fb"] = w["q_meas"] + 0.002 if k < 600 else np.nan

    log, _ = fly_hydraulic(np.zeros(1200), noise=0.0, faults=biased)
    assert log["q_rod"][[599, -1]] == pytest.approx([-0.002, 0.0], abs=1e-4)


def test_liquid_ofc_at_the_valve_moves_the_rod_as_the_error_poles_say():
    """At low frequency the rod answers a valve fault with D / k_q metres per unit: cross-checked by flight, 0.5 Hz."""

    def ofc(k, u, w):
        u["f_u"] = 0.003 * math.sin(2 * math.pi * 0.5 * k * DT)

    D = 2 * 1e9 * 0.0025 * 0.0025 / (0.001973 * 2000)
    log, _ = fly_hydraulic(np.zeros(2000), noise=0.0, faults=ofc, actuator=HYDRAULIC.smooth)
    assert np.abs(log["q_rod"][800:]).max() == pytest.approx(0.003 * D / servo.params()["k_q"][0], rel=0.1)


def test_error_poles_are_where_they_are_said_to_be():
    """With full state and no delay, u held: three poles at 25 rad/s (3 per cent apart by placement)."""
    A, B = lu17.linear(hydraulic.params()[0])
    c = servo.params()[0]
    drive, beta = 17.5 * 2 * 1e9 * 0.0025 / (1.4e7 * 0.001973), 52.3 / 2000
    K = np.array([[c.k_q, c.k_v - drive - (c.k_a - beta) * beta, (c.k_a - beta) * 17.5 - 0.023 * drive]]) / drive
    Phi, Gamma = jay.discretise(A, B, DT)
    poles = np.log(np.linalg.eigvals(Phi - Gamma @ K)) / DT
    np.testing.assert_allclose(np.sort(poles.real), [-25.75, -25.0, -24.25], rtol=1e-3)


# -- the electromechanical one


def test_surface_error_is_the_springs_and_nothing_hunts():
    """The position sensor sits at the screw: against the load the surface lags by hm / l^2 K_s, 0.08 degree here.
    Without noise everything comes to rest across the friction, and stays."""
    log, _ = fly_ema(step(3.0, 8.0), noise=0.0, hm0=-2500.0, hmd=-15e3)
    hm = -2500.0 - 15e3 * math.radians(3.0)
    assert np.degrees(EMA.driven(log)[-200:].mean()) == pytest.approx(3.0, abs=0.02)
    assert np.degrees(log["delta"][-200:].mean()) == pytest.approx(3.0 + math.degrees(hm / 2.4e6), abs=0.02)
    assert np.degrees(np.ptp(log["delta"][-400:])) < 1e-6


def test_runaway_at_its_rate_to_the_stop():
    def runaway(k, u, w):
        w["s_rate"], w["f_rate"] = (1.0, math.radians(20.0)) if k >= 200 else (0.0, 0.0)

    log, _ = fly_ema(np.zeros(600), hmd=-15e3, faults=runaway)
    assert np.degrees(log["delta"][300] - log["delta"][240]) / (60 * DT) == pytest.approx(20.0, rel=0.03)
    assert np.degrees(EMA.driven(log)[-1]) == pytest.approx(17.0, abs=0.05)


def test_given_position_replaces_the_sensor():
    """Reconfiguration: with the sensor 5 degrees off, the loop on the given position stays where it should."""

    def wrong(k, u, w):
        w["pos_fb"], w["pos_use"] = float(w["pos_meas"][0, 0]), 1.0
        w["pos_meas"] += 0.15 * math.radians(5.0)

    assert np.degrees(fly_ema(step(3.0), faults=wrong)[0]["delta"][-1]) == pytest.approx(3.0, abs=0.05)


def test_lead_in_the_compensator_is_refused():
    with pytest.raises(ValueError, match="without lead"):
        ema_servo.params(symbols={"a": 45.0})
    assert jay.values("elevator")["a"] == jay.values("elevator")["b"]
