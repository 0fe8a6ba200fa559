"""A flight point: mass, CG, altitude, speed, and what is uncertain about it; how mass and CG are loaded."""

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any

from actuators.constants import G0, M_PER_FT, M_S_PER_KT, N_PER_LBF
from cosim.scenario import Scenario
from cosim.scenario.aircraft import DEFAULT, Aircraft, load_aircraft


@dataclass(frozen=True)
class FlightPoint:
    """One flight point and what is uncertain about it; SI, `speed` in m/s for "cas" and "tas", a number for "mach"."""

    mass: float = 200e3  # [kg]
    cg: float = 0.30  # share of the mean aerodynamic chord
    altitude: float = 6096.0  # [m]
    speed_kind: str = "cas"  # "cas", "tas" or "mach"
    speed: float = 290.0 * M_S_PER_KT  # [m/s], or the Mach number
    multipliers: dict = field(default_factory=dict)  # coefficient -> factor, e.g. {"Cm_alpha": 0.9}
    turbulence: str = "none"  # none, light, moderate or severe
    changes: tuple[tuple[float, str, float], ...] = ()  # of the turbulence: (start [s], word, time it takes [s])
    wind: tuple[float, float] = (0.0, 0.0)  # steady, to north and east, at this altitude [m/s]
    shear: tuple[float, float] = (0.0, 0.0)  # its growth with altitude [1/s]
    gusts: tuple[tuple[float, str, float, float, str], ...] = ()  # as cosim/flight/plant/gusts.py takes them
    seed: int = 0  # of the turbulence
    aircraft: str = DEFAULT  # a bundled name or a folder
    climb: float | None = None  # vertical speed [m/s], or
    gamma: float | None = None  # angle of the path [rad]; up +
    bank: float | None = None  # right + [rad], or
    turn: float | None = None  # rate of the heading [rad/s]

    @property
    def level(self) -> "FlightPoint":
        """Return the same point in level flight."""
        return dataclasses.replace(self, climb=None, gamma=None, bank=None, turn=None)

    @property
    def calm(self) -> "FlightPoint":
        """Return the same point in air that does not move, for what no weather changes: trim, linear model, design."""
        none = (0.0, 0.0)
        return dataclasses.replace(self, turbulence="none", changes=(), wind=none, shear=none, gusts=(), seed=0)

    @property
    def words(self) -> str:
        """Return the point as a scenario says it: "200 t, CG 30 %, 20,000 ft, 290 kt"."""
        kt = f"{self.speed / M_S_PER_KT:.0f} kt{' TAS' * (self.speed_kind == 'tas')}"
        speed = f"Mach {self.speed:.2f}" if self.speed_kind == "mach" else kt
        return f"{self.mass / 1e3:.0f} t, CG {self.cg * 100:.0f} %, {self.altitude / M_PER_FT:,.0f} ft, {speed}"

    @property
    def record(self) -> Aircraft:
        """Return the record of the aircraft that flies there."""
        return load_aircraft(self.aircraft)

    @classmethod
    def at(
        cls, mass_t: float, cg_pct: Any, altitude_ft: float, *, cas_kt: float | None = None,
        mach: float | None = None, tas_kt: Any = None, **rest: Any,
    ) -> Any:  # fmt: skip
        """Build a flight point from the units of the scenario file; exactly one speed must be given (ValueError)."""
        given = [(k, v) for k, v in (("cas", cas_kt), ("mach", mach), ("tas", tas_kt)) if v is not None]
        if len(given) != 1:
            raise ValueError("give exactly one of cas_kt, mach, tas_kt")
        kind, value = given[0]
        return cls(
            mass_t * 1e3, cg_pct / 100.0, altitude_ft * M_PER_FT, kind,
            value if kind == "mach" else value * M_S_PER_KT, **rest,
        )

    @classmethod
    def of(cls, scenario: Scenario) -> "FlightPoint":
        """Return the flight point of `scenario`, with its coefficients' multipliers, air and seed."""
        f = scenario.flight
        return cls.at(
            f.mass_t, f.cg_pct, f.altitude_ft, cas_kt=f.cas_kt, mach=f.mach, tas_kt=f.tas_kt,
            multipliers=dict(scenario.tolerances.aero), turbulence=f.turbulence, changes=f.changes, wind=f.wind,
            shear=f.shear, gusts=f.discrete, seed=scenario.seed, aircraft=f.aircraft,
            climb=f.climb_fpm and f.climb_fpm * M_PER_FT / 60.0, gamma=f.gamma_deg and math.radians(f.gamma_deg),
            bank=f.bank_deg and math.radians(f.bank_deg), turn=f.turn_deg_s and math.radians(f.turn_deg_s),
        )  # fmt: skip


# The six points of the papers, by a scenario's keys: they belong to the transport
SIX = load_aircraft(DEFAULT).points
POINTS = {name: FlightPoint.at(**point) for name, point in SIX.items()}


def loading(aircraft: Aircraft, mass: float, cg: float) -> dict[str, float]:
    """Return {property: value} of point masses and tank for `mass` [kg], `cg` [fraction], constant radii of gyration.

    Six equal masses stand in pairs around the centroid of the load: (+-X, 0, +-Zx), (0, +-Y, 0), (0, 0, +-Z). With w
    each and inertia J of the load about its centroid, 2 w X^2 = (Jyy + Jzz - Jxx) / 2 and so on, 2 w X Zx = Jxz; J is m
    k^2 less that of the empty aircraft less the distance between the two centroids. Raises ValueError outside the
    aircraft's mass and CG.
    """
    allowed, geometry = aircraft.mass, aircraft.geometry
    (low, high), (fore, aft) = allowed.mass_t, allowed.cg_pct
    if not low <= mass / 1e3 <= high:
        raise ValueError(f"mass {mass / 1e3:.1f} t; allowed {low:.0f} to {high:.0f} t")
    if not fore / 100.0 <= cg <= aft / 100.0:
        raise ValueError(f"CG {cg * 100:.1f} %; allowed {fore:.0f} to {aft:.0f} %")
    empty, fuel = allowed.empty_t * 1e3, allowed.fuel_t * 1e3
    load = mass - empty
    # centroid of the load aft of the reference [m]
    offset = (cg - geometry.reference_pct / 100.0) * (12.0 * geometry.chord_ft) * 0.0254 * mass / load
    apart = empty * load / mass * offset**2
    J = {k: load * v for k, v in allowed.gyration2_m2}
    w = (load - fuel) / 6.0
    try:
        X = math.sqrt(((J["yy"] + J["zz"] - J["xx"]) / 2 - apart) / (2 * w))
        Y = math.sqrt((J["xx"] + J["zz"] - J["yy"]) / 2 / (2 * w))
        Zx = J["xz"] / (2 * w * X)
        Z = math.sqrt((J["xx"] + J["yy"] - J["zz"]) / 2 / (2 * w) - Zx**2)
    except (ValueError, ZeroDivisionError):
        said = "two of xx, yy, zz must exceed the third, xz be small and the CG near geometry.reference_pct"
        raise ValueError(f"no load has the radii of gyration of mass.gyration2_m2: {said}") from None
    x0 = geometry.station_in + offset / 0.0254
    out = {"propulsion/tank/contents-lbs": fuel * G0 / N_PER_LBF, "propulsion/tank/x-position": x0}
    # forward of the centroid is low, aft is high: a positive product of inertia in body axes
    for i, (x, y, z) in enumerate([(-X, 0, -Zx), (X, 0, Zx), (0, -Y, 0), (0, Y, 0), (0, 0, -Z), (0, 0, Z)]):
        out[f"inertia/pointmass-weight-lbs[{i}]"] = w * G0 / N_PER_LBF
        for axis, value in zip("XYZ", (x0 + x / 0.0254, y / 0.0254, z / 0.0254)):
            out[f"inertia/pointmass-location-{axis}-inches[{i}]"] = value
    return out
