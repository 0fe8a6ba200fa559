"""Losses: f = t d of valve or supply, f = t z of a leakage.

f is the input fault, d the command behind the same lag, z the pressure.
"""

from actuators.block import kernel
from fdi.hydraulic.sample_rings import EVEN_S, N

GAIN_ERROR = 0.06  # of the learned gain
DEAD = 0.85  # a valve that loses more may as well be where something slow holds it
LOSS_LEAST, LEAK_LEAST = 0.15, 0.05  # of flow [1], pressure [1]
LEAK_MOST = 1.2
LEAST_EVEN = 10  # even samples that a loss is fitted to


@kernel
def least(ff, fd, dd, gain):
    """Return what f = t d leaves of f, the least over t within GAIN_ERROR of `gain`."""
    t = gain
    if dd > 0.0:
        t = min(max(fd / dd, gain - GAIN_ERROR), gain + GAIN_ERROR)
    return max(ff - 2.0 * t * fd + t * t * dd, 0.0)


@kernel
def loss(x, n):
    """Fit each loss alone to the newest `n` even samples: f = t d or t z; return (H, least energy left, sum of d d).

    A valve that passes less, or a lower supply: t d; leakage: t z. Both take away: t is negative.
    """
    i = int(x.even_head) - n
    if i < 0:
        i += N
    ff, fd, dd, fz, zz = 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(n):
        f, d, z = x.even_ring[0, i], x.even_ring[1, i], x.even_ring[2, i]
        ff += f * f
        fd += f * d
        dd += d * d
        fz += f * z
        zz += z * z
        i = 0 if i == N - 1 else i + 1
    H = least(ff, fd, dd, x.gain)
    E = H
    if dd > 0.0 and -DEAD < fd / dd < -LOSS_LEAST:
        E = min(E, ff - fd * fd / dd)
    if zz > 0.0 and -LEAK_MOST < fz / zz < -LEAK_LEAST:
        E = min(E, ff - fz * fz / zz)
    return H, max(E, 0.0), dd


@kernel
def even_window(n, h):
    """Return how many even samples span `n` of `h` seconds."""
    return max(min(int(n * h / EVEN_S + 0.5), N), LEAST_EVEN)
