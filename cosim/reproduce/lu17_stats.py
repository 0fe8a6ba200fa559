"""What the rows of [Lu17] ask of many seeds: is an estimate unbiased, does the rod follow, does it leave."""

import functools

import numpy as np

from cosim.reproduce import lu17_bench as bench

STATES = (("q", "q_hat"), ("qd", "qd_hat"), ("x3", "x3_hat"))
FAULT = (("f", "f_hat"),)
PHASES = {"before": bench.BEFORE, "after": bench.AFTER, "whole": bench.WHOLE}


def span(phase):
    """Return the slice of ticks of a phase."""
    a, b = PHASES[phase]
    return slice(round(a / bench.DT), round(b / bench.DT))


def mean_error(out, pairs, phase):
    """Return (largest |mean error| / its standard error, that mean error) over `pairs`.

    The error of a seed is the mean over the phase; its mean over the seeds and the standard error of that make
    Student's t with seeds - 1 degrees of freedom when the estimate is unbiased.
    """
    worst = (0.0, 0.0)
    for true, estimate in pairs:
        e = (out[estimate] - out[true])[:, span(phase)].mean(axis=1)
        spread = e.std(ddof=1) / np.sqrt(len(e))
        t = abs(e.mean()) / max(spread, 1e-300)  # a held rod has no spread at all
        if t > worst[0]:
            worst = (float(t), float(e.mean()))
    return worst


def worst_instant(out, pairs, phase):
    """Return the largest over ticks and `pairs` of |mean error over the seeds| / its standard error."""
    worst = 0.0
    for true, estimate in pairs:
        e = (out[estimate] - out[true])[:, span(phase)]
        spread = e.std(axis=0, ddof=1) / np.sqrt(len(e))
        worst = max(worst, float((np.abs(e.mean(axis=0)) / np.maximum(spread, 1e-300)).max()))
    return worst


def _summary(out):
    """Return the numbers that the rows need of one case."""
    found = {}
    for phase in PHASES:
        on = span(phase)
        for name, pairs in (("state", STATES), ("fault", FAULT)):
            found[name, phase], found[f"{name} error", phase] = mean_error(out, pairs, phase)
        leave = np.abs(out["surface"] - out["r"])[:, on]
        found["leaves", phase] = 1e3 * float(leave.max())  # [mm]
        found["leaves rms", phase] = 1e3 * float(np.sqrt((leave**2).mean()))
        found["fault rms", phase] = float(np.sqrt((out["f"][:, on] ** 2).mean()))
        found["fault error rms", phase] = float(np.sqrt(((out["f_hat"] - out["f"])[:, on] ** 2).mean()))
        found["f_hat rms", phase] = float(np.sqrt((out["f_hat"][:, on] ** 2).mean()))
        found["q error", phase] = 1e3 * float(np.abs(out["q_hat"] - out["q"])[:, on].max())  # [mm]
        found["u", phase] = float(np.abs(out["u"][:, on]).max())
        found["f_hat", phase] = float(out["f_hat"][:, on].mean())
        found["rod leaves", phase] = 1e3 * float((out["q"] - out["r"])[:, on].mean())  # [mm]
        found["sensor leaves", phase] = 1e3 * float((out["surface"] + out["f"] - out["r"])[:, on].mean())
    for name, pairs in (("state", STATES), ("fault", FAULT)):
        found[f"{name} instant", "after"] = worst_instant(out, pairs, "after")
    k = round(bench.ONSET / bench.DT)
    late = out["surface"][:, k:]
    found["wanders", "after"] = 1e3 * float(np.abs(late - late[:, :1]).max())  # [mm]
    found["null", "after"] = 1e3 * float(np.abs(late).max())
    found["end", "after"] = 1e3 * float(out["surface"][:, -1].mean())
    return found


@functools.cache
def case(scenario, load="no load", seeds=bench.SEEDS, **options):
    """Return {(number, phase): value} of a scenario under a load; `options` of `lu17_bench.fly`."""
    return _summary(bench.fly(scenario, load, seeds=seeds, **options))


def relative_degree():
    """Return how often the rod must be differentiated until the valve shows, by (4) linearised at rest."""
    from actuators import lu17

    a22, a23, a31, a32, a33, b3, _ = lu17.jacobian(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, lu17.params()[0])
    A, b, row = np.array([[0, 1, 0], [0, a22, a23], [a31, a32, a33]]), np.array([0, 0, b3]), np.array([1.0, 0, 0])
    for r in range(1, 4):
        if row @ b != 0.0:
            return r
        row = row @ A
    return 4
