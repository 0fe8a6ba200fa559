"""Recordings of others: the same numbers from every kind of file, over a clock that is named, or one line."""

import os
import struct

import numpy as np
import pandas as pd
import pytest
from log_samples import MIB, TOPICS, bounded, expected, same_bits, write
from mcap.writer import CompressionType
from recordings import ZERO, write_json

from cosim.errors import LogError
from cosim.log import foxglove
from cosim.replay.foreign import columns_of, read_recording

N = 200
T = 0.005 * np.arange(N)
Q = np.sin(3.0 * T)
NS = [ZERO + 5_000_000 * k for k in range(N)]
DATES = pd.to_datetime(NS)
TEXTS = {
    "comma.csv": (",", "utf-8"), "mark.csv": (",", "utf-8-sig"), "semicolon.csv": (";", "utf-8"),
    "tab.tsv": ("\t", "utf-8"), "x-plane.txt": (" |", "utf-8"), "spaces.dat": (" ", "utf-8"),
}  # fmt: skip


def table(path, frame):
    frame.to_parquet(path) if path.suffix == ".parquet" else frame.to_csv(path, index=False)
    return path


def text(path, sep, encoding):
    """Write t and q, a name in the first row alone between them, each row ended by its separator where it is two."""
    rows = [
        ("t", "event", "q"),
        *((repr(t), "START" if t == 0.0 else "-", repr(q)) for t, q in zip(T.tolist(), Q.tolist())),
    ]
    path.write_text("\n".join(sep.join(row) + sep * (len(sep) > 1) for row in rows) + "\n", encoding)
    return path


@pytest.mark.parametrize("name", [*TEXTS, "a.parquet", "json.mcap", "protobuf.mcap", "cdr.mcap"])
def test_every_kind_of_file_gives_the_same_numbers(name, tmp_path):
    path, channel = tmp_path / name, "q"
    if name in TEXTS:
        text(path, *TEXTS[name])
    elif name == "a.parquet":
        table(path, pd.DataFrame({"t": T, "q": Q, "event": "START"}))
    else:
        channel = {"json": "/imu.rate[1].y", "protobuf": "/fix.latitude", "cdr": "/imu.angular_velocity.y"}[path.stem]
        globals()[path.stem](path)
    read = read_recording(path, [channel])
    (times,) = (read.times[where] for where, _ in read.channels.values())
    assert same_bits(read.channels[channel][1], Q) and times == pytest.approx(T, abs=1e-9) and not read.notes
    numbers, others = columns_of(path)
    assert channel in numbers and (others == ["event"] or name.endswith("mcap"))


def json(path):
    sent = [("/imu", at, {"rate": [{"x": 0}, {"y": q}], "name": "imu"}) for at, q in zip(NS, Q)]
    return write_json(path, [*sent[::-1], ("/rosout", ZERO, {"msg": "step"})], compression=CompressionType.LZ4)


def protobuf(path):
    from mcap_protobuf.writer import Writer

    kind = foxglove.TOPICS["/fix"]
    with path.open("wb") as file, Writer(file) as writer:
        for at, q in zip(NS, Q):
            writer.write_message("/fix", kind(latitude=q, position_covariance=[0.0] * 9), at, at)


def cdr(path):
    from mcap_ros2.writer import Writer

    text = "geometry_msgs/Vector3 angular_velocity\n" + "=" * 80
    text += "\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
    with path.open("wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef("sensor_msgs/Imu", text)
        for at, q in zip(NS, Q):
            message = {"angular_velocity": {"x": 0.0, "y": q, "z": 0.0}}
            writer.write_message("/imu", schema, message, log_time=at, publish_time=at)
        writer.finish()


@pytest.mark.parametrize(
    ("name", "values", "time", "said"),
    [
        ("clock_ms", 1e3 * T, "clock_ms", "clock_ms in ms"), ("t [us]", (1e6 * T).astype(int), None, "in us"),
        ("timestamp", np.array(NS) // 1000, "timestamp [us]", "timestamp in us"),
        ("when", DATES, "when", "when, zero at 2023-11-14T22:13:20.000"),
        ("when", DATES.tz_localize("UTC"), "when", "zero at 2023-11-14T22:13:20.000"),
        ("Time", DATES.astype(str), None, "Time, ISO 8601, zero at 2023-11-14T22:13:20.000"),
        ("t", pd.to_timedelta(5 * np.arange(N), unit="ms"), None, "t; 200 samples"),
    ],
)  # fmt: skip
def test_the_clock_of_a_table_is_one_column_in_its_unit(name, values, time, said, tmp_path):
    read = read_recording(table(tmp_path / "a.parquet", pd.DataFrame({"q": Q, name: values})), ["q"], time)
    (times,) = read.times.values()
    assert times - times[0] == pytest.approx(T, abs=1e-6) and said in read.clock
    assert "200 samples from" in read.clock and "step 5 ms" in read.clock and "0 missing" in read.clock


def iso(ns):
    return str(np.datetime64(ns, "ns"))


STAMPS = {
    **{f"{a} and {b}": lambda ns, a=a, b=b: {a: ns // 10**9, b: ns % 10**9}
       for a, b in (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanos"))},
    "seconds alone": lambda ns: ns / 1e9, "ISO 8601": iso,
}  # fmt: skip


@pytest.mark.parametrize("kind", [*STAMPS, "publish_time", "us"])
def test_the_clock_of_messages_is_the_one_that_is_named(kind, tmp_path):
    """A recorder that writes in bursts logs every message late, some at the same time."""
    late = [ZERO + -(-(at - ZERO) // 100_000_000) * 100_000_000 for at in NS]
    stamp = STAMPS.get(kind, lambda ns: ns / 1e3)
    messages = [("/imu", log, {"q": q, "head": {"t": stamp(at)}}) for at, log, q in zip(NS, late, Q)]
    true = iter(NS)
    path = write_json(tmp_path / "a.mcap", messages, lambda _: next(true))
    time = {"publish_time": "publish_time", "us": "head.t [us]"}.get(kind, "head.t")
    read = read_recording(path, ["/imu.q"], time)
    times = read.times["/imu"]
    assert times - times[0] == pytest.approx(T, abs=1e-6) and read.clock.startswith(time.split()[0])
    with pytest.raises(LogError, match=r"/imu, row 3: the time .* stands twice.*or name another clock"):
        read_recording(path, ["/imu.q"])
    with pytest.raises(LogError, match=r"a message has no time 'clock'; allowed: log_time, publish_time"):
        read_recording(path, ["/imu.q"], "clock")


def test_how_regular_the_clock_is_and_what_it_lacks_is_said(tmp_path):
    jitter = np.where(np.arange(N) % 2, 2e-5, 0.0)
    read = read_recording(
        table(tmp_path / "a.csv", pd.DataFrame({"t": T + jitter, "q": Q}).drop(index=[7, 90, 91])), ["q"]
    )
    assert "197 samples from 0 to 0.99502 s, step 5.02 ms ± 0.019999 ms, 3 missing" in read.clock


def frame(**columns):
    return pd.DataFrame({"t": T, "q": Q} | columns)


def longer(path):
    path.write_text("t,q\n0,1\n")
    os.truncate(path, 5 << 30)  # sparse


TOLD = {  # file, what is written to it, and what is said
    "a folder": ("a.csv", os.mkdir, r"is a folder; allowed: one file: .*Convert to Parquet: one row per time"),
    "MATLAB": ("a.mat", lambda p: p.write_bytes(b"MATLAB 5.0"), "unknown kind of file '.mat'; .*Convert to Parquet"),
    "nothing": ("a.csv", None, "cannot read the file: No such file"),
    "empty": ("a.csv", lambda p: p.write_text(""), "cannot be read: it is empty"),
    "5 GB": ("a.csv", longer, r"has 5.37 GB; allowed: 1 GB. Cut it"),
    "no Parquet": ("a.parquet", lambda p: p.write_bytes(b"PAR1" * 9), "cannot be read: .*Parquet"),
    "no MCAP": ("a.mcap", lambda p: p.write_bytes(b"no such thing, however long"), "not a readable MCAP file"),
    "a word": ("a.mcap", lambda p: p.write_bytes(b"no such"), "not a readable MCAP file"),
    "no clock": ("a.csv", lambda p: table(p, frame(t=None).rename(columns={"t": "x"})), "no column may be its clock"),
    "two clocks": ("a.csv", lambda p: table(p, frame(time_s=T)), "2 columns may be its clock; allowed: t, time_s"),
    "a time twice": ("a.csv", lambda p: table(p, frame(t=T - 0.005 * (T > 0.5))), "row 102: the time 0.5 s stands"),
    "a clock that restarts": ("a.csv", lambda p: table(p, frame(t=T % 0.5)), "row 101: the clock goes back from"),
    "one time": ("a.csv", lambda p: table(p, frame(t=1.0)), "the clock holds a single time"),
    "no row": ("a.csv", lambda p: p.write_text("t,q\n"), "holds no row"),
    "no time": ("a.csv", lambda p: table(p, frame(t=[*T[:6], np.nan, *T[7:]])), "row 7: t holds no time"),
    "a word among times": ("a.csv", lambda p: table(p, frame(t=[*T[:6], "later", *T[7:]])), "row 7: t holds .*'later'"),
    "another date": ("a.csv", lambda p: table(p, frame(t="2018/07/18/15:58:47.1")), r"row 1: t holds no time \(200 s"),
    "another unit": ("a.csv", lambda p: table(p, frame(t=1e3 * T)), r"5 s apart; allowed: below 1 s.*NAME \[us\]"),
    "a text": ("a.csv", lambda p: table(p, frame(q=["1", "", "oops", *Q[3:]])), "no number: 'oops' in row 3"),
    "decimal commas": ("a.csv", lambda p: p.write_text("t;q\n0;0,1\n.1;0,2\n"), "'q' holds '0,1': a comma is no"),
    "a cell too few": ("a.csv", lambda p: p.write_text("t,x,q\n0,,1\n1,2\n2,3,4\n"), "line 3: has 2 cells; allowed: 3"),
    "a cell too many": ("a.csv", lambda p: p.write_text("t,q\n0,1,\n1,2,3\n"), "line 3: has 3 cells; allowed: 2"),
    "texts": ("a.parquet", lambda p: table(p, frame(q="x")), "column 'q' holds something that is no number: 'x'"),
    "another name": ("a.csv", lambda p: table(p, frame().rename(columns={"q": "q_"})), "has no column 'q'.*mean 'q_'"),
    "a name twice": ("a.csv", lambda p: p.write_text("t,q,q\n0,1,2\n"), "has more than one column 'q'"),
    "Latin letters": ("a.csv", lambda p: p.write_bytes("t,q,größer\n".encode("cp1252")), "cannot be read: .*utf-8"),
}  # fmt: skip


@pytest.mark.parametrize("case", TOLD)
def test_what_is_not_taken_is_one_line_with_its_place(case, tmp_path):
    name, made, told = TOLD[case]
    if made:
        made(tmp_path / name)
    with pytest.raises(LogError, match=told) as error, bounded(seconds=10, memory=50 * MIB):
        read_recording(tmp_path / name, ["q"])
    assert str(error.value).startswith(str(tmp_path / name)) and "\n" not in str(error.value)


def two_sources(late, first=0):
    """Return messages of two channels on one topic, those of the second `late` [ns] from number `first` on."""
    own = [("/act A", at, {"q": q}) for at, q in zip(NS, Q)]
    return [*own, *(("/act B", at + late, {"q": 1 + q}) for at, q in list(zip(NS, Q))[first:])]


def test_two_sources_on_one_topic_are_refused_unless_one_follows_the_other(tmp_path):
    for late in (0, 2_500_000):
        with pytest.raises(LogError, match="/act: 2 channels share the topic and overlap in time; allowed: one source"):
            read_recording(write_json(tmp_path / "a.mcap", two_sources(late)), ["/act.q"])
    read = read_recording(write_json(tmp_path / "a.mcap", two_sources(NS[-1] - NS[0] + 5_000_000)), ["/act.q"])
    assert len(read.times["/act"]) == 2 * N


def test_what_no_message_holds_is_told_with_the_topics_that_have_no_number(tmp_path):
    path = write_json(tmp_path / "a.mcap", [*two_sources(0)[:N], ("/rosout", ZERO, {"msg": "step"})])
    with pytest.raises(LogError, match=r"holds a number 'q'; .*: /act.q; topics without numbers: /rosout.*'/act.q'"):
        read_recording(path, ["q"])
    with pytest.raises(LogError, match=r"no number: 'step'"):
        read_recording(path, ["/rosout.msg"])
    path = write_json(tmp_path / "b.mcap", two_sources(0)[:N], use_chunking=False, enable_data_crcs=False)
    path.write_bytes(path.read_bytes().replace(b"\x04\0\0\0json", b"\x04\0\0\0yaml"))
    with pytest.raises(LogError, match="the messages of /act are yaml; allowed: protobuf, json, cdr of ROS 2"):
        read_recording(path, ["/act.q"])


def test_only_what_is_named_is_decoded(tmp_path):
    big = [("/big", at, list(range(300_000))) for at in NS[:8]]
    path = write_json(tmp_path / "a.mcap", [*two_sources(0)[:N], *big], compression=CompressionType.ZSTD)
    with bounded(seconds=10, memory=100 * MIB):
        assert same_bits(read_recording(path, ["/act.q"]).channels["/act.q"][1], Q)
        with pytest.raises(LogError, match=r"a message of \d+ bytes"):
            read_recording(path, ["/big.[3]"])
    wide = {f"engine_bay_temperature_{k}": np.zeros(N) for k in range(20_000)}
    path = table(tmp_path / "wide.parquet", pd.DataFrame({"t": T, **wide, "q": Q}))
    with bounded(seconds=10, memory=100 * MIB):
        assert same_bits(read_recording(path, ["q"]).channels["q"][1], Q)


@pytest.mark.parametrize("how", [{"use_chunking": False}, {"chunk_size": 2000, "compression": CompressionType.ZSTD}])
def test_a_cut_file_is_read_up_to_its_cut(how, tmp_path):
    raw = write_json(tmp_path / "a.mcap", two_sources(0)[:N], **how).read_bytes()
    end = raw.index(b"\x0f\x04\0\0\0\0\0\0\0")  # where the data end
    (tmp_path / "a.mcap").write_bytes(raw[: end * 3 // 4])
    read = read_recording(tmp_path / "a.mcap", ["/act.q"])
    left = len(read.times["/act"])
    assert 50 < left < N and same_bits(read.channels["/act.q"][1], Q[:left]) and "the file is cut" in read.notes[0]


def test_the_last_line_of_a_cut_text_is_left_out(tmp_path):
    path = table(tmp_path / "a.csv", frame())
    path.write_bytes(path.read_bytes()[:-9])
    read = read_recording(path, ["q"])
    assert same_bits(read.channels["q"][1], Q[:-1]) and read.notes[0].startswith(
        "the file is cut: its last line, row 200"
    )


def test_our_own_log_read_as_a_strangers_gives_the_same_bits(tmp_path):
    v = write(tmp_path / "ours.mcap", pose=True)
    names = {}
    for topic in TOPICS:
        lane = "".join(f"{word}." for word in topic.name[len(topic.channel) :].split("/")[1:])
        names |= {f"{topic.channel}.{lane}{f}": (topic, j) for j, f in enumerate(topic.fields)}
    read = read_recording(tmp_path / "ours.mcap", list(names))
    for name, (topic, j) in names.items():
        where, y = read.channels[name]
        assert same_bits(y, expected(v, topic)[:, j])
        assert (read.times[where] * 200.0).round().tolist() == list(range(0, 230, topic.every))


def test_mutated_files_are_read_or_refused_in_a_line(tmp_path):
    path = tmp_path / "a.mcap"
    good = write_json(path, two_sources(0)[:N], chunk_size=300, enable_data_crcs=True).read_bytes()
    rng, refused = np.random.default_rng(0), 0
    for _ in range(300):
        bad, at = bytearray(good), int(rng.integers(0, len(good) - 8))
        if rng.random() < 0.5:
            bad[at] ^= 1 << int(rng.integers(0, 8))
        else:
            struct.pack_into("<Q", bad, at, int(rng.integers(0, 2**63)))
        path.write_bytes(bad[: None if rng.random() < 0.7 else at])
        try:
            read = read_recording(path, ["/act.q"])
            assert read.notes or same_bits(read.channels["/act.q"][1], Q)
        except LogError as error:
            assert "\n" not in str(error)
            refused += 1
    assert refused > 150
