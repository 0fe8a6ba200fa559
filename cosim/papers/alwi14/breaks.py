"""What is broken in turn in the observer of [Alwi14] or in what it is shown, and the rows that must see it."""

import dataclasses

import numpy as np

from cosim.papers.alwi14.flights import POINTS
from cosim.papers.broken import Break, swap
from cosim.training import lpv
from fdi.lpv_smo import model as lpv_model
from fdi.lpv_smo import synthesis

MODEL, ROWS, QUIET, MOTION, PLANT = (
    f"cosim.papers.alwi14.{name}" for name in ("model", "rows", "quiet", "motion", "plant")
)
OBSERVER = "fdi.lpv_smo.lpv_smo"


def _five_points(fit):
    """Return what fit() says of a model that is fitted to the paper's five points alone."""

    def other():
        model, _ = lpv.fit(lpv.sample(np.array(list(POINTS.values()))))
        vertices = [float(lpv_model.at(model.B, v)[4, 0]) for v in lpv_model.vertices(lpv.BOX)]
        return fit() | {"b51_vertices": vertices, "b11": fit()["b51"]}

    return other


def _turned(_):
    return lambda: synthesis.verify(dataclasses.replace(made := synthesis.load()[1], L=-made.L))


def _weak(params):
    """Return params() with a modulation gain of a hundredth of the paper's."""

    def other(*args, **more):
        p = params(*args, **more)
        p["K"] *= 0.01
        return p

    return other


def _larger(share):
    """Return a wrapper of `nonlinear` that flies the faults `share` larger than said."""
    return lambda flown: lambda point, faults, **more: flown(point, tuple(f * (1 + share) for f in faults), **more)


def _disturbed(flown):
    return lambda point, faults, **more: flown(point, tuple(f or d for f, d in zip(faults, (0.3, 0.1, 0.5))), **more)


def _plant(fly):
    return lambda made, rho, block, faults, **more: fly(
        made, rho, block, faults=tuple(1.05 * f for f in faults), **more
    )


NEXT = dict(zip("ABCDE", "CAEBD"))


def _half_of_w(lemma):
    return lambda lib, part, P1, P2, Y, W, *more: lemma(lib, part, P1, P2, Y, 0.5 * W, *more)


BREAKS = (
    Break(
        "W_1 enters the LMIs with half of its size",
        lambda: swap("fdi.lpv_smo.synthesis", wrap__lemma=_half_of_w),
        ("section 3, made anew from",),
        "method",
    ),
    Break(
        "the model is fitted to the paper's five points alone, alpha and q are exchanged",
        lambda: swap(MODEL, wrap_fit=_five_points),
        ("section 2.2, B51", "section 5, neglected B11"),
        "method",
    ),
    Break(
        "L of (21) has the wrong sign",
        lambda: swap(MODEL, wrap_certificate=_turned),
        ("slowest pole", "largest eig"),
        "method",
    ),
    Break(
        "the LPV plant's faults are 5 % larger than said",
        lambda: swap(ROWS, wrap_fly=_plant),
        ("LPV plant, worst error of elevator", "LPV plant, worst error of n_z", "LPV plant, worst error of alpha"),
    ),
    Break(
        "the modulation gain K of (15) is a hundredth",
        lambda: swap(OBSERVER, wrap_params=_weak),
        (
            "LPV plant, largest |e_y|",
            "figure 1c, nonlinear aircraft, no noise: largest |e_y|",
            "figure 2c, nonlinear aircraft, no noise: largest |e_y|",
            "sensor set transport: largest |e_y|",
            "(17), section 5",
        ),
        "method",
    ),
    Break(
        "n_z is off by 0.1 g and alpha by 0.5 deg in the fault-free flights",
        lambda: swap(QUIET, wrap_nonlinear=_disturbed),
        ("largest fault-free n_z", "largest fault-free alpha", "sensor set transport: fault-free elevator"),
    ),
    Break(
        "the faults are a tenth larger than said",
        lambda: swap(ROWS, wrap_nonlinear=_larger(0.1)),
        (
            "5 deg: worst error of elevator",
            "5 deg: worst error of n_z",
            "5 deg: worst error of alpha",
            "offset learned up to",
            "as published, no offset",
        ),
    ),
    Break(
        "each point of table 4 is flown where another is",
        lambda: swap(QUIET, wrap__quiet_flight=lambda fly: lambda point: fly(NEXT[point])),
        ("table 4, Mach",),
    ),
    Break(
        "the stabiliser moves as the elevator does",
        lambda: swap(QUIET, wrap__ranges=lambda r: lambda name, unit: r(name.replace("stab_cmd", "de_cmd"), unit)),
        ("figure 1b",),
    ),
    Break("there is no fault", lambda: swap(QUIET, SENSIBLE=(0.0, 0.0, 0.0)), ("figure 2a",)),
)
