"""Trim of a climb, a descent or a turn: steady in body axes, without sideslip, by Newton from level flight.

    unknowns   alpha, stabiliser, throttle, aileron, rudder, and the turn rate of a given bank, or its bank
    residuals  u', v', w' [m/s2], p', q', r' [rad/s2]
    attitude   tan(theta) = (a b + s sqrt(a^2 - s^2 + b^2)) / (a^2 - s^2)         rate-of-climb constraint, [Stevens]
               a = cos(alpha), b = cos(phi) sin(alpha), s = sin(gamma)
    rates      p = -turn sin(theta)
               q =  turn cos(theta) sin(phi) + w cos(phi)
               r =  turn cos(theta) cos(phi) - w sin(phi)

w = -V cos(gamma)/R turns the horizon along over the curved earth. A straight climb has no turn and the bank of some
tenths of a milliradian that the rotating earth asks for. [Stevens] Stevens and Lewis, Aircraft Control and Simulation.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actuators.constants import G0, M_PER_FT
from actuators.deterministic_linalg import solve
from cosim.errors import TrimError
from cosim.flight.plant.trim import EARTH_MERIDIAN, Trim, level, lift_margin, surfaces_at

STEP = np.array([1e-5, 1e-5, 1e-4, 1e-5, 1e-5, 1e-5])
MOST = np.array([0.05, 0.05, 0.25, 0.05, 0.05, 0.05])  # of one step of the search


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
        return " in a ".join(filter(None, (path, bank or rate))) or "level flight"


def steady(plant: Any, elevator: float = 0.0) -> Trim:
    """Return the Trim of the climb, descent or turn at `plant.flight`, elevators at `elevator` [rad], and leave the
    plant in it; raise TrimError with the reason.
    """
    f = plant.flight
    gamma = f.gamma or 0.0
    if f.climb is not None:
        gamma = math.asin(min(max(f.climb / plant.tas, -0.5), 0.5))
    path = _Path(plant, gamma, f.bank, f.turn or 0.0, elevator)
    start = level(plant, elevator)
    last = path.turn * plant.tas * math.cos(gamma) / G0
    last = math.atan(last) if f.bank is None else G0 * math.tan(f.bank) / (plant.tas * math.cos(gamma))
    x = _search(path, np.array([start.alpha, start.stabilizer, start.throttle, 0.0, 0.0, last]))
    t = path.place(x)
    residual = max(abs(v) for v in (t.udot, t.vdot, t.wdot, t.pdot, t.qdot, t.rdot))
    _check(path, x, residual)
    phi, turn, theta = path.attitude(x)
    alpha, stabilizer, throttle, aileron, rudder, _ = (float(v) for v in x)
    return Trim(
        alpha=alpha, stabilizer=stabilizer, throttle=throttle, elevator=elevator, theta=float(theta), tas=plant.tas,
        altitude=f.altitude, q=float(t.q), residual=float(residual), nz=float(t.nz), gamma=gamma, phi=float(phi),
        p=float(t.p), r=float(t.r), turn=float(turn), aileron=aileron, rudder=rudder, surfaces=path.surfaces(x),
    )  # fmt: skip


def _search(path, x):
    """Return the unknowns by Newton from x, the throttle within its stops."""
    for _ in range(40):
        f = path.residual(x)
        if np.abs(f).max() < 1e-12:
            break
        J = np.empty((6, 6))
        for i, d in enumerate(np.diag(STEP)):
            J[:, i] = (path.residual(x + d) - path.residual(x - d)) / (2 * STEP[i])
        try:
            step = solve(J, -f)
        except np.linalg.LinAlgError:
            break
        new = x + step / max(1.0, (np.abs(step) / MOST).max())
        new[2] = min(max(new[2], 0.0), 1.0)
        if np.abs(new - x).max() < 1e-15:
            break
        x = new
    return x


def _check(path, x, residual):
    """Raise TrimError with the reason why the aircraft cannot fly so."""
    plant, (alpha, stabilizer, throttle, aileron, rudder, _) = path.plant, x
    f, travels = plant.flight, plant.aircraft.travels
    place = f"{f.mass / 1e3:.0f} t, CG {f.cg * 100:.0f} %, {f.altitude / M_PER_FT:.0f} ft, {plant.tas:.1f} m/s TAS"
    phi, _, _ = path.attitude(x)
    n = math.cos(path.gamma) / math.cos(phi)
    needs, has, most = lift_margin(plant, n)
    path.place(x)  # back from where the lift was looked for
    if needs > has or alpha > most:
        said = f"stall: a {path} needs a lift coefficient of {needs:.2f}, the wing gives {has:.2f}"
        raise TrimError(said, place=place, remedy="Fly faster, lower or lighter, or bank less")
    if throttle >= 0.999:
        raise TrimError(f"thrust: the engines cannot hold a {path}", place=place, remedy="Climb or bank less")
    if throttle <= 0.001:
        raise TrimError(f"thrust: even idle thrust is too much for a {path}", place=place, remedy="Descend less")
    for name, angle in (("stabiliser", stabilizer), ("aileron", aileron), ("rudder", rudder)):
        low, high = (math.degrees(v) for v in travels[name])
        if not low <= math.degrees(angle) <= high:
            said = f"{name}: {math.degrees(angle):.1f} deg needed for a {path}"
            raise TrimError(said, place=place, allowed=f"{low:.0f} to {high:.0f} deg")
    if residual > 1e-8:
        raise TrimError(f"no steady {path} found, residual {residual:.1e}", place=place)
