"""Studies: jobs over processes, kept line by line; a killed study goes on, results of other code are dropped."""

import json
import os

import pytest

from cosim.papers import studies as study


def square(x):
    return {"pid": os.getpid(), "value": x * x}


def test_jobs_are_done_once_and_a_line_cut_short_is_done_again(tmp_path):
    jobs = [(square, {"x": x}) for x in (1, 2, 3, 2)]
    seen = []
    first = study.work(jobs, folder=tmp_path, workers=0, progress=lambda done, total: seen.append((done, total)))
    assert [v["value"] for v in first] == [1, 4, 9, 4]
    assert seen == [(0, 3), (1, 3), (2, 3), (3, 3)]
    path = tmp_path / "results.jsonl"
    lines = path.read_text().splitlines()
    assert len(lines) == 4
    path.write_text("\n".join(lines)[:-5])  # the last one is cut
    seen.clear()
    again = study.work(jobs, folder=tmp_path, workers=0, progress=lambda done, total: seen.append(done))
    assert seen == [2, 3] and again == first
    assert len(path.read_text().splitlines()) == 4


def test_results_of_other_code_are_dropped(tmp_path):
    jobs = [(square, {"x": 2})]
    study.work(jobs, folder=tmp_path, code="a", workers=0)
    path = tmp_path / "results.jsonl"
    key = json.loads(path.read_text().splitlines()[1])[0]
    path.write_text(json.dumps({"code": "a"}) + "\n" + json.dumps([key, "kept"]) + "\n")
    assert study.work(jobs, folder=tmp_path, code="a", workers=0) == ["kept"]
    assert study.work(jobs, folder=tmp_path, code="b", workers=0)[0]["value"] == 4


def test_processes_give_the_same_values_in_order():
    jobs = [(square, {"x": x}) for x in range(5)]
    found = study.work(jobs, workers=2)
    assert [v["value"] for v in found] == [0, 1, 4, 9, 16]
    assert os.getpid() not in {v["pid"] for v in found}


def made():
    jobs = [(square, {"x": 3})]
    rows = lambda options, values: [("what [m]", ("x", "y [mm]>"), [["[a]", values[0]["value"]], ["b", None]])]  # noqa: E731
    return [study.Part("one", "a question", lambda options: jobs, rows)]


def test_the_command_prints_tables_helps_and_refuses(tmp_path, capsys):
    call = {"module": "cosim.x_study", "about": "What is asked.", "parts": made(), "seeds": 3, "folder": str(tmp_path)}
    assert study.main(**call, argv=["one", "--workers", "0"]) == 0
    shown = capsys.readouterr().out
    assert all(word in shown for word in ("what [m]", "y [mm]", "[a]", "9", "-"))
    assert study.main(**call, argv=["two"]) == 2
    assert "no part 'two'; parts: one" in capsys.readouterr().err
    assert study.main(**call, argv=["--seeds", "0"]) == 2
    with pytest.raises(SystemExit) as stop:
        study.main(**call, argv=["--help"])
    assert stop.value.code == 0 and "a question" in capsys.readouterr().out
