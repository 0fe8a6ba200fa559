"""`cosim reproduce` as a whole: plans, README table, page; each paper's own rows are tested beside."""

import json
import re
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from cosim import papers as reproduce
from cosim.cli import commands as cli
from cosim.errors import CosimError
from cosim.papers.claims import load
from cosim.papers.jay import figures as jay_figures
from cosim.papers.row import Planned
from cosim.report.reproduce_page import render


@pytest.fixture(scope="module")
def plan():
    return reproduce.plan("all")


def test_every_paper_plans_rows_that_quote_it(plan):
    """Nothing can agree with a paper that says nothing, and a row that no number can fail says nothing."""
    assert list(dict.fromkeys(p.paper for p in plan)) == list(reproduce.PAPERS)
    silent = ("not given", "not said", "not in the paper", "not evaluated", "not claimed", "our extension")
    places = ("section", "slide", "figure", "theorem", "I", "V", "(", "after", "title", "our extension", "stable",
              '"close')  # fmt: skip
    for p in plan:
        assert p.says and not (p.low <= 0.0 and p.high == float("inf")), p.item
        assert not any(w in p.says for w in silent), p.item
        assert p.says.startswith(places) or '"' in p.says, (p.item, p.says)


def judged(got, low, high, reason=""):
    return Planned("p", "i", "s", lambda: got, low, high, reason, found=(0.55, 0.65) if reason else None).judge()


@pytest.mark.parametrize(
    ("got", "reason", "verdict"),
    [
        (0.5, "", "agrees"),
        (0.5, "why", "agrees"),
        (0.6, "", "differs"),
        (0.6, "why", "differs_explained"),
        (0.52, "why", "differs"),  # a reason is no licence
        (0.7, "why", "differs"),
        (float("nan"), "why", "differs"),
    ],
)
def test_a_number_is_judged_by_its_band_and_by_what_was_found_for_a_reason(got, reason, verdict):
    row = judged(got, 0.0, 0.5, reason=reason)
    assert row.verdict == verdict and bool(row.reason) == (verdict == "differs_explained")
    assert row.tolerance == "0 .. 0.5" + "; found 0.55 .. 0.65" * bool(reason)


def test_a_reason_without_what_was_found_explains_nothing():
    assert Planned("x", "y", "z", lambda: 0.6, 0, 0.5, "why").judge().verdict == "differs"


def test_an_unknown_paper_is_refused_with_a_proposal():
    with pytest.raises(CosimError, match="Did you mean 'jay'"):
        reproduce.plan("jey")


@pytest.fixture(scope="module")
def jay():
    """The rows and drawings of the bench."""
    rows = [p.judge() for p in reproduce.plan("jay") if "in flight" not in p.item]
    return rows, jay_figures.drawings()


def test_page_holds_every_row_and_figure_and_nothing_from_elsewhere(jay):
    rows, drawings = jay
    html = render(rows, drawings)
    ours = re.sub(r"<script>.*?</script>", "", html, flags=re.S)  # the plotting library's own text differs by version
    assert ours.count('<div class="plot"') == 12
    assert ours.count("<tr") == len(rows) + 1
    assert all(f"figure {n}." in html for n in range(3, 14))
    assert "<title>Jay, reproduced</title>" in html and "Five" not in html
    assert html.count("Plotly.react") >= 1 and 'src="http' not in ours and '<link rel="stylesheet' not in html


def test_command_writes_page_and_rows_and_fails_on_a_difference(jay, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows, drawings = jay
    monkeypatch.setattr(reproduce, "reproduce", lambda *_, **__: (rows, drawings))
    run = CliRunner().invoke(cli.app, ["reproduce", "jay", "--json", "-o", "folder"])
    assert run.exit_code == 0, run.output
    found = json.loads(run.stdout)
    assert found["counts"] == {"agrees": 17, "differs_explained": 1, "differs": 0}
    assert Path(found["report"]).read_text(encoding="utf-8").startswith("<!doctype html>")
    assert sorted(p.name for p in Path("folder").iterdir()) == ["reproduce-jay.csv", "reproduce-jay.html"]
    table = pd.read_csv(found["table"])
    assert list(table.item) == [row["item"] for row in found["rows"]] and len(table) == len(rows)
    bad = Planned("jay", "x", "s", lambda: 9.0, 0.0, 1.0).judge()
    monkeypatch.setattr(reproduce, "reproduce", lambda *_, **__: ([*rows, bad], []))
    assert CliRunner().invoke(cli.app, ["reproduce", "jay", "--json"]).exit_code == 1


def test_pieces_are_put_together_in_the_order_of_the_plan(monkeypatch):
    asked = [Planned("jay", str(i), "s", lambda i=i: i, 0, 9, piece=str(i % 2)) for i in range(5)]
    monkeypatch.setattr(reproduce.claims, "load", lambda paper: asked)
    one, counted = reproduce.one, []
    monkeypatch.setattr(reproduce, "one", lambda paper, piece: one(paper, piece) if piece != "figures" else ["drawing"])
    rows, drawings = reproduce.reproduce("jay", workers=0, progress=lambda done, total: counted.append((done, total)))
    assert [r.got for r in rows] == [0, 1, 2, 3, 4] and drawings == ["drawing"]
    assert counted[-1] == (6, 6)


ROW = """[[row]]
item = "figure 3"
says = "section 4"
measure = "rows.settles"
with = { reconfigure = true }
band = [1.0, 2.0]
"""


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("band = [1.0, 2.0]", "band = [2.0, 1.0]"), r"\[2, 1\] is not \[least, largest\]"),
        (("band = [1.0, 2.0]", ""), r"band\n.*Field required"),
        (("rows.settles", "rows.settled"), "measure = 'rows.settled'"),
        (("reconfigure", "reconfigured"), "measure = 'rows.settles' with {'reconfigured': True}"),
        (("says =", "say ="), r"says\n.*Field required(.|\n)*say\n.*Extra inputs"),
        (('item = "figure 3"', "item = 3"), r"item\n.*valid string"),
        (("band = [1.0, 2.0]", 'band = [1.0, 2.0]\nreason = "r"'), "reason, found and spread stand together"),
        (("band = [1.0, 2.0]", "band = [-inf, inf]"), r"is not \[least, largest\]"),
        (("band = [1.0, 2.0]", 'band = ["1", true]'), r"band.0\n.*valid number(.|\n)*band.1\n.*valid number"),
    ],
)
def test_a_wrong_row_is_refused_with_its_place(change, told):
    assert len(load("jay", ROW)) == 1
    with pytest.raises(ValueError, match=told):
        load("jay", ROW.replace(*change))


def test_two_rows_of_one_name_are_refused():
    with pytest.raises(ValueError, match="two rows with item = 'figure 3'"):
        load("jay", ROW + ROW)
