"""[Jay] reproduced: every row of the bench is in its band, and what stands behind the numbers."""

import numpy as np
import pytest

from cosim.papers.claims import load
from cosim.papers.jay.bench import DT, SEEDS, bench


@pytest.fixture(scope="module")
def rows():
    return [p.judge() for p in load("jay") if "in flight" not in p.item]


def test_no_row_differs_and_only_figure_5_is_explained(rows):
    """Bands hold what is printed: settling at 2.0 and 2.5 mm, the three numbers of section 4.4."""
    assert [r for r in rows if r.verdict == "differs"] == []
    assert [r.item.split(",")[0] for r in rows if r.verdict == "differs_explained"] == ["figure 5"]


def test_the_numbers_that_reasons_name_are_printed_beside_them(rows):
    """1.03, 0.18 and 0.14, where 1, 0.2 and 0.1 are printed, is what the recovered constants give (derived)."""
    [note] = [r.note for r in rows if "resistance + 5 %: farthest" in r.item]
    assert "1.03, 0.18 mm, 0.14 A; two numbers that are not printed" in note


def test_the_innovation_is_white_with_unit_variance_only_for_the_noise_that_the_filter_knows(rows):
    [row] = [r for r in rows if "ten times the variance" in r.item]
    assert row.got == pytest.approx(1.0, abs=0.1)
    twice = [np.var(bench(seed=s, noise=2.0)["eta_bar"][20:]) for s in SEEDS]
    assert 10.0 * np.mean(twice) == pytest.approx(4.0, rel=0.1)


def test_position_scale_settles_at_the_threshold_and_crosses_only_in_the_overshoot():
    """At 2.5 mm of (faulty) reading R1 is 0.25 * 2.0 = 0.500 mm: it is the overshoot, of 34 %, that crosses."""
    run = bench(figure=8, noise=0.0)
    assert np.abs(run["R1"][round(2.0 / DT) :]).max() == pytest.approx(0.5e-3 * 1.34, rel=0.02)
    assert run["R1"][round(7.0 / DT) - 1] == pytest.approx(0.5e-3, abs=2e-6)


def test_bench_without_noise_and_fault_has_no_residual():
    run = bench(noise=0.0)
    for name, most in {"R1": 1e-8, "R2": 1e-4, "eta_bar": 1e-4}.items():
        assert np.abs(run[name]).max() < most
