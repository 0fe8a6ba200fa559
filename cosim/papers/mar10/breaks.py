"""What is broken in turn in the method of [Mar10], and the rows that must see it."""

import contextlib

import numpy as np

from cosim.papers.broken import Break, swap
from cosim.papers.mar10 import flights

ROWS, FLIGHTS, FURTHER = (f"cosim.papers.mar10.{name}" for name in ("rows", "flights", "further"))
STRUCTURE = "fdi.control_redundancy.structure"
LABELS = ("mean and learned offset", "mean, no offset", "force and moment rows")
SCENARIOS = ((1, "engine"), (2, "elevator, then engine"), (3, "engine, then elevator, then rudder"))


@contextlib.contextmanager
def _axes():
    """Swap the x and z axes of the accelerometers; two draws are enough to see that."""
    with swap(FLIGHTS, wrap_WIRES=lambda w: w | {"n_x": w["n_z"], "n_z": w["n_x"]}), swap(ROWS, DRAWS=2):
        yield


def _weights(combination):
    def other(G, family):
        c, s = combination(G, family)
        return c * np.array([1.0, 1.0, 1.1]), s

    return other


VEHICLE_FLIGHTS, ISOLATION = "cosim.papers.mar10.vehicle", "cosim.papers.mar10.isolation"


def _lifted(equations):
    """Take the pitch fins' force for one of the other sign."""

    def other(flown, of):
        known, G = equations(flown, of)
        return known, G * np.array([1.0, 1.0, -1.0])[:, None]

    return other


def _weak(equations):
    def other(flown, of):
        known, G = equations(flown, of)
        return known, G * np.array([1.0, 1.0, 1.0, 1.0 / 3.0])

    return other


BREAKS = (
    Break(
        "no bank is asked of the vehicle, so that its roll fins stand still",
        lambda: swap("cosim.papers.mar10.vehicle_rows", BANK=0.0),
        ("vehicle, roll fins locked",),
    ),
    Break(
        "the aileron moves the z axis too (slide 7)",
        lambda: swap(STRUCTURE, wrap_TALK=lambda talk: talk | (np.arange(12).reshape(3, 4) == 8)),
        ("slide 10, sig",),
        "method",
    ),
    Break(
        "f_3 enters the combinations of slide 9 ten per cent too large",
        lambda: swap(STRUCTURE, wrap_combination=_weights),
        ("slides 8 to 10",),
        "method",
    ),
    Break(
        "the x and z axes of the accelerometers are swapped",
        _axes,
        (
            "slide 13, scenario 1",
            "slide 14, scenario 2",
            "slide 15, scenario 3",
            "scenario 1, identified thrust loss [%]",
            *(f"scenario {n} ({who}), {label}" for n, who in SCENARIOS for label in LABELS),
            f"thresholds {flights.GUSTS:g} times those",
        ),
    ),
    Break(
        "the vehicle's pitch fins push the other way than its equations say",
        lambda: swap(ISOLATION, wrap_equations=_lifted),
        (
            "flying vehicle: families that fire though blind",
            "vehicle, scenario 1 (",
            "vehicle, scenario 2 (",
            "vehicle, scenario 3 (",
            "vehicle without a fault",
            "vehicle, a mean of 0.3 s",
            "vehicle, twice the bound",
        ),
        "method",
    ),
    Break(
        "the motor's share of the thrust is a third of what it is",
        lambda: swap(ISOLATION, wrap_equations=_weak),
        ("vehicle, scenario 1, identified thrust loss",),
        "method",
    ),
)
