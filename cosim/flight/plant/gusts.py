"""Turbulence: the Dryden gusts of MIL-F-8785C above 2,000 ft, in the aircraft's axes, met by the tail later.

    u_g    first order, sigma^2 2 tau / (1 + (tau w)^2),  tau = L / V
    v_g, w_g   sigma sqrt(tau) (1 + sqrt(3) tau s) / (1 + tau s)^2 on white noise
    p_g    first order, the gradient over the span b
    q_g    (1 - d epsilon / d alpha) (w_g(t) - w_g(t - l / V)) / l: tail and downwash meet it when the wing has met it
    r_g    -(v_g(t) - v_g(t - l / V)) / l: so does the fin

A gust is the air's velocity over the ground, body axes: forward, right and down +. q_g and r_g are the body rates that
give tail and fin the same local angle; JSBSim's aerodynamics add them to its own. All three components have the same
sigma (`INTENSITY`), constant over altitude, and the same scale length.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel
from actuators.constants import M_PER_FT
from cosim.flight.noise import generator

INTENSITY = {"none": 0.0, "light": 5 * M_PER_FT, "moderate": 10 * M_PER_FT, "severe": 21 * M_PER_FT}  # rms [m/s]
SCALE_LENGTH = 1750 * M_PER_FT  # [MIL-F-8785C] Dryden form [m]
LINE = 128  # samples of the way from the wing to the tail

PARAMS = dtype(
    [
        ("sigma", "f8"),  # rms of each component [m/s]
        ("length", "f8"),  # scale length [m]
        ("span", "f8"),  # [m]
        ("tail_arm", "f8"),  # from the CG aft to tail and fin [m]
        ("downwash", "f8"),  # d epsilon / d alpha [-]
        ("stride", "f8"),  # ticks between two samples of the line
    ]
)
INPUTS = dtype(
    [
        ("noise", "f8", (4,)),  # standard normal draws for u, v, w, p
        ("tas", "f8"),  # [m/s]
        ("phi", "f8"),  # [rad]
        ("theta", "f8"),
        ("psi", "f8"),
    ]
)
STATE = dtype(
    [
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
    ]
)
OUTPUTS = ("north", "east", "down", "p", "q", "r")


def params(intensity: str, dt: float, *, span: float, tail_arm: float, downwash: float) -> np.ndarray:
    """Return PARAMS for "none", "light", "moderate" or "severe"; lengths in m. KeyError for another word."""
    p = np.zeros(1, PARAMS)
    p["sigma"], p["length"] = INTENSITY[intensity], SCALE_LENGTH
    p["span"], p["tail_arm"], p["downwash"] = span, tail_arm, downwash
    p["stride"] = math.ceil(tail_arm / 60.0 / dt / (LINE - 2))  # the line is long enough down to 60 m/s
    return p


def init(p: np.ndarray) -> Any:
    """Return still air."""
    return np.zeros(p.shape, STATE)


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
def step(x, u, p, dt):
    """Advance the gusts by one tick and give them in axes of the earth."""
    speed = max(u.tas, 30.0)
    adt = speed * dt / p.length
    e = math.exp(-adt)
    x.u = e * x.u + math.sqrt(1.0 - e * e) * u.noise[0]
    ug = p.sigma * x.u
    vg = p.sigma * _second(x.v, u.noise[1], e, adt)
    wg = p.sigma * _second(x.w, u.noise[2], e, adt)

    x.since += 1.0
    if x.since >= p.stride:
        x.since = 0.0
        x.head = (x.head + 1.0) % LINE
        x.v_line[int(x.head)] = vg
        x.w_line[int(x.head)] = wg
    head = int(x.head)
    late = min(max((p.tail_arm / speed / dt - x.since) / p.stride, 0.0), LINE - 2.0)
    x.q = (1.0 - p.downwash) * (wg - _late(x.w_line, head, late)) / p.tail_arm
    x.r = -(vg - _late(x.v_line, head, late)) / p.tail_arm

    # [MIL-F-8785C] 3.7.2: roll gust of the vertical one over the span
    corner = math.pi * speed / (4.0 * p.span)
    variance = 0.8 * math.exp(math.log(math.pi * p.length / (4.0 * p.span)) / 3.0) / (p.length * speed) * corner / 2.0
    e = math.exp(-corner * dt)
    x.p = e * x.p + p.sigma * math.sqrt(variance * (1.0 - e * e)) * u.noise[3]

    cf, sf = math.cos(u.phi), math.sin(u.phi)
    ct, st = math.cos(u.theta), math.sin(u.theta)
    cp, sp = math.cos(u.psi), math.sin(u.psi)
    across, below = cf * vg - sf * wg, sf * vg + cf * wg  # in the horizontal plane's axes about the nose
    ahead = ct * ug + st * below
    x.north = cp * ahead - sp * across
    x.east = sp * ahead + cp * across
    x.down = -st * ug + ct * below


rollout = entry(step, STATE, INPUTS, PARAMS)


class Gusts:
    """The gusts of one flight: noise from its own generator, one step per tick, written to the aircraft."""

    DRAWS = 1000  # ticks of noise drawn at once

    def __init__(self, p: np.ndarray, dt: float, seed: int):
        """`p` PARAMS (1,); the same seed gives the same air."""
        self._rng = generator(seed, "gusts")
        self._noise, self._k = np.zeros((self.DRAWS, 4)), self.DRAWS
        self.x, self._u, self._p, self._dt = init(p), np.zeros((1, 1), INPUTS), p, dt
        self._in, self._out = self._u.view("f8").reshape(-1), self.x.view("f8")[:6]
        self._advance = rollout.bound(self.x, self._u, p, dt)

    def next(self, tas: float, phi: float, theta: float, psi: float) -> list[float]:
        """Return (north, east, down [m/s], p, q, r [rad/s]) of the next tick for an aircraft at `tas` [m/s]."""
        if self._k == self.DRAWS:
            self._rng.standard_normal(out=self._noise)
            self._k = 0
        self._in[:4] = self._noise[self._k]
        self._in[4:] = tas, phi, theta, psi
        self._k += 1
        self._advance()
        return self._out.tolist()

    def tell(self, tape: Any, how: Any, read: list, write: list) -> None:
        """Tell a tape that begins at tick 0 to read `read`, step and write to `write`, nodes in the order of `next` in
        JSBSim's units, by the addresses of `how` (cosim/flight/plant/crossing.py).
        """
        raw, put = np.zeros(4), np.zeros(6)
        tape.first(self._draw)
        tape.noise(np.arange(4), self._noise, self._in)
        tape.get(how.nodes(read), how.get, raw)
        tape.scale(raw, np.array([M_PER_FT, 1.0, 1.0, 1.0]), np.ones(4), self._in[4:])
        tape.advance(rollout, self.x, self._u, self._p, self._dt)
        tape.scale(self._out, np.ones(6), np.array([M_PER_FT] * 3 + [1.0] * 3), put)
        tape.put(how.nodes(write), how.put, put)

    def _draw(self, k):
        if k % self.DRAWS == 0:
            self._rng.standard_normal(out=self._noise)
