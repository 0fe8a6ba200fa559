"""Curves of a comparison: operating points and probability of detection, as frames with bounds."""

import numpy as np
import pandas as pd
import pytest
from test_stats import hand_made

from cosim.compare import Comparison, metrics, stats
from cosim.errors import CosimError


@pytest.fixture
def found():
    rows = hand_made()
    return Comparison(rows, stats.detectors(rows), rows["run"].nunique(), 0, "hand made")


def many(n=200):
    """Return a Comparison of `n` oscillations at one frequency, seen by a logistic law of their amplitude."""
    rng, one = np.random.default_rng(1), hand_made()
    first = one[(one["id"] == "iotsekf") & one["frequency_hz"].notna()].head(1)
    rows = pd.concat([first] * n, ignore_index=True)
    a = np.exp(rng.uniform(-1.0, 2.0, n))
    seen = rng.random(n) < 1.0 / (1.0 + np.exp(-(0.5 + 3.0 * np.log(a))))
    rows = rows.assign(run=[f"r{i}" for i in range(n)], amplitude_mm=a, detected=seen, not_valid=False)
    return Comparison(rows, stats.detectors(one), n, 0, "made")


def test_the_operating_points_have_exact_bounds_and_hold_the_shipped_threshold(found):
    curve = found.roc(["iotsekf"])
    assert set(curve["detector"]) == {"iotsekf"} and (np.diff(curve["threshold"]) < 0.0).all()
    at = curve[curve["threshold"] == 1.0].iloc[0]  # by hand: r 0.2 to 0.8 without a fault, 0.7, 3 and 9 with one
    assert (at["fault_free_flights"], at["faults"], at["false_alarm"], at["detection"]) == (4, 3, 0.0, 2 / 3)
    told = metrics.proportion(2, 3)
    assert (at["detection_low"], at["detection_high"]) == (told.low, told.high)
    assert curve.iloc[0][["false_alarm", "detection"]].tolist() == [0.0, 0.0] and curve.iloc[-1]["detection"] == 1.0


def test_flights_of_one_kind_have_no_operating_points_and_an_unknown_detector_is_refused(found):
    with pytest.raises(CosimError, match="Did you mean"):
        found.roc(["iotsek"])
    found.rows = found.rows[found.rows["case"].notna()]
    with pytest.raises(CosimError, match="part"):
        found.roc()


def test_the_fit_returns_coefficients_and_covariance_that_give_its_own_bounds():
    rows = many().rows
    fit = metrics.fit(rows["amplitude_mm"], rows["detected"])
    assert fit.coefficients == pytest.approx((0.5, 3.0), abs=1.0)
    value, low, _ = fit.at([fit.a90, fit.a90_95])
    assert value[0] == pytest.approx(0.9) and low[1] == pytest.approx(0.9)
    assert fit.at([fit.low])[2][0] == pytest.approx(0.9)
    with pytest.raises(ValueError, match="too few"):
        metrics.fit([1.0], [True]).at([1.0])


def test_curves_of_levels_and_of_detectors_stay_within_the_sizes_flown_and_say_why_there_is_none():
    made = many()
    for own in (made.pod(), made.pod(["iotsekf"])):
        assert (own["low"] <= own["pod"]).all() and (own["pod"] <= own["high"]).all()
        ends = made.rows["amplitude_mm"]
        assert own["amplitude_mm"].min() == pytest.approx(ends.min())
        assert own["amplitude_mm"].max() == pytest.approx(ends.max())
    (none,) = many(3).pod().to_dict("records")
    assert none["note"] == "too few flights" and np.isnan(none["pod"])
