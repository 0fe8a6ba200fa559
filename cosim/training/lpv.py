"""The affine LPV model of the flying aircraft and its observer: trims, linearisations, fit, LMIs. Source: [Alwi14].

Grid points are combinations of mass, CG, calibrated airspeed and Mach number; the last two give the altitude in the
standard atmosphere. Points below the sea, above `CEILING`, or without a steady flight below `THROTTLE_MAX` are left
out: 270 kt at M 0.40 lies under water, 210 kt at M 0.68 above the troposphere. Fitting the paper's five points alone
gives zero error and nonsense between.

The paper's box leaves out light and fast aircraft. What flies has boxes side by side over the whole trim envelope: each
of `EDGES` that holds enough steady flights gets a model fitted to linearisations at Sobol points in and around it, and
gains whose inequalities hold at all its vertices.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.stats import qmc

import fdi
from actuators.constants import DEG_PER_RAD, M_S_PER_KT
from cosim.errors import TrimError
from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.point import FlightPoint
from cosim.scenario.aircraft import DEFAULT
from cosim.training.flights import ALPHA_MAX, MACH_MAX
from cosim.training.trainer import significant
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
EDGES = (
    (195.0, 290.0, 405.0),  # t
    (22.0, 40.0),  # %
    (112.0, 150.0, 190.0, 240.0, 300.0, 390.0),  # kt
    (0.15, 0.30, 0.45, 0.65, 0.80, 0.90),  # Mach
)
SPAN = np.array([[195.0, 405.0], [22.0, 40.0], [0.0, 12500.0], [112.0, 390.0]])  # sampled: t, %, m, kt
DRAWS, SOBOL_SEED = 4096, 5
AROUND = 1.25  # a box is fitted to what lies within so many halves of its width
FEWEST = 12  # points that a box needs
Progress = Callable[[str], None] | None


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


def _impact(cas_kt):
    """Return the impact pressure [Pa] of a calibrated airspeed."""
    return 101325.0 * ((1 + 0.2 * (cas_kt * M_S_PER_KT / 340.294) ** 2) ** 3.5 - 1)


def _pressure(h):
    """Return the pressure [Pa] of the standard troposphere."""
    return 101325.0 * (1 - 0.0065 * h / 288.15) ** 5.2558797


def pressure_altitude(cas_kt: float, mach: float) -> float:
    """Return the altitude [m] of the standard troposphere where `cas_kt` is flown at `mach`; under water negative."""
    ratio = (1 + 0.2 * mach**2) ** 3.5 - 1
    return brentq(lambda h: _pressure(h) * ratio - _impact(cas_kt), -6000.0, 25000.0)


def mach_at(cas_kt: float, h: float) -> float:
    """Return the Mach number of `cas_kt` at `h` [m] in the standard atmosphere, up to 20 km."""
    pressure = _pressure(min(h, CEILING)) * math.exp((min(h, CEILING) - h) / 6341.62)
    return math.sqrt(5 * ((_impact(cas_kt) / pressure + 1) ** (1 / 3.5) - 1))


def sample(points: np.ndarray, progress: Progress = None) -> Samples:
    """Return `Samples` at each rho of `points` (k, 4); what cannot be flown with its reason."""
    return samples(*linearised(points, _at_mach, progress))


def linearised(points: np.ndarray, one: Callable[..., tuple], progress: Progress = None) -> tuple[list, list]:
    """Return ([what `one`(point) makes: rho, A, B, C, D, trim], [(point, reason)] of those without a steady flight)."""
    kept, refused = [], []
    for point in points:
        try:
            kept.append(one(point))
        except TrimError as error:
            refused.append((tuple(map(float, point)), str(error)))
        if progress is not None:
            progress("next flight point")
    return kept, refused


def samples(kept: list[tuple], refused: list) -> Samples:
    """Return `Samples` of what `linearised` found."""
    rho, A, B, C, D, trims = (np.array(column) for column in zip(*kept))
    return Samples(rho, A, B, C, D, trims, refused)


def _at_mach(rho):
    """Return a row of `linearised` at `rho` = [t, %, kt, Mach] in the troposphere, with some thrust to climb."""
    mass, cg, cas, mach = rho
    h = pressure_altitude(cas, mach)
    if not 0.0 <= h <= CEILING:
        raise TrimError(f"{cas:.0f} kt at M {mach:.2f} is an altitude of {h:.0f} m")
    made = linearize(FlightPoint(mass * 1e3, cg / 100.0, h, "mach", mach))
    if made.trim.throttle > THROTTLE_MAX:
        raise TrimError(f"needs {100 * made.trim.throttle:.0f} % of the throttle")
    flown = made.y0[list(made.outputs).index("cas")] / M_S_PER_KT
    return np.array([mass, cg, flown, mach]), *in_paper_units(made)


def short_of_stall(
    at: np.ndarray, alpha_max: float = ALPHA_MAX, mach_max: float = MACH_MAX, aircraft: str = DEFAULT
) -> tuple:
    """Return a row of `linearised` at [t, %, m, kt]. Raises TrimError beyond `alpha_max` [deg] or `mach_max`."""
    mass, cg, h, cas = at
    made = linearize(FlightPoint(mass * 1e3, cg / 100.0, h, "cas", cas * M_S_PER_KT, aircraft=aircraft))
    mach = mach_at(cas, h)
    if math.degrees(made.trim.alpha) > alpha_max or mach > mach_max:
        raise TrimError(f"{math.degrees(made.trim.alpha):.1f} deg at M {mach:.2f}")
    return np.array([mass, cg, cas, mach]), *in_paper_units(made)


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
    fitted = {k: lpv_model.fit(samples.rho, getattr(samples, k), box=box, scale=size[k], weight=weight) for k in "ABCD"}
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


def design(model: Any) -> Any:
    """Design the observer with the paper's weights: xi in the alpha and V channels (36), deltas of section 5."""
    M = np.zeros((5, 2))
    M[0, 0] = M[3, 1] = 1.0
    return lpv_smo_design.design(model.A, model.B, model.C, model.D, box=model.box, M=M)


def single(progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the design of the paper's box: sampled, fitted, judged, and how it was made."""
    first, second = sample(grid(GRID), progress), sample(grid(SECOND, offset=0.5), progress)
    model, fixed = fit(first)
    made = design(model)
    return {
        **lpv_smo_design.plain(model, made),
        "grid": {"points": len(first.rho), "refused": len(first.refused), "second": len(second.rho)},
        "fit": {k: np.asarray(v).tolist() for k, v in judge(model, second).items()},
        "fixed": {k: v.tolist() for k, v in fixed.items()},
        "vertices_refused": sample(lpv_model.vertices(BOX)).refused,
        "certificate": lpv_smo_design.verify(made),
    }  # fmt: skip


def points(span: np.ndarray, draws: int) -> np.ndarray:
    """Return Sobol points (draws, 4) of a span (4, 2): t, %, m, kt."""
    low, high = span.T
    return low + (high - low) * qmc.Sobol(4, seed=SOBOL_SEED).random(draws)


def boxed(samples: Samples, edges: Sequence[Sequence[float]] = EDGES) -> list[tuple]:
    """Return [(LpvModel, Design)] of every box of `edges` with at least `FEWEST` samples in it."""
    out = []
    for corner in itertools.product(*(itertools.pairwise(axis) for axis in edges)):
        box = np.array(corner)
        near = np.abs(lpv_model.normalise(samples.rho, box))
        if (near <= 1.0).all(1).sum() >= FEWEST:
            part = (near <= AROUND).all(1)
            here = dataclasses.replace(samples, **{k: v[part] for k, v in vars(samples).items() if k != "refused"})
            model = fit(here, box=box, weight=np.ones(part.sum()))[0]
            out.append((model, design(model)))
    return out


def several(progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the designs of the boxes of the aircraft in the tree, over Sobol points of `SPAN` short of stall."""
    return stacked(boxed(samples(*linearised(points(SPAN, DRAWS), short_of_stall, progress))), DRAWS)


def stacked(pairs: list[tuple], draws: int) -> dict[str, Any]:
    """Return the designs of `boxed` as they are stored."""
    return significant({"draws": draws, "seed": SOBOL_SEED, "boxes": [lpv_smo_design.plain(*one) for one in pairs]}, 10)


def wrong(held: dict[str, Any]) -> str:
    """Return "" when each of the stored designs belongs to its model and verifies, else what is wrong."""
    try:
        reports = [lpv_smo_design.verify(lpv_smo_design.pair(one)[1]) for one in held.get("boxes", [held])]
    except ValueError as error:
        return str(error)
    bad = {k: report for k, report in enumerate(reports) if not report["ok"]}
    return f"LPV designs do not verify: {bad}" if bad else ""
