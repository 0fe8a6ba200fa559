"""The servo of the hydraulic actuator: reference model, inversion, observer, limits, command faults, linear model."""

import math

import numpy as np
import pytest
from actuator_loops import DT, between, fly_hydraulic, liquid, predicted, solid, step, there_and_back
from servo_loops import hydraulic_loop

from actuators.common import reference
from actuators.ema import jay
from actuators.hydraulic import actuator as hydraulic
from actuators.hydraulic import lu17, servo

SMOOTH = {"F_c": 0.0, "F_s": 0.0}


def _run_reference(target, p, ticks=1000):
    x = np.zeros(1, servo.STATE)
    out = np.zeros((ticks, 4))
    for k in range(ticks):
        reference.advance(x[0], DT)
        reference.demand(x[0], target, 1.0, p)
        out[k] = x["r"][0], x["rd"][0], x["rdd"][0], x["rddd"][0]
    return out


def test_reference_is_a_third_order_filter_with_the_stated_poles():
    """Small steps: sampled recurrence of r has the characteristic polynomial of exp(p dt), p = -45 and 45 at 0.8."""
    out = _run_reference(1e-4, servo.params()[0], 60)
    r = out[:, 0] - 1e-4
    pair = 45 * complex(-0.8, 0.6)
    c = np.real(np.poly(np.exp(np.array([-45, pair, np.conj(pair)]) * DT)))
    residual = r[3:] + c[1] * r[2:-1] + c[2] * r[1:-2] + c[3] * r[:-3]
    assert np.abs(residual).max() < 1e-12


@pytest.mark.parametrize("degrees", [0.3, 3.0, 10.0, 20.0])
def test_reference_keeps_its_limits_and_stops_in_time(degrees):
    p = servo.params()[0]
    out = _run_reference(0.3 * math.radians(degrees), p)
    for column, limit in ((1, p.v_max), (2, p.a_max), (3, p.j_max)):
        # velocity runs over by 2 per cent while the acceleration dies away within its jerk limit
        assert np.abs(out[:, column]).max() <= limit * (1.02 if column == 1 else 1 + 1e-9)
    assert out[:, 0].max() <= 1.004 * 0.3 * math.radians(degrees)
    assert out[-1, 0] == pytest.approx(0.3 * math.radians(degrees), rel=1e-6)


def test_reference_derivatives_are_those_of_its_position():
    out = _run_reference(0.02, servo.params()[0], 300)
    for n in range(3):
        taylor = out[:-1, n] + sum(out[:-1, n + m] * DT**m / math.factorial(m) for m in range(1, 4 - n))
        np.testing.assert_allclose(out[1:, n], taylor, rtol=1e-9, atol=1e-12)


def test_rod_follows_the_reference():
    """Smooth actuator, no load, no noise: a tenth of a millimetre in a 3 degree step."""
    log, s = fly_hydraulic(step(3.0), noise=0.0, actuator=hydraulic.params(**SMOOTH))
    assert np.abs(log["q_rod"] - s["r"]).max() < 1e-4


def test_rod_follows_with_friction_noise_and_load():
    log, s = fly_hydraulic(step(3.0), hm0=-1000.0, hmd=-15e3)
    assert np.abs(log["q_rod"] - s["r"]).max() < 1.5e-3  # the moving load is not known, only followed
    assert np.degrees(np.abs(log["delta"] - math.radians(3.0))[600:]).max() < 0.01


@pytest.mark.parametrize("delta", [-15.0, 0.0, 10.0])
def test_no_steady_error_against_the_hinge_load(delta):
    """Hinge load near the stall (9 of 10.5 kN m), there from the start or put on at 1 s: its estimate holds it."""

    def load(k, u, w):
        u["hm0"] = -9000.0 * min(max(k - 200, 0) / 100, 1.0)

    command = np.full(1200, math.radians(delta))
    log, _ = fly_hydraulic(command, hm0=-9000.0, start=math.radians(delta))
    assert np.degrees(np.abs(log["delta"] - command)).max() < 0.02
    log, _ = fly_hydraulic(command, start=math.radians(delta), faults=load)
    assert np.degrees(np.abs(log["delta"] - command)[-300:]).max() < 0.02


def test_noise_reaches_the_valve_as_little():
    """At rest and without friction, set `transport`: u below 0.002 rms, rod below 0.04 mm, estimate below 0.07."""
    log, s = fly_hydraulic(np.zeros(2000), actuator=hydraulic.params(**SMOOTH))
    assert s["u"].std() < 2e-3
    assert log["q_rod"].std() < 4e-5
    assert (s["q"] - log["q_rod"]).std() < 7e-5


@pytest.mark.parametrize("seed", range(3))
def test_flies_with_tolerances(seed):
    rng = np.random.default_rng(seed)
    names = ("B", "M", "P_s", "phi_n", "V_m", "E", "L")
    wrong = {n: hydraulic.NOMINAL[n] * (1 + 0.05 * rng.choice([-1, 1])) for n in names}
    log, _ = fly_hydraulic(step(3.0), hm0=-1000.0, hmd=-15e3, actuator=hydraulic.params(**wrong), seed=seed)
    assert np.degrees(np.abs(log["delta"] - math.radians(3.0))[700:]).max() < 0.05


def test_full_travel_and_back_without_windup():
    log, _ = fly_hydraulic(there_and_back(), hmd=-15e3)
    assert np.degrees(log["delta"].min()) == pytest.approx(-22.9, abs=0.05)  # 0.1 degrees inside the stop
    assert np.degrees(log["delta"][-1]) == pytest.approx(16.9, abs=0.05)
    left = np.flatnonzero(np.degrees(log["delta"][1000:]) > -22.5)[0] * DT
    assert left < 0.1


def test_recovers_from_a_long_jam_at_once():
    """Two seconds jammed against a standing command: no windup is left, overshoot stays below 10 per cent."""
    log, _ = fly_hydraulic(step(5.0, 5.0, at=1.2), faults=between(1.0, 3.0, jam=1.0))
    assert np.degrees(np.abs(log["delta"][300:600])).max() < 0.01
    assert np.degrees(log["delta"][600:]).max() < 5.5
    assert np.degrees(np.abs(log["delta"][800:] - math.radians(5.0))).max() < 0.05


def test_lost_samples_are_bridged():
    """One sample in five lost at random, then all of the pressure, then 0.1 s of everything: NaN never spreads.

    A servo that stood still for that 0.1 s would be off by 0.08 degrees, that of a held command.
    """
    rng = np.random.default_rng(0)

    def lose(k, u, w):
        for meas, flag in (("q_meas", "q_valid"), ("x3_meas", "x3_valid")):
            w[flag] = 1.0
            gone = (k < 400 and rng.random() < 0.2) or (k >= 400 and flag == "x3_valid") or 600 <= k < 620
            if gone:
                w[meas], w[flag] = np.nan, 0.0

    command = step(3.0) + math.radians(0.5) * np.sin(3 * np.arange(800) * DT)
    log, s = fly_hydraulic(command, hm0=-1000.0, hmd=-15e3, faults=lose)
    good, _ = fly_hydraulic(command, hm0=-1000.0, hmd=-15e3)
    assert np.all(np.isfinite(s["u"]))
    assert np.degrees(np.abs(log["delta"] - good["delta"])).max() < 0.05


def test_a_nan_without_its_flag_does_no_harm():
    def spoil(k, u, w):
        if k % 7 == 0:
            w["q_meas"] = np.nan
        if k % 11 == 0:
            w["command"] = np.nan

    log, s = fly_hydraulic(step(3.0), faults=spoil)
    assert np.all(np.isfinite(s["u"])) and np.degrees(abs(log["delta"][-1] - math.radians(3.0))) < 0.05


def test_given_estimate_replaces_the_observer():
    """A rod estimate from outside that is 2 mm off moves the rod by 2 mm; a NaN in it falls back to the observer."""

    def biased(k, u, w):
        w["q_use"] = 1.0
        w["q_fb"] = w["q_meas"] + 0.002 if k < 600 else np.nan

    log, _ = fly_hydraulic(np.zeros(1200), noise=0.0, faults=biased)
    assert log["q_rod"][599] == pytest.approx(-0.002, abs=1e-4)
    assert log["q_rod"][-1] == pytest.approx(0.0, abs=1e-4)


def test_command_faults_add_and_replace():
    for fault, end in ((liquid, 4.0), (solid, -2.0)):
        log, _ = fly_hydraulic(step(3.0), faults=fault)
        assert np.degrees(log["delta"][-1]) == pytest.approx(end, abs=0.05)


def test_liquid_ofc_at_the_valve_moves_the_rod_as_the_error_poles_say():
    """At low frequency the rod answers a valve fault with D / k_q metres per unit: cross-checked by flight, 0.5 Hz."""
    c = servo.params()
    D = 2 * 1e9 * 0.0025 * 0.0025 / (0.001973 * 2000)
    expected = D / c["k_q"][0]
    amplitude = 0.003

    def ofc(k, u, w):
        u["f_u"] = amplitude * math.sin(2 * math.pi * 0.5 * k * DT)

    log, _ = fly_hydraulic(np.zeros(2000), noise=0.0, faults=ofc, actuator=hydraulic.params(**SMOOTH))
    peak = np.abs(log["q_rod"][800:]).max()
    assert peak == pytest.approx(amplitude * expected, rel=0.1)


def test_linear_model_predicts_the_flown_response():
    """A small step through the sampled linear model and through the smooth nonlinear loop: 1 per cent of the step."""
    load = {"hm0": -1000.0, "hmd": -15e3}
    m = hydraulic_loop(**load)
    command = step(0.2, 2.0)
    log, _ = fly_hydraulic(command, noise=0.0, actuator=hydraulic.params(**SMOOTH), **load)
    assert np.abs(predicted(m, command) - log["delta"]).max() < 0.01 * math.radians(0.2)


@pytest.mark.parametrize("hmd", [0.0, -15e3, -26e3, 5e3])
def test_loop_is_stable_over_hinge_stiffness_and_parameters(hmd):
    for off in ({}, {"M": 2400.0}, {"M": 1600.0}, {"E": 5e8}, {"L": 0.1}, {"P_s": 1.1e7}):
        m = hydraulic_loop(hmd=hmd, hm0=-1000.0, actuator=hydraulic.params(**off))
        assert np.abs(np.linalg.eigvals(m.A)).max() < math.exp(-4 * DT)


def test_error_poles_are_where_they_are_said_to_be():
    """With full state and no delay, u held: three poles at 25 rad/s (3 per cent apart by placement)."""
    A, B = lu17.linear(lu17.params()[0])
    c = servo.params()[0]
    k = 2 * 1e9 * 0.0025 / (1.4e7 * 0.001973)
    drive = 17.5 * k
    beta = 52.3 / 2000
    K = np.array([[c.k_q, c.k_v - drive - (c.k_a - beta) * beta, (c.k_a - beta) * 17.5 - 0.023 * drive]]) / drive
    Phi, Gamma = jay.discretise(A, B, DT)
    poles = np.log(np.linalg.eigvals(Phi - Gamma @ K)) / DT
    np.testing.assert_allclose(np.sort(poles.real), [-25.75, -25.0, -24.25], rtol=1e-3)
