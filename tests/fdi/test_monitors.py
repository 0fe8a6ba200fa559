"""The two baselines: position monitor and the crossing counter."""

import math

import numpy as np
import pytest
from lu17_bench import DT, doublets, fly, inputs, roll, run

from cosim.training.flights import fly_hydraulic, watch
from fdi.common import verdict
from fdi.monitors import ofc_monitor, position_monitor

K_FAULT = 2400


def onset(log):
    """Return the delay of each lane's first alarm after the fault [s], inf where there is none; none may be before."""
    assert not log["alarm"][:, :K_FAULT].any()
    hit = log["alarm"][:, K_FAULT:] > 0.5
    return np.where(hit.any(axis=1), hit.argmax(axis=1) * DT, np.inf)


def write(**values):
    """Return a fault writer that sets actuator inputs from K_FAULT on; a callable value takes the time since then."""

    def faults(k, x, w):
        if k >= K_FAULT:
            for name, value in values.items():
                x[name] = value((k - K_FAULT) * DT) if callable(value) else value

    return faults


def test_the_position_monitor_is_quiet_in_manoeuvres_and_follows_the_servo():
    flights = [fly(doublets(20.0, degrees=1.0 + s), seed=s) for s in range(4)]
    log = run(position_monitor, flights)
    assert not log["alarm"].any()
    surface = np.array([f["truth"]["delta"] for f in flights])
    assert np.degrees(np.abs(log["model"] - surface)).mean() < 0.2


def test_it_names_a_jam_and_a_runaway_by_how_the_surface_moves():
    command = np.where(np.arange(3000) * DT >= 12.0, np.radians(4.0), 0.0)
    flights = [
        fly(command, seed=1, faults=write(jam=1.0)),
        fly(0.0 * command, seed=2, faults=write(f_u=0.1, s_u=1.0)),
    ]
    log = run(position_monitor, flights)
    assert (onset(log) < 0.5).all()
    for said, right in zip(log["verdict"][:, K_FAULT:], (verdict.JAM_SOLID, verdict.RUNAWAY)):
        classes = [c for c in dict.fromkeys(said) if c not in (verdict.NONE, verdict.AMBIGUOUS)]
        assert classes == [right] and (said[600:] == right).all()  # no other name at any time, and it stays


@pytest.mark.parametrize("left", [0.3, 0.5])
@pytest.mark.parametrize("away", [-1.0, 1.0])
def test_a_surface_that_follows_with_part_of_its_command_is_no_runaway(left, away):
    """On the way back from a far command the surface of less travel moves away from the model's larger deflection."""
    t = np.arange(round(20.0 / DT)) * DT
    command = away * np.radians(np.interp(t, [0.0, 5.0, 6.0, 9.0, 16.0], [0.0, 0.0, 16.0, 16.0, 0.0]))
    p = position_monitor.params(limits=(-0.4, 0.4))
    u = np.zeros((1, len(t)), position_monitor.INPUTS)
    u["command"], u["surface"], u["surface_valid"] = command, left * command, 1.0
    log = roll(position_monitor, p, u)
    assert (log["verdict"] == verdict.AMBIGUOUS).any() and not (log["verdict"] == verdict.RUNAWAY).any()
    stuck = u.copy()
    stuck["surface"] = np.where(t < 9.0, command, command[round(9.0 / DT)] - away * np.radians(8.0) * (t - 9.0))
    stuck["command"] = command[round(9.0 / DT)] * (t >= 9.0) + command * (t < 9.0)
    assert (roll(position_monitor, p, stuck)["verdict"] == verdict.RUNAWAY).any()


def test_what_looks_like_a_jam_for_a_moment_is_called_none():
    command = np.where(np.arange(3600) * DT >= 12.0, np.radians(4.0), 0.0)
    flights = [
        fly(command, seed=1, faults=write(f_u=-0.004, s_u=1.0)),  # creeps away
        fly(command, seed=2, faults=write(f_u=lambda t: 0.06 * np.sin(2 * np.pi * t), s_u=1.0)),  # rests at its turns
    ]
    log = run(position_monitor, flights)
    assert log["alarm"].any(axis=1).all() and not (log["verdict"] == verdict.JAM_SOLID).any()


@pytest.mark.parametrize("own, jam", [
    (lambda t: 0.0 * t, True),
    (lambda t: 0.015 * t, False),  # free-floating, it creeps with the air
    (lambda t: 0.05 * np.sin(2 * np.pi * 3.0 * t), False),  # it swings by less than the threshold of a rest
])  # fmt: skip
def test_a_surface_that_moves_by_itself_is_no_jam_though_its_command_passes_it_all_the_time(own, jam):
    """In gusts the model passes a surface that stands twice a second, and so is near it again and again [deg]."""
    t = np.arange(round(30.0 / DT)) * DT
    command = np.radians(2.0 * np.sin(2 * np.pi * 0.4 * t) + 1.0 * np.sin(2 * np.pi * 0.7 * t))
    u = np.zeros((1, len(t)), position_monitor.INPUTS)
    u["command"], u["surface_valid"] = command, 1.0
    p = position_monitor.params(limits=(-0.4, 0.4))
    follows = roll(position_monitor, p, u)["model"][0]
    k = round(12.0 / DT)
    u["surface"] = np.where(t < 12.0, follows, follows[k] + np.radians(own(t - 12.0)))
    u["surface"] += np.radians(0.02) * np.random.default_rng(5).standard_normal(len(t))
    log = roll(position_monitor, p, u)[0]
    assert not log["alarm"][:k].any() and log["alarm"][-2000:].any()
    last = log["verdict"][-2000:][log["alarm"][-2000:] > 0.5]
    assert (last == (verdict.JAM_SOLID if jam else verdict.AMBIGUOUS)).mean() > (0.8 if jam else 0.999)


def test_it_cannot_see_what_stays_below_its_threshold():
    small = fly(doublets(15.0), seed=3, faults=write(f_u=lambda t: 0.003 * np.sin(2 * np.pi * t)))
    assert not run(position_monitor, [small])["alarm"].any()


@pytest.mark.parametrize(("hz", "u"), [(1.0, 0.04), (3.0, 0.12), (7.0, 0.2)])
def test_the_ofc_monitor_counts_a_large_oscillation_and_gives_its_frequency(hz, u):
    wave = write(f_u=lambda t: u * np.sin(2 * np.pi * hz * t))
    log = run(ofc_monitor, [fly(np.zeros(round((12 + 5 / hz) / DT)), seed=s, faults=wave) for s in range(3)])
    assert (onset(log) <= 3.0 / hz).all()
    assert (log["verdict"][:, -1] == verdict.AMBIGUOUS).all()  # the command is still: added or in place, it looks alike
    assert np.abs(log["ofc_hz"][:, -1] / hz - 1).max() < 0.25


@pytest.mark.parametrize("seed", [1, 2])
def test_what_swings_with_the_command_is_no_oscillation(seed):
    """A servo that becomes weak: the residual alternates as the command does."""
    t = np.arange(round(30.0 / DT)) * DT
    command = np.radians(3.0) * np.sign(np.sin(2 * np.pi * 0.6 * t + seed)) * (t > 5.0)
    healthy = fly(command, seed=seed)
    u = inputs(ofc_monitor, [healthy])
    u["y_rod"] *= np.where(t > 15.0, 0.5, 1.0)  # half of what was asked for
    log = roll(ofc_monitor, ofc_monitor.params(), u)
    assert log["alarm"].any()
    assert set(np.unique(log["verdict"])) == {verdict.NONE, verdict.AMBIGUOUS}


def test_an_irregular_residual_is_no_oscillation():
    u = inputs(ofc_monitor, [fly(np.zeros(8000), seed=4)])
    rng = np.random.default_rng(5)
    kicks = np.repeat(rng.choice([-1.0, 1.0], 400) * rng.uniform(4e-3, 12e-3, 400), rng.integers(20, 180, 400))
    u["y_rod"] += kicks[:8000]
    log = roll(ofc_monitor, ofc_monitor.params(), u)
    assert (log["verdict"] == verdict.AMBIGUOUS).any()
    assert not (log["verdict"] == verdict.OFC_LIQUID).any()


@pytest.mark.parametrize(("size", "lasts"), [(2e-3, 0.6), (3e-3, 1.1), (6e-3, 2.5), (15e-3, 2.0), (40e-3, 20.0)])
def test_a_rod_that_is_off_for_a_while_does_not_oscillate_nor_does_the_servo_answer_so(size, lasts):
    """Off by `size` [m] for `lasts` [s], as while a sensor in the loop is: a step, or two, are no half periods."""
    u = _missing(0.1, 1)
    t = np.arange(u.shape[1]) * DT
    before = roll(ofc_monitor, ofc_monitor.params(), u)[0]["response"][-1]
    u["y_rod"][0] += size * ((t > 17.0) & (t < 17.0 + lasts))
    log = roll(ofc_monitor, ofc_monitor.params(), u)[0]
    assert not log["alarm"].any()
    assert ofc_monitor.departure(log["response"][-1] - before) < 0.08


def test_the_ofc_monitor_is_quiet_in_manoeuvres_and_at_a_jam():
    flights = [fly(doublets(20.0, degrees=2.0), seed=s) for s in range(3)]
    assert not run(ofc_monitor, flights)["alarm"].any()
    step = np.where(np.arange(3000) * DT >= 12.0, np.radians(3.0), 0.0)
    assert not run(ofc_monitor, [fly(step, seed=1, faults=write(jam=1.0))])["alarm"].any()


def test_the_alarm_of_a_rod_that_has_jammed_ends_in_time():
    """What the filters make of the way back is no oscillation any more."""
    u = _swinging(0.0, 0.9, amplitude=3e-3, moves=0.0)
    t = np.arange(u.shape[1]) * DT
    u["y_rod"][0] = np.where(t < 20.0, u["y_rod"][0] + 20e-3 * (t > 15.0), u["y_rod"][0][round(14.0 / DT)])
    alarm = roll(ofc_monitor, ofc_monitor.params(), u)[0]["alarm"] > 0.5
    assert alarm[round(19.9 / DT)] and not alarm[round(23.0 / DT) :].any()


def test_a_reference_at_its_limits_of_rate_widens_the_limit_and_learns_no_step():
    t = np.arange(round(30.0 / DT)) * DT
    u = np.zeros((1, len(t)), ofc_monitor.INPUTS)
    u["command"], u["y_rod_valid"], u["y_dp_valid"] = np.radians(15.0) * ((t > 15.0) & (t < 16.0)), 1.0, 1.0
    log = roll(ofc_monitor, ofc_monitor.params(), u)[0]
    assert log["limited"][: round(15.0 / DT)].max() == 0.0 and log["limited"].max() == 1.0
    assert log["limited"][round(26.5 / DT)] == pytest.approx(math.exp(-2.0), rel=0.1)


def _missing(share, late, seconds=40.0):
    """Return INPUTS of a rod that lacks a `share` of its reference's motion and is `late` [ticks] beyond it."""
    rng = np.random.default_rng(7)
    n = round(seconds / DT)
    t = np.arange(n) * DT
    waves = [(a, f, rng.uniform(0.0, 6.28)) for a, f in ((0.4, 0.5), (0.4, 0.83), (0.35, 1.3), (0.3, 1.9), (0.2, 2.7))]
    u = np.zeros((1, n), ofc_monitor.INPUTS)
    u["command"] = np.radians(sum(a * np.sin(2 * np.pi * f * t + phase) for a, f, phase in waves))
    u["y_rod_valid"] = u["y_dp_valid"] = 1.0
    q = roll(ofc_monitor, ofc_monitor.params(), u)["q_est"][0]
    u["y_rod"] = (1.0 - share) * q[np.maximum(np.arange(n) - 2 - late, 0)]
    return u


def test_a_servo_that_misses_a_share_of_its_reference_is_no_oscillation():
    u = _missing(0.3, 3)
    log = roll(ofc_monitor, ofc_monitor.params(), u)[0]
    assert not log["alarm"].any()
    p, hz = ofc_monitor.params()[0], ofc_monitor.AT[0]
    learned = (p["L_re"] + 1j * p["L_im"])[0] @ log["response"][-1]
    assert abs(learned - (0.7 * np.exp(-2j * np.pi * hz * 3 * DT) - 1.0)) < 0.06
    t = np.arange(u.shape[1]) * DT
    u["y_rod"][0] += np.where(t > 30.0, 2.5e-3 * np.sin(2 * np.pi * 2.3 * t), 0.0)
    seen = roll(ofc_monitor, ofc_monitor.params(), u)[0]["alarm"] > 0.5
    assert not seen[: round(30.0 / DT)].any() and seen[round(32.0 / DT) :].all()


def _swinging(follows, hz, amplitude=2e-3, moves=1.0, seconds=30.0, begins=15.0):
    """Return INPUTS of a rod that oscillates from `begins` on [s] and then follows its command by the share `follows`,
    and by which its command `moves` then [deg]."""
    rng = np.random.default_rng(3)
    t = np.arange(round(seconds / DT)) * DT
    own = np.interp(t, [0.0, begins - 4.0, begins - 3.0], [0.5, 0.5, moves])
    u = np.zeros((1, len(t)), ofc_monitor.INPUTS)
    u["command"] = np.radians(own * (np.sin(2 * np.pi * 0.37 * t) + 0.5 * np.sin(2 * np.pi * 0.83 * t + 1.0)))
    u["y_rod_valid"] = u["y_dp_valid"] = 1.0
    q = roll(ofc_monitor, ofc_monitor.params(), u)["q_est"][0][np.maximum(np.arange(len(t)) - 2, 0)]
    after = t > begins
    swing = amplitude * np.sin(2 * np.pi * hz * (t - begins)) * after
    u["y_rod"] = np.where(after, follows, 1.0) * q + swing + 1e-4 * rng.standard_normal(len(t))
    return u


@pytest.mark.parametrize("hz", [0.7, 1.9, 6.0])
@pytest.mark.parametrize(("follows", "name"), [(1.0, verdict.OFC_LIQUID), (0.0, verdict.OFC_SOLID)])
def test_an_oscillation_is_added_or_in_place_by_the_commands_own_part_of_the_motion(hz, follows, name):
    log = roll(ofc_monitor, ofc_monitor.params(), _swinging(follows, hz))[0]
    said = log["verdict"][log["alarm"] > 0.5]
    assert not log["alarm"][: round(15.0 / DT)].any()
    assert set(said) == {verdict.AMBIGUOUS, name} and log["verdict"][round(22.0 / DT)] == name
    named = log[log["verdict"] == name][-1]
    assert named["gain"] == pytest.approx(follows, abs=4.0 * named["gain_sigma"] + 0.02)
    assert named["ofc_hz"] == pytest.approx(hz, rel=0.05)


@pytest.mark.parametrize("follows", [0.0, 1.0])
def test_while_the_command_is_still_an_oscillation_has_no_name(follows):
    log = roll(ofc_monitor, ofc_monitor.params(), _swinging(follows, 1.9, moves=0.0))[0]
    assert set(log["verdict"][round(18.0 / DT) :]) == {verdict.AMBIGUOUS}


def test_a_servo_beyond_what_tolerances_make_is_not_judged():
    log = roll(ofc_monitor, ofc_monitor.params(), _missing(0.6, 0))[0]
    assert not log["valid"][-1] and log["departure"][-1] > ofc_monitor.params()["most"][0]


@pytest.mark.parametrize("kt", [310.0, 365.0])
def test_the_ofc_monitor_is_quiet_in_gusts_at_a_corner_of_the_tolerances(kt):
    """Less flow, less supply, more piston area: the corner at which a servo lacks most of its motion."""
    flown = fly_hydraulic(
        duration=40.0, seed=0, tolerances={"hydraulic": {"A_p": 1.05, "phi_n": 0.95, "P_s": 0.95}},
        flight={"mass_t": 393.0, "cg_pct": 30.0, "altitude_ft": 20000.0, "cas_kt": kt, "turbulence": "moderate"},
    )  # fmt: skip
    assert not watch(flown, ofc_monitor, ofc_monitor.params(), ("alarm",))["alarm"].any()


@pytest.mark.parametrize("module", [position_monitor, ofc_monitor])
def test_bad_measurements_do_not_stick(module):
    u = inputs(module, [fly(doublets(12.0), seed=s) for s in range(2)])
    for name in u.dtype.names:
        if name.endswith("_valid"):
            continue
        u[name][:, 800:880] = np.nan
    log = roll(module, np.repeat(module.params(), 2), u)
    for name in log.dtype.names:
        assert np.isfinite(log[name]).all(), name
    assert not log["valid"][:, 845:880].any()
    assert log["valid"][:, 885:].all()


def monitored(which, command, surface):
    """Return the position monitor's log (ticks,) over tables of command and surface [rad]."""
    u = np.zeros((1, len(command)), position_monitor.INPUTS)
    u["command"], u["surface"], u["surface_valid"] = command, surface, 1.0
    p = position_monitor.params(which)
    log = np.zeros((1, len(command)), position_monitor.STATE)
    position_monitor.rollout(position_monitor.init(p), u, p, DT, log)
    return log[0]


@pytest.mark.parametrize("which", ["flight", "flight_ema"])
def test_a_surface_sensor_that_is_frozen_is_named_and_one_without_noise_that_stands_still_is_not(which):
    t, rng = np.arange(4000) * DT, np.random.default_rng(2)
    command = 0.06 * np.sin(2.0 * np.pi * 0.3 * t)
    follows = monitored(which, command, 0.0 * t)["model"]
    for sigma in (np.radians(0.02), 0.0):
        surface = follows + sigma * rng.standard_normal(len(t))
        surface[t >= 10.1] = surface[2020]
        log = monitored(which, command, surface)
        assert not log["alarm"][:2000].any()
        named = log[2020:][log["alarm"][2020:] > 0.5]
        assert len(named) and ((named["verdict"] == verdict.SENSOR) == (sigma > 0.0)).all()
        assert (named["culprit"] == (1.0 if sigma > 0.0 else 0.0)).all()


@pytest.mark.parametrize("which", ["flight", "flight_ema"])
@pytest.mark.parametrize("turns", [False, True])
def test_a_surface_that_runs_away_and_turns_back_is_open(which, turns):
    """Where the sensor in the loop is frozen the surface runs, too, but turns when the command passes the reading."""
    t = np.arange(4000) * DT
    command = np.radians(np.interp(t, [0.0, 10.0, 12.0, 14.0, 16.0], [0.0, 0.0, -2.0, 2.0, 2.0]))
    surface = np.radians(np.interp(t, [0.0, 10.0, 12.0], [0.0, 0.0, 16.0]))
    if turns:
        surface = np.where(t < 13.0, surface, np.radians(16.0 - 15.0 * np.clip(t - 13.0, 0.0, 2.0)))
    said = monitored(which, command, surface)["verdict"]
    assert said[2599] == verdict.RUNAWAY and said[2200] == verdict.RUNAWAY
    assert said[2900] == said[-1] == (verdict.AMBIGUOUS if turns else verdict.RUNAWAY)


@pytest.mark.parametrize(("stays", "named"), [(0.3, False), (3.0, True)])
def test_a_surface_that_turns_back_from_the_end_of_its_travel_is_not_called_a_runaway(stays, named):
    """As a frozen position sensor moves it: to the stop, and back once the command has passed the reading."""
    t = np.arange(4000) * DT
    command = np.radians(np.interp(t, [0.0, 10.0, 10.4, 16.0], [0.0, 0.0, -2.0, -2.0]))
    surface = np.radians(np.interp(t, [0.0, 10.0, 10.2, 10.2 + stays, 12.0 + stays], [0.0, 0.0, 16.8, 16.8, -2.0]))
    said = monitored("flight_ema", command, surface)["verdict"]
    assert (said == verdict.RUNAWAY).any() == named and (said == verdict.AMBIGUOUS).any()
