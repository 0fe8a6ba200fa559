"""[Lu17], what the paper does not show: sizes behind the statistics, variants, faults as they are, the relative degree.

These rows carry the reasons of the others. The bands are what the paper's words would need, or say where they are from.
"""

import numpy as np

from cosim.papers.lu17 import bench
from cosim.papers.lu17 import reasons as why
from cosim.papers.lu17.stats import (
    T_FOUR,
    T_ONE,
    T_STATES,
    beside,
    case,
    get,
    linear_delay,
    noise_share,
    ratio,
    relative_degree,
    row,
)
from fdi.hydraulic import rtsekf

STATE, FAULT = "mean state error over its standard error", "mean fault error over its standard error"
UNBIASED = 'I: "in an unbiased sense"'


def _gain():
    """Return N of (48) after 100 ticks."""
    p = rtsekf.params("published", load=0, delay_s=0.0)
    u = np.zeros((1, 100), rtsekf.INPUTS)
    u["y_rod_valid"] = 1.0
    log = np.zeros(u.shape, rtsekf.STATE)
    rtsekf.rollout(rtsekf.init(p), u, p, bench.DT, log)
    return log["N"][0, -1]


def _sizes():
    for scenario in ("fault-free", "liquid OFC", "solid OFC"):
        for load in bench.LOADS:
            phase, when = ("whole", "") if scenario == "fault-free" else ("after", " after the fault")
            yield row(
                f"figure {bench.SCENARIOS[scenario][0]}, {scenario}, {load}{when}: largest mean error over the scatter "
                "of one estimate, of q, q', x3, f",
                UNBIASED,
                get("over scatter", scenario, load, phase),
                0,
                0.1,
                why.LOAD_INPUT if load == "load left out" else why.SOLID if scenario == "solid OFC" else "",
            )
    yield row(
        "figure 4, solid OFC, load known after the fault, but (17) at x_hat, sign(u + f): largest mean error over the "
        "scatter of one estimate",
        UNBIASED,
        get("over scatter", "solid OFC", "load known", centre=1.0, total_sign=1.0),
        0,
        0.1,
        why.SOLID,
    )
    yield beside(
        "figure 2, fault-free, load known, no noise: mean error of q' over that with noise",
        "not in the paper; 0 says that noise makes it",
        lambda: case("fault-free", "load known", quiet=True)["q' error", "whole"]
        / case("fault-free", "load known")["q' error", "whole"],
        -0.1,
        0.1,
    )
    yield beside(
        "figure 3, liquid OFC, no noise: mean error of x3 over that with noise",
        "not in the paper; 1 says that noise has no part in it",
        lambda: case("liquid OFC", quiet=True)["x3 error", "after"] / case("liquid OFC")["x3 error", "after"],
        0.9,
        1.1,
    )
    yield row(
        "figure 3(e), liquid OFC, no load: |f_hat / f| at 1 Hz",
        'IV.D: "estimated in an unbiased sense"',
        get("gain", "liquid OFC"),
        0.9,
        1.1,
    )
    yield beside(
        "figure 3(e), liquid OFC, no load: delay of f_hat over that of the linear filter, less 1",
        "not said; derived: a Kalman filter of the linear model with these noises, 5 %",
        lambda: case("liquid OFC")["delay", "after"] / linear_delay() - 1.0,
        -0.05,
        0.05,
    )


def _variants():
    for name, options in (
        ("(17) at x_hat", {"centre": 1.0}),
        ("(17) at x_hat, sign(u + f)", {"centre": 1.0, "total_sign": 1.0}),
    ):
        for scenario in ("liquid OFC", "solid OFC"):
            for what, long, band in (("state", STATE, T_STATES), ("fault", FAULT, T_ONE)):
                yield row(
                    f"figure {bench.SCENARIOS[scenario][0]}, {scenario}, no load, but {name}: {long}",
                    UNBIASED,
                    get(what, scenario, **options),
                    0,
                    band,
                    why.SINE if scenario == "liquid OFC" else why.STEPS,
                )
    for name, options in (
        ("as published", {}),
        ("but (17) at x_hat", {"centre": 1.0}),
        ("but (17) at x_hat, sign(u + f)", {"centre": 1.0, "total_sign": 1.0}),
    ):
        for scenario in ("liquid OFC", "solid OFC"):
            yield beside(
                f"figure {bench.SCENARIOS[scenario][0]}, {scenario}, no load, {name}: mean error less that of a run "
                "without noise, over its standard error",
                "not in the paper; derived: t of four quantities when every seed shares the error",
                lambda s=scenario, o=options: noise_share(s, **o),
                0,
                T_FOUR,
            )
    for name, options in (("as published", {}), ("but (17) at x_hat, sign(u + f)", {"centre": 1.0, "total_sign": 1.0})):
        yield row(
            f"figure 4(f), solid OFC, no load, away from the steps, {name}: rms of the fault's error over that of the "
            "fault",
            'IV.E: "the estimation error is small"',
            get("away from steps", "solid OFC", **options),
            0,
            0.1,
            why.SOLID if not options else "",
        )


def _loaded():
    for scenario, figure in (("fault-free", 2), ("liquid jamming", 5)):
        yield row(
            f"figure {figure}(a), {scenario}, load known, before the fault: rod farthest from reference [mm]",
            'IV.C: "can follow the command very well"',
            get("leaves", scenario, "load known", "before"),
            0,
            1,
            why.SLOPE,
        )
    yield row(
        "figure 2(a), fault-free, load known and constant: rod farthest from reference [mm]",
        'IV.C: "can follow the command very well"',
        get("leaves", "fault-free", "load known", "whole", hmd=0.0),
        0,
        1,
    )
    yield beside(
        "figure 4(a), solid OFC, load left out: drift over leakage and unequal flow by (4)",
        "not in the paper; 1 says that (4) explains the drift",
        ratio("drift", "leak", "solid OFC", "load left out"),
        0.9,
        1.1,
    )


def _structure():
    yield row(
        "section III.A, relative degree of (9)-(11)",
        '"in this paper, r = 2"',
        relative_degree,
        2,
        2,
        "q'' of (4) does not contain u, so that (13) with r = 2 divides by zero; the third-order reference model of "
        "III.B supplies what r = 3 needs",
    )
    yield beside("section V.B, gain N of (48) for m = p = 1, F = 1", "(48), not evaluated", _gain, 1, 1)
    for scenario, of in (("held rod", "solid jamming"), ("held valve", "runaway")):
        yield row(
            f"figure {bench.SCENARIOS[scenario][0]}(b), {of} as it is ({scenario}), no load: largest error of q_hat "
            "after the fault [mm]",
            'V.D, V.E: "estimation of the states is unbiased"',
            get("q error", scenario),
            0,
            1,
            why.REAL,
        )


def plan():
    """Return what is asked beyond the paper, as Planned rows."""
    return [*_sizes(), *_variants(), *_loaded(), *_structure()]
