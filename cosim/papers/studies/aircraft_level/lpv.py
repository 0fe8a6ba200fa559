"""How near the affine LPV model of [Alwi14] is on its second grid, and how near any affine function could be.

The least possible error of an entry is that of a linear programme: the affine function of mass, CG, CAS and Mach with
the smallest largest error on the second grid itself. What exceeds a bound there exceeds it for every affine model.
"""

import json
from typing import Any

import numpy as np
from scipy.optimize import linprog

from cosim.papers.studies import Options, Table
from cosim.training import lpv as design_lpv
from fdi.lpv_smo import model as lpv_model

ENTRY = 0.15  # of an entry's largest value
CLOSE = {("B", 4, 0): 0.10, ("C", 4, 0): 0.10, ("D", 4, 0): 0.10}
ZERO = 1e-8  # of the matrix's largest: rounding of the differences


def least(rho: Any, value: Any) -> Any:
    """Return the least possible largest error of an affine function of rho (k, nr) to value (k,), over the largest."""
    X = np.column_stack([np.ones(len(rho)), lpv_model.normalise(rho, design_lpv.BOX)])
    n, m = X.shape
    rules = np.block([[X, -np.ones((n, 1))], [-X, -np.ones((n, 1))]])
    found = linprog(np.r_[np.zeros(m), 1.0], A_ub=rules, b_ub=np.r_[value, -value],
                    bounds=[(None, None)] * m + [(0.0, None)])  # fmt: skip
    return float(found.x[m] / np.abs(value).max())


def entries(model: Any, fixed: Any, samples: Any) -> list[tuple[str, float, str, float, float, float]]:
    """Return rows (entry, largest, how it is held, error, least possible, bound) of what is no zero nor constant."""
    rows = []
    for name in "ABCD":
        S, stack = getattr(samples, name), getattr(model, name)
        error = lpv_model.judge(stack, samples.rho, S)
        for place in np.ndindex(*S.shape[1:]):
            value = S[(slice(None), *place)]
            size = np.abs(value).max()
            if size <= ZERO * np.abs(S).max() or np.ptp(value) <= 1e-4 * size:
                continue
            how = "constant" if fixed[name][place[0]][place[1]] else "affine"
            label = f"{name}{place[0] + 1}{place[1] + 1}"
            rows.append((label, float(size), how, float(error[place]), least(samples.rho, value),
                         CLOSE.get((name, *place), ENTRY)))  # fmt: skip
    return rows


def jobs(options: Options) -> list[Any]:
    """Return nothing: the second grid is sampled for the tables (seconds)."""
    return []


def tables(options: Options, values: Any) -> Any:
    """Return the tables of the stored fit."""
    held = json.loads(design_lpv.STORED.read_text(encoding="utf-8"))
    fit = held["fit"]
    arrays: Any = {k: np.array(v) for k, v in held["model"].items()}
    model = lpv_model.LpvModel(**arrays)
    samples = design_lpv.sample(design_lpv.grid(design_lpv.SECOND, offset=0.5))
    rows = entries(model, held["fixed"], samples)
    first = Table(
        f"affine LPV model on {len(samples.rho)} points between those of the fit: error over the entry's largest value",
        ("entry", "largest>", "held", "error>", "least possible>", "bound>"), rows,
        ("constant: below 2 % of its row in manoeuvres of 0.15 g, or of its own value (29)-(32)",
         "A54 measures dM/dV; where the least possible error is beyond the bound, no affine model meets it"),
    )  # fmt: skip
    modes = [
        ("short-period frequency, 95 % of the points", float(np.quantile(fit["wn_error"], 0.95)), 0.08),
        ("short-period frequency, largest", max(fit["wn_error"]), None),
        ("short-period damping, 95 % of the points", float(np.quantile(fit["zeta_error"], 0.95)), 0.04),
        ("short-period damping, largest", max(fit["zeta_error"]), 0.04),
        ("B51 at the 16 vertices, largest [1/s2]", max(fit["b51_vertices"]), 0.0),
        ("neglected B11 over B51", fit["b11"] / fit["b51"], None),
        ("neglected B41 over B51", fit["b41"] / fit["b51"], None),
    ]
    second = Table("modes and what is neglected", ("figure", "value>", "bound>"), modes)
    refused = [(", ".join(f"{x:g}" for x in rho), why) for rho, why in held["vertices_refused"]]
    third = Table("vertices that cannot be flown (mass t, CG %, CAS kt, Mach)", ("vertex", "reason"), refused)
    return [first, second, third]
