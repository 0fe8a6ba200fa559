"""Probability of detection over size: a known curve is found again, its bound holds, and what has no curve says so."""

import math

import numpy as np
import pytest

from cosim.compare.metrics import fit, logistic


def sample(rng, n, a50=1.0, slope=3.0):
    a = np.exp(rng.uniform(math.log(0.1), math.log(10.0), n))
    return a, rng.random(n) < 1.0 / (1.0 + np.exp(-slope * np.log(a / a50)))


def test_a_known_curve_is_found_again():
    found = fit(*sample(np.random.default_rng(1), 4000))
    true = math.exp(math.log(9.0) / 3.0)  # where the logistic reaches 0.9
    assert found.a90 == pytest.approx(true, rel=0.08) and found.low < true < found.a90_95


def test_the_fit_zeroes_the_gradient_of_the_likelihood_and_its_covariance_inverts_the_information():
    a, y = sample(np.random.default_rng(4), 60)
    x = np.log(a)
    b, cov = logistic(x, y)

    def gradient(b):
        left = y - 1.0 / (1.0 + np.exp(-b[0] - b[1] * x))
        return np.array([left.sum(), left @ x])

    assert gradient(b) == pytest.approx([0.0, 0.0], abs=1e-6)
    steps = np.eye(2) * 1e-5
    information = -np.array([(gradient(b + h) - gradient(b - h)) / 2e-5 for h in steps])
    assert cov @ information == pytest.approx(np.eye(2), abs=1e-6)


def test_its_bound_is_beyond_the_truth_in_95_of_100_samples():
    rng, true = np.random.default_rng(2), math.exp(math.log(9.0) / 3.0)
    found = [fit(*sample(rng, 100)).a90_95 for _ in range(200)]
    assert 0.90 <= np.mean([b is None or b >= true for b in found]) <= 1.0
    assert fit(*sample(rng, 1000)).a90_95 < np.median([b for b in found if b is not None])  # more flights, closer


@pytest.mark.parametrize(
    "seen, note",
    [
        (lambda a: a > 1e9, "none seen"),
        (lambda a: a > 0.0, "all seen"),
        (lambda a: a > 1.0, "between"),
        (lambda a: (a < 0.3) | (a > 7.0), "does not grow"),
    ],
)
def test_what_has_no_curve_says_so(seen, note):
    a = np.geomspace(0.1, 10.0, 40) if note != "does not grow" else np.geomspace(0.05, 8.0, 40)
    found = fit(a, seen(a))
    assert found.a90_95 is None and note in found.note
    assert fit(a[:5], seen(a[:5])).note == "too few flights"


def test_nothing_is_said_beyond_the_sizes_flown():
    rng = np.random.default_rng(3)
    a, seen = sample(rng, 400, a50=8.0)  # 0.9 is reached at 16.6, the largest flown is 10
    found = fit(a, seen)
    assert found.a90 is None and found.note == "beyond 10"
    assert fit(*sample(rng, 4000, a50=0.03)).note == "below 0.1"  # reached at 0.06
    near = fit(*sample(rng, 60, a50=3.0))  # at 6.2: within, its bound is not
    assert near.low < near.a90 < 10.0 and near.a90_95 is None and near.note.startswith("bound beyond")
