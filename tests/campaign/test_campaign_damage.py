"""A damaged campaign folder: what is whole is used, what is not is named and flown again, nothing is a traceback."""

import os
import shutil

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from campaign_texts import two_flights
from typer.testing import CliRunner

from cosim.campaign.run import run_campaign
from cosim.cli.commands import app
from cosim.errors import CosimError


def cosim(*args):
    return CliRunner().invoke(app, [str(a) for a in args])


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    home = tmp_path_factory.mktemp("campaign")
    (home / "few.toml").write_text(two_flights())
    assert run_campaign(home / "few.toml", out=home / "out", workers=0).done == 2
    return home


def _cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _drop(path):
    pq.write_table(pq.read_table(path).drop_columns(["run"]), path)


def _rows(out):
    return pq.read_metadata(out / "runs.parquet").num_rows


def _set(path, name, values):
    table = pq.read_table(path)
    pq.write_table(table.set_column(table.column_names.index(name), name, values), path)


def _bytes(path):
    """Let its texts hold bytes that are no text."""
    table = pq.read_table(path)
    bad = pa.Array.from_buffers(pa.string(), 1, pa.array([b"\xff\xfe"]).buffers())
    _set(path, "status", pa.chunked_array([bad] * table.num_rows))


DAMAGE = {
    "campaign.json empty": lambda out: (out / "campaign.json").write_text(""),
    "campaign.json null": lambda out: (out / "campaign.json").write_text("null"),
    "a part cut": lambda out: [_cut(p) for p in (out / "parts").glob("rows-*")],
    "a timing cut": lambda out: [_cut(p) for p in (out / "parts").glob("timing-*")],
    "a part without its runs": lambda out: [_drop(p) for p in (out / "parts").glob("rows-*")],
    "runs cut": lambda out: _cut(out / "runs.parquet"),
    "runs without a column": lambda out: _drop(out / "runs.parquet"),
    "runs empty": lambda out: (out / "runs.parquet").write_bytes(b""),
    "scenarios cut": lambda out: _cut(out / "scenarios.parquet"),
    "timing cut": lambda out: _cut(out / "timing.parquet"),
    "runs of another kind": lambda out: _set(out / "runs.parquet", "r_max_before", pa.array(["x"] * _rows(out))),
    "runs of nobody": lambda out: _set(out / "runs.parquet", "run", pa.array(["nobody"] * _rows(out))),
    "runs not UTF-8": lambda out: _bytes(out / "runs.parquet"),
    "scenarios of numbers": lambda out: _set(out / "scenarios.parquet", "toml", pa.array([1.0, None])),
    "runs a folder": lambda out: [(out / "runs.parquet").unlink(), (out / "runs.parquet").mkdir()],
    "a part a pipe": lambda out: os.mkfifo(out / "parts" / "rows-0000.parquet"),
    "guests of nonsense": lambda out: (out / "guests.json").write_text('[{"guest": {}}]'),
    "all gone but the parts": lambda out: [p.unlink() for p in out.glob("*.parquet")],
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_named_and_mended_by_resuming(name, flown, tmp_path):
    whole = pd.read_parquet(flown / "out" / "runs.parquet")
    shutil.copytree(flown / "out", tmp_path / "out")
    DAMAGE[name](tmp_path / "out")
    seen = cosim("compare", tmp_path / "out", "-o", tmp_path / "page", "--json")
    assert seen.exit_code in (0, 2) and not isinstance(seen.exception, Exception), seen.exception
    assert seen.exit_code == 0 or seen.stderr.count("\n") == 1
    if "json" in name:  # nothing says what code its rows are of
        with pytest.raises(CosimError, match=r"campaign|other code"):
            run_campaign(flown / "few.toml", out=tmp_path / "out", workers=0, resume=True)
        return
    if name == "runs a folder":  # not ours to remove
        with pytest.raises(CosimError, match="is a folder"):
            run_campaign(flown / "few.toml", out=tmp_path / "out", workers=0, resume=True)
        return
    again = run_campaign(flown / "few.toml", out=tmp_path / "out", workers=0, resume=True)
    assert again.failed == 0 and bool(again.damaged) == name.startswith("a part")
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "out" / "runs.parquet"), whole)


def test_an_edited_campaign_says_which_rows_it_leaves_out(flown, tmp_path):
    out, edited = shutil.copytree(flown / "out", tmp_path / "out"), tmp_path / "few.toml"
    before = pd.read_parquet(out / "runs.parquet")
    edited.write_text(two_flights(0.6))
    told = cosim("campaign", edited, "-o", out, "--resume", "--workers", 1)
    left = set(before["run"]) - set(pd.read_parquet(out / "runs.parquet")["run"])
    rows = int(before["run"].isin(left).sum())
    assert told.exit_code == 0 and len(left) == 2
    assert f"note: {rows} rows of 2 runs of an earlier version of this campaign left out of {out}" in told.stderr
    assert f"they stay in {out / 'parts'}" in told.stderr
    kept = pd.concat(pd.read_parquet(p) for p in (out / "parts").glob("rows-*.parquet"))
    assert left <= set(kept["run"])
    again = cosim("campaign", flown / "few.toml", "-o", out, "--resume", "--workers", 1)
    assert again.exit_code == 0 and set(pd.read_parquet(out / "runs.parquet")["run"]) == set(before["run"])


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("sim_time_s", 0.0, "sim_time_s = 0 of position_monitor in run"),
        ("sim_time_s", -1.0, "is impossible; allowed: above 0"),
        ("sim_time_s", float("inf"), "sim_time_s = inf"),
        ("sim_time_s", None, "sim_time_s = nan"),
        ("false_alarms", -5, "false_alarms = -5 of position_monitor in run"),
        ("false_alarms", None, "false_alarms = nan"),
        ("standing_s", -1.0, "standing_s = -1"),
        ("delay_s", -1.0, "delay_s = -1"),
        ("fault", 99, "fault = 99 of position_monitor in run"),
        ("fault", -1, "fault = -1 of position_monitor in run"),
        ("level", "[/x]", "level = [/x] of position_monitor"),
        ("concerned", None, "concerned = None"),
    ],
)
def test_a_row_that_no_flight_has_is_named(name, value, told, flown, tmp_path):
    out = shutil.copytree(flown / "out", tmp_path / "out")
    kind = pq.read_table(out / "runs.parquet").schema.field(name).type
    _set(out / "runs.parquet", name, pa.array([value] * _rows(out), kind))
    seen = cosim("compare", out, "-o", tmp_path / "page")
    assert seen.exit_code == 2 and told in seen.stderr and seen.stderr.count("\n") == 1, seen.stderr
    assert seen.stderr.startswith(f"error: {out}: ")


def test_a_detector_of_any_name_is_shown_by_it(flown, tmp_path):
    out = shutil.copytree(flown / "out", tmp_path / "out")
    _set(out / "runs.parquet", "id", pa.array(["[/x]"] * _rows(out)))
    seen = cosim("compare", out, "-o", tmp_path / "page")
    assert seen.exit_code == 0 and "[/x]" in seen.stdout
