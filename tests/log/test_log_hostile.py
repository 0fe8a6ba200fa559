"""A hostile log, with checksums that agree, ends in one LogError within bounded memory and time."""

import io
import re
import struct
import zlib

import lz4.frame
import numpy as np
import pytest
import zstandard
from log_samples import MIB, bounded, flight_log, reseal
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from cosim.log import Limits, LogError, LogWriter, Topic, open_log
from cosim.log.format import LIBRARY, channel_metadata, schema_data, schema_name
from cosim.log.record_writer import Sink, encode
from cosim.log.records import MAGIC, pack_chunk


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return flight_log(tmp_path_factory.mktemp("hostile"), 120)


class Forge(Sink):
    """Write logs whose checksums and indexes are right and whose content is not."""

    def __init__(self, path, *, n=100):
        super().__init__(path)
        self.topic = Topic("/a", ("x", "y"), ("m", "m"), [0, 1])
        self.preamble(
            [(self.topic.name, schema_name("/a"), schema_data("/a", self.topic.fields), channel_metadata(self.topic))],
            {"log": {"dt_ns": "5000000"}},
            {},
        )
        from cosim.log.chunk import Layout

        self.layout, self.n = Layout([(1, 2, 1)], 5_000_000), n
        self.content = self.layout.plan(0, n).template(0)

    def seal(self, content=None, data=None, compression="zstd", k0=0, finish=True, **changes):
        """Write a chunk with the given content or compressed data, and change its record and index as asked."""
        content = self.content if content is None else content
        data = zstandard.compress(bytes(content)) if data is None else data
        blobs, ref = pack_chunk(self.layout, content, [data], compression, k0, self.n, {}, self.offset)
        head = bytearray(blobs[0])
        for name, (at, kind) in {
            "length": (1, "<Q"), "start": (9, "<Q"), "end": (17, "<Q"), "size": (25, "<Q"),
        }.items():  # fmt: skip
            if name in changes:
                struct.pack_into(kind, head, at, changes[name])
        if "data_size" in changes:
            struct.pack_into("<Q", head, len(head) - 8, changes["data_size"])
        ref.size, ref.start_ns, ref.end_ns = struct.unpack_from("<Q", head, 25)[0], *struct.unpack_from("<QQ", head, 9)
        self.chunk([bytes(head), *blobs[1:]], ref)
        if finish:
            self.finish()
        return self.path


def _refused(path, word="", seconds=5.0, memory=150 * MIB):
    """Check that a log is refused in bounded time and memory, and return the message."""
    with bounded(seconds, memory), pytest.raises(LogError) as error:
        open_log(path).arrays()
    assert word in str(error.value) and "byte" in str(error.value), error.value
    return str(error.value)


def test_the_forge_itself_makes_a_good_log(tmp_path):
    assert open_log(Forge(tmp_path / "a").seal()).array("/a").shape == (100, 2)


def _stream(size):
    """Return zstd frames of `size` zeros that do not state their size."""
    out = io.BytesIO()
    with zstandard.ZstdCompressor().stream_writer(out, closefd=False) as writer:
        for _ in range(size // MIB):
            writer.write(bytes(MIB))
    return out.getvalue()


def test_bombs_are_refused(tmp_path):
    bomb = _stream(256 * MIB)
    stated = zstandard.compress(bytes(256 * MIB))
    assert len(bomb) < 64 * 1024 and len(stated) < 64 * 1024
    _refused(Forge(tmp_path / "a").seal(data=bomb), "not as long as its chunk says")
    _refused(Forge(tmp_path / "a").seal(data=stated), "not as long as its chunk says")
    _refused(Forge(tmp_path / "a").seal(data=stated, size=256 * MIB), "limits")
    _refused(Forge(tmp_path / "a").seal(data=stated, size=2**60), "limits")
    zeros = zstandard.compress(bytes(60 * MIB))
    _refused(Forge(tmp_path / "a").seal(data=zeros, size=60 * MIB), "cannot hold")
    many = Forge(tmp_path / "a")
    for i in range(500):
        many.seal(data=zeros[:40], size=60 * MIB, k0=100 * i, finish=False)
    many.finish()
    _refused(tmp_path / "a", "cannot hold")


def test_wrong_compression_is_refused(tmp_path):
    for name in ("LZ4", "xz", "zstd\0", "z" * 100):
        _refused(Forge(tmp_path / "a").seal(compression=name), "unknown compression")
    _refused(Forge(tmp_path / "a").seal(data=b"not zstd at all"), "cannot be decompressed")
    _refused(Forge(tmp_path / "a").seal(data=b""), "cannot be decompressed")
    two = zstandard.compress(bytes(Forge(tmp_path / "b").content)) + zstandard.compress(b"more")
    _refused(Forge(tmp_path / "a").seal(data=two), "cannot be decompressed")


def test_lz4_bombs_and_broken_frames_are_refused(tmp_path):
    def refused(data, word, **more):
        _refused(Forge(tmp_path / "a").seal(data=data, compression="lz4", **more), word)

    content = bytes(Forge(tmp_path / "b").content)
    good = lz4.frame.compress(content)
    Forge(tmp_path / "a").seal(data=good, compression="lz4")
    assert open_log(tmp_path / "a").array("/a").shape == (100, 2)
    bomb = lz4.frame.compress(bytes(256 * MIB), store_size=False)
    stated = lz4.frame.compress(bytes(256 * MIB))
    refused(bomb, "not as long as its chunk says")
    refused(stated, "not as long as its chunk says")
    refused(stated, "limits", size=256 * MIB)
    refused(good[:15] + bomb[7:], "cannot be decompressed")  # a frame that states the chunk's size and holds 256 MiB
    refused(good + good, "cannot be decompressed")
    refused(good + b"more", "cannot be decompressed")
    refused(b"not lz4 at all", "cannot be decompressed")
    refused(b"", "cannot be decompressed")
    for cut in (4, 14, 20, len(good) // 2, len(good) - 1):
        refused(good[:cut], "")


def test_wrong_lengths_are_refused(tmp_path):
    for length in (2**63, 2**64 - 1, 3 * 2**30, 2**40, 0, 10):
        _refused(Forge(tmp_path / "a").seal(length=length))
        _refused(Forge(tmp_path / "a").seal(data_size=length), "bytes of data in a record")
    for size in (0, 10, 5000):
        _refused(Forge(tmp_path / "a").seal(size=size))


def test_wrong_times_are_refused(tmp_path):
    for times in ({"start": 1}, {"end": 2**63}, {"end": 2**64 - 1}, {"start": 500_000_000}, {"end": 10**18}):
        _refused(Forge(tmp_path / "a").seal(**times))
    again = Forge(tmp_path / "a")
    again.seal(finish=False)
    again.seal()
    _refused(tmp_path / "a", "before the chunk before it ends")


@pytest.mark.parametrize(
    ("at", "kind", "value"),
    [
        (0, "<B", 4),  # another record
        (1, "<Q", 2**50),  # a length beyond the chunk: the library takes it and gives a short message
        (1, "<Q", 0),
        (9, "<H", 2),  # a channel that does not exist
        (11, "<I", 7),  # another tick
        (15, "<Q", 12345),
        (23, "<Q", 12345),
        (31, "<B", 0x11),  # another tag
    ],
)
def test_a_chunk_whose_messages_are_not_one_per_sample_is_refused(tmp_path, at, kind, value):
    for row in (0, 1, 99):
        forge = Forge(tmp_path / "a")
        struct.pack_into(kind, forge.content, row * 49 + at, value)
        told = _refused(forge.seal(), "not one message per sample")
        assert re.search(rf"byte {row * 49 + at}\b", told), told


def test_a_tail_that_is_no_message_is_refused(tmp_path):
    for tail in (b"\x05", bytes(31), b"\x05" + struct.pack("<QHIQQ", 22, 1, 0, 0, 0)):
        forge = Forge(tmp_path / "a")
        _refused(forge.seal(content=np.concatenate([forge.content, np.frombuffer(tail, "u1")])), "count")


def _declared(path, *records):
    """Write a log whose data section is a header and the given records, and a summary that agrees."""
    from cosim.log.records import closing

    body = MAGIC + b"".join(r if isinstance(r, bytes) else encode(r) for r in records)
    path.write_bytes(body + b"".join(closing(len(body), zlib.crc32(body), [], [], [], [], [])))
    return path


def test_redefined_foreign_and_malformed_records_are_refused(tmp_path):
    path, topic = tmp_path / "a", Topic("/a", ("x",), ("m",), [0])
    head = Header(profile="", library=LIBRARY)
    schema = Schema(id=1, name=schema_name("/a"), encoding="protobuf", data=schema_data("/a", ("x",)))
    channel = Channel(id=1, topic="/a", message_encoding="protobuf", schema_id=1, metadata=channel_metadata(topic))
    other = Channel(id=1, topic="/b", message_encoding="protobuf", schema_id=1, metadata=channel_metadata(topic))
    log = Metadata(name="log", metadata={"dt_ns": "5000000"})
    latin = encode(channel).replace(b"/a", b"/\xff")
    deep = {**channel_metadata(topic), "units": "[" * 100_000}
    bad_units = {**channel_metadata(topic), "units": "[1]"}
    large_every = {**channel_metadata(topic), "every": "9" * 5000}
    attachment = bytearray(encode(Attachment(0, 0, "a", "", b"data")))
    attachment[-6] ^= 1
    for word, records in {
        "out of order or defined again": (head, schema, channel, other),
        "defined again ": (head, schema, channel, schema),
        "header": (head, head),
        "a log has one header": (schema,),
        "written by": (Header(profile="ros2", library="x"),),
        "utf-8": (head, schema, latin),
        "recursion": (head, schema, Channel(1, "/a", "protobuf", deep, 1)),
        "units must be texts": (head, schema, Channel(1, "/a", "protobuf", bad_units, 1)),
        "digits": (head, schema, Channel(1, "/a", "protobuf", large_every, 1)),
        "not protobuf": (head, schema, Channel(1, "/a", "json", channel_metadata(topic), 1)),
        "error parsing message": (head, Schema(1, b"\x0a\xff\xff\xff", "protobuf", "cosim.a"), channel),
        "is there twice": (head, schema, channel, log, log),
        "no topic": (head, log),
        "do not give the tick": (head, schema, channel, Metadata("log", {"dt_ns": "-5"})),
        "lengths or checksum": (head, schema, channel, log, bytes(attachment)),
        "is not what was written": (head, schema, channel, log, Metadata("preamble", {"sha256": "0"})),
        "it follows no chunk": (head, schema, channel, log, b"\x07" + struct.pack("<QHI", 6, 1, 0)),
        "no place here": (head, b"\x99" + struct.pack("<Q", 0)),
        "beyond the reader's limit": (head, Metadata("x", {"x": "y" * (5 * MIB)})),
        "does not fit": (head, b"\x0c" + struct.pack("<Q", 2**20)),
        "beyond the reader's limits": (head, b"\x0c" + struct.pack("<Q", 2**62)),
    }.items():
        told = _refused(_declared(path, *records))
        assert word.strip() in told.lower() or word.strip() in told, (word, told)


def test_limits_can_be_set(whole):
    for limits in (Limits(chunk_bytes=1000), Limits(total_bytes=1000), Limits(channels=2), Limits(records=5)):
        with pytest.raises(LogError):
            open_log(whole, limits=limits)


def test_a_summary_that_tells_another_story_is_refused(whole, tmp_path):
    """Another reader trusts the summary, so it must say what the data say, even with a right checksum."""
    data = bytearray(whole.read_bytes())
    (start,) = struct.unpack_from("<Q", data, len(data) - 28)
    at = data.index(b"\x0b" + struct.pack("<Q", 46 + 10 * 7), start)  # statistics of seven channels
    data[at + 9] ^= 1  # the message count
    (tmp_path / "a").write_bytes(reseal(bytes(data)))
    _refused(tmp_path / "a", "summary does not agree")


def test_reading_takes_one_chunk_and_what_was_asked_for(tmp_path):
    topics = [Topic(f"/t{i}", [f"x{j}" for j in range(20)], ["-"] * 20, np.arange(20) + 20 * i) for i in range(10)]
    with LogWriter(tmp_path / "a", topics, n_values=200, rows_per_chunk=100) as log:
        for row in np.random.default_rng(0).standard_normal((5000, 200)):
            log.append(row)
    with bounded(seconds=10, memory=5000 * 20 * 8 + 3 * MIB):  # the log holds 8 MB of values
        open_log(tmp_path / "a").array("/t3")


def test_an_index_entry_that_points_elsewhere_is_refused(whole, tmp_path):
    data = bytearray(whole.read_bytes())
    chunk = open_log(whole).chunks[0]
    at = chunk.offset + chunk.length  # of its first message index: 15 bytes, then (time, offset) of each message
    assert data[at] == 7
    for place in (at + 15, at + 23, at + 31):  # the first time, the first offset, the second time
        forged = bytearray(data)
        struct.pack_into("<Q", forged, place, struct.unpack_from("<Q", forged, place)[0] + 8)
        path = tmp_path / "forged.mcap"
        path.write_bytes(reseal(forged))
        with pytest.raises(LogError, match="point elsewhere"):
            open_log(path)
    path.write_bytes(reseal(data))
    assert open_log(path).complete
