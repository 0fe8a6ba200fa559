"""By how much one channel lags another that physics ties to it: the slope of the phase of their cross spectrum.

    Y / X = g (j w)^n e^(-j w tau),    arg S_xy(w) - n pi/2 = -w tau

n is -1 for an angle beside its rate, 1 for a rate beside its angle, 0 for two readings of one thing. The phase of a
frequency has the variance (1 - c) / (2 m c), c the coherence, m the number of independent segments (Bendat and Piersol,
Random Data, 9.2); the slope is their weighted least squares, its interval widened where the phases scatter by more.
"""

from dataclasses import dataclass

import numpy as np
from scipy import signal
from scipy.stats import t as student

PAIRS = (  # (channel, other channel, n)
    ("theta", "q", -1), ("phi", "p", -1), ("psi", "r", -1), ("h_baro", "hdot", -1), ("h_inertial", "hdot", -1),
    ("qdot", "q", 1), ("pdot", "p", 1), ("rdot", "r", 1), ("cas", "tas", 0), ("mach", "tas", 0),
    ("h_baro", "h_inertial", 0), ("alpha", "alpha_ground", 0), ("tas", "v_ground", 0),
)  # fmt: skip
LEAST = 0.6  # coherence of a frequency that counts
SEGMENTS = 8  # of the recording at least
SEGMENT_S = 20.0  # at most: the slowest motion that counts takes some five of these
FEWEST = 4  # frequencies


@dataclass(frozen=True)
class Delay:
    """Lag behind `of` [s], + later, with its interval; `note` says why there is none."""

    of: str
    tau: float = np.nan
    low: float = np.nan
    high: float = np.nan
    coherence: float = np.nan
    note: str = ""


def lag(y: np.ndarray, x: np.ndarray, n: int, dt: float, of: str, level: float = 0.95) -> Delay:
    """Return the Delay of samples y behind x (both (samples,), finite, every `dt` seconds) with Y/X = g (j w)^n."""
    size = int(min(SEGMENT_S / dt, len(y) * 2 // (SEGMENTS + 1)))
    if size < 16:
        return Delay(of, note=f"{len(y) * dt:.3g} s are too short")
    how = {"fs": 1.0 / dt, "nperseg": size, "detrend": "linear"}
    f, cross = signal.csd(x, y, **how)
    coherence = signal.coherence(x, y, **how)[1]
    m = 0.6 * (2.0 * len(y) / size - 1.0)  # Hann windows that overlap by half are not independent
    on = (coherence > max(LEAST, 4.0 / m)) & (f > 1.5 / (size * dt)) & (f < 0.25 / dt)
    if on.sum() < FEWEST:
        return Delay(of, note=f"does not move with {of}")
    w, c = 2.0 * np.pi * f[on], np.clip(coherence[on], 0.0, 1.0 - 1e-9)
    phase = cross[on] / (1j * w) ** n
    phase = np.angle(phase * np.conj(np.sign(np.real(phase.sum())) or 1.0))
    weight = 2.0 * m * c / (1.0 - c)
    denominator = float(weight @ w**2)
    tau = -float(weight @ (w * phase)) / denominator
    left = np.angle(np.exp(1j * (phase + w * tau)))
    scatter = float(weight @ left**2) / (len(w) - 1)
    half = float(student.ppf(0.5 + level / 2.0, len(w) - 1)) * np.sqrt(max(1.0, scatter) / denominator)
    return Delay(of, tau, tau - half, tau + half, float(np.average(c, weights=weight)))
