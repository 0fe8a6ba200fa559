"""The campaign file: what a grid and draws make of a scenario, what is refused and how, and the command around it."""

import functools
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pandas as pd
import pytest
from killed import heeds_ctrl_c
from scipy import stats
from typer.testing import CliRunner

from cosim.campaign.draw import Draw, unit_cube
from cosim.campaign.engine import cluster, rerun, run_many
from cosim.campaign.spec import EVALUATION_SEED, load_campaign
from cosim.cli import commands as cli
from cosim.errors import CosimError
from cosim.scenario import builtin_names
from cosim.scenario import catalog as c
from cosim.scenario.catalog import toleranced

SMALL = """
base = "liquid-ofc"
[set]
duration_s = 2.0
"faults.0.start_s" = 0.5
"detectors.enabled" = ["position_monitor", "iotsekf"]
"""


@pytest.fixture
def written(tmp_path):
    """Return a function that writes a campaign file and returns its path."""

    def write(text, name="c.toml"):
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return write


def test_grid_is_factorial_and_its_last_key_changes_fastest(written):
    made = load_campaign(
        written(SMALL + "[grid]\n'faults.0.frequency_hz' = [1, 3]\n'flight.mass_t' = [200, 250, 300]\n")
    )
    scenarios, labels = made.scenarios()
    got = [(s.faults[0].model_extra["frequency_hz"], s.flight.mass_t) for s in scenarios]
    assert got == [(f, m) for f in (1, 3) for m in (200, 250, 300)]
    assert [s.seed for s in scenarios] == [EVALUATION_SEED + i for i in range(6)]
    assert labels == [{}] * 6


def test_a_table_in_a_grid_sets_several_keys_and_names_them(written):
    text = SMALL + "[grid]\npoint = [{name = 'A', 'flight.mass_t' = 260, 'flight.cas_kt' = 210, seed = 7}]\n"
    (scenario,), (label,) = load_campaign(written(text)).scenarios()
    assert (scenario.flight.mass_t, scenario.flight.cas_kt, scenario.seed, label) == (260, 210, 7, {"point": "A"})


def test_draws_repeat_with_their_seed_and_cover_every_interval(written):
    text = "runs = 8\n" + SMALL + "[draw]\n'flight.mass_t' = {low = 200, high = 280}\n"
    masses = [[s.flight.mass_t for s in load_campaign(written(text)).scenarios()[0]] for _ in range(2)]
    assert masses[0] == masses[1]
    assert sorted(int((m - 200) // 10) for m in masses[0]) == list(range(8))  # a Latin hypercube
    other = [s.flight.mass_t for s in load_campaign(written("seed = 2\n" + text)).scenarios()[0]]
    assert other != masses[0]


def test_every_tolerance_is_drawn_on_its_own(written):
    text = SMALL + "[draw]\n'tolerances.hydraulic.arm' = {low = 0.5, high = 0.6}\n"
    text += "'tolerances.hydraulic.*' = {mean = 1.0, sigma = 0.02, low = 0.95, high = 1.05}\n"
    (scenario,), _ = load_campaign(written(text)).scenarios()
    values = dict(scenario.tolerances.hydraulic)
    assert 0.5 <= values.pop("arm") <= 0.6  # what is named itself wins over the star
    values = list(values.values())
    assert len(values) > 5 and len(set(values)) == len(values) and all(0.95 <= v <= 1.05 for v in values)


def test_parts_share_what_stands_above_them(written):
    text = (
        SMALL
        + "[grid]\n'flight.mass_t' = [200, 250]\n[[part]]\nname = 'a'\ngrid = {'faults.0.frequency_hz' = [1, 2]}\n"
    )
    text += "[[part]]\nname = 'b'\nset = {'faults.0.kind' = 'jam_solid'}\n"
    made, labels = load_campaign(written(text)).scenarios()
    scenarios = list(made)
    assert [(s.faults[0].kind, s.flight.mass_t) for s in scenarios[3:]] == [("ofc_liquid", 250)] + [
        ("jam_solid", m) for m in (200, 250)
    ]
    assert [x["part"] for x in labels] == ["a"] * 4 + ["b"] * 2
    assert len({s.seed for s in scenarios}) == 6


def test_base_may_be_a_file_beside_the_campaign(written):
    written(
        "duration_s = 5.0\n[flight]\nmass_t = 222.0\ncg_pct = 30.0\naltitude_ft = 1e4\ncas_kt = 250.0\n", "own.toml"
    )
    (scenario,), _ = load_campaign(written("base = 'own.toml'\n")).scenarios()
    assert scenario.flight.mass_t == 222.0


@pytest.mark.parametrize(
    "text, says",
    [
        ("rnus = 3", "Did you mean 'runs'"),
        ("runs = 0", "runs = 0: is out of range; allowed: 1 to 1000000"),
        ("runs = true", "runs = true: must be a valid number; allowed: 1 to 1000000"),
        ("x = [", "not valid TOML"),
        ("base = 'liquid-ocf'", "liquid-ofc"),
        ("sampling = 'sobol'", "latin_hypercube"),
        ("[set]\nflight.mass_t = 260.0", "set.flight: is a table"),
        ("[grid]\n'flight.mass_t' = 3", "grid.flight.mass_t: must be a list"),
        ("[grid]\n'flight.mass_t' = []", "grid.flight.mass_t: must not be empty"),
        ("[grid]\n'flight.mass' = [200]", "mass_t"),
        ("[grid]\n'flight.mass_t' = [200, 9000]", "run 1: flight.mass_t = 9000"),
        ("[grid]\n'flight.mass_t' = [200]\n[draw]\n'flight.mass_t' = {low = 200, high = 300}", "drawn and in the grid"),
        ("[draw]\n'flight.mass_t' = {low = 300, high = 200}", "not below"),
        ("[draw]\n'flight.mass_t' = {lo = 300}", "draw.flight.mass_t.lo: unknown key; allowed: low, high,"),
        ("[draw]\n'flight.mass_t' = {low = 300}", "neither low and high"),
        ("[draw]\n'flight.mass_t' = {mean = 300}", "mean and sigma"),
        ("[draw]\n'flight.mass_t' = {low = 0, high = 200, scale = 'log'}", "no logarithm"),
        ("[draw]\n'flight.mass_t' = {low = nan, high = 200}", "draw.flight.mass_t.low: is out of range"),
        ("[draw]\n'flight.*' = {low = 1, high = 2}", "tolerances.aero.*"),
        ("[draw]\n'flight.mass_t' = {choice = []}", "draw.flight.mass_t.choice: must not be empty"),
        ("[[part]]\nnmae = 'x'", "Did you mean 'name'"),
    ],
)
def test_every_mistake_is_one_line_that_says_where_and_what(written, text, says):
    with pytest.raises(CosimError) as caught:
        load_campaign(written(text)).scenarios()
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_what_there_is_not_is_one_line(written, monkeypatch):
    grid = "".join(f"'tolerances.aero.{name}' = [{'1.0,' * 99}]\n" for name in list(toleranced("aero"))[:12])
    with pytest.raises(CosimError, match=rf"has {99**12} runs; allowed: 1 to"):  # beyond 2^63
        load_campaign(written(f"[grid]\n{grid}")).scenarios()
    with pytest.raises(CosimError, match="no built-in campaign and no file of this name"):
        load_campaign("nowhere.toml")
    monkeypatch.setattr("cosim.campaign.engine.CONNECT_S", 0.2)
    for there, says in ((True, "dask scheduler"), (False, r"cosim-fdi\[cluster\]")):
        if not there:
            monkeypatch.setitem(sys.modules, "distributed", None)
        with pytest.raises(CosimError, match=says), cluster("tcp://127.0.0.1:9"):
            pass


def test_distributions_are_what_they_are_called():
    u = unit_cube(2000, 1, sampling="latin_hypercube", seed=3)[:, 0]
    assert stats.kstest([Draw(**{"low": 2, "high": 4})(q) for q in u], stats.uniform(2, 2).cdf).pvalue > 0.1
    log = [Draw(**{"low": 0.1, "high": 10, "scale": "log"})(q) for q in u]
    assert stats.kstest(log, stats.loguniform(0.1, 10).cdf).pvalue > 0.1
    normal = [Draw(**{"mean": 1, "sigma": 2})(q) for q in u]
    assert stats.kstest(normal, stats.norm(1, 2).cdf).pvalue > 0.1
    cut = [Draw(**{"mean": 1, "sigma": 2, "low": 0, "high": 2})(q) for q in u]
    assert stats.kstest(cut, stats.truncnorm(-0.5, 0.5, 1, 2).cdf).pvalue > 0.1
    whole = [Draw(**{"low": 1, "high": 4, "integer": True})(q) for q in u]
    assert np.bincount(whole).tolist() == [0, 500, 500, 500, 500]
    assert [Draw(**{"choice": ["a", "b"]})(q) for q in (0.0, 0.49, 0.51, 0.999)] == ["a", "a", "b", "b"]


@functools.cache
def built_in(name):
    """Return a built-in campaign and its scenarios."""
    made = load_campaign(name)
    return made, made.scenarios()[0]


@pytest.mark.parametrize("name", builtin_names("campaign"))
def test_built_in_campaigns_keep_off_training_seeds_and_cover_the_envelope(name):
    made, scenarios = built_in(name)
    assert len(scenarios) == len(made) and made.title and not any(s.warnings() for s in scenarios)
    seeds = {s.seed for s in scenarios}
    assert min(seeds) >= EVALUATION_SEED and len(seeds) == len(scenarios)
    if name.startswith("fault-free"):  # detectors may judge from 8 to 9.5 s on: no manoeuvre begins before
        assert all(not s.faults for s in scenarios)
        assert all(s.manoeuvre.start_s >= 10.0 for s in scenarios if s.manoeuvre.kind != "cruise")
    if name != "benchmark-1":  # independent flights over the envelope, not the points of training
        assert len({(s.flight.mass_t, s.flight.cas_kt) for s in scenarios}) >= min(100, 0.9 * len(scenarios))
        assert min(s.flight.mass_t for s in scenarios) < 210 and max(s.flight.mass_t for s in scenarios) > 395


@pytest.mark.parametrize("name, technology", [("ema-faults", "ema"), ("hydraulic-faults", "hydraulic")])
def test_a_campaign_of_an_actuator_draws_every_kind_on_every_sensor_and_what_recurs(name, technology):
    flights = built_in(name)[1]
    drawn, healed = ({(f.parsed.sensor, f.kind) for s in flights for f in s.faults if f.end_s or not ends}
                     for ends in (False, True))  # fmt: skip
    kinds = {k for k, spec in c.ELEVATOR_KINDS.items() if technology in spec.technologies} - {"bias", "jam_liquid"}
    own = c.TECHNOLOGIES[technology].own_sensors
    whole = {(sensor, k) for sensor in own for k in c.SENSOR_KINDS if k != "dropout"}
    assert whole | {("", kind) for kind in kinds} <= drawn & healed
    assert max(len([f for f in s.faults if f.kind == s.faults[0].kind]) for s in flights if s.faults) >= 4
    assert any(len({f.start_s for f in s.faults}) < len(s.faults) for s in flights)  # two at once
    assert {f.shape for s in flights for f in s.faults} >= set(c.SHAPES[1:])


# -- the command ------------------------------------------------------------------------------------------------------


def cosim(*words):
    return CliRunner().invoke(cli.app, list(map(str, words)))


def test_command_flies_resumes_and_repeats_a_run(written, tmp_path):
    path = written(SMALL + "[grid]\n'faults.0.frequency_hz' = [1, 3]\n")
    out = tmp_path / "out"
    first = cosim("campaign", path, "-o", out, "--workers", 1, "--json")
    assert first.exit_code == 0, first.output
    found = json.loads(first.stdout)
    assert found == {"parquet": str(out / "runs.parquet"), "done": 2, "failed": 0, "resumed": 0, "errors": []}
    again = cosim("campaign", path, "-o", out)
    assert again.exit_code == 2 and "--resume" in again.stderr
    resumed = cosim("campaign", path, "-o", out, "--resume", "--json")
    assert json.loads(resumed.stdout)["resumed"] == 2
    table = cosim("campaign", path, "-o", out, "--resume")
    assert "iotsekf" in table.stdout and "2 were there already" in table.stdout
    run = pd.read_parquet(found["parquet"])["run"].iloc[-1]
    once = cosim("campaign", path, "-o", out, "--rerun", run, "--json")
    assert once.exit_code == 0, once.output
    assert json.loads(once.stdout)["repeats"] is True and (out / "logs" / f"{run}.mcap").is_file()
    frame = pd.read_parquet(found["parquet"])
    frame.assign(r_max_before=frame["r_max_before"] + 1e-9).to_parquet(found["parquet"])
    *_, repeats, same_code = rerun(path, run, out=out)
    assert repeats is False and same_code is True
    unknown = cosim("campaign", path, "-o", out, "--rerun", "abc")
    assert unknown.exit_code == 2 and "no run of this campaign" in unknown.stderr


BEYOND = """base = "cruise"
[set]
duration_s = 0.5
"detectors.enabled" = ["iotsekf"]
[grid]
point = [FLIGHTS]
"""
DRIVE = """{ "faults.0.target" = "elevator.right_inner", "faults.0.kind" = "ofc_liquid", "faults.0.at" = "valve",
"faults.0.start_s" = 0.1, "faults.0.frequency_hz" = 10, "faults.0.amplitude_mm" = 100 }"""
NO_TRIM = '{ "flight.mass_t" = 405, "flight.cas_kt" = 101 }'


@pytest.mark.parametrize(
    ("flights", "status", "told"),
    [
        (DRIVE.replace("\n", " "), 1, ("1 runs: 1 error", "1 x error: ScenarioError", "take")),
        (NO_TRIM, 1, ("1 runs: 1 infeasible", "1 x infeasible: ")),
        (NO_TRIM + ", { seed = 5 }", 0, ("2 runs: ", "1 x infeasible: ", "iotsekf")),
        (DRIVE.replace("\n", " ") + ", { seed = 5 }", 1, ("2 runs: ", "1 x error: ", "iotsekf")),
    ],
)
def test_runs_that_fail_are_told_and_decide_the_exit_status(flights, status, told, written, tmp_path, one_process):
    path = written(BEYOND.replace("FLIGHTS", flights))
    found = cosim("campaign", path, "-o", tmp_path / "out", "--workers", 1)
    assert found.exit_code == status, found.output
    for words in told:
        assert words in found.stdout
    again = cosim("campaign", path, "-o", tmp_path / "out", "--resume", "--json")
    assert again.exit_code == status and sum(e["runs"] for e in json.loads(again.stdout)["errors"]) == 1


def test_interrupted_campaign_keeps_its_rows_and_can_go_on(written, tmp_path):
    path, out = written("runs = 150\n" + SMALL), tmp_path / "out"
    words = [sys.executable, "-m", "cosim", "campaign", str(path), "-o", str(out), "--workers", "1"]
    process = subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=heeds_ctrl_c
    )
    deadline = time.monotonic() + 120
    while not list(out.glob("parts/runs-*")) and time.monotonic() < deadline:
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130 and "Traceback" not in err and "interrupted" in err, err
    parts = [pd.read_parquet(p) for p in out.glob("parts/runs-*")]
    assert 0 < pd.concat(parts)["run"].nunique() < 150


# -- the cluster ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def dask():
    """Two worker processes on loopback."""
    distributed = pytest.importorskip("distributed")
    from cosim.campaign.pool import THREADS

    os.environ.update(dict.fromkeys(THREADS, "1"))
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    ) as made:
        yield made


PAIRED = (
    "paired = true\nruns = 2\n"
    + SMALL
    + """[grid]
"faults.0.frequency_hz" = [1, 2, 3]
[draw]
"flight.mass_t" = { low = 200, high = 300 }
"""
)


def test_paired_points_of_a_grid_fly_the_same_draws_and_seeds(written):
    scenarios = list(load_campaign(written(PAIRED)).scenarios()[0])
    assert [s.seed - scenarios[0].seed for s in scenarios] == [0, 1] * 3
    assert [s.flight.mass_t for s in scenarios] == [s.flight.mass_t for s in scenarios[:2]] * 3
    assert scenarios[0].flight.mass_t != scenarios[1].flight.mass_t
    alone, _ = load_campaign(written(PAIRED.replace("true", "false"))).scenarios()
    assert len({(s.seed, s.flight.mass_t) for s in alone}) == 6


def test_a_dask_cluster_gives_the_same_rows_as_this_process_also_when_a_worker_is_killed(written, dask):
    scenarios, _ = load_campaign(written("runs = 8\n" + SMALL)).scenarios()
    killed = []

    def kill(done, total):
        if not killed:
            killed.append(next(iter(dask.workers.values())).pid)
            os.kill(killed[0], 9)

    with cluster(dask.scheduler_address) as (executor, threads):
        there = run_many(scenarios, executor=executor, workers=threads, progress=kill)
    assert killed and threads == 2
    pd.testing.assert_frame_equal(there.frame, run_many(scenarios, workers=0).frame)


def test_a_choice_can_be_the_rows_of_a_file_beside_the_campaign(written):
    path = written("runs = 4\n" + SMALL + "[draw]\npoint = { choice = 'p.csv' }\n")
    (path.parent / "p.csv").write_text("name,flight.mass_t,flight.turbulence\nlow,210,none\nhigh,300,light\n")
    scenarios, labels = load_campaign(path).scenarios()
    assert {(s.flight.mass_t, s.flight.turbulence) for s in scenarios} == {(210.0, "none"), (300.0, "light")}
    assert {label["point"] for label in labels} == {"low", "high"}
    (path.parent / "p.csv").unlink()
    with pytest.raises(CosimError, match="no CSV file"):
        load_campaign(path)
