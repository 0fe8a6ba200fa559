"""Fault estimator of Sun13 against an exact simulation: estimates, alarms, classes, noise, dropouts."""

import json
import math

import numpy as np
import pytest
from rfafe_aircraft import E_SPEED, amplitude, global_of, heffley_jewell, sampled
from scipy.linalg import expm

from actuators.constants import RAD_PER_DEG
from fdi.common import tuning, verdict
from fdi.rfafe import design, rfafe
from fdi.rfafe.discrete import noise
from fdi.rfafe.store import from_plain

pytest.importorskip("cvxpy")
DT, REST = 0.005, 60  # ticks at rest before, in which the trim is learned


@pytest.fixture(scope="module")
def published():
    A, B, C, D = global_of(*heffley_jewell("6"))
    return design(A, B, C, D, E_SPEED, B, dt=DT)


def params(made, **more):
    """Return PARAMS of a Design as it comes back from JSON, with an actuator that has no limit of rate."""
    entry = {"design": json.loads(json.dumps(tuning.plain(made))), "u_delay_s": 0.0,
             "actuator": {"a_rad_s": 18.0, "gain": 1.0, "rate_deg_s": 1e6}}  # fmt: skip
    return rfafe.params(stored={"designs": {"hydraulic": entry}}, **more)


def measured(y, command=0.0):
    """Return INPUTS (1, REST + n) of y (n, m) [m/s, deg ...] and commands (n, sides) [deg] about a trimmed flight."""
    y, command = (np.concatenate([np.zeros((REST, w.shape[1])), w]) for w in (y, command + np.zeros((len(y), 2))))
    u = np.zeros((1, len(y)), rfafe.INPUTS)
    u["tas"], u["alpha"] = 200.0 + y[:, 0], 0.05 + y[:, 1] * RAD_PER_DEG
    u["q"], u["theta"] = y[:, 2] * RAD_PER_DEG, 0.05 + y[:, 3] * RAD_PER_DEG
    u["surface"] = 0.01 + np.repeat(y[:, 4:], 2, axis=1) * RAD_PER_DEG  # two segments a side
    u["command"] = 0.01 + command * RAD_PER_DEG
    for name in ("tas", "alpha", "q", "theta", "surface"):
        u[f"{name}_valid"] = 1.0
    return u


def flight(d, hz, degrees, n, side=0):
    """Return INPUTS of the linear aircraft with an oscillation on one side's command."""
    return measured(sampled(d.A, d.F[:, side : side + 1], d.C, (degrees, 2 * math.pi * hz), DT, n))


def fly(p, u):
    """Return the log (n,) of one lane from its initial state, without the time at rest."""
    log = np.zeros(u.shape, rfafe.STATE)
    rfafe.rollout(rfafe.init(p), u, p, DT, log)
    return log[0, REST:]


def held_inputs(d, command, fault):
    """Return y (n, m) of the linear aircraft, commands (n,) of both sides and left faults (n,) held over each tick."""
    n, r = d.B.shape
    big = np.zeros((n + r, n + r))
    big[:n, :n], big[:n, n:] = d.A * DT, d.B * DT
    big = expm(big)
    x, y = np.zeros(n), np.zeros((len(command), len(d.C)))
    for k in range(len(command)):
        y[k] = d.C @ x
        x = big[:n, :n] @ x + big[:n, n:] @ (command[k] + np.array([fault[k], 0.0]))
    return measured(y, command[:, None])


def test_a_stored_design_comes_back_exactly(published):
    again = tuning.plain(from_plain(json.loads(json.dumps(tuning.plain(published)))))
    assert again == tuning.plain(published)


@pytest.mark.parametrize("side", [0, 1])
def test_block_estimates_and_alarms_on_the_right_side(published, side):
    log = fly(params(published), flight(published, 1.0, 0.64, 2400, side))
    t = np.arange(2400) * DT
    late, names = t > 4.0, ("f_hat_left", "f_hat_right")
    assert amplitude(t[late], log[names[side]][late], 2 * math.pi) == pytest.approx(0.64 * RAD_PER_DEG, rel=0.05)
    assert amplitude(t[late], log[names[1 - side]][late], 2 * math.pi) < 0.02 * 0.64 * RAD_PER_DEG
    assert rfafe.ISOLABLE_PARTS[int(log["isolated_part"][-1])] == ("elevator_left", "elevator_right")[side]
    assert t[np.argmax(log["alarm"] > 0.5)] < 1.0 + 3.0  # settling, then three periods


@pytest.mark.parametrize(("size", "both"), [(1.0, True), (0.6, True), (0.2, False)])
def test_each_side_is_declared_from_the_threshold_on_and_one_below_it_that_swings_with_the_other(published, size, both):
    one, other, healthy = (flight(published, 1.0, size, 2400, side) for size, side in ((1.2, 0), (size, 1), (0.0, 0)))
    one["surface"] += other["surface"] - healthy["surface"]
    p = params(published)
    p["bank_threshold"] = np.radians(0.9)
    log = fly(p, one)
    parts = rfafe.ISOLABLE_PARTS
    assert parts[int(log["isolated_part"][-1])] == ("elevator_left and elevator_right" if both else "elevator_left")
    assert log["alarm_elevator_left"].any() and log["alarm_elevator_right"].any() == both


@pytest.mark.parametrize("kind", ["ofc_liquid", "ofc_solid", "ambiguous"])
def test_class_of_an_oscillation_needs_a_command_that_moves(published, kind):
    """f = s is liquid, f = s - u solid; while the command stands still the two are one signal."""
    t = np.arange(4000) * DT
    s = 0.64 * np.sin(2 * np.pi * (t - 4.0)) * (t >= 4.0)
    u = 0.5 * np.sin(2 * np.pi * 0.23 * t) + 0.3 * np.sin(2 * np.pi * 0.61 * t)
    u *= kind != "ambiguous"
    log = fly(params(published), held_inputs(published, u, s - u * (t >= 4.0) if kind == "ofc_solid" else s))
    assert log["alarm"][t < 4.0].max() == 0.0
    assert verdict.class_name(log["verdict"][-1]) == kind
    assert rfafe.ISOLABLE_PARTS[int(log["isolated_part"][-1])] == "elevator_left"


def test_healthy_flight_is_quiet_a_dropout_leaves_no_trace_and_the_airframe_is_not_needed(published):
    u = flight(published, 1.0, 0.0, 2000)
    u["q"][0, 400:], u["q_valid"][0, 400:] = np.nan, 0.0  # its gain is zero
    u["surface"][0, 800:820, 1], u["surface_valid"][0, 800:820, 1] = np.nan, 0.0
    log = fly(params(published), u)
    assert log["alarm"].max() == 0.0 and abs(log["f_hat"]).max() < 1e-9
    assert log["valid"][[410, 700, 805 - REST, 1100]].tolist() == [1.0, 1.0, 0.0, 1.0]
    assert all(np.isfinite(log[name]).all() for name in rfafe.STATE.names)


def test_another_tick_is_discretised_anew_and_another_technology_refused(published):
    A, B, C, D = global_of(*heffley_jewell("6"))
    again = design(A, B, C, D, E_SPEED, B, dt=0.0025)
    assert params(published, dt=0.0025)["Phi"][0, :8, :8] == pytest.approx(again.discrete.Phi, abs=1e-9)
    with pytest.raises(ValueError, match="no design for ema"):
        params(published, technology="ema")


def test_a_design_for_known_noise_has_less_of_it():
    sigma = np.array([0.05, 0.03, 0.02, 0.02])
    A, B = heffley_jewell("6")
    given = (*global_of(A, B, sides=1)[:2], np.eye(5)[:4], None, None, np.vstack([B, [[0.0]]]))
    plain, weighed = (design(*given, dt=DT, sigma=s) for s in (None, sigma))
    assert noise(weighed.discrete, sigma)[0] < 0.7 * noise(plain.discrete, sigma)[0]


def test_an_alarm_without_an_estimate_is_withdrawn_after_five_seconds(published):
    u = flight(published, 1.0, 0.64, 4000)
    u["surface_valid"][0, REST + 1500 :, 0] = 0.0
    log = fly(params(published), u)
    assert log["alarm"][1499] == 1.0 and log["valid"][1501] == 0.0
    assert log["alarm"][1500 + 999] == 1.0 and log["alarm"][1500 + 1001] == 0.0
    assert log["verdict"][-1] == verdict.NONE and log["isolated_part"][-1] == 0.0


@pytest.mark.parametrize("side", [0, 1])
def test_a_slow_oscillation_is_not_the_other_sides_while_it_passes_zero(published, side):
    log = fly(params(published), flight(published, 0.2, 2.0, 6000, side))
    on = log["alarm"] > 0.5
    assert on.any() and set(log["isolated_part"][on]) == {1.0 + side}


def test_r_counts_what_has_the_shape_of_an_oscillation(published):
    """Bursts of 2 s in every 7: each fills a fit beyond its threshold, none is an oscillation that lasts."""
    u, quiet = (flight(published, 1.0, size, 8000) for size in (0.64, 0.0))
    between = (np.arange(8000 + REST) * DT) % 7.0 > 0.3
    u["surface"][0, between] = quiet["surface"][0, between]
    log = fly(params(published), u)
    assert log["alarm"].max() == 0.0 and log["r"].max() < 1.0


@pytest.mark.parametrize("hz", [1.0, 3.0, 6.0])
def test_a_resonance_that_is_known_is_taken_out_of_the_estimate(published, hz):
    p = params(published, response={"hydraulic": (35.9, 0.327)})
    b, a = p["even"][0, 0, :3], np.r_[1.0, p["even"][0, 0, 3:]]
    s, z = 2j * np.pi * hz, np.exp(2j * np.pi * hz * DT)
    resonance = 35.9**2 / (s * s + 2 * 0.327 * 35.9 * s + 35.9**2)
    assert abs(np.polyval(b, z) / np.polyval(a, z) * resonance) == pytest.approx(1.0, abs=0.15)
