"""Oscillations that are too fast for the lines of a window: a sine in each part of it."""

from actuators.block import kernel
from fdi.isolation.evidence import SWING_PRESSURE, logarithm
from fdi.isolation.sums import OCTAVES, PARTED, REFUSED

KNOWN = 0.7  # share of a window that its parts must have been asked for


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
            Q2, c2, m = x.parts[o - 1, k, 0], x.parts[o - 1, k, 1], x.parts_n[o - 1]
            if x.told_n[o - 1] > 0.0 and x.told[o - 1, k, 0] < REFUSED:
                Q2, c2, m = Q2 + x.told[o - 1, k, 0], c2 + x.told[o - 1, k, 1], m + x.told_n[o - 1]
            if m > KNOWN * n:
                Q2 *= n / m
                other = logarithm(Q2, n) + c2 - x.ev_base
                if other > told:
                    Q, c, told = Q2, c2, other
        x.ev_told[k] = told
        if o < OCTAVES - 1:
            x.told[o, k, 0], x.told[o, k, 1] = Q if told > 0.0 else REFUSED, c
    if o < OCTAVES - 1:
        x.told_n[o] = n
