"""The affine LPV fit [Alwi14] (27)-(32), on arrays and on a transport written from public data."""

import lpv_transport as transport
import numpy as np
import pytest

from fdi.lpv_smo import model as lpv_model


def test_an_affine_family_is_recovered_to_rounding():
    rng = np.random.default_rng(0)
    box = np.array([[1.0, 3.0], [-2.0, 5.0]])
    stack = rng.normal(size=(3, 2, 4))
    rho = rng.uniform(box[:, 0], box[:, 1], (20, 2))
    S = np.array([lpv_model.at(stack, r) for r in rho])
    got, _ = lpv_model.fit(rho, S, box=box, tolerance=0.0)
    np.testing.assert_allclose(got, stack, atol=1e-12)


def test_insignificant_and_invariant_entries_keep_their_mean_in_the_constant_part():
    rng = np.random.default_rng(1)
    box = np.array([[0.0, 1.0]])
    rho = rng.uniform(0, 1, (30, 1))
    S = np.zeros((30, 1, 3))
    S[:, 0, 0] = 10 + 5 * rho[:, 0]  # significant
    S[:, 0, 1] = 7 + 0.01 * rho[:, 0]  # invariant within 2 %
    S[:, 0, 2] = 0.01 * rho[:, 0]  # insignificant beside the others
    got, fixed = lpv_model.fit(rho, S, box=box)
    assert fixed.tolist() == [[False, True, True]]
    assert np.all(got[1:, fixed] == 0)
    np.testing.assert_allclose(got[0, fixed], S.mean(0)[fixed])


def test_a_grid_that_cannot_determine_the_coefficients_is_refused():
    with pytest.raises(ValueError, match="undetermined"):
        lpv_model.fit(np.ones((6, 2)), np.zeros((6, 1, 1)), box=[[0, 2], [0, 2]])


def test_trim_maps_reproduce_a_cubic_to_rounding():
    rng = np.random.default_rng(2)
    box = np.array([[0.0, 2.0], [1.0, 4.0]])
    rho = rng.uniform(box[:, 0], box[:, 1], (40, 2))
    value = rho[:, 0] ** 3 - 2 * rho[:, 0] * rho[:, 1] ** 2 + 5
    trim = lpv_model.fit_trim(rho, value[:, None], box=box)
    z = lpv_model.normalise(rho, box)
    basis = np.prod(z[:, None, :] ** lpv_model.powers(2), axis=2)
    np.testing.assert_allclose(basis @ trim[0], value, rtol=1e-10)


def test_the_judge_sees_an_error_that_was_put_in():
    stack = np.ones((2, 1, 1))
    rho = np.array([[0.0], [1.0]])
    S = np.array([[[1.0]], [[4.0]]])  # the model says 2 there
    assert lpv_model.judge(stack, rho, S)[0, 0] == pytest.approx(0.5)


@pytest.fixture(scope="module")
def second_grid():
    points = transport.grid(5)
    return points, [transport.linearise(r) for r in points]


def test_a_transport_is_fitted_within_the_bounds_on_a_second_grid(second_grid):
    """B51, C51, D51 within 10 %, short-period frequency within 8 % at 95 % of the points."""
    rho, parts = second_grid
    model = transport.model()
    assert lpv_model.judge(model.B, rho, [p[1] for p in parts])[4, 0] <= 0.10
    assert lpv_model.judge(model.C, rho, [p[2] for p in parts])[4, 0] <= 0.10
    assert lpv_model.judge(model.D, rho, [p[3] for p in parts])[4, 0] <= 0.10
    ratio = [
        lpv_model.modes(lpv_model.at(model.A, r))[0][0] / lpv_model.modes(p[0])[0][0]
        for r, p in zip(rho, parts, strict=True)
    ]
    assert np.quantile(np.abs(np.array(ratio) - 1), 0.95) <= 0.08


def test_the_elevator_moment_keeps_its_sign_at_all_vertices():
    model = transport.model()
    values = [lpv_model.at(model.B, v)[4, 0] for v in lpv_model.vertices(model.box)]
    assert len(values) == 16 and max(values) < 0


def test_fitting_the_five_points_alone_gives_no_error_and_nonsense():
    """Five points, five unknowns: exact there, and B51 changes sign inside the box (README of the papers)."""
    rho = np.array(list(transport.POINTS.values()), float)
    B = np.array([transport.linearise(r)[1] for r in rho])
    stack, _ = lpv_model.fit(rho, B, box=transport.BOX, tolerance=0.0)
    assert lpv_model.judge(stack, rho, B)[4, 0] < 1e-9
    corners = np.array([lpv_model.at(stack, v)[4, 0] for v in lpv_model.vertices(transport.BOX)])
    full = np.array([lpv_model.at(transport.model().B, v)[4, 0] for v in lpv_model.vertices(transport.BOX)])
    assert np.abs(corners - full).max() > 0.25 * np.abs(full).max()


def test_a_sample_that_counts_twice_is_a_sample_that_is_there_twice():
    rng = np.random.default_rng(3)
    rho, S = rng.uniform(0, 1, (12, 1)), rng.normal(size=(12, 1, 2))
    twice = np.r_[np.arange(12), 3, 7]
    weight = np.ones(12)
    weight[[3, 7]] = 2.0
    weighted, _ = lpv_model.fit(rho, S, box=[[0, 1]], tolerance=0.0, weight=weight)
    repeated, _ = lpv_model.fit(rho[twice], S[twice], box=[[0, 1]], tolerance=0.0)
    np.testing.assert_allclose(weighted, repeated, atol=1e-12)


def test_the_weights_of_a_grid_are_those_of_the_trapezoidal_rule():
    from cosim.training import lpv as design_lpv

    w = design_lpv.volume(design_lpv.grid(3))
    assert len(w) == 81 and w.sum() == pytest.approx(2.0**4)  # two cells per parameter
    assert w.min() == 1 / 16 and w.max() == 1.0
