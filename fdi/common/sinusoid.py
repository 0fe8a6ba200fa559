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
def beside(F, D, first, n, angle, f0, d0, c0):
    """Return (ff, fd, dd): sums of products over `n` samples of F - f0 and D - d0, less what a sine explains of each; of
    0 none.

    With the means of F, D and the sine's cosine (`mean_cosine`) as f0, d0, c0 a constant is explained, too; else they
    are 0. F, D: rings of one length; `first`: place of the oldest sample; `angle`: the sine's phase per sample [rad]. Its
    cosine c and sine s are taken about the middle of the samples, where the two are nearly orthogonal; they turn by a
    rotation, one multiplication in place of a cosine a sample.
    """
    start = -0.5 * (n - 1) * angle
    c, s = math.cos(start), math.sin(start)
    turn_c, turn_s = math.cos(angle), math.sin(angle)
    ff, fd, dd, fc, fs, dc, ds, cc, cs, ss = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    i = first
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
