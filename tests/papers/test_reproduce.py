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
from cosim.papers.row import ANY, Planned
from cosim.report import papers_markdown as readme
from cosim.report.markdown import markers, part
from cosim.report.reproduce_page import render

README = Path(__file__).parents[2] / "cosim" / "papers" / "README.md"


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
        assert p.kind != "claim" or not any(w in p.says for w in silent), p.item
        assert p.kind == "ours" or p.says.startswith(places) or '"' in p.says, (p.item, p.says)


def judged(got, *band, reason="", kind="claim", found=(0.55, 0.65)):
    low, high = band or ANY
    return Planned("p", "i", "s", lambda: got, low, high, reason, kind, found=found if reason else None).judge()


@pytest.mark.parametrize(
    ("kind", "got", "reason", "verdict"),
    [
        ("claim", 0.5, "", "agrees"),
        ("claim", 0.5, "why", "agrees"),
        ("claim", 0.6, "", "differs"),
        ("claim", 0.6, "why", "differs_explained"),
        ("claim", 0.52, "why", "differs"),  # a reason is no licence
        ("claim", 0.7, "why", "differs"),
        ("claim", float("nan"), "why", "differs"),
        ("ours", 0.4, "", "ours"),
        ("ours", 0.6, "", "differs"),
        ("ours", float("nan"), "", "differs"),
        ("beyond", 0.4, "", "beyond"),
        ("beyond", 0.6, "", "differs"),
    ],
)
def test_a_number_is_judged_by_its_band_and_by_what_was_found_for_a_reason(kind, got, reason, verdict):
    row = judged(got, 0.0, 0.5, reason=reason, kind=kind)
    assert row.verdict == verdict and bool(row.reason) == (verdict == "differs_explained")
    assert row.tolerance == "0 .. 0.5" + "; found 0.55 .. 0.65" * bool(reason)


def test_a_number_without_a_band_and_a_reason_without_what_was_found():
    assert judged(7.0, kind="ours").tolerance == "none"
    assert Planned("x", "y", "z", lambda: 0.6, 0, 0.5, "why").judge().verdict == "differs"  # nothing was found


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
    monkeypatch.setattr(reproduce.claims, "load", lambda paper: asked)
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
        (('kind = "claim"', 'kind = "claims"'), r"figure 3.*\n.*kind\n.* 'claim', 'ours' or 'beyond'"),
        (("band = [1.0, 2.0]", "band = [2.0, 1.0]"), r"\[2, 1\] is not \[least, largest\]"),
        (("band = [1.0, 2.0]", ""), r"band\n.*Field required"),
        (("rows.settles", "rows.settled"), "measure = 'rows.settled'"),
        (("reconfigure", "reconfigured"), "measure = 'rows.settles' with {'reconfigured': True}"),
        (("says =", "say ="), r"says\n.*Field required(.|\n)*say\n.*Extra inputs"),
        (('item = "figure 3"', "item = 3"), r"item\n.*valid string"),
        (("band = [1.0, 2.0]", 'band = [1.0, 2.0]\nreason = "r"'), "reason, found and spread stand together"),
        (("band = [1.0, 2.0]", "band = [-inf, inf]"), "a claim needs a band"),
        (("band = [1.0, 2.0]", 'band = ["1", true]'), r"band.0\n.*valid number(.|\n)*band.1\n.*valid number"),
        (('kind = "claim"', 'kind = "ours"\nreason = "r"\nfound = [1, 2]\nspread = "s"'), "without a claim"),
    ],
)
def test_a_wrong_row_is_refused_with_its_place(change, told):
    assert len(load("jay", ROW)) == 1
    with pytest.raises(ValueError, match=told):
        load("jay", ROW.replace(*change))


def test_two_rows_of_one_name_are_refused():
    with pytest.raises(ValueError, match="two rows with item = 'figure 3'"):
        load("jay", ROW + ROW)
