"""Metrics against examples worked by hand, and against the libraries that define the same thing."""

import math

import numpy as np
import pytest
from scipy import stats

from cosim.compare import metrics as m


def test_exact_bounds_of_no_event_are_the_rule_of_three():
    # by hand: 1 - 0.05^(1/300) = 0.00994, 1 - 0.025^(1/300) = 0.01222; 0.05^(1/3000) likewise
    assert m.upper_bound(0, 300) == pytest.approx(1 - 0.05 ** (1 / 300), abs=1e-12)
    assert m.upper_bound(0, 300) < 0.01 and m.upper_bound(0, 3000) < 0.001
    assert m.clopper_pearson(0, 300) == pytest.approx((0.0, 0.0, 1 - 0.025 ** (1 / 300)), abs=1e-12)
    assert m.clopper_pearson(300, 300).low == pytest.approx(0.025 ** (1 / 300), abs=1e-12)


@pytest.mark.parametrize("k, n", [(0, 10), (1, 10), (3, 10), (10, 10), (7, 300)])
def test_proportions_agree_with_scipy_and_statsmodels(k, n):
    exact = stats.binomtest(k, n).proportion_ci(0.95, method="exact")
    score = stats.binomtest(k, n).proportion_ci(0.95, method="wilson")
    assert m.clopper_pearson(k, n)[1:] == pytest.approx((exact.low, exact.high), abs=1e-9)
    assert m.wilson(k, n)[1:] == pytest.approx((score.low, score.high), abs=1e-9)
    proportion = pytest.importorskip("statsmodels.stats.proportion")
    assert m.clopper_pearson(k, n)[1:] == pytest.approx(proportion.proportion_confint(k, n, method="beta"), abs=1e-9)
    assert m.wilson(k, n)[1:] == pytest.approx(proportion.proportion_confint(k, n, method="wilson"), abs=1e-9)


def test_wilson_by_hand():
    # 3 of 10, z = 1.96: centre (0.3 + 0.19207) / 1.38415, half-width 1.96 sqrt(0.021 + 0.009604) / 1.38415
    z2 = 1.959964**2
    centre, half = (0.3 + z2 / 20) / (1 + z2 / 10), math.sqrt(z2 * (0.021 + z2 / 400)) / (1 + z2 / 10)
    assert m.wilson(3, 10) == pytest.approx((0.3, centre - half, centre + half), abs=1e-6)


def test_rate_of_no_event_and_of_five():
    assert m.rate(0, 5.0) == pytest.approx((0.0, 0.0, -math.log(0.025) / 5.0))  # P(0) = exp(-rate hours)
    low, high = m.rate(5, 2.0)[1:]
    assert stats.poisson.sf(4, low * 2.0) == pytest.approx(0.025)
    assert stats.poisson.cdf(5, high * 2.0) == pytest.approx(0.025)


@pytest.mark.parametrize("call", [lambda: m.wilson(1, 0), lambda: m.clopper_pearson(3, 2), lambda: m.rate(1, 0.0)])
def test_impossible_counts_are_refused(call):
    with pytest.raises(ValueError, match="is no count"):
        call()


def test_delays_by_hand_with_a_missed_run():
    d = m.delays([1.0, 2.0, np.nan, 4.0, 3.0])
    assert (d.runs, d.detected, d.median, d.largest, d.p95) == (5, 4, 3.0, 4.0, math.inf)
    assert d.missed.value == 0.2
    # S falls to 4/5, 3/5, 2/5 at 1, 2, 3; area up to 4: 1 + 0.8 + 0.6 + 0.4
    assert d.restricted_mean == pytest.approx(2.8)


def test_a_missed_run_makes_the_median_later_not_smaller():
    seen = m.delays([1.0, 2.0, 3.0])
    missed = m.delays([1.0, 2.0, 3.0, np.nan, np.nan])
    assert missed.median == 3.0 > seen.median == 2.0
    assert m.delays([np.nan, np.nan, 1.0]).median == math.inf


def test_interval_of_the_median_covers_it():
    rng = np.random.default_rng(4)
    inside = 0
    for _ in range(400):
        d = m.delays(rng.exponential(1.0, 25))
        inside += d.median_low <= math.log(2.0) <= d.median_high
    assert inside / 400 > 0.93  # nominal 0.95, exact interval is wider: 0.957 for 25


def test_kaplan_meier_by_hand_and_by_statsmodels():
    delay, watched = np.array([1.0, np.nan, 2.0, 3.0, np.nan]), np.array([9.0, 1.5, 9.0, 9.0, 9.0])
    times, survival = m.kaplan_meier(delay, watched)
    assert list(times) == [1.0, 2.0, 3.0]
    assert survival == pytest.approx([4 / 5, 4 / 5 * 2 / 3, 4 / 5 * 2 / 3 * 1 / 2])  # at risk: 5, 3, 2
    survfunc = pytest.importorskip("statsmodels.duration.survfunc")
    seen = np.isfinite(delay)
    theirs = survfunc.SurvfuncRight(np.where(seen, delay, watched), seen.astype(int))
    assert survival == pytest.approx(theirs.surv_prob)


def test_confusion_keeps_none_and_ambiguous_as_columns():
    c = m.confusion(["a", "a", "b", "b"], ["a", None, "ambiguous", "c"])
    assert c.classes == ("a", "b") and c.verdicts == ("a", "b", "c", "none", "ambiguous")
    assert c.counts.tolist() == [[1, 0, 0, 1, 0], [0, 0, 1, 0, 1]]
    assert c.accuracy.value == 0.25


def test_confusion_agrees_with_scikit_learn():
    sk = pytest.importorskip("sklearn.metrics")
    rng = np.random.default_rng(5)
    truth, verdict = rng.choice(["a", "b", "c"], 200), rng.choice(["a", "b", "c", "none", "ambiguous"], 200)
    c = m.confusion(truth, verdict)
    theirs = sk.confusion_matrix(truth, verdict, labels=c.verdicts)
    assert c.counts.tolist() == theirs[:3].tolist()
    assert c.accuracy.value == pytest.approx(sk.accuracy_score(truth, verdict))


def test_roc_by_hand():
    curve = m.roc([1.0, 2.0], [2.0, 3.0])
    assert curve.threshold.tolist() == [math.inf, 3.0, 2.0, 1.0]
    assert curve.false_alarm.tolist() == [0.0, 0.0, 0.5, 1.0]
    assert curve.detection.tolist() == [0.0, 0.5, 1.0, 1.0]
    assert m.auc(curve) == 0.875  # 3 of 4 pairs are ordered, one is a tie


def test_area_agrees_with_scikit_learn_and_mann_whitney():
    rng = np.random.default_rng(6)
    healthy, faulty = np.round(rng.normal(0, 1, 60), 1), np.round(rng.normal(1, 1, 40), 1)  # rounded: with ties
    area = m.auc(m.roc(healthy, faulty))
    assert area == pytest.approx(stats.mannwhitneyu(faulty, healthy).statistic / 2400)
    sk = pytest.importorskip("sklearn.metrics")
    labels = np.repeat([0, 1], [60, 40])
    assert area == pytest.approx(sk.roc_auc_score(labels, np.concatenate([healthy, faulty])))


def test_roc_refuses_a_run_without_a_number():
    with pytest.raises(ValueError, match="all with a number"):
        m.roc([1.0, np.nan], [2.0])


def test_threshold_lets_no_more_runs_alarm_than_asked():
    healthy = np.arange(1.0, 101.0)
    at, bound = m.threshold(healthy, 0.02)
    assert np.sum(healthy >= at) == 2 and at > 98.0
    assert bound == pytest.approx(m.upper_bound(2, 100))
    assert m.threshold(healthy, 0.0)[0] > 100.0


def test_trade_moves_from_early_to_safe():
    delay = np.array([1.0, 2.0])
    points = m.trade([0.5, 0.9], lambda t: delay * t, [0.6, 1.0])
    assert [(t, p.value, d.median) for t, p, d in points] == [(0.6, 0.5, 0.6), (1.0, 0.0, 1.0)]


def test_estimate_pools_runs():
    e = m.estimate([3.0, 4.0], [1.0, -1.0], [5.0, 7.0])
    assert e.rmse.value == pytest.approx(math.sqrt(12.5)) and e.bias.value == 0.0 and e.largest == 7.0
    assert e.rmse.low >= 3.0 and e.rmse.high <= 4.0 and (e.bias.low, e.bias.high) == (-1.0, 1.0)
    assert m.estimate([3.0, 4.0], [1.0, -1.0], [5.0, 7.0]) == e  # seeded


def test_nis_and_its_bounds():
    # Bar-Shalom 2001, example of 50 runs with 2 states: [1.5, 2.6] from chi-square with 100 degrees of freedom
    assert m.nis_bounds(50, 2) == pytest.approx((74.2 / 50, 129.6 / 50), abs=1e-2)
    S = np.array([[2.0, 1.0], [1.0, 3.0]])
    e = np.random.default_rng(7).multivariate_normal([0, 0], S, 5000)
    values = m.nis(e, S)
    assert values[0] == pytest.approx(e[0] @ np.linalg.inv(S) @ e[0])
    low, high = m.nis_bounds(5000, 2, confidence=0.999)
    assert low < values.mean() < high
    assert not low < m.nis(1.1 * e, S).mean() < high  # a covariance 20 % too small is noticed
    assert m.nis(e, np.broadcast_to(S, (5000, 2, 2))) == pytest.approx(values)


def test_whiteness_by_hand_and_by_statsmodels():
    # alternating +1, -1: rho_1 = -(n - 1) / n, so Q = n (n + 2) ((n-1)/n)^2 / (n - 1) = (n + 2)(n - 1)/n
    x = np.tile([1.0, -1.0], 50)
    assert m.ljung_box(x, lags=1).statistic == pytest.approx(102 * 99 / 100)
    assert m.ljung_box(x, lags=1).p_value < 1e-6
    noise = np.random.default_rng(8).normal(size=400)
    assert m.ljung_box(noise).p_value > 0.01
    diagnostic = pytest.importorskip("statsmodels.stats.diagnostic")
    theirs = diagnostic.acorr_ljungbox(noise, lags=[20])
    assert m.ljung_box(noise) == pytest.approx((theirs["lb_stat"].iloc[0], theirs["lb_pvalue"].iloc[0]))


def test_mean_of_innovations_is_students_t():
    x = np.random.default_rng(9).normal(0.3, 1.0, 100)
    theirs = stats.ttest_1samp(x, 0.0)
    assert m.mean_test(x) == pytest.approx((theirs.statistic, theirs.pvalue))


def test_fault_to_noise_gap_takes_the_worst_frequency():
    fault = np.array([[[2.0]], [[1.0j]]])
    disturbance = np.array([[[0.1]], [[0.25]]])
    assert m.fault_to_noise(fault, disturbance) == pytest.approx(4.0)
    assert m.fault_to_noise(fault, 0 * disturbance) == math.inf
