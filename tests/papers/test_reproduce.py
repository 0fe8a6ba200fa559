"""`cosim reproduce` as a whole: plans, README table, page; each paper's own rows are tested beside."""

import json
import re
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from cosim import papers as reproduce
from cosim.cli import commands as cli
from cosim.errors import CosimError, OutputError
from cosim.papers.claims import load
from cosim.papers.jay import figures as jay_figures
from cosim.papers.row import Planned
from cosim.report import papers_markdown as readme
from cosim.report.markdown import markers, part
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


def test_every_claim_has_a_band_that_can_be_missed(plan):
    """A row that no number can fail says nothing."""
    for p in plan:
        if p.banded:
            assert not (p.low <= 0.0 and p.high == float("inf")), p.item
            assert p.low <= p.high, p.item


def test_a_number_that_the_paper_does_not_give_has_no_claim(plan):
    """Nothing can agree with a paper that says nothing."""
    silent = ("not given", "not said", "not in the paper", "not evaluated", "not claimed", "our extension")
    for p in plan:
        if any(w in p.says for w in silent):
            assert p.kind != "claim", p.item


def test_a_claim_quotes_its_place(plan):
    for p in plan:
        places = ("section", "slide", "figure", "theorem", "I", "V", "(", "after", "title", "our extension", "stable",
                  '"close')  # fmt: skip
        if p.kind != "ours":
            assert p.says.startswith(places) or '"' in p.says, (p.item, p.says)


def test_ours_neither_agrees_nor_is_explained_and_a_derived_band_can_be_missed():
    def judged(got, *band, kind="ours"):
        return Planned("p", "i", "s", lambda: got, *band, kind=kind).judge()

    assert (judged(7.0).verdict, judged(7.0).tolerance) == ("ours", "none")
    assert judged(float("nan")).verdict == "differs"
    assert judged(7.0, 0, 8).tolerance == "0 .. 8"
    assert judged(7.0, 0, 6, kind="beyond").verdict == "differs"
    with pytest.raises(ValueError, match="without a claim"):
        Planned("p", "i", "s", lambda: 1.0, 0.0, 2.0, "because", kind="ours")


def test_readme_table_has_the_rows_of_the_code(plan):
    found, totals = readme.parsed(part(README.read_text(encoding="utf-8"), readme.NAME))
    assert tuple(found) == reproduce.PAPERS
    for paper in found:
        assert found[paper] == [p.item for p in plan if p.paper == paper], paper
        assert totals[paper][0] == sum(totals[paper][1:]) == len(found[paper])
    assert totals["all"] == tuple(sum(totals[p][i] for p in found) for i in range(6))


def test_readme_is_written_between_its_markers_only(tmp_path):
    rows = [Planned("jay", item, "s", lambda v=v: v, 0.0, 2.0).judge() for item, v in (("a | b", 1.0), ("c", 3.0))]
    path, (begin, end) = tmp_path / "README.md", markers(readme.NAME)
    path.write_text(f"before\n{begin}\nold\n{end}\nafter\n")
    readme.write(path, rows)
    text = path.read_text()
    assert text.startswith("before\n") and text.endswith("\nafter\n") and "old" not in text
    totals = {"jay": (2, 1, 0, 1, 0, 0), "all": (2, 1, 0, 1, 0, 0)}
    assert readme.parsed(part(text, readme.NAME)) == ({"jay": ["a | b", "c"]}, totals)
    readme.write(path, [Planned("lu17", "d", "s", lambda: 1.0, 0.0, 2.0).judge()])
    assert readme.parsed(part(path.read_text(), readme.NAME))[1]["all"] == (3, 2, 0, 1, 0, 0)
    path.write_text("no markers")
    with pytest.raises(OutputError, match="markers"):
        readme.write(path, rows)


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
    assert found["counts"] == {"agrees": 24, "differs_explained": 1, "differs": 0, "ours": 8, "beyond": 0}
    assert Path(found["report"]).read_text(encoding="utf-8").startswith("<!doctype html>")
    assert sorted(p.name for p in Path("folder").iterdir()) == ["reproduce-jay.csv", "reproduce-jay.html"]
    table = pd.read_csv(found["table"])
    assert list(table.item) == [row["item"] for row in found["rows"]] and len(table) == len(rows)
    bad = Planned("jay", "x", "s", lambda: 9.0, 0.0, 1.0).judge()
    monkeypatch.setattr(reproduce, "reproduce", lambda *_, **__: ([*rows, bad], []))
    assert CliRunner().invoke(cli.app, ["reproduce", "jay", "--json"]).exit_code == 1


def test_pieces_are_put_together_in_the_order_of_the_plan(monkeypatch):
    asked = [Planned("jay", str(i), "s", lambda i=i: i, 0, 9, piece=str(i % 2)) for i in range(5)]
    monkeypatch.setattr(reproduce, "_plan", lambda paper: asked)
    one, counted = reproduce.one, []
    monkeypatch.setattr(reproduce, "one", lambda paper, piece: one(paper, piece) if piece != "figures" else ["drawing"])
    rows, drawings = reproduce.reproduce("jay", workers=0, progress=lambda done, total: counted.append((done, total)))
    assert [r.got for r in rows] == [0, 1, 2, 3, 4] and drawings == ["drawing"]
    assert counted[-1] == (6, 6)


ROW = """[[row]]
kind = "claim"
item = "figure 3"
says = "section 4"
measure = "rows.settles"
with = { reconfigure = true }
band = [1.0, 2.0]
"""


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (('kind = "claim"', 'kind = "claims"'), "row 1 .figure 3.: kind = 'claims'; allowed: claim, ours, beyond"),
        (("band = [1.0, 2.0]", "band = [2.0, 1.0]"), r"band = \[2.0, 1.0\] is not \[least, largest\]"),
        (("band = [1.0, 2.0]", ""), "band is missing"),
        (("rows.settles", "rows.settled"), "measure = 'rows.settled'"),
        (("reconfigure", "reconfigured"), "measure = 'rows.settles' with {'reconfigured': True}"),
        (("says =", "say ="), "unknown key say; allowed: kind, item"),
        (('item = "figure 3"', "item = 3"), "item = 3 is no str"),
        (("band = [1.0, 2.0]", 'band = [1.0, 2.0]\nreason = "r"'), "reason, found and spread stand together"),
    ],
)
def test_a_wrong_row_is_refused_with_its_place(change, told):
    assert len(load("jay", ROW)) == 1
    with pytest.raises(ValueError, match=told):
        load("jay", ROW.replace(*change))


def test_two_rows_of_one_name_are_refused():
    with pytest.raises(ValueError, match="two rows with item = 'figure 3'"):
        load("jay", ROW + ROW)
