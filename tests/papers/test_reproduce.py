"""`cosim reproduce` as a whole: plans, README table, page; each paper's own rows are tested beside."""

import dataclasses
import json
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from cosim import papers as reproduce
from cosim.cli import commands as cli
from cosim.errors import CosimError, OutputError
from cosim.papers.jay import figures as jay_figures
from cosim.papers.row import ANY, Row, judged, ours
from cosim.report import papers_markdown as readme
from cosim.report.markdown import markers
from cosim.report.reproduce_page import render

README = Path(__file__).parents[2] / "cosim" / "papers" / "README.md"


@pytest.fixture(scope="module")
def plan():
    return reproduce.plan("all")


def test_each_paper_plans_rows_of_its_own_with_names_of_their_own(plan):
    assert list(dict.fromkeys(p.paper for p in plan)) == list(reproduce.PAPERS)
    names = [(p.paper, p.item) for p in plan]
    assert len(set(names)) == len(names)
    assert all(p.says for p in plan)


def test_every_band_can_be_missed(plan):
    """A row that no number can fail says nothing: with a claim of the paper there is a band."""
    for p in plan:
        low, high = (float(v) for v in p.tolerance.split(" .. ")) if isinstance(p, Row) else (p.low, p.high)
        if isinstance(p, Row) or p.claim or (low, high) != ANY:
            assert not (low <= 0.0 and high == float("inf")), p.item
        assert low <= high, p.item


def test_a_number_that_the_paper_does_not_give_has_no_claim(plan):
    """Nothing can agree with a paper that says nothing."""
    silent = ("not given", "not said", "not in the paper", "not printed", "not evaluated", "no errors", "no number in")
    for p in plan:
        if any(w in p.says for w in silent):
            assert not getattr(p, "claim", True), p.item
    assert sum(not getattr(p, "claim", True) for p in plan) > 40


def test_ours_neither_agrees_nor_is_explained_and_a_derived_band_can_be_missed():
    assert ours("p", "i", lambda: 7.0).judge().verdict == "ours"
    assert ours("p", "i", lambda: 7.0).judge().tolerance == "none"
    assert ours("p", "i", lambda: float("nan")).judge().verdict == "differs"
    assert ours("p", "i", lambda: 7.0, 0, 8).judge().tolerance == "0 .. 8"
    assert ours("p", "i", lambda: 7.0, 0, 6).judge().verdict == "differs"
    with pytest.raises(ValueError, match="without a claim"):
        reproduce.row.Planned("p", "i", "s", lambda: 1.0, 0.0, 2.0, "because", "cosim", claim=False)


def test_a_reason_comes_with_a_command_of_this_program(plan):
    for p in plan:
        assert bool(p.reason) <= bool(p.evidence), p.item
        assert not p.evidence or p.evidence.startswith("cosim "), p.item


def test_readme_table_has_the_rows_of_the_code(plan):
    found, totals = readme.identifiers(README.read_text(encoding="utf-8"))
    for paper in reproduce.PAPERS:
        assert found[paper] == [p.item for p in plan if p.paper == paper], paper
        assert totals[paper][0] == sum(totals[paper][1:]) == len(found[paper])
        assert totals[paper][3] == 0
    assert totals["all"] == tuple(sum(totals[p][i] for p in reproduce.PAPERS) for i in range(5))


def test_readme_is_written_between_its_markers_only(tmp_path):
    rows = [judged("jay", "a | b", "s", 1.0, 0.0, 2.0), judged("jay", "c", "s", 3.0, 0.0, 2.0)]
    path, (begin, end) = tmp_path / "README.md", markers(readme.NAME)
    path.write_text(f"before\n{begin}\nold\n{end}\nafter\n")
    readme.write(path, rows)
    text = path.read_text()
    assert text.startswith("before\n") and text.endswith("\nafter\n") and "old" not in text
    assert readme.identifiers(text) == ({"jay": ["a | b", "c"]}, {"jay": (2, 1, 0, 1, 0), "all": (2, 1, 0, 1, 0)})
    path.write_text("no markers")
    with pytest.raises(OutputError, match="markers"):
        readme.write(path, rows)


def test_an_unknown_paper_is_refused_with_a_proposal():
    with pytest.raises(CosimError, match="Did you mean 'jay'"):
        reproduce.plan("jey")


def test_page_holds_every_row_and_figure_and_nothing_from_elsewhere():
    rows = [p.judge() for p in reproduce.plan("jay")]
    html = render(rows, jay_figures.drawings())
    assert html.count('<div class="plot"') == 11
    assert html.count("<tr") == len(rows) + 1
    assert all(f"figure {n}." in html for n in range(3, 14))
    assert "<title>Jay, reproduced</title>" in html and "Five" not in html
    assert html.count("Plotly.react") >= 1 and 'src="http' not in html and "<link rel=\"stylesheet" not in html


def test_command_writes_page_and_rows_and_fails_on_a_difference(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = CliRunner().invoke(cli.app, ["reproduce", "jay", "--json", "-o", "folder"])
    assert run.exit_code == 0, run.output
    found = json.loads(run.stdout)
    assert found["counts"] == {"agrees": 32, "differs_explained": 5, "differs": 0, "ours": 2}
    assert Path(found["report"]).read_text(encoding="utf-8").startswith("<!doctype html>")
    assert sorted(p.name for p in Path("folder").iterdir()) == ["reproduce-jay.csv", "reproduce-jay.html"]
    table = pd.read_csv(found["table"])
    assert list(table.item) == [row["item"] for row in found["rows"]] and len(table) == 39
    one, bad = reproduce.one, judged("jay", "x", "s", 9.0, 0.0, 1.0)
    monkeypatch.setattr(reproduce, "one", lambda name: ([*one(name)[0], bad], []))
    assert CliRunner().invoke(cli.app, ["reproduce", "jay", "--json"]).exit_code == 1


def test_a_row_that_is_known_judges_as_itself():
    row = judged("p", "i", "s", 1.0, 0.0, 2.0, note="n")
    assert row.judge() is row
    planned = reproduce.row.Planned("p", "i", "s", lambda: (1.0, "n"), 0.0, 2.0)
    assert dataclasses.asdict(planned.judge()) == dataclasses.asdict(row)
