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


def _columns(vehicle):
    return vehicle * np.array([1.0, 1.0, 1.0, 0.01])


@contextlib.contextmanager
def _wide():
    """Double every threshold of the transport's detector; two draws are enough to see that."""

    def other(made):
        def detector(**kw):
            p = made(**kw)
            p["threshold"] *= 2.0
            p["rel"] *= 2.0
            return p

        return detector

    with swap(FLIGHTS, wrap_detector=other), swap(ROWS, DRAWS=2):
        yield


@contextlib.contextmanager
def _half():
    with swap(FLIGHTS, LOSS=dict.fromkeys(flights.LOSS, 0.5)), swap(ROWS, DRAWS=2):
        yield


def _slow():
    return swap(FURTHER, wrap_step=lambda step: lambda: (5000.0 * step()[0], ""))


def _as_it_is(word):
    return lambda load: lambda name, changes: load(name, [*changes, f"law.reallocate={word}"])


def _rudder(load):
    """Return a load_scenario in which the rudder runs to its stop when the engine fails."""

    def other(name, changes):
        held = load(name, changes)
        start = held.faults[1].start_s
        own = ("target=rudder", "kind=runaway", "rate_deg_s=5", "limit_deg=15", f"start_s={start}")
        return load(name, [*changes, *(f"faults.2.{key}" for key in own)])

    return other


BREAKS = (
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
    Break(
        "the roll fins make no side force",
        lambda: swap(VEHICLE_FLIGHTS, wrap_numbers=lambda numbers: lambda: numbers() | {"cyl": 0.0}),
        ("flying vehicle: residuals that exist",),
    ),
    Break("g_14 is a hundredth", lambda: swap(ROWS, wrap_VEHICLE=_columns), ("as a share of throttle",)),
    Break(
        "all but one residual are taken for defined",
        lambda: swap(STRUCTURE, wrap_undefined=lambda undefined: lambda own: undefined(own)[:1]),
        ("residuals of the 27 that are defined",),
    ),
    Break(
        "the thresholds are twice as wide",
        _wide,
        ("mean and learned offset: loss", "mean, no offset: loss", "rows of force: all", "rows of force+moment: all"),
        "option",
    ),
    Break("the loss is taken for half of the thrust", _half, ("noise of one sample",)),
    Break(
        "the thresholds of moments are those for gusts",
        lambda: swap(FLIGHTS, wrap_detector=lambda made: lambda **kw: made(**kw | {"gusts": True})),
        ("thresholds of still air",),
        "option",
    ),
    Break(
        "nothing is reallocated",
        lambda: swap(FURTHER, wrap_load_scenario=_as_it_is("false")),
        ("reconfigured: farthest from the altitude held [m], six",),
        "option",
    ),
    Break(
        "the rudder runs away, too",
        lambda: swap(FURTHER, wrap_load_scenario=_rudder),
        ("reconfigured: farthest from the heading",),
    ),
    Break(
        "the stabiliser flies on",
        lambda: swap(FURTHER, wrap_load_scenario=_as_it_is("true")),
        ("the same without reconfiguration",),
    ),
)
