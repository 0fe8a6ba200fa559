"""`cosim identify`: noise, delays, actuators and thresholds of recordings whose truth is known."""

import json

import numpy as np
import pandas as pd
import pytest
from flight_point import POINT
from recorded_bench import Ride, move
from typer.testing import CliRunner

import cosim
from cosim.cli import commands as cli
from cosim.replay.map import prepare
from cosim.training.identify import NO_COMMAND, identify, texts
from cosim.training.identify.channels import lag, white
from cosim.training.identify.flow import flow
from cosim.training.identify.response import respond, simulate
from cosim.training.identify.thresholds import _one

DT = 0.005
FLIGHT = (
    POINT
    + """[detectors]
enabled = ["position_monitor"]
"""
)


def slow_noise(n, seed, size=0.05):
    rng = np.random.default_rng(seed)
    y = np.cumsum(np.cumsum(rng.standard_normal(n)) * 0.0)
    for hz in (0.1, 0.23, 0.4, 0.7, 1.1, 1.7):
        y = y + np.sin(2.0 * np.pi * hz * np.arange(n) * DT + rng.uniform(0, 6)) / (1.0 + hz)
    return size * y


@pytest.mark.parametrize("seed", range(4))
def test_noise_is_found_under_motion_and_lies_in_its_interval(seed):
    y = slow_noise(6000, seed, 0.2)
    found = white(y + 1e-3 * np.random.default_rng(seed).standard_normal(6000), 0.99)
    assert found.low < 1e-3 < found.high < 1.1e-3 and not found.note


def test_noise_that_is_not_white_is_a_bound_and_a_constant_channel_has_none():
    t = np.arange(600) / 10.0
    found = white(np.sin(2.0 * t) + np.sin(9.0 * t))
    assert found.note.startswith("at most") and found.low == 0.0
    assert white(np.ones(1000)) is None and white(np.full(1000, np.nan)) is None
    gaps = np.random.default_rng(0).standard_normal(4000)
    gaps[::500] = np.nan
    assert white(gaps).sigma == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize(("n", "late"), [(-1, 0.04), (0, 0.1), (1, 0.0)])
def test_a_delay_lies_in_its_interval(n, late):
    size, dt, rng = 12000, 0.04, np.random.default_rng(n + 2)
    w = 2.0 * np.pi * rng.uniform(0.05, 1.5, 60)
    a, b, t = rng.standard_normal(60), rng.uniform(0, 6.3, 60), np.arange(size) * dt
    x = sum(a * np.sin(w * s + b) for a, w, b, s in ((a[k], w[k], b[k], t) for k in range(60)))
    y = sum(a[k] * np.imag((1j * w[k]) ** n * np.exp(1j * (w[k] * (t - late) + b[k]))) for k in range(60))
    found = lag(y + 0.05 * rng.standard_normal(size), x + 0.05 * rng.standard_normal(size), n, dt, "x", 0.999)
    assert found.low < late < found.high and found.high - found.low < 0.02
    assert "does not move" in lag(rng.standard_normal(size), x, n, dt, "x").note


TRUTH = {"omega": 22.0, "zeta": 0.8, "rate": 0.3, "dead_band": 0.001, "delay": 0.02}


def recorded(command, seed=0, **changes):
    noise = 3e-4 * np.random.default_rng(seed).standard_normal(len(command))
    return simulate(command, command[0], DT, (-0.5, 0.5), **{**TRUTH, **changes}) + noise + 1e-3


def jumpy(n=4000, seed=0):
    return slow_noise(n, seed) + 0.06 * np.sign(np.sin(2.0 * np.pi * 0.3 * np.arange(n) * DT))


@pytest.mark.parametrize("seed", range(2))
def test_the_parameters_of_an_actuator_lie_in_their_intervals(seed):
    command = jumpy(seed=seed)
    found = respond(command, recorded(command, seed), DT, 0.999)
    for name, value in {**TRUTH, "bias": 1e-3}.items():
        p = found.parameters[name]
        assert p.low <= value <= p.high, name
        assert p.high - p.low < 0.1 * value + 2e-4, name
    assert found.fit_pct > 95.0 and found.correlation < 2.0


@pytest.mark.parametrize("off", [-0.0016, 0.0012])
def test_an_actuator_may_begin_anywhere_in_its_dead_band(off):
    """It stands there for 8 s in still air: a reading of its start, with noise, is worse than none."""
    command = np.concatenate([np.zeros(1600), jumpy(3000, 1) - jumpy(3000, 1)[0]])
    truth = {**TRUTH, "dead_band": 0.002}
    noise = 3e-4 * np.random.default_rng(4).standard_normal(len(command))
    found = respond(command, simulate(command, off, DT, (-0.5, 0.5), **truth) + noise, DT, 0.999)
    assert all(found.parameters[n].low <= value <= found.parameters[n].high for n, value in truth.items())
    assert found.correlation < 2.0


def test_a_rate_limit_that_was_not_reached_is_a_bound():
    command = slow_noise(4000, 3, 0.02)
    p = respond(command, recorded(command, rate=3.0, dead_band=0.0), DT).parameters["rate"]
    assert np.isnan(p.value) and 0.0 < p.low < 3.0 and "never reached" in p.note


@pytest.mark.parametrize(
    ("command", "surface", "words"),
    [
        (np.zeros(4000), jumpy(), "constant"),
        (jumpy(), np.zeros(4000), "three times"),
        (jumpy(100), jumpy(100), "short"),
    ],
)
def test_what_does_not_move_is_not_identified(command, surface, words):
    surface = surface + 1e-4 * np.random.default_rng(0).standard_normal(len(surface))
    assert words in respond(command, surface, DT).note


def test_the_flow_of_a_valve_lies_in_its_interval():
    n, scenario = 3000, cosim.load_scenario("cruise", ["detectors.enabled=[]"])
    command = jumpy(n, 1)
    ride = Ride(command, 0.0 * command, 0.0 * command, 0.0 * command)
    load = np.array([np.full((1, n), -300.0), np.full((1, n), -15000.0)])
    seen = {w.partition(".")[2]: v[0] for w, v in move([ride], [scenario], load, "left_inner", 1).items()}
    found = flow(seen["valve_command"][1:], seen["rod"][:-1], seen["pressure"][:-1], DT, 0.99)
    rng = np.random.default_rng(1)
    own = {s: rng.uniform(0.95, 1.05) for s in ("A_p", "B", "M", "P_s", "phi_n")}
    p = found.parameters["flow_gain"]
    assert p.low < own["phi_n"] / own["A_p"] < p.high and p.high - p.low < 0.1
    assert "constant" in flow(np.zeros(n), seen["rod"], None, DT).note


def files(tmp_path, extra="", n=4000, **columns):
    command = jumpy(n)
    table = {"t_s": np.arange(n) * DT, "cmd": command, "pos": recorded(command), **columns}
    path, m = tmp_path / "rig.csv", tmp_path / "rig.toml"
    pd.DataFrame({k: v for k, v in table.items() if v is not None}).to_csv(path, index=False)
    signals = f'[signals]\nde_cmd = {{ channel = "cmd"{extra} }}\n"left_inner.surface" = {{ channel = "pos" }}\n'
    m.write_text(FLIGHT + signals)
    return path, m


def test_what_is_identified_flies(tmp_path):
    path, m = files(tmp_path)
    found = identify(path, m)
    assert found.responses["left_inner"].parameters["rate"].value == pytest.approx(0.3, rel=0.01)
    for file, text in texts(found, tmp_path, "mine").items():
        file.write_text(text)
    keys = ["duration_s=3", "manoeuvre.kind=nz_doublet", "manoeuvre.start_s=1", "detectors.enabled=[]",
            f"actuators.mine_left_inner.file={tmp_path}/mine_left_inner.py",
            "elevator.left_inner=mine_left_inner"]  # fmt: skip
    flown = cosim.fly(cosim.load_scenario("cruise", keys), ["truth.aircraft.de_li", "law.law.de_cmd"])
    moved = flown["truth.aircraft.de_li"].to_numpy()
    assert np.ptp(moved) > 0.01 and np.abs(np.diff(moved)).max() <= 0.301 * DT
    assert "[detectors.position_monitor]" in (tmp_path / "mine.toml").read_text() or found.thresholds[0].factor == 1.0


def test_thresholds_are_raised_until_a_sluggish_healthy_actuator_is_quiet(tmp_path):
    n, command = 24000, jumpy(24000)
    path, m = files(tmp_path, t_s=np.arange(n) * DT, cmd=command, pos=recorded(command, omega=6.0))
    made = prepare(path, m)
    found = _one(made, made.found[0])
    assert found.factor > 1.2 and found.agrees and found.alarms == 0 and found.held_back_s > 40.0
    assert found.parameters["threshold"] > made.params(made.found[0])["threshold"][0]


def test_without_a_command_it_says_so(tmp_path):
    path, m = files(tmp_path, extra=', proxy = "the measured deflection"', n=1600)
    assert [row["note"] for row in identify(path, m).actuators] == [NO_COMMAND]


def test_the_command_prints_and_writes(tmp_path):
    path, m = files(tmp_path, n=1600)
    run = CliRunner().invoke(cli.app, ["identify", str(path), "--map", str(m), "-o", str(tmp_path / "o"), "--json"])
    told = json.loads(run.stdout)
    assert run.exit_code == 0 and len(told["files"]) == 2
    assert told["actuators"][0]["parameters"]["omega"]["unit"] == "rad/s"
    run = CliRunner().invoke(cli.app, ["identify", str(path), "--map", str(m)])
    assert run.exit_code == 0 and "rate" in run.stdout and "Thresholds" in run.stdout


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"t_s": None}, "no time column"),
        ({"t_s": np.zeros(4000) + np.nan}, "holds no time"),
        ({"pos": None}, "no channel 'pos'"),
    ],
)
def test_bad_input_is_one_error(tmp_path, columns, words):
    with pytest.raises(cosim.CosimError, match=words):
        identify(*files(tmp_path, **columns))


def test_constant_channels_and_gaps_are_told(tmp_path):
    found = identify(*files(tmp_path, pos=np.zeros(4000)), detectors=False)
    assert found.channels[1]["noise_note"] == "is constant" and "three times" in found.actuators[0]["note"]
    t = np.arange(4000) * DT
    found = identify(*files(tmp_path, t_s=t + 5.0 * (t > 10.0)), detectors=False)
    assert any("no sample from" in text for text in found.caveats) and found.responses["left_inner"].fit_pct > 95.0
