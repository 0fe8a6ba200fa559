"""Trim: steady flight by JSBSim's own search, then Newton to rounding; elevators at zero.

Level: unknowns alpha, stabiliser, throttle (all engines alike); residuals u', w' [m/s2] and q' [rad/s2] with theta =
alpha, no bank, and the pitch rate -V/R that keeps the attitude constant over the curved earth. A climb, a descent or a
turn, without sideslip, by Newton from level:

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
    elevator: float  # 0
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
    border: Border, stabilizer: float, throttle: float, *, elevator: float = 0.0, aileron: float = 0.0,
    rudder: float = 0.0,
) -> np.ndarray:  # fmt: skip
    """Return the input vector of a trim: angles [rad], throttle as a fraction."""
    out = np.zeros(len(border.inputs))
    for names, value in ((("da_l", "da_r"), aileron), (("dr",), rudder), (border.elevators, elevator),
                         (("stab",), stabilizer), (border.throttles, throttle)):  # fmt: skip
        out[border.column(names)] = value
    return out


def _newton(residual: Callable, x: NDArray, limited: Callable, most: int) -> NDArray:
    """Return the unknowns by Newton from x, each step `limited`, the throttle x[2] within its stops."""
    n = len(x)
    for _ in range(most):
        f = residual(x)
        if np.abs(f).max() < 1e-12:
            break
        J = np.column_stack([(residual(x + d) - residual(x - d)) / (2 * h) for h, d in zip(STEP, np.diag(STEP[:n]))])
        try:
            new = x + limited(solve(J, -f))
        except np.linalg.LinAlgError:
            break
        new[2] = min(max(new[2], 0.0), 1.0)
        if np.abs(new - x).max() < 1e-15:
            break
        x = new
    return x


def _trim(plant, x, t, **more):
    """Return the Trim of the unknowns x whose truth is `t`, and its residual."""
    alpha, stabilizer, throttle = (float(v) for v in x[:3])
    residual = float(max(abs(v) for v in (t.udot, t.vdot, t.wdot, t.pdot, t.qdot, t.rdot)))
    level: dict[str, Any] = {"theta": alpha, "surfaces": surfaces_at(plant.border, stabilizer, throttle)}
    return Trim(
        alpha=alpha, stabilizer=stabilizer, throttle=throttle, elevator=0.0, tas=plant.tas,
        altitude=plant.flight.altitude, q=float(t.q), nz=float(t.nz), residual=residual, **(level | more),
    )  # fmt: skip


def _level_truth(plant, x):
    """Return the truth of level flight at the unknowns x, in which the plant is then."""
    alpha, stabilizer, throttle = x
    h, tas = plant.flight.altitude, plant.tas
    plant.place(tas=tas, alpha=alpha, theta=alpha, altitude=h, q=-tas / (EARTH_MERIDIAN + h),
                surfaces=surfaces_at(plant.border, stabilizer, throttle))  # fmt: skip
    return plant.truth()[0]


def level(plant: Any) -> Trim:
    """Return the Trim of level flight at `plant.flight` and leave the plant in it; raise TrimError with the reason."""

    def residual(x):
        t = _level_truth(plant, x)
        return np.array([t.udot, t.wdot, t.qdot])

    def limited(step):
        return step * min(1.0, 0.05 / max(abs(step[0]), abs(step[1]), abs(step[2]) / 5, 1e-12))

    x = _newton(residual, np.array(plant.guess() or (math.radians(5.0), 0.0, 0.6)), limited, 25)
    t = _level_truth(plant, x)
    trim, limits, mach = _trim(plant, x, t), plant.aircraft.limits, t.mach
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
    _level_truth(plant, x)  # back from where the lift was looked for
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

    def wrong(said, **more):
        return TrimError(said, place=_place(plant), **more)

    if needs > has or trim.alpha > most:
        said = f"stall: {what} needs a lift coefficient of {needs:.2f}, the wing gives {has:.2f}"
        raise wrong(said, remedy=remedies[0])
    if trim.throttle >= 0.999:
        raise wrong(f"thrust: the engines cannot hold {what}", remedy=remedies[1])
    if trim.throttle <= 0.001:
        raise wrong(f"thrust: even idle thrust is too much for {what}", remedy=remedies[2])
    for name, angle in (("stabiliser", trim.stabilizer), ("aileron", trim.aileron), ("rudder", trim.rudder)):
        low, high = (math.degrees(v) for v in plant.aircraft.travels[name])
        if not low <= math.degrees(angle) <= high:
            said = f"{name}: {math.degrees(angle):.1f} deg needed for {what}"
            raise wrong(said, allowed=f"{low:.0f} to {high:.0f} deg")
    if not trim.residual <= 1e-8:  # or no number
        raise wrong(f"no steady flight found for {what}, residual {trim.residual:.1e}")


def lift_margin(plant: Any, n: float = 1.0) -> tuple[Any, ...]:
    """Return the lift coefficients that flight at load factor `n` needs and that the aircraft has, and the angle of
    attack [rad] of the latter; elevator and stabiliser at 0."""
    best, needs, most = 0.0, 0.0, 0.0
    for alpha in np.radians(np.arange(2.0, 25.0, 0.5)):
        t = _level_truth(plant, (alpha, 0.0, 0.0))
        force = t.nz * math.cos(alpha) + t.nx * math.sin(alpha)
        needs = t.mass * G0 / (t.qbar * plant.aircraft.wing_area)
        best, most = max((best, most), (force * needs, float(alpha)))
    return n * needs, best, most


def _words(gamma, bank, turn):
    """Return what is flown, in the scenario's units."""
    path = f"{'climb' if gamma > 0 else 'descent'} at {math.degrees(gamma):+.1f} deg" * bool(gamma)
    rate = f"turn of {math.degrees(turn or 0.0):.1f} deg/s" * bool(turn)
    turned = rate if bank is None else f"bank of {math.degrees(bank):.0f} deg"
    return " in ".join(f"a {part}" for part in (path, turned) if part) or "level flight"


def steady(plant: Any) -> Trim:
    """Return the Trim of the climb, descent or turn at `plant.flight` and leave the plant in it; raise TrimError with
    the reason."""
    f, tas, h = plant.flight, plant.tas, plant.flight.altitude
    gamma = f.gamma or 0.0
    if f.climb is not None:
        gamma = math.asin(min(max(f.climb / tas, -0.5), 0.5))

    def attitude(x):
        """Return (phi, turn, theta)."""
        phi, turn = (f.bank, x[5]) if f.bank is not None else (x[5], f.turn or 0.0)
        a, b, s = math.cos(x[0]), math.cos(phi) * math.sin(x[0]), math.sin(gamma)
        return phi, turn, math.atan2(a * b + s * math.sqrt(max(a * a - s * s + b * b, 0.0)), a * a - s * s)

    def surfaces(x):
        return surfaces_at(plant.border, x[1], x[2], aileron=x[3], rudder=x[4])

    def truth(x):
        phi, turn, theta = attitude(x)
        w = -tas * math.cos(gamma) / (EARTH_MERIDIAN + h)
        plant.place(
            tas=tas, alpha=x[0], theta=theta, phi=phi, altitude=h,
            p=-turn * math.sin(theta),
            q=turn * math.cos(theta) * math.sin(phi) + w * math.cos(phi),
            r=turn * math.cos(theta) * math.cos(phi) - w * math.sin(phi),
            surfaces=surfaces(x),
        )  # fmt: skip
        return plant.truth()[0]

    def residual(x):
        t = truth(x)
        return np.array([t.udot, t.vdot, t.wdot, t.pdot, t.qdot, t.rdot])

    start = level(plant)
    last = (f.turn or 0.0) * tas * math.cos(gamma) / G0
    last = math.atan(last) if f.bank is None else G0 * math.tan(f.bank) / (tas * math.cos(gamma))
    x = np.array([start.alpha, start.stabilizer, start.throttle, 0.0, 0.0, last])
    x = _newton(residual, x, lambda step: step / max(1.0, (np.abs(step) / MOST).max()), 40)
    t, (phi, turn, theta) = truth(x), attitude(x)
    trim = _trim(
        plant, x, t, theta=float(theta), gamma=gamma, phi=float(phi), p=float(t.p), r=float(t.r), turn=float(turn),
        aileron=float(x[3]), rudder=float(x[4]), surfaces=surfaces(x),
    )  # fmt: skip
    margin = lift_margin(plant, math.cos(gamma) / math.cos(phi))
    truth(x)  # back from where the lift was looked for
    remedies = "Fly faster, lower or lighter, or bank less", "Climb or bank less", "Descend less"
    _refuse(plant, trim, margin, _words(gamma, f.bank, f.turn), remedies)
    return trim
