"""What physics leaves an aircraft-level observer: motion per degree of elevator oscillation, over frequency."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats
from scipy.optimize import brentq


def motion_per_degree(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, frequencies_hz: Any) -> Any:
    """Return |y| per input unit, shape (frequency, output, input), of x' = A x + B u, y = C x + D u.

    With inputs in deg of one segment's (or side's) elevator and outputs q in deg/s and n_z in g this is the largest
    motion that an oscillatory fault of one degree leaves, the actuators' own lag not counted. Raises ValueError for a
    frequency that is not positive.
    """
    A, B, C, D = (np.atleast_2d(np.asarray(x, float)) for x in (A, B, C, D))
    f = np.atleast_1d(np.asarray(frequencies_hz, float))
    if not (f > 0.0).all():
        raise ValueError("frequencies are positive")
    s = 2j * math.pi * f[:, None, None]
    return abs(C @ np.linalg.solve(s * np.eye(len(A)) - A, np.broadcast_to(B, (len(f), *B.shape))) + D)


def detectable_amplitude(
    bound: Any,
    sigma: float,
    *,
    frequencies_hz: Any,
    periods: int = 3,
    sample_s: float = 0.005,
    probability_z: float = 3.0,
) -> Any:
    """Return the smallest amplitude (input units) whose motion exceeds `probability_z` sigma of a least-squares sine.

    A sine fitted to N samples of white noise sigma has an amplitude error of sigma sqrt(2/N) per quadrature; N
    follows from `periods` and `sample_s`. `bound` is (frequency,) motion per input unit. Known model, still air: no
    detector does better on this output alone.
    """
    n = periods / (np.asarray(frequencies_hz, float) * sample_s)
    return probability_z * sigma * np.sqrt(2.0 / n) / np.asarray(bound, float)


def information(motion: NDArray, noise: NDArray) -> NDArray:
    """Return (frequency,) what a second of all outputs tells of an oscillation: squared distance per squared unit.

    `motion` (frequency, output) is the complex response per unit of amplitude, `noise` (frequency, output, output) the
    two-sided spectral density matrix of what disturbs the outputs [unit^2/Hz]: sigma^2 dt of white samples, gusts
    through the aircraft. The distance of a sine of amplitude a over T seconds is d^2 = a^2 T information, that of the
    matched filter, which no detector exceeds.
    """
    solved = np.linalg.solve(noise, motion[..., None])[..., 0]
    return 0.5 * np.einsum("fo,fo->f", motion.conj(), solved).real


def probability(amplitude: ArrayLike, told: ArrayLike, seconds: ArrayLike, false_alarm: float) -> NDArray:
    """Return the largest probability to see an oscillation of unknown phase, given `information`, in `seconds`.

    `false_alarm` is the probability of an alarm in as much time without one; frequency and aircraft are known.
    """
    d2 = np.asarray(amplitude) ** 2 * np.asarray(told) * np.asarray(seconds)
    return stats.ncx2.sf(stats.chi2.isf(false_alarm, 2), 2, d2)


def least_amplitude(
    told: ArrayLike, seconds: ArrayLike, *, false_alarm: float = 0.05, detection: float = 0.9
) -> NDArray:
    """Return the smallest amplitude that can be seen with probability `detection`; see `probability`."""
    threshold = stats.chi2.isf(false_alarm, 2)
    d2 = brentq(lambda x: stats.ncx2.sf(threshold, 2, x) - detection, 1e-3, 1e3)
    return np.sqrt(d2 / (np.asarray(told) * np.asarray(seconds)))
