"""[Mar10] row by row: signature table, the three scenarios on this aircraft, the robustness figure.

Slides 13 to 15 show curves without numbers. What they claim follows from slide 10: a residual reacts to the faults that
its signature names and to no other, and after one fault those blind to it show the next.
"""

import functools
from collections import Counter
from typing import Any

import numpy as np

from cosim.flight.plant.force_model import force_model
from cosim.papers.mar10 import flights
from cosim.papers.measured import share_of
from fdi.control_redundancy import structure

DRAWS = 20  # flown per scenario
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
INPUTS = ("elevator", "aileron", "rudder", "engine")


def table() -> tuple[float, str]:
    """Return how many signatures of the talk's pattern have another number of residuals than slide 10 prints."""
    found = structure.signatures(structure.TALK)
    wrong = sum(found.get(k, 0) != TABLE.get(k, 0) for k in {*TABLE, *found})
    return wrong, f"{sum(found.values())} residuals, {len(found)} signatures"


def injected() -> tuple[float, str]:
    """Inject a fault of each input into the vehicle: return (entries of 27 x 4 that contradict the table, and one where
    the direct r_ij identify another size; its error)."""
    u, wrong, error = np.array([0.02, -0.03, 0.01, 0.6]), 0, 0.0
    for family in structure.families(VEHICLE != 0):
        c, _ = structure.combination(VEHICLE, family)
        scale = VEHICLE[family.base, list(family.solved)]
        for j, fault in enumerate([*0.05 * np.eye(4), np.zeros(4)]):
            r = c @ (VEHICLE @ (u + fault) - VEHICLE @ u) / scale  # of the row solved for each of its inputs
            wrong += np.sum((np.abs(r) > 1e-9) != bool((*family.signature, 0)[j]))
            if j in family.solved and not family.pivots:
                error = max(error, abs(r[family.solved.index(j)] - 0.05))
    return wrong + (error > 1e-9), f"error of the fault that r_ij identifies {error:.1g}"


@functools.cache
def nominal_flight(number: int) -> Any:
    """Return (flight, detector log) of a scenario with nominal aircraft and sensors."""
    flown = flights.fly(number)
    return flown, flights.detector_log(flown, flights.detector())


def chosen(number: int) -> tuple[float, str]:
    """Return (faults of a scenario that no residual of their own shows, or that one shows too early; what fires).

    A family is a fault's own that it moves while the earlier ones do not, until a later fault moves it too; it is early
    when it fires before any fault that moves it, from the learned offset on.
    """
    flown, log = nominal_flight(number)
    families = structure.families(force_model().structure())
    t, truth, early = flown.index.to_numpy(), flights.TRUTH[number], []
    own: dict[str, list[str]] = {name: [] for name, _ in truth}
    for family, fired in zip(families, log["fired"].T > 0.5):
        moved = [(name, at) for name, at in truth if family.signature[INPUTS.index(name)]]
        first, second = ([at for _, at in moved] + [np.inf] * 2)[:2]
        if fired[(t >= 20.0) & (t < first)].any():
            early.append(family.name)
        if fired[(t >= first) & (t < second)].any():
            own[moved[0][0]].append(family.name)
    words = "; ".join(f"{name}: {', '.join(which) or 'none'}" for name, which in own.items())
    alone = sum(not which for which in own.values())
    return len(early) + alone, words + (f"; early: {', '.join(early)}" if early else "")


def isolated(scenario: int) -> tuple[float, str]:
    """Return (share of draws [%] with the right effectors in order from raw samples, its interval and what the others
    declared)."""
    runs = [flights.raw(scenario, draw) for draw in range(DRAWS)]
    share, words = share_of([o.right for o in runs])
    others = Counter(", ".join(name for _, name in o.order) or "nothing" for o in runs if not o.right)
    words += "".join(f"; {names} in {n}" for names, n in others.most_common(3))
    return share, f"{words}; noise of one sample {np.median([o.noise for o in runs]):.2f} of what the loss does"


def identified() -> float:
    """Return the thrust loss [%] that scenario 1 identifies with the nominal aircraft."""
    flown, log = nominal_flight(1)
    return -100.0 * log["f_hat_thrust"][flown.index > 30.0].mean()


def throttle_in_error(u: np.ndarray, share: float, command: np.ndarray | None = None) -> Any:
    """Return what r~_14^5, blind to the elevator, says of the throttle with g_12 off by `share`: (4, ...) inputs `u`.

    `command`: what the detector believes, `u` itself by default. Slide 16
    """
    family = next(f for f in structure.families(VEHICLE != 0) if f.signature == (1, 0, 0, 1))
    wrong = VEHICLE * (1.0 + share * (np.arange(12).reshape(3, 4) == 1))
    c, _ = structure.combination(VEHICLE, family)
    return c @ (wrong @ u - VEHICLE @ (u if command is None else command)) / VEHICLE[0, 3]


def drift() -> tuple[float, str]:
    """Return the change of slide 16 over the printed epsilon delta_m / (g_23 g_14); epsilon: 5 % of g_12."""
    g, moved = VEHICLE, 0.05 * VEHICLE[0, 1] * ELEVATOR[1]
    r = throttle_in_error(ELEVATOR, 0.05)
    note = f"over epsilon delta_m / g_14, which slide 9 gives: {r / (moved / g[0, 3]):.3f}"
    return r / (g[0, 1] * moved / (g[1, 2] * g[0, 3])), note
