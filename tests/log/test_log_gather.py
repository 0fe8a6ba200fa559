"""Reading by compiled code: the values and the refusals of the plain way, and of every byte that is no value."""

import numpy as np
import pytest
from helpers.log_samples import N_VALUES, TOPICS, same_bits, vectors, write
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from actuators.object_cache import PLAIN
from cosim.log import LogWriter, Topic, open_log, reader
from cosim.log.chunk import GATHER

pytestmark = pytest.mark.skipif(PLAIN, reason="nothing is compiled")


@pytest.fixture(autouse=True, scope="module")
def compiled():
    assert GATHER.address  # a reader does not wait for it


@pytest.mark.parametrize(("start", "stop"), [(0, None), (3, 7), (49, 151), (64, 65), (229, 230), (230, None)])
@pytest.mark.parametrize("topics", [None, [TOPICS[2].name], [t.name for t in reversed(TOPICS)]])
def test_both_ways_of_reading_give_the_same_bits(tmp_path, monkeypatch, topics, start, stop):
    write(tmp_path / "a.mcap", pose=True)
    log, counted = open_log(tmp_path / "a.mcap"), []
    monkeypatch.setattr("cosim.log.chunk.Plan.values", lambda *_: pytest.fail("numpy read it"))
    one = log.arrays(topics, start, stop)
    monkeypatch.undo()
    monkeypatch.setattr(reader, "PLAIN", True)
    monkeypatch.setattr("cosim.log.chunk.Plan.gather", lambda *_: counted.append(1))
    other = log.arrays(topics, start, stop)
    assert list(one) == list(other) and not counted
    assert all(same_bits(one[name], other[name]) for name in one)


def test_every_byte_that_is_no_value_is_compared(tmp_path):
    rows, ticks = vectors(9), 9
    with LogWriter(tmp_path / "a.mcap", TOPICS, n_values=N_VALUES, rows_per_chunk=ticks) as log:
        for row in rows:
            log.append(row)
    log = open_log(tmp_path / "a.mcap")
    ((plan, content, _),) = log._contents()
    content, out = content.copy(), np.zeros((ticks, 20))
    wanted = {0: (out.ctypes.data, 0, ticks)}
    assert plan.gather(content, 0, wanted, False) and same_bits(out, np.ascontiguousarray(rows[:, :20]))
    block = plan.blocks[1]
    for at in range(plan.size):
        content[at] ^= 1 + at % 255
        whole, only = plan.differs(content, 0) is None, plan.differs(content, 0, [1]) is None
        assert plan.gather(content, 0, {}, False) == whole
        assert plan.gather(content, 0, {1: (0, 0, 0)}, True) == only
        assert only or block.start <= at < block.start + block.rows * block.stride
        content[at] ^= 1 + at % 255
    assert not plan.gather(content, 1, {}, False)  # of other ticks


def test_a_topic_with_tags_of_three_bytes_is_read_by_both_ways_and_by_protobuf(tmp_path, monkeypatch):
    n, ticks = 2_300, 40
    wide = Topic("/state/wide", [f"x_{i}" for i in range(n)], ["-"] * n, np.arange(n)[::-1].copy())
    rows = np.random.default_rng(3).standard_normal((ticks, n))
    rows[:, ::7] = 1.5  # what stands still is a reference in LZ4
    with LogWriter(tmp_path / "a.mcap", [wide], n_values=n, rows_per_chunk=16) as log:
        for row in rows:
            log.append(row)
    assert same_bits(open_log(tmp_path / "a.mcap").arrays()[wide.name], np.ascontiguousarray(rows[:, ::-1]))
    monkeypatch.setattr(reader, "PLAIN", True)
    log = open_log(tmp_path / "a.mcap")
    assert same_bits(log.arrays()[wide.name], np.ascontiguousarray(rows[:, ::-1]))
    plan, content, _ = next(log._contents())
    content = content.copy()
    content[plan.blocks[0].start + 31 + 9 * 15 + 10 * (2047 - 15) + 2] ^= 1  # the third byte of the first such tag
    assert not plan.gather(content, 0, {}, False) and plan.differs(content, 0) is not None
    with open(tmp_path / "a.mcap", "rb") as file:
        messages = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=[wide.name])
        for row, (*_, message) in zip(rows, messages, strict=True):
            assert all(getattr(message, f"x_{i}") == row[n - 1 - i] for i in (0, 14, 15, 2046, 2047, 2299))
