"""[Mar10], further rows: the least faults that show, what a step costs, and the next step, after isolation."""

import functools

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.flight.loop.signals import fly
from cosim.flight.plant.point import SIX
from cosim.papers.mar10 import flights
from cosim.papers.measured import at_point, share_of_tick, worst
from cosim.scenario import load_scenario

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


def step() -> tuple[float, str]:
    """Return the time of a step of all residuals as a share of 5 ms [%], and in microseconds."""
    flown, p = flights.fly(1), flights.detector()
    share, told = share_of_tick(lambda: flights.detector_log(flown, p), flown.attrs["dt"])
    return share, f"{told}, with its log"


@functools.cache
def _reconfigured(point, reallocate):
    """Return (farthest from the altitude that the law holds [m], from the heading [deg]) from the engine's failure."""
    scenario = load_scenario("mar10-reconfigured", [*at_point(point), f"law.reallocate={reallocate}"])
    f = fly(scenario, ["truth.aircraft.h", "law.law.h_ref", "truth.aircraft.psi"])
    late = f[f.index >= scenario.faults[1].start_s].to_numpy().T
    psi = np.unwrap(f["truth.aircraft.psi"].to_numpy())
    turned = np.abs(psi - psi[0])[-late.shape[1] :].max()
    return float(np.abs(late[0] - late[1]).max()), float(turned / RAD_PER_DEG)


def farthest(i: int, reallocate: str) -> tuple[float, str]:
    """Return how far the aircraft leaves its altitude [m] (i = 0) or heading [deg] (1), six points."""
    return worst({point: _reconfigured(point, reallocate)[i] for point in SIX}, "{} {:.3g}")


def smallest(rows: str, others: tuple) -> tuple[float, str]:
    """Return the smallest lock offset of all elevators beyond its threshold [deg]; the `others` in the note."""
    found = {name: _least(rows)[EFFECTORS[name][0]] / EFFECTORS[name][1] for name in ("elevator", *others)}
    return found["elevator"], ", ".join(f"{n} {found[n]:.3g} {EFFECTORS[n][2]}" for n in others)
