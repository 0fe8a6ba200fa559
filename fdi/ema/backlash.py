"""Backlash of the surface, told from a wrong surface sensor: both leave position and velocity.

e is position less surface, rigging and windup taken off, in the even samples of `drive` since it began.

| hypothesis | model |
|---|---|
| sensor: bias, drift | e = a + b t |
| sensor: scale | e = k y |
| sensor: oscillation | e = a cos + b sin |
| loose | none: within the play the surface falls as its load drives it, bounces, and goes over when the load turns |

One of the first three that leaves what noise leaves is the sensor's; where all leave more, and e stays within what a
worn screw lets it move, the surface is loose. A surface that rests on one side of its play is a bias, e = const, but on
the side to which its hinge moment M drives it, e M < 0: a bias against M is the sensor's. One with it, within the play,
stays undecided: only the beginning differs, in which a reading steps within a sample and a surface needs
sqrt(2 e J / (arm M)), 20 to 60 ms under the usual loads. A scale is told where it leaves less than a bias, as which it
looks while the surface rests. A drift is judged from the beginning on, at zero.
"""

import math

from actuators.block import kernel
from fdi.common.decision import PLAY
from fdi.common.verdict import EFFECTIVENESS, NONE, SENSOR
from fdi.ema.shapes import EVEN_S, PAIR, RING, ROD, best_sine

FIRST, EVERY = 15, 5  # samples after which the hypotheses are weighed, and again
SURE = 40  # and after which noise is known well enough where it decides
BEGUN = 2.5  # deviations of e at which it begins
TAU_NOISE = 10.0  # memory of its noise [s]
SHARE, NOISE = 0.003, 1.3  # of what there is, and of noise, that a sensor's hypothesis may leave: 90 % at 40 samples
ZERO = 4.0  # deviations within which a drift begins
LOOSE, ROUGH = 0.06, 2.2  # and what all must leave where the surface is loose
VOTES = 2.0  # evaluations in a row
TAU_LOAD, TURNS = 0.5, 50.0  # lag of the hinge moment [s], and that which surely has a sign [N m]

STATE = [
    ("pair_since", "f8", "-"),  # samples since e began
    ("pair_noise", "f8", "m2"),  # variance of a sample
    ("pair_load", "f8", "N m"),  # hinge moment, lagged
    ("pair_votes", "f8", "-"),  # evaluations in a row that found it loose
    ("pair_name", "f8", "-"),  # SENSOR, EFFECTIVENESS where it is loose, or NONE
]


@kernel
def update(x, p):
    """Take the sample of `drive` that has just ended; write `pair_name` where one is sure."""
    head = int(x.even_head)
    now = RING - 1 if head == 0 else head - 1
    e = x.even_ring[PAIR, now]
    x.pair_load += EVEN_S / TAU_LOAD * (x.hm0 + x.hmd * x.x_hat[0] + x.x_hat[5] - x.pair_load)
    if x.pair_noise == 0.0:
        x.pair_noise = 1.5 * p.sigma_pos * p.sigma_pos / p.even  # of both sensors
    if x.sensor < 0.5 and e * e < BEGUN * BEGUN * x.pair_noise:
        x.pair_noise += EVEN_S / TAU_NOISE * (e * e - x.pair_noise)
        x.pair_since = x.pair_votes = 0.0
    elif x.pair_since < RING + EVERY:
        x.pair_since += 1.0
    else:
        x.pair_since -= EVERY - 1.0
    if x.sensor < 0.5:
        x.pair_name = NONE
    elif x.pair_name == NONE and x.blame == 2.0 and x.pair_since >= FIRST and int(x.pair_since) % EVERY == 0:
        _explain(x, now, min(int(x.pair_since) - 1, RING))


@kernel
def _explain(x, now, n):
    ee, e1, et, tt, ey, yy, far = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    first = now - n + 1 if now - n + 1 >= 0 else now - n + 1 + RING
    i = first
    for k in range(n):
        e, y, t = x.even_ring[PAIR, i], x.even_ring[ROD, i], k - 0.5 * (n - 1)
        ee += e * e
        e1 += e
        et += e * t
        tt += t * t
        ey += e * y
        yy += y * y
        far = max(far, math.fabs(e))
        i = 0 if i == RING - 1 else i + 1
    swing, _ = best_sine(x.even_ring[PAIR], first, n, 0.5 / (n * EVEN_S))
    scale, bias, slope, noise = ee - ey * ey / max(yy, 1e-12), ee - e1 * e1 / n, et / tt, n * x.pair_noise
    rests = min(min(scale, swing), bias - et * slope)  # of all that is no play at work
    least = min(swing, scale) if scale < bias - ROUGH * x.pair_noise else swing
    if far > PLAY or e1 * x.pair_load > TURNS * math.fabs(e1):
        least = min(least, bias)
    begun = e1 / n - 0.5 * n * slope
    if x.pair_since <= RING and math.fabs(begun) <= ZERO * math.sqrt(x.pair_noise) + 2.0 * math.fabs(slope):
        least = min(least, bias - et * slope)
    if least <= SHARE * ee + NOISE * noise and (n >= SURE or far > PLAY):
        x.pair_name = SENSOR
    moves = n >= SURE and rests >= LOOSE * ee + ROUGH * noise and far <= PLAY
    x.pair_votes = x.pair_votes + 1.0 if moves else 0.0
    if x.pair_votes >= VOTES:
        x.pair_name = EFFECTIVENESS
