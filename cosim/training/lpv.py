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
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.stats import qmc

from actuators.constants import DEG_PER_RAD, M_PER_FT, M_S_PER_KT
from cosim.errors import DesignError, TrimError
from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.point import FlightPoint
from cosim.scenario.aircraft import DEFAULT, load_aircraft
from cosim.training.flights import ALPHA_MAX, MACH_MAX, reach
from cosim.training.trainer import significant
from fdi.lpv_smo import model as lpv_model
from fdi.lpv_smo import synthesis as lpv_smo_design
from fdi.lpv_smo.core import NB

BOX = np.array([[260.0, 405.0], [28.0, 36.0], [210.0, 270.0], [0.40, 0.68]])  # [Alwi14] section 4.3: t, %, kt, Mach
STATES = {"alpha": "deg", "h": "m", "theta": "deg", "tas": "m/s", "q": "deg/s"}  # (33)
OUTPUTS = {"h": "m", "theta": "deg", "tas": "m/s", "q": "deg/s", "nz": "g", "alpha": "deg"}  # (37)
THROTTLE_MAX = 0.90  # below it the papers' points trim, and leave some thrust to climb
GRID = 7  # values per parameter of the grid that is fitted
SECOND = 4  # and of the grid between whose points the second grid lies, 3^4 points inside the box
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
OTHERS = 1024  # points of another aircraft
MASS_RATIO, CAS_RATIO = 1.75, 1.35  # of the edges of a box of another aircraft


@dataclasses.dataclass(frozen=True)
class Samples:
    """Hold linear models on a grid, paper's units: rho (k, 4), A, B, C, D (k, ., .), trims (k, 13) = [x; u; y]."""

    rho: np.ndarray
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    trims: np.ndarray


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


def samples(points: np.ndarray, one: Callable[..., tuple]) -> Samples:
    """Return `Samples` of what `one`(point) makes, rho, A, B, C, D and trim, of each of `points` (k, 4) with a steady
    flight. Raises DesignError where none has one."""
    kept = []
    for point in points:
        try:
            kept.append(one(point))
        except TrimError:
            continue
    if not kept:
        raise DesignError("no flight point of the envelope has a steady flight",
                          remedy="`cosim check` of the aircraft's folder says why")  # fmt: skip
    return Samples(*(np.array(column) for column in zip(*kept)))


def at_mach(rho: np.ndarray) -> tuple:
    """Return a row of `samples` at `rho` = [t, %, kt, Mach] in the troposphere, with some thrust to climb."""
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
    """Return a row of `samples` at [t, %, m, kt]. Raises TrimError beyond `alpha_max` [deg] or `mach_max`."""
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
    A, B, C, D = (lpv_model.fit(samples.rho, getattr(samples, k), box=box, scale=size[k], weight=weight)[0]
                  for k in "ABCD")  # fmt: skip
    C[:, [0, 1, 2, 3, 5]] = 0.0
    C[0, [0, 1, 2, 3, 5], [1, 2, 3, 4, 0]] = 1.0
    D[:, [0, 1, 2, 3, 5]] = 0.0
    trim = lpv_model.fit_trim(samples.rho, samples.trims, box=box)
    return lpv_model.LpvModel(A=A, B=B, C=C, D=D, box=box, trim=trim)


def volume(rho: np.ndarray) -> np.ndarray:
    """Return the share of the box that each point of a regular grid stands for: half as much on a face as inside.

    The sum of squares (31) is then that of the trapezoidal rule, the integral over the flyable part of the box; equal
    weights count faces, edges and corners twice, four and more times. Points are on a face when within 1 % of it (the
    achieved CAS differs from the asked one in the fourth digit).
    """
    return np.where(np.abs(lpv_model.normalise(rho, BOX)) > 0.99, 0.5, 1.0).prod(axis=1)


def design(model: Any) -> Any:
    """Design the observer with the paper's weights: xi in the alpha and V channels (36), deltas of section 5."""
    M = np.zeros((5, 2))
    M[0, 0] = M[3, 1] = 1.0
    return lpv_smo_design.design(model.A, model.B, model.C, model.D, box=model.box, F=np.eye(5)[4], M=M)


def single(progress: Callable[[str], None], aircraft: str = DEFAULT) -> dict[str, Any]:
    """Return the design of the paper's box, and how large the entries of B are on a second grid."""
    progress("linear models over the paper's box")
    model = fit(samples(grid(GRID), at_mach))
    second = samples(grid(SECOND, offset=0.5), at_mach)
    return {**lpv_smo_design.plain(model, design(model)), "largest_B": np.abs(second.B).max(axis=0).tolist()}


def points(span: np.ndarray, draws: int) -> np.ndarray:
    """Return Sobol points (draws, 4) of a span (4, 2): t, %, m, kt."""
    low, high = span.T
    return low + (high - low) * qmc.Sobol(4, seed=SOBOL_SEED).random(draws)


def boxed(samples: Samples, edges: Sequence[Sequence[float]]) -> list[tuple]:
    """Return [(LpvModel, Design)] of every box of `edges` with at least `FEWEST` samples in it."""
    out = []
    for corner in itertools.product(*(itertools.pairwise(axis) for axis in edges)):
        box = np.array(corner)
        near = np.abs(lpv_model.normalise(samples.rho, box))
        if (near <= 1.0).all(1).sum() >= FEWEST:
            part = (near <= AROUND).all(1)
            here = Samples(**{k: v[part] for k, v in vars(samples).items()})
            model = fit(here, box=box, weight=np.ones(part.sum()))
            out.append((model, design(model)))
    return out


def several(progress: Callable[[str], None], aircraft: str = DEFAULT) -> dict[str, Any]:
    """Return the designs of the boxes over the envelope of an aircraft, made of Sobol points short of stall."""
    progress("linear models over the envelope, LMIs")
    own, draws = load_aircraft(aircraft), DRAWS
    if own.own_designs is None:
        boxes = boxed(samples(points(SPAN, draws), short_of_stall), EDGES)
    else:
        height = [feet * M_PER_FT for feet in own.limits.altitude_ft]
        span, draws = np.array([own.mass.mass_t, own.mass.cg_pct, height, own.limits.cas_kt]), OTHERS
        alpha, mach = reach(own)
        one = partial(short_of_stall, alpha_max=alpha, mach_max=mach, aircraft=aircraft)
        found, ratio = samples(points(span, draws), one), CAS_RATIO
        boxes = boxed(found, edges_of(found.rho, ratio))
        while len(boxes) > NB:  # wider ones until the block holds them
            ratio *= 1.15
            boxes = boxed(found, edges_of(found.rho, ratio))
    return significant({"draws": draws, "seed": SOBOL_SEED, "boxes": [lpv_smo_design.plain(*one) for one in boxes]}, 10)


def edges_of(rho: np.ndarray, cas_ratio: float) -> tuple[Any, ...]:
    """Return edges of boxes over what is flown, rho (k, 4); the speeds of a box differ by `cas_ratio` at most."""
    low, high = rho.min(axis=0), rho.max(axis=0)
    mass, cas = (np.round(np.geomspace(math.floor(low[i]), math.ceil(high[i]),
                                       math.ceil(math.log(high[i] / low[i]) / math.log(ratio)) + 1))
                 for i, ratio in ((0, MASS_RATIO), (2, cas_ratio)))  # fmt: skip
    mach = (max(low[3] - 1e-6, 0.0), *(m for m in EDGES[3] if low[3] < m < high[3]), high[3])
    return mass, (math.floor(low[1]), math.ceil(high[1])), cas, mach
