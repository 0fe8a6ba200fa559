"""[Mar10] row by row: signature table, the three scenarios, the robustness figure, and what this aircraft allows."""

import functools
import math
from collections import Counter
from typing import Any

import numpy as np

from cosim.flight.plant.force_model import force_model
from cosim.papers.mar10 import flights
from cosim.papers.mar10 import selection as mar10_selection
from cosim.papers.measured import share_of
from fdi.control_redundancy import structure as redundancy_structure

DRAWS = 20  # flown per scenario, with every set of options
# slide 10, families in its order: (delta_l, delta_m, delta_n, eta) -> residuals
TABLE = {
    (1, 1, 1, 1): 4,
    (1, 0, 1, 0): 2,
    (0, 1, 0, 0): 1,
    (1, 0, 1, 1): 4,
    (0, 1, 1, 1): 4,
    (1, 1, 0, 1): 4,
    (0, 0, 1, 1): 4,
    (1, 0, 0, 1): 4,
}
# A vehicle with the talk's pattern, to exercise all 27: accelerations [m/s2] per rad and per unit of throttle, of a
# 500 kg missile-like body at 40 kPa with 0.1 m2; own numbers, only their pattern is the talk's.
VEHICLE = np.array([[-1.5, -2.5, -2.0, 18.0], [3.0, 0.0, 28.0, 0.0], [0.0, -32.0, 0.0, 0.0]])
ELEVATOR = np.array([0.0, 0.05, 0.0, 0.55])  # inputs of slide 16
OPTIONS: tuple = (  # of the detector, which all judge the same flights
    {},  # mean and learned offset
    {"t_learn": 0.0},
    {"t_mean": 0.0, "t_learn": 0.0},  # raw samples
    {"rows": "force+moment"},
)


def injected() -> tuple[float, str]:
    """Inject a fault of each input into the vehicle: return (entries of 27 x 4 that contradict the table, and one where
    the direct r_ij identify another size; its error)."""
    u = np.array([0.02, -0.03, 0.01, 0.6])
    f = VEHICLE @ u
    wrong = sum(abs(r) > 1e-9 for _, _, r in redundancy_structure.residuals(f, VEHICLE, u))
    error = 0.0
    for j in range(4):
        fault = np.zeros(4)
        fault[j] = 0.05
        for family, i, r in redundancy_structure.residuals(f + VEHICLE @ fault, VEHICLE, u):
            wrong += (abs(r) > 1e-9) != bool(family.signature[j])
            if i == j and not family.pivots:
                error = max(error, abs(r - 0.05))
    wrong += error > 1e-9
    return wrong, f"error of the fault that r_ij identifies {error:.1g}"


@functools.cache
def _campaign(number):
    return flights.campaign(number, DRAWS, options=OPTIONS)


def share_right(runs: list) -> tuple[float, str]:
    """Return (share of draws that are right [%], its interval and what the others declared)."""
    share, words = share_of([o.right for o in runs])
    words += f"; further declarations in {sum(o.extra > 0 for o in runs)}"
    missed = [o for o in runs if not o.right]
    if missed:
        others = Counter(", ".join(name for _, name in o.order) or "nothing" for o in missed)
        reach, before, held, shared = (
            float(np.median([getattr(o, k) for o in missed])) for k in ("reach", "before", "held", "shared")
        )
        against = "" if math.isnan(before) else f"residual against it before {before:.2f}, "
        words += (
            f"; else declared: {'; '.join(f'{names} in {n}' for names, n in others.most_common(3))}; medians of those: "
            f"loss over threshold {reach:.2f}, {against}engine alone for {held:.2f} of the confirmation time, shared "
            f"with single engines for {100 * shared:.0f} % of the time"
        )
    return share, words


def identified() -> float:
    """Return the thrust loss [%] that scenario 1 identifies with the nominal aircraft."""
    flown, log, _ = mar10_selection.nominal_flight(1)
    return -100.0 * log["f_hat_thrust"][flown.index > 30.0].mean()


def throttle_in_error(u: np.ndarray, share: float, command: np.ndarray | None = None) -> Any:
    """Return what r~_14^5, blind to the elevator, says of the throttle with g_12 off by `share`: (4, ...) inputs `u`.

    `command`: what the detector believes, `u` itself by default. Slide 16
    """
    family = next(f for f in redundancy_structure.families(VEHICLE != 0) if f.signature == (1, 0, 0, 1))
    wrong = VEHICLE * (1.0 + share * (np.arange(12).reshape(3, 4) == 1))
    c, _ = redundancy_structure.combination(VEHICLE, family)
    return c @ (wrong @ u - VEHICLE @ (u if command is None else command)) / VEHICLE[0, 3]


def table() -> tuple[float, str]:
    """Return how many signatures of the talk's pattern have another number of residuals than slide 10 prints."""
    found = redundancy_structure.signatures(redundancy_structure.TALK)
    wrong = sum(found.get(k, 0) != TABLE.get(k, 0) for k in {*TABLE, *found})
    return wrong, f"{sum(found.values())} residuals, {len(found)} signatures"


def own_structure() -> np.ndarray:
    """Return which inputs move which row of forces of this aircraft, (3, 4), inputs in the talk's order."""
    return force_model().structure()[:3][:, [1, 0, 2, 3]]


def defined() -> tuple[int, str]:
    """Return how many of the 27 residuals this aircraft has."""
    own = own_structure()
    missing = redundancy_structure.undefined(own)
    return 27 - len(missing), f"{len(redundancy_structure.signatures(own))} signatures; {missing[0][1]}"


def isolated(scenario: int, options: int) -> tuple[float, str]:
    """Return the share of draws [%] of a scenario with the right effectors in order, with one of OPTIONS."""
    return share_right(_campaign(scenario)[options])


def median(options: int, field: str) -> tuple[float, str]:
    """Return the median of a field of scenario 1's outcomes, and its range."""
    found = [getattr(o, field) for o in _campaign(1)[options]]
    return float(np.median(found)), f"{min(found):.2f} .. {max(found):.2f}"


def drift() -> tuple[float, str]:
    """Return the change of slide 16 over the printed epsilon delta_m / (g_23 g_14); epsilon: 5 % of g_12."""
    g, moved = VEHICLE, 0.05 * VEHICLE[0, 1] * ELEVATOR[1]
    r = throttle_in_error(ELEVATOR, 0.05)
    note = f"over epsilon delta_m / g_14, which slide 9 gives: {r / (moved / g[0, 3]):.3f}"
    return r / (g[0, 1] * moved / (g[1, 2] * g[0, 3])), note
