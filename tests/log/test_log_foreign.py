"""Recordings of other people become tables over time, or one clear error."""

import json
import struct

import numpy as np
import pandas as pd
import pytest
import zstandard
from log_samples import TOPICS, expected, same_bits, write
from mcap.writer import CompressionType, Writer

from cosim.errors import LogError
from cosim.log import foxglove
from cosim.log.compression import FrameError, decompress
from cosim.replay.foreign import read_channels


@pytest.fixture
def table():
    t = np.arange(100) * 0.01
    return pd.DataFrame({"time": t, "alpha_deg": np.sin(t), "name": "x", "on": t > 0.5})


def test_csv_and_parquet_are_one_channel_with_a_time_index(tmp_path, table):
    table.to_csv(tmp_path / "flight.csv", index=False)
    table.to_parquet(tmp_path / "flight.parquet")
    for name in ("flight.csv", "flight.parquet"):
        frame = read_channels(tmp_path / name)["flight"]
        assert list(frame.columns) == ["alpha_deg", "on"] and frame.index.name == "t_s"
        assert same_bits(frame["alpha_deg"].to_numpy(), table["alpha_deg"].to_numpy())
        assert (frame.index == table["time"]).all() and frame["on"].sum() == 49


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("clock_ms", np.arange(100) * 10.0),
        ("t_ns", np.arange(100) * 10_000_000),
        ("when", pd.date_range("2026-01-01", periods=100, freq="10ms", tz="UTC")),
        ("when", pd.to_timedelta(np.arange(100) * 10, unit="ms")),
    ],
)
def test_time_columns_in_other_units_become_seconds(tmp_path, name, values):
    pd.DataFrame({"x": np.arange(100.0), name: values}).to_parquet(tmp_path / "a.parquet")
    frame = read_channels(tmp_path / "a.parquet", time=name)["a"]
    assert frame.index.to_numpy() == pytest.approx(np.arange(100) * 0.01)


def test_an_index_serves_as_time_and_rows_out_of_order_are_told(tmp_path):
    frame = pd.DataFrame({"x": [3.0, 1.0, 2.0]}, index=pd.Index([0.3, 0.1, 0.2], name="seconds"))
    frame.sort_index().to_parquet(tmp_path / "a.parquet")
    assert read_channels(tmp_path / "a.parquet")["a"]["x"].tolist() == [1.0, 2.0, 3.0]
    frame.to_parquet(tmp_path / "a.parquet")
    with pytest.raises(LogError, match=r"row 2: the clock goes back from 0\.3 to 0\.1 s"):
        read_channels(tmp_path / "a.parquet")


def test_what_cannot_be_read_is_named(tmp_path, table):
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "bad.parquet").write_bytes(b"no parquet")
    (tmp_path / "bad.mcap").write_bytes(b"no mcap")
    (tmp_path / "a.xlsx").write_bytes(b"")
    table.drop(columns="time").to_csv(tmp_path / "timeless.csv", index=False)
    (tmp_path / "gap.csv").write_text("t,x\n0,1\n,2\n")
    for name, word in {
        "empty.csv": "as csv", "bad.parquet": "as parquet", "bad.mcap": "MCAP", "a.xlsx": "unknown kind",
        "timeless.csv": "no time column", "gap.csv": "holds no time", "none.csv": "cannot read",
        "none.mcap": "cannot read",
    }.items():  # fmt: skip
        with pytest.raises(LogError, match=word) as error:
            read_channels(tmp_path / name)
        assert name in str(error.value)
    with pytest.raises(LogError, match="no time column clock"):
        read_channels(tmp_path / "gap.csv", time="clock")


@pytest.mark.parametrize("compression", list(CompressionType))
def test_mcap_of_another_writer_is_read_whatever_its_order(tmp_path, compression):
    epoch = 1_700_000_000_000_000_000
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file, chunk_size=500, compression=compression)
        writer.start()
        schema = writer.register_schema("imu", "jsonschema", b'{"type": "object"}')
        imu = writer.register_channel("/imu", "json", schema)
        schema = writer.register_schema("foxglove.LocationFix", "protobuf", foxglove.schema("LocationFix"))
        fix = writer.register_channel("/fix", "protobuf", schema)
        other = writer.register_channel("/raw", "cdr", 0)
        for i in [5, 4, 3, 2, 1, 0, *range(6, 40)]:
            at = epoch + i * 10_000_000
            data = {"gyro": {"x": i / 10, "list": [1, i]}, "ok": True, "name": "imu"}
            writer.add_message(imu, at, json.dumps(data).encode(), at)
            made = foxglove.message("LocationFix")(latitude=i, position_covariance=[i] * 9)
            writer.add_message(fix, at, made.SerializeToString(), at)
            writer.add_message(other, at, b"\0", at)
        writer.finish()
    read = read_channels(tmp_path / "a.mcap")
    assert set(read) == {"/imu", "/fix"}
    assert read["/imu"].index.to_numpy() == pytest.approx(np.arange(40) * 0.01)
    assert list(read["/imu"].columns) == ["gyro.x", "gyro.list[0]", "gyro.list[1]", "ok"]
    assert read["/imu"]["gyro.x"].tolist() == [i / 10 for i in range(40)]
    assert read["/fix"]["latitude"].tolist() == list(range(40))
    assert read["/fix"]["position_covariance[8]"].tolist() == list(range(40))


def test_our_own_log_read_as_a_foreign_one_gives_the_same_bits(tmp_path):
    from cosim.log.foreign import read_mcap

    v = write(tmp_path / "ours.mcap", pose=True)
    fast, slow = read_channels(tmp_path / "ours.mcap"), read_mcap(tmp_path / "ours.mcap")
    for topic in TOPICS:
        want = expected(v, topic)
        assert same_bits(fast[topic.name].to_numpy(), want)
        times, fields = slow[topic.channel]
        lane = "".join(f"{word}." for word in topic.name[len(topic.channel) :].split("/")[1:])
        assert times.tolist() == [5_000_000 * k for k in range(0, 230, topic.every)]
        assert same_bits(np.column_stack([fields[lane + f] for f in topic.fields]), want)


def test_a_foreign_bomb_is_refused(tmp_path):
    import lz4.frame
    import zstandard
    from mcap.data_stream import RecordBuilder
    from mcap.records import Chunk, DataEnd, Footer, Header

    pack = {"zstd": zstandard.compress, "lz4": lz4.frame.compress}
    for size, content, name in ((100, 64 << 20, "zstd"), (2**60, 1000, "zstd"), (100, 64 << 20, "lz4")):
        builder = RecordBuilder()
        Header("", "x").write(builder)
        Chunk(name, pack[name](bytes(content)), 0, 0, 0, size).write(builder)
        DataEnd(0).write(builder)
        Footer(0, 0, 0).write(builder)
        (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n" + builder.end() + b"\x89MCAP0\r\n")
        with pytest.raises(LogError, match=r"limits|not as long"):
            read_channels(tmp_path / "a.mcap")


def test_no_more_of_a_foreign_lz4_bomb_is_made_than_its_chunk_says():
    import tracemalloc

    import lz4.frame

    from cosim.log.compression import decompress

    bomb = lz4.frame.compress(bytes(256 << 20))
    tracemalloc.start()
    with pytest.raises(ValueError, match="not as long"):
        decompress(bomb, 100, "lz4", others=True)
    assert tracemalloc.get_traced_memory()[1] < 32 << 20
    tracemalloc.stop()
    assert decompress(lz4.frame.compress(b"abc"), 3, "lz4", others=True) == b"abc"


def test_mutated_foreign_files_are_refused_or_read_without_a_crash(tmp_path):
    with (tmp_path / "good").open("wb") as file:
        writer = Writer(file, chunk_size=300, enable_data_crcs=True)
        writer.start()
        channel = writer.register_channel("/a", "json", writer.register_schema("a", "jsonschema", b"{}"))
        for i in range(50):
            writer.add_message(channel, i, b'{"x": %d}' % i, i)
        writer.finish()
    data, rng, refused = (tmp_path / "good").read_bytes(), np.random.default_rng(0), 0
    for _ in range(300):
        bad = bytearray(data)
        at = int(rng.integers(0, len(bad) - 8))
        if rng.random() < 0.5:
            bad[at] ^= 1 << int(rng.integers(0, 8))
        else:
            struct.pack_into("<Q", bad, at, int(rng.integers(0, 2**63)))
        (tmp_path / "bad.mcap").write_bytes(bad[: None if rng.random() < 0.7 else at])
        try:
            read_channels(tmp_path / "bad.mcap")
        except LogError:
            refused += 1
    assert refused > 150


def test_an_empty_chunk_that_does_not_state_its_size_holds_nothing():
    frame = zstandard.ZstdCompressor(write_content_size=False).compressobj()
    empty = frame.compress(b"") + frame.flush()
    assert decompress(empty, 0, "zstd", others=True) == b""
    with pytest.raises(FrameError, match="not as long as"):
        decompress(empty, 1, "zstd", others=True)
