"""Whether a counted oscillation adds to the command or has taken its place.

It is told by the command's own part of the rod's motion: over the last samples since the first crossing

    y = g m + A cos w t + B sin w t + rest

where the sine also takes up what the control law answers at the oscillation's own frequency. Added, g is 1; in place,
0. Its deviation follows from the rest and from how far the command has moved; while both are possible the name is
AMBIGUOUS, and it is so where no sine explains the rest: an actuator that has lost flow, pressure or its hold swings as
well, with the command or with the gusts.
"""

import math

from actuators.block import kernel
from fdi.common.sinusoid import fit_sine, put
from fdi.common.verdict import AMBIGUOUS, OFC_LIQUID, OFC_SOLID

SAMPLE, RING = 0.02, 250  # a sample of the ring [s]: five of a period at 10 Hz; 2.5 periods at 0.5 Hz
EVERY = 25  # samples after which the name is weighed anew
PERIODS = 2.0  # that the window must hold
SWINGS = 0.2  # share of the rest that the sine must leave at most
CORRELATED = 0.1  # time by which samples of the rest are independent: half a period of the servo's pole [s]
SURE = 3.0  # deviations of the gain
NEAR = 0.25  # by so much it may be off 1 or 0: the valve's limit, what is not sine

STATE = [
    ("sums", "f8", (2,), "m"),  # of the open sample: rod, rod of a healthy servo
    ("ticks", "f8", "-"),  # in it
    ("head", "f8", "-"),  # write position
    ("ring", "f8", (2, RING), "m"),
    ("since", "f8", "-"),  # samples since the first crossing of the alarm
    ("gain", "f8", "-"),  # of the command's own part
    ("gain_sigma", "f8", "-"),  # its deviation
    ("sine_hz", "f8", "Hz"),  # frequency of the best sine
    ("residual", "f8", "-"),  # share of the rest that the best sine leaves
]


@kernel
def keep_sample(x, rod, healthy, p):
    """Take the `rod` and that of a `healthy` servo [m] into the ring."""
    x.sums[0] += rod
    x.sums[1] += healthy
    x.ticks += 1.0
    if x.ticks < p.even:
        return
    x.head = put(x.ring, x.sums, x.ticks, x.head)
    x.ticks = 0.0
    x.since += 1.0


@kernel
def weigh(x, p, h):
    """Return the class that the gain of the command's own part tells, else AMBIGUOUS; `h`: time of a sample [s]."""
    n = int(min(x.since, float(RING)))
    first = (int(x.head) - n) % RING
    Y, M = x.ring[0], x.ring[1]
    best, rest, gain, dd, before = fit_sine(Y, M, first, n, h, PERIODS / (n * h), min(p.f_high, 0.4 / h), 0.0)
    x.gain, x.gain_sigma = gain, math.sqrt(max(rest, 0.0) * CORRELATED / (n * h) / max(dd, 1e-12))
    x.residual, x.sine_hz = rest / before if best > 0.0 else 1.0, best
    off = SURE * x.gain_sigma
    nearest = 1.0 if x.gain > 0.5 else 0.0
    away = math.fabs(x.gain - nearest)
    if x.residual > SWINGS or away > NEAR + off or away + off > 0.5:
        return AMBIGUOUS
    return OFC_LIQUID if nearest > 0.5 else OFC_SOLID


@kernel
def name(x, p, dt):
    """Weigh an oscillation while it is counted, at every EVERY-th sample; a class that is told is the verdict."""
    if x.timer == p.t_release and x.ticks == 0.0 and int(x.since) % EVERY == 0:
        said = weigh(x, p, p.even * dt)
        x.verdict = x.verdict if said == AMBIGUOUS else said
    if x.verdict == OFC_LIQUID or x.verdict == OFC_SOLID:
        x.ofc_hz = x.sine_hz
