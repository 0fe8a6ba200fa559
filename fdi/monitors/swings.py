"""Swings of a rod's residual in sub-bands, counted while they alternate: the crossing counter of in-service monitors.

A swing is a sub-band's e beyond its limit. Swings of alternating sign are counted over a sliding window of as many half
periods of the sub-band's lowest frequency; an alarm needs `half_periods` of them. In the lowest sub-band it is also
half the way from one turning point to the next, where that is more.

The filters answer a step of the rod, as when a fault begins or heals, with alternating swings as well, and in the
lowest sub-band the answer lasts into the next step. There a second copy of the filters runs on from each turning point
with the residual held as it was, and a swing counts only where e departs from that copy's by MOVED of the limit: the
residual has moved since.
"""

import math

from actuators.block import kernel

BANDS = ((0.4, 1.3), (1.3, 4.0), (4.0, 12.0))  # [Hz]; 0.5 to 10 Hz is considered
B = len(BANDS)
COUNT = 4  # swings kept
# of the reference's motion: what the response of a servo 10 % off makes beside the usual one in a first manoeuvre
UNKNOWN = 0.2
MOVED = 0.5  # of the limit: by so much a swing must differ from the filters' own answer to what was before

STATE = [
    ("high", "f8", (B, 2)),  # filter states
    ("low", "f8", (B, 2)),
    ("e_band", "f8", (B,), "m"),  # residual by band
    ("peak", "f8", (B,), "m"),  # its largest, fading
    ("side", "f8", (B,), "-"),  # sign of the last swing that counts, 0 for none in the window
    ("swing", "f8", (B,), "m"),  # how large the swing is now
    ("off", "f8", (2,), "m"),  # residual less what has been learned, and the same without what is slow
    ("turn", "f8", "m"),  # of the lowest sub-band: where the swing begins
    ("turn_age", "f8", "s"),  # time since then
    ("stood", "f8", "m"),  # residual then
    ("own_high", "f8", (2,)),  # filter states had it stood still since
    ("own_low", "f8", (2,)),
    ("ages", "f8", (B, COUNT), "s"),  # time since the last swings that count, newest first
]


@kernel
def filtered(s, v, a1, g):
    """Return (low, high, band) of a second-order Butterworth state-variable filter with states `s`, and advance it."""
    k = math.sqrt(2.0)
    e = v - s[1]
    band = a1 * s[0] + g * a1 * e
    low = s[1] + g * a1 * s[0] + g * g * a1 * e
    s[0] = 2.0 * band - s[0]
    s[1] = 2.0 * low - s[1]
    return low, v - k * band - low, band


@kernel
def limit(x, p, b):
    """Return what band b's residual has to exceed [m]."""
    return p.threshold[b] + (p.share[b] + UNKNOWN * max(x.unknown, x.limited)) * x.ref_peak[b]


@kernel
def mark(x, v):
    """Begin a swing of the lowest sub-band at `v` [m], and what its filters make of a residual that stands still."""
    x.turn, x.turn_age, x.stood = v, 0.0, x.off[0]
    for i in range(2):
        x.own_high[i], x.own_low[i] = x.high[0, i], x.low[0, i]


@kernel
def count(x, p, b, dt):
    """Split band b off and count its swings; return whether they make an oscillation now."""
    for i in range(COUNT):
        x.ages[b, i] += dt
    _, high, _ = filtered(x.high[b], x.off[min(b, 1)], p.high_a1[b], p.high_g[b])
    v, _, _ = filtered(x.low[b], high, p.low_a1[b], p.low_g[b])
    n, half, most = int(p.half_periods), 0.5 / p.f_low[b], limit(x, p, b)
    x.e_band[b], x.swing[b] = v, math.fabs(v)
    x.peak[b] = max(x.peak[b] * (1.0 - dt / half), math.fabs(v))
    side = 1.0 if v > 0.0 else -1.0
    moved = True
    if b == 0:
        _, high, _ = filtered(x.own_high, x.stood, p.high_a1[0], p.high_g[0])
        own, _, _ = filtered(x.own_low, high, p.low_a1[0], p.low_g[0])
        side = 1.0 if v > x.turn else -1.0
        x.swing[0] = max(side * v, 0.5 * math.fabs(v - x.turn))
        moved = side * (v - own) >= MOVED * most
        x.turn_age += dt
        if x.turn_age > half:
            moved = False
            mark(x, v)
    if side == x.side[b]:
        if b == 0:
            mark(x, v)
    elif x.swing[b] >= most and moved:
        x.side[b] = side
        if b == 0:
            mark(x, v)
        for i in range(COUNT - 1, 0, -1):
            x.ages[b, i] = x.ages[b, i - 1]
        x.ages[b, 0] = 0.0
    span = x.ages[b, n - 1] - x.ages[b, 0]
    if x.ages[b, 0] > (n - 1) * half:
        x.side[b] = 0.0
    if x.ages[b, 0] > half or span > (n - 1) * half or span <= 0.0:
        return False
    x.ofc_hz = 0.5 * (n - 1) / span
    return True
