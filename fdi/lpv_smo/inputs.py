"""What `fdi.lpv_smo.synthesis.design` is given: affine stacks of agreeing sizes, and what no gain can do about them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from fdi.common.conditions import unit_rows, unobservable_modes
from fdi.lpv_smo.model import at, vertices


def stacks(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> Any:
    """Return A, B, C, D as float stacks (1 + nr, rows, cols) of agreeing sizes.

    One matrix alone is a constant; D may be None. Raises ValueError that names what does not agree.
    """
    given = {"A": A, "B": B, "C": C}
    given = {k: np.asarray(v, float) for k, v in (given if D is None else given | {"D": D}).items()}
    for name, S in given.items():
        if S.ndim not in (2, 3):
            raise ValueError(f"{name} has {S.ndim} dimensions; give a matrix or an affine stack (1 + nr, rows, cols)")
        if not np.isfinite(S).all():
            raise ValueError(f"{name} holds a value that is not finite")
    terms = max(len(S) if S.ndim == 3 else 1 for S in given.values())
    held = {name: _stack(name, S, terms) for name, S in given.items()}
    n, m, p = held["A"].shape[1], held["B"].shape[2], held["C"].shape[1]
    held.setdefault("D", np.zeros((terms, p, m)))
    wanted = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m)}
    for name, shape in wanted.items():
        if held[name].shape[1:] != shape:
            raise ValueError(f"{name} is {held[name].shape[1:]}, not {shape}: {n} states, {m} inputs, {p} outputs")
    return tuple(held[k] for k in "ABCD")


def _stack(name, S, terms):
    S = S[None] if S.ndim == 2 else S
    if len(S) not in (1, terms):
        raise ValueError(f"{name} has {len(S)} affine terms, others have {terms}")
    return np.concatenate([S, np.zeros((terms - len(S), *S.shape[1:]))])


def options(box: Any, poles: Sequence[Any], a_f: Any, n_x: Any, inputs: Any, actuator: Any) -> tuple[Any, ...]:
    """Return box (nr, 2) and poles (slow, fast); ValueError for what is out of order."""
    box = np.asarray(box, float).reshape(-1, 2)
    if not np.isfinite(box).all() or (box[:, 0] >= box[:, 1]).any():
        raise ValueError("each row of box is (lowest, highest) of a parameter, and the first is less than the second")
    slow, fast = (float(x) for x in poles)
    if not 0.0 < slow < fast:
        raise ValueError(f"poles = {poles}: a slow and a faster bound, both positive [rad/s]")
    if not a_f > 0.0:
        raise ValueError(f"a_f = {a_f} is positive [rad/s]")
    if not actuator or len(set(actuator)) != len(actuator) or not all(0 <= a < inputs for a in actuator):
        raise ValueError(f"actuator = {tuple(actuator)}: columns of B, of which there are {inputs}")
    if len(actuator) > n_x:
        raise ValueError(f"{len(actuator)} actuator faults, {n_x} states")
    return box, (slow, fast)


def vector(name: str, value: Any, size: int, *, sign: int = 0) -> np.ndarray:
    """Return `value` as an array of `size` numbers, all positive or negative as `sign` says; ValueError otherwise."""
    value = np.asarray(value, float)
    if value.shape != (size,) or not np.isfinite(value).all():
        raise ValueError(f"{name} takes {size} finite numbers, not {value.tolist()}")
    if sign and not (sign * value > 0.0).all():
        raise ValueError(f"{name} are all {'positive' if sign > 0 else 'negative'}, not {value.tolist()}")
    return value


def movable(A: np.ndarray, box: Any, n_free: int, n_outer: int, poles: Sequence[Any]) -> None:
    """Raise ValueError when a pole of the sliding motion lies outside `poles` and no L moves it.

    A (1+nr, n, n) in canonical coordinates, the first n_free states unmeasured, L free over the first n_outer outputs:
    such a pole is an eigenvalue of A11 that does not show in those rows of A21, an invariant zero from the faults to
    the outputs.
    """
    for rho in vertices(box):
        a = at(A, rho)
        for pole in unobservable_modes(a[:n_free, :n_free], a[n_free : n_free + n_outer, :n_free]):
            if not -poles[1] <= pole.real <= -poles[0]:
                where = f" at rho = {np.round(rho, 4).tolist()}" if len(rho) else ""
                raise ValueError(
                    f"no L and W meet the LMIs: the sliding motion has a pole at {pole:.3g} 1/s{where} that no gain "
                    f"moves (an invariant zero from the faults to the outputs), outside {poles} rad/s; measure more, "
                    "take fewer faults or widen the bound"
                )


def least_seen(A: np.ndarray, box: Any, n_free: int, n_outer: int, poles: Sequence[Any]) -> str:
    """Return words about the unmeasured mode that is slower than `poles` ask for and shows least in the outputs.

    Arguments as in `movable`. The figure is the least singular value of [(s I - A11) / |A11|; A21], unit rows of A21.
    """
    worst = (np.inf, 0.0, None)
    for rho in vertices(box):
        a = at(A, rho)
        A11, A21 = a[:n_free, :n_free], unit_rows(a[n_free : n_free + n_outer, :n_free])
        size = max(np.linalg.norm(A11, 2), 1e-12)
        for pole in np.linalg.eigvals(A11):
            if pole.real > -poles[0]:
                gap = np.linalg.svd(np.vstack([(pole * np.eye(n_free) - A11) / size, A21]), compute_uv=False)[-1]
                worst = min(worst, (float(gap), pole, rho), key=lambda w: w[0])
    if worst[2] is None:
        return ""
    gap, pole, rho = worst
    where = f" at rho = {np.round(rho, 4).tolist()}" if len(rho) else ""
    return f"; the unmeasured mode {pole:.3g} 1/s{where} shows in the outputs by {gap:.1e} only"
