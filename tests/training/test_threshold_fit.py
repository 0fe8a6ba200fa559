"""A threshold from fault-free flights: what it grows with, and how often a flight passes it."""

import numpy as np
import pytest

from cosim.errors import DesignError
from cosim.training.threshold_fit import exceeded, limit, quantile


def _flights(rng, number, blocks=60):
    """Return flights whose statistic is noise of size 1 + 2 gust; each has a gust of its own, seen by the threshold."""
    out = []
    for gust in rng.uniform(0.0, 2.0, number):
        y = np.abs(rng.standard_normal(blocks)) * (1.0 + 2.0 * gust)
        out.append(np.stack([y, np.ones(blocks), np.full(blocks, gust)], axis=1))
    return out


def test_weights_follow_what_the_statistic_grows_with():
    rows = np.concatenate(_flights(np.random.default_rng(0), 200))
    w = quantile(rows[:, 0], rows[:, 1:], 0.99)
    assert w[1] / w[0] == pytest.approx(2.0, rel=0.2)


def test_new_flights_pass_the_limit_about_as_often_as_asked():
    w, found = limit(_flights(np.random.default_rng(1), 300), 1e-2)
    new = [(f[:, 0] > f[:, 1:] @ w).any() for f in _flights(np.random.default_rng(2), 2000)]
    assert 0.002 < np.mean(new) < 0.03
    assert found["largest"] <= 1.0  # of the flights that made it


def test_less_probability_is_a_higher_limit():
    largest = np.random.default_rng(3).exponential(size=500)
    assert exceeded(largest, 1e-4) > exceeded(largest, 1e-3) >= largest.max()


def test_a_kind_that_few_flights_are_of_is_held_to_the_probability_by_itself():
    rng = np.random.default_rng(4)
    kinds = ["severe" if k % 20 == 0 else "calm" for k in range(400)]
    flights = [np.array([[(4.0 if kind == "severe" else 1.0) * rng.exponential(), 1.0]]) for kind in kinds]
    new = 4.0 * rng.exponential(size=20_000)
    passed = [(new > limit(flights, 1e-3, kinds=own)[0][0]).mean() for own in (None, kinds)]
    assert passed[1] < 2e-3 < 4e-3 < passed[0]


def test_a_threshold_is_nowhere_nothing():
    flights = [np.array([[1.0, 1.0, 5.0], [2.0, 1.0, 10.0]])] * 10  # all that is seen grows with the gust
    w, _ = limit(flights, 1e-3)
    assert w[0] > 0.0


def test_flights_that_never_show_a_statistic_are_refused_with_its_name():
    with pytest.raises(DesignError, match=r"lpv_smo, swing.*more flights"):
        limit([np.zeros((0, 3))] * 10, 1e-3, "lpv_smo, swing")
