"""Sums of whitened innovations and signatures over common windows, and what the flight has taught of the columns.

Ticks are added up to blocks of BLOCK_S; of every octave of frequencies a window begins anew every PERIODS of its
middle, and is asked from a third of its length on. It holds

    J = sum S' S / s,    b = sum S' e / s,    E = sum e^2 / s,    D(f) = sum (e, S_gain, S_fast) exp(i w t) / sqrt(s)

for LINES frequencies of its octave: two periods tell no more of an octave apart. J, b and E are nested: every window
is twice as long as that of the octave above and takes its sums when that is full, so that the sums of a window are
those of all above it together (`gather`); the shortest one is the lesson of the flight. D turns with its own lines.
Nothing is accumulated for longer than a window.
"""

import math

import numpy as np

from actuators.block import kernel
from fdi.isolation.filter import FAST, GAIN, SENSORS, N

BLOCK_S = 0.02  # [s]
OCTAVES, LINES = 5, 2
WAVES = 2 * LINES  # cosines and sines
TOP_HZ = 8.0  # middle of the fastest octave
PERIODS = 2.0
YOUNG = 1.0 / 3.0  # of its length, from which on a window is asked
PAIRS = N * (N + 1) // 2
ENERGY, NUMBER, MEAN, NEXT = range(4)  # sums of e^2, 1, e, and of e with that of the tick before
TOLD = 4
PARTED = 3  # oscillations that are asked for in the parts of a window: added, in place, of the pressure sensor
REFUSED = 1e12  # left by an oscillation that is not in a part
SOLVE_BLOCKS = 50  # so often the lesson is solved for
FIRST = 3 * SOLVE_BLOCKS  # until then little is known of the actuator [blocks]

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
    ("noise", "f8", (SENSORS,)),  # variance of each sensor's innovations over what the filter expects
    ("blocks", "f8"),  # so far
    ("block_tick", "f8"),  # into the block
    ("block_w", "f8", (3, SENSORS)),  # of innovations, signatures of the gain and of its fast part
    ("phase_c", "f8", (OCTAVES, LINES)),  # of each line since its window began
    ("phase_s", "f8", (OCTAVES, LINES)),
    ("window_age", "f8", (OCTAVES,)),  # blocks since it began
    ("window_J", "f8", (OCTAVES, PAIRS)),  # less what those of the octaves above hold
    ("window_b", "f8", (OCTAVES, N)),
    ("window_t", "f8", (OCTAVES, TOLD, SENSORS)),
    ("window_D", "f8", (OCTAVES, 3, SENSORS, WAVES)),  # innovations, signatures of gain and fast part, by cos, sin
    # what an oscillation leaves in a window, but the longest, or in its parts together, and -1/2 of its ln det
    ("told", "f8", (OCTAVES - 1, PARTED, 2)),
    ("told_n", "f8", (OCTAVES - 1,)),  # of so many samples
    ("parts", "f8", (OCTAVES - 1, PARTED, 2)),  # sums over the windows so long that are over in the next longer one
    ("parts_n", "f8", (OCTAVES - 1,)),
    ("e_last", "f8", (SENSORS,)),  # whitened innovations of the tick before
    ("JJ", "f8", (PAIRS,)),  # sums of the window at hand
    ("bb", "f8", (N,)),
    ("tt", "f8", (TOLD, SENSORS)),
]


def design(dt: float) -> dict:
    """Return the PARAMS fields for ticks of `dt` seconds."""
    block = max(round(BLOCK_S / dt), 1)
    middle = TOP_HZ / 2.0 ** np.arange(OCTAVES)
    hz = middle[:, None] * 2.0 ** ((np.arange(LINES) - 0.5 * (LINES - 1)) / LINES)
    angle = 2.0 * np.pi * hz * block * dt
    length = max(2.0 * round(0.5 * PERIODS / (TOP_HZ * block * dt)), 2.0) * 2.0 ** np.arange(OCTAVES)
    return {"block": float(block), "length": length, "hz": hz, "turn_c": np.cos(angle), "turn_s": np.sin(angle)}


@kernel
def begin(x, w):
    """Let the waves of window `w` begin anew, and the sums that only it holds."""
    x.window_age[w] = 0.0
    for i in range(PAIRS):
        x.window_J[w, i] = 0.0
    for i in range(N):
        x.window_b[w, i] = 0.0
    for t in range(TOLD):
        for j in range(SENSORS):
            x.window_t[w, t, j] = 0.0
    for s in range(3):
        for j in range(SENSORS):
            for k in range(WAVES):
                x.window_D[w, s, j, k] = 0.0
    for k in range(LINES):
        x.phase_c[w, k], x.phase_s[w, k] = 1.0, 0.0
    if w < OCTAVES - 1:
        x.told_n[w] = 0.0
    if w > 0:
        x.parts_n[w - 1] = 0.0
        for k in range(PARTED):
            x.parts[w - 1, k, 0] = x.parts[w - 1, k, 1] = 0.0


@kernel
def begin_all(x):
    """Let all windows and the block begin anew."""
    for o in range(OCTAVES):
        begin(x, o)
    clear_block(x)


@kernel
def clear_block(x):
    """Begin a block."""
    x.block_tick = 0.0
    for s in range(3):
        for j in range(SENSORS):
            x.block_w[s, j] = 0.0


@kernel
def add_tick(x):
    """Add a tick's innovations and signatures to the shortest window and to the block; leave the signatures in units
    of the noise."""
    w, t, J = x.h_S, x.window_t[0], x.window_J[0]
    for j in range(SENSORS):
        s = x.h_s[j]
        over = 1.0 / (s * x.noise[j]) if s > 0.0 else 0.0
        root = math.sqrt(over)
        e = x.h_e[j] * root
        for a in range(N):
            w[j, a] *= root
            x.window_b[0, a] += w[j, a] * e
        t[ENERGY, j] += e * e
        t[NUMBER, j] += 1.0 if s > 0.0 else 0.0
        t[MEAN, j] += e
        t[NEXT, j] += e * x.e_last[j]
        x.e_last[j] = e
        x.block_w[0, j] += e
        x.block_w[1, j] += w[j, GAIN]
        x.block_w[2, j] += w[j, FAST]
    i = 0
    for a in range(N):
        for b in range(a + 1):
            J[i] += w[0, a] * w[0, b] + w[1, a] * w[1, b] + w[2, a] * w[2, b]
            i += 1
    x.block_tick += 1.0


@kernel
def close_block(x, p):
    """Turn every line by a block, add the finished block to its sums."""
    for o in range(OCTAVES):
        for k in range(LINES):
            c, s = x.phase_c[o, k], x.phase_s[o, k]
            c, s = c * p.turn_c[o, k] - s * p.turn_s[o, k], s * p.turn_c[o, k] + c * p.turn_s[o, k]
            norm = 1.5 - 0.5 * (c * c + s * s)
            c, s = c * norm, s * norm
            x.phase_c[o, k], x.phase_s[o, k] = c, s
            for i in range(3):
                for j in range(SENSORS):
                    x.window_D[o, i, j, 2 * k] += c * x.block_w[i, j]
                    x.window_D[o, i, j, 2 * k + 1] += s * x.block_w[i, j]
        x.window_age[o] += 1.0
    x.blocks += 1.0
    clear_block(x)


@kernel
def fold(x, p):
    """Let the windows that are full begin anew; what they hold goes to the next longer one."""
    for o in range(OCTAVES):
        if x.window_age[o] < p.length[o]:
            return
        if o < OCTAVES - 1:
            for i in range(PAIRS):
                x.window_J[o + 1, i] += x.window_J[o, i]
            for i in range(N):
                x.window_b[o + 1, i] += x.window_b[o, i]
            for t in range(TOLD):
                for j in range(SENSORS):
                    x.window_t[o + 1, t, j] += x.window_t[o, t, j]
            if x.told_n[o] > 0.0:
                x.parts_n[o] += x.told_n[o]
                for k in range(PARTED):
                    x.parts[o, k, 0] += x.told[o, k, 0]
                    x.parts[o, k, 1] += x.told[o, k, 1]
        begin(x, o)


@kernel
def gather(x, w):
    """Write the sums of window `w`."""
    for i in range(PAIRS):
        x.JJ[i] = x.window_J[0, i]
        for o in range(1, w + 1):
            x.JJ[i] += x.window_J[o, i]
    for i in range(N):
        x.bb[i] = x.window_b[0, i]
        for o in range(1, w + 1):
            x.bb[i] += x.window_b[o, i]
    for t in range(TOLD):
        for j in range(SENSORS):
            x.tt[t, j] = x.window_t[0, t, j]
            for o in range(1, w + 1):
                x.tt[t, j] += x.window_t[o, t, j]


@kernel
def octave(blocks):
    """Return the octave to evaluate at this block: the fastest at every second one, the next at every fourth, ..."""
    n, o = int(blocks), 0
    while n % 2 == 0 and o < OCTAVES - 1:
        n //= 2
        o += 1
    return o


@kernel
def apart(o):
    """Return how many blocks apart octave `o` is evaluated where every block asks."""
    return 1 << min(o + 1, OCTAVES - 1)
