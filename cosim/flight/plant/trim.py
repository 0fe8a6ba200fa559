"""Trim: steady flight by JSBSim's own search, then Newton to rounding.

Level: unknowns alpha, stabiliser, throttle (all engines alike); residuals u', w' [m/s2] and q' [rad/s2] with theta =
alpha, no bank, and the pitch rate -V/R that keeps the attitude constant over the curved earth. Elevators stand where
they are told, at zero unless said otherwise. A climb, a descent or a turn, without sideslip, by Newton from level:

    unknowns   alpha, stabiliser, throttle, aileron, rudder, and the turn rate of a given bank, or its bank
    residuals  u', v', w' [m/s2], p', q', r' [rad/s2]
    attitude   tan(theta) = (a b + s sqrt(a^2 - s^2 + b^2)) / (a^2 - s^2)         rate-of-climb constraint, [Stevens]
               a = cos(alpha), b = cos(phi) sin(alpha), s = sin(gamma)
    rates      p = -turn sin(theta)
               q =  turn cos(theta) sin(phi) + w cos(phi)
               r =  turn cos(theta) cos(phi) - w sin(phi)

w = -V cos(gamma)/R turns the horizon along. A straight climb has no turn and the bank of some tenths of a milliradian
that the rotating earth asks for. [Stevens] Stevens and Lewis, Aircraft Control and Simulation.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actuators.constants import G0, M_PER_FT
from actuators.deterministic_linalg import solve
from cosim.errors import TrimError
from cosim.flight.plant.jsbsim_signals import Border

EARTH_MERIDIAN = 6335439.3  # radius of curvature of the meridian at the equator, WGS84 [m]
STEP = np.array([1e-5, 1e-5, 1e-4, 1e-5, 1e-5, 1e-5])
MOST = np.array([0.05, 0.05, 0.25, 0.05, 0.05, 0.05])  # of one step of the search


@dataclass(frozen=True)
class Trim:
    """A trimmed flight point; SI, rad."""

    alpha: float
    stabilizer: float
    throttle: float
    elevator: float
    theta: float
    tas: float
    altitude: float
    q: float  # -V/R
    residual: float  # largest of |u'|, |v'|, |w'| [m/s2], |p'|, |q'|, |r'| [rad/s2]
    nz: float  # load factor in this flight, not exactly 1: rotating earth, weight at standard gravity
    surfaces: np.ndarray  # in the order of the border's inputs
    gamma: float = 0.0  # climb +
    phi: float = 0.0  # right +
    p: float = 0.0
    r: float = 0.0
    turn: float = 0.0  # rate of the heading, right +
    aileron: float = 0.0  # + rolls right
    rudder: float = 0.0  # + yaws left

    @property
    def level(self) -> bool:
        """Tell whether it is neither a climb or a descent nor a turn."""
        return self.gamma == 0.0 and self.phi == 0.0

    @property
    def climb(self) -> float:
        """Return the vertical speed [m/s]."""
        return self.tas * math.sin(self.gamma)


def surfaces_at(
    border: Border, stabilizer: float, throttle: float, elevator: float, aileron: float = 0.0, rudder: float = 0.0
) -> np.ndarray:
    """Return the input vector of a trim: angles [rad], throttle as a fraction."""
    out = np.zeros(len(border.inputs))
    out[border.column(("da_l", "da_r"))] = aileron
    out[border.column(("dr",))] = rudder
    out[border.column(border.elevators)] = elevator
    out[border.column(("stab",))] = stabilizer
    out[border.column(border.throttles)] = throttle
    return out


def _residual(plant, x, elevator, full=False):
    alpha, stabilizer, throttle = x
    h, tas = plant.flight.altitude, plant.tas
    plant.place(tas=tas, alpha=alpha, theta=alpha, altitude=h, q=-tas / (EARTH_MERIDIAN + h),
                surfaces=surfaces_at(plant.border, stabilizer, throttle, elevator))  # fmt: skip
    t = plant.truth()[0]
    return t if full else np.array([t.udot, t.wdot, t.qdot])


def _newton(residual: Callable, x: NDArray, limited: Callable, most: int) -> NDArray:
    """Return the unknowns by Newton from x, each step `limited`, the throttle x[2] within its stops."""
    n = len(x)
    for _ in range(most):
        f = residual(x)
        if np.abs(f).max() < 1e-12:
            break
        J = np.empty((n, n))
        for i, d in enumerate(np.diag(STEP[:n])):
            J[:, i] = (residual(x + d) - residual(x - d)) / (2 * STEP[i])
        try:
            new = x + limited(solve(J, -f))
        except np.linalg.LinAlgError:
            break
        new[2] = min(max(new[2], 0.0), 1.0)
        if np.abs(new - x).max() < 1e-15:
            break
        x = new
    return x


def _trim(plant, elevator, x, t, **more):
    """Return the Trim of the unknowns x whose truth is `t`, and its residual."""
    alpha, stabilizer, throttle = (float(v) for v in x[:3])
    residual = float(max(abs(v) for v in (t.udot, t.vdot, t.wdot, t.pdot, t.qdot, t.rdot)))
    return Trim(
        alpha=alpha, stabilizer=stabilizer, throttle=throttle, elevator=elevator, tas=plant.tas,
        altitude=plant.flight.altitude, q=float(t.q), nz=float(t.nz), residual=residual,
        **{"theta": alpha, "surfaces": surfaces_at(plant.border, stabilizer, throttle, elevator), **more},
    )  # fmt: skip


def level(plant: Any, elevator: float = 0.0) -> Trim:
    """Return the Trim of level flight at `plant.flight` and leave the plant in it; raise TrimError with the reason."""

    def limited(step):
        return step * min(1.0, 0.05 / max(abs(step[0]), abs(step[1]), abs(step[2]) / 5, 1e-12))

    start = np.array(plant.guess() or (math.radians(5.0), 0.0, 0.6))
    x = _newton(lambda x: _residual(plant, x, elevator), start, limited, 25)
    t = _residual(plant, x, elevator, full=True)
    trim, limits, mach = _trim(plant, elevator, x, t), plant.aircraft.limits, t.mach
    least, most_mach = limits.mach
    if not least - 1e-6 <= mach <= most_mach + 1e-6:  # JSBSim's own rounding of the speed
        raise TrimError(
            f"speed: Mach {mach:.2f} is beyond the aerodynamic data", place=_place(plant),
            allowed=f"{least:g} to {most_mach:g}",
            remedy="Fly slower or lower" if mach > most_mach else "Fly faster or higher",
        )  # fmt: skip
    low, high = plant.aircraft.travels["stabiliser"]
    solved = trim.residual < 1e-8 and low <= trim.stabilizer <= high and 0.0 <= trim.throttle <= 1.0
    if solved and trim.alpha < math.radians(limits.alpha_surely_flies_deg):
        return trim
    margin = lift_margin(plant)
    _residual(plant, x, elevator)  # back from where the lift was looked for
    if not solved or trim.alpha > margin[2]:  # a fall at a huge angle of attack is an equilibrium too
        remedies = "Fly faster, lower or lighter", "Fly lower, lighter or at another speed", "Fly faster or higher"
        _refuse(plant, trim, margin, "level flight", remedies)
    return trim


def _place(plant):
    f = plant.flight
    return f"{f.mass / 1e3:.0f} t, CG {f.cg * 100:.0f} %, {f.altitude / M_PER_FT:.0f} ft, {plant.tas:.1f} m/s TAS"


def _refuse(plant, trim, margin, what, remedies):
    """Raise TrimError with the reason why the aircraft cannot fly `what`, if there is one.

    `margin` is what `lift_margin` gives, `remedies` are those of a stall, of too little thrust and of too much.
    """
    needs, has, most = margin
    if needs > has or trim.alpha > most:
        said = f"stall: {what} needs a lift coefficient of {needs:.2f}, the wing gives {has:.2f}"
        raise TrimError(said, place=_place(plant), remedy=remedies[0])
    if trim.throttle >= 0.999:
        raise TrimError(f"thrust: the engines cannot hold {what}", place=_place(plant), remedy=remedies[1])
    if trim.throttle <= 0.001:
        said = f"thrust: even idle thrust is too much for {what}"
        raise TrimError(said, place=_place(plant), remedy=remedies[2])
    for name, angle in (("stabiliser", trim.stabilizer), ("aileron", trim.aileron), ("rudder", trim.rudder)):
        low, high = (math.degrees(v) for v in plant.aircraft.travels[name])
        if not low <= math.degrees(angle) <= high:
            said = f"{name}: {math.degrees(angle):.1f} deg needed for {what}"
            raise TrimError(said, place=_place(plant), allowed=f"{low:.0f} to {high:.0f} deg")
    if not trim.residual <= 1e-8:  # or no number
        raise TrimError(f"no steady flight found for {what}, residual {trim.residual:.1e}", place=_place(plant))


def lift_margin(plant: Any, n: float = 1.0) -> tuple[Any, ...]:
    """Return the lift coefficients that flight at load factor `n` needs and that the aircraft has, and the angle of
    attack [rad] of the latter; elevator and stabiliser at 0."""
    best, needs, most = 0.0, 0.0, 0.0
    for alpha in np.radians(np.arange(2.0, 25.0, 0.5)):
        t = _residual(plant, (alpha, 0.0, 0.0), 0.0, full=True)
        force = t.nz * math.cos(alpha) + t.nx * math.sin(alpha)
        area = plant.aircraft.wing_area
        needs = t.mass * G0 / (t.qbar * area)
        best, most = max((best, most), (force * needs, float(alpha)))
    return n * needs, best, most


@dataclass(frozen=True)
class _Path:
    """What is given of a steady flight."""

    plant: Any
    gamma: float
    bank: float | None  # None: the turn rate is given
    turn: float
    elevator: float

    def attitude(self, x: NDArray) -> tuple[float, float, float]:
        """Return (phi, turn, theta) at the unknowns x."""
        phi, turn = (self.bank, x[5]) if self.bank is not None else (x[5], self.turn)
        a, b, s = math.cos(x[0]), math.cos(phi) * math.sin(x[0]), math.sin(self.gamma)
        return phi, turn, math.atan2(a * b + s * math.sqrt(max(a * a - s * s + b * b, 0.0)), a * a - s * s)

    def place(self, x: NDArray) -> Any:
        """Put the plant there and return its truth."""
        plant, (phi, turn, theta) = self.plant, self.attitude(x)
        h, tas = plant.flight.altitude, plant.tas
        w = -tas * math.cos(self.gamma) / (EARTH_MERIDIAN + h)
        plant.place(
            tas=tas, alpha=x[0], theta=theta, phi=phi, altitude=h,
            p=-turn * math.sin(theta),
            q=turn * math.cos(theta) * math.sin(phi) + w * math.cos(phi),
            r=turn * math.cos(theta) * math.cos(phi) - w * math.sin(phi),
            surfaces=self.surfaces(x),
        )  # fmt: skip
        return plant.truth()[0]

    def surfaces(self, x: NDArray) -> NDArray:
        """Return the plant's input vector."""
        _, stabilizer, throttle, aileron, rudder, _ = (float(v) for v in x)
        return surfaces_at(self.plant.border, stabilizer, throttle, self.elevator, aileron, rudder)

    def residual(self, x: NDArray) -> NDArray:
        """Return (u', v', w', p', q', r')."""
        t = self.place(x)
        return np.array([t.udot, t.vdot, t.wdot, t.pdot, t.qdot, t.rdot])

    def __str__(self) -> str:
        """Say what is flown, in the scenario's units."""
        path = f"{'climb' if self.gamma > 0 else 'descent'} at {math.degrees(self.gamma):+.1f} deg" * bool(self.gamma)
        bank = "" if self.bank is None else f"bank of {math.degrees(self.bank):.0f} deg"
        rate = f"turn of {math.degrees(self.turn):.1f} deg/s" * bool(self.turn)
        return " in ".join(f"a {part}" for part in (path, bank or rate) if part) or "level flight"


def steady(plant: Any, elevator: float = 0.0) -> Trim:
    """Return the Trim of the climb, descent or turn at `plant.flight`, elevators at `elevator` [rad], and leave the
    plant in it; raise TrimError with the reason."""
    f = plant.flight
    gamma = f.gamma or 0.0
    if f.climb is not None:
        gamma = math.asin(min(max(f.climb / plant.tas, -0.5), 0.5))
    path = _Path(plant, gamma, f.bank, f.turn or 0.0, elevator)
    start = level(plant, elevator)
    last = path.turn * plant.tas * math.cos(gamma) / G0
    last = math.atan(last) if f.bank is None else G0 * math.tan(f.bank) / (plant.tas * math.cos(gamma))
    x = np.array([start.alpha, start.stabilizer, start.throttle, 0.0, 0.0, last])
    x = _newton(path.residual, x, lambda step: step / max(1.0, (np.abs(step) / MOST).max()), 40)
    t, (phi, turn, theta) = path.place(x), path.attitude(x)
    trim = _trim(
        plant, elevator, x, t, theta=float(theta), gamma=gamma, phi=float(phi), p=float(t.p), r=float(t.r),
        turn=float(turn), aileron=float(x[3]), rudder=float(x[4]), surfaces=path.surfaces(x),
    )  # fmt: skip
    margin = lift_margin(plant, math.cos(gamma) / math.cos(phi))
    path.place(x)  # back from where the lift was looked for
    _refuse(plant, trim, margin, str(path), ("Fly faster, lower or lighter, or bank less", "Climb or bank less",
                                             "Descend less"))  # fmt: skip
    return trim
