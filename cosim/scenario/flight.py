"""[flight]: the point at which the aircraft is trimmed. Feet, knots, tonnes and degrees end here."""

import math
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator

from actuators.constants import M_PER_FT, M_S_PER_KT
from actuators.technology import Key
from cosim.scenario.aircraft import DEFAULT, of
from cosim.scenario.problem import Problems, Seconds, Table, accepted, within

SPEEDS = ("cas_kt", "mach", "tas_kt")
AIR = ("turbulence", "air", "wind_kt", "wind_from_deg", "shear_kt_1000ft", "gusts")  # keys of what the air does
PATHS = (("climb_fpm", "gamma_deg"), ("bank_deg", "turn_deg_s"))  # of each pair one, or none

Turbulence = Literal["none", "light", "moderate", "severe"]


def cas_kt(altitude_ft: float, *, mach: float | None = None, tas_kt: float | None = None) -> float:
    """Return the calibrated airspeed [kt] of a Mach number or true airspeed in the standard atmosphere (ISO 2533)."""
    h = altitude_ft * M_PER_FT
    kelvin = max(288.15 - 0.0065 * h, 216.65)
    pressure = 101325.0 * (kelvin / 288.15) ** 5.2558797 * math.exp(-max(0.0, h - 11000.0) / 6341.62)
    if mach is None:
        assert tas_kt is not None
        mach = tas_kt * M_S_PER_KT / math.sqrt(1.4 * 287.05287 * kelvin)
    impact = pressure * ((1.0 + 0.2 * mach**2) ** 3.5 - 1.0)
    return 340.294 * math.sqrt(5.0 * ((impact / 101325.0 + 1.0) ** (2 / 7) - 1.0)) / M_S_PER_KT


class AirChange(Table):
    """A change of the turbulence within a flight."""

    start_s: Seconds
    turbulence: Turbulence
    ramp_s: Annotated[float, within(0.0, 3600.0)] = 5.0  # until it is reached


class Gust(Table):
    """A discrete gust; a positive speed raises angle of attack, sideslip or airspeed."""

    start_s: Seconds
    axis: Literal["vertical", "lateral", "longitudinal"] = "vertical"
    speed_fps: Annotated[float, within(-150.0, 150.0)]  # of the air, true: from below, the right, ahead +
    gradient_ft: Annotated[float, within(10.0, 10000.0)] = 350.0  # flown from its beginning to its full speed
    shape: Literal["1-cosine", "ramp"] = "1-cosine"  # CS-25 25.341(a), or MIL-F-8785C 3.7.1.3, which stays


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
    climb_fpm: Annotated[float, within(-6000.0, 6000.0)] | None = None  # descent -
    gamma_deg: Annotated[float, within(-15.0, 15.0)] | None = None  # angle of the path, in place of climb_fpm
    bank_deg: Annotated[float, within(-60.0, 60.0)] | None = None  # of a steady turn, right +
    turn_deg_s: Annotated[float, within(-6.0, 6.0)] | None = None  # rate of the heading, in place of bank_deg
    turbulence: Turbulence = "none"
    air: Annotated[tuple[AirChange, ...], Field(strict=False, max_length=16)] = ()  # changes of the turbulence
    wind_kt: Annotated[float, within(0.0, 250.0)] = 0.0  # steady, at altitude_ft
    wind_from_deg: Annotated[float, within(0.0, 360.0)] = 0.0  # true; the aircraft starts heading north
    shear_kt_1000ft: Annotated[float, within(-100.0, 100.0)] = 0.0  # growth of that wind with altitude
    gusts: Annotated[tuple[Gust, ...], Field(strict=False, max_length=16)] = ()

    def mistakes(self, wrong: Problems, info: ValidationInfo) -> None:
        """Check the order of changes, that nothing is said twice, and that no Mach number or true airspeed is beyond
        the highest calibrated one."""
        for i, (before, change) in enumerate(zip(self.air, self.air[1:]), start=1):
            reached = before.start_s + before.ramp_s
            allowed = f"{reached:g} or later: start_s + ramp_s of air.{i - 1}"
            wrong.require(change.start_s >= reached, f"begins before air.{i - 1} is reached", key=f"air.{i}.start_s",
                          allowed=allowed, remedy="Order them by time")
        given = {key for key, value in self if value is not None}
        wrong.one_of(SPEEDS, given, who="the flight")
        for pair in PATHS:
            wrong.one_of(pair, given)
        key, most = ("mach" if self.mach is not None else "tas_kt"), dict(of(info).limits)["cas_kt"][1]
        if given & {*SPEEDS} == {key} and (cas := cas_kt(self.altitude_ft, mach=self.mach, tas_kt=self.tas_kt)) > most:
            said = f"is {cas:.0f} kt calibrated at {self.altitude_ft:g} ft"
            wrong.add(said, key=key, allowed=f"up to {most:g} kt calibrated", remedy="Fly slower or higher")

    @field_validator("mass_t", "cg_pct", "altitude_ft", *SPEEDS, mode="before")
    @classmethod
    def _within_limits(cls, value: Any, info: ValidationInfo) -> Any:
        record = of(info)
        span = {**dict(record.mass), **dict(record.limits)}[info.field_name or ""]
        return None if value is None else accepted(value, Key("", *span))

    @property
    def changes(self) -> tuple[tuple[float, str, float], ...]:
        """Return (start [s], turbulence, time until it is reached [s]) of each change of the turbulence."""
        return tuple((a.start_s, a.turbulence, a.ramp_s) for a in self.air)

    @property
    def wind(self) -> tuple[float, float]:
        """Return the steady wind at the start, to north and east [m/s]."""
        return self._along(self.wind_kt * M_S_PER_KT)

    @property
    def shear(self) -> tuple[float, float]:
        """Return the growth of the wind with altitude, to north and east [1/s]."""
        return self._along(self.shear_kt_1000ft * M_S_PER_KT / (1000.0 * M_PER_FT))

    def _along(self, size):
        """Return what blows with `size` from the wind's direction, to north and east."""
        angle = math.radians(self.wind_from_deg)
        return (-size * math.cos(angle), -size * math.sin(angle)) if size else (0.0, 0.0)

    @property
    def discrete(self) -> tuple[tuple[float, str, float, float, str], ...]:
        """Return (start [s], axis, speed [m/s], gradient [m], shape) of each discrete gust."""
        return tuple((g.start_s, g.axis, g.speed_fps * M_PER_FT, g.gradient_ft * M_PER_FT, g.shape) for g in self.gusts)

    @property
    def weather(self) -> str:
        """Return in words what the air does: "still air", "light turbulence, wind of 30 kt from 270 deg"."""
        blows = self.wind_kt or self.shear_kt_1000ft
        none = "no turbulence" if blows or self.gusts else "still air"
        said = [none if self.turbulence == "none" else f"{self.turbulence} turbulence"]
        said += [f"{a.turbulence.replace('none', 'no turbulence')} from {a.start_s:g} s" for a in self.air]
        if blows:
            said.append(f"wind of {self.wind_kt:g} kt from {self.wind_from_deg:g} deg")
        if self.shear_kt_1000ft:
            said.append(f"shear of {self.shear_kt_1000ft:+g} kt per 1,000 ft")
        gusts = [f"{g.axis} gust of {g.speed_fps:+g} ft/s at {g.start_s:g} s" for g in self.gusts]
        return ", ".join([*said, *(gusts if len(gusts) < 3 else [f"{len(gusts)} gusts"])])

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
    def point(self) -> str:
        """Return in words where the aircraft is trimmed: "200 t, CG 30 %, 20,000 ft, 290 kt CAS"."""
        units = {"cas_kt": "kt CAS", "mach": "Mach", "tas_kt": "kt TAS"}
        speed = next(f"{getattr(self, key):g} {units[key]}" for key in SPEEDS if getattr(self, key))
        return f"{self.mass_t:g} t, CG {self.cg_pct:g} %, {self.altitude_ft:,.0f} ft, {speed}"
