"""The affine LPV fit [Alwi14] (27)-(32), on arrays and on a transport written from public data."""

import lpv_transport as transport
import numpy as np
import pytest

from fdi.lpv_smo import model as lpv_model


def test_a_grid_that_cannot_determine_the_coefficients_is_refused():
    with pytest.raises(ValueError, match="undetermined"):
        lpv_model.fit(np.ones((6, 2)), np.zeros((6, 1, 1)), box=[[0, 2], [0, 2]])


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


def test_the_weights_of_a_grid_are_those_of_the_trapezoidal_rule():
    from cosim.training import lpv as design_lpv

    w = design_lpv.volume(design_lpv.grid(3))
    assert len(w) == 81 and w.sum() == pytest.approx(2.0**4)  # two cells per parameter
    assert w.min() == 1 / 16 and w.max() == 1.0
