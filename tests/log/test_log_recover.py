"""A log that a kill, a full disk or a bad disk has cut gives back every whole chunk."""

import numpy as np
import pytest
from log_samples import TOPICS, expected, flight_log, same_bits, vectors

from cosim.log import LogError, log_info, open_log, recover

ROWS = 50  # of a chunk, as log_samples.write


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return flight_log(tmp_path_factory.mktemp("whole"), 230)


def _ends(path):
    """Return where each chunk record of a log ends, without its message indexes."""
    return [c.end for c in open_log(path).chunks]


def _check(path, v, ticks):
    log = open_log(path)
    assert log.n_ticks == len(ticks)
    for topic in TOPICS:
        assert same_bits(log.array(topic.name), expected(v, topic, ticks))
    return log


def test_a_cut_anywhere_keeps_every_whole_chunk(whole, tmp_path):
    data, v, ends = whole.read_bytes(), vectors(230), _ends(whole)
    first = open_log(whole).chunks[0].offset
    rng = np.random.default_rng(0)
    cuts = sorted({0, 7, 8, *rng.integers(0, len(data), 60).tolist(), *ends, *(e - 1 for e in ends), len(data) - 1})
    for cut in cuts:
        (tmp_path / "cut").write_bytes(data[:cut])
        with pytest.raises(LogError):
            open_log(tmp_path / "cut")
        if cut < first:
            try:
                report = recover(tmp_path / "cut", tmp_path / "out")
            except LogError:
                continue
            assert report["ticks"] == 0
            continue
        report = recover(tmp_path / "cut", tmp_path / "out")
        kept = sum(end <= cut for end in ends)
        assert report["chunks"] == kept and report["lost"]
        log = _check(tmp_path / "out", v, np.arange(min(230, kept * ROWS)))
        assert log.metadata["run"] == {"seed": "0", "unit": "µ"} and "recovered" in log.metadata
        assert report["complete"] == log.complete
        if kept < len(ends):
            assert not log.complete


def test_a_bad_chunk_in_the_middle_costs_only_itself(whole, tmp_path):
    v, chunks = vectors(230), open_log(whole).chunks
    for number, place in ((0, 60), (2, 3000), (4, 200)):
        data = bytearray(whole.read_bytes())
        data[chunks[number].offset + place] ^= 0x10
        (tmp_path / "bad").write_bytes(data)
        report = recover(tmp_path / "bad", tmp_path / "out")
        ticks = np.array([k for k in range(230) if k // ROWS != number])
        log = _check(tmp_path / "out", v, ticks)
        assert not report["complete"] and not log.complete and log.result is None
        assert any(c["offset"] == chunks[number].offset for c in report["lost"])
        assert log_info(tmp_path / "out")["gaps"] == (0 if number == 4 else ROWS)  # the last leaves none


def test_a_whole_log_comes_back_whole(whole, tmp_path):
    report = recover(whole, tmp_path / "out")
    assert report["complete"] and not report["lost"]
    assert open_log(tmp_path / "out").result == open_log(whole).result
    _check(tmp_path / "out", vectors(230), np.arange(230))


def test_a_log_is_not_recovered_onto_itself_nor_from_nothing(whole, tmp_path):
    before = whole.read_bytes()
    with pytest.raises(LogError, match="onto itself"):
        recover(whole, whole)
    assert whole.read_bytes() == before
    for data in (b"", b"hello", before[:8], before[:500]):
        (tmp_path / "bad").write_bytes(data)
        with pytest.raises(LogError):
            recover(tmp_path / "bad", tmp_path / "out")
