"""`ema_kalman_flight`: which sensor, how soon, and what happens when the loop closes on the estimate.

The bench and its draws are `ema_bench` and `ema_draws`; thresholds were
chosen on seeds below 1000.
"""

import json
import math
from importlib import resources

import numpy as np
import pytest
from ema_bench import ARM, DT, NO_LOAD, STALL, fly_bench, script, three_two_one_one
from ema_draws import (
    FAULTS,
    SECONDS,
    START,
    draw,
    outcome,
    outcomes,
    reconfigured,
)
from scipy.linalg import solve_discrete_lyapunov

from actuators.constants import RAD_PER_DEG
from actuators.ema import jay
from cosim.training import train_ema
from fdi.common.verdict import AMBIGUOUS, EFFECTIVENESS, JAM_SOLID, NONE, RUNAWAY, SENSOR
from fdi.ema import drive, gains, vote
from fdi.ema import ema_kalman_flight as flight
from fdi.ema import model as ema_design

QUICK = range(2000, 2030)


# --- design


def test_model_has_the_hinge_stiffness_inside_a():
    """First order in HM_delta equals the exponential of the whole model; the load state acts as a hinge moment."""
    v = jay.values("elevator")
    Phi, Phi_h, G, G_h = ema_design.model(v, DT, 20.0)
    for hmd in (0.0, -40e3):
        m = jay.continuous("elevator", hinge_stiffness=hmd)
        B = np.column_stack([m.B[:5], m.E[:5]])
        exact, gamma = jay.discretise(m.A[:5, :5], B, DT)
        scale = np.abs(exact).max(axis=1, keepdims=True)
        error = np.abs((Phi + hmd * Phi_h)[:5, :5] - exact) / scale
        assert error.max() < (1e-9 if hmd == 0.0 else 1e-4)
        if hmd == 0.0:
            np.testing.assert_allclose(G[:5], gamma[:, 0], rtol=1e-6)
            np.testing.assert_allclose(G_h[:5], gamma[:, 1], rtol=1e-6)
    np.testing.assert_allclose(Phi[:5, 5], G_h[:5], rtol=1e-3)  # a load that leaks with 20 s acts as one that is held
    with pytest.raises(ValueError, match="a = b"):
        ema_design.model({**v, "a": 45.0}, DT, 20.0)


def test_gain_is_the_fixed_point_of_the_covariance():
    """The covariance that a filter with this gain has (Lyapunov, no Riccati solver) gives back the same gain."""
    v = jay.values("elevator")
    Phi, Phi_h, _, _ = ema_design.model(v, DT, 20.0)
    Phi = Phi - 2e4 * Phi_h
    K, S_root = ema_design.gain(Phi, 630.0, 20.0, 1.0, 1.0, DT)
    Q = np.diag([0, 0, 0, 1.0, 0, 630.0**2 * -math.expm1(-2 * DT / 20.0)])
    closed = Phi @ (np.eye(6) - np.outer(K, np.eye(6)[3]))
    assert np.abs(np.linalg.eigvals(closed)).max() < 1.0
    P = solve_discrete_lyapunov(closed, Phi @ np.outer(K, K) @ Phi.T + Q, method="bilinear")
    # the position is seen through the hinge stiffness alone, its pole is at 0.999997: there the solvers differ more
    np.testing.assert_allclose(P[:, 3] / (P[3, 3] + 1.0), K, rtol=1e-2)
    np.testing.assert_allclose(P[3:, 3] / (P[3, 3] + 1.0), K[3:], rtol=1e-4)
    assert math.sqrt(P[3, 3] + 1.0) == pytest.approx(S_root, rel=1e-4)


# --- isolation


@pytest.mark.parametrize("fault", FAULTS)
def test_right_sensor_is_named(fault):
    """15 draws with a hinge model 30 % wrong; `slow` has the 100 of the requirement."""
    right = FAULTS[fault][2]
    named = [o.named for o in outcomes(fault, QUICK[:15])]
    assert named.count(right) >= (13 if fault == "position x1.25" else 14), named
    if fault == "position x1.25":
        assert "velocity" not in named


@pytest.mark.slow
def test_confusion_matrix_of_100_draws():
    """The requirement: 95 of 100, 85 for position x1.25, no alarm without a fault and with R +40 %, K_T, K_B -5 %."""
    for noise in (0.5, 1.0, 2.0):
        for fault, (_, _, right) in FAULTS.items():
            named = [o.named for o in outcomes(fault, range(3000, 3100), noise=noise)]
            least = 100 if right == "none" else 85 if fault == "position x1.25" else 95
            assert named.count(right) >= least, (noise, fault, sorted(set(named)))


def test_fault_free_tests_stay_below_their_thresholds_which_are_those_of_the_training():
    stored = json.loads(resources.files("fdi").joinpath("thresholds", "ema_kalman_flight.json").read_text())
    for tick, kwargs, _ in map(draw, QUICK):
        log = fly_bench(tick, **kwargs).log[round(1.0 / DT) :]
        assert all(log[name].max() < 1.0 for name in ("r_pair", "r_speed", "r_f", "r_gain", "r_velocity", "r_jump"))
    how = stored["training"]
    names = {name for names in train_ema.TESTS.values() for name in names} | {"th_rough", train_ema.GAIN}
    assert names == set(how["trained"])
    for name, trained in how["trained"].items():
        assert stored["flight"][name] == trained, name
    assert all(found["largest"] <= 1.0 for test, found in how["found"].items() if test != train_ema.GAIN)
    assert how["found"][train_ema.LOAD]["limit"] < 0.4  # of the stall moment, from where on a jam is one


def test_smallest_fault_that_is_found():
    """On 20 draws: 0.4 deg of position and 8 % of the stall current are found, a fifth of that is not."""
    seeds = range(2000, 2020)
    degree = RAD_PER_DEG * ARM
    for fault, sizes in (
        ("position + 1 deg", (0.08 * degree, 0.4 * degree)),
        ("current + 10 % of stall", (0.01 * STALL, 0.08 * STALL)),
    ):
        small, large = ([o.named for o in outcomes(fault, seeds, size=size)].count(FAULTS[fault][2]) for size in sizes)
        assert small < 19 <= large, fault


@pytest.mark.parametrize("off", [-0.01, 0.01])
def test_a_lever_off_its_length_is_learned_and_is_no_surface_sensor(off):
    """Learned as far as 7 mm of rod in noise tell it; before it is known it is no disagreement of the two."""
    t = np.arange(round(20.0 / DT)) * DT
    command = three_two_one_one(t, start=3.0) + three_two_one_one(t, start=10.0)
    tick = script(20.0, command=command, hm0=1500.0, hmd=-20e3, rng=np.random.default_rng(3))
    log = fly_bench(tick, tolerance={"arm": 1.0 + off}, reconfigure=False).log
    assert not log["alarm"].any() and log["r_pair"].max() < 0.8
    assert log["lever"][-1] == pytest.approx(off, abs=0.003)


@pytest.mark.parametrize("over", [-0.18, 0.0, 0.22])
def test_gain_magnets_and_pole_are_learned_although_the_demand_answers_the_noise_of_the_rate(over):
    """Least squares on the measured rate takes its noise, which stands in f, for magnets that are stronger."""
    p, n = flight.params(), 4000
    x, b = flight.init(p), p["b_motor"][0]
    rng, lag, w, answer = np.random.default_rng(5), 0.0, 0.0, 0.0
    rows = []
    for _ in range(n):
        d = 0.5 * rng.normal() - answer
        lag += p["amp"][0] * (d - lag)
        predicted = 0.98 * w + 0.3 * d
        w = predicted + 0.5 * rng.normal()
        read = w + rng.normal()
        answer = 0.8 * (read - w) + 0.1 * w
        f = 0.1 * d + over * (d - lag) - 0.05 * b * w + b * (read - w) + 0.1 * rng.normal()
        gains.tick(x[0], f, d, d - lag, read, predicted)
        rows.append((d, d - lag, b * read, f))
    x["gain_tick"] /= p["even"][0]
    gain, pole, magnets, doubt, doubt_b = gains.solve(x["gain_tick"][0], p[0], 0.0)
    assert gain == pytest.approx(0.1, abs=4.0 * doubt) and doubt < 0.01
    assert pole == pytest.approx(over, abs=0.02)
    assert magnets / b == pytest.approx(-0.05, abs=min(4.0 * doubt_b / b, 0.1))
    *regressors, f = np.array(rows).T
    assert np.linalg.lstsq(np.array(regressors).T, f)[0][2] > 0.1


@pytest.mark.parametrize(("swing", "name"), [(0.3, RUNAWAY), (-0.3, RUNAWAY), (0.5, NONE), (-0.5, NONE)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_current_that_has_jumped_and_stays_is_a_runaway_before_a_model_is_fitted(side, swing, name):
    """What has left it again by four tenths, up or down, is part of a fast oscillation."""
    p = flight.params()
    x, level = flight.init(p), side * 0.5 * p["I_max"][0]
    x["age"] = 10.0
    while x["f_age"][0] < drive.STAYS:
        y = level * (1.0 + swing) if x["f_age"][0] >= drive.JUMP else level
        drive.watch(x[0], y, True, 0.0, 0.0, True, 0.0, p[0], DT)
    assert x["drive_name"][0] == name


@pytest.mark.parametrize(("beyond", "says"), [(1e-3, {NONE}), (-5e-3, {NONE, JAM_SOLID})])
def test_a_drive_that_presses_on_a_stop_neither_rubs_nor_is_jammed(beyond, says):
    p, n = flight.params(), 1600
    rng, u = np.random.default_rng(2), np.zeros((1, n), flight.INPUTS)
    where = p["stop_high"][0] + beyond
    u["u"][0, 400:] = 0.75 * STALL
    u["y_current"] = np.roll(u["u"], int(p["delay"][0]), axis=1) + 0.1 * rng.normal(size=n)
    u["y_velocity"] = rng.normal(size=n)
    u["y_position"] = where + 1e-4 * rng.normal(size=n)
    u["y_surface"] = (where + 1e-4 * rng.normal(size=n)) / ARM
    for name in ("velocity", "position", "current", "surface"):
        u[f"{name}_valid"] = 1.0
    log = np.zeros((1, n), flight.STATE)
    flight.rollout(flight.init(p), u, p, DT, log)
    assert set(log["verdict"][0]) == says


@pytest.mark.parametrize(("rate", "name"), [(1.2, NONE), (4.0, EFFECTIVENESS)])
def test_friction_is_named_where_the_drive_moves_and_may_be_a_jam_where_it_does_not(rate, name):
    p = flight.params()
    x = flight.init(p)
    x["hot_friction"], x["residual"], x["w_power"] = 1.0, 1.0, rate * rate
    assert vote._drive(x[0], p[0], DT)[0] == name


@pytest.mark.parametrize(
    "share", [0.002, 0.005, 0.03, 0.1, *(pytest.param(x, marks=pytest.mark.slow) for x in (0.01, 0.05, 0.07))]
)
def test_a_velocity_bias_never_reconfigures(share):
    """In a 3-2-1-1, in a slow sine and at rest; from 0.5 % on it is named, and no other sensor ever is."""
    commands = (None, lambda t: 10 * RAD_PER_DEG * np.sin(2 * np.pi * 0.3 * t), lambda t: 0.0 * t)
    for command in commands:
        for sign in (1.0, -1.0):
            found = outcomes(
                "velocity + 10 % of no-load", range(2000, 2008), size=sign * share * NO_LOAD, command=command
            )
            assert not any(o.reconfigured for o in found)
            assert {o.named for o in found} <= ({"velocity"} if share >= 0.005 else {"none", "velocity"})


@pytest.mark.parametrize("scale", [-0.25, -0.15, 0.15, 0.25])
def test_a_velocity_scale_in_slow_motion_is_not_blamed_on_the_position(scale):
    """Where the torque says too little about the velocity, the verdict is ambiguous and the loop stays where it is."""
    for f in (0.3, 0.5):
        found = outcomes("velocity x1.25", range(2000, 2010), size=scale,
                         command=lambda t, f=f: 8 * RAD_PER_DEG * np.sin(2 * np.pi * f * t))  # fmt: skip
        assert not any(o.reconfigured for o in found)
        assert "position" not in {o.named for o in found}


@pytest.mark.parametrize("rate", [0.02, 0.1, 0.5])
def test_a_drift_of_the_position_is_named_and_reconfigured_before_a_degree(rate):
    """At rest; without the surface sensor it is ambiguous: a velocity bias looks the same."""
    for seen in (1.0, 0.0):
        tick = script(60.0)
        t = np.arange(len(tick)) * DT
        tick["f_p"] = np.clip(t - 5.0, 0.0, None) * rate * RAD_PER_DEG * ARM
        tick["ok_s"] = seen
        log = fly_bench(tick).log
        if seen:
            first = np.argmax(log["reconf"] > 0.5)
            assert log["culprit"][first] == flight.CULPRITS.index("position")
            assert 0.0 < tick["f_p"][first] < 0.3 * RAD_PER_DEG * ARM
            assert log["alarm"][first:].mean() > 0.95
        else:
            assert not log["reconf"].any() and set(np.unique(log["verdict"])) <= {NONE, AMBIGUOUS}


def test_a_jam_is_no_sensor_fault():
    names = []
    for seed in range(2000, 2015):
        tick, kwargs, begin = draw(seed)
        tick["jam"][np.arange(len(tick)) * DT >= begin] = 1.0
        flown = fly_bench(tick, **kwargs)
        names.append(JAM_SOLID if JAM_SOLID in flown.log["verdict"] else NONE)
        assert not flown.log["culprit"].any() and not flown.log["reconf"].any()
        assert set(np.unique(flown.log["verdict"])) <= {NONE, AMBIGUOUS, JAM_SOLID, EFFECTIVENESS}
    assert names.count(JAM_SOLID) >= 10


def test_current_fault_inside_the_loop_never_reconfigures():
    """Loop only: the true current is off, the monitor's copy right. Both copies: hardly anything to see but a load."""
    for both in (False, True):
        for seed in range(2000, 2015):
            tick, kwargs, begin = draw(seed)
            late = np.arange(len(tick)) * DT >= begin
            tick["f_i"][late] = 0.1 * STALL
            tick["f_c"][late] = 0.1 * STALL if both else 0.0
            log = fly_bench(tick, **kwargs).log
            assert not log["reconf"].any()
            assert not np.isin(log["culprit"], (1.0, 2.0)).any()
            if both:  # the loop's own droop shows at most
                assert set(np.unique(log["verdict"])) <= {NONE, AMBIGUOUS, SENSOR}


# --- reconfiguration


@pytest.mark.parametrize("seeds", [2, pytest.param(5, marks=pytest.mark.slow)])
@pytest.mark.parametrize("fault, size", [("f_p", 5 * RAD_PER_DEG * ARM), ("f_p", 15 * RAD_PER_DEG * ARM), ("z_p", 1.0)])
def test_surface_stays_below_half_a_degree_for_60_s_after_reconfiguration(fault, size, seeds):
    """With a velocity bias of 1e-4 of no-load; at 1e-3 too, because the anchor has learned it before the fault."""
    for bias in (1e-4, -1e-4, 1e-3):
        for seed in range(2000, 2000 + seeds):
            flown, t = reconfigured(fault, size, bias=bias, seed=seed)
            begin = t[np.argmax(flown.log["reconf"] > 0)]
            assert 20.0 < begin < 21.5  # frozen on a plateau shows at the pulse's end, 21.2 s
            late = (t > begin + 2.0) & (t < begin + 62.0)
            settled = late & (np.abs(np.gradient(flown.reference, t)) < 1e-3)
            assert np.abs(flown.surface - flown.reference)[settled].max() < 0.5 * RAD_PER_DEG
            assert np.abs(flown.estimate_error)[late[1:]].max() < 0.5 * RAD_PER_DEG
            assert np.all(flown.log["valid"][late] == 1.0)


@pytest.mark.parametrize("seeds", [3, pytest.param(10, marks=pytest.mark.slow)])
def test_pos_sigma_covers_the_error_and_validity_is_withdrawn(seeds):
    """Its error over its sigma after 60 s stays below 3 in every run; with neither position for long, valid falls."""
    ratio = []
    for seed in range(2000, 2000 + seeds):
        flown, _ = reconfigured("f_p", 5 * RAD_PER_DEG * ARM, bias=0.0, seed=seed)
        ratio.append(flown.estimate_error[-1] * ARM / flown.log["pos_sigma"][-1])
    assert np.abs(ratio).max() < 3.0
    tick = script(400.0)
    tick["f_p"][round(5.0 / DT) :] = 5 * RAD_PER_DEG * ARM
    tick["ok_s"] = 0.0
    log = fly_bench(tick).log
    gone = log["pos_sigma"] > 0.5 * RAD_PER_DEG * ARM
    assert gone.any() and not gone[: round(60.0 / DT)].any()
    np.testing.assert_array_equal(log["valid"][1:], np.where(gone, 0.0, 1.0)[1:])


def test_a_healed_position_sensor_is_taken_back_and_a_frozen_one_is_not():
    t = np.arange(round(40.0 / DT)) * DT
    for field, size in (("f_p", 2 * RAD_PER_DEG * ARM), ("z_p", 1.0)):
        tick = script(40.0, command=three_two_one_one(t, start=5.0))
        tick[field][(t >= 5.2) & (t < (10.0 if field == "f_p" else 40.0))] = size
        log = fly_bench(tick).log
        assert log["reconf"][round(9.9 / DT)] == 1.0
        assert log["alarm"][round(13.0 / DT)] == (field == "z_p")  # it agrees as long as nothing moves: not healed


# --- a long healthy flight, and bad samples


@pytest.mark.parametrize("minutes", [3, pytest.param(10, marks=pytest.mark.slow)])
def test_quiet_minutes_with_a_velocity_bias(minutes):
    t = np.arange(round(60 * minutes / DT)) * DT
    command = sum(three_two_one_one(t, start=s) for s in range(30, 60 * minutes, 60))
    for bias in (1e-4, 5e-4):
        log = fly_bench(script(60.0 * minutes, command=command, factor=(1.3, 0.7), bias=bias * NO_LOAD)).log
        assert not log["alarm"].any()
        assert np.all(log["valid"][1:] == 1.0)
        assert log["r"][200:].max() < 0.95


def gap(field, seconds, *, flag=None, value=None):
    t = np.arange(round(SECONDS / DT)) * DT
    tick, kwargs, _ = draw(2000)
    hit = (t >= START + 0.2) & (t < START + 0.2 + seconds)
    if flag is not None:
        tick[flag][hit] = 0.0  # NaN with an invalid flag
    if value is not None:
        tick[field][hit] = value
    return fly_bench(tick, **kwargs), hit


@pytest.mark.parametrize("flag", ["ok_v", "ok_p", "ok_c"])
@pytest.mark.parametrize("seconds", [DT, 0.1, 1.0])
def test_dropouts_are_survived(flag, seconds):
    """Dropped in the middle of the motion: nothing not finite, no sensor blamed, valid again at the end."""
    flown, hit = gap(None, seconds, flag=flag)
    for name in flight.STATE.names:
        assert np.all(np.isfinite(flown.log[name])), name
    assert not flown.log["alarm"].any()
    assert flown.log["valid"][-1] == 1.0
    if flag == "ok_v" and seconds > 0.2:
        assert (flown.log["valid"][hit] == 0.0).any()
    assert abs(flown.estimate_error[-1]) < 0.3 * RAD_PER_DEG


SPIKES = [("f_v", 2 * NO_LOAD), ("f_v", -1e6), ("f_p", 20 * RAD_PER_DEG * ARM), ("f_c", 100.0)]


@pytest.mark.parametrize("field, size", SPIKES)
def test_single_spikes_are_ignored(field, size):
    flown, _ = gap(field, DT, value=size)
    assert not flown.log["alarm"].any()
    assert abs(flown.estimate_error[-1]) < 0.3 * RAD_PER_DEG


def test_a_frozen_velocity_sensor_is_named():
    for seed in range(2000, 2010):
        tick, kwargs, begin = draw(seed)
        tick["z_v"][np.arange(len(tick)) * DT >= begin] = 1.0
        assert outcome(fly_bench(tick, **kwargs), begin).named == "velocity"
