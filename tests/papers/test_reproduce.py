"""`reproduce`: verdicts, claims as data, page and command."""

import inspect
import json
import re
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from cosim import papers
from cosim.cli import commands as cli
from cosim.errors import CosimError
from cosim.papers.claims import Claim, load
from cosim.report.reproduce_page import render


def test_every_claim_quotes_its_paper_can_fail_and_names_a_function_with_its_arguments():
    plan = papers.plan("all")
    assert list(dict.fromkeys(c.paper for c in plan)) == list(papers.PAPERS)
    for c in plan:
        assert re.match(r'section|slide|figure|theorem|[IV]+[.:]|\(|after|"', c.says), (c.item, c.says)
        assert not (c.band[0] <= 0.0 and c.band[1] == float("inf")), c.item
        for other in ({}, *c.beside.values()):
            inspect.signature(c.function()).bind(**c.with_ | other)


def claim(**more):
    return Claim.model_validate({"paper": "p", "item": "i", "says": "s", "measure": "m.f", "band": (0.0, 0.5), **more})


@pytest.mark.parametrize(
    ("got", "explained", "verdict"),
    [
        (0.5, False, "agrees"),
        (0.5, True, "agrees"),
        (0.6, False, "differs"),
        (0.6, True, "differs_explained"),
        (0.52, True, "differs"),  # a reason is no licence
        (float("nan"), True, "differs"),
    ],
)
def test_a_number_is_judged_by_its_band_and_by_what_was_found_for_a_reason(got, explained, verdict):
    why = {"reason": "why", "found": (0.55, 0.65), "spread": "s"} if explained else {}
    row = claim(**why).row(got)
    assert row.verdict == verdict and bool(row.reason) == (verdict == "differs_explained")
    assert row.tolerance == "0 .. 0.5" + "; found 0.55 .. 0.65" * explained


ROW = '[[row]]\nitem = "figure 3"\nsays = "section 4"\nmeasure = "rows.settles"\nband = [1.0, 2.0]\n'


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("band = [1.0, 2.0]", "band = [2.0, 1.0]"), r"\[2, 1\] is not \[least, largest\]"),
        (("says =", "say ="), r"says\n.*Field required(.|\n)*say\n.*Extra inputs"),
        (("band = [1.0, 2.0]", 'band = [1.0, 2.0]\nreason = "r"'), "reason, found and spread stand together"),
        ((ROW, ROW + ROW), "two rows with the same item"),
    ],
)
def test_a_wrong_row_is_refused(change, message):
    assert len(load("jay", ROW)) == 1
    with pytest.raises(ValueError, match=message):
        load("jay", ROW.replace(*change))


def test_an_unknown_paper_is_refused_with_a_proposal():
    with pytest.raises(CosimError, match="Did you mean 'jay'"):
        papers.plan("jey")


@pytest.fixture(scope="module")
def jay():
    return papers.reproduce("jay", workers=0)


def test_page_holds_every_row_and_figure_and_nothing_from_elsewhere(jay):
    rows, drawings = jay
    html = render(rows, drawings)
    ours = re.sub(r"<script>.*?</script>", "", html, flags=re.S)  # the plotting library's own text differs by version
    assert ours.count('<div class="plot"') == 12 and ours.count("<tr") == len(rows) + 1
    assert all(f"figure {n}." in html for n in range(3, 14))
    assert 'src="http' not in ours and '<link rel="stylesheet' not in html
    assert all((d.look.endswith(".") and p.unit) or p.title == "innovation mean" for d in drawings for p in d.panels)


def test_command_writes_page_and_rows_and_fails_on_a_difference(jay, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows, drawings = jay
    monkeypatch.setattr(papers, "reproduce", lambda *_, **__: (rows, drawings))
    run = CliRunner().invoke(cli.app, ["reproduce", "jay", "--json", "-o", "folder"])
    assert run.exit_code == 0, run.output
    found = json.loads(run.stdout)
    assert found["counts"] == {"agrees": 17, "differs_explained": 1, "differs": 0}
    assert Path(found["report"]).read_text(encoding="utf-8").startswith("<!doctype html>")
    assert list(pd.read_csv(found["table"]).item) == [row["item"] for row in found["rows"]]
    monkeypatch.setattr(papers, "reproduce", lambda *_, **__: ([*rows, claim().row(9.0)], []))
    assert CliRunner().invoke(cli.app, ["reproduce", "jay", "--json"]).exit_code == 1


def test_pieces_are_put_together_in_the_order_of_the_plan(monkeypatch):
    plan = [claim(item=str(i), piece=str(i % 2)) for i in range(5)]
    monkeypatch.setattr(papers.claims, "load", lambda paper: plan)
    made = {str(k): [c.row(i / 10) for i, c in enumerate(plan) if c.piece == str(k)] for k in (0, 1)}
    monkeypatch.setattr(papers, "one", lambda paper, piece: made.get(piece, ["drawing"]))
    counted = []
    rows, drawings = papers.reproduce("jay", workers=0, progress=lambda done, total: counted.append((done, total)))
    assert [r.item for r in rows] == list("01234") and drawings == ["drawing"] and counted[-1] == (6, 6)
