"""Jobs over processes, kept line by line; a killed study goes on, results of other code are dropped."""

import json
import os
from pathlib import Path

import pytest
from worker_calls import square

from cosim.campaign import jobs
from cosim.campaign.jobs import work
from cosim.errors import OutputError


def test_jobs_are_done_once_and_a_line_cut_short_is_done_again(tmp_path):
    jobs = [(square, {"x": x}) for x in (1, 2, 3, 2)]
    seen = []
    first = work(jobs, folder=tmp_path, workers=0, progress=lambda done, total: seen.append((done, total)))
    assert [v["value"] for v in first] == [1, 4, 9, 4]
    assert seen == [(0, 3), (1, 3), (2, 3), (3, 3)]
    path = tmp_path / "results.jsonl"
    lines = path.read_text().splitlines()
    assert len(lines) == 4
    path.write_text("\n".join(lines)[:-5])  # the last one is cut
    seen.clear()
    again = work(jobs, folder=tmp_path, workers=0, progress=lambda done, total: seen.append(done))
    assert seen == [2, 3] and again == first
    assert len(path.read_text().splitlines()) == 4


def test_results_of_other_code_are_dropped(tmp_path):
    jobs_ = [(square, {"x": 2})]
    first = work(jobs_, folder=tmp_path, code="a", workers=0)
    jobs.keep(tmp_path, "a", dict.fromkeys(jobs.stored(tmp_path)[1], "kept"))
    assert work(jobs_, folder=tmp_path, code="a", workers=0) == ["kept"]
    assert work(jobs_, folder=tmp_path, code="b", workers=0) == first


def test_processes_give_the_same_values_in_order():
    jobs = [(square, {"x": x}) for x in range(5)]
    found = work(jobs, workers=2)
    assert [v["value"] for v in found] == [0, 1, 4, 9, 16]
    assert os.getpid() not in {v["pid"] for v in found}


def test_what_is_damaged_or_forged_is_done_again(tmp_path):
    """A bit that flipped in a value changes its line's digest; what `read` refuses was never a value."""
    jobs_, path = [(square, {"x": x}) for x in (2, 3)], tmp_path / "results.jsonl"
    first = work(jobs_, folder=tmp_path, workers=0)
    path.write_text(path.read_text().replace('"value": 4', '"value": 5'))
    assert work(jobs_, folder=tmp_path, workers=0) == first
    code, values = jobs.stored(tmp_path)
    jobs.keep(tmp_path, code, {key: {"value": None} for key in values})

    def read(value):
        if value["value"] is None:
            raise ValueError
        return value

    assert work(jobs_, folder=tmp_path, workers=0, read=read) == first
    listed = json.dumps([["key"], 1, jobs._digest(["key"], 1)])  # whole, and no job has such a key
    for nonsense in ("", f'{{"code": "x"}}\n{listed}', '{"code": []}', '{"code": "x"}\n\xff' + "[" * 9000):
        path.write_text(nonsense)
        assert work(jobs_, folder=tmp_path, workers=0) == first


@pytest.mark.parametrize("text", ["null\nnull", "[]", "\xff", "[" * 9000, '{"code": 1, "mine": 2}', '["mine", 1]'])
def test_a_foreign_file_is_not_overwritten(text, tmp_path):
    (tmp_path / "results.jsonl").write_text(text)
    with pytest.raises(OutputError, match=r"results\.jsonl: holds something else"):
        work([(square, {"x": 2})], folder=tmp_path, workers=0)
    assert (tmp_path / "results.jsonl").read_text() == text


def test_a_full_disk_is_told_with_the_file():
    with pytest.raises(OutputError, match=r"/dev/full: cannot be written: No space left.*Free space"):
        jobs._append(Path("/dev/full"), "line")
