"""Small logs with awkward values, for the tests of the log."""

import struct
import time
import tracemalloc
import zlib
from contextlib import contextmanager

import numpy as np

from cosim.log import LogWriter, Pose, Topic

MIB = 1 << 20
N_VALUES = 40
TOPICS = (
    Topic("/truth", [f"x_{i}" for i in range(20)], ["m"] * 20, np.arange(20)),  # more fields than one-byte tags
    Topic("/actuators/left_inner", ("q_rod", "u"), ("m", "-"), np.array([7, 3]), group="actuators", description="rod"),
    Topic("/detectors/slow", ("r", "alarm", "f_hat"), ("-", "-", "m"), np.array([30, 31, 39]), every=3),
    Topic("/state", [f"P_{i}" for i in range(10)], ["-"] * 10, np.arange(20, 30), every=64),
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
        "pose": Pose(0, 1, 2, 6, 3, 4, every=20) if pose else None,
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


def reseal(data):
    """Return `data` with both checksums made to agree, as an attacker would, where it still has an end."""
    out = bytearray(data)
    if len(out) < 60:
        return data
    (start,) = struct.unpack_from("<Q", out, len(out) - 28)
    if not 21 <= start <= len(out) - 37:
        return data
    struct.pack_into("<I", out, start - 4, zlib.crc32(out[: start - 13]))
    struct.pack_into("<I", out, len(out) - 12, zlib.crc32(out[start : len(out) - 12]))
    return bytes(out)


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
