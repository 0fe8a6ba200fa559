"""What is broken in turn in the estimator of [Sun13] or in what it is shown, and the rows that must see it."""

import dataclasses

import numpy as np

from cosim.papers.broken import Break, swap
from cosim.papers.sun13 import variants
from fdi.rfafe import rfafe

VARIANTS = "cosim.papers.sun13.variants"
ROWS, FLOWN, DECOUPLING, DESIGNS = (f"cosim.papers.sun13.{name}" for name in ("rows", "flown", "decoupling", "designs"))


def _design(name, make):
    """Return the swap of the design that an estimator flies with when none is named."""

    def wrap(estimated):
        def other(r, form, p=None):
            return estimated(r, form, make() if p is None and form == name else p)

        return other

    return lambda: swap(FLOWN, wrap_estimated=wrap)


def _still_commanded(load):
    """Return a load_scenario in which a solid OFC leaves the command on, through a doublet."""

    def other(name, changes=()):
        more = ["manoeuvre.kind=nz_doublet", "manoeuvre.start_s=21", "faults.0.amplitude_travel=0.033"]
        return load("sun13-liquid-ofc", [*changes, *more])

    return other


def _unstable(choose):
    def other(*args):
        design, entry = choose(*args)
        return dataclasses.replace(design, N=-design.N), entry

    return other


def _along(choose):
    def other(*args):
        design, entry = choose(*args)
        return dataclasses.replace(design, E=design.F), entry

    return other


def _slow_learning(choose):
    def other(*args):
        design, entry = choose(*args)
        return dataclasses.replace(design, Gamma=0.1 * design.Gamma), entry

    return other


def _slow():
    return rfafe.params(stored=variants.published("six flights", 10.0))


def _smallest(reduce):
    """Return (36) with the order of its singular values reversed."""

    def other(E, rank):
        U, sigma, _ = np.linalg.svd(E, full_matrices=False)
        return (U * sigma)[:, ::-1][:, :rank]

    return other


def _halved(discretise):
    return lambda *, gain, **more: discretise(gain=0.5 * gain, **more)


def _uncoupled(made):
    return lambda source="six flights", cross=0.7: made(source, 0.0)


BREAKS = (
    Break(
        "(36) keeps the smallest singular values",
        lambda: swap("fdi.rfafe.rfafe", wrap_reduce_E=_smallest),
        ("(36), E",),
        "method",
    ),
    Break("(28) is halved", lambda: swap(DESIGNS, wrap_discretise=_halved), ("(2), (28): largest",), "method"),
    Break("P has no cross term", lambda: swap(VARIANTS, wrap_coupled=_uncoupled), ("P couples",), "option"),
    Break("N of (7) has the wrong sign", lambda: swap(DESIGNS, wrap_choose=_unstable), ("theorem 2",), "method"),
    Break(
        "the liquid OFC is the solid one, the solid one the liquid",
        lambda: swap(FLOWN, SCENARIO={"ofc_liquid": "sun13-solid-ofc", "ofc_solid": "sun13-liquid-ofc"}),
        ("figure 3,", "figure 4, 0.033 of travel at 1 Hz: left elevator's amplitude"),
    ),
    Break(
        "a solid OFC leaves the command on",
        lambda: swap(FLOWN, wrap_load_scenario=_still_commanded),
        ("rest of the left elevator",),
    ),
    Break(
        "the learning rate of (17) is a quarter",
        _design("rfafe", _slow),
        (
            "figure 5, still air",
            "figure 6, 0.016 of travel at 0.5",
            "figure 6, 0.016 of travel at 1 Hz, light",
            "figure 7, 0.033 of travel at 0.5",
            "figure 7, 0.033 of travel at 1 Hz, light",
            "both sides at once, left 1 Hz",
        ),
        "method",
    ),
    Break(
        "the fault-free flight is in severe turbulence",
        lambda: swap(ROWS, wrap_fly_aircraft=lambda fly: lambda **kw: fly(**kw, flight={"turbulence": "severe"})),
        ("figures 5 and 6",),
    ),
    Break(
        "the fault oscillates a tenth faster than said",
        lambda: swap(FLOWN, wrap_faulty=lambda fly: lambda kind, hz, *more: fly(kind, 1.1 * hz, *more)),
        ("figure 6, 0.016 of travel at 1 Hz: frequency", "figure 7, 0.033 of travel at 1 Hz: frequency"),
    ),
    Break(
        "coefficients are 30 % off instead of 5",
        lambda: swap("cosim.papers.sun13.variants", WRONG=(("Cm_alpha", 1.3), ("Cm_de", 0.6), ("Cm_q", 0.6))),
        ("Cm_alpha +5 %",),
    ),
    Break(
        "the learning rate stays where it is",
        lambda: swap("cosim.papers.sun13.decoupling", BANDWIDTH=(40.0, 40.0, 40.0)),
        ("learning rate a quarter", "learning rate four times"),
        "option",
    ),
    Break("E is F_a", lambda: swap(DESIGNS, wrap_choose=_along), ("theorem 1",), "method"),
    Break(
        "the learning rate of (28) is a tenth",
        lambda: swap(DESIGNS, wrap_choose=_slow_learning),
        ("(28), a step",),
        "method",
    ),
)
