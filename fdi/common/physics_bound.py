"""What physics leaves an aircraft-level observer: motion per degree of elevator oscillation, over frequency."""

import math

import numpy as np


def motion_per_degree(A, B, C, D, frequencies_hz):
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


def detectable_amplitude(bound, sigma, *, frequencies_hz, periods=3, sample_s=0.005, probability_z=3.0):
    """Return the smallest amplitude (input units) whose motion exceeds `probability_z` sigma of a least-squares sine.

    A sine fitted to N samples of white noise sigma has an amplitude error of sigma sqrt(2/N) per quadrature; N
    follows from `periods` and `sample_s`. `bound` is (frequency,) motion per input unit. Known model, still air: no
    detector does better on this output alone.
    """
    n = periods / (np.asarray(frequencies_hz, float) * sample_s)
    return probability_z * sigma * np.sqrt(2.0 / n) / np.asarray(bound, float)
