"""The air that moves: Dryden turbulence, steady wind, its linear shear, and discrete gusts, met by the tail later.

    u_g    first order, sigma^2 2 tau / (1 + (tau w)^2),  tau = L / V
    v_g, w_g   sigma sqrt(tau) (1 + sqrt(3) tau s) / (1 + tau s)^2 on white noise
    p_g    first order, the gradient over the span b
    q_g    (1 - d epsilon / d alpha) (w(t) - w(t - l / V)) / l: tail and downwash meet it when the wing has met it
    r_g    -(v(t) - v(t - l / V)) / l: so does the fin

    1-cosine   U / 2 (1 - cos(pi s / H)) over 0 <= s <= 2 H, s the way flown into it, H its gradient  [CS-25] 25.341(a)
    ramp       the same up to s = H, U from there on                                  [MIL-F-8785C] 3.7.1.3
    wind       W + (h - h_0) dW/dh from one direction, h_0 the altitude of the start

A gust is the air's velocity over the ground. Turbulence [MIL-F-8785C, above 2,000 ft] is in body axes, forward, right
and down +, all three components of the same sigma (`INTENSITY`, constant over altitude) and scale length; sigma may
change within a flight, by straight lines. A discrete gust is along the heading, across it, or vertical, in level axes;
a positive one raises airspeed, sideslip or angle of attack: it blows from ahead, from the right or upwards. v and w of
the tail are those of both. q_g and r_g are the body rates that give tail and fin the same local angle; JSBSim's
aerodynamics add them to its own. Wind and shear have no gradient over the aircraft.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel
from actuators.constants import M_PER_FT
from cosim.flight.blocks.noise import generator

INTENSITY = {"none": 0.0, "light": 5 * M_PER_FT, "moderate": 10 * M_PER_FT, "severe": 21 * M_PER_FT}  # rms [m/s]
SCALE_LENGTH = 1750 * M_PER_FT  # [MIL-F-8785C] Dryden form [m]
LINE = 128  # samples of the way from the wing to the tail
CHANGES, DISCRETE = 16, 16  # most changes of the turbulence and discrete gusts of a flight
KNOTS = 2 * CHANGES + 1
AXES = ("longitudinal", "lateral", "vertical")
SHAPES = ("1-cosine", "ramp")

PARAMS = dtype([
    ("time", "f8", (KNOTS,), "s"),  # of the flight, rising from 0, inf where unused
    ("sigma", "f8", (KNOTS,)),  # rms of each component at those times, between them on a line [m/s]
    ("length", "f8"),  # scale length [m]
    ("span", "f8"),  # [m]
    ("tail_arm", "f8"),  # from the CG aft to tail and fin [m]
    ("downwash", "f8"),  # d epsilon / d alpha [-]
    ("stride", "f8"),  # ticks between two samples of the line
    ("wind", "f8", (2,)),  # steady wind to north and east at h_0 [m/s]
    ("shear", "f8", (2,)),  # its growth with altitude [1/s]
    ("h_0", "f8", "m"),
    ("start", "f8", (DISCRETE,), "s"),  # when each discrete gust is entered, inf where unused
    ("speed", "f8", (DISCRETE, 3)),  # its speed along AXES, + raises airspeed, sideslip, angle of attack [m/s]
    ("gradient", "f8", (DISCRETE,)),  # way flown from its beginning to its full speed [m]
    ("stays", "f8", (DISCRETE,)),  # 1: a ramp
])
INPUTS = dtype([
    ("noise", "f8", (4,)),  # standard normal draws for u, v, w, p
    ("tas", "f8"),  # [m/s]
    ("phi", "f8"),  # [rad]
    ("theta", "f8"),
    ("psi", "f8"),
    ("h", "f8", "m"),
])
STATE = dtype([
    ("north", "f8"),  # gust over the ground [m/s]
    ("east", "f8"),
    ("down", "f8"),
    ("p", "f8"),  # its gradients as body rates [rad/s]
    ("q", "f8"),
    ("r", "f8"),
    ("u", "f8"),  # body components over sigma [-]
    ("v", "f8", (2,)),
    ("w", "f8", (2,)),
    ("v_line", "f8", (LINE,)),  # the past of the body components, a ring [m/s]
    ("w_line", "f8", (LINE,)),
    ("head", "f8"),  # of the newest sample
    ("since", "f8"),  # ticks since it was taken
    ("ticks", "f8", "-"),  # of the flight
    ("knot", "f8", "-"),  # of the turbulence's changes, the last that has come
    ("way", "f8", (DISCRETE,)),  # flown into each discrete gust [m]
])
OUTPUTS = ("north", "east", "down", "p", "q", "r")


def params(
    intensity: str, dt: float, *, span: float, tail_arm: float, downwash: float,
    changes: Sequence[tuple[float, str, float]] = (), wind: tuple[float, float] = (0.0, 0.0),
    shear: tuple[float, float] = (0.0, 0.0), altitude: float = 0.0,
    gusts: Sequence[tuple[float, str, float, float, str]] = (),
) -> np.ndarray:  # fmt: skip
    """Return PARAMS for "none", "light", "moderate" or "severe"; lengths in m. KeyError for another word.

    `changes` are (start [s], word, time until it is reached [s]), one after the other; `wind` and `shear` to north and
    east [m/s, 1/s] at `altitude` [m]; `gusts` (start [s], one of AXES, speed [m/s], gradient [m], one of SHAPES).
    """
    p = np.zeros(1, PARAMS)
    p["length"] = SCALE_LENGTH
    p["span"], p["tail_arm"], p["downwash"] = span, tail_arm, downwash
    p["stride"] = math.ceil(tail_arm / 60.0 / dt / (LINE - 2))  # the line is long enough down to 60 m/s
    p["wind"], p["shear"], p["h_0"] = wind, shear, altitude
    knots = [(0.0, INTENSITY[intensity])]
    for start, word, ramp in changes:
        knots += [(start, knots[-1][1]), (start + ramp, INTENSITY[word])]
    p["time"], p["sigma"] = np.inf, knots[-1][1]
    for i, (time, sigma) in enumerate(knots):
        p["time"][0, i], p["sigma"][0, i] = time, sigma
    p["start"], p["gradient"] = np.inf, 1.0
    for i, (start, axis, speed, gradient, shape) in enumerate(gusts):
        p["start"][0, i], p["gradient"][0, i], p["stays"][0, i] = start, gradient, SHAPES.index(shape)
        p["speed"][0, i, AXES.index(axis)] = speed
    return p


def init(p: np.ndarray) -> Any:
    """Return the air of the start: the steady wind."""
    x = np.zeros(p.shape, STATE)
    x["north"], x["east"] = p["wind"][:, 0], p["wind"][:, 1]
    return x


@kernel
def _second(z, n, e, adt):
    """Advance the two states of (1 + sqrt(3) tau s) / (1 + tau s)^2 by white noise; return its output, rms 1."""
    g = math.sqrt(0.5 * (1.0 - e * e)) * n
    z[1] = e * (z[1] + adt * z[0]) + 0.5 * adt * g
    z[0] = e * z[0] + g
    return math.sqrt(3.0) * z[0] + (1.0 - math.sqrt(3.0)) * z[1]


@kernel
def _late(line, head, ticks):
    """Return the value `ticks` samples ago, between two samples by a straight line."""
    k = int(ticks)
    f = ticks - k
    a = line[(head + LINE - k) % LINE]
    b = line[(head + LINE - k - 1) % LINE]
    return (1.0 - f) * a + f * b


@kernel
def _intensity(x, p, t):
    """Return the rms of the turbulence at time t [m/s]."""
    i = int(x.knot)
    while i + 1 < KNOTS and t >= p.time[i + 1]:
        i += 1
    x.knot = i
    if i + 1 == KNOTS or p.time[i + 1] == math.inf:
        return p.sigma[i]
    return p.sigma[i] + (p.sigma[i + 1] - p.sigma[i]) * (t - p.time[i]) / (p.time[i + 1] - p.time[i])


@kernel
def _discrete(x, p, axis, t, way):
    """Return the speed of the discrete gusts along an axis after another `way` [m] in each that has begun by t."""
    total = 0.0
    for i in range(DISCRETE):
        if p.speed[i, axis] != 0.0:
            x.way[i] += way if t > p.start[i] else 0.0
            s = x.way[i] / p.gradient[i]
            if p.stays[i] > 0.0 and s > 1.0:
                total += p.speed[i, axis]
            elif s < 2.0:
                total += 0.5 * p.speed[i, axis] * (1.0 - math.cos(math.pi * s))
    return total


@kernel
def step(x, u, p, dt):
    """Advance the air by one tick and give it in axes of the earth."""
    speed = max(u.tas, 30.0)
    x.ticks += 1.0
    t = x.ticks * dt
    sigma = _intensity(x, p, t)
    begun = t - 0.5 * dt  # a gust that begins with this tick has been entered by nothing
    against, from_right, up = (
        _discrete(x, p, 0, begun, speed * dt),
        _discrete(x, p, 1, begun, speed * dt),
        _discrete(x, p, 2, begun, speed * dt),
    )
    adt = speed * dt / p.length
    e = math.exp(-adt)
    x.u = e * x.u + math.sqrt(1.0 - e * e) * u.noise[0]
    ug = sigma * x.u
    vg = sigma * _second(x.v, u.noise[1], e, adt)
    wg = sigma * _second(x.w, u.noise[2], e, adt)

    cf, sf = math.cos(u.phi), math.sin(u.phi)
    ct, st = math.cos(u.theta), math.sin(u.theta)
    cp, sp = math.cos(u.psi), math.sin(u.psi)
    v = vg - (sf * st * against + cf * from_right + sf * ct * up)
    w = wg - (cf * st * against - sf * from_right + cf * ct * up)

    x.since += 1.0
    if x.since >= p.stride:
        x.since = 0.0
        x.head = (x.head + 1.0) % LINE
        x.v_line[int(x.head)] = v
        x.w_line[int(x.head)] = w
    head = int(x.head)
    late = min(max((p.tail_arm / speed / dt - x.since) / p.stride, 0.0), LINE - 2.0)
    x.q = (1.0 - p.downwash) * (w - _late(x.w_line, head, late)) / p.tail_arm
    x.r = -(v - _late(x.v_line, head, late)) / p.tail_arm

    # [MIL-F-8785C] 3.7.2: roll gust of the vertical one over the span
    corner = math.pi * speed / (4.0 * p.span)
    variance = 0.8 * math.exp(math.log(math.pi * p.length / (4.0 * p.span)) / 3.0) / (p.length * speed) * corner / 2.0
    e = math.exp(-corner * dt)
    x.p = e * x.p + sigma * math.sqrt(variance * (1.0 - e * e)) * u.noise[3]

    below = sf * vg + cf * wg
    ahead = ct * ug + st * below - against
    across = cf * vg - sf * wg - from_right
    higher = u.h - p.h_0
    x.north = p.wind[0] + p.shear[0] * higher + (cp * ahead - sp * across)
    x.east = p.wind[1] + p.shear[1] * higher + (sp * ahead + cp * across)
    x.down = -st * ug + ct * below - up


rollout = entry(step, STATE, INPUTS, PARAMS)


class Gusts:
    """The air of one flight, as a block with noise from its own generator: it is met as `met` says, and moves `moved`.

    `met` are true airspeed [m/s], bank, pitch, heading [rad] and altitude [m] of the aircraft, `moved` the velocity to
    north, east and down [m/s] and p, q, r [rad/s].
    """

    DRAWS = 1000  # ticks of noise drawn at once
    every = 1

    def __init__(self, p: np.ndarray, dt: float, seed: int):
        """`p` PARAMS (1,); the same seed gives the same air."""
        self._rng, self._noise = generator(seed, "gusts"), np.zeros((self.DRAWS, 4))
        self.rollout, self.x, self.u, self.p, self.dt = rollout, init(p), np.zeros((1, 1), INPUTS), p, dt
        self._in, self.moved = self.u.view("f8").reshape(-1), self.x.view("f8")[:6]
        self.met = self._in[4:]

    def schedule(self, tape: Any) -> None:
        """Schedule on a tape that begins at tick 0 to advance by one tick."""
        tape.first(lambda k: None if k % self.DRAWS else self._rng.standard_normal(out=self._noise))
        tape.table(np.arange(4), self._noise, self._in)
        tape.step(self)
