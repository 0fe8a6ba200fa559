"""The three-step filter as published, and the form fit for flight."""

import numpy as np
import pytest
from lu17_bench import DT, doublets, fly, inputs, roll, run

import cosim
from fdi.common import verdict
from fdi.hydraulic import rtsekf, rtsekf_flight

K_FAULT = 2400


@pytest.fixture(scope="module")
def flights():
    return [fly(doublets(20.0), seed=s) for s in range(4)]


def blame(log):
    return [rtsekf_flight.ISOLABLE_PARTS[int(c)] for c in log["isolated_part"][:, -1]]


def test_in_flight_it_does_not_grow_in_ten_minutes():
    flight = fly(doublets(60.0, degrees=3.0), seed=3)
    u = np.concatenate([inputs(rtsekf_flight, [flight])] * 10, axis=1)
    truth = np.tile(flight["truth"]["q_rod"], 10)
    log = roll(rtsekf_flight, rtsekf_flight.params(), u)[0]
    off, fault = ((a.reshape(10, -1)[:, 400:]) for a in (log["q_now"] - truth, log["f_hat"]))
    error = np.sqrt((off**2).mean(axis=1))
    assert not log["alarm"].any()
    assert error.max() < 1.5e-4 and error[-1] < 1.1 * error[0] + 1e-5
    assert np.abs(fault.mean(axis=1)).max() < 5e-5


def test_both_position_sensors_in_three_steps_equal_the_published_matrices():
    p = rtsekf_flight.params()
    rng = np.random.default_rng(5)
    A = rng.standard_normal((4, 4))
    x = rtsekf_flight.init(p)
    H, R = np.array([[1.0, 0, 0, 0]] * 2), np.diag([p["r_rod"][0], p["r_surface"][0]])
    for blamed, F in ((0.0, np.array([[1.0], [0.0]])), (2.0, np.array([[0.0], [1.0]]))):
        P = 1e-8 * A @ A.T
        x["P"][0], x["x_hat"][0], x["blame"] = P, [0.01, 0.02, 0.1, -0.1], blamed
        y = np.array([0.0113, 0.0102])
        gamma = y - H @ x["x_hat"][0]
        S = H @ P @ H.T + R  # (40)
        P_f = np.linalg.inv(F.T @ np.linalg.inv(S) @ F)  # (43)
        f = (P_f @ F.T @ np.linalg.inv(S) @ gamma).item()  # (42), (48)
        K = P @ H.T @ np.linalg.inv(S)  # (45)
        state = x["x_hat"][0] + K @ (gamma - F[:, 0] * f)  # (46)
        cov = P - K @ (S - F @ P_f @ F.T) @ K.T  # (47)
        rtsekf_flight.three_steps(x[0], y[0], y[1], p[0])
        assert x["f_hat"][0] == pytest.approx(f, rel=1e-9)
        assert np.abs(x["x_hat"][0] - state).max() < 1e-12
        assert np.abs(x["P"][0] - cov).max() < 1e-9 * np.abs(P).max()


@pytest.mark.parametrize("mm", [0.6, 3.0])
@pytest.mark.parametrize("which", ["rod", "surface"])
def test_the_wrong_one_of_two_disagreeing_sensors_is_named(flights, mm, which):
    u = inputs(rtsekf_flight, flights)
    u[f"y_{which}"][:, K_FAULT:] += mm * 1e-3 / (0.30 if which == "surface" else 1.0)
    log = roll(rtsekf_flight, np.repeat(rtsekf_flight.params(), 4), u)
    assert not log["alarm"][:, :K_FAULT].any()
    assert (log["alarm"][:, K_FAULT : K_FAULT + 60].max(axis=1) == 1).all()  # 0.3 s
    assert (log["verdict"][:, -1] == verdict.SENSOR).all()
    assert blame(log) == [which] * 4
    assert np.abs(log["f_hat"][:, -400:].mean(axis=1) - mm * 1e-3).max() < 1e-4  # README: 1 mm to 0.1 mm
    truth = np.array([f["truth"]["q_rod"] for f in flights])
    assert np.abs(log["q_now"] - truth)[:, K_FAULT + 100 :].max() < 6e-4  # the estimate stays with the healthy one


def test_a_frozen_and_a_drifting_rod_sensor_are_found(flights):
    u = inputs(rtsekf_flight, flights)
    u["y_rod"][:, K_FAULT:] = u["y_rod"][:, K_FAULT : K_FAULT + 1]
    frozen = roll(rtsekf_flight, np.repeat(rtsekf_flight.params(), 4), u)
    assert blame(frozen) == ["rod"] * 4
    u = inputs(rtsekf_flight, flights)
    u["y_rod"][:, K_FAULT:] += 1e-3 * DT * np.arange(u.shape[1] - K_FAULT)
    drift = roll(rtsekf_flight, np.repeat(rtsekf_flight.params(), 4), u)
    assert (drift["alarm"][:, K_FAULT + 200] == 1).all()
    assert np.isin(drift["verdict"][:, -1], (verdict.SENSOR, verdict.AMBIGUOUS)).all()


@pytest.mark.parametrize("ticks", [-1, 1])
def test_samples_of_another_age_are_no_fault(flights, ticks):
    u = inputs(rtsekf_flight, flights)[:, 1:-1]
    u["y_rod"] = np.roll(inputs(rtsekf_flight, flights)["y_rod"], ticks, axis=1)[:, 1:-1]
    assert not roll(rtsekf_flight, np.repeat(rtsekf_flight.params(), 4), u)["alarm"].any()


def valve(value):
    """Return a fault that holds the valve open by value(k) from K_FAULT on."""

    def fault(k, x, w):
        if k >= K_FAULT:
            x["f_u"], x["s_u"] = value(k), 1.0

    return fault


def jam(k, x, w):
    x["jam"] = float(k >= K_FAULT - 200)


RUNAWAY = valve(lambda k: 0.1)


def test_it_stays_quiet_under_a_real_jam_and_a_real_runaway():
    log = run(rtsekf_flight, [fly(doublets(16.0), seed=s, faults=f) for s, f in enumerate((jam, RUNAWAY))])
    assert not log["alarm"].any()
    assert log["valid"][:, 1:].all()


def test_as_published_it_alarms_at_a_runaway_and_a_jam_and_does_not_tell_them_apart():
    log = run(rtsekf, [fly(doublets(16.0), seed=s, faults=f) for s, f in enumerate((jam, RUNAWAY))], load=1)
    assert not log["alarm"][:, : K_FAULT - 200].any() and (log["alarm"][:, -1] == 1.0).all()
    assert set(log["verdict"][log["alarm"] > 0.5]) == {verdict.AMBIGUOUS}


@pytest.mark.parametrize("seed", [910200011, 910200012])
def test_sensors_twice_as_noisy_as_specified_do_not_alarm_and_their_faults_are_named(seed):
    keys = ["duration_s=20", f"seed={seed}", "sensors.noise_scale=2", 'detectors.enabled=["rtsekf_flight"]']
    healthy = cosim.simulate(cosim.load_scenario("cruise", keys), timed=False).detectors
    assert [d["false_alarms"] for d in healthy] == [0] * len(healthy)
    keys += ["faults.0.target=elevator.left_inner.rod", "faults.0.kind=bias", "faults.0.start_s=12",
             "faults.0.bias_mm=1"]  # fmt: skip
    found = cosim.simulate(cosim.load_scenario("cruise", keys), timed=False).detectors
    assert next(d for d in found if d["target"] == "elevator.left_inner")["isolated"]["target"].endswith(".rod")
