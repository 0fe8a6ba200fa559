"""The last seconds of a hydraulic actuator: averaged samples of input fault, command and pressure; sines in them.

To the rings of `fdi.common.bank` come a slow one, for oscillations below 0.5 Hz, and an even one of all three signals.
"""

import math
from typing import Any

from actuators.block import kernel
from fdi.common import bank
from fdi.common.sinusoid import products, put

N = bank.N
SLOW = bank.LEVELS  # index of the slow ring
SLOW_HZ = (0.1, 0.126, 0.158, 0.2, 0.251, 0.316, 0.398)  # [Hz]; the bank begins at 0.5 Hz
SLOW_K = len(SLOW_HZ)
SLOW_S, EVEN_S = 0.5, 0.04  # samples of the slow ring and of the even one [s]
# noise of f in the rings' samples, with sensor noise 1.2 times that of the set `transport` [1]
SIGMA = (0.00235, 0.00115, 0.0004, 0.0004, 0.00125)
ROUGHER = {0: 25.0, 1: 4.0, 2: 1.0}  # what a load that is not measured adds, by load form

PARAMS = [
    ("sigma", "f8", (bank.LEVELS + 2,)),  # noise of f in the samples of the bank's rings, the slow and the even [1]
    ("slow_threshold", "f8", (SLOW_K,)),  # amplitude of f in quiet flight [1]
    ("slow_block", "f8"),  # samples of the bank's slowest ring in one of the slow ring
    ("even_block", "f8"),  # ticks in one of the even ring
    ("slow_hz", "f8", (SLOW_K,)),  # [Hz]
]
STATE = [
    ("slow_ring", "f8", (2, N)),  # f and d, averages of SLOW_S
    ("slow_sum", "f8", (2,)),
    ("slow_count", "f8"),
    ("slow_head", "f8"),
    ("slow_seen", "f8"),
    ("even_ring", "f8", (3, N)),  # f, d, z, averages of EVEN_S
    ("even_sum", "f8", (3,)),
    ("even_count", "f8"),
    ("even_head", "f8"),
    ("even_seen", "f8"),
]


def design(dt: float, load: Any) -> dict[str, Any]:
    """Return the PARAMS fields of ticks of `dt` seconds and of a load form."""
    last = max(round(bank.BLOCKS_S[-1] / dt), 1) * dt
    sigma = tuple(ROUGHER[load] * v for v in SIGMA)
    return {"sigma": sigma, "slow_hz": SLOW_HZ, "slow_block": float(round(SLOW_S / last)),
            "even_block": float(max(round(EVEN_S / dt), 1))}


@kernel
def push(x, p, f, d, z):
    """Take one tick into the even ring, and a sample of the bank's slowest ring into the slow one where it is new.

    Return 1.0 where the even ring has a new sample, 2.0 added where the slow one has.
    """
    fresh = 0.0
    x.even_sum[0] += f
    x.even_sum[1] += d
    x.even_sum[2] += z
    x.even_count += 1.0
    if x.even_count >= p.even_block:
        x.even_head = put(x.even_ring, x.even_sum, x.even_count, x.even_head)
        x.even_count = 0.0
        x.even_seen += 1.0
        fresh = 1.0
    if x.bank_tick[bank.LEVELS - 1] == 0.0 and x.bank_seen[bank.LEVELS - 1] > 0.0:
        last = int(x.bank_head[bank.LEVELS - 1]) - 1
        if last < 0:
            last = N - 1
        for s in range(2):
            x.slow_sum[s] += x.bank_ring[s, bank.LEVELS - 1, last]
        x.slow_count += 1.0
        if x.slow_count >= p.slow_block:
            x.slow_head = put(x.slow_ring, x.slow_sum, x.slow_count, x.slow_head)
            x.slow_count = 0.0
            x.slow_seen += 1.0
            fresh += 2.0
    return fresh


@kernel
def empty(x, slow):
    """Empty every ring, the slow one where `slow`: what they hold is of a fault that has healed, or of a sensor that is
    no longer read."""
    for j in range(bank.LEVELS):
        x.bank_seen[j] = 0.0
    if slow:
        x.slow_seen = 0.0
    x.even_seen = 0.0


@kernel
def sample(x, s, j, i):
    """Return sample `i` of signal `s`, 0 f, 1 d, of ring `j`."""
    if j == SLOW:
        return x.slow_ring[s, i]
    return x.bank_ring[s, j, i]


@kernel
def begin(x, j, n):
    """Return the place of the oldest of the last `n` samples of ring `j`."""
    i = int(x.slow_head if j == SLOW else x.bank_head[j]) - n
    return i + N if i < 0 else i


@kernel
def tone(x, p, j, n, angle):
    """Fit a sine of `angle` [rad] a sample to the last `n` of ring `j`.

    Return (ff, fd, dd, ff', fd', dd', a, m): sums of products of f and d, the same of what the sine leaves of each,
    the sine's amplitude in f - g d, and the energy of its mean. Where f has an
    offset of its own (`keep_mean` 0) its mean is taken out first.
    """
    first = begin(x, j, n)
    mean = 0.0
    if p.keep_mean < 0.5:
        i = first
        for _ in range(n):
            mean += sample(x, 0, j, i)
            i = 0 if i == N - 1 else i + 1
        mean /= n
    F, D = (x.slow_ring[0], x.slow_ring[1]) if j == SLOW else (x.bank_ring[0, j], x.bank_ring[1, j])
    f1, d1, ff, fd, dd, fc, fs, dc, ds, cc, cs, ss = products(F, D, first, n, angle, mean)
    det = max(cc * ss - cs * cs, 1e-12)
    fa, fb = (fc * ss - fs * cs) / det, (fs * cc - fc * cs) / det
    da, db = (dc * ss - ds * cs) / det, (ds * cc - dc * cs) / det
    ea, eb = fa - x.gain * da, fb - x.gain * db
    offset = (f1 - x.gain * d1) / n
    return (ff, fd, dd, ff - fa * fc - fb * fs, fd - da * fc - db * fs, dd - da * dc - db * ds,
            math.sqrt(ea * ea + eb * eb), n * offset * offset)


@kernel
def swing(x, j, n, angle):
    """Fit w to (1, cos, sin) over the last `n` samples of ring `j`.

    Return (energy about the mean, what is left of it, mean).
    """
    i = begin(x, j, n)
    start = -0.5 * (n - 1) * angle
    c, s = math.cos(start), math.sin(start)
    turn_c, turn_s = math.cos(angle), math.sin(angle)
    y1, c1, s1, yy, yc, ys, cc, cs, ss = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(n):
        y = sample(x, 0, j, i) + sample(x, 1, j, i)
        y1 += y
        c1 += c
        s1 += s
        yy += y * y
        yc += y * c
        ys += y * s
        cc += c * c
        cs += c * s
        ss += s * s
        i = 0 if i == N - 1 else i + 1
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s
    yy -= y1 * y1 / n
    yc -= y1 * c1 / n
    ys -= y1 * s1 / n
    cc -= c1 * c1 / n
    cs -= c1 * s1 / n
    ss -= s1 * s1 / n
    det = max(cc * ss - cs * cs, 1e-12)
    a, b = (yc * ss - ys * cs) / det, (ys * cc - yc * cs) / det
    return max(yy, 0.0), max(yy - a * yc - b * ys, 0.0), y1 / n


@kernel
def recent(x, j, n):
    """Return the mean square of f - g d over the newest `n` samples of ring `j`."""
    i = int(x.slow_head if j == SLOW else x.bank_head[j]) - 1
    H = 0.0
    for _ in range(n):
        i = i + N if i < 0 else i
        e = sample(x, 0, j, i) - x.gain * sample(x, 1, j, i)
        H += e * e
        i -= 1
    return H / n
