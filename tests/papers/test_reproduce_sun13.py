"""`reproduce sun13`: the bound rows on short flights; the whole study is slow."""

import pytest

from cosim.papers.sun13 import rows as sun13
from cosim.training.flights import estimate


def test_designs_agree():
    rows = [row.judge() for row in sun13._designs()]
    assert [row.verdict for row in rows] == ["agrees", "ours", "ours"]


@pytest.mark.parametrize(("kind", "hz"), [("ofc_liquid", 2.0), ("ofc_solid", 1.0)])
def test_both_forms_follow_the_left_elevator_in_closed_loop_flight(kind, hz):
    flown = sun13._faulty(kind, hz, onset=6.0)
    f = sun13._fault(flown, kind)
    log = estimate(flown, "rfafe")
    assert 0.9 < abs(sun13._ratio(flown, log["f_hat_left"], f, hz, 8.0, 3.0 / hz)) < 1.1
    assert 0.8 < abs(sun13._airframe(flown, hz, 8.0)) < 1.15
    declared = flown.index[log["alarm"] > 0.5]
    assert 6.0 < declared[0] < 6.0 + 3.0 / hz
    assert {1.0} == set(log["culprit"][log["alarm"] > 0.5])
