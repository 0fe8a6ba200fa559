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

import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from actuators.constants import G0, M_PER_FT
from actuators.deterministic_linalg import solve
from cosim.errors import TrimError

EARTH_MERIDIAN = 6335439.3  # radius of curvature of the meridian at the equator, WGS84 [m]
STEP = np.array([1e-5, 1e-5, 1e-4, 1e-5, 1e-5, 1e-5])
MOST = np.array([0.05, 0.05, 0.25, 0.05, 0.05, 0.05])  # of one step of the search
STEPS = 40
LEVEL, STEADY = ("udot", "wdot", "qdot"), ("udot", "vdot", "wdot", "pdot", "qdot", "rdot")  # what is brought to 0


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


def trim(plant: Any) -> Trim:
    """Return the Trim of `plant.flight` and leave the plant in it; raise TrimError with the reason where there is none.

    A climb, a descent or a turn begins with level flight.
    """
    f = plant.flight
    found = _solved(plant, np.array(plant.guess() or (math.radians(5.0), 0.0, 0.6)), LEVEL, 0.0)
    if f == f.level:
        return found
    gamma = f.gamma or 0.0
    if f.climb is not None:
        gamma = math.asin(min(max(f.climb / plant.tas, -0.5), 0.5))
    if f.bank is None:
        last = math.atan((f.turn or 0.0) * plant.tas * math.cos(gamma) / G0)
    else:
        last = G0 * math.tan(f.bank) / (plant.tas * math.cos(gamma))
    return _solved(plant, np.array([found.alpha, found.stabilizer, found.throttle, 0.0, 0.0, last]), STEADY, gamma)


def _solved(plant, x, names, gamma):
    """Return the Trim that Newton finds from the unknowns x; raises TrimError where it cannot be flown."""
    x = _newton(plant, x, names, gamma)
    t, surfaces, (phi, turn, theta) = _flown(plant, x, gamma)
    alpha, stabilizer, throttle, aileron, rudder = (float(v) for v in (*x, 0.0, 0.0)[:5])
    found = Trim(
        alpha=alpha, stabilizer=stabilizer, throttle=throttle, elevator=0.0, theta=float(theta), tas=plant.tas,
        altitude=plant.flight.altitude, q=float(t.q), residual=float(max(abs(t[name]) for name in STEADY)),
        nz=float(t.nz), surfaces=surfaces, gamma=gamma, phi=float(phi), p=float(t.p), r=float(t.r), turn=float(turn),
        aileron=aileron, rudder=rudder,
    )  # fmt: skip
    _refuse(plant, found, x, t.mach)
    return found


def _refuse(plant, found, x, mach):
    """Raise TrimError with the reason why the aircraft cannot fly a trim of the unknowns x, if there is one."""
    wrong, limits = functools.partial(TrimError, place=plant.flight.words), plant.aircraft.limits
    least, most = limits.mach
    if not least - 1e-6 <= mach <= most + 1e-6:  # JSBSim's own rounding of the speed
        remedy = "Fly slower or lower" if mach > most else "Fly faster or higher"
        said = f"speed: Mach {mach:.2f} is beyond the aerodynamic data"
        raise wrong(said, allowed=f"{least:g} to {most:g}", remedy=remedy)
    level = len(x) == len(LEVEL)
    what = "level flight" if level else _words(found.gamma, plant.flight)
    beyond = _beyond(plant, found, what)
    if level and not beyond and found.alpha < math.radians(limits.alpha_surely_flies_deg):
        return
    needs, has, stalls = lift_margin(plant, math.cos(found.gamma) / math.cos(found.phi))
    _flown(plant, x, found.gamma)  # back from where the lift was looked for
    if found.alpha > stalls or (beyond and needs > has):  # an equilibrium while it falls, too
        said = f"stall: {what} needs a lift coefficient of {needs:.2f}, the wing gives {has:.2f}"
        raise wrong(said, remedy="Fly faster, lower or lighter" + ", or bank less" * (not level))
    if beyond:
        said, about = beyond
        raise wrong(said, **about)


def _newton(plant, x, names, gamma):
    """Return the unknowns by Newton from x, the throttle x[2] within its stops."""

    def residual(x):
        t = _flown(plant, x, gamma)[0]
        return np.array([t[name] for name in names])

    n = len(x)
    for _ in range(STEPS):
        f = residual(x)
        if np.abs(f).max() < 1e-12:
            break
        J = np.column_stack([(residual(x + d) - residual(x - d)) / (2 * h) for h, d in zip(STEP, np.diag(STEP[:n]))])
        try:
            step = solve(J, -f)
        except np.linalg.LinAlgError:
            break
        new = x + step / max(1.0, (np.abs(step) / MOST[:n]).max())
        new[2] = min(max(new[2], 0.0), 1.0)
        if np.abs(new - x).max() < 1e-15:
            break
        x = new
    return x


def _flown(plant, x, gamma):
    """Put the plant into the unknowns x and return (truth, surfaces, (phi, turn, theta)); level flight has three."""
    f, tas, h = plant.flight, plant.tas, plant.flight.altitude
    alpha, stabilizer, throttle, aileron, rudder, last = (*x, 0.0, 0.0, 0.0)[:6]
    phi, turn, theta = 0.0, 0.0, alpha
    if len(x) > len(LEVEL):
        phi, turn = (f.bank, last) if f.bank is not None else (last, f.turn or 0.0)
        a, b, s = math.cos(alpha), math.cos(phi) * math.sin(alpha), math.sin(gamma)
        theta = math.atan2(a * b + s * math.sqrt(max(a * a - s * s + b * b, 0.0)), a * a - s * s)
    border, surfaces = plant.border, np.zeros(len(plant.border.inputs))
    for names, value in ((("da_l", "da_r"), aileron), (("dr",), rudder), (("stab",), stabilizer),
                         (border.throttles, throttle)):  # fmt: skip
        surfaces[border.column(names)] = value
    w = -tas * math.cos(gamma) / (EARTH_MERIDIAN + h)
    plant.place(
        tas=tas, alpha=alpha, theta=theta, phi=phi, altitude=h,
        p=0.0 - turn * math.sin(theta),
        q=turn * math.cos(theta) * math.sin(phi) + w * math.cos(phi),
        r=turn * math.cos(theta) * math.cos(phi) - w * math.sin(phi),
        surfaces=surfaces,
    )  # fmt: skip
    return plant.truth()[0], surfaces, (phi, turn, theta)


def _beyond(plant, found, what):
    """Return what a trim needs that the aircraft has not, (text, remedy or range); None where nothing is wrong."""
    more = "Fly lower, lighter or at another speed" if found.level else "Climb or bank less"
    less = "Fly faster or higher" if found.level else "Descend less"
    found_at = {"stabiliser": found.stabilizer, "aileron": found.aileron, "rudder": found.rudder}
    degrees = {name: (math.degrees(angle), *map(math.degrees, plant.aircraft.travels[name]))
               for name, angle in found_at.items()}  # fmt: skip
    reasons = [
        (found.throttle >= 0.999, f"thrust: the engines cannot hold {what}", {"remedy": more}),
        (found.throttle <= 0.001, f"thrust: even idle thrust is too much for {what}", {"remedy": less}),
        *((not low <= own <= high, f"{name}: {own:.1f} deg needed for {what}",
           {"allowed": f"{low:.0f} to {high:.0f} deg"}) for name, (own, low, high) in degrees.items()),
        (not found.residual <= 1e-8, f"no steady flight found for {what}, residual {found.residual:.1e}", {}),
    ]  # fmt: skip
    return next(((said, about) for wrong, said, about in reasons if wrong), None)


def lift_margin(plant: Any, n: float = 1.0) -> tuple[Any, ...]:
    """Return the lift coefficients that flight at load factor `n` needs and that the aircraft has, and the angle of
    attack [rad] of the latter; elevator and stabiliser at 0."""
    best, needs, most = 0.0, 0.0, 0.0
    for alpha in np.radians(np.arange(2.0, 25.0, 0.5)):
        t = _flown(plant, (alpha, 0.0, 0.0), 0.0)[0]
        force = t.nz * math.cos(alpha) + t.nx * math.sin(alpha)
        needs = t.mass * G0 / (t.qbar * (plant.aircraft.geometry.wing_area_ft2 * M_PER_FT**2))
        best, most = max((best, most), (force * needs, float(alpha)))
    return n * needs, best, most


def _words(gamma, flight):
    """Return what is flown, in the scenario's units."""
    path = f"{'climb' if gamma > 0 else 'descent'} at {math.degrees(gamma):+.1f} deg" * bool(gamma)
    rate = f"turn of {math.degrees(flight.turn or 0.0):.1f} deg/s" * bool(flight.turn)
    turned = rate if flight.bank is None else f"bank of {math.degrees(flight.bank):.0f} deg"
    return " in ".join(f"a {part}" for part in (path, turned) if part)
