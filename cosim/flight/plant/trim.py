"""Trim: steady flight by JSBSim's own search, then Newton to rounding.

Level: unknowns alpha, stabiliser, throttle (all engines alike); residuals u', w' [m/s2] and q' [rad/s2] with theta =
alpha, no bank, and the pitch rate -V/R that keeps the attitude constant over the curved earth. Elevators stand where
they are told, at zero unless said otherwise. A climb, a descent or a turn has six: ailerons, rudder and the turn rate
of a given bank, or the bank of a given turn rate, beside them, without sideslip; `cosim.flight.plant.steady` has it.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from actuators.constants import G0, M_PER_FT
from actuators.deterministic_linalg import solve
from cosim.errors import TrimError
from cosim.flight.plant.jsbsim_signals import Border

EARTH_MERIDIAN = 6335439.3  # radius of curvature of the meridian at the equator, WGS84 [m]
STEP = (1e-5, 1e-5, 1e-4)


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
    plant.place(
        tas=tas,
        alpha=alpha,
        theta=alpha,
        altitude=h,
        q=-tas / (EARTH_MERIDIAN + h),
        surfaces=surfaces_at(plant.border, stabilizer, throttle, elevator),
    )
    t = plant.truth()[0]
    return t if full else np.array([t.udot, t.wdot, t.qdot])


def level(plant: Any, elevator: float = 0.0) -> Trim:
    """Return the Trim of level flight at `plant.flight` and leave the plant in it; raise TrimError with the reason."""
    x = np.array(plant.guess() or (math.radians(5.0), 0.0, 0.6))
    for _ in range(25):
        f = _residual(plant, x, elevator)
        if np.abs(f).max() < 1e-12:
            break
        J = np.empty((3, 3))
        for i, d in enumerate(np.diag(STEP)):
            J[:, i] = (_residual(plant, x + d, elevator) - _residual(plant, x - d, elevator)) / (2 * STEP[i])
        try:
            step = solve(J, -f)
        except np.linalg.LinAlgError:
            break
        step *= min(1.0, 0.05 / max(abs(step[0]), abs(step[1]), abs(step[2]) / 5, 1e-12))
        new = x + step
        new[2] = min(max(new[2], 0.0), 1.0)
        if np.abs(new - x).max() < 1e-15:
            break
        x = new
    t = _residual(plant, x, elevator, full=True)
    residual = max(abs(v) for v in (t.udot, t.vdot, t.wdot, t.pdot, t.qdot, t.rdot))
    _check(plant, x, elevator, residual)
    alpha, stabilizer, throttle = (float(v) for v in x)
    return Trim(
        alpha=alpha, stabilizer=stabilizer, throttle=throttle, elevator=elevator, theta=alpha, tas=plant.tas,
        altitude=plant.flight.altitude, q=float(t.q), residual=float(residual), nz=float(t.nz),
        surfaces=surfaces_at(plant.border, stabilizer, throttle, elevator),
    )  # fmt: skip


def _check(plant, x, elevator, residual):
    alpha, stabilizer, throttle = x
    f = plant.flight
    place = f"{f.mass / 1e3:.0f} t, CG {f.cg * 100:.0f} %, {f.altitude / M_PER_FT:.0f} ft, {plant.tas:.1f} m/s TAS"
    low, high = plant.aircraft.travels["stabiliser"]
    least, most_mach = plant.aircraft.limits.mach
    mach = plant.truth()[0].mach
    if not least - 1e-6 <= mach <= most_mach + 1e-6:  # JSBSim's own rounding of the speed
        raise TrimError(
            f"speed: Mach {mach:.2f} is beyond the aerodynamic data",
            place=place,
            allowed=f"{least:g} to {most_mach:g}",
            remedy="Fly slower or lower" if mach > most_mach else "Fly faster or higher",
        )
    solved = residual < 1e-8 and low <= stabilizer <= high and 0.0 <= throttle <= 1.0
    if solved and alpha < math.radians(plant.aircraft.limits.alpha_surely_flies_deg):
        return
    needs, has, most = lift_margin(plant)
    if solved and alpha <= most:
        _residual(plant, x, elevator)  # back from where the lift was looked for
        return
    if needs > has or alpha > most:  # a fall at a huge angle of attack is an equilibrium too
        raise TrimError(
            f"stall: level flight needs a lift coefficient of {needs:.2f}, the wing gives {has:.2f}",
            place=place,
            remedy="Fly faster, lower or lighter",
        )
    if throttle >= 0.999:
        raise TrimError(
            "thrust: the engines cannot hold this speed and altitude",
            place=place,
            remedy="Fly lower, lighter or at another speed",
        )
    if throttle <= 0.001:
        raise TrimError(
            "thrust: even idle thrust is too much for level flight", place=place, remedy="Fly faster or higher"
        )
    if not low <= stabilizer <= high:
        raise TrimError(
            f"stabiliser: {math.degrees(stabilizer):.1f} deg needed",
            place=place,
            allowed=f"{math.degrees(low):.0f} to {math.degrees(high):.0f} deg",
        )
    raise TrimError(f"no steady level flight found, residual {residual:.1e}", place=place)


def lift_margin(plant: Any, n: float = 1.0) -> tuple[Any, ...]:
    """Return the lift coefficients that flight at load factor `n` needs and that the aircraft has, and the angle of
    attack [rad] of the latter; elevator and stabiliser at 0.
    """
    best, needs, most = 0.0, 0.0, 0.0
    for alpha in np.radians(np.arange(2.0, 25.0, 0.5)):
        t = _residual(plant, (alpha, 0.0, 0.0), 0.0, full=True)
        force = t.nz * math.cos(alpha) + t.nx * math.sin(alpha)
        area = plant.aircraft.wing_area
        needs = t.mass * G0 / (t.qbar * area)
        best, most = max((best, most), (force * needs, float(alpha)))
    return n * needs, best, most
