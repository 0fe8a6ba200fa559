"""[Mar10], further rows: the least faults that show, what a step costs, and the next step, after isolation."""

import dataclasses
import functools
import math
import time
from collections.abc import Iterator

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.flight.plant.point import SIX
from cosim.flight.signals import fly
from cosim.papers.mar10 import flights
from cosim.papers.row import Of, Planned, near
from cosim.scenario import load_scenario

NEXT = "our extension: the talk isolates, what then flies it does not say"


SEEN = {  # rows -> (smallest elevator fault that was found [deg], the others)
    "force": (0.451, ("rudder", "thrust")),
    "force+moment": (0.096, ("aileron", "rudder", "thrust")),
}
EFFECTORS = {
    "elevator": (0, RAD_PER_DEG, "deg"),
    "aileron": (1, RAD_PER_DEG, "deg"),
    "rudder": (2, RAD_PER_DEG, "deg"),
    "thrust": (3, 0.01, "%"),
}


@functools.cache
def _least(rows):
    """Return the smallest lock offsets [rad] or loss beyond the thresholds, in level flight at the Sun13 point."""
    flown = fly(flights.scenario(1, extra=("manoeuvre.start_s=40",)), flights.WIRES.values())
    p = flights.detector(rows=rows)
    log = flights.detector_log(flown, p)
    k = round(23.0 / flown.attrs["dt"])
    n = int(p["n_families"][0])
    S, tau = log["S"][k, :n], log["tau"][k, :n]
    with np.errstate(divide="ignore"):
        return (tau[:, None] / np.abs(S[:, :4])).min(0)


def _smallest(of):
    """Say what the thresholds let through: the smallest lock offset or loss seen. No force row sees the aileron."""

    def sizes(rows, names):
        found = {name: _least(rows)[EFFECTORS[name][0]] / EFFECTORS[name][1] for name in ("elevator", *names)}
        return found["elevator"], ", ".join(f"{n} {found[n]:.3g} {EFFECTORS[n][2]}" for n in names)

    for rows, (found, others) in SEEN.items():
        item = f"smallest fault beyond its threshold in level flight, rows of {rows}: all elevators [deg]"
        yield of.ours(item, lambda r=rows, o=others: sizes(r, o), *near(found))


def _cost(of):
    """Slide 4: nothing is integrated, to reduce the cost."""
    yield of.ours(
        "slide 4, a step of the residuals, all families and the decision, as a share of 5 ms [%]",
        _step,
        0.0,
        2.0,
        says='slide 4: "Avoid dynamical integration, to reduce computational cost"; no number; wall clock',
    )


def _step():
    flown, p, best = flights.fly(1), flights.detector(), math.inf
    for _ in range(3):
        begin = time.perf_counter()
        flights.detector_log(flown, p)
        best = min(best, time.perf_counter() - begin)
    took = best / len(flown)
    return 100.0 * took / flown.attrs["dt"], f"{1e6 * took:.1f} microseconds, with its log"


@functools.cache
def _reconfigured(point, reallocate):
    """Return (farthest from the altitude that the law holds [m], from the heading [deg]) from the engine's failure."""
    at = [f"flight.{k}={v}" for k, v in SIX[point].items()]
    scenario = load_scenario("mar10-reconfigured", [*at, f"law.reallocate={reallocate}"])
    f = fly(scenario, ["truth.aircraft.h", "law.law.h_ref", "truth.aircraft.psi"])
    late = f[f.index >= scenario.faults[1].start_s].to_numpy().T
    psi = np.unwrap(f["truth.aircraft.psi"].to_numpy())
    turned = np.abs(psi - psi[0])[-late.shape[1] :].max()
    return float(np.abs(late[0] - late[1]).max()), float(turned / RAD_PER_DEG)


def _farthest(i, reallocate):
    found = {point: _reconfigured(point, reallocate)[i] for point in SIX}
    return max(found.values()), ", ".join(f"{point} {v:.3g}" for point, v in found.items())


def _next(of):
    """Elevators locked, then an engine out: what is left flies."""
    for i, (what, band, without) in enumerate(
        (("altitude held [m]", (0.0, 50.0), (150.0, 1e4)), ("heading [deg]", (0.0, 10.0), None))
    ):
        item = f"elevators locked, then an engine out, reconfigured: farthest from the {what}, six points"
        row = of.beyond(item, NEXT, lambda i=i: _farthest(i, "true"), *band)
        yield dataclasses.replace(row, piece="reconfigured")
        if without:
            row = of.ours(f"the same without reconfiguration: farthest from the {what}", lambda: _farthest(0, "false"),
                          *without)  # fmt: skip
            yield dataclasses.replace(row, piece="not reconfigured")


def plan(of: Of) -> Iterator[Planned]:
    """Yield the Planned rows."""
    yield from _smallest(of)
    yield from _cost(of)
    yield from _next(of)
