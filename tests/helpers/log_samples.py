"""Small logs with awkward values, for the tests of the log."""

import hashlib
import struct
import time
import tracemalloc
import zlib
from contextlib import contextmanager

import lz4.frame
import numpy as np

from cosim.log import LogWriter, Pose, Topic

MIB = 1 << 20
N_VALUES = 40
TOPICS = (
    Topic("/truth", [f"x_{i}" for i in range(20)], ["m"] * 20, np.arange(20)),  # more fields than one-byte tags
    Topic("/actuators/left_inner/servo", ("u",), ("A",), np.array([9]), group="actuators", channel="/actuators"),
    Topic("/actuators/left_inner", ("q_rod", "u"), ("m", "-"), np.array([7, 3]), 1, "actuators", "/actuators"),
    Topic("/actuators/left_outer", ("q_rod",), ("m",), np.array([8]), group="actuators", channel="/actuators"),
    Topic("/detectors/slow", ("r", "alarm", "f_hat"), ("-", "-", "m"), np.array([30, 31, 39]), every=3),
    Topic("/state", ["s", *(f"P[{i}]" for i in range(9))], ["-"] * 10, np.arange(20, 30), every=64),  # packed
)
# bit patterns that careless handling changes: NaNs with payloads and signs, -0.0, the smallest denormal, infinities
AWKWARD = np.array(
    [0x7FF8000000000001, 0xFFF8DEADBEEF0001, 0x7FF0000000000001, 1 << 63, 1, 0x7FF0000000000000, 0xFFF0000000000000],
    dtype="<u8",
).view("<f8")


def vectors(ticks, seed=0):
    """Return (ticks, N_VALUES) noise, constants and awkward bit patterns."""
    v = np.random.default_rng(seed).standard_normal((ticks, N_VALUES))
    v[:, 6] = 42.0
    rows = np.arange(0, ticks, 5)
    v[rows, rows % N_VALUES] = AWKWARD[(rows // 5) % len(AWKWARD)]
    return v


def write(path, ticks=230, seed=0, result=True, pose=False, **options):
    """Write a log of `ticks` vectors to `path` and return the vectors."""
    v = vectors(ticks, seed)
    options = {
        "metadata": {"run": {"seed": str(seed), "unit": "µ"}},
        "attachments": {"scenario.toml": ("application/toml", b"seed = 0\n"), "empty.bin": ("", b"")},
        "rows_per_chunk": 50,
        "pose": Pose((0, 1, 2, 6, 3, 4), every=20) if pose else None,
        **options,
    }
    with LogWriter(path, TOPICS, n_values=N_VALUES, **options) as log:
        for k, row in enumerate(v):
            if k == 70:
                log.window(k, 40, None, kind="jam", target="elevator.left_inner")
            log.append(row)
        if result:
            log.close({"status": "completed"})
    return v


def flight_log(folder, ticks):
    """Write a log of `ticks` vectors with poses into a folder and return its path."""
    write(folder / "flight.mcap", ticks, pose=True)
    return folder / "flight.mcap"


def expected(v, topic, ticks=None):
    """Return what a topic must hold of the vectors, at the given ticks (default: all)."""
    ticks = np.arange(len(v)) if ticks is None else ticks
    return np.ascontiguousarray(v[ticks[ticks % topic.every == 0]][:, topic.index])


def same_bits(a, b):
    """Tell whether two float64 arrays agree in shape and in every bit."""
    return a.shape == b.shape and bool((np.ascontiguousarray(a).view("i8") == np.ascontiguousarray(b).view("i8")).all())


class Records(list):
    """[opcode, content] of the records in the data section of a log; `sealed` makes a log of them, its checksums right,
    as an attacker would."""

    def __init__(self, data):
        at = 8
        while (opcode := data[at]) != 15:
            (length,) = struct.unpack_from("<Q", data, at + 1)
            self.append([opcode, data[at + 9 : at + 9 + length]])
            at += 9 + length

    def first(self, opcode, skip=0):
        """Return the position of a record."""
        return [i for i, (op, _) in enumerate(self) if op == opcode][skip]

    def content(self, number):
        """Return the content of a chunk."""
        body = self[self.first(6, number)][1]
        return lz4.frame.decompress(bytes(body[43:]))

    def chunk(self, number, *, content=None, data=None, compression="lz4", **changes):
        """Change a chunk: its content, its compressed data, or fields of its head."""
        record = self[self.first(6, number)]
        head = dict(zip(("start", "end", "size", "crc"), struct.unpack_from("<QQQI", record[1])))
        if content is not None:
            head |= {"size": len(content), "crc": zlib.crc32(content)}
            data = lz4.frame.compress(content)
        data, name = bytes(record[1][43:]) if data is None else data, compression.encode()
        size = changes.pop("data_size", len(data))
        numbers = (head | changes).values()
        record[1] = struct.pack("<QQQII", *numbers, len(name)) + name + struct.pack("<Q", size) + data

    def sealed(self, *, preamble=True):
        """Return the bytes of a log; without `preamble` its hash stays as it was."""
        out, begun = bytearray(b"\x89MCAP0\r\n"), True
        for opcode, body in self:
            if opcode == 12 and b"preamble" in body[:12] and begun:
                begun = False
                body = body[:-64] + hashlib.sha256(out).hexdigest().encode() if preamble else body
            out += struct.pack("<BQ", opcode, len(body)) + body
        out += struct.pack("<BQI", 15, 4, zlib.crc32(out))
        footer = struct.pack("<BQQQ", 2, 20, len(out), 0)
        return bytes(out + footer + struct.pack("<I", zlib.crc32(footer)) + b"\x89MCAP0\r\n")


@contextmanager
def bounded(seconds, memory):
    """Check that what is done takes no more time and memory [byte] than that."""
    tracemalloc.start()
    begun = time.monotonic()
    try:
        yield
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert time.monotonic() - begun < seconds and peak < memory, (time.monotonic() - begun, peak / MIB)
