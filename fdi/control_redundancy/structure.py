"""Residual families of control-induced redundancy from a sparsity pattern alone. Source: [Mar10], slides 7 to 10.

The force equations are written f = G u, rows f_i known from measurements, u the control inputs; only *which* g_ij
exist matters here. A row solved for one of its inputs gives a residual (slide 8). A row may first replace one of its
inputs j by the estimate (f_k - sum_{h != j} g_kh u_hc) / g_kj from another row k (slide 9), which makes it blind to
faults of j. The rule that gives the talk's table, and nothing twice: row k serves when all its inputs also appear in
the base row, each row and each input once, no serving row may contain another replaced input, and the same rows
without the same inputs count once.

| symbol | here |
|---|---|
| r_ij (slide 8) | `Residual(base=i, pivots=(), solved=j)` |
| r~_1i^1 ... r~_1i^5 (slides 9, 10) | base row 1 with `pivots` = ((row, input), ...) |
| signature (slide 10) | `Family.signature`, one 0/1 per input |
"""

import dataclasses
import itertools
from collections import Counter

import numpy as np

TALK = np.array([[1, 1, 1, 1], [1, 0, 1, 0], [0, 1, 0, 0]], bool)  # slide 7: rows x, y, z; inputs below
TALK_INPUTS = ("delta_l", "delta_m", "delta_n", "eta")


@dataclasses.dataclass(frozen=True)
class Family:
    """Hold residuals that differ only by the input they are solved for: base row, replacements, sensitive inputs."""

    base: int
    pivots: tuple  # ((row, replaced input), ...)
    signature: tuple  # 1 where a fault of that input shows
    solved: tuple  # inputs that the base row can be solved for

    @property
    def name(self) -> str:
        """Return r1, or r1~m3 for row 1 with input m replaced from row 3 (numbered from 1)."""
        tail = "".join(f"~{j + 1}by{k + 1}" for k, j in self.pivots)
        return f"r{self.base + 1}{tail}"


def families(structure: np.ndarray, *, most: int = 2) -> list[Family]:
    """Return the families of a bool matrix (rows, inputs), with at most `most` replacements each.

    Families that no input moves (everything replaced) are left out: they test the model, not an actuator.
    """
    structure = np.asarray(structure, bool)
    found: dict = {}
    for count, base in itertools.product(range(most + 1), range(len(structure))):
        for pivots in itertools.combinations(_servants(structure, base), count):
            rows, gone = [k for k, _ in pivots], [j for _, j in pivots]
            left = np.any(structure[[base, *rows]], axis=0)
            left[gone] = False
            own = structure[np.ix_(rows, gone)]  # each serving row contains of the replaced inputs its own alone
            if left.any() and np.array_equal(own, np.eye(count)):
                solved = tuple(np.flatnonzero(structure[base]).tolist())
                family = Family(base, pivots, tuple(left.astype(int).tolist()), solved)
                found.setdefault((frozenset([base, *rows]), frozenset(gone)), family)
    return list(found.values())


def signatures(structure: np.ndarray) -> Counter[tuple]:
    """Return {signature: number of residuals} of `families(structure)`, in order of appearance."""
    return Counter(family.signature for family in families(structure) for _ in family.solved)


def combination(G: np.ndarray, family: Family) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights c (rows,) and sensitivities s (inputs,) of a family: r = c (f - G u_c) = s (u - u_c).

    G (rows, inputs). The entries of the pivots are divided by: take the families of G's own structure.
    """
    c = np.zeros(len(G))
    c[family.base] = 1.0
    for k, j in family.pivots:
        c[k] -= G[family.base, j] / G[k, j]
    return c, c @ G


def _servants(structure, base):
    """Return [(row, input)] that may replace an input of `base`."""
    return [
        (k, int(j))
        for k in range(len(structure))
        if k != base and structure[k].any() and not (structure[k] & ~structure[base]).any()
        for j in np.flatnonzero(structure[k])
    ]
