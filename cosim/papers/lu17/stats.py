"""What the rows of [Lu17] ask of many seeds: is an estimate unbiased, does the rod follow, does it leave."""

import functools

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from actuators.hydraulic import lu17
from cosim.papers.lu17 import bench
from cosim.papers.row import Planned, ours
from fdi.hydraulic import iotsekf

# two-sided 99.9 % of t, 99 degrees of freedom
T_ONE, T_STATES, T_FOUR, T_ONE_WORST, T_STATES_WORST = 3.39, 3.72, 3.80, 5.42, 5.67
EVIDENCE = "cosim reproduce lu17"
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


def noise_share(scenario, **options):
    """Return (largest |mean error - that of a run without noise| / standard error of q, q', x3, f; which one).

    Student's t when the error is the same for every seed, noise or not.
    """
    out, quiet = bench.fly(scenario, **options), bench.fly(scenario, quiet=True, seeds=1, **options)
    worst = (0.0, "")
    for true, estimate in (*STATES, *FAULT):
        e, still = ((o[estimate] - o[true])[:, span("after")].mean(axis=1) for o in (out, quiet))
        t = abs(e.mean() - still.mean()) / (e.std(ddof=1) / np.sqrt(len(e)))
        worst = max(worst, (float(t), f"{true}: {e.mean():.3g} with noise, {still.mean():.3g} without"))
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
        error = {true: (out[estimate] - out[true])[:, on] for true, estimate in (*STATES, *FAULT)}
        found["over scatter", phase] = max(abs(e.mean()) / max(e.std(), 1e-300) for e in error.values())
        found["x3 error", phase], found["q' error", phase] = float(error["x3"].mean()), float(error["qd"].mean())
    for name, pairs in (("state", STATES), ("fault", FAULT)):
        found[f"{name} instant", "after"] = worst_instant(out, pairs, "after")
    k = round(bench.ONSET / bench.DT)
    late = out["surface"][:, k:]
    found["wanders", "after"] = 1e3 * float(np.abs(late - late[:, :1]).max())  # [mm]
    found["null", "after"] = 1e3 * float(np.abs(late).max())
    found["drift", "after"] = float((late[:, -1] - late[:, 0]).mean())
    found["leak", "after"] = float(_leak(out[:, k:]).mean())
    away = np.ones(out.shape[1], bool)  # but for 0.3 s after each step of the command
    for step in (bench.ONSET, 13.0, 16.0, 18.0, 19.0, 20.0):
        away[round(step / bench.DT) : round((step + 0.3) / bench.DT)] = False
    away[:k] = False
    e, f = (out["f_hat"] - out["f"])[:, away], out["f"][:, away]
    found["away from steps", "after"] = float(np.sqrt((e**2).mean() / max((f**2).mean(), 1e-300)))
    gain = _sine(out["f_hat"][:, span("after")]) / (_sine(out["f"][:, span("after")]) or 1e-300)
    found["gain", "after"] = abs(gain)
    found["delay", "after"] = float(-1e3 * np.angle(gain) / (2 * np.pi * bench.OFC_HZ))  # [ms]
    found["end", "after"] = 1e3 * float(out["surface"][:, -1].mean())
    return found


@functools.cache
def case(scenario, load="no load", seeds=bench.SEEDS, **options):
    """Return {(number, phase): value} of a scenario under a load; `options` of `lu17_bench.fly`."""
    return _summary(bench.fly(scenario, load, seeds=seeds, **options))


def _sine(y):
    """Return the complex amplitude of the OFC's frequency in the mean over the seeds, whole periods."""
    t = np.arange(y.shape[1]) * bench.DT
    return complex(2 * (y.mean(axis=0) * np.exp(-2j * np.pi * bench.OFC_HZ * t)).mean())


def _leak(out):
    """Return how far each seed's rod goes by (4) at rest: leakage, and more flow one way than the other [m].

    The valve is open by s - u + u as `f` has it; compressibility left out.
    """
    v = out["f"][:, 1:] + out["u"][:, :-1]
    x3 = out["x3"][:, :-1]
    flow = np.sqrt(np.maximum(1.0 - np.sign(v) * x3, 0.0)) * v - lu17.NOMINAL["L"] * x3
    return flow.sum(axis=1) * bench.DT


def row(item, says, measure, low, high, reason=""):
    """Return a Planned row of [Lu17]; a reason points to the rows of the same command."""
    return Planned("lu17", item, says, measure, low, high, reason, EVIDENCE if reason else "")


def beside(item, says, measure, low, high):
    """Return the Planned row of a number that [Lu17] does not give; low .. high is derived, other rows rest on it."""
    return ours("lu17", item, measure, low, high, says=says)


def get(key, scenario, load="no load", phase="after", scale=1.0, **options):
    """Return a function that looks up one number of a case."""
    return lambda: scale * case(scenario, load, **options)[key, phase]


def ratio(above, below, scenario, load="no load", phases=("after", "after")):
    """Return a function that divides one number of a case by another."""
    return lambda: case(scenario, load)[above, phases[0]] / case(scenario, load)[below, phases[1]]


@functools.cache
def linear_delay():
    """Return the delay [ms] of f_hat at the OFC's frequency in a Kalman filter of (4) linearised at rest.

    State (q, q', x3, f), f a random walk; the filter's own noises, no load.
    """
    p = lu17.params()[0]
    a22, a23, a31, a32, a33, b3, _ = lu17.jacobian(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, p)
    A = np.array([[0, 1, 0, 0], [0, a22, a23, 0], [a31, a32, a33, b3], [0, 0, 0, 0]])
    Phi = expm(A * bench.DT)
    Q = np.diag([*np.array(iotsekf.NOISE["q"])[:3], iotsekf.NOISE["q_f"]]) * bench.DT
    H = np.array([[1.0, 0, 0, 0]])
    scale = np.diag([1e-4, 1e-2, 1e-2, 1e-2])  # the Riccati solver wants entries of one size
    back = np.linalg.inv(scale)
    P = solve_discrete_are((back @ Phi @ scale).T, (H @ scale).T, back @ Q @ back, [[iotsekf.NOISE["r_rod"]]])
    P = scale @ P @ scale
    K = P @ H.T / (H @ P @ H.T + iotsekf.NOISE["r_rod"])
    # x+ = Phi x + Gamma f, the filter (Phi without f's column) adds K (y - H x-): both at z on the unit circle
    z = np.exp(2j * np.pi * bench.OFC_HZ * bench.DT)
    plant = np.linalg.solve(z * np.eye(3) - Phi[:3, :3], Phi[:3, 3])  # (q, q', x3) over the f of this tick
    closed = (np.eye(4) - K @ H) @ Phi
    estimate = np.linalg.solve(z * np.eye(4) - closed, z * K[:, 0]) * plant[0]
    return float(-1e3 * np.angle(estimate[3] * z) / (2 * np.pi * bench.OFC_HZ))  # against the f of the last tick


def relative_degree():
    """Return how often the rod must be differentiated until the valve shows, by (4) linearised at rest."""
    a22, a23, a31, a32, a33, b3, _ = lu17.jacobian(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, lu17.params()[0])
    A, b, row = np.array([[0, 1, 0], [0, a22, a23], [a31, a32, a33]]), np.array([0, 0, b3]), np.array([1.0, 0, 0])
    for r in range(1, 4):
        if row @ b != 0.0:
            return r
        row = row @ A
    return 4
