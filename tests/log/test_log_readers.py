"""Readers that are not ours read our logs, with every checksum on, and see the same numbers."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pytest
from google.protobuf import json_format
from log_samples import TOPICS, expected, same_bits, write
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

from cosim.log import foxglove, open_log


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("readers") / "flight.mcap"
    return path, write(path, pose=True)


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
            if channel.topic in got:
                fields = [f.name for f in proto.DESCRIPTOR.fields]
                got[channel.topic].append((message.sequence, [getattr(proto, f) for f in fields]))
                assert fields == list(next(t for t in TOPICS if t.name == channel.topic).fields)
            elif channel.topic == "/events":
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
    assert {name: counts[name] for name in ours.topics} == {t.name: t.rows for t in ours.topics.values()}
    assert set(foxglove.TOPICS) <= {c.topic for c in summary.channels.values()}
    assert [a.name for a in summary.attachment_indexes] == ["scenario.toml", "empty.bin"]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # newer versions of the package name the two limits otherwise
def test_one_topic_and_a_span_of_time_can_be_sought(log):
    with log[0].open("rb") as file:
        found = list(
            SeekingReader(file, validate_crcs=True).iter_messages(
                topics=["/actuators/left_inner"], start_time=500_000_000, end_time=600_000_000
            )
        )
    assert [m.sequence for _, _, m in found] == list(range(100, 120))


def test_well_known_schemas_are_foxgloves_own():
    foxglove_sdk = pytest.importorskip("foxglove.messages", reason="foxglove-sdk is an extra (live)")
    from google.protobuf.descriptor_pb2 import FileDescriptorSet

    for name in ("Log", "Event", "FrameTransforms", "LocationFix"):
        theirs = FileDescriptorSet.FromString(getattr(foxglove_sdk, name).get_schema().data)
        ours = FileDescriptorSet.FromString(foxglove.schema(name))
        assert _plain(ours) == _plain(theirs)


def _plain(files):
    """Return {message: {field: (number, type)}} of a descriptor set."""
    return {
        m.name: {f.name: (f.number, f.type, f.label, f.type_name) for f in m.field}
        for file in files.file
        if file.package == "foxglove"
        for m in file.message_type
    }


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


FOLDED = ("h_s", "h_S", "y_1_0", "y_10")  # what proto3 takes for one another


@pytest.mark.parametrize("topic", [t for t in TOPICS], ids=lambda t: t.name)
def test_names_that_differ_in_case_or_underscores_are_allowed_by_the_schema(topic):
    from google.protobuf import descriptor_pb2, descriptor_pool

    from cosim.log.format import schema_data

    for fields in (topic.fields, FOLDED):
        (file,) = descriptor_pb2.FileDescriptorSet.FromString(schema_data(topic.name, tuple(fields))).file
        descriptor_pool.DescriptorPool().Add(file)
        folded = [f.replace("_", "").lower() for f in fields]
        assert file.syntax == "proto2" or len(set(folded)) == len(fields)
