"""A flight point: mass, CG, altitude, speed, and what is uncertain about it; how mass and CG are loaded."""

import math
from dataclasses import dataclass, field

from cosim.flight.plant.border import CHORD_IN, FT, G0, KT, LB, QUARTER_IN

EMPTY_KG, FUEL_KG = 160000.0, 10000.0
# inertia over mass [m2], CR-2144 at 636,636 lb
GYRATION2 = {"xx": 85.4507, "yy": 155.4077, "zz": 233.3463, "xz": 4.55451}
# [kg], fraction; below 180 t the point masses would move too far out
MASS_RANGE, CG_RANGE = (180e3, 405e3), (0.20, 0.40)


@dataclass(frozen=True)
class FlightPoint:
    """One flight point and what is uncertain about it; SI, `speed` in m/s for "cas" and "tas", a number for "mach"."""

    mass: float = 200e3
    cg: float = 0.30
    altitude: float = 6096.0
    speed_kind: str = "cas"
    speed: float = 290.0 * KT
    multipliers: dict = field(default_factory=dict)  # coefficient -> factor, e.g. {"Cm_alpha": 0.9}
    turbulence: str = "none"
    seed: int = 0
    fuel_freeze: bool = True

    @classmethod
    def at(cls, mass_t, cg_pct, altitude_ft, *, cas_kt=None, mach=None, tas_kt=None, **rest):
        """Build a flight point from the units of the scenario file; exactly one speed must be given (ValueError)."""
        given = [(k, v) for k, v in (("cas", cas_kt), ("mach", mach), ("tas", tas_kt)) if v is not None]
        if len(given) != 1:
            raise ValueError("give exactly one of cas_kt, mach, tas_kt")
        kind, value = given[0]
        return cls(
            mass_t * 1e3, cg_pct / 100.0, altitude_ft * FT, kind, value if kind == "mach" else value * KT, **rest
        )

    @classmethod
    def of(cls, scenario):
        """Return the flight point of `scenario`, with its coefficients' multipliers, turbulence and seed."""
        f = scenario.flight
        kind, speed = f.speed
        return cls(
            f.mass, f.cg, f.altitude, kind, speed, dict(scenario.tolerances.aero), f.turbulence, scenario.seed
        )


# The six points of the papers, by a scenario's keys: [Sun13] section 5, [Alwi14] table 4 (CAS and altitude; its Mach
# agrees within 415 ft)
SIX = {
    "sun13": {"mass_t": 200.0, "cg_pct": 30.0, "altitude_ft": 20000.0, "cas_kt": 290.0},
    "A": {"mass_t": 260.0, "cg_pct": 28.0, "altitude_ft": 12500.0, "cas_kt": 210.0},
    "B": {"mass_t": 260.0, "cg_pct": 36.0, "altitude_ft": 12500.0, "cas_kt": 270.0},
    "C": {"mass_t": 375.0, "cg_pct": 28.0, "altitude_ft": 27500.0, "cas_kt": 210.0},
    "D": {"mass_t": 405.0, "cg_pct": 36.0, "altitude_ft": 27500.0, "cas_kt": 270.0},
    "E": {"mass_t": 320.0, "cg_pct": 28.0, "altitude_ft": 20000.0, "cas_kt": 240.0},
}
POINTS = {name: FlightPoint.at(**point) for name, point in SIX.items()}


def loading(mass, cg):
    """Return {property: value} of point masses and tank for `mass` [kg], `cg` [fraction], constant radii of gyration.

    Six equal masses stand in pairs around the centroid of the load: (+-X, 0, +-Zx), (0, +-Y, 0), (0, 0, +-Z). With w
    each and inertia J of the load about its centroid, 2 w X^2 = (Jyy + Jzz - Jxx) / 2 and so on, 2 w X Zx = Jxz; J is m
    k^2 less that of the empty aircraft less the distance between the two centroids. Raises ValueError outside
    MASS_RANGE and CG_RANGE.
    """
    if not MASS_RANGE[0] <= mass <= MASS_RANGE[1]:
        raise ValueError(f"mass {mass / 1e3:.1f} t; allowed {MASS_RANGE[0] / 1e3:.0f} to {MASS_RANGE[1] / 1e3:.0f} t")
    if not CG_RANGE[0] <= cg <= CG_RANGE[1]:
        raise ValueError(f"CG {cg * 100:.1f} %; allowed {CG_RANGE[0] * 100:.0f} to {CG_RANGE[1] * 100:.0f} %")
    load = mass - EMPTY_KG
    offset = (cg - 0.25) * CHORD_IN * 0.0254 * mass / load  # centroid of the load aft of 25 % [m]
    apart = EMPTY_KG * load / mass * offset**2
    J = {k: load * v for k, v in GYRATION2.items()}
    w = (load - FUEL_KG) / 6.0
    X = math.sqrt(((J["yy"] + J["zz"] - J["xx"]) / 2 - apart) / (2 * w))
    Y = math.sqrt((J["xx"] + J["zz"] - J["yy"]) / 2 / (2 * w))
    Zx = J["xz"] / (2 * w * X)
    Z = math.sqrt((J["xx"] + J["yy"] - J["zz"]) / 2 / (2 * w) - Zx**2)
    x0 = QUARTER_IN + offset / 0.0254
    out = {"propulsion/tank/contents-lbs": FUEL_KG * G0 / LB, "propulsion/tank/x-position": x0}
    # forward of the centroid is low, aft is high: a positive product of inertia in body axes
    for i, (x, y, z) in enumerate([(-X, 0, -Zx), (X, 0, Zx), (0, -Y, 0), (0, Y, 0), (0, 0, -Z), (0, 0, Z)]):
        out[f"inertia/pointmass-weight-lbs[{i}]"] = w * G0 / LB
        for axis, value in zip("XYZ", (x0 + x / 0.0254, y / 0.0254, z / 0.0254)):
            out[f"inertia/pointmass-location-{axis}-inches[{i}]"] = value
    return out
