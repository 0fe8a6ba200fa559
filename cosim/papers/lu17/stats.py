"""What the rows of [Lu17] ask of many seeds: how far off an estimate is, whether the rod follows or leaves."""

import functools
from typing import Any

import numpy as np
from scipy.linalg import expm, solve_discrete_are
from scipy.stats import t as student

from actuators.hydraulic import lu17
from cosim.papers.lu17 import bench
from fdi.hydraulic import iotsekf

STATES = (("q", "q_hat"), ("qd", "qd_hat"), ("x3", "x3_hat"))
LEVEL = 0.01  # of the tests of a mean


def span(phase: Any) -> Any:
    """Return the slice of ticks of a phase."""
    a, b = bench.PHASES[phase]
    return slice(round(a / bench.DT), round(b / bench.DT))


def _student(e):
    """Return the size of Student's t of errors (seeds, ...) whose mean should be zero."""
    return np.abs(e.mean(0)) / np.maximum(e.std(0, ddof=1) / np.sqrt(len(e)), 1e-300)


def _beyond(e):
    """Return the share of instants at which the mean of errors (seeds, ticks) is beyond its bound of LEVEL."""
    return float((_student(e) > student.ppf(1.0 - LEVEL / 2.0, len(e) - 1)).mean())


def _summary(out):
    found = {}
    for phase in bench.PHASES:
        on = span(phase)
        leave = np.abs(out["surface"] - out["r"])[:, on]
        found["leaves", phase] = 1e3 * float(leave.max())  # [mm]
        found["leaves rms", phase] = 1e3 * float(np.sqrt((leave**2).mean()))
        error = {true: (out[estimate] - out[true])[:, on] for true, estimate in (*STATES, ("f", "f_hat"))}
        beyond = {true: _beyond(e) for true, e in error.items()}
        found["fault", phase], found["state", phase] = beyond["f"], max(beyond[true] for true, _ in STATES)
        found["drift", phase] = max(_student(error[true].mean(1)) for true, _ in STATES)
        found["nis", phase] = float(out["nis"][:, on].mean())
        ahead = (out["f_hat"][:, :-1] - out["f"][:, 1:])[:, on]  # the filter's f is that of the tick to come
        found["nees", phase] = float((ahead**2 / np.maximum(out["f_sigma"][:, :-1][:, on], 1e-12) ** 2).mean())
        found["fault error", phase] = float(error["f"].mean())
        found["fault error rms", phase] = float(np.sqrt((error["f"] ** 2).mean()))
        found["fault rms", phase] = float(np.sqrt((out["f"][:, on] ** 2).mean()))
        found["q error", phase] = 1e3 * float(np.abs(error["q"]).max())  # [mm]
        found["f_hat", phase] = float(out["f_hat"][:, on].mean())
        found["rod leaves", phase] = 1e3 * float((out["q"] - out["r"])[:, on].mean())  # [mm]
    late = out["surface"][:, round(bench.ONSET / bench.DT) :]
    found["wanders", "after"] = 1e3 * float(np.abs(late - late[:, :1]).max())  # [mm]
    gain = _sine(out["f_hat"][:, span("after")]) / (_sine(out["f"][:, span("after")]) or 1e-300)
    found["gain", "after"] = abs(gain)
    found["delay", "after"] = float(-1e3 * np.angle(gain) / (2 * np.pi * bench.OFC_HZ))  # [ms]
    return found


@functools.cache
def case(scenario: str, load: Any = "no load", seeds: int | None = None, **options: Any) -> Any:
    """Return {(number, phase): value} of a scenario under a load; `options` of `bench.fly`, `bench.SEEDS` seeds.

    "state" and "fault" are the share of instants at which the mean error of the seeds is beyond its bound of LEVEL (the
    largest of q, q', x3), "drift" the largest Student's t of the mean over time, "nis" and "nees" the squared
    innovation and fault error over the variance that the IOTSEKF reckons with.
    """
    return _summary(bench.fly(scenario, load, seeds=seeds or bench.SEEDS, **options))


def _sine(y):
    """Return the complex amplitude of the OFC's frequency in the mean over the seeds, whole periods."""
    t = np.arange(y.shape[1]) * bench.DT
    return complex(2 * (y.mean(axis=0) * np.exp(-2j * np.pi * bench.OFC_HZ * t)).mean())


def _at_rest():
    """Return A (4, 4) of (4) linearised at rest, states q, q', x3 and a constant input fault."""
    a22, a23, a31, a32, a33, b3, _ = lu17.jacobian(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, lu17.params()[0])
    return np.array([[0, 1, 0, 0], [0, a22, a23, 0], [a31, a32, a33, b3], [0, 0, 0, 0]])


@functools.cache
def linear_delay() -> float:
    """Return the delay [ms] of f_hat at the OFC's frequency in a Kalman filter of (4) linearised at rest.

    State (q, q', x3, f), f a random walk; the filter's own noises, no load.
    """
    Phi = expm(_at_rest() * bench.DT)
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


def relative_degree() -> int:
    """Return how often the rod must be differentiated until the valve shows, by (4) linearised at rest."""
    A, b, row = _at_rest()[:3, :3], _at_rest()[:3, 3], np.array([1.0, 0, 0])
    for r in range(1, 4):
        if row @ b != 0.0:
            return r
        row = row @ A
    return 4


def number(
    key: str, scenario: str, load: Any = "no load", phase: str = "after", scale: float = 1.0, **options: Any
) -> float:
    """Return one number of a case."""
    return scale * case(scenario, load, **options)[key, phase]


def ratio(
    above: str, below: str, scenario: str, load: str = "no load", phases: tuple[str, str] = ("after", "after")
) -> float:
    """Return one number of a case over another."""
    found = case(scenario, load)
    return found[above, phases[0]] / found[below, phases[1]]
