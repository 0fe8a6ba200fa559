"""Frequency bank: least squares of two periods on (cos, sin, 1, t, t^2), a row of frequencies, bounded cost per tick.

Several signals run through it together: residuals, and last a drive that scales their thresholds. Each is averaged down
to three rates by triangles (two block lengths wide, the second zero of their response lies on every alias), and a
frequency is fitted on the slowest rate that gives it five samples a period: 40 stored samples then hold any two
periods. The constant, slope and curvature take the manoeuvre out. Every frequency is fitted about eight times a period,
in turn, from weights made once by `design`; nothing is accumulated for longer than two periods, so that rounding does
not grow and a bad sample leaves.
"""

import math

import numpy as np

from actuators.block import dtype, kernel, record

K = 14  # frequencies
N = 40  # stored samples for each rate
LEVELS = 3
F_LOW, F_HIGH = 0.5, 10.6  # [Hz]; actuators filter what lies above 10 Hz
BLOCKS_S = (0.01, 0.04, 0.10)  # block lengths [s]
FITS = 8  # per period

PARAMS = [
    ("bank_hz", "f8", (K,), "Hz"),  # frequencies
    ("bank_level", "f8", (K,)),  # rate that each is fitted on
    ("bank_n", "f8", (K,)),  # samples of its two periods, even
    ("bank_stride", "f8", (K,)),  # fit at each so many samples
    ("bank_wc", "f8", (K, N // 2)),  # weights of the sum of samples at equal distance from the middle
    ("bank_ws", "f8", (K, N // 2)),  # of their difference
    ("bank_hc", "f8", (K, N // 2)),  # weights of one period on its own, oldest first
    ("bank_hs", "f8", (K, N // 2)),
    ("bank_loss", "f8", (K,)),  # amplitude of a stored sinusoid over its true amplitude
    ("bank_angle", "f8", (K,), "rad"),  # phase from sample to sample
    ("bank_block", "f8", (LEVELS,), "-"),  # block lengths
]
SIZES = {"bank_level": 0, "bank_n": 1, "bank_stride": 1}  # parameters that are positions and sizes: least values
PLACES = {"bank_head": ("bank_ring", 2)}  # states that are positions: array, axis


def state(signals: int) -> list[tuple]:
    """Return the bank's STATE fields for so many signals."""
    return [
        ("bank_ring", "f8", (signals, LEVELS, N)),  # averaged samples, a ring for each signal and rate
        ("bank_rise", "f8", (signals, LEVELS)),  # rising half of the triangle that is being summed
        ("bank_fall", "f8", (signals, LEVELS)),  # falling half of the one before
        ("bank_hold", "f8", (signals, LEVELS)),  # rising half of the one before
        ("bank_tick", "f8", (LEVELS,)),  # ticks into the block
        ("bank_head", "f8", (LEVELS,)),  # next place in the ring
        ("bank_seen", "f8", (LEVELS,)),  # samples since the start
        ("bank_cos", "f8", (signals, K)),  # amplitude of the fit, in phase and in quadrature at the window's middle
        ("bank_sin", "f8", (signals, K)),
        ("bank_new", "f8", (K,)),  # 1 where this tick renewed the fit
    ]


def frequencies() -> np.ndarray:
    """Return the K frequencies [Hz], in equal ratios of 1.27: a fault between two is read 4 % low at most."""
    return np.geomspace(F_LOW, F_HIGH, K)


def design(dt: float) -> dict:
    """Return the bank's PARAMS fields for ticks of `dt` seconds."""
    p = record(dtype(PARAMS), bank_hz=frequencies(), bank_block=np.maximum(np.rint(np.array(BLOCKS_S) / dt), 1.0))[0]
    for k, f in enumerate(p.bank_hz):
        level = max((j for j in range(LEVELS) if 1.0 / (p.bank_block[j] * dt) >= 5.0 * f), default=0)
        h = p.bank_block[level] * dt
        n = min(2 * round(1.0 / (f * h)), N)
        loss = np.sinc(f * h) ** 2  # the triangle's own
        p.bank_level[k], p.bank_n[k], p.bank_stride[k] = level, n, max(n // (2 * FITS), 1)
        p.bank_loss[k], p.bank_angle[k] = loss, 2 * np.pi * f * h
        half = n // 2
        p.bank_wc[k, :half], p.bank_ws[k, :half] = _weights(f, h, n, 2)[:, :half] / loss
        p.bank_hc[k, :half], p.bank_hs[k, :half] = _weights(f, h, half, 1) / loss
    return {name: p[name] for name in p.dtype.names}


def _weights(f, h, n, degree):
    """Return what fits the amplitudes of cosine and sine at `f` [Hz] to `n` samples `h` [s] apart, beside a polynomial
    of `degree` of time; (2, n)."""
    t = (np.arange(n) - (n - 1) / 2) * h
    waves = [np.cos(2 * np.pi * f * t), np.sin(2 * np.pi * f * t)]
    return np.linalg.pinv(np.stack([*waves, *((t * f) ** k for k in range(degree + 1))], axis=1))[:2]


@kernel
def push(x, p, now):
    """Take one tick of the signals `now`, none of them NaN; return the number of fits renewed."""
    renewed = 0.0
    x.bank_new[:] = 0.0
    for j in range(LEVELS):
        D = p.bank_block[j]
        x.bank_tick[j] += 1.0
        a = x.bank_tick[j] / (D * D)
        b = (D - x.bank_tick[j]) / (D * D)
        for s in range(len(now)):
            x.bank_rise[s, j] += a * now[s]
            x.bank_fall[s, j] += b * now[s]
        if x.bank_tick[j] < D:
            continue
        head = int(x.bank_head[j])
        for s in range(len(now)):
            x.bank_ring[s, j, head] = x.bank_hold[s, j] + x.bank_fall[s, j]
            x.bank_hold[s, j] = x.bank_rise[s, j]
            x.bank_rise[s, j] = 0.0
            x.bank_fall[s, j] = 0.0
        x.bank_tick[j] = 0.0
        x.bank_head[j] = 0.0 if head == N - 1 else head + 1.0
        x.bank_seen[j] += 1.0
        seen = int(x.bank_seen[j])
        for k in range(K):
            if p.bank_level[k] == j and seen > p.bank_n[k] and seen % int(p.bank_stride[k]) == 0:
                fit(x, p, k, j, head)
                x.bank_new[k] = 1.0
                renewed += 1.0
    return renewed


@kernel
def fit(x, p, k, j, head):
    """Fit frequency k on the samples of rate j that end at ring place `head`."""
    n = int(p.bank_n[k])
    for signal in range(x.bank_cos.shape[0]):
        new, old, c, s = head, (head - n + 1) % N, 0.0, 0.0
        for i in range(n // 2):
            a, b = x.bank_ring[signal, j, old], x.bank_ring[signal, j, new]
            c += p.bank_wc[k, i] * (a + b)
            s += p.bank_ws[k, i] * (a - b)
            old = 0 if old == N - 1 else old + 1
            new = N - 1 if new == 0 else new - 1
        x.bank_cos[signal, k], x.bank_sin[signal, k] = c, s


@kernel
def character(x, p, k, signal, b):
    """Return (agreement, purity) of a signal + b drive at frequency k, over its two periods.

    Agreement is Re(A_1 A_2*) / max(|A_1|^2, |A_2|^2) of each period's own fit: 1 for a sinusoid, about 0 for a
    step or a single swing, which live in one period. Purity is the share of the window's variance that goes when the
    fitted oscillation is taken away; it is negative where fit and slow terms only cancel each other.
    """
    n = int(p.bank_n[k])
    j = int(p.bank_level[k])
    i = (int(x.bank_head[j]) - n) % N
    loss = p.bank_loss[k]
    drive = x.bank_cos.shape[0] - 1
    fc = loss * (x.bank_cos[signal, k] + b * x.bank_cos[drive, k])
    fs = loss * (x.bank_sin[signal, k] + b * x.bank_sin[drive, k])
    turn_c, turn_s = math.cos(p.bank_angle[k]), math.sin(p.bank_angle[k])
    first = -0.5 * (n - 1) * p.bank_angle[k]
    c, s = math.cos(first), math.sin(first)
    c1, s1, c2, s2, total, power, left, over = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for m in range(n):
        y = x.bank_ring[signal, j, i] + b * x.bank_ring[drive, j, i]
        rest = y - fc * c - fs * s
        total += y
        power += y * y
        over += rest
        left += rest * rest
        if m < n // 2:
            c1 += p.bank_hc[k, m] * y
            s1 += p.bank_hs[k, m] * y
        else:
            c2 += p.bank_hc[k, m - n // 2] * y
            s2 += p.bank_hs[k, m - n // 2] * y
        i = 0 if i == N - 1 else i + 1
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s
    most = max(c1 * c1 + s1 * s1, c2 * c2 + s2 * s2)
    agreement = (c1 * c2 + s1 * s2) / most if most > 0.0 else 0.0
    power -= total * total / n
    left -= over * over / n
    purity = 1.0 - left / power if power > 0.0 else 0.0
    return agreement, purity


@kernel
def shaped(x, p, k, signal, b):
    """Return whether a signal + b drive has the shape of an oscillation at frequency k: `character` of p.coherence and
    p.purity at least."""
    agreement, purity = character(x, p, k, signal, b)
    return agreement >= p.coherence and purity >= p.purity


@kernel
def amplitude(x, k, signal):
    """Return the amplitude of a signal at frequency k."""
    c, s = x.bank_cos[signal, k], x.bank_sin[signal, k]
    return math.sqrt(c * c + s * s)
