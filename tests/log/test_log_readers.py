"""Readers that are not ours read our logs, with every checksum on, and see the same numbers."""

import json
import shutil
import struct
import subprocess
import sys

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, json_format
from log_samples import TOPICS, Records, expected, same_bits, write
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

from cosim.log import LogWriter, Topic, foxglove, open_log, recover
from cosim.log.layout import schema_data


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("readers") / "flight.mcap"
    return path, write(path, pose=True)


def values_of(proto, topic):
    """Return the values of a part in the message of its channel, decoded by another's code."""
    for word in topic.name[len(topic.channel) :].split("/")[1:]:
        proto = getattr(proto, word)
    names = (field.rstrip("]").partition("[") for field in topic.fields)
    return [getattr(proto, name)[int(i)] if bracket else getattr(proto, name) for name, bracket, i in names]


@pytest.mark.parametrize("reader", [SeekingReader, NonSeekingReader])
def test_the_mcap_package_decodes_every_message(log, reader):
    path, v = log
    got = {topic.name: [] for topic in TOPICS}
    texts = []
    with path.open("rb") as file:
        decoded = reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        last = 0
        for _, channel, message, proto in decoded:
            assert message.log_time == message.publish_time == message.sequence * 5_000_000 >= last
            last = message.log_time
            for topic in (t for t in TOPICS if t.channel == channel.topic):
                got[topic.name].append((message.sequence, values_of(proto, topic)))
            if channel.topic == "/events":
                texts.append({m.key: m.value for m in proto.metadata})
    for topic in TOPICS:
        ticks, values = zip(*got[topic.name])
        assert list(ticks) == list(range(0, 230, topic.every))
        assert same_bits(np.array(values), expected(v, topic))
    assert texts == [{"kind": "jam", "target": "elevator.left_inner"}]


def test_every_record_passes_the_packages_own_checks(log):
    path, _ = log
    with path.open("rb") as file:
        kinds = [type(r).__name__ for r in StreamReader(file, validate_crcs=True).records]
    assert kinds[0] == "Header" and kinds[-1] == "Footer" and kinds.count("Statistics") == 1
    with path.open("rb") as file:
        summary = SeekingReader(file).get_summary()
    statistics, ours = summary.statistics, open_log(path)
    assert statistics.message_start_time == 0 and statistics.message_end_time == 229 * 5_000_000
    counts = {summary.channels[c].topic: n for c, n in statistics.channel_message_counts.items()}
    assert {t.channel: counts[t.channel] for t in TOPICS} == {t.channel: t.rows for t in ours.topics.values()}
    assert set(foxglove.TOPICS) <= {c.topic for c in summary.channels.values()}
    assert [a.name for a in summary.attachment_indexes] == ["scenario.toml", "empty.bin"]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # newer versions of the package name the two limits otherwise
def test_one_topic_and_a_span_of_time_can_be_sought(log):
    with log[0].open("rb") as file:
        found = list(
            SeekingReader(file, validate_crcs=True).iter_messages(
                topics=["/actuators"], start_time=500_000_000, end_time=600_000_000
            )
        )
    assert [m.sequence for _, _, m in found] == list(range(100, 120))


def test_of_no_field_there_are_rows_without_columns(log):
    own = open_log(log[0])
    topic = next(t for t in own.topics.values() if t.every == 1)
    assert own.array(topic.name, fields=[]).shape == own.frame(topic.name, fields=[]).shape == (topic.rows, 0)


def test_the_aircraft_stands_where_its_coordinates_say(log):
    path, v = log
    poses, fixes = open_log(path).messages("/tf"), open_log(path).messages("/fix")
    assert [k for k, _ in poses] == [k for k, _ in fixes] == list(range(0, 230, 20))
    frame = json_format.MessageToDict(poses[0][1])["transforms"][0]
    assert frame["parentFrameId"] == "map" and frame["childFrameId"] == "aircraft"
    assert poses[3][1].transforms[0].translation.z == v[60, 2]
    assert fixes[3][1].latitude == pytest.approx(np.degrees(v[60, 0]))


@pytest.mark.parametrize(
    ("phi", "theta", "psi", "axis", "want"),
    [
        (0, 0, 0, (1, 0, 0), (0, 1, 0)),  # heading north: forward is north (ENU y)
        (0, 0, np.pi / 2, (1, 0, 0), (1, 0, 0)),  # heading east: forward is east
        (0, np.pi / 4, 0, (1, 0, 0), (0, 0.5**0.5, 0.5**0.5)),  # nose up: forward points up
        (np.pi / 4, 0, 0, (0, 1, 0), (-(0.5**0.5), 0, 0.5**0.5)),  # right wing down: left points up
    ],
)
def test_the_viewers_attitude_has_the_right_signs(phi, theta, psi, axis, want):
    x, y, z, w = foxglove._quaternion(phi, -theta, np.pi / 2 - psi)
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    assert rotation @ axis == pytest.approx(want, abs=1e-12)


NODE = """
const { McapIndexedReader, McapStreamReader } = require("@mcap/core");
const { open } = require("node:fs/promises");
const fs = require("node:fs");
const zstd = require("@mcap/support");
(async () => {
  const decompressHandlers = await zstd.loadDecompressHandlers();
  const handle = await open(process.argv[1]);
  const readable = {
    size: async () => BigInt((await handle.stat()).size),
    read: async (offset, length) => {
      const buffer = Buffer.alloc(Number(length));
      await handle.read(buffer, 0, Number(length), Number(offset));
      return buffer;
    },
  };
  const indexed = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const counts = {};
  let last = -1n;
  for await (const m of indexed.readMessages({ validateCrcs: true })) {
    if (m.logTime < last) throw new Error("out of order");
    last = m.logTime;
    const topic = indexed.channelsById.get(m.channelId).topic;
    counts[topic] = (counts[topic] ?? 0) + 1;
  }
  const stream = new McapStreamReader({ validateCrcs: true, decompressHandlers });
  stream.append(fs.readFileSync(process.argv[1]));
  while (stream.nextRecord()) {}
  console.log(JSON.stringify({ counts, done: stream.done() }));
})();
"""


def test_the_node_reader_accepts_a_log(log):
    node = shutil.which("node")
    if node is None or subprocess.run([node, "-e", "require('@mcap/core');require('@mcap/support')"]).returncode:
        pytest.skip("npm packages @mcap/core and @mcap/support are not installed (set NODE_PATH to their folder)")
    told = subprocess.run([node, "-e", NODE, str(log[0])], capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    answer = json.loads(told.stdout)
    ours = open_log(log[0])
    assert answer["done"] and answer["counts"]["/events"] == 1
    assert {name: answer["counts"][name] for name in ours.topics} == {t.name: t.rows for t in ours.topics.values()}


def test_rerun_accepts_a_log(log):
    rerun = shutil.which("rerun")
    if rerun is None:
        pytest.skip("rerun-sdk is not installed")
    told = subprocess.run([rerun, "mcap", "check", str(log[0])], capture_output=True, text=True)
    assert told.returncode == 0, told.stdout + told.stderr


def test_reading_needs_no_pandas_until_a_frame_is_asked_for():
    code = "import sys, cosim.log; sys.exit('pandas' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


WIDE = [
    Topic("/w", [f"x_{i}" for i in range(2300)], ["-"] * 2300, np.arange(2300)),  # tags of one, two and three bytes
    Topic("/n/a", [f"x_{i}" for i in range(14)], ["-"] * 14, np.arange(14), channel="/n"),  # 126 bytes
    Topic("/n/b", [f"x_{i}" for i in range(15)], ["-"] * 15, np.arange(15), channel="/n"),  # 135: its length takes two
    Topic("/n/b/deep", [f"P[{i}]" for i in range(2200)], ["-"] * 2200, np.arange(2200), channel="/n"),  # three
    Topic("/n", ("h_s", "h_S", "y_1_0", "y_10"), ["-"] * 4, np.arange(4), channel="/n"),  # proto3 takes them for one
    Topic("/slow/a", ("r",), ["-"], [5], every=150, channel="/slow"),  # more than a chunk's rows, no multiple of them
]


def test_lengths_and_tags_of_any_size_are_read_by_the_mcap_package_and_by_us(tmp_path):
    v = np.random.default_rng(1).standard_normal((470, 2300))
    with LogWriter(tmp_path / "a", WIDE, n_values=2300, rows_per_chunk=40) as log:
        for row in v:
            log.append(row)
    log, got = open_log(tmp_path / "a"), {t.name: [] for t in WIDE}
    with (tmp_path / "a").open("rb") as file:
        decoded = SeekingReader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, _, proto in decoded.iter_decoded_messages(end_time=50 * 5_000_000):
            for topic in (t for t in WIDE if t.channel == channel.topic):
                got[topic.name].append(values_of(proto, topic))
    assert sum(len(t.fields) for t in log.topics.values()) == sum(len(t.fields) for t in WIDE)
    for topic in WIDE:
        want = v[:: topic.every][:, topic.index]
        assert same_bits(log.array(topic.name), np.ascontiguousarray(want))
        assert same_bits(np.array(got[topic.name]), np.ascontiguousarray(want[: len(got[topic.name])]))


@pytest.mark.parametrize("topic", [*TOPICS, *WIDE], ids=lambda t: t.name)
def test_no_schema_has_names_that_its_syntax_takes_for_one(topic):
    parts = [t for t in (*TOPICS, *WIDE) if t.channel == topic.channel and t.every == topic.every]
    (file,) = descriptor_pb2.FileDescriptorSet.FromString(schema_data(topic.channel, tuple(parts))).file
    descriptor_pool.DescriptorPool().Add(file)
    assert file.syntax == "proto2"


@pytest.mark.parametrize("parts", [
    [("/a", ("x", "b")), ("/a/b", ("y",))],  # a field and a nested message
    [("/a/b", ("y",)), ("/a", ("b",))],
    [("/a", ("P[1]", "P[0]"))],
    [("/a", ("P", "P[0]"))],
    [("/a/b", ("x",), 1), ("/a/c", ("x",), 2)],  # two rates on one channel
])  # fmt: skip
def test_parts_that_do_not_fit_into_one_message_are_refused(parts, tmp_path):
    with pytest.raises(ValueError):
        topics = [Topic(name, fields, ["-"] * len(fields), np.arange(len(fields)), *every, channel="/a")
                  for name, fields, *every in parts]  # fmt: skip
        LogWriter(tmp_path / "a", topics, n_values=9)


def test_every_index_entry_points_at_a_message_of_its_channel_and_time(log, tmp_path):
    recover(log[0], tmp_path / "recovered")
    for path in (log[0], tmp_path / "recovered"):
        records, content, count = Records(path.read_bytes()), b"", 0
        chunk = -1
        for opcode, body in records:
            if opcode == 6:
                chunk += 1
                content = records.content(chunk)
            elif opcode == 7:
                channel, _ = struct.unpack_from("<HI", body)
                for ns, at in np.frombuffer(body[6:], "<u8").reshape(-1, 2).tolist():
                    op, _, own, _, time, _ = struct.unpack_from("<BQHIQQ", content, at)
                    assert (op, own, time) == (5, channel, ns)
                    count += 1
        with path.open("rb") as file:
            assert count == SeekingReader(file).get_summary().statistics.message_count > 500
