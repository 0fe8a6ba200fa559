"""The clock of a recording: what is no time or goes back is told with its row, and gaps before any verdict."""

import json
import struct
import zlib

import numpy as np
import pandas as pd
import pytest
from flight_point import POINT
from hypothesis import given
from hypothesis import strategies as st
from log_samples import MIB, bounded
from mcap.writer import CompressionType, Writer
from typer.testing import CliRunner

from cosim.cli.commands import app
from cosim.errors import LogError
from cosim.log.foreign import read_mcap
from cosim.replay import clock
from cosim.replay.foreign import read_channels

MAP = (
    f"rate_hz = 200\n{POINT}"
    + """[signals]
de_cmd = { channel = "cmd", unit = "deg" }
"left_inner.surface" = { channel = "surf", unit = "deg" }
"""
)


def recording(path, t, **columns):
    """Write a CSV of a still elevator at times `t`."""
    frame = pd.DataFrame({"t_s": t, "cmd": np.zeros(len(t)), "surf": np.zeros(len(t)), **columns})
    frame.to_csv(path, index=False)
    return path


def replay(path, tmp_path, *args):
    (tmp_path / "map.toml").write_text(MAP)
    return CliRunner().invoke(app, ["replay", str(path), "--map", str(tmp_path / "map.toml"), *args])


@pytest.mark.parametrize("bad", ["", "nan", "inf", "-inf", "yesterday"])
def test_a_row_without_a_time_is_named(bad, tmp_path):
    path = recording(tmp_path / "a.csv", np.arange(0, 5, 0.005))
    lines = path.read_text().splitlines()
    lines[700] = f"{bad},0,0"
    path.write_text("\n".join(lines))
    told = replay(path, tmp_path)
    assert told.exit_code == 2 and "a.csv, row 700: " in told.stderr and told.stderr.count("\n") == 1


def test_nat_in_a_parquet_is_named(tmp_path):
    t = pd.date_range("2026-01-01", periods=100, freq="5ms").to_series().reset_index(drop=True)
    t[7] = pd.NaT
    pd.DataFrame({"time": t, "cmd": 0.0}).to_parquet(tmp_path / "a.parquet")
    with pytest.raises(LogError, match="row 8: column 'time' holds no time"):
        read_channels(tmp_path / "a.parquet")


@pytest.mark.parametrize("kind", ["float64", "datetime64[ns]", "datetime64[ns, UTC]", "timedelta64[ns]"])
def test_a_table_without_rows_is_told_whatever_its_clock(kind, tmp_path):
    empty = pd.DataFrame({"time": pd.Series([], dtype=kind), "cmd": pd.Series([], dtype=float)})
    empty.to_parquet(tmp_path / "a.parquet")
    with pytest.raises(LogError, match="holds no row"):
        read_channels(tmp_path / "a.parquet")


def test_a_clock_that_restarts_is_an_error_with_both_values_until_said_otherwise(tmp_path):
    t = np.arange(0, 5, 0.005)
    path = recording(tmp_path / "a.csv", np.concatenate([t, t + 0.1]))
    told = replay(path, tmp_path)
    assert told.exit_code == 2 and "row 1001: the clock goes back from 4.995 to 0.1 s" in told.stderr
    assert "--on-reset split" in told.stderr and told.stderr.count("\n") == 1
    joined = json.loads(replay(path, tmp_path, "--on-reset", "offset", "--json").stdout)
    assert joined["duration_s"] == pytest.approx(10.0)
    assert joined["caveats"][0] == "row 1001: the clock goes back from 4.995 to 0.1 s, it is carried on"
    apart = json.loads(replay(path, tmp_path, "--on-reset", "split", "--json").stdout)["stretches"]
    assert [d["start_s"] for d in apart] == [0.0, 0.1] and {round(d["duration_s"], 2) for d in apart} == {5.0}
    assert [d["caveats"][0] for d in apart] == ["stretch 1 of 2, rows 1 to 1000", "stretch 2 of 2, rows 1001 to 2000"]


def test_gaps_doubled_times_and_rates_stand_before_the_verdicts(tmp_path):
    t = np.concatenate([np.arange(0, 5, 0.005), np.arange(7, 12, 0.005), np.arange(12, 20, 0.01)])
    t[500] = t[499]
    path = recording(tmp_path / "a.csv", t)
    said = " ".join(json.loads(replay(path, tmp_path, "--json").stdout)["caveats"])
    shown = replay(path, tmp_path).stdout
    assert shown.index("no sample from") < shown.index("Verdicts")
    assert "no sample from 4.995 to 7 s" in said and "1 times stand twice" in said
    assert "rate changes from 200 to 100 Hz" in said


def test_semicolons_and_decimal_commas_are_read(tmp_path):
    t = np.arange(0, 3, 0.005)
    plain = recording(tmp_path / "a.csv", t, surf=np.sin(t))
    comma = tmp_path / "b.csv"
    pd.read_csv(plain).to_csv(comma, sep=";", decimal=",", index=False)
    a, b = (read_channels(p)[p.stem] for p in (plain, comma))
    np.testing.assert_allclose(b, a, rtol=1e-12, atol=1e-15)  # versions of pandas round a decimal comma differently
    np.testing.assert_allclose(b.index, a.index, rtol=1e-12)


@given(st.lists(st.lists(st.floats(0, 1e6), min_size=1, max_size=20), min_size=1, max_size=5))
def test_joined_times_rise_and_keep_their_distances(stretches):
    t = np.concatenate([np.sort(s) for s in stretches])
    made, rows, _ = clock.rising(t, "x", "offset")
    assert rows == slice(0, len(t)) and np.all(np.diff(made) >= 0.0)
    for part in clock.stretches(t):
        assert np.diff(made[part]) == pytest.approx(np.diff(t[part]), abs=1e-6)


def big(path, messages):
    """Write an MCAP of others' JSON messages, compressed."""
    with path.open("wb") as file:
        w = Writer(file, compression=CompressionType.ZSTD, chunk_size=8 << 20)
        w.start()
        schema = w.register_schema(name="x", encoding="jsonschema", data=b"{}")
        ids = {n: w.register_channel(topic=n, message_encoding="json", schema_id=schema) for n in ("/a", "/b")}
        for k, (topic, data) in enumerate(messages):
            w.add_message(channel_id=ids[topic], log_time=k * 1000, publish_time=k * 1000, data=data)
        w.finish()
    return path


def test_megabytes_of_json_in_a_small_file_are_refused_and_what_is_not_mapped_is_not_decoded(tmp_path):
    huge = json.dumps(list(range(1_000_000))).encode()
    path = big(tmp_path / "bomb.mcap", [("/a", b'{"x": 1}'), *(("/b", huge) for _ in range(8))])
    with bounded(seconds=10, memory=300 * MIB):
        with pytest.raises(LogError, match=r"message of \d+ bytes is beyond"):
            read_mcap(path)
        assert list(read_mcap(path, wanted=lambda topic: topic == "/a")) == ["/a"]


@pytest.mark.slow
def test_two_million_messages_are_read_in_seconds(tmp_path):
    path = big(tmp_path / "many.mcap", ((("/a" if k % 20 == 0 else "/b"), b'{"x": %d}' % k) for k in range(2_000_000)))
    with bounded(seconds=120, memory=200 * MIB):  # some 4 s on a quiet core, tracing apart
        times, fields = read_mcap(path, wanted=lambda topic: topic == "/a")["/a"]
    assert len(times) == 100_000 and fields["x"][1] == 20.0


def test_a_chunk_of_another_writer_with_a_wrong_checksum_is_refused(tmp_path):
    path = big(tmp_path / "a.mcap", [("/a", b'{"x": 1}')] * 10)
    data = bytearray(path.read_bytes())
    at = data.index(b"\x28\xb5\x2f\xfd")  # the zstd frame; the chunk's checksum stands before its compression's name
    (crc,) = struct.unpack_from("<I", data, at - 20)
    assert crc != zlib.crc32(b"")
    struct.pack_into("<I", data, at - 20, crc ^ 1)
    path.write_bytes(data)
    with pytest.raises(LogError, match="CRC"):
        read_mcap(path)
