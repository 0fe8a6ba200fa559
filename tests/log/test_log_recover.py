"""A log that a kill, a full disk or a bad disk has cut gives back every whole chunk."""

import os
import time

import numpy as np
import pytest
from killed import grown, killer
from log_samples import TOPICS, expected, flight_log, same_bits, vectors

from cosim.log import LogError, open_log, recover
from cosim.log.overview import log_info

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


PREPARE = """
import sys
sys.path.insert(0, {tests!r})
from log_samples import *
v = vectors(1000)
"""
# a writer tells in a file which rows it has passed
WRITE = """
told = os.open({path!r} + ".told", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
with LogWriter({path!r}, TOPICS, n_values=N_VALUES, rows_per_chunk=50) as log:
    for k in range(10**9):
        log.append(v[k % 1000])
        if k % 50 == 0 and k:
            os.write(told, b"%d\\n" % k)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and SIGKILL")
@pytest.mark.parametrize("kills", [8, pytest.param(40, marks=pytest.mark.slow)])
def test_kill_9_at_random_moments_loses_only_the_open_chunk(kills, tmp_path, request):
    v, rng = vectors(1000), np.random.default_rng(7)
    path, told = tmp_path / "killed.mcap.part", tmp_path / "killed.mcap.told"

    def wait():
        grown(told)  # the first chunk is written
        time.sleep(float(rng.uniform(0.0, 0.05)))

    write = WRITE.format(path=str(tmp_path / "killed.mcap"))
    with killer(PREPARE.format(tests=str(request.path.parents[1] / "helpers")), write) as kill:
        for _ in range(kills):
            kill(wait)
            passed = int(told.read_text().split("\n")[-2])
            begun = time.monotonic()
            report = recover(path, tmp_path / "out.mcap")
            assert time.monotonic() - begun < 60 and not report["complete"]
            ticks = np.arange(report["ticks"])
            # a chunk is written when the row after it comes, before the writer tells of that row
            assert len(ticks) % ROWS == 0 and len(ticks) >= passed
            _check(tmp_path / "out.mcap", v[ticks % 1000], ticks)
            told.unlink()
            path.unlink()
