"""Sums of whitened innovations and signatures over common windows, and what the flight has taught of the columns.

Ticks are added up to blocks of BLOCK_S; of every octave of frequencies a window begins anew every PERIODS of its
middle, and is asked from a third of its length on. It holds

    J = sum S' S / s,    b = sum S' e / s,    E = sum e^2 / s,    D(f) = sum (e, S_gain) exp(-i w t) / sqrt(s)

for LINES frequencies of its octave. Nothing is accumulated for longer than a window.
"""

import math

import numpy as np

from actuators.block import kernel
from fdi.isolation.filter import FAST, GAIN, SENSORS, N

BLOCK_S = 0.02  # [s]
OCTAVES, LINES = 6, 3
WAVES = 2 * LINES  # cosines and sines
GRAM = WAVES * (WAVES + 1) // 2
TOP_HZ = 8.0  # middle of the fastest octave
PERIODS = 2.0
PAIRS = N * (N + 1) // 2
SOLVE_BLOCKS = 50  # so often the lesson is solved for

PARAMS = [
    ("block", "f8"),  # ticks of a block
    ("length", "f8", (OCTAVES,)),  # of a window [blocks]
    ("turn_c", "f8", (OCTAVES, LINES)),  # rotation of each line's phasor from block to block
    ("turn_s", "f8", (OCTAVES, LINES)),
    ("hz", "f8", (OCTAVES, LINES), "Hz"),
]
STATE = [
    ("mu", "f8", (N,)),  # learned errors
    ("sd", "f8", (N,)),  # their standard deviations
    ("lesson_J", "f8", (PAIRS,)),
    ("lesson_b", "f8", (N,)),
    ("noise_scale", "f8", "-"),  # variance of the innovations over what the filter expects
    ("blocks", "f8"),  # so far
    ("block_tick", "f8"),  # into the block
    ("block_J", "f8", (PAIRS,)),
    ("block_b", "f8", (N,)),
    ("block_E", "f8", (SENSORS,)),
    ("block_N", "f8", (SENSORS,)),
    ("block_w", "f8", (3, SENSORS)),  # of innovations, signatures of the gain and of its fast part
    ("phase_c", "f8", (OCTAVES, LINES)),
    ("phase_s", "f8", (OCTAVES, LINES)),
    ("window_age", "f8", (OCTAVES,)),  # blocks since it began
    ("window_J", "f8", (OCTAVES, PAIRS)),
    ("window_b", "f8", (OCTAVES, N)),
    ("window_E", "f8", (OCTAVES, SENSORS)),
    ("window_n", "f8", (OCTAVES, SENSORS)),
    ("window_D", "f8", (OCTAVES, 3, SENSORS, WAVES)),  # innovations, signatures of gain and fast part, by cos, sin
    ("gram", "f8", (OCTAVES, GRAM)),  # of the waves, over blocks
    ("e_last", "f8", (SENSORS,)),  # whitened innovations of the tick before
    ("block_c", "f8", (SENSORS,)),
    ("c1", "f8", (OCTAVES, SENSORS)),  # sums of their products with those of the tick before
    ("window_M", "f8", (OCTAVES, SENSORS)),  # sums of the innovations
    ("weighed", "f8", (SENSORS, N)),  # scratch
    ("wave", "f8", (WAVES,)),  # scratch
]


def design(dt: float) -> dict:
    """Return the PARAMS fields for ticks of `dt` seconds."""
    block = max(round(BLOCK_S / dt), 1)
    middle = TOP_HZ / 2.0 ** np.arange(OCTAVES)
    hz = middle[:, None] * 2.0 ** ((np.arange(LINES) - 0.5 * (LINES - 1)) / LINES)
    angle = 2.0 * np.pi * hz * block * dt
    length = np.maximum(2.0 * np.round(0.5 * PERIODS / (middle * block * dt)), 2.0)
    return {"block": float(block), "length": length, "hz": hz, "turn_c": np.cos(angle), "turn_s": np.sin(angle)}


@kernel
def empty(x, w):
    """Let window `w` begin anew."""
    x.window_age[w] = 0.0
    for i in range(PAIRS):
        x.window_J[w, i] = 0.0
    for i in range(N):
        x.window_b[w, i] = 0.0
    for j in range(SENSORS):
        x.window_E[w, j] = 0.0
        x.window_n[w, j] = 0.0
        x.window_M[w, j] = 0.0
        x.c1[w, j] = 0.0
        for k in range(WAVES):
            x.window_D[w, 0, j, k] = 0.0
            x.window_D[w, 1, j, k] = 0.0
            x.window_D[w, 2, j, k] = 0.0
    for i in range(GRAM):
        x.gram[w, i] = 0.0


@kernel
def empty_all(x):
    """Let all windows begin anew."""
    for o in range(OCTAVES):
        empty(x, o)


@kernel
def add_tick(x):
    """Add a tick's innovations and signatures to the block."""
    w = x.weighed
    for j in range(SENSORS):
        s = x.h_s[j]
        over = 1.0 / s if s > 0.0 else 0.0
        root = math.sqrt(over)
        e = x.h_e[j] * root
        for a in range(N):
            w[j, a] = x.h_S[j, a] * root
            x.block_b[a] += w[j, a] * e
        x.block_E[j] += e * e
        x.block_N[j] += 1.0 if s > 0.0 else 0.0
        x.block_c[j] += e * x.e_last[j]
        x.e_last[j] = e
        x.block_w[0, j] += e
        x.block_w[1, j] += w[j, GAIN]
        x.block_w[2, j] += w[j, FAST]
    i = 0
    for a in range(N):
        for b in range(a + 1):
            x.block_J[i] += w[0, a] * w[0, b] + w[1, a] * w[1, b] + w[2, a] * w[2, b]
            i += 1
    x.block_tick += 1.0


@kernel
def close_block(x, p):
    """Add the finished block to every window; windows at their length begin anew before."""
    for o in range(OCTAVES):
        for k in range(LINES):
            c, s = x.phase_c[o, k], x.phase_s[o, k]
            c, s = c * p.turn_c[o, k] - s * p.turn_s[o, k], s * p.turn_c[o, k] + c * p.turn_s[o, k]
            norm = 1.5 - 0.5 * (c * c + s * s)
            x.phase_c[o, k], x.phase_s[o, k] = c * norm, s * norm
            x.wave[2 * k], x.wave[2 * k + 1] = c, s
        w = o
        if x.window_age[w] >= p.length[o]:
            empty(x, w)
        for a in range(PAIRS):
            x.window_J[w, a] += x.block_J[a]
        for a in range(N):
            x.window_b[w, a] += x.block_b[a]
        for j in range(SENSORS):
            e, g, f = x.block_w[0, j], x.block_w[1, j], x.block_w[2, j]
            x.window_E[w, j] += x.block_E[j]
            x.window_n[w, j] += x.block_N[j]
            x.window_M[w, j] += e
            x.c1[w, j] += x.block_c[j]
            for k in range(WAVES):
                x.window_D[w, 0, j, k] += x.wave[k] * e
                x.window_D[w, 1, j, k] += x.wave[k] * g
                x.window_D[w, 2, j, k] += x.wave[k] * f
        m = 0
        for k in range(WAVES):
            for l in range(k + 1):
                x.gram[w, m] += x.wave[k] * x.wave[l]
                m += 1
        x.window_age[w] += 1.0
    x.blocks += 1.0


@kernel
def clear_block(x):
    """Begin a block."""
    x.block_tick = 0.0
    for i in range(PAIRS):
        x.block_J[i] = 0.0
    for i in range(N):
        x.block_b[i] = 0.0
    for j in range(SENSORS):
        x.block_E[j] = 0.0
        x.block_N[j] = 0.0
        x.block_c[j] = 0.0
        x.block_w[0, j] = 0.0
        x.block_w[1, j] = 0.0
        x.block_w[2, j] = 0.0


@kernel
def octave(blocks):
    """Return the octave to evaluate at this block: the fastest at every second one, the next at every fourth, ..."""
    n, o = int(blocks), 0
    while n % 2 == 0 and o < OCTAVES - 1:
        n //= 2
        o += 1
    return o
