"""The observer of [Alwi14] over the whole trim envelope: boxes side by side, each with its affine model and its LMIs.

The paper's box leaves out light and fast aircraft. Here every box of `EDGES` that holds enough steady flights gets a
model fitted to linearisations at Sobol points in and around it, and gains whose inequalities hold at all its vertices.
"""

import itertools
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import qmc

from actuators.constants import M_S_PER_KT
from cosim.errors import TrimError
from cosim.flight.plant.aero.functions import numbers_digest
from cosim.flight.plant.force_model import FOLDER
from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.point import FlightPoint
from cosim.scenario.aircraft import DEFAULT
from cosim.training import lpv
from fdi.lpv_smo import boxes, synthesis
from fdi.lpv_smo import model as lpv_model

EDGES = (
    (195.0, 290.0, 405.0),  # t
    (22.0, 40.0),  # %
    (112.0, 150.0, 190.0, 240.0, 300.0, 390.0),  # kt
    (0.15, 0.30, 0.45, 0.65, 0.80, 0.90),  # Mach
)
STORED = lpv.STORED.with_name("lpv_smo_boxes.json")
SPAN = np.array([[195.0, 405.0], [22.0, 40.0], [0.0, 12500.0], [112.0, 390.0]])  # sampled: t, %, m, kt
DRAWS, SOBOL_SEED = 4096, 5
ALPHA_MAX, MACH_MAX = 12.5, 0.895  # deg, beyond it lift stalls; Mach, beyond it coefficients turn too fast
AROUND = 1.25  # a box is fitted to what lies within so many halves of its width
FEWEST = 12  # points that a box needs


def scattered(draws: int = DRAWS, progress: Callable[..., Any] | None = None) -> Any:
    """Trim and linearise at Sobol points of `SPAN` with steady flights short of stall; returns `lpv.Samples`."""
    return samples(steady(points(SPAN, draws), progress=progress))


def points(span: np.ndarray, draws: int) -> np.ndarray:
    """Return Sobol points (draws, 4) of a span (4, 2): t, %, m, kt."""
    low, high = span.T
    return low + (high - low) * qmc.Sobol(4, seed=SOBOL_SEED).random(draws)


def steady(
    at: np.ndarray, *, alpha_max: float = ALPHA_MAX, mach_max: float = MACH_MAX, aircraft: str = DEFAULT,
    progress: Callable[..., Any] | None = None,
) -> list[tuple]:  # fmt: skip
    """Return (rho, A, B, C, D, trim) of those points (k, 4) that have a steady flight below `alpha_max` [deg]."""
    kept: list = []
    for mass, cg, h, cas in at:
        try:
            made = linearize(FlightPoint(mass * 1e3, cg / 100.0, h, "cas", cas * M_S_PER_KT, aircraft=aircraft))
        except TrimError:
            continue
        if progress is not None:
            progress()
        mach = mach_at(cas, h)
        if math.degrees(made.trim.alpha) <= alpha_max and mach <= mach_max:
            kept.append((np.array([mass, cg, cas, mach]), *lpv.in_paper_units(made)))
    return kept


def samples(kept: list[tuple]) -> lpv.Samples:
    """Return `lpv.Samples` of what `steady` found."""
    rho, A, B, C, D, trims = (np.array(column) for column in zip(*kept))
    return lpv.Samples(rho, A, B, C, D, trims, [])


def mach_at(cas_kt: float, h: float) -> float:
    """Return the Mach number of `cas_kt` at `h` [m] in the standard atmosphere, up to 20 km."""
    impact = 101325.0 * ((1 + 0.2 * (cas_kt * M_S_PER_KT / 340.294) ** 2) ** 3.5 - 1)
    pressure = 101325.0 * (1 - 0.0065 * min(h, lpv.CEILING) / 288.15) ** 5.2558797
    pressure *= math.exp((min(h, lpv.CEILING) - h) / 6341.62)
    return math.sqrt(5 * ((impact / pressure + 1) ** (1 / 3.5) - 1))


def make(samples: Any, edges: Sequence[Sequence[float]] = EDGES) -> Any:
    """Return [(LpvModel, Design)] of every box of `edges` with at least `FEWEST` samples in it."""
    out = []
    for corner in itertools.product(*(itertools.pairwise(axis) for axis in edges)):
        box = np.array(corner)
        near = np.abs(lpv_model.normalise(samples.rho, box))
        if (near <= 1.0).all(1).sum() >= FEWEST:
            part = (near <= AROUND).all(1)
            names = ("rho", "A", "B", "C", "D", "trims")
            here = lpv.Samples(**{k: getattr(samples, k)[part] for k in names}, refused=[])
            model = boxes.rounded(lpv.fit(here, box=box, weight=np.ones(part.sum()))[0])
            out.append((model, lpv.design(model)))
    return out


def store(path: Path = STORED, *, progress: Callable[..., Any] | None = None) -> None:
    """Make the boxes of the aircraft in the tree, each with its inequalities verified, and write them to `path`."""
    pairs = make(scattered(progress=progress))
    boxes.save(pairs, path, aircraft_sha256=numbers_digest(FOLDER), draws=DRAWS, seed=SOBOL_SEED)


def check(path: Path = STORED) -> str:
    """Return "" when the stored boxes belong to the aircraft in the tree and verify, else what is wrong."""
    if not Path(path).is_file():
        return "no stored boxes of the LPV design; make them with: cosim design"
    held = json.loads(Path(path).read_text(encoding="utf-8"))
    if held["aircraft_sha256"] != numbers_digest(FOLDER):
        return "the LPV boxes were designed for other numbers in the aircraft's XML; mend: cosim design"
    bad = [k for k, (_, made) in enumerate(boxes.load(path)) if not synthesis.verify(made)["ok"]]
    return f"boxes {bad} of the LPV design do not verify" if bad else ""
