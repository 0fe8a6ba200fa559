"""A hostile log, also one whose checksums agree, ends in one LogError within bounds, or holds what was written."""

import struct

import lz4.frame
import numpy as np
import pytest
import zstandard
from log_samples import MIB, TOPICS, Records, bounded, flight_log, same_bits, vectors

from cosim.log import LogError, LogWriter, Topic, open_log, recover

HEADER, SCHEMA, CHANNEL, CHUNK, ATTACHMENT, METADATA = 1, 3, 4, 6, 9, 12


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return flight_log(tmp_path_factory.mktemp("hostile"), 120)


@pytest.fixture
def forged(whole, tmp_path):
    """Return a call that lets `change(records)` change the records of a log and returns the path of the sealed one."""

    def made(change=lambda records: None):
        records = Records(whole.read_bytes())
        change(records)
        (tmp_path / "forged").write_bytes(records.sealed())
        return tmp_path / "forged"

    return made


def refused(path, word="", seconds=5.0, memory=150 * MIB):
    """Check that a log is refused in bounded time and memory."""
    with bounded(seconds, memory), pytest.raises(LogError) as error:
        log = open_log(path)
        [log.array(name) for name in log.topics]
        log.messages("/events")
    assert word in str(error.value) and str(path) in str(error.value), error.value


def content(path):
    """Return (values, all else) of a log."""
    log = open_log(path)
    texts = {name: [(k, m.SerializeToString()) for k, m in log.messages(name)] for name in ("/events", "/tf", "/fix")}
    told = log.metadata, log.attachments, log.media_types, log.result, log.topics, texts
    return {name: log.array(name) for name in log.topics}, told


def same(one, other):
    return one[1] == other[1] and all(same_bits(one[0][name], values) for name, values in other[0].items())


def test_the_generator_itself_makes_a_good_log(forged, whole):
    assert same(content(forged()), content(whole))


STATED = zstandard.compress(bytes(256 * MIB))
LZ4 = lz4.frame.compress(bytes(256 * MIB), store_size=False), lz4.frame.compress(bytes(256 * MIB))
CHUNKS = {  # of the first chunk: what is changed, what is said
    "stated bomb": ({"data": STATED, "compression": "zstd"}, "not as long as its chunk says"),
    "large bomb": ({"data": STATED, "compression": "zstd", "size": 256 * MIB}, "limit"),
    "huge bomb": ({"data": STATED, "compression": "zstd", "size": 2**60}, "limit"),
    "lz4 bomb": ({"data": LZ4[0]}, "not as long as its chunk says"),
    "stated lz4 bomb": ({"data": LZ4[1]}, "not as long as its chunk says"),
    "no frame": ({"data": b"not lz4 at all"}, "cannot be decompressed"),
    "nothing": ({"data": b""}, "cannot be decompressed"),
    "compression": ({"compression": "xz"}, "unknown compression"),
    "long compression": ({"compression": "z" * 100}, "unknown compression"),
    "data size": ({"data_size": 2**63}, "its length is wrong"),
    "no size": ({"size": 0}, "cannot hold its ticks"),
    "end": ({"end": 2**63}, "do not follow"),
    "late end": ({"end": 10**18}, "cannot hold its ticks"),
    "start after end": ({"start": 500_000_000}, "do not follow"),
    "CRC": ({"crc": 0}, "damaged (CRC)"),
}


@pytest.mark.parametrize("name", CHUNKS)
def test_a_forged_chunk_is_refused(name, forged):
    changes, word = CHUNKS[name]
    refused(forged(lambda records: records.chunk(0, **changes)), word)


@pytest.mark.parametrize("row", [0, 1, 49])
@pytest.mark.parametrize("place", [0, 1, 9, 11, 15, 23, 31, 40])
def test_a_single_constant_byte_of_a_chunk_is_checked(row, place, forged, whole):
    log = open_log(whole)
    rows = log._scan.layout.sizes(0, 50)
    at = sum(rows[:-1]) + rows[-1] // 50 * row + place  # the messages of every tick come last

    def change(records):
        data = bytearray(records.content(0))
        data[at] ^= 2
        records.chunk(0, content=bytes(data))

    refused(forged(change), f"byte {at} ")


def test_tails_that_are_no_messages_are_refused(forged):
    for tail in (b"\x05", bytes(31), b"\x05" + struct.pack("<QHIQQ", 22, 1, 0, 0, 0)):
        refused(forged(lambda records, tail=tail: records.chunk(1, content=records.content(1) + tail)), " message")


def _change(opcode, old, new):
    def change(records):
        record = next(r for r in records if r[0] == opcode and old in r[1])
        record[1] = bytearray(bytes(record[1]).replace(old, new))

    return change


PREAMBLES = {  # what is done to the records, what is said
    "strange record": (lambda r: r.insert(3, [0x99, b""]), "damaged or foreign"),
    "another's": (_change(HEADER, b"cosim-log", b"other-log"), "written by 'other-log"),
    "older": (_change(HEADER, b"cosim-log 2", b"cosim-log 1"), "written in format 1, which cosim"),
    "not UTF-8": (_change(CHANNEL, b"/truth", b"/trut\xff"), "damaged or foreign"),
    "rate": (_change(CHANNEL, b"every", b"evere"), "damaged or foreign"),
    "no tick": (_change(METADATA, b"5000000", b"-500000"), "it has no tick"),
    "chunk before": (lambda r: r.insert(1, next(x for x in r if x[0] == CHUNK)), "not what was written"),
    "order": (lambda r: r.insert(r.first(CHUNK), r[r.first(CHUNK, 1)]), "do not follow"),
}


@pytest.mark.parametrize("name", PREAMBLES)
def test_records_out_of_place_are_refused(name, forged):
    change, word = PREAMBLES[name]
    refused(forged(change), word)


def test_a_preamble_that_is_not_what_was_written_is_refused_before_it_is_parsed(whole, tmp_path):
    records = Records(whole.read_bytes())
    _change(SCHEMA, b"x_3", b"\xff\xff\xff")(records)
    (tmp_path / "a").write_bytes(records.sealed(preamble=False))
    refused(tmp_path / "a", "not what was written")


def test_reading_takes_what_was_asked_for_and_a_bounded_cache(tmp_path, monkeypatch):
    monkeypatch.setattr("cosim.log.reader.CACHE_BYTES", MIB)
    topics = [Topic(f"/t{i}", [f"x{j}" for j in range(20)], ["-"] * 20, np.arange(20) + 20 * i) for i in range(10)]
    with LogWriter(tmp_path / "a", topics, n_values=200, rows_per_chunk=100) as log:
        for row in np.random.default_rng(0).standard_normal((5000, 200)):
            log.append(row)
    with bounded(seconds=10, memory=5000 * 20 * 8 + 5 * MIB):  # the log holds 8 MB of values
        open_log(tmp_path / "a").array("/t3")


def _mutate(data, rng):
    """Return `data` changed in one random way."""
    out, n = bytearray(data), len(data)
    a, b = sorted(rng.integers(0, n, 2).tolist())
    match int(rng.integers(0, 8)):
        case 0 | 1:
            out[a] ^= 1 << int(rng.integers(0, 8))
        case 2:
            out[a] = int(rng.choice([0, 1, 0x7F, 0x80, 0xFF]))
        case 3:
            return bytes(out[:a])
        case 4:
            out[a:a] = rng.bytes(int(rng.integers(1, 40)))
        case 5:
            del out[a : a + int(rng.integers(1, 40))]
        case 6:
            out[a : a + 8] = struct.pack("<Q", (2**63, 2**64 - 1, 3 * 2**30, 2**40, 0)[rng.integers(5)])
        case 7:
            out[a : a + 200] = out[b : b + 200]
    return bytes(out)


@pytest.mark.parametrize("number", [150, pytest.param(2400, marks=pytest.mark.slow)])
def test_changed_bytes_are_refused(number, whole, tmp_path):
    data, rng, before = whole.read_bytes(), np.random.default_rng(2026), content(whole)
    for _ in range(number):
        changed = _mutate(data, rng)
        (tmp_path / "bad").write_bytes(changed)
        try:
            assert same(content(tmp_path / "bad"), before) and changed == data
        except LogError as error:
            assert str(tmp_path / "bad") in str(error)


def test_what_is_recovered_of_a_changed_log_was_written(whole, tmp_path):
    data, rng, v, kept = whole.read_bytes(), np.random.default_rng(5), vectors(120), 0
    for _ in range(60):
        (tmp_path / "bad").write_bytes(_mutate(data, rng))
        try:
            recover(tmp_path / "bad", tmp_path / "out")
        except LogError:
            continue
        log = open_log(tmp_path / "out")
        kept += log.n_ticks > 0
        for topic in (t for t in TOPICS if t.name in log.topics):
            assert same_bits(log.array(topic.name), np.ascontiguousarray(v[log.ticks(topic.name)][:, topic.index]))
    assert kept > 20
