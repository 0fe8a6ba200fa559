"""Every claim can fail: something is broken in one place, and its row differs."""

import inspect
from collections import Counter
from pathlib import Path

import mutants
import numpy as np
import pytest

import cosim.papers
from cosim.papers import PAPERS, plan, proof
from cosim.papers.broken import Break, breaks, chosen, edit, place
from cosim.papers.broken import proof as proof_of
from cosim.papers.row import ANY


@pytest.mark.parametrize("paper", PAPERS)
def test_each_claim_that_agrees_is_broken_by_something(paper):
    """What differs for a reason has failed already; of the other claims none is left out."""
    rows = plan(paper)
    assert [p.item for p in rows if (p.low, p.high) == ANY] == []
    proven = {p.item for of in breaks(paper) for p in chosen(rows, of)}
    left = [p.item for p in rows if p.kind == "claim" and not p.reason and p.item not in proven]
    assert left == []


def test_the_readme_counts_what_is_broken():
    n = Counter(of.kind for paper in PAPERS for of in breaks(paper))
    text = (Path(cosim.papers.__file__).parent / "README.md").read_text(encoding="utf-8")
    said = (f"{n['equation']} breaks of an equation, {n['method']} of a parameter of the method, {n['flown']} of what "
            f"is flown, {n['option']} of an option")  # fmt: skip
    assert said in " ".join(text.split())


def test_rows_of_the_bench_see_what_is_broken():
    found = proof_of("jay", lambda of: "in flight" not in " ".join(of.rows))
    assert len(found) > 15 and [b for b in found if not b.seen] == []


def test_a_break_that_names_no_row_or_another_kind_is_an_error():
    at = {"what": "a break", "at": "cosim.papers.jay.bench.bench", "was": "t = ", "now": "t = 1.0 + "}
    with pytest.raises(ValueError, match="a break: no row has 'figure 99' in it"):
        chosen(plan("jay"), Break(**at, rows=["figure 99"]))
    with pytest.raises(ValueError, match="'equation', 'method', 'flown' or 'option'"):
        Break(**at, rows=[], kind="noise")


def test_a_function_is_changed_while_it_is_broken_and_put_back():
    from cosim.papers.jay import bench

    before = bench.bench()["R1"]
    with edit("cosim.papers.jay.bench.bench", 'params("nozzle")', 'params("nozzle", R=1.0)'):
        assert not np.array_equal(bench.bench()["R1"], before)
    assert np.array_equal(bench.bench()["R1"], before)


@pytest.mark.slow
@pytest.mark.parametrize("paper", PAPERS)
def test_every_break_is_seen(paper):
    assert [(b.item, b.what, b.got) for b in proof(paper, workers=0) if not b.seen] == []


def test_the_paper_s_equations_are_seen_broken(monkeypatch):
    """Mutations that every row of the bench once survived: the factor 2 of (4), (13), (30), (36), K_f = 0. A filter
    that estimates nothing is seen by 20 seeds; all hundred fly among the slow ones."""
    monkeypatch.setattr("cosim.papers.lu17.bench.SEEDS", 20)
    named = ("(4): 2.0", "(13):", "(30):", "(36):", "K_f of (29)", "another piston area")
    found = proof_of("lu17", lambda of: any(word in of.what for word in named))
    assert len(found) > 10 and [b for b in found if not b.seen] == []


def test_the_code_of_a_function_is_changed_where_nothing_is_compiled_only():
    with pytest.raises(RuntimeError, match="NUMBA_DISABLE_JIT=1"), edit("fdi.hydraulic.rtsekf.correct", "gamma", "0.0"):
        pass


@pytest.mark.parametrize("paper", PAPERS)
def test_each_break_finds_its_place(paper):
    """The text that is changed stands in its function once; another place would break something else."""
    for b in breaks(paper):
        function = place(b.at)
        assert inspect.getsource(getattr(function, "py_func", function)).count(b.was) == 1, b


@pytest.mark.parametrize("paper", mutants.METHODS)
def test_mutants_are_drawn_by_a_seed_and_change_one_place(paper):
    drawn = mutants._drawn(paper, 3, 5)
    assert drawn == mutants._drawn(paper, 3, 5) != mutants._drawn(paper, 4, 5)
    for m in drawn:
        name, text = mutants._function(m["text"], m["line"])
        whole = (mutants.ROOT / m["file"]).read_text(encoding="utf-8")
        assert (name, text) != mutants._function(whole, m["line"])


def test_a_number_that_json_cannot_hold_is_null(monkeypatch):
    import json

    from typer.testing import CliRunner

    from cosim import papers
    from cosim.cli import commands as cli

    found = [papers.Broken("jay", "a", "b", float("inf"), "0 .. 1", True)]
    monkeypatch.setattr(papers, "proof", lambda *_, **__: found)
    told = CliRunner().invoke(cli.app, ["reproduce", "jay", "--break", "--json"])
    assert told.exit_code == 0 and json.loads(told.stdout)["broken"][0]["got"] is None
