"""The two baselines: position monitor and the crossing counter."""

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


def test_both_are_quiet_in_manoeuvres_and_the_position_monitor_follows_the_servo():
    flights = [fly(doublets(20.0, degrees=1.0 + s), seed=s) for s in range(4)]
    log = run(position_monitor, flights)
    assert not log["alarm"].any() and not run(ofc_monitor, flights)["alarm"].any()
    assert np.degrees(np.abs(log["model"] - np.array([f["truth"]["delta"] for f in flights]))).mean() < 0.2


def test_it_names_a_jam_and_a_runaway_by_how_the_surface_moves():
    command = np.where(np.arange(3000) * DT >= 12.0, np.radians(4.0), 0.0)
    log = run(position_monitor, [
        fly(command, seed=1, faults=write(jam=1.0)),
        fly(0.0 * command, seed=2, faults=write(f_u=0.1, s_u=1.0)),
    ])  # fmt: skip
    assert (onset(log) < 0.5).all()
    for said, right in zip(log["verdict"][:, K_FAULT:], (verdict.JAM_SOLID, verdict.RUNAWAY)):
        classes = [c for c in dict.fromkeys(said) if c not in (verdict.NONE, verdict.AMBIGUOUS)]
        assert classes == [right] and (said[600:] == right).all()  # no other name at any time, and it stays


def monitored(command, surface, which="flight", **more):
    """Return the position monitor's log (ticks,) over tables of command and surface [rad]."""
    u = np.zeros((1, len(command)), position_monitor.INPUTS)
    u["command"], u["surface"], u["surface_valid"] = command, surface, 1.0
    return roll(position_monitor, position_monitor.params(which, **more), u)[0]


@pytest.mark.parametrize("own, jam", [
    (lambda t: 0.0 * t, True),
    (lambda t: 0.015 * t, False),  # free-floating, it creeps with the air
    (lambda t: 0.05 * np.sin(2 * np.pi * 3.0 * t), False),  # it swings by less than the threshold of a rest
])  # fmt: skip
def test_a_surface_that_moves_by_itself_is_no_jam_though_its_command_passes_it_all_the_time(own, jam):
    """In gusts the model passes a surface that stands twice a second, and so is near it again and again [deg]."""
    t, k = np.arange(round(30.0 / DT)) * DT, round(12.0 / DT)
    command = np.radians(2.0 * np.sin(2 * np.pi * 0.4 * t) + 1.0 * np.sin(2 * np.pi * 0.7 * t))
    follows = monitored(command, 0.0 * t, limits=(-0.4, 0.4))["model"]
    surface = np.where(t < 12.0, follows, follows[k] + np.radians(own(t - 12.0)))
    surface += np.radians(0.02) * np.random.default_rng(5).standard_normal(len(t))
    log = monitored(command, surface, limits=(-0.4, 0.4))
    assert not log["alarm"][:k].any() and log["alarm"][-2000:].any()
    last = log["verdict"][-2000:][log["alarm"][-2000:] > 0.5]
    assert (last == (verdict.JAM_SOLID if jam else verdict.AMBIGUOUS)).mean() > (0.8 if jam else 0.999)


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
    u = inputs(ofc_monitor, [fly(command, seed=seed)])
    u["y_rod"] *= np.where(t > 15.0, 0.5, 1.0)  # half of what was asked for
    log = roll(ofc_monitor, ofc_monitor.params(), u)
    assert log["alarm"].any()
    assert set(np.unique(log["verdict"])) == {verdict.NONE, verdict.AMBIGUOUS}


@pytest.mark.parametrize(("size", "lasts"), [(2e-3, 0.6), (3e-3, 1.1), (6e-3, 2.5), (15e-3, 2.0), (40e-3, 20.0)])
def test_a_rod_that_is_off_for_a_while_does_not_oscillate_nor_does_the_servo_answer_so(size, lasts):
    """Off by `size` [m] for `lasts` [s], as while a sensor in the loop is: a step, or two, are no half periods."""
    u = _missing(0.1)
    t = np.arange(u.shape[1]) * DT
    u["y_rod"][0] += size * ((t > 17.0) & (t < 17.0 + lasts))
    assert not roll(ofc_monitor, ofc_monitor.params(), u)["alarm"].any()


def test_the_ofc_monitor_is_quiet_at_a_jam():
    step = np.where(np.arange(3000) * DT >= 12.0, np.radians(3.0), 0.0)
    assert not run(ofc_monitor, [fly(step, seed=1, faults=write(jam=1.0))])["alarm"].any()


def test_the_alarm_of_a_rod_that_has_jammed_ends_in_time():
    """What the filters make of the way back is no oscillation any more."""
    u = _swinging(0.0, 0.9, amplitude=3e-3, moves=0.0)
    t = np.arange(u.shape[1]) * DT
    u["y_rod"][0] = np.where(t < 20.0, u["y_rod"][0] + 20e-3 * (t > 15.0), u["y_rod"][0][round(14.0 / DT)])
    alarm = roll(ofc_monitor, ofc_monitor.params(), u)[0]["alarm"] > 0.5
    assert alarm[round(19.9 / DT)] and not alarm[round(25.0 / DT) :].any()


def _tracked(command, rod):
    """Return INPUTS under a command (ticks,) [deg] of a rod at rod(q), q (ticks,) where a healthy one is [m]."""
    u = np.zeros((1, len(command)), ofc_monitor.INPUTS)
    u["command"], u["y_rod_valid"], u["y_dp_valid"] = np.radians(command), 1.0, 1.0
    q = roll(ofc_monitor, ofc_monitor.params(), u)["past"][0, :, 0]
    u["y_rod"] = rod(q[np.maximum(np.arange(len(q)) - 2, 0)])
    return u


def _missing(share):
    """Return INPUTS of a rod that lacks a `share` of its reference's motion and is a tick late."""
    t, rng = np.arange(round(40.0 / DT)) * DT, np.random.default_rng(7)
    waves = ((0.4, 0.5), (0.4, 0.83), (0.35, 1.3), (0.3, 1.9), (0.2, 2.7))
    command = sum(a * np.sin(2 * np.pi * f * t + rng.uniform(0.0, 6.28)) for a, f in waves)
    return _tracked(command, lambda q: (1.0 - share) * np.concatenate([q[:1], q[:-1]]))


def test_a_servo_that_misses_a_share_of_its_reference_is_no_oscillation():
    u = _missing(0.15)
    assert not roll(ofc_monitor, ofc_monitor.params(), u)["alarm"].any()
    t = np.arange(u.shape[1]) * DT
    u["y_rod"][0] += np.where(t > 30.0, 2.5e-3 * np.sin(2 * np.pi * 2.3 * t), 0.0)
    seen = roll(ofc_monitor, ofc_monitor.params(), u)[0]["alarm"] > 0.5
    assert not seen[: round(30.0 / DT)].any() and seen[round(32.0 / DT) :].all()


def _swinging(follows, hz, amplitude=2e-3, moves=1.0):
    """Return INPUTS of a rod that oscillates from 15 s on and then follows its command by the share `follows`, and by
    which its command `moves` then [deg]."""
    t, rng = np.arange(round(30.0 / DT)) * DT, np.random.default_rng(3)
    own = np.interp(t, [0.0, 11.0, 12.0], [0.5, 0.5, moves])
    swing = amplitude * np.sin(2 * np.pi * hz * (t - 15.0)) * (t > 15.0) + 1e-4 * rng.standard_normal(len(t))
    command = own * (np.sin(2 * np.pi * 0.37 * t) + 0.5 * np.sin(2 * np.pi * 0.83 * t + 1.0))
    return _tracked(command, lambda q: np.where(t > 15.0, follows, 1.0) * q + swing)


@pytest.mark.parametrize("hz", [0.7, 1.9, 6.0])
@pytest.mark.parametrize(("follows", "name"), [(1.0, verdict.OFC_LIQUID), (0.0, verdict.OFC_SOLID)])
def test_an_oscillation_is_added_or_in_place_by_the_commands_own_part_of_the_motion(hz, follows, name):
    log = roll(ofc_monitor, ofc_monitor.params(), _swinging(follows, hz))[0]
    said = log["verdict"][log["alarm"] > 0.5]
    assert not log["alarm"][: round(15.0 / DT)].any()
    assert set(said) == {verdict.AMBIGUOUS, name} and said[-1] == name
    named = log[log["verdict"] == name][-1]
    assert named["gain"] == pytest.approx(follows, abs=4.0 * named["gain_sigma"] + 0.02)
    assert named["ofc_hz"] == pytest.approx(hz, rel=0.05)


def test_the_ofc_monitor_is_quiet_in_gusts_at_a_corner_of_the_tolerances():
    """Less flow, less supply, more piston area: the corner at which a servo lacks most of its motion."""
    flown = fly_hydraulic(
        duration=40.0, seed=0, tolerances={"hydraulic": {"A_p": 1.05, "phi_n": 0.95, "P_s": 0.95}},
        flight={"mass_t": 393.0, "cg_pct": 30.0, "altitude_ft": 20000.0, "cas_kt": 365.0, "turbulence": "moderate"},
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


@pytest.mark.parametrize("which", ["flight", "flight_ema"])
def test_a_surface_sensor_that_is_frozen_is_named_and_one_without_noise_that_stands_still_is_not(which):
    t, rng = np.arange(4000) * DT, np.random.default_rng(2)
    command = 0.06 * np.sin(2.0 * np.pi * 0.3 * t)
    follows = monitored(command, 0.0 * t, which)["model"]
    for sigma in (np.radians(0.02), 0.0):
        surface = follows + sigma * rng.standard_normal(len(t))
        surface[t >= 10.1] = surface[2020]
        log = monitored(command, surface, which)
        assert not log["alarm"][:2000].any()
        named = log[2020:][log["alarm"][2020:] > 0.5]
        assert len(named) and ((named["verdict"] == verdict.SENSOR) == (sigma > 0.0)).all()
        assert (named["isolated_part"] == (1.0 if sigma > 0.0 else 0.0)).all()


@pytest.mark.parametrize("which", ["flight", "flight_ema"])
@pytest.mark.parametrize("turns", [False, True])
def test_a_surface_that_runs_away_and_turns_back_is_open_and_one_that_follows_with_a_bias_does_not_run(which, turns):
    """Where the sensor in the loop is frozen the surface runs, too, but turns when the command passes the reading."""
    t = np.arange(4000) * DT
    command = np.radians(np.interp(t, [0.0, 10.0, 12.0, 14.0, 16.0], [0.0, 0.0, -2.0, 2.0, 2.0]))
    surface = np.radians(np.interp(t, [0.0, 10.0, 12.0], [0.0, 0.0, 16.0]))
    if turns:
        surface = np.where(t < 13.0, surface, np.radians(16.0 - 15.0 * np.clip(t - 13.0, 0.0, 2.0)))
    biased = monitored(4.0 * command, 0.0 * t, which)["model"] + np.radians(2.0) * (t > 10.0)
    assert set(monitored(4.0 * command, biased, which)["verdict"]) == {verdict.NONE, verdict.AMBIGUOUS}  # it follows
    said = monitored(command, surface, which)["verdict"]
    assert said[2599] == verdict.RUNAWAY and said[2200] == verdict.RUNAWAY
    assert said[2900] == said[-1] == (verdict.AMBIGUOUS if turns else verdict.RUNAWAY)
