"""Linear matrix inequalities: the few lines that every design by cvxpy and Clarabel shares.

The solver is an optional extra, imported when a design runs, so that a flight needs none.
"""

import warnings
from typing import Any

import numpy as np


class Infeasible(ValueError):
    """The inequalities of a design have no solution; the message says which."""


def cvxpy() -> Any:
    """Return the cvxpy module; raise ImportError that names the extra when it or Clarabel is missing."""
    try:
        import clarabel  # noqa: F401 (cvxpy would report a missing solver only when it solves)
        import cvxpy as module
    except ImportError as error:
        raise ImportError(
            f"this design needs the optional extra `design` ({error.name} is missing): pip install 'cosim-fdi[design]'"
        ) from error
    return module


def negative(expression: Any, margin: float) -> Any:
    """Return the constraint `sym(expression) <= -margin I` for a square cvxpy expression, strict when margin > 0."""
    return (expression + expression.T) / 2 << -margin * np.eye(expression.shape[0])


def solve(problem: Any, *, tolerance: float = 1e-9) -> None:
    """Solve a cvxpy problem with Clarabel; raise Infeasible unless a solution was found.

    "Almost solved" counts as solved: whoever calls must substitute the result back (`violation`).
    """
    cp = cvxpy()
    options = {"tol_gap_abs": tolerance, "tol_gap_rel": tolerance, "tol_feas": tolerance}
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Solution may be inaccurate")  # the caller checks the solution itself
            problem.solve(solver=cp.CLARABEL, **options)
    except cp.SolverError as error:
        raise Infeasible("Clarabel finds no solution within its accuracy") from error
    if problem.status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):
        raise Infeasible(f"Clarabel reports the inequalities as {problem.status}")


def violation(matrix: Any) -> float:
    """Return lambda_max(sym(matrix)) / |matrix|_2: negative when `matrix < 0` holds, relative to its own size."""
    eigenvalues = np.linalg.eigvalsh((matrix + matrix.T) / 2)
    size = max(abs(eigenvalues[0]), abs(eigenvalues[-1]))
    return float(eigenvalues[-1] / size) if size > 0.0 else 0.0
