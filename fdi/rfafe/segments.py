"""Which sides oscillate, which segment alone, and whether beside the command or in its place: one fit of all segments.

    e = A cos w t + B sin w t - share m + constant + rest

e is a segment's position less that of its model and less its mean while the trim was learned, m what the model of its
side does (fdi/rfafe/servo.py). The bank declares a side and says about which w; the samples since then, and those of
the PERIODS before that the bank has needed, are fitted, w where the worst segment of the declared sides is fitted best.

Class. Of a segment that oscillates the share of the command that does not come through is 0 (liquid) or 1 (solid). Its
variance follows from the rest and from how far the model moves beside the sine, so that nothing is told where the
command rests. It is told from an EVIDENCE on, the logarithm of the likelihood of one over that of the other, and stands
until the other is likelier; an oscillation that comes back within the ring's length keeps it.

Sides. The limit of a side is as high as what a manoeuvre leaves in it; what swings at the frequency of another side, by
more than MOVED of it and more than standing still explains, is not of a manoeuvre. Such a side is declared, too, if its
swing stands out of the rest, else the class stays AMBIGUOUS.

Segment. The largest of the declared sides if no other of them reaches ALONE of it: of what oscillates the swings, else
mean squares.
"""

import math

from actuators.block import kernel
from actuators.constants import RAD_PER_DEG
from fdi.common.sinusoid import beside, fit_sine, put
from fdi.common.verdict import AMBIGUOUS, NONE, OFC_LIQUID, OFC_SOLID
from fdi.rfafe.core import AIRFRAME
from fdi.rfafe.servo import D, R

SAMPLE, RING = 0.04, 250  # a sample of the ring [s]: 2.5 of a period at 10 Hz; ten seconds, five periods at 0.5 Hz
EVERY = 6  # samples after which the fit is renewed: a quarter of a second
PERIODS = 1.5  # that an oscillation has lasted when the bank declares it: its windows have two and must agree
NEXT = 1.15  # ratio by which it may be off the bank's frequency: half a step of the bank is 1.13
# Amplitude of a segment over that of the largest: electromechanical segments move half as far under the same fault, a
# third where their rate limits it; of one that is healthy the law's answer leaves a fifth
ALONE, MOVED = 0.3, 0.25
# Time by which samples of the rest are independent [s], error of the share that a servo at a limit makes, logarithm of
# the ratio of likelihoods from which a class is given: chosen on training flights, on which few names depend on them
CORRELATED, MODEL, EVIDENCE = 0.3, 0.15, 8.0
NAMES = ("", "elevator_left_outer", "elevator_left_inner", "elevator_right_inner", "elevator_right_outer")

STATE = [
    ("apart", "f8", (4,), "deg"),  # mean of each segment's residual beside its side's, while the trim was learned
    ("part_ring", "f8", (6, RING), "deg"),  # residual of each segment, position of each side's model
    ("part_sums", "f8", (6,), "deg"),  # of the open sample
    ("part_ticks", "f8", "-"),  # in it
    ("part_head", "f8", "-"),  # next place in the ring
    ("part_since", "f8", "-"),  # samples since the alarm; without one the negative of those since its end
    ("part_size", "f8", (4,), "deg2"),  # mean square of each segment's residual
    # of it what the sine explains, of a side not declared what no share of the command that is lost explains as well
    ("swing", "f8", (4,), "deg2"),
    ("noise", "f8", (4,), "deg2"),  # what sine and command leave
    ("share", "f8", "-"),  # of the command that does not come through where most oscillates
    ("share_sigma", "f8", "-"),
    ("ofc_class", "f8", "-"),  # class by the share; NONE where it is open
    ("segment", "f8", "-"),  # that alone does not follow, index into NAMES; 0: several, or open
]


@kernel
def compare(x, u, p, dt):
    """Learn how far segments are apart with the trim, then take the residuals of this sample; x.y holds deviations once
    the trim is known."""
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
def name(x, dt):
    """Set class, sides and segment of what is declared."""
    swings = x.ofc_timer[0] + x.ofc_timer[1] > 0.0
    if x.part_ticks * dt > SAMPLE - 0.5 * dt:
        x.part_head = put(x.part_ring, x.part_sums, x.part_ticks, x.part_head)
        x.part_ticks = 0.0
        x.part_since = max(x.part_since, 0.0) + 1.0 if swings else min(x.part_since, 0.0) - 1.0
        if x.part_since < -RING:
            x.ofc_class, x.swing[:] = NONE, 0.0
        if swings and int(x.part_since) % EVERY == 1:
            _fit(x)
    most = max(max(x.swing[0], x.swing[1]), max(x.swing[2], x.swing[3]))
    if swings:
        x.verdict = AMBIGUOUS if x.ofc_class == NONE else x.ofc_class
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
    """Fit sine and share of the command to the residuals of the segments, of the worst first; weigh the class."""
    worst, _, _ = _largest(x, x.part_size)
    hz = x.ofc_hz[worst // 2] if x.ofc_hz[worst // 2] > 0.0 else x.ofc_hz[1 - worst // 2]  # of a side declared
    n = int(min(x.part_since + PERIODS / (hz * SAMPLE), RING))
    first, m = (int(x.part_head) - n) % RING, x.part_ring[4 + worst // 2]
    hz, rest, gain, mm, _ = fit_sine(x.part_ring[worst], m, first, n, SAMPLE, hz / NEXT, hz * NEXT, 1.0)
    free = max(n * SAMPLE / CORRELATED - 1.0, 1e-3)  # samples of the rest that are independent, less the share
    x.share, x.share_sigma = -gain, math.sqrt(max(rest, 0.0) / (free * max(mm, 1e-12)))
    for i in range(4):
        e, m = x.part_ring[i], x.part_ring[4 + i // 2]
        ee, em, mm = beside(e, m, first, n, 2.0 * math.pi * hz * SAMPLE, 1.0)
        whole, along, square = beside(e, m, first, n, 0.0, 1.0)
        lost = 0.0 if x.ofc_timer[i // 2] > 0.0 else min(max(-along / max(square, 1e-12), 0.0), 1.0)
        x.swing[i] = min(whole - ee, whole + lost * (2.0 * along + lost * square)) / n
        x.noise[i] = (ee - em * em / max(mm, 1e-12)) / n
    near, likelier = (1.0, OFC_SOLID) if x.share > 0.5 else (0.0, OFC_LIQUID)
    evidence = (0.5 - math.fabs(x.share - near)) / (x.share_sigma * x.share_sigma + MODEL * MODEL)
    if evidence >= EVIDENCE:
        x.ofc_class = likelier
    elif evidence > 0.0 and likelier != x.ofc_class:
        x.ofc_class = NONE
