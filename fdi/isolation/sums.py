"""Sums of whitened innovations and signatures over common windows.

Ticks are added up to blocks of BLOCK_S; of every octave of frequencies a window begins anew every PERIODS of its
middle, and is asked from a third of its length on. It holds

    J = sum S' S / s,    b = sum S' e / s,    E = sum e^2 / s,    D(f) = sum (e, S_BESIDE) exp(i w t) / sqrt(s)

for LINES frequencies of its octave: two periods tell no more of an octave apart. J, b and E are nested: every window
is twice as long as that of the octave above and takes its sums when that is full, so that the sums of a window are
those of all above it together (`gather`); the shortest one is the lesson of the flight. D turns with its own lines.
Nothing is accumulated for longer than a window, but for what `passes` has of an alarm: that is forgotten in LATELY.
"""

import math

import numpy as np

from actuators.block import kernel
from fdi.isolation.filter import FAST, GAIN, GATE, PRESSURE, SENSORS, TIMING, N

BLOCK_S = 0.02  # [s]
OCTAVES, LINES = 5, 2
WAVES = 2 * LINES  # cosines and sines
TOP_HZ = 8.0  # middle of the fastest octave
PERIODS = 2.0
YOUNG = 1.0 / 3.0  # of its length, from which on a window is asked
BESIDE = (*range(TIMING), FAST, GAIN)  # columns that meet an oscillation's
SIGNALS = 1 + len(BESIDE)  # innovations, signatures of those columns
PAIRS = N * (N + 1) // 2
# Places in the vector of sums: of S'S, packed, of S'e; by sensor of e^2, 1, and of e with that of the tick before
B, ENERGY = PAIRS, PAIRS + N
NUMBER, NEXT, SUMS = (ENERGY + i * SENSORS for i in range(1, 4))
LATELY, LEFT = 400.0, 100.0  # memory of `passing` in samples of the pressure; squares of noise that it begins with
STEP = 8.0  # of the signature: three deviations of the command's noise; beyond it the model errs by more than noise
SOLVE_BLOCKS = 50  # so often the lesson is solved for
FIRST = 3 * SOLVE_BLOCKS  # until then little is known of the actuator [blocks]

PARAMS = [
    ("block", "f8"),  # ticks of a block
    ("length", "f8", (OCTAVES,)),  # of a window [blocks]
    ("turn_c", "f8", (OCTAVES, LINES)),  # rotation of each line's wave from block to block
    ("turn_s", "f8", (OCTAVES, LINES)),
    ("hz", "f8", (OCTAVES, LINES), "Hz"),
]
STATE = [
    ("mu", "f8", (N,)),  # learned errors
    ("sd", "f8", (N,)),  # their standard deviations
    ("noise", "f8", (SENSORS,)),  # variance of each sensor's innovations over what the filter expects
    ("blocks", "f8"),  # so far
    ("block_tick", "f8"),  # into the block
    ("block_w", "f8", (SIGNALS, SENSORS)),
    ("wave", "f8", (OCTAVES, WAVES)),  # cos, sin of each line since its window began
    ("window_age", "f8", (OCTAVES,)),  # blocks since it began
    ("window", "f8", (OCTAVES, SUMS)),  # less what those of the octaves above hold
    ("window_D", "f8", (OCTAVES, SIGNALS, SENSORS, WAVES)),
    ("window_G", "f8", (OCTAVES, WAVES, WAVES)),  # sums of the waves' products
    ("e_last", "f8", (SENSORS,)),  # whitened innovations of the tick before
    ("before", "f8", (2, 2)),  # the pressure's innovation and the signature of FAST, one and two ticks before
    # since the alarm, lately: sums of the second differences g of the signature, d of the innovation: g^2, g d, d^2, 1
    ("passing", "f8", (4,)),
    ("in_a_row", "f8"),  # samples of the pressure within the gate
    ("lost", "f8", "-"),  # share of the fast command that does not pass the valve, 0 without an alarm,
    ("lost_sd", "f8", "-"),  # its standard deviation
    ("total", "f8", (SUMS,)),  # sums of the window at hand
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
def begin(x, o):
    """Let the waves of octave `o` begin anew, and the sums that only its window holds."""
    x.window_age[o] = 0.0
    x.window[o] = x.window_D[o] = x.window_G[o] = x.told[o, :, :3] = x.parts[o] = 0.0
    x.wave[o, 0::2], x.wave[o, 1::2] = 1.0, 0.0


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
    x.block_w[:] = 0.0


@kernel
def add_tick(x):
    """Add a tick's innovations and signatures to the shortest window and to the block; leave the signatures in units
    of the noise."""
    w, sums = x.h_S, x.window[0]
    for j in range(SENSORS):
        s = x.h_s[j]
        root = math.sqrt(1.0 / (s * x.noise[j])) if s > 0.0 else 0.0
        e = x.h_e[j] * root
        for a in range(N):
            w[j, a] *= root
            sums[B + a] += w[j, a] * e
        sums[ENERGY + j] += e * e
        sums[NUMBER + j] += 1.0 if s > 0.0 else 0.0
        sums[NEXT + j] += e * x.e_last[j]
        x.e_last[j] = e
        x.block_w[0, j] += e
        for k in range(len(BESIDE)):
            x.block_w[1 + k, j] += w[j, BESIDE[k]]
    passes(x, x.e_last[PRESSURE], w[PRESSURE, FAST])
    i = 0
    for a in range(N):
        for b in range(a + 1):
            sums[i] += w[0, a] * w[0, b] + w[1, a] * w[1, b] + w[2, a] * w[2, b]
            i += 1
    x.block_tick += 1.0


@kernel
def passes(x, e, w):
    """Write what share of the fast command is lost since the alarm, by the pressure's innovation `e` and the signature
    `w` of FAST: no oscillation is left in their second differences, nor a sample that has passed the gate in part."""
    old = x.before
    d, g = e - 2.0 * old[0, 0] + old[0, 1], w - 2.0 * old[1, 0] + old[1, 1]
    old[0, 1], old[1, 1], old[0, 0], old[1, 0] = old[0, 0], old[1, 0], e, w
    x.in_a_row = x.in_a_row + 1.0 if x.h_s[PRESSURE] > 0.0 and math.fabs(x.h_before[PRESSURE]) < GATE else 0.0
    add, keep = (g * g, g * d, d * d, 1.0), (1.0 - 1.0 / LATELY) * x.alarm
    for i in range(4 if x.in_a_row > 2.0 and math.fabs(g) < STEP else 0):
        x.passing[i] = keep * x.passing[i] + add[i]
    J, b, E, n = max(x.passing[0], 1e-9), x.passing[1], x.passing[2], max(x.passing[3], 1e-9)
    x.lost, x.lost_sd = x.alarm * min(max(-b / J, 0.0), 1.0), math.sqrt((LEFT + max(E - b * b / J, 0.0)) / (n * J))


@kernel
def close_block(x, p):
    """Turn every wave by a block, add the finished block to its sums."""
    for o in range(OCTAVES):
        wave, D, G = x.wave[o], x.window_D[o], x.window_G[o]
        for k in range(LINES):
            c, s = wave[2 * k], wave[2 * k + 1]
            wave[2 * k] = c * p.turn_c[o, k] - s * p.turn_s[o, k]
            wave[2 * k + 1] = s * p.turn_c[o, k] + c * p.turn_s[o, k]
        for w in range(WAVES):
            for v in range(WAVES):
                G[w, v] += wave[w] * wave[v]
            for i in range(SIGNALS):
                for j in range(SENSORS):
                    D[i, j, w] += wave[w] * x.block_w[i, j]
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
            for i in range(SUMS):
                x.window[o + 1, i] += x.window[o, i]
            for h in range(x.told.shape[1]):
                for i in range(3):
                    x.parts[o + 1, h, i] += x.told[o, h, i]
        begin(x, o)


@kernel
def gather(x, w):
    """Write the sums of window `w`."""
    for i in range(SUMS):
        x.total[i] = 0.0
        for o in range(w + 1):
            x.total[i] += x.window[o, i]


@kernel
def octave(blocks):
    """Return the octave to evaluate at this block: the fastest at every second one, the next at every fourth, ..."""
    n, o = int(blocks), 0
    while n % 2 == 0 and o < OCTAVES - 1:
        n //= 2
        o += 1
    return o
