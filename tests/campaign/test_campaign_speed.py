"""One process against two on the same flights: their rows are equal."""

import campaign_speed
import pytest

from cosim.scenario import load_scenario

FEW = [load_scenario("cruise", ["duration_s=1", "detectors.enabled=[]", f"seed={1_000_000 + i}"]) for i in range(3)]


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_rows_of_this_and_other_processes_are_equal_and_a_changed_value_is_not(workers):
    one, two = (campaign_speed.measure(FEW, n) for n in (0, workers))
    assert one["outcomes"] == {"completed": 3} and one["flown_s"] == pytest.approx(3.0)
    assert campaign_speed.same(one["rows"], two["rows"])
    changed = two["rows"].copy()
    changed.loc[1, "sim_time_s"] += 1e-12
    assert not campaign_speed.same(one["rows"], changed)
