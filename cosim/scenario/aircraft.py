"""The aircraft that flies, as its folder's aircraft.toml describes it: one typed record, read once.

The contract of a folder is aircraft/README.md. A bundled aircraft is named, another one is given as a path.
"""

import functools
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, Field, ValidationInfo

from actuators.constants import RAD_PER_DEG
from actuators.registry import SHIPPED
from actuators.technology import Key
from cosim.errors import ScenarioError, did_you_mean
from cosim.scenario.problem import Origin, Problems, Table, checked, within
from cosim.texts import read, toml

FOLDER = Path(__file__).resolve().parents[2] / "aircraft"
RECORD = "aircraft.toml"
DEFAULT = "transport"
R = TypeVar("R")
Positive = Annotated[float, within(0.0, open_low=True)]


def _rising(span: tuple[float, float]) -> tuple[float, float]:
    if not span[0] < span[1]:
        raise ValueError("must be [lowest, highest]")
    return span


Span = Annotated[tuple[float, float], Field(strict=False), AfterValidator(_rising)]
Percent = Annotated[float, within(0.0, 100.0)]


class Geometry(Table):
    """Reference geometry as in the JSBSim model: lengths of the coefficients, and where the CG is counted from."""

    wing_area_ft2: Positive
    span_ft: Positive
    chord_ft: Positive
    tail_arm_ft: Positive  # from the CG to the tail, which meets a gust later
    downwash: Annotated[float, Field(ge=0.0, lt=1.0)]  # d epsilon / d alpha at the tail
    station_in: float  # of the CG reference in the structural frame, x aft
    reference_pct: Percent  # CG reference, of the mean chord


class Gyration(Table):
    """Radii of gyration squared [m2], body axes; `xz` is the product of inertia over mass."""

    xx: Positive
    yy: Positive
    zz: Positive
    xz: float


class Mass(Table):
    """What may be loaded, and what the empty aircraft and its one tank weigh."""

    mass_t: Span
    cg_pct: Annotated[tuple[Percent, Percent], Field(strict=False), AfterValidator(_rising)]  # of the mean chord
    empty_t: Positive
    fuel_t: Positive
    gyration2_m2: Gyration

    def mistakes(self, wrong: Problems, info: ValidationInfo) -> None:
        """Check that the aircraft can be loaded."""
        least, low = self.empty_t + self.fuel_t, self.mass_t[0]
        wrong.require(low > least, f"begins at {low:g} t", key="mass_t",
                      allowed=f"above empty_t + fuel_t = {least:g} t")


class Limits(Table):
    """What a scenario may ask for, and the angle below which no wing of this aircraft stalls."""

    altitude_ft: Span
    cas_kt: Span
    tas_kt: Span
    mach: Span
    alpha_surely_flies_deg: Annotated[float, Field(gt=0.0, lt=90.0)]


class Segment(Table):
    """An elevator segment: its short name in fields and properties, and the technology that moves it by default."""

    short: Annotated[str, Field(pattern=r"^[a-z][a-z0-9]*$")]
    actuator: str


class Elevator(Table, extra="allow"):
    """The elevator: travel of every segment (trailing edge down +), and the segments from left to right."""

    __pydantic_extra__: dict[str, Segment]

    travel_deg: Span

    @property
    def segments(self) -> dict[str, Segment]:
        """Return {name: Segment} from left to right."""
        return dict(self.model_extra or {})


class Surface(Table):
    """A surface with a plain actuator: travel, fastest rate, natural frequency of the position loop."""

    travel_deg: Span
    rate_deg_s: Positive
    omega_rad_s: Positive

    @property
    def rate(self) -> float:
        """Return the fastest rate [rad/s]."""
        return math.radians(self.rate_deg_s)


class Surfaces(Table):
    """The surfaces beside the elevator."""

    aileron: Surface
    rudder: Surface
    stabiliser: Surface


class Aircraft(Table):
    """What the loop must know of an aircraft beside its JSBSim model."""

    title: str
    engines: Annotated[int, within(1, 8)]
    geometry: Geometry
    mass: Mass
    limits: Limits
    elevator: Elevator
    surfaces: Surfaces
    # technology -> parameters that differ from its own design
    actuators: dict[str, dict[str, float]] = Field(default_factory=dict)
    points: dict[str, dict[str, float]] = Field(default_factory=dict)
    name: str = ""  # the folder's
    folder: Annotated[Path, Field(strict=False)] = Path()

    def mistakes(self, wrong: Problems, info: ValidationInfo) -> None:
        """Check the elevator's segments, and the parameters of actuators."""
        segments = self.elevator.segments
        wrong.require(segments, "elevator has no segment")
        short = {s.short for s in segments.values()}
        wrong.require(len(short) == len(segments), "two elevator segments have the same short name")
        for name in segments:
            wrong.require(name.split("_")[0] in ("left", "right"), "the name of a segment begins with left or right",
                          key=f"elevator.{name}")
        for technology in (t for t in SHIPPED if t.name in self.actuators):
            keys = {name: _of_the_sign(name, value) for name, value in technology.parameters(()).items()}
            wrong.numbers(self.actuators[technology.name], keys, f"{technology.article} actuator",
                          f"actuators.{technology.name}.")

    @property
    def segments(self) -> tuple[str, ...]:
        """Return the names of the elevator segments from left to right."""
        return tuple(self.elevator.segments)

    @property
    def short(self) -> dict[str, str]:
        """Return {segment: its short name}, as fields of the truth and the plant call it."""
        return {name: s.short for name, s in self.elevator.segments.items()}

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Return {left, right, all: segments}."""
        sides = {side: tuple(s for s in self.segments if s.split("_")[0] == side) for side in ("left", "right")}
        return {**sides, "all": self.segments}

    @property
    def technology(self) -> dict[str, str]:
        """Return {segment: technology of its actuator} where a scenario says nothing."""
        return {name: s.actuator for name, s in self.elevator.segments.items()}

    @property
    def engine_names(self) -> tuple[str, ...]:
        """Return "1", "2", ... from left to right."""
        return tuple(str(i + 1) for i in range(self.engines))

    @property
    def travels_deg(self) -> dict[str, tuple[float, float]]:
        """Return {elevator, aileron, rudder, stabiliser: stops [deg]}, trailing edge down +."""
        others = {name: surface.travel_deg for name, surface in self.surfaces}
        return {"elevator": self.elevator.travel_deg, **others}

    @property
    def travels(self) -> dict[str, tuple[float, float]]:
        """Return `travels_deg` in rad."""
        return {name: (math.radians(low), math.radians(high)) for name, (low, high) in self.travels_deg.items()}

    @property
    def travel(self) -> float:
        """Return the whole travel of the elevator [rad]."""
        return (self.elevator.travel_deg[1] - self.elevator.travel_deg[0]) * RAD_PER_DEG

    def own(self, technology: str) -> tuple[tuple[str, float], ...]:
        """Return ((parameter, value), ...) in which this aircraft's actuators of a technology differ from it."""
        return tuple(self.actuators.get(technology, {}).items())

    @property
    def own_designs(self) -> Path | None:
        """Return the folder of designs and thresholds made for this aircraft, None for that which `fdi` brings them."""
        return None if self.folder == FOLDER / DEFAULT else self.folder


def _of_the_sign(name, nominal):
    """Return the Key of a parameter of an actuator: of the sign of its nominal value, any where that is 0."""
    low, high = sorted((0.0, math.copysign(math.inf, nominal)))
    return Key(name, low, high, healthy=0.0) if nominal else Key(name, -math.inf, math.inf)


@functools.cache
def bundled() -> tuple[str, ...]:
    """Return the names of the aircraft that ship."""
    return tuple(sorted(p.parent.name for p in FOLDER.glob(f"*/{RECORD}")))


def stamps(folder: Path) -> tuple[tuple[str, int, int], ...]:
    """Return what changes with every change of a file of an aircraft's `folder`; () for a bundled one, which stays."""
    found = []
    for top, inner, names in os.walk(folder) if folder.parent != FOLDER else ():
        inner[:] = [name for name in inner if not name.startswith(".")]  # a repository's own files, thousands of them
        found += [(path, os.stat(path)) for path in (os.path.join(top, name) for name in names) if os.path.isfile(path)]
    return tuple(sorted((path, about.st_mtime_ns, about.st_size) for path, about in found))


def of_folder(function: Callable[..., R]) -> Callable[..., R]:
    """Remember what `function(folder, ...)` returns, by default of the default aircraft, until a file there changes."""
    known = functools.lru_cache(maxsize=64)(lambda folder, _, *more: function(folder, *more))

    @functools.wraps(function)
    def called(folder: Path = FOLDER / DEFAULT, *more: Any) -> R:
        return known(folder, stamps(folder), *more)

    return called


def load_aircraft(name: str = DEFAULT) -> Aircraft:
    """Return the record of a bundled aircraft, or of the folder `name`; raises ScenarioError, also where there is no
    JSBSim model."""
    made = load_record(name)
    if not (made.folder / f"{made.name}.xml").is_file():
        raise ScenarioError(f"there is no {made.name}.xml, its JSBSim model", place=made.name)
    return made


def aircraft_of(tables: dict[str, Any]) -> Aircraft:
    """Return the record of the aircraft that the tables of a scenario name; what is no name is for its model to
    refuse."""
    flight = tables.get("flight")
    name = flight.get("aircraft") if isinstance(flight, dict) else None
    return load_aircraft(name if isinstance(name, str) else DEFAULT)


def load_record(name: str) -> Aircraft:
    """Return the record of a bundled aircraft or folder `name`, which may lack its model; raises ScenarioError."""
    folder = FOLDER / name if name in bundled() else Path(os.path.expanduser(name)).resolve()
    if not os.path.isfile(folder / RECORD):
        said = f"{name!r} is no aircraft" if not os.path.isdir(folder) else f"the folder has no {RECORD}"
        raise ScenarioError(
            said, place=f"flight.aircraft = {name}", allowed=f"{', '.join(bundled())}, or a folder with {RECORD}",
            remedy=did_you_mean(name, bundled()),
        )  # fmt: skip
    return _read(folder)


def of(info: ValidationInfo) -> Aircraft:
    """Return the aircraft that a validator's context names, the default one where there is none."""
    return (info.context or {}).get("aircraft") or load_aircraft()


@of_folder
def _read(folder: Path) -> Aircraft:
    path = folder / RECORD
    place, text = f"{folder.name}/{RECORD}", read(path, error=ScenarioError)
    table = toml(text, place=place, error=ScenarioError)
    return checked(Aircraft, {**table, "name": folder.name, "folder": folder}, Origin(place, text))


@of_folder
def multipliers(folder: Path) -> tuple[str, ...]:
    """Return the names of the coefficients that the JSBSim model of a folder can scale: its properties
    aero/mult/<name>."""
    import re

    texts = (path.read_text(encoding="utf-8", errors="replace") for path in sorted(folder.rglob("*.xml")))
    return tuple(dict.fromkeys(name for text in texts for name in re.findall(r"aero/mult/(\w+)", text)))
