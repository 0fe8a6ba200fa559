"""Reading by compiled code: the values and the refusals of the plain way, and of every byte that is no value."""

import numpy as np
import pytest
from helpers.log_samples import N_VALUES, TOPICS, same_bits, vectors, write

from actuators.object_cache import PLAIN
from cosim.log import LogWriter, open_log, reader
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
