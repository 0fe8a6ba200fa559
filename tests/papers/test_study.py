"""Studies: the command prints the tables of a part, and refuses what there is not."""

import json

import pytest
from typer.testing import CliRunner

from cosim.cli import commands as cli
from cosim.papers import studies
from cosim.papers.studies import Question


def square(x):
    return {"value": x * x}


def tables(options, values):
    return [("what [m]", ("x", "y>"), [["[a]", values[0]["value"]], ["b", None]], ["so"])]


@pytest.fixture
def study(monkeypatch):
    class Study:
        ABOUT = "What is asked."

        @staticmethod
        def questions():
            return [Question("one", "a question", lambda options: [(square, {"x": options.seeds})], tables, seeds=3)]

    monkeypatch.setattr(studies, "known", lambda name: Study)


def asked(*arguments):
    return CliRunner().invoke(cli.app, ["study", "ema", *arguments])


def test_the_command_prints_tables_and_keeps_results(study, tmp_path, one_process):
    shown = asked("one", "-o", str(tmp_path))
    assert shown.exit_code == 0, shown.output
    assert all(word in shown.stdout for word in ("what [m]", "[a]", "9", "–", "so"))
    assert len((tmp_path / "results.jsonl").read_text().splitlines()) == 2
    found = json.loads(asked("one", "--seeds", "4", "--json", "-o", str(tmp_path)).stdout)
    assert found["parts"][0]["tables"][0]["rows"][0] == ["[a]", 16]


def test_the_command_helps_and_refuses(study):
    assert "a question" in asked("--list").stdout
    refused = asked("two")
    assert refused.exit_code == 2 and "has no question 'two'; allowed: one" in refused.stderr
    assert asked("one", "--seeds", "0").exit_code == 2


def test_without_a_name_the_studies_are_listed():
    told = CliRunner().invoke(cli.app, ["study"])
    assert told.exit_code == 0 and all(name in told.stdout for name in studies.NAMES)


def test_an_unknown_study_is_refused_with_a_proposal():
    refused = CliRunner().invoke(cli.app, ["study", "manoevres"])
    assert refused.exit_code == 2 and "Did you mean 'manoeuvres'" in refused.stderr
