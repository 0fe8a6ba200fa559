"""Fault signals, one lane per place a fault acts on: when, how strongly, in which shape.

A lane is active from `start` to `end`; its envelope g rises linearly over `ramp` and drops to zero at `end` (healed).
Its signal is

    form 0 constant   g * amplitude
    form 1 sine       g * amplitude * sin(omega (t - start) + phase)          oscillatory failure case (OFC)
    form 2 drift      g * amplitude * (t - start)                             amplitude in unit/s
    form 3 runaway    g * (latched reference + amplitude (t - start)), within [lower, upper]; from a reference outside
                      of them it stays there: a runaway never goes back to its limit
    form 4 square     g * amplitude * (1 in the first half of a period, -1 in the second)
    form 5 triangle   g * amplitude * the triangle with the sine's zeros and peaks
    form 6 chirp      the sine, its frequency omega + sweep (t - start) within [lower, upper]

A substitution (solid OFC, runaway) moves two inputs, its
share g of the healthy signal and its own signal. Which input of which part a kind of fault moves is in
cosim/flight/faults/inject.py.
"""

import math

from actuators.block import dtype, entry, kernel, zero_state

CONSTANT, SINE, DRIFT, RUNAWAY, SQUARE, TRIANGLE, CHIRP = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0
TURN = 2.0 * math.pi

PARAMS = dtype([
    ("form", "f8"),  # one of those above
    ("start", "f8", "s"),
    ("end", "f8", "s"),  # inf when never healed
    ("ramp", "f8", "s"),
    ("amplitude", "f8"),  # [unit of the place; per second for drift and runaway]
    ("omega", "f8", "rad/s"),
    ("phase", "f8", "rad"),
    ("lower", "f8"),  # limits of a runaway [unit of the place], of a chirp's frequency [rad/s]
    ("upper", "f8"),
    ("sweep", "f8", "rad/s2"),  # change of a chirp's frequency
])

INPUTS = dtype([
    ("t", "f8", "s"),  # time of the tick
    ("ref", "f8"),  # signal latched at the onset of a runaway [unit of the place]
])

STATE = dtype([
    ("active", "f8", "-"),  # 1 between start and end
    ("g", "f8", "-"),  # envelope, 0..1
    ("f_inj", "f8", "of the place"),  # injected signal
    ("f_neg", "f8"),  # its negative, for places that count the other way
    ("latch", "f8"),  # reference at onset [unit of the place]
])

OUTPUTS = ("active", "g", "f_inj")


init = zero_state(STATE)  # inactive


@kernel
def _swept(since, p):
    """Return the angle of a chirp [rad]; a frequency that has reached its limit stays there."""
    until = since
    if p.sweep != 0.0:
        until = min(since, ((p.upper if p.sweep > 0.0 else p.lower) - p.omega) / p.sweep)
    return p.omega * since + p.sweep * until * (since - 0.5 * until) + p.phase


@kernel
def _wave(form, angle):
    """Return the square or triangular wave of amplitude 1 at `angle` [rad]."""
    part = angle / TURN - math.floor(angle / TURN)
    if form == SQUARE:
        return 1.0 if part < 0.5 else -1.0
    return 4.0 * part if part < 0.25 else (2.0 - 4.0 * part if part < 0.75 else 4.0 * part - 4.0)


@kernel
def step(x, u, p, dt):
    """Advance one fault lane to the time of this tick."""
    since = u.t - p.start
    # half a tick of slack: start and end fall on the tick nearest to them, whatever the rounding of k * dt
    active = since > -0.5 * dt and u.t < p.end - 0.5 * dt
    if not active:
        x.active, x.g, x.f_inj, x.f_neg = 0.0, 0.0, 0.0, 0.0
        return
    if x.active == 0.0:
        x.latch = u.ref
    x.active = 1.0
    since = max(since, 0.0)
    x.g = 1.0 if p.ramp <= 0.0 else min(1.0, since / p.ramp)
    if p.form == SINE:
        s = p.amplitude * math.sin(p.omega * since + p.phase)
    elif p.form == CHIRP:
        s = p.amplitude * math.sin(_swept(since, p))
    elif p.form == SQUARE or p.form == TRIANGLE:
        s = p.amplitude * _wave(p.form, p.omega * since + p.phase)
    elif p.form == DRIFT:
        s = p.amplitude * since
    elif p.form == RUNAWAY:
        s = min(max(x.latch + p.amplitude * since, min(p.lower, x.latch)), max(p.upper, x.latch))
    else:
        s = p.amplitude
    x.f_inj = x.g * s
    x.f_neg = -x.f_inj


rollout = entry(step, STATE, INPUTS, PARAMS)
