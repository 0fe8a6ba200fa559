"""The frames that compiled code makes of the rows of a chunk: any LZ4 library gives the content back."""

from concurrent.futures import ThreadPoolExecutor

import lz4.frame
import numpy as np
import pytest
from helpers.log_samples import AWKWARD, TOPICS, expected, same_bits, vectors, write

from actuators.object_cache import PLAIN
from cosim.log import LogError, open_log, reader
from cosim.log.chunk import GATHER, Layout
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


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_one_topic_is_read_without_the_others(tmp_path, monkeypatch, compression):
    rows = write(tmp_path / "a.mcap", pose=True, compression=compression)
    log = open_log(tmp_path / "a.mcap")
    whole = []
    load_chunk = reader.load_chunk
    monkeypatch.setattr(reader, "load_chunk", lambda *given: whole.append(1) or load_chunk(*given))
    for topic in TOPICS:
        assert same_bits(log.array(topic.name), expected(rows, topic))
        assert same_bits(log.array(topic.name, 70, 129), expected(rows, topic, np.arange(70, 129)))
    assert bool(whole) == (compression != "lz4")
    monkeypatch.setattr(reader, "PLAIN", True)
    assert same_bits(log.array(TOPICS[1].name), expected(rows, TOPICS[1]))


def test_a_file_that_was_written_to_since_it_was_opened_is_compared_as_a_whole(tmp_path):
    path = tmp_path / "a.mcap"
    write(path)
    log = open_log(path)
    held, chunk = bytearray(path.read_bytes()), log.chunks[1]
    changed = 0
    for at in range(chunk.data_offset, chunk.data_offset + chunk.data_size, 97):
        held[at] ^= 1
        path.write_bytes(held)
        with pytest.raises(LogError):
            log.array(TOPICS[1].name)
        held[at] ^= 1
        changed += 1
    path.write_bytes(held)
    assert changed > 10 and len(log.array(TOPICS[1].name)) == 230


def test_a_foreign_or_damaged_frame_raises_nothing_but_is_left_to_who_compares_all(tmp_path):
    plan, content = _filled([(i + 1, 40, 1) for i in range(7)], 50, _some_stand_still)
    packed, rng, found = bytearray(_frame(plan, content)), np.random.default_rng(5), 0
    others = [lz4.frame.compress(content.tobytes(), store_size=True, block_linked=linked) for linked in (True, False)]
    cut = [bytes(packed[:n]) for n in (0, 3, 7, 15, 18, 2000, len(packed) - 5)]
    for _ in range(300):
        wrong = packed.copy()
        wrong[rng.integers(len(wrong))] ^= 1 << rng.integers(8)
        cut.append(bytes(wrong))
    for data in (*others, *cut):
        (tmp_path / "frame").write_bytes(data)
        with open(tmp_path / "frame", "rb", buffering=0) as file:
            some = plan.frame.topics(file, 0, len(data), [3], np.empty(content.size, "u1"))
        assert not some or data in cut
        found += some
    assert 0 < found < 300  # what strikes other topics is not seen


@pytest.mark.parametrize(("plain", "times"), [(False, 200), (True, 40)])
def test_threads_that_read_topics_of_one_log_do_not_mix_them(tmp_path, monkeypatch, plain, times):
    assert GATHER.address
    monkeypatch.setattr(reader, "PLAIN", plain)
    rows = write(tmp_path / "a.mcap", ticks=1000)
    log = open_log(tmp_path / "a.mcap")
    with ThreadPoolExecutor(4) as pool:
        read = list(pool.map(lambda i: log.array(TOPICS[i % 2].name), range(times)))
    assert all(same_bits(values, expected(rows, TOPICS[i % 2])) for i, values in enumerate(read))
