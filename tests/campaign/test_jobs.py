"""Jobs over processes, kept line by line; a killed study goes on, results of other code are dropped."""

import json
import os

from cosim.campaign.jobs import work


def square(x):
    return {"pid": os.getpid(), "value": x * x}


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
    jobs = [(square, {"x": 2})]
    work(jobs, folder=tmp_path, code="a", workers=0)
    path = tmp_path / "results.jsonl"
    key = json.loads(path.read_text().splitlines()[1])[0]
    path.write_text(json.dumps({"code": "a"}) + "\n" + json.dumps([key, "kept"]) + "\n")
    assert work(jobs, folder=tmp_path, code="a", workers=0) == ["kept"]
    assert work(jobs, folder=tmp_path, code="b", workers=0)[0]["value"] == 4


def test_processes_give_the_same_values_in_order():
    jobs = [(square, {"x": x}) for x in range(5)]
    found = work(jobs, workers=2)
    assert [v["value"] for v in found] == [0, 1, 4, 9, 16]
    assert os.getpid() not in {v["pid"] for v in found}
