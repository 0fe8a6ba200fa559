"""`cosim replay` and `cosim recover`: exit status, tables, JSON and nothing else on standard output."""

import json
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from cosim.cli import commands as cli
from cosim.log import open_log

EXAMPLE = Path(__file__).parents[1] / "data" / "foreign_map.toml"


@pytest.fixture
def flight(short_log):
    return short_log


def call(*args):
    return CliRunner().invoke(cli.app, [str(a) for a in args])


def test_an_exact_replay_exits_with_0_and_says_how_much_it_compared(flight):
    done = call("replay", flight, "--detectors", "iotsekf,position_monitor", "--from", "2")
    assert done.exit_code == 0 and "exact: " in done.stdout and "values of" in done.stdout
    told = json.loads(call("replay", flight, "--json").stdout)
    assert told["exact"] and told["differences"] == [] and told["values"] > 100_000 and told["rows"] > 10_000


def test_a_what_if_exits_with_1_tells_both_outcomes_and_writes_both(flight, tmp_path):
    what_if = ("replay", flight, "--set", "position_monitor.threshold=0.01", "-o", tmp_path / "what.mcap")
    done = call(*what_if)
    assert done.exit_code == 1
    for word in ("/detectors/position_monitor/left_inner.r", "different: ", "as logged and as replayed", "what.mcap"):
        assert word in done.stdout.replace("\n", "")  # a long path is folded
    told = json.loads(call(*what_if, "--json").stdout)
    assert not told["exact"] and told["changed"] == {"position_monitor": {"threshold": 0.01}}
    assert {d["field"].split("/")[2] for d in told["differences"]} == {"position_monitor", "joint"}  # which reads it
    assert all({"field", "count", "first_tick", "max_abs"} <= set(d) for d in told["differences"])
    names = open_log(tmp_path / "what.mcap").topics
    assert {"/replay/detectors/position_monitor/left_inner", "/detectors/position_monitor/left_inner"} <= set(names)


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("--detectors", "iotsekff"), "Did you mean 'iotsekf'"),
        (("--detectors", ""), "no detector"),
        (("--set", "position_monitor.thresold=1"), "Did you mean 'threshold'"),
        (("--set", "threshold=1"), "detector.parameter=number"),
        (("--set", "position_monitor.threshold=much"), "detector.parameter=number"),
        (("--from", "100"), "the log ends before that time"),
        (("--from", "inf"), "inf is no time"),
        (("--from", "1e308"), "1e+308 is no time"),
        (("--from", "9e9"), "the log ends before that time"),
        (("--live", "--from", "inf"), "inf is no time"),
        (("--live", "--from", "1e308"), "1e+308 is no time"),
        (("--set", "position_monitor.threshold=1", "--detectors", "ofc_monitor"), "would change nothing"),
        (("--set", "position_monitor.threshold[0=1"), "no such parameter"),
        (("--set", "iotsekf.delay=1e7"), "is out of range"),
        (("--set", "iotsekf.lag_ticks=inf"), "is out of range"),
        (("--map", "none.toml"), "none.toml: there is no such file"),
    ],
)
def test_mistakes_exit_with_2_and_one_line(flight, args, words):
    done = call("replay", flight, *args)
    assert done.exit_code == 2 and done.stdout == "" and words in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_log_of_an_older_layout_says_so(flight, tmp_path, monkeypatch):
    from actuators.block import dtype
    from fdi.monitors import position_monitor as module

    kind = dtype([(n, "f8") for n in (*module.PARAMS.names, "later")])
    monkeypatch.setattr(module, "PARAMS", kind)
    done = call("replay", flight)
    assert done.exit_code == 2 and "--detectors" in done.stderr
    for word in ("position_monitor.params (later)", "another layout", "written by cosim"):
        assert word in done.stderr
    assert call("replay", flight, "--detectors", "ofc_monitor").exit_code == 0


def test_a_cut_log_is_recovered_and_what_is_lost_is_told(flight, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(flight.read_bytes()[: flight.stat().st_size // 2])
    assert call("replay", cut).exit_code == 2 and "cosim recover" in call("replay", cut).stderr
    assert "incomplete" in call("info", cut).stdout
    done = call("recover", cut)
    assert done.exit_code == 0 and "whole chunks" in done.stdout and "bytes at" in done.stdout
    assert call("replay", tmp_path / "cut.recovered.mcap").exit_code == 0
    told = json.loads(call("recover", cut, "-o", tmp_path / "b.mcap", "--json").stdout)
    size = open_log(flight).spans[0][1]
    assert told["ticks"] == size * told["chunks"] > 0 and told["lost"]
    assert call("recover", cut, "-o", cut).exit_code == 2


def test_a_log_cut_before_its_first_chunk_says_why_nothing_can_be_recovered(flight, tmp_path):
    (tmp_path / "cut.mcap").write_bytes(flight.read_bytes()[: open_log(flight).chunks[0].offset // 2])
    done = call("recover", tmp_path / "cut.mcap", "-o", tmp_path / "out.mcap")
    assert done.exit_code == 2 and "the log has no end" in done.stderr
    (tmp_path / "killed.mcap.flown.toml").write_text("")
    done = call("recover", tmp_path / "killed.mcap")
    assert done.exit_code == 2 and "`cosim run" in done.stderr and "killed.mcap.flown.toml" in done.stderr


def test_a_bad_chunk_in_the_middle_costs_its_own_ticks_and_a_restart(flight, tmp_path):
    data = bytearray(flight.read_bytes())
    chunk = open_log(flight).chunks[4]
    data[chunk.offset + 200] ^= 1
    (tmp_path / "bad.mcap").write_bytes(data)
    assert call("recover", tmp_path / "bad.mcap", "-o", tmp_path / "out.mcap").exit_code == 0
    told = json.loads(call("replay", tmp_path / "out.mcap", "--json").stdout)
    lanes = len(told["detectors"])
    left = open_log(flight).n_ticks - open_log(flight).spans[4][1]
    assert told["exact"] and told["rows"] + told["skipped"] == left * lanes
    assert 0 < told["skipped"] <= 201 * lanes  # up to and with the next whole state


def test_foreign_data_is_diagnosed(flight, tmp_path):
    log = open_log(flight)
    surface, law = log.frame("/sensors/left_inner"), log.frame("/law")
    frame = pd.DataFrame(
        {
            "clock_ms": 5.0 * log.ticks("/law"),
            "ELEV_CMD_DEG": -57.29577951308232 * law["de_cmd"].to_numpy(),
            "SURF_DEG": -57.29577951308232 * surface["surface"].to_numpy(),
        }
    )
    frame.to_csv(tmp_path / "bench.csv", index=False)
    lines = [
        line for line in EXAMPLE.read_text().splitlines() if " = { " not in line or "ELEV" in line or "SURF" in line
    ]
    (tmp_path / "map.toml").write_text("\n".join(lines))
    args = ("replay", tmp_path / "bench.csv", "--map", tmp_path / "map.toml", "-o", tmp_path / "out.mcap")
    done = call(*args)
    assert done.exit_code == 0 and "Verdicts" in done.stdout and "Not run" in done.stdout, done.stderr
    assert "left_inner.rod" in done.stdout
    told = json.loads(call(*args, "--json").stdout)
    assert [d["id"] for d in told["detectors"]] == ["position_monitor", "joint"]
    assert "/replay/detectors/position_monitor/left_inner" in open_log(tmp_path / "out.mcap").topics
