"""A damaged log ends in one LogError, or holds exactly what was written; never more memory or time."""

import struct

import numpy as np
import pytest
from log_samples import MIB, TOPICS, bounded, flight_log, reseal, same_bits, vectors

from cosim.log import LogError, open_log, recover


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return flight_log(tmp_path_factory.mktemp("hostile"), 120)


def _content(path):
    log = open_log(path)
    texts = {name: [(k, m.SerializeToString()) for k, m in log.messages(name)] for name in ("/log", "/events", "/tf")}
    return log.arrays(), (log.metadata, log.attachments, log.media_types, log.result, log.topics, texts)


def _mutate(data, rng):
    """Return `data` changed in one random way."""
    out, n = bytearray(data), len(data)
    a, b = sorted(rng.integers(0, n, 2).tolist())
    match int(rng.integers(0, 10)):
        case 0 | 1 | 2:
            out[a] ^= 1 << int(rng.integers(0, 8))
        case 3:
            out[a] = int(rng.choice([0, 1, 0x7F, 0x80, 0xFF]))
        case 4:
            return bytes(out[:a])
        case 5:
            out[a:a] = rng.bytes(int(rng.integers(1, 40)))
        case 6:
            del out[a : a + int(rng.integers(1, 40))]
        case 7:
            out[a : a + 8] = struct.pack("<Q", (2**63, 2**64 - 1, 3 * 2**30, 2**40, 0)[rng.integers(5)])
        case 8:
            out[a : a + 200] = out[b : b + 200]
        case 9:
            out[a:b] = bytes(b - a)
    return bytes(out)


@pytest.mark.parametrize("number", [200, pytest.param(2400, marks=pytest.mark.slow)])
def test_mutated_logs_are_refused_or_unchanged(number, whole, tmp_path):
    data, rng = whole.read_bytes(), np.random.default_rng(2026)
    arrays, others = _content(whole)
    refused = 0
    for _ in range(number):
        changed = _mutate(data, rng)
        (tmp_path / "bad").write_bytes(changed)
        try:
            got, rest = _content(tmp_path / "bad")
        except LogError as error:
            assert str(tmp_path / "bad") in str(error)
            refused += changed != data
            continue
        assert all(same_bits(got[name], arrays[name]) for name in arrays) and rest == others
        assert changed == data, "a changed file was taken, although every byte of a log is checked"
    assert refused > 0.875 * number


@pytest.mark.parametrize("number", [200, pytest.param(700, marks=pytest.mark.slow)])
def test_mutated_logs_with_forged_checksums_neither_crash_nor_change_a_sample(number, whole, tmp_path):
    data, rng = whole.read_bytes(), np.random.default_rng(11)
    arrays, _ = _content(whole)
    taken = 0
    with bounded(seconds=120, memory=20 * MIB):
        for _ in range(number):
            (tmp_path / "bad").write_bytes(reseal(_mutate(data, rng)))
            try:
                got, _ = _content(tmp_path / "bad")
            except LogError:
                continue
            for name in got:  # what is taken may be forged text, but samples have the chunk's own checksum
                assert same_bits(got[name], arrays[name])
            taken += 1
    assert taken >= number // 200  # forged texts of the result, say; others are refused, entries of the index too


@pytest.mark.parametrize("number", [100, pytest.param(300, marks=pytest.mark.slow)])
def test_mutated_logs_are_recovered_or_refused_with_true_samples(number, whole, tmp_path):
    data, rng = whole.read_bytes(), np.random.default_rng(11)
    v, ticks = vectors(120), 0
    for _ in range(number):
        (tmp_path / "bad").write_bytes(_mutate(data, rng))
        try:
            recover(tmp_path / "bad", tmp_path / "out")
        except LogError:
            continue
        log = open_log(tmp_path / "out")
        for topic in TOPICS:
            assert same_bits(log.array(topic.name), v[log.ticks(topic.name)][:, topic.index])
        ticks += log.n_ticks
    assert ticks > number * 120 / 4  # otherwise little was compared
