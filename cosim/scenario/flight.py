"""[flight]: the point at which the aircraft is trimmed. Feet, knots, tonnes and degrees end here."""

import math
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, model_validator

from actuators.constants import M_PER_FT, M_S_PER_KT
from cosim.scenario.aircraft import DEFAULT, of
from cosim.scenario.problem import problem
from cosim.scenario.table import Table

SPEEDS = ("cas_kt", "mach", "tas_kt")
PATHS = (("climb_fpm", "gamma_deg"), ("bank_deg", "turn_deg_s"))  # of each pair one, or none


class Flight(Table):
    """The point at which the aircraft is trimmed, and the air it flies through."""

    aircraft: str = DEFAULT  # a bundled name, or a folder with aircraft.toml
    aircraft_sha256: str | None = None  # of that folder
    mass_t: float
    cg_pct: float
    altitude_ft: float
    cas_kt: float | None = None
    mach: float | None = None
    tas_kt: float | None = None
    climb_fpm: Annotated[float, Field(ge=-6000.0, le=6000.0)] | None = None  # descent -
    gamma_deg: Annotated[float, Field(ge=-15.0, le=15.0)] | None = None  # angle of the path, in place of climb_fpm
    bank_deg: Annotated[float, Field(ge=-60.0, le=60.0)] | None = None  # of a steady turn, right +
    turn_deg_s: Annotated[float, Field(ge=-6.0, le=6.0)] | None = None  # rate of the heading, in place of bank_deg
    turbulence: Literal["none", "light", "moderate", "severe"] = "none"

    @model_validator(mode="after")
    def _one_path(self):
        for pair in PATHS:
            if all(getattr(self, key) is not None for key in pair):
                said = f"{' and '.join(pair)} are both given"
                raise problem(said, key=pair[1], allowed="one of them, or none")
        return self

    @model_validator(mode="after")
    def _one_speed(self):
        given = [k for k in SPEEDS if getattr(self, k) is not None]
        if len(given) != 1:
            said = f"{' and '.join(given)} are both given" if given else "no speed is given"
            raise problem(said, key=given[1] if given else "cas_kt", allowed="exactly one of cas_kt, mach, tas_kt")
        return self

    @model_validator(mode="before")
    @classmethod
    def _within_limits(cls, raw: Any, info: ValidationInfo) -> Any:
        record = of(info)
        spans = {**{k: v for k, v in record.mass if k in ("mass_t", "cg_pct")}, **dict(record.limits)}
        for key in ("mass_t", "cg_pct", "altitude_ft", *SPEEDS):
            value, (low, high) = raw.get(key) if isinstance(raw, dict) else None, spans[key]
            if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
                raise problem("must be a valid number", key=key, allowed=f"{low:.10g} to {high:.10g}")
            if value is not None and math.isfinite(value) and not low <= value <= high:
                raise problem("is out of range", key=key, allowed=f"{low:.10g} to {high:.10g}")
        return raw

    @property
    def mass(self) -> float:
        """Return the mass [kg]."""
        return self.mass_t * 1000.0

    @property
    def cg(self) -> float:
        """Return the centre of gravity as a fraction of the mean aerodynamic chord."""
        return self.cg_pct / 100.0

    @property
    def altitude(self) -> float:
        """Return the altitude [m]."""
        return self.altitude_ft * M_PER_FT

    @property
    def climb(self) -> float | None:
        """Return the vertical speed at the start [m/s], None where none is asked for."""
        return None if self.climb_fpm is None else self.climb_fpm * M_PER_FT / 60.0

    @property
    def gamma(self) -> float | None:
        """Return the angle of the path at the start [rad], None where none is asked for."""
        return None if self.gamma_deg is None else math.radians(self.gamma_deg)

    @property
    def bank(self) -> float | None:
        """Return the bank of a steady turn [rad], None where none is asked for."""
        return None if self.bank_deg is None else math.radians(self.bank_deg)

    @property
    def turn(self) -> float | None:
        """Return the turn rate [rad/s], None where none is asked for."""
        return None if self.turn_deg_s is None else math.radians(self.turn_deg_s)

    @property
    def path(self) -> str:
        """Return in words how the flight begins where that is not level: "climb of 1000 ft/min, bank of 20 deg"."""
        said = {
            "climb_fpm": lambda v: f"{'climb' if v > 0 else 'descent'} of {abs(v):g} ft/min",
            "gamma_deg": lambda v: f"{'climb' if v > 0 else 'descent'} at {abs(v):g} deg",
            "bank_deg": lambda v: f"bank of {v:g} deg",
            "turn_deg_s": lambda v: f"turn of {v:g} deg/s",
        }
        return ", ".join(tell(getattr(self, key)) for key, tell in said.items() if getattr(self, key))

    @property
    def speed(self) -> tuple[str, float]:
        """Return (kind, value): ("cas" or "tas", m/s) or ("mach", -)."""
        if self.mach is not None:
            return "mach", self.mach
        if self.cas_kt is not None:
            return "cas", self.cas_kt * M_S_PER_KT
        assert self.tas_kt is not None  # exactly one is given
        return "tas", self.tas_kt * M_S_PER_KT
