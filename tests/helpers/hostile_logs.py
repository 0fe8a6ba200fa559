"""Hostile logs of our own format: damaged bytes, forged contents, forged records, all sealed with right checksums."""

import contextlib
import hashlib
import io
import json
import struct
import zlib

import lz4.frame
import numpy as np
import zstandard
from forged import forge
from hostile_texts import mangled
from log_samples import reseal
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from cosim.errors import LogError
from cosim.log import open_log
from cosim.log.format import Limits
from cosim.log.records import MAGIC, closing
from cosim.log.validate import scan

STRANGE = (None, -1, 0, 7, 1e308, "x", "", [], {}, [[]], 10**30, 10**9, True, "é" * 500, "../../x", [None], {"x": {}})
NUMBERS = (np.nan, np.inf, -np.inf, 1e300, -1e18, 1e18, -1.0, 0.5, 0.0, 1e-310, 2.0**63, 99.0)
TEXTS = (
    "",
    "0",
    "-1",
    "1",
    "1e9",
    "9" * 400,
    "null",
    "[]",
    "[1]",
    "[" * 5000,
    "{}",
    "nan",
    "\x00",
    "é" * 300,
    "/",
    "../../x",
    "<script>alert(1)</script>",
    "1.5",
    "inf",
    "99999999999",
    "iotsekf",
    "💥",
    "[bold]",
    "\x1b[2J",
)
KINDS = {1: Header, 3: Schema, 4: Channel, 9: Attachment, 12: Metadata}
INTEGERS = (0, 1, 2, 255, 65535, 2**31, 2**32 - 1, 2**62, 2**63 - 1, 2**64 - 1, 5_000_000)


class Logs:
    """Make hostile logs from whole ones at `paths`, each written to `path`."""

    def __init__(self, paths, path):
        self.data = [p.read_bytes() for p in paths]
        self.logs = [open_log(p) for p in paths]
        self.path = path

    def mutated(self, rng):
        """Damage bytes; mostly with checksums that agree afterwards."""
        out = bytearray(rng.choice(self.data))
        for _ in range(rng.choice((1, 1, 2, 5))):
            at, n = rng.randrange(len(out)), rng.choice((1, 1, 8, 100))
            if rng.random() < 0.7:
                out[at : at + n] = rng.randbytes(n)
            elif rng.random() < 0.5:
                del out[at : at + n]
            else:
                out[at:at] = rng.randbytes(n)
        self.path.write_bytes(reseal(bytes(out)) if rng.random() < 0.7 else bytes(out))
        return self.path

    def contents(self, rng):
        """Write a log anew, right in all but what it says: attachments, samples, metadata, result, gaps, ticks."""
        log = rng.choice(self.logs)
        how = {"attachments": {}, "samples": [], "metadata": {}, "result": {}}
        for _ in range(rng.choice((1, 1, 1, 2, 3))):
            what = rng.random()
            if what < 0.35:
                name = rng.choice([n for n in log.attachments if n in ("scenario.toml", "detectors.json")])
                how["attachments"][name] = self._text(rng, name, log.attachments[name])
            elif what < 0.55:
                name = rng.choice([n for n in log.attachments if n.endswith((".npy", ".npz"))])
                how["attachments"][name] = _bytes(rng, log.attachments[name])
            elif what < 0.75:
                topic = rng.choice(list(log.topics.values()))
                how["samples"].append((topic.name, rng.choice(topic.fields), rng.choice(NUMBERS)))
            elif what < 0.85:
                key = rng.choice(["detectors", "achieved", "status", "reason", "sim_time_s", *log.result])
                how["result"][key] = rng.choice(TEXTS)
            elif what < 0.93:
                name = rng.choice([n for n in log.metadata if n not in ("log", "preamble", "result")] + ["x"])
                many = {f"k{i}": "v" for i in range(rng.choice((0, 3, 20_000)))}
                held = dict(log.metadata.get(name, {}))
                held[rng.choice([*held, "new"])] = rng.choice(TEXTS)
                how["metadata"][name] = rng.choice([held, many, {}])
            else:
                how |= {"gap": rng.choice((1, 40, 10**6, 10**9, 10**12)), "dt_ns": rng.choice((1, 5_000_000, 10**12))}
        return forge(log, self.path, **how)

    def _text(self, rng, name, raw):
        if rng.random() < 0.05:
            return rng.choice(
                [None, b"", b"null", b"\xff\xfe" + raw, raw[: rng.randrange(len(raw))], raw.decode().encode("utf-16")]
            )
        if name.endswith(".toml"):
            return mangled(rng, raw.decode()).encode("utf-8", "surrogatepass")
        found = json.loads(raw)
        node = entry = rng.choice(found)
        for _ in range(rng.randrange(5)):  # somewhere inside
            below = list(node.values()) if isinstance(node, dict) else node
            deeper = [v for v in below if isinstance(v, dict | list) and v]
            if deeper:
                node = rng.choice(deeper)
        key = rng.choice(list(node)) if isinstance(node, dict) else rng.randrange(len(node))
        if rng.random() < 0.2:
            del node[key]
        else:
            node[key] = rng.choice(STRANGE)
        return json.dumps(rng.choice([found, found, found, entry, found * 2, None, [entry], found[::-1]])).encode()

    def records(self, rng):
        """Change, move, repeat or drop records, then make preamble, result, checksums and summary agree."""
        found = _records(rng.choice(self.data))
        for _ in range(rng.choice((1, 1, 2, 4))):
            with contextlib.suppress(Exception):  # what is damaged before is not damaged further
                _changed(rng, found)
        self.path.write_bytes(sealed(found, self.path) if rng.random() < 0.8 else _summary(rng, rng.choice(self.data)))
        return self.path


def _bytes(rng, raw):
    """Return the bytes of an array with numbers, header or length changed."""
    raw = bytearray(raw)
    for _ in range(rng.choice((1, 3))):
        at = (
            rng.randrange(len(raw))
            if rng.random() < 0.3
            else max(0, len(raw) - 8 * rng.randint(1, max(1, len(raw) // 8)))
        )
        raw[at : at + 8] = rng.choice([rng.randbytes(8), np.float64(rng.choice(NUMBERS)).tobytes()])
    if rng.random() < 0.2:
        header = rng.choice(
            [b"'<f4'", b"'>f8'", b"'|S8'", b"'<M8[s]'", b"'|O'", b"'<c16'", b"[('a', '<f8')]", b"'|V8'"]
        )
        raw = bytearray(bytes(raw).replace(b"'<f8'", header, 1))
    return bytes(raw[: rng.randrange(len(raw))] if rng.random() < 0.1 else raw)


def _records(data):
    """Return [opcode, body] of every record before the end of the data."""
    out, at = [], len(MAGIC)
    while at < len(data):
        opcode, length = struct.unpack_from("<BQ", data, at)
        if opcode == Opcode.DATA_END:
            break
        out.append([opcode, data[at + 9 : at + 9 + length]])
        at += 9 + length
    return out


def _changed(rng, found):
    """Do one thing to the records."""
    i, what = rng.randrange(len(found)), rng.random()
    if rng.random() < 0.5:  # a rare kind as often as a frequent one
        kind = rng.choice(sorted({opcode for opcode, _ in found}))
        i = rng.choice([k for k, (opcode, _) in enumerate(found) if opcode == kind])
    opcode, body = found[i]
    if what < 0.06:
        j = rng.randrange(len(found))
        found[i], found[j] = found[j], found[i]
    elif what < 0.12:
        found.insert(rng.randrange(len(found) + 1), [opcode, body])
    elif what < 0.18:
        del found[i]
    elif what < 0.22:
        found.insert(i, [rng.choice((0, 5, 15, 99, 128, 200, 255)), rng.randbytes(rng.choice((0, 3, 50)))])
    elif what < 0.26:
        found[i][0] = rng.choice(list(range(1, 16)))
    elif what < 0.34:
        found[i][1] = body[: rng.randrange(len(body) + 1)] + rng.randbytes(rng.choice((0, 4)))
    elif what < 0.5 and len(body) > 8:
        at, width = rng.randrange(len(body) - 7), rng.choice((1, 2, 4, 8))
        at = min(at, rng.choice((4, 8, 16, 24, 40, 60, len(body))))
        value = rng.choice(INTEGERS) % 256**width
        found[i][1] = body[:at] + value.to_bytes(width, "little") + body[at + width :]
    elif opcode in KINDS:
        record = KINDS[opcode].read(ReadDataStream(io.BytesIO(body)))
        _lie(rng, record)
        builder = RecordBuilder()
        record.write(builder)
        found[i][1] = builder.end()[9:]
    elif opcode == Opcode.CHUNK:
        found[i][1] = _chunk(rng, body)


def _lie(rng, record):
    name = rng.choice([k for k in vars(record) if not k.startswith("_")])
    value = getattr(record, name)
    if isinstance(value, dict):
        value = dict(value)
        key = rng.choice([*value, "new"])
        value[key] = rng.choice([*TEXTS, json.dumps(["-"] * 3000)])
        setattr(record, name, rng.choice([value, {}, {f"k{i}": "v" for i in range(20_000)}]))
    elif isinstance(value, bytes):
        raw = bytearray(value or b"x")
        raw[rng.randrange(len(raw))] = rng.randrange(256)
        setattr(record, name, rng.choice([bytes(raw), bytes(raw) * 2, b"", rng.randbytes(40), value + b"\x0a\x00"]))
    elif isinstance(value, int):
        setattr(record, name, rng.choice(INTEGERS) % (2**16 if name in ("id", "schema_id") else 2**64))
    else:
        setattr(record, name, rng.choice([*TEXTS, value + value, value.upper()]))


def _chunk(rng, body):
    """Return a chunk whose content, times, sizes or compression lie, with the right checksum of what is in it."""
    start, end, size, crc, n = struct.unpack_from("<QQQII", body)
    name, data = body[32 : 32 + n], body[40 + n :]
    content = bytearray(lz4.frame.decompress(data) if name == b"lz4" else data)
    what = rng.random()
    if what < 0.4:
        for _ in range(rng.choice((1, 3))):
            at = (
                rng.randrange(len(content))
                if rng.random() < 0.5
                else len(content) - 1 - rng.randrange(min(400, len(content)))
            )
            content[at : at + 8] = rng.choice([rng.randbytes(8), struct.pack("<Q", rng.choice(INTEGERS))])
    elif what < 0.5:
        content = content[: rng.randrange(len(content) + 1)] + rng.randbytes(rng.choice((0, 31, 40)))
    elif what < 0.6:
        content = bytearray(rng.choice((1 << 20, 40 << 20, 63 << 20)))  # a bomb
    elif what < 0.8:
        start, end = rng.choice(
            [(end, start), (start, end * 1000), (0, 2**63 - 1), (start, start), (start + 1, end + 1)]
        )
    size = rng.choice((len(content), len(content), len(content), size, 0, 2**40, 2**64 - 1))
    crc = rng.choice((zlib.crc32(content), zlib.crc32(content), crc, 0))
    name = rng.choice((name, name, b"zstd", b"", b"bz2", b"lz4" * 100))
    if name == b"zstd":
        data = zstandard.ZstdCompressor(write_content_size=rng.random() < 0.8).compress(bytes(content))
    elif name == b"lz4":
        data = lz4.frame.compress(bytes(content), store_size=rng.random() < 0.8)
    else:
        data = bytes(content)
    data = rng.choice((data, data, data, data + b"x", data[:-1], data + data))
    return struct.pack("<QQQII", start, end, size, crc, len(name)) + name + struct.pack("<Q", len(data)) + data


def sealed(found, path):
    """Return the bytes of a log of these records whose preamble, result, checksums and summary agree with them."""
    out, whole, chunks = bytearray(MAGIC), hashlib.sha256(MAGIC), hashlib.sha256()
    for opcode, body in found:
        if opcode == Opcode.METADATA and b"preamble" in body[:12]:
            body = _metadata("preamble", {"sha256": whole.hexdigest()})
        elif opcode == Opcode.CHUNK and len(body) >= 28:
            chunks.update(body[:28])
        elif opcode == Opcode.METADATA and body[:10] == b"\x06\0\0\0result":
            try:
                texts = Metadata.read(ReadDataStream(io.BytesIO(body))).metadata
                body = _metadata("result", texts | {"content": chunks.hexdigest()})
            except Exception:  # what is no record stays as it is
                pass
        record = struct.pack("<BQ", opcode, len(body)) + body
        if opcode not in (Opcode.CHUNK, Opcode.MESSAGE_INDEX):
            whole.update(record)
        out += record
    path.write_bytes(out)
    try:
        seen = scan(path, Limits(), tolerant=True)
        crc = zlib.crc32(out)
        return bytes(
            out
            + b"".join(
                closing(len(out), crc, seen.schemas, seen.channels, seen.chunks, seen.attachments, seen.metadata)
            )
        )
    except (LogError, struct.error, KeyError):
        return bytes(out + b"".join(closing(len(out), zlib.crc32(out), [], [], [], [], [])))


def _metadata(name, texts):
    builder = RecordBuilder()
    Metadata(name=name, metadata=texts).write(builder)
    return builder.end()[9:]


def _summary(rng, data):
    """Return a log whose summary points elsewhere, backwards or in circles, its checksum right."""
    out = bytearray(data)
    (start,) = struct.unpack_from("<Q", out, len(out) - 28)
    for _ in range(rng.choice((1, 3))):
        at = rng.randrange(start, len(out) - 8)
        out[at : at + 8] = struct.pack("<Q", rng.choice((*INTEGERS, start, at, len(out), len(MAGIC))))
    return reseal(bytes(out[: len(data)]))
