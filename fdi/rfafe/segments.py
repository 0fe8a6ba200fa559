"""Which sides and which segment oscillate, and whether beside the command or in its place.

    e_outer = e + d / 2,  e_inner = e - d / 2,  d = outer - inner - (m_outer - m_inner) - d_0
    e = A cos w t + B sin w t - share m + const

e is the side's position less that of its model m (fdi/rfafe/rfafe.py), d the difference of its two segments less that
of their models and its mean d_0 while the trim was learned. The last RING samples since the alarm are fitted, w about
what the bank found where the worst segment is fitted best, then all four. A segment of less than ONE of the largest
swing is healthy, one from BOTH on oscillates, too, as do the segments of a side that the bank declares: limits of a
single side are as high as what a manoeuvre leaves in it, a swing in step with another is not of the manoeuvre. Of those
that oscillate share is 0 (liquid) or 1 (solid); its deviation follows from the rest and from how far the command has
moved. The class is told when one of the two fits and is exp(EVIDENCE) times likelier than the other, while no side is
between ONE and BOTH; once told it stands until the other is told.

`segment` is the one that does not follow while the second largest is below ONE of it; without an oscillation sizes are
mean squares.
"""

import math

from actuators.block import kernel
from actuators.constants import RAD_PER_DEG
from fdi.common.sinusoid import beside, fit_sine, put
from fdi.common.verdict import AMBIGUOUS, OFC_LIQUID, OFC_SOLID
from fdi.rfafe.core import AIRFRAME
from fdi.rfafe.servo import D, R

SAMPLE, RING = 0.04, 125  # a sample of the ring [s]: five of a period at 10 Hz; 2.5 periods at 0.5 Hz
EVERY = 6  # samples after which the fit is renewed
PERIODS, NEXT = 1.5, 1.15  # that the window must hold; how far from the bank's frequency the sine may be, a ratio
ALONE, MOVED = 0.3, 0.25  # amplitude of one segment over that of the largest
CORRELATED, MODEL = 0.3, 0.15  # time by which samples of the rest are independent [s]; error of the model in the share
EVIDENCE = 8.0  # logarithm of a ratio of likelihoods
NAMES = ("", "elevator_left_outer", "elevator_left_inner", "elevator_right_inner", "elevator_right_outer")

STATE = [
    ("apart", "f8", (4,), "deg"),  # d_0 of each segment
    ("part_ring", "f8", (6, RING), "deg"),  # residual of each segment, position of each side's model
    ("part_sums", "f8", (6,), "deg"),  # of the open sample
    ("part_ticks", "f8", "-"),  # in it
    ("part_head", "f8", "-"),  # next place in the ring
    ("part_since", "f8", "-"),  # samples since the alarm; without one the negative of those since its end
    ("part_size", "f8", (4,), "deg2"),  # mean square of each segment's residual
    ("swing", "f8", (4,), "deg2"),  # of it what the sine explains
    ("noise", "f8", (4,), "deg2"),  # what sine and command leave
    ("share", "f8", "-"),  # of the command that does not come through where most oscillates
    ("share_sigma", "f8", "-"),
    ("ofc_class", "f8", "-"),  # told by it
    ("segment", "f8", "-"),  # that alone does not follow, index into NAMES; 0: several, or open
]


@kernel
def compare(x, u, p, dt):
    """Learn d_0 with the trim, then take the residuals of this sample; x.y holds deviations once the trim is known."""
    for i in range(4):
        j, k = i // 2, i + 1 - 2 * (i % 2)  # side, other segment of it
        d = 0.5 * ((u.surface[i] - u.surface[k]) / RAD_PER_DEG - x.ref[i, R] + x.ref[i, D] + x.ref[k, R] - x.ref[k, D])
        if x.started < 0.5:
            x.apart[i] += (d - x.apart[i]) / max(x.seen, 1.0) if x.seen < p.n_trim else 0.0
            continue
        m = x.act[j] - p.gain[j] * x.u0[j]
        e = x.y[AIRFRAME + j] - m + d - x.apart[i]
        x.part_sums[i] += e
        x.part_sums[4 + j] += 0.5 * m
        x.part_size[i] += (1.0 - math.exp(-dt / p.tau_energy)) * (e * e - x.part_size[i])
    x.part_ticks += x.started


@kernel
def name(x, p, dt):
    """Set class, sides and segment of what is declared."""
    swings = x.ofc_timer[0] + x.ofc_timer[1] > 0.0
    if x.part_ticks * dt > SAMPLE - 0.5 * dt:
        x.part_head = put(x.part_ring, x.part_sums, x.part_ticks, x.part_head)
        x.part_ticks = 0.0
        x.part_since = max(x.part_since, 0.0) + 1.0 if swings else min(x.part_since, 0.0) - 1.0
        if x.part_since < -RING:
            x.ofc_class, x.swing[:] = AMBIGUOUS, 0.0
        if swings and int(x.part_since) % EVERY == 1:
            _fit(x)
    most = max(max(x.swing[0], x.swing[1]), max(x.swing[2], x.swing[3]))
    if swings:
        x.verdict = x.ofc_class
        for i in range(4):
            if x.ofc_timer[i // 2] == 0.0 and x.swing[i] > MOVED * MOVED * most:
                if x.swing[i] - x.noise[i] > MOVED * MOVED * most:
                    x.isolated_part = 3.0
                else:
                    x.verdict = AMBIGUOUS
    which, most, next_ = _largest(x, x.swing if swings and most > 0.0 else x.part_size)
    x.segment = 1.0 + which if x.alarm > 0.5 and next_ < ALONE * ALONE * most else 0.0


@kernel
def _largest(x, sizes):
    """Return (segment from 0, size, size of the next) of the largest of the sides declared."""
    which, most, next_ = 0, -1.0, 0.0
    for i in range(4):
        if x.isolated_part == 3.0 or (i < 2) == (x.isolated_part < 1.5):
            if sizes[i] > most:
                which, most, next_ = i, sizes[i], most
            else:
                next_ = max(next_, sizes[i])
    return which, most, next_


@kernel
def _fit(x):
    """Fit the sine and the command's share to the segments' residuals since the alarm, of the worst of those declared
    first."""
    worst, _, _ = _largest(x, x.part_size)
    hz = x.ofc_hz[worst // 2]
    n = int(min(x.part_since + PERIODS / (hz * SAMPLE), RING))
    first, m = (int(x.part_head) - n) % RING, x.part_ring[4 + worst // 2]
    hz, rest, gain, mm, _ = fit_sine(x.part_ring[worst], m, first, n, SAMPLE, hz / NEXT, hz * NEXT, 1.0)
    free = max(n * SAMPLE / CORRELATED - 1.0, 1e-3)  # samples of the rest that are independent, less the share
    x.share, x.share_sigma = -gain, math.sqrt(rest / (free * max(mm, 1e-12)))
    for i in range(4):
        e, m = x.part_ring[i], x.part_ring[4 + i // 2]
        ee, em, mm = beside(e, m, first, n, 2.0 * math.pi * hz * SAMPLE, 1.0)
        x.swing[i] = (beside(e, m, first, n, 0.0, 1.0)[0] - ee) / n
        x.noise[i] = (ee - em * em / max(mm, 1e-12)) / n
    near, likelier = (1.0, OFC_SOLID) if x.share > 0.5 else (0.0, OFC_LIQUID)
    evidence = (0.5 - math.fabs(x.share - near)) / (x.share_sigma * x.share_sigma + MODEL * MODEL)
    if evidence >= EVIDENCE:
        x.ofc_class = likelier
    elif evidence > 0.0 and likelier != x.ofc_class:
        x.ofc_class = AMBIGUOUS
