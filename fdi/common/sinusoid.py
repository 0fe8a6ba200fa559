"""Rings of averaged samples, and what a sine of a given frequency leaves of two signals over the newest of them."""

import math

from actuators.block import kernel


@kernel
def put(ring, sums, count, head):
    """Write the means of `count` ticks, from their `sums` (signals,), to place `head` of `ring` (signals, samples),
    clear the sums, and return the next place."""
    at = int(head)
    for s in range(sums.size):
        ring[s, at] = sums[s] / count
        sums[s] = 0.0
    return 0.0 if at == ring.shape[1] - 1 else head + 1.0


@kernel
def beside(F, D, first, n, angle, constant):
    """Return (ff, fd, dd): sums of products over `n` samples of F and D, less what a sine explains of each; of 0 none.

    F, D: rings of one length; `first`: place of the oldest sample; `angle`: the sine's phase per sample [rad];
    `constant`: 1 where a constant is explained, too, else 0. The sine's cosine c and sine s are taken about the middle
    of the samples, where the two are nearly orthogonal; they turn by a rotation, one multiplication in place of a
    cosine a sample. A constant is explained where the means of F, D and c are taken away first.
    """
    f0, d0, c0, i = 0.0, 0.0, 0.0, first
    if constant > 0.5:
        c0 = math.sin(0.5 * n * angle) / (n * math.sin(0.5 * angle)) if angle > 0.0 else 1.0
        for k in range(first, first + n):
            f0 += F[k % F.size] / n
            d0 += D[k % F.size] / n
    start = -0.5 * (n - 1) * angle
    c, s = math.cos(start), math.sin(start)
    turn_c, turn_s = math.cos(angle), math.sin(angle)
    ff, fd, dd, fc, fs, dc, ds, cc, cs, ss = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(n):
        f, d, a = F[i] - f0, D[i] - d0, c - c0
        ff, fd, dd = ff + f * f, fd + f * d, dd + d * d
        fc, fs, dc, ds = fc + f * a, fs + f * s, dc + d * a, ds + d * s
        cc, cs, ss = cc + a * a, cs + a * s, ss + s * s
        i = 0 if i == F.size - 1 else i + 1
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s
    det = cc * ss - cs * cs
    if det <= 1e-9 * n * n:
        return ff, fd, dd
    f_c, f_s = (fc * ss - fs * cs) / det, (fs * cc - fc * cs) / det
    d_c, d_s = (dc * ss - ds * cs) / det, (ds * cc - dc * cs) / det
    return ff - f_c * fc - f_s * fs, fd - f_c * dc - f_s * ds, dd - d_c * dc - d_s * ds


@kernel
def fit_sine(F, D, first, n, h, low, high, constant):
    """Return (hz, rest, gain, dd, before) of F = gain D + sine + rest at the frequency in [low, high] [Hz] that leaves
    least: sums of squares of the rest, of D beside the sine, and of the rest without one; hz 0 where no sine explains
    anything. `h`: time of a sample [s]; other arguments as of `beside`."""
    ff, fd, dd = beside(F, D, first, n, 0.0, constant)
    before = ff - fd * fd / max(dd, 1e-12)
    rest, best, gain, spread = before, 0.0, 0.0, 0.0
    hz, apart = low, 0.5 / (n * h)
    for _ in range(3):  # half a line apart, then about the best
        while hz <= high:
            ff, fd, dd = beside(F, D, first, n, 6.283185307179586 * hz * h, constant)
            if ff - fd * fd / max(dd, 1e-12) < rest:
                rest, best, gain, spread = ff - fd * fd / max(dd, 1e-12), hz, fd / max(dd, 1e-12), dd
            hz += apart
        hz, high, apart = best - 0.5 * apart, best + 0.6 * apart, 0.5 * apart
    return best, rest, gain, spread, before
