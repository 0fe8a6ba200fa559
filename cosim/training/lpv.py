"""The affine LPV model of the flying aircraft and its observer: trims, linearisations, fit, LMIs. Source: [Alwi14].

Grid points are combinations of mass, CG, calibrated airspeed and Mach number; the last two give the altitude in the
standard atmosphere. Points below the sea, above `CEILING`, or without a steady flight below `THROTTLE_MAX` are left
out: 270 kt at M 0.40 lies under water, 210 kt at M 0.68 above the troposphere. Fitting the paper's five points alone
gives zero error and nonsense between.
"""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

import fdi
from actuators.constants import DEG_PER_RAD, M_S_PER_KT
from cosim.errors import TrimError
from cosim.flight.plant.aero.functions import numbers_digest
from cosim.flight.plant.force_model import FOLDER
from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.point import FlightPoint
from fdi.lpv_smo import model as lpv_model
from fdi.lpv_smo import synthesis as lpv_smo_design

BOX = np.array([[260.0, 405.0], [28.0, 36.0], [210.0, 270.0], [0.40, 0.68]])  # [Alwi14] section 4.3: t, %, kt, Mach
NAMES = ("mass_t", "cg_pct", "cas_kt", "mach")
STATES = {"alpha": "deg", "h": "m", "theta": "deg", "tas": "m/s", "q": "deg/s"}  # (33)
OUTPUTS = {"h": "m", "theta": "deg", "tas": "m/s", "q": "deg/s", "nz": "g", "alpha": "deg"}  # (37)
THROTTLE_MAX = 0.90  # below it the papers' points trim, and leave some thrust to climb
GRID = 7  # values per parameter of the grid that is fitted
SECOND = 4  # and of the grid between whose points the second grid lies, 3^4 points inside the box
STORED = Path(fdi.__file__).parent / "designs" / "lpv_smo.json"
CEILING = 11000.0  # top of the troposphere [m]
# size of each signal in manoeuvres of +-0.15 g, from the flights of [Alwi14] figure 1: they weigh what is insignificant
SIZE_X = np.array([2.0, 100.0, 3.0, 5.0, 2.0])
SIZE_U = np.array([3.0, 1.0])


@dataclasses.dataclass(frozen=True)
class Samples:
    """Hold linear models on a grid, paper's units: rho (k, 4), A, B, C, D (k, ., .), trims (k, 13) = [x; u; y]."""

    rho: np.ndarray
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    trims: np.ndarray
    refused: list  # (rho, reason)


def pressure_altitude(cas_kt: float, mach: float) -> Any:
    """Return the altitude [m] of the standard troposphere where `cas_kt` is flown at `mach`; under water negative."""
    impact = 101325.0 * ((1 + 0.2 * (cas_kt * M_S_PER_KT / 340.294) ** 2) ** 3.5 - 1)
    ratio = (1 + 0.2 * mach**2) ** 3.5 - 1

    def excess(h):
        return 101325.0 * (1 - 0.0065 * h / 288.15) ** 5.2558797 * ratio - impact

    return brentq(excess, -6000.0, 25000.0)


def flight_at(rho: Any) -> Any:
    """Return the FlightPoint of `rho` = [t, %, kt, Mach]."""
    mass, cg, cas, mach = rho
    return FlightPoint(mass * 1e3, cg / 100.0, pressure_altitude(cas, mach), "mach", mach)


def sample(points: Any, progress: Callable[..., Any] | None = None) -> Samples:
    """Trim and linearise at each rho of `points` (k, 4); returns `Samples`, what cannot be flown with its reason."""
    kept, refused = [], []
    for rho in points:
        try:
            kept.append(_one(rho))
        except TrimError as error:
            refused.append((tuple(map(float, rho)), str(error)))
        if progress is not None:
            progress()
    rho, A, B, C, D, trims = (np.array(column) for column in zip(*kept))
    return Samples(rho, A, B, C, D, trims, refused)


def _one(rho):
    h = pressure_altitude(rho[2], rho[3])
    if not 0.0 <= h <= CEILING:
        raise TrimError(f"{rho[2]:.0f} kt at M {rho[3]:.2f} is an altitude of {h:.0f} m")
    made = linearize(flight_at(rho))
    if made.trim.throttle > THROTTLE_MAX:
        raise TrimError(f"needs {100 * made.trim.throttle:.0f} % of the throttle")
    A, B, C, D, trim = in_paper_units(made)
    actual = np.array([rho[0], rho[1], made.y0[list(made.outputs).index("cas")] / M_S_PER_KT, rho[3]])
    return actual, A, B, C, D, trim


def in_paper_units(made: Any) -> tuple[Any, ...]:
    """Return A, B, C, D and [x; u; y] of a `LinearModel` in deg, m, m/s, g, elevators aggregated (34)."""
    segments = made.named("de_")
    inputs = (*segments, "stab")
    A, B, C, D = made.block(tuple(STATES), inputs, tuple(OUTPUTS))
    tables = (STATES, OUTPUTS)
    x, y = (np.array([DEG_PER_RAD if unit.startswith("deg") else 1.0 for unit in t.values()]) for t in tables)
    B, D = (np.column_stack([M[:, :-1].sum(1), M[:, -1]]) / DEG_PER_RAD for M in (B, D))
    x0 = [made.x0[list(made.states).index(n)] for n in STATES]
    y0 = [made.y0[list(made.outputs).index(n)] for n in OUTPUTS]
    u0 = [np.mean([made.u0[list(made.inputs).index(n)] for n in segments]), made.u0[list(made.inputs).index("stab")]]
    trim = np.concatenate([x * x0, DEG_PER_RAD * np.array(u0), y * y0])
    return x[:, None] * A / x, x[:, None] * B, y[:, None] * C / x, y[:, None] * D, trim


def grid(n: int, *, offset: float = 0.0) -> np.ndarray:
    """Return a regular grid over the box, (n^4, 4); `offset` (in steps) shifts it to lie between the points."""
    axes = [low + (high - low) * (np.arange(n - (offset > 0)) + offset) / (n - 1) for low, high in BOX]
    return np.array(np.meshgrid(*axes, indexing="ij")).reshape(4, -1).T


def fit(samples: Any, *, box: Any = BOX, weight: Any = None) -> Any:
    """Fit the `LpvModel` to `samples`; outputs that are states are exact, so C_1 is constant and D_1 zero."""
    size = {"A": SIZE_X, "B": SIZE_U, "C": SIZE_X, "D": SIZE_U}
    weight = volume(samples.rho) if weight is None else weight
    fitted = {
        k: lpv_model.fit(samples.rho, getattr(samples, k), box=box, scale=size[k], weight=weight) for k in "ABCD"
    }
    A, B, C, D = (fitted[k][0] for k in "ABCD")
    C[:, [0, 1, 2, 3, 5]] = 0.0
    C[0, [0, 1, 2, 3, 5], [1, 2, 3, 4, 0]] = 1.0
    D[:, [0, 1, 2, 3, 5]] = 0.0
    trim = lpv_model.fit_trim(samples.rho, samples.trims, box=box)
    names = [tuple(f"{k}_{v}" for k, v in table.items()) for table in (STATES, OUTPUTS)]
    model = lpv_model.LpvModel(
        A=A, B=B, C=C, D=D, box=box, trim=trim,
        states=names[0], inputs=("elevator_deg", "stab_deg"), outputs=names[1], rho=NAMES,
    )  # fmt: skip
    return model, {k: fixed for k, (_, fixed) in fitted.items()}


def volume(rho: float) -> Any:
    """Return the share of the box that each point of a regular grid stands for: half as much on a face as inside.

    The sum of squares (31) is then that of the trapezoidal rule, the integral over the flyable part of the box; equal
    weights count faces, edges and corners twice, four and more times. Points are on a face when within 1 % of it (the
    achieved CAS differs from the asked one in the fourth digit).
    """
    return np.where(np.abs(lpv_model.normalise(rho, BOX)) > 0.99, 0.5, 1.0).prod(axis=1)


def judge(model: Any, samples: Any) -> Any:
    """Compare the model with a second grid: error per entry over its largest value, modes, what is neglected."""
    out = {k: lpv_model.judge(getattr(model, k), samples.rho, getattr(samples, k)) for k in "ABCD"}
    truth = [lpv_model.modes(A)[0] for A in samples.A]
    fitted = [lpv_model.modes(lpv_model.at(model.A, r))[0] for r in samples.rho]
    out["wn_error"] = np.array([abs(f[0] / t[0] - 1) for f, t in zip(fitted, truth)])
    out["zeta_error"] = np.array([abs(f[1] - t[1]) for f, t in zip(fitted, truth)])
    out["b51_vertices"] = np.array([lpv_model.at(model.B, v)[4, 0] for v in lpv_model.vertices(BOX)])
    out["b11"], out["b41"], out["b51"] = (np.abs(samples.B[:, i, 0]).max() for i in (0, 3, 4))
    trims = [np.concatenate(lpv_model.trim_at(model, r)) for r in samples.rho]
    out["trim_error"] = np.abs(trims - samples.trims).max(0)
    return out


def unflyable_vertices() -> Any:
    """Return [(rho, reason)] of the corners of the box without a steady flight."""
    return sample(lpv_model.vertices(BOX)).refused


def design(model: Any) -> Any:
    """Design the observer with the paper's weights: xi in the alpha and V channels (36), deltas of section 5."""
    M = np.zeros((5, 2))
    M[0, 0] = M[3, 1] = 1.0
    return lpv_smo_design.design(model.A, model.B, model.C, model.D, box=model.box, M=M)


def make(*, progress: Any = None) -> tuple[Any, ...]:
    """Sample, fit, judge and design; return (model, design, facts) with `facts` ready for `lpv_smo_design.save`."""
    first, second = sample(grid(GRID), progress), sample(grid(SECOND, offset=0.5), progress)
    model, fixed = fit(first)
    made = design(model)
    return model, made, {
        "aircraft_sha256": numbers_digest(FOLDER),
        "grid": {"points": len(first.rho), "refused": len(first.refused), "second": len(second.rho)},
        "fit": {k: np.asarray(v).tolist() for k, v in judge(model, second).items()},
        "fixed": {k: v.tolist() for k, v in fixed.items()},
        "vertices_refused": unflyable_vertices(),
        "certificate": lpv_smo_design.verify(made),
    }  # fmt: skip


def store(path: Path = STORED, *, progress: Callable[..., Any] | None = None) -> Any:
    """Make the design of the aircraft in the tree and write it to `path`; return the facts."""
    model, made, facts = make(progress=progress)
    lpv_smo_design.save(model, made, path, **facts)
    return facts


def check(path: Path = STORED) -> str:
    """Return "" when the stored design belongs to the aircraft in the tree and verifies, else what is wrong."""
    if not Path(path).is_file():
        return "no stored LPV design; make it with: cosim design"
    held = json.loads(Path(path).read_text(encoding="utf-8"))
    if held["aircraft_sha256"] != numbers_digest(FOLDER):
        return "the LPV design was made for other numbers in the aircraft's XML; mend: cosim design"
    try:
        report = lpv_smo_design.verify(lpv_smo_design.load(path)[1])
    except ValueError as error:
        return str(error)
    return "" if report["ok"] else f"the stored LPV design does not verify: {report}"
