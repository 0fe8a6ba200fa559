"""Oscillations that are too fast for the lines of a window: a sine in each part of it."""

from actuators.block import kernel
from fdi.isolation.evidence import SWING_PRESSURE, logarithm
from fdi.isolation.sums import OCTAVES, PARTED

ASKED = 0.7  # share of a window that its parts must have been asked for
REFUSED = 1e12  # left by an oscillation that is not in a part


@kernel
def in_parts(x, o):
    """Write `ev_told`: an oscillation too fast for the lines of octave `o` swings in the parts of the window, a sine in
    each that shows it. What they leave, of one unknown scale of noise, and their determinants are added up."""
    n = x.ev_n
    for k in range(PARTED):
        h = k if k < 2 else SWING_PRESSURE
        Q, told = x.ev_Q[h], x.ev[h]
        c = told + x.ev_base - logarithm(Q, n)
        if o > 0:
            Q_parts, c_parts, m = x.parts[o - 1, k, 0], x.parts[o - 1, k, 1], x.parts_n[o - 1]
            if x.told_n[o - 1] > 0.0 and x.told[o - 1, k, 0] < REFUSED:
                Q_parts, c_parts, m = Q_parts + x.told[o - 1, k, 0], c_parts + x.told[o - 1, k, 1], m + x.told_n[o - 1]
            in_them = logarithm(Q_parts * n / m, n) + c_parts - x.ev_base if m > ASKED * n else 0.0
            if m > ASKED * n and in_them > told:
                Q, c, told = Q_parts * n / m, c_parts, in_them
        x.ev_told[k] = told
        if o < OCTAVES - 1:
            x.told[o, k, 0], x.told[o, k, 1], x.told_n[o] = Q if told > 0.0 else REFUSED, c, n
