"""Metrics against examples worked by hand."""

import math

import numpy as np
import pytest
from scipy import stats

from cosim.compare import metrics as m


def test_exact_bounds_of_no_event_are_the_rule_of_three():
    # by hand: 1 - 0.025^(1/300) = 0.01222
    assert m.proportion(0, 300) == pytest.approx((0.0, 0.0, 1 - 0.025 ** (1 / 300)), abs=1e-12)
    assert m.proportion(300, 300).low == pytest.approx(0.025 ** (1 / 300), abs=1e-12)
    assert m.proportion(0, 0)[1:] == (0.0, 1.0) and math.isnan(m.proportion(0, 0).value)


def test_rate_of_no_event_and_of_five():
    assert m.rate(0, 5.0) == pytest.approx((0.0, 0.0, -math.log(0.025) / 5.0))  # P(0) = exp(-rate hours)
    low, high = m.rate(5, 2.0)[1:]
    assert stats.poisson.sf(4, low * 2.0) == pytest.approx(0.025)
    assert stats.poisson.cdf(5, high * 2.0) == pytest.approx(0.025)


def test_interval_of_the_median_covers_it():
    rng = np.random.default_rng(4)
    inside = 0
    for _ in range(400):
        d = m.delays(rng.exponential(1.0, 25))
        inside += d["low"] <= math.log(2.0) <= d["high"]
    assert inside / 400 > 0.93  # nominal 0.95, exact interval is wider: 0.957 for 25


def test_the_predictive_value_is_bayes_rule_and_its_bounds_hold():
    found = m.predictive_value(90, 100, 2, 100.0, fault_rate=0.01)
    assert found.value == pytest.approx(0.009 / (0.009 + 0.02))
    assert found.low < found.value < found.high
    p, f = m.proportion(90, 100, 0.975), m.rate(2, 100.0, 0.975)  # each with half of the error
    assert found.low == pytest.approx(0.01 * p.low / (0.01 * p.low + f.high))
    assert m.predictive_value(90, 100, 0, 100.0, 0.01).value == 1.0
    assert m.predictive_value(90, 100, 0, 100.0, 1e-6).low < 1e-4  # no false alarm in 100 h shows little of 1e-6
    assert np.isnan(m.predictive_value(0, 0, 0, 1.0, 0.1).value)
    rng, held = np.random.default_rng(5), 0
    for _ in range(300):  # p = 0.8, one false alarm in 20 h
        one = m.predictive_value(rng.binomial(50, 0.8), 50, rng.poisson(5), 100.0, 0.1)
        held += one.low <= 0.08 / (0.08 + 0.05) <= one.high
    assert held >= 285


def test_a_missed_run_makes_delays_later_not_smaller():
    d = m.delays([1.0, 2.0, np.nan, 4.0, 3.0])
    assert (d["median"], d["max"], d["p95"]) == (3.0, 4.0, math.inf)
    halves = ([1.0, 2.0, 3.0, np.nan, np.nan], [np.nan, np.nan, 1.0], [1.0, 2.0, np.nan, np.nan])
    assert [m.delays(x)["median"] for x in halves] == [3.0, math.inf, math.inf]  # of an even number the later one, too
    assert m.delays([0.08, 0.795, 0.10, 1.195])["median"] == pytest.approx(0.4475)
    d = m.delays(np.arange(1.0, 31.0))  # tables of order statistics: covered with 95.7 %
    assert (d["low"], d["high"]) == (10.0, 21.0)
