"""Curves for a paper: frames with bounds, figures as vectors, coefficients of the fit."""

import numpy as np
import pandas as pd
import pytest
from test_stats import hand_made

from cosim.compare import Comparison, metrics, pod, stats
from cosim.errors import CosimError
from cosim.report import compared


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
    at = curve[curve["threshold"] == 1.0].iloc[0]
    healthy, faulty = stats.maxima(found.rows)["iotsekf"]
    assert at["false_alarm"] == np.mean(healthy >= 1.0) and at["detection"] == np.mean(faulty >= 1.0)
    told = metrics.proportion(int(np.sum(faulty >= 1.0)), len(faulty))
    assert (at["detection_low"], at["detection_high"]) == (told.low, told.high)


def test_flights_of_one_kind_have_no_operating_points(found):
    found.rows = found.rows[found.rows["case"].notna()]
    with pytest.raises(CosimError, match="part"):
        found.roc()


def test_unknown_detectors_and_figures_are_told(found):
    with pytest.raises(CosimError, match="Did you mean"):
        found.roc(["iotsek"])
    with pytest.raises(CosimError, match="roc, pod"):
        found.figure("rok")


def test_a_figure_without_a_curve_is_refused():
    lone = many(3)
    with pytest.raises(CosimError, match="too few flights"):
        lone.figure("pod")


def test_the_fit_returns_coefficients_and_covariance_that_give_its_own_bounds():
    rows = many().rows
    fit = pod.fit(rows["amplitude_mm"], rows["detected"])
    assert fit.coefficients == pytest.approx((0.5, 3.0), abs=1.0)
    value, low, _ = fit.at([fit.a90, fit.a90_95])
    assert value[0] == pytest.approx(0.9) and low[1] == pytest.approx(0.9)
    assert fit.at([fit.low])[2][0] == pytest.approx(0.9)
    with pytest.raises(ValueError, match="too few"):
        pod.fit([1.0], [True]).at([1.0])


def test_curves_of_levels_and_of_detectors_stay_within_the_sizes_flown():
    made = many()
    for own in (made.pod(), made.pod(["iotsekf"])):
        assert (own["low"] <= own["pod"]).all() and (own["pod"] <= own["high"]).all()
        ends = made.rows["amplitude_mm"]
        assert own["amplitude_mm"].min() == pytest.approx(ends.min())
        assert own["amplitude_mm"].max() == pytest.approx(ends.max())


def test_figures_are_vectors_one_column_wide_with_their_legend_off_the_curves(found, tmp_path):
    pytest.importorskip("matplotlib")
    for kind, made in (("roc", found), ("pod", many())):
        path = tmp_path / f"{kind}.pdf"
        drawn = made.figure(kind)
        drawn.savefig(path)
        assert path.read_bytes().startswith(b"%PDF") and drawn.get_size_inches()[0] == 3.5
        boxes = [part.get_window_extent() for part in (drawn.legends[0], drawn.axes[0])]
        assert boxes[0].y1 <= boxes[1].y0 and boxes[0].x0 >= 0.0 and boxes[0].x1 <= drawn.bbox.width


def test_the_operating_point_is_where_the_alarms_are_and_the_figure_says_so(found):
    """A fault-free flight crosses the threshold, but not for the time of confirmation."""
    pytest.importorskip("matplotlib")
    free = (found.rows["id"] == "lpv_smo") & found.rows["case"].isna()
    found.rows.loc[free, "false_alarms"] = 0
    found.detectors = stats.detectors(found.rows)
    drawn = found.figure("roc", ["lpv_smo"])
    told = found.detectors[1]
    dots = [c.lines[0].get_xydata().tolist() for c in drawn.axes[0].containers]
    assert dots == [[[0.0, told["detection_probability"]]]] and found.rows.loc[free, "r_fault_free"].max() > 1.0
    assert "Dot: alarms as shipped" in drawn.legends[0].get_title().get_text()
    page = [t for t in compared.roc(found.rows, found.detectors).data if t["mode"] == "markers"][1]
    assert (page["x"], page["y"]) == ([0.0], [told["detection_probability"]])


def test_the_figure_of_sizes_says_who_has_no_curve_and_why_and_numbers_its_sizes():
    pytest.importorskip("matplotlib")
    made = many()
    other = made.rows.assign(id="rtsekf", detected=True)
    made.rows = pd.concat([made.rows, other], ignore_index=True)
    drawn = made.figure("pod", ["iotsekf", "rtsekf"])
    told = " ".join(drawn.legends[0].get_title().get_text().split())
    assert "No curve (mm): rtsekf, 1 Hz: all seen from" in told and "Band: each bound with 95 %" in told
    (name,) = [t.get_text() for t in drawn.legends[0].get_texts()]
    assert name == "iotsekf, 1 Hz" and told.startswith("liquid OFC, one segment.")
    assert {"0.5", "1", "2", "5"} == {t.get_text() for t in drawn.axes[0].get_xticklabels()}
