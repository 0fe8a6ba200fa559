"""What physics leaves an observer of an oscillation: the matched filter's information, probability and amplitude."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats
from scipy.optimize import brentq


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
