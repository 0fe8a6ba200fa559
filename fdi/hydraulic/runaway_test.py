"""Runaway test: w = f + d has jumped and stays constant against the command, as with a valve that stands open."""

import math

from actuators.block import kernel
from fdi.hydraulic.sample_rings import N

FLAT, RISE, BEND = 0.2, 0.4, 3.0  # a runaway's valve stays so flat, BEND times as long as it took to rise from RISE
EVEN = 0.05  # ... by its own noise and this share
LOOSE = 0.6  # ... more of it where the valve is wide open: no oscillation is that fast for so long
SUDDEN = (0.05, 0.125)  # a runaway's valve has opened within [s], by ring: a sine takes a tenth of its period
AGAINST = 0.4  # ... and has not stood open the other way before, by this share
WAS = 0.45  # w before the jump, over what it is after it
TRAVEL = 4e-3  # [m] that way


@kernel
def is_runaway(x, p, j, least, h, opposed):
    """Return whether the valve stands open since a jump: w flat for BEND times as long as it took to get there.

    Over means of three samples of ring `j`, flat for at least so many samples.
    """
    if x.bank_seen[j] < N:
        return False
    newest = int(x.bank_head[j]) - 1
    newest = newest + N if newest < 0 else newest
    i, mean = newest, 0.0
    for _ in range(least):
        mean += (x.bank_ring[0, j, i] + x.bank_ring[1, j, i]) / least
        i = N - 1 if i == 0 else i - 1
    size = math.fabs(mean)
    side = 1.0 if mean > 0.0 else -1.0
    if size < 0.6 * x.noise_scale * p.run_threshold or side * x.bank_ring[1, j, newest] > -opposed * size:
        return False
    w0 = side * (x.bank_ring[0, j, newest] + x.bank_ring[1, j, newest])
    i = N - 1 if newest == 0 else newest - 1
    w1 = side * (x.bank_ring[0, j, i] + x.bank_ring[1, j, i])
    flat, rise, jumped, against = 0, 0, False, False
    flat_to = min(FLAT * size, (EVEN + LOOSE * size) * size + 1.2 * x.noise_scale * p.sigma[j])
    for _ in range(N - 2):
        i = N - 1 if i == 0 else i - 1
        w2 = side * (x.bank_ring[0, j, i] + x.bank_ring[1, j, i])
        w = (w0 + w1 + w2) / 3.0
        w0, w1 = w1, w2
        fault = side * (x.bank_ring[0, j, i] - x.gain * x.bank_ring[1, j, i])
        if jumped:
            against = against or fault < -AGAINST * size
            continue
        before = w if j > 0 else fault
        if before <= RISE * size and w <= WAS * size:
            jumped = True
            continue
        if rise == 0 and math.fabs(w - size) <= flat_to:
            flat += 1
        else:
            rise += 1
    sudden = rise * h <= SUDDEN[j] and flat >= BEND * rise
    return jumped and not against and flat >= least - 2 and sudden and flat * h * size >= TRAVEL


@kernel
def runs_away(x, p, dt):
    """Return whether one of the bank's faster rings shows a valve that stands open."""
    loaded = x.x_hat[3] * (x.f_slow + x.u_slow) > 0.0  # the way in which a free-floating surface moves
    if is_runaway(x, p, 0, 18 if loaded else 12, p.bank_block[0] * dt, 0.0):
        return True
    return is_runaway(x, p, 1, 16, p.bank_block[1] * dt, 0.6)
