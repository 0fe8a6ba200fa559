"""The frames that compiled code makes of the rows of a chunk: any LZ4 library gives the content back."""

import lz4.frame
import numpy as np
import pytest
from helpers.log_samples import AWKWARD, TOPICS, vectors, write

from actuators.native import PLAIN
from cosim.log import open_log
from cosim.log.chunk import Layout
from cosim.log.frame import MOST

pytestmark = pytest.mark.skipif(PLAIN, reason="nothing is compiled")
FIELDS = 1, 2, 14, 15, 16, 40


def _filled(topics, n, values, k0=0):
    """Return (plan, content) of n ticks of topics (channel, fields, every), whose values `values(shape)` gives."""
    plan = Layout(topics, 5_000_000).plan(k0, n)
    content = plan.template(k0)
    for number in plan.blocks:
        for _, view in plan.values(content, number):
            view[:] = values(view.shape)
    return plan, content


def _frame(plan, content, tail=b""):
    return b"".join(map(bytes, plan.frame.pack(plan.ended(tail), tail)))


def _awkward(shape):
    return np.random.default_rng(1).choice(AWKWARD, shape)


def _some_stand_still(shape):
    values = np.random.default_rng(2).standard_normal(shape)
    values[:, ::3] = values[0, ::3]
    values[shape[0] // 2 :] = values[shape[0] // 2]
    return values


CASES = {
    "noise": np.random.default_rng(0).standard_normal,
    "zero": np.zeros,
    "awkward": _awkward,
    "some stand still": _some_stand_still,
    "close to each other": lambda shape: 1.0 + 1e-12 * np.arange(shape[0])[:, None] * np.ones(shape),
}


@pytest.mark.parametrize("values", CASES.values(), ids=CASES)
@pytest.mark.parametrize("n", [1, 2, 3, 200])
def test_the_library_gives_the_content_back(n, values):
    topics = [(i + 1, count, every) for i, (count, every) in enumerate((c, e) for c in FIELDS for e in (1, 3, 200))]
    for k0 in (0, 7, 2**32 - 2):  # the sequence of a message has four bytes
        plan, content = _filled(topics, n, values, k0)
        packed = _frame(plan, content)
        assert lz4.frame.decompress(packed) == content.tobytes()
        assert len(packed) <= content.size + 4 * len(plan.blocks) + 40


def test_what_stands_still_takes_next_to_nothing_and_noise_no_more_than_itself():
    plan, content = _filled([(1, 40, 1)], 200, np.zeros)
    assert len(_frame(plan, content)) < 0.06 * content.size
    plan, content = _filled([(1, 40, 1)], 200, np.random.default_rng(0).standard_normal)
    assert 0.9 * content.size < len(_frame(plan, content)) < content.size


def test_a_topic_larger_than_a_block_and_a_tail_larger_than_one():
    plan, content = _filled([(1, 2, 1), (2, 2000, 1), (3, 1, 1)], 30, _some_stand_still)
    tail = np.random.default_rng(3).bytes(MOST + 5)
    whole = content.tobytes() + tail
    packed = _frame(plan, content, tail)
    assert lz4.frame.decompress(packed) == whole and lz4.frame.get_frame_info(packed)["content_size"] == len(whole)


def test_without_a_compiler_the_content_is_the_same(tmp_path, monkeypatch):
    write(tmp_path / "a.mcap", pose=True)
    monkeypatch.setattr("cosim.log.writer.PLAIN", True)
    monkeypatch.setattr("cosim.log.frame.Frame.pack", lambda *_: pytest.fail("compiled"))
    write(tmp_path / "b.mcap", pose=True)
    one, other = open_log(tmp_path / "a.mcap"), open_log(tmp_path / "b.mcap")
    assert [c.crc for c in one.chunks] == [c.crc for c in other.chunks]
    assert one.array(TOPICS[0].name).tobytes() == np.ascontiguousarray(vectors(230)[:, :20]).tobytes()
