"""Fault estimator of Sun13 against an exact simulation: estimates, alarms, classes, noise, dropouts."""

import json
import math

import numpy as np
import pytest
from rfafe_aircraft import E_SPEED, amplitude, global_of, heffley_jewell, sampled
from scipy.linalg import expm

from actuators.constants import RAD_PER_DEG
from fdi.common import verdict
from fdi.rfafe import rfafe
from fdi.rfafe.discrete import noise
from fdi.rfafe.store import from_plain, to_plain

pytest.importorskip("cvxpy")


def stored(design):
    """Return a design file's content with this Design alone, as it comes back from JSON."""
    return {"designs": {"hydraulic": {"design": json.loads(json.dumps(to_plain(design))), "u_delay_s": 0.0}}}


TRIM = {"tas": 200.0, "alpha": 0.05, "theta": 0.05, "elevator": 0.01}


@pytest.fixture(scope="module")
def published():
    A, B, C, D = global_of(*heffley_jewell("6"))
    return rfafe.design(A, B, C, D, E_SPEED, B, dt=0.005)


def measured(module, y, command=0.0):
    """Return INPUTS (1, n) of y (n, m) [m/s, deg ...] and commands (n, sides) [deg], both from the trimmed flight."""
    u = np.zeros((1, len(y)), module.INPUTS)
    u["tas"], u["alpha"] = TRIM["tas"] + y[:, 0], TRIM["alpha"] + y[:, 1] * RAD_PER_DEG
    u["q"], u["theta"] = y[:, 2] * RAD_PER_DEG, TRIM["theta"] + y[:, 3] * RAD_PER_DEG
    if "surface" in module.INPUTS.names:
        u["surface"] = TRIM["elevator"] + np.repeat(y[:, 4:], 2, axis=1) * RAD_PER_DEG  # two segments a side
    u["command"] = TRIM["elevator"] + command * RAD_PER_DEG
    for name in module.INPUTS.names:
        if name.endswith("_valid"):
            u[name] = 1.0
    return u


def flight(published, hz, degrees, n, side=0):
    """Return rfafe INPUTS (1, n) of the linear aircraft with an oscillation on one side's command."""
    d = published
    y = sampled(d.A, d.F[:, side : side + 1], d.C, (degrees, 2 * math.pi * hz), d.dt, n)
    return measured(rfafe, y)


def fly(module, p, u, dt=0.005):
    """Return the log (n,) of one lane of a block from its initial state."""
    x = module.init(p)
    log = np.zeros(u.shape, module.STATE)
    module.rollout(x, u, p, dt, log)
    return log[0]


def held_inputs(d, command, fault):
    """Return y (n, m) of the linear aircraft, commands (n, r) and left faults (n,) held over each tick."""
    n, r = d.B.shape
    big = np.zeros((n + r, n + r))
    big[:n, :n], big[:n, n:] = d.A * d.dt, d.B * d.dt
    big = expm(big)
    x, y = np.zeros(n), np.zeros((len(command), len(d.C)))
    for k in range(len(command)):
        y[k] = d.C @ x
        x = big[:n, :n] @ x + big[:n, n:] @ (command[k] + np.array([fault[k], 0.0]))
    return y


def test_stored_design_comes_back_exactly(published):
    again = from_plain(json.loads(json.dumps(to_plain(published))))
    for name in ("N", "P", "E", "Gamma"):
        assert np.array_equal(getattr(again, name), getattr(published, name))
    assert np.array_equal(again.discrete.Phi, published.discrete.Phi)
    assert again.report == published.report and again.region == published.region


@pytest.mark.parametrize("side", [0, 1])
def test_block_estimates_and_alarms_on_the_right_side(published, side):
    p = rfafe.params(stored=stored(published), trim=TRIM)
    log = fly(rfafe, p, flight(published, 1.0, 0.64, 2400, side))
    t = np.arange(2400) * 0.005
    late = t > 4.0
    name = ("f_hat_left", "f_hat_right")
    assert amplitude(t[late], log[name[side]][late], 2 * math.pi) == pytest.approx(0.64 * RAD_PER_DEG, rel=0.05)
    assert amplitude(t[late], log[name[1 - side]][late], 2 * math.pi) < 0.02 * 0.64 * RAD_PER_DEG
    assert log["alarm"][-1] == 1.0
    assert rfafe.CULPRITS[int(log["culprit"][-1])] == ("elevator_left", "elevator_right")[side]
    first = t[np.argmax(log["alarm"] > 0.5)]
    assert first < 1.0 + 3.0  # settling, then three periods


def test_both_sides_are_named_where_both_swing(published):
    left, right = (flight(published, 1.0, 0.64, 2400, side) for side in (0, 1))
    left["surface"][0, :, 2:] = right["surface"][0, :, 2:]
    log = fly(rfafe, rfafe.params(stored=stored(published), trim=TRIM), left)
    assert rfafe.CULPRITS[int(log["culprit"][-1])] == "elevator_left and elevator_right"
    assert log["alarm_elevator_left"][-1] == log["alarm_elevator_right"][-1] == 1.0


@pytest.mark.parametrize("kind", ["ofc_liquid", "ofc_solid", "ambiguous"])
def test_class_of_an_oscillation_needs_a_command_that_moves(published, kind):
    """f = s is liquid, f = s - u solid; while the command stands still the two are one signal."""
    t = np.arange(4000) * 0.005
    s = 0.64 * np.sin(2 * np.pi * (t - 4.0)) * (t >= 4.0)
    u = 0.5 * np.sin(2 * np.pi * 0.23 * t) + 0.3 * np.sin(2 * np.pi * 0.61 * t)
    u *= kind != "ambiguous"
    f = s - u * (t >= 4.0) if kind == "ofc_solid" else s
    command = np.stack([u, u], 1)
    inputs = measured(rfafe, held_inputs(published, command, f), command)
    log = fly(rfafe, rfafe.params(stored=stored(published), trim=TRIM), inputs)
    assert log["alarm"][t < 4.0].max() == 0.0
    assert verdict.class_name(log["verdict"][-1]) == kind
    assert rfafe.CULPRITS[int(log["culprit"][-1])] == "elevator_left"


def test_healthy_flight_is_quiet_and_a_dropout_leaves_no_trace(published):
    p = rfafe.params(stored=stored(published), trim=TRIM)
    u = flight(published, 1.0, 0.0, 2000)
    u["q"][0, 400:420], u["q_valid"][0, 400:420] = np.nan, 0.0  # its gain is zero
    u["surface"][0, 800:820, 1], u["surface_valid"][0, 800:820, 1] = np.nan, 0.0
    log = fly(rfafe, p, u)
    assert log["alarm"].max() == 0.0 and abs(log["f_hat"]).max() < 1e-9 and log["valid"][410] == 1.0
    assert log["valid"][700] == 1.0 and log["valid"][805] == 0.0 and log["valid"][1100] == 1.0
    for name in rfafe.STATE.names:
        assert np.isfinite(log[name]).all(), name


def test_another_tick_is_discretised_anew_and_another_technology_refused(published):
    kept = stored(published)
    fast = rfafe.params(stored=kept, dt=0.0025)
    A, B, C, D = global_of(*heffley_jewell("6"))
    again = rfafe.design(A, B, C, D, E_SPEED, B, dt=0.0025)
    assert fast["Phi"][0, :8, :8] == pytest.approx(again.discrete.Phi, abs=1e-9)
    with pytest.raises(ValueError, match="no design for ema"):
        rfafe.params(stored=stored(published), technology="ema")


def test_a_design_for_known_noise_has_less_of_it():
    sigma = np.array([0.05, 0.03, 0.02, 0.02])
    A, B = heffley_jewell("6")
    given = (*global_of(A, B, sides=1)[:2], np.eye(5)[:4], None, None, np.vstack([B, [[0.0]]]))
    plain, weighed = (rfafe.design(*given, dt=0.005, sigma=s) for s in (None, sigma))
    assert noise(weighed.discrete, sigma)[0] < 0.7 * noise(plain.discrete, sigma)[0]


def test_an_alarm_without_an_estimate_is_withdrawn_after_five_seconds(published):
    u = flight(published, 1.0, 0.64, 4000)
    u["surface_valid"][0, 1500:, 0] = 0.0
    log = fly(rfafe, rfafe.params(stored=stored(published), trim=TRIM), u)
    assert log["alarm"][1499] == 1.0 and log["valid"][1501] == 0.0
    assert log["alarm"][1500 + 999] == 1.0 and log["alarm"][1500 + 1001] == 0.0
    assert log["verdict"][-1] == verdict.NONE and log["culprit"][-1] == 0.0


@pytest.mark.parametrize("side", [0, 1])
def test_a_slow_oscillation_is_not_the_other_sides_while_it_passes_zero(published, side):
    log = fly(rfafe, rfafe.params(stored=stored(published), trim=TRIM), flight(published, 0.2, 2.0, 6000, side))
    on = log["alarm"] > 0.5
    assert on.any() and set(log["culprit"][on]) == {1.0 + side}


def test_r_counts_what_has_the_shape_of_an_oscillation(published):
    """Bursts of 2 s in every 7: each fills a fit beyond its threshold, none is an oscillation that lasts."""
    n, p = 8000, rfafe.params(stored=stored(published), trim=TRIM)
    u = flight(published, 1.0, 0.64, n)
    quiet = flight(published, 1.0, 0.0, n)
    between = (np.arange(n) * 0.005) % 7.0 > 0.3
    u["surface"][0, between], u["command"][0, between] = quiet["surface"][0, between], quiet["command"][0, between]
    log = fly(rfafe, p, u)
    assert log["alarm"].max() == 0.0 and log["r"].max() < 1.0


def test_without_any_sensor_of_the_airframe_the_positions_go_on(published):
    u = flight(published, 1.0, 0.64, 2400)
    whole = fly(rfafe, rfafe.params(stored=stored(published), trim=TRIM), u)
    for name in ("tas", "alpha", "q", "theta"):
        u[name][0, 900:], u[f"{name}_valid"][0, 900:] = np.nan, 0.0
    log = fly(rfafe, rfafe.params(stored=stored(published), trim=TRIM), u)
    assert log["valid"][-1] == 1.0 and log["alarm"][-1] == 1.0
    assert np.abs(log["f_hat_left"] - whole["f_hat_left"]).max() < 0.02 * 0.64 * RAD_PER_DEG


def with_command(inputs):
    """Return the inputs (1, n) with a slow command of both sides beside the oscillation, so that a class is named."""
    out = inputs.copy()
    t = np.arange(inputs.shape[1]) * 0.005
    out["command"] += np.radians(0.4 * np.sin(2 * np.pi * 0.1 * t))[:, None]
    return out


def test_a_side_is_not_called_alone_while_the_other_swings_within_its_threshold(published):
    one, other, healthy = (flight(published, 1.0, d, 2400, side) for d, side in ((1.2, 0), (0.6, 1), (0.0, 0)))
    for name in ("surface", "tas", "alpha", "q", "theta"):
        one[name] += other[name] - healthy[name]
    p = rfafe.params(stored=stored(published), trim=TRIM)
    p["bank_threshold"] = np.radians(0.9)  # between the two
    log = fly(rfafe, p, with_command(one))
    said = log[log["alarm"] > 0.5]
    assert len(said) > 1000 and not log["alarm_elevator_right"].any()
    assert (said["verdict"] == verdict.AMBIGUOUS).all()
    one["surface"][..., 2:] = healthy["surface"][..., 2:]
    assert np.isin(fly(rfafe, p, with_command(one))["verdict"], (verdict.OFC_LIQUID, verdict.OFC_SOLID)).any()


def test_a_fast_solid_oscillation_is_not_called_liquid_by_what_was_before_it(published):
    """Its share of the command is read from a window of 1.4 s: just after the onset that holds a healthy actuator."""
    t = np.arange(4000) * 0.005
    u = 0.8 * np.sin(2 * np.pi * 0.4 * t) + 0.8 * np.sin(2 * np.pi * 0.9 * t)
    s = 1.5 * np.sin(2 * np.pi * 7.0 * (t - 9.0))
    f = np.where(t >= 9.0, s - u, 0.0)
    inputs = measured(rfafe, held_inputs(published, np.stack([u, u], 1), f), np.stack([u, u], 1))
    log = fly(rfafe, rfafe.params(stored=stored(published), trim=TRIM), inputs)
    assert log["alarm"][t < 9.0].max() == 0.0
    assert {verdict.class_name(v) for v in log["verdict"][t > 9.0]} - {"none", "ambiguous"} == {"ofc_solid"}


@pytest.mark.parametrize("hz", [1.0, 3.0, 6.0])
def test_a_resonance_that_is_known_is_taken_out_of_the_estimate(published, hz):
    p = rfafe.params(stored=stored(published), trim=TRIM, response={"hydraulic": (35.9, 0.327)})
    b, a = p["even"][0, 0, :3], np.r_[1.0, p["even"][0, 0, 3:]]
    s, z = 2j * np.pi * hz, np.exp(2j * np.pi * hz * 0.005)
    even = np.polyval(b, z) / np.polyval(a, z)
    resonance = 35.9**2 / (s * s + 2 * 0.327 * 35.9 * s + 35.9**2)
    assert abs(even * resonance) == pytest.approx(1.0, abs=0.15)


def test_the_bilinear_transform_is_that_of_scipy_to_rounding():
    from scipy.signal import bilinear

    rng = np.random.default_rng(1)
    for _ in range(50):
        b, a, fs = rng.uniform(0.1, 50.0, 3), rng.uniform(0.1, 50.0, 3), rng.uniform(50.0, 2000.0)
        for ours, theirs in zip(rfafe._bilinear(b, a, fs), bilinear(b, a, fs)):
            np.testing.assert_array_max_ulp(ours, theirs, maxulp=8)  # versions of SciPy round differently


@pytest.mark.parametrize("side", [0, 1])
def test_a_jolt_in_the_estimate_does_not_end_the_alarm_of_an_oscillation(published, side):
    """A single swing beside the sine spoils the windows that hold it; the sine goes on, until 16 s."""
    n, dt = 4000, 0.005
    t = np.arange(n) * dt
    u, quiet = flight(published, 1.0, 1.5, n, side), flight(published, 1.0, 0.0, n, side)
    jolt = 2.5 * RAD_PER_DEG * np.sin(np.pi * (t - 8.0) / 2.5) * ((t > 8.0) & (t < 10.5))
    u["surface"][0][:, 2 * side : 2 * side + 2] += jolt[:, None]
    for name in ("surface", "command"):
        u[name][0, t >= 16.0] = quiet[name][0, t >= 16.0]
    on = fly(rfafe, rfafe.params(stored=stored(published), trim=TRIM), u)["alarm"] > 0.5
    rose, fell = int(on.argmax()) * dt, np.flatnonzero(on)[-1] * dt
    assert rose < 4.0 and on[int(rose / dt) : round(16.0 / dt)].all()
    assert fell < 16.0 + 2.0 * 1.0 + 2.0
