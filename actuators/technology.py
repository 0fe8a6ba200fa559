"""The record of an actuator technology: what loop, log, faults, judgement and replay know about it, said once.

A technology is a folder here: its blocks (servo, actuator) and `record.py` with one `Technology`, listed by a line in
actuators/registry.py. What needs the blocks' numbers is behind a call, so that a scenario is checked without compiling.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

from actuators.constants import RAD_PER_DEG

Own = tuple[tuple[str, float], ...]  # ((parameter, value), ...) in which an aircraft's actuators differ, SI


@dataclass(frozen=True)
class Unit:
    """A unit that ends a key: SI = value * factor; `si` may be a share of a nominal value ("of supply", ...)."""

    suffix: str
    factor: float
    si: str
    limit: float  # largest magnitude that is accepted, in this unit


MM = Unit("mm", 1e-3, "m", 150.0)
ARM_DEG = Unit("deg", RAD_PER_DEG, "rad", 40.0)  # surface angle that a position stands for
SURFACE_DEG = Unit("deg", RAD_PER_DEG, "rad", 45.0)


@dataclass(frozen=True)
class Key:
    """A number from `low` to `high`, SI = value * factor; `open_low` excludes `low`, `healthy` is refused: no fault."""

    name: str
    low: float
    high: float
    factor: float = 1.0
    si: str = "-"
    open_low: bool = False
    healthy: float | None = None
    default: float | None = None

    def accepts(self, x: float) -> bool:
        """Tell whether the number x is allowed."""
        above = x > self.low if self.open_low else x >= self.low
        return above and x <= self.high and x != self.healthy

    @property
    def range(self) -> str:
        """Return the allowed range as words."""
        low, high = (f"{x:g}" if isinstance(x, float) else str(x) for x in (self.low, self.high))
        text = f"{'above ' if self.open_low else ''}{low} to {high}"
        return text + ("" if self.healthy is None else f", not {self.healthy:g}")


LOSS = (Key("loss_pct", 0.0, 100.0, 0.01, "fraction", open_low=True),)


@dataclass(frozen=True)
class Kind:
    """A kind of fault or manoeuvre: exactly one key of `one_of`, all of `keys`.

    Of a fault: `at` are its places of entry; it is switched at once (no ramp) when `switched`; `exclusive` names what
    it takes over on its actuator: two overlapping faults that take over the same are refused.
    """

    summary: str
    one_of: tuple[Key, ...] = ()
    keys: tuple[Key, ...] = ()
    at: tuple[str, ...] = ()
    technologies: tuple[str, ...] = ()
    switched: bool = False
    exclusive: str = ""

    def filled(self, table: dict[str, Any]) -> dict[str, Any]:
        """Return a table of this kind with whole numbers as floats, and with the defaults of what it leaves out."""
        given = {name: float(x) if type(x) is int else x for name, x in table.items()}
        one_of = () if any(key.name in table for key in self.one_of) else self.one_of
        missing = (key for key in (*self.keys, *one_of) if key.default is not None and key.name not in given)
        return {**given, **{key.name: key.default for key in missing}}


@dataclass(frozen=True)
class Sensor:
    """A sensor of the actuator: what it reads, how well, and who uses it."""

    state: str  # field of the actuator's state that it reads
    meaning: str  # with its sign
    units: tuple[Unit, ...]  # in which its faults and settings may be given; the first is its own
    sigma: float  # noise per 5 ms sample, 1 sigma [own unit, SI]
    spread: float = 0.0  # bound of the constant error that each flight draws [own unit, SI]
    servo: tuple[str, str] | None = None  # the servo's inputs for its value and its flag
    drive: tuple[str, str] | None = None  # the actuator's own electronics read it too: inputs that replace and that add
    may_fail: bool = True  # a fault may be on it


SURFACE = Sensor(  # noise, and a constant error of rigging
    "delta", "surface position, trailing edge down +", (SURFACE_DEG,), 0.02 * RAD_PER_DEG, 0.08 * RAD_PER_DEG
)


@dataclass(frozen=True)
class Effect:
    """What a kind of fault does to the actuator: its magnitude, or its envelope when it is switched, is added to an
    input field. `unit` "m" or "rad" says in which of the two the field is, where the fault may be given in either;
    `share` is the field that takes the share of the healthy signal away which the fault stands in place of."""

    input: str
    unit: str = ""
    share: str = ""


@dataclass(frozen=True)
class Design:
    """Nominal numbers of a technology, SI: what the relative units of faults and sensors refer to."""

    arm: float  # of the linkage [m]
    drive: float  # what 1 of u stands for: 1 for a valve, the largest demand of a drive [A]
    probe: float  # u far inside the limits, with which the gain of an oscillation is measured
    stall_moment: float  # at the surface [N m]
    limited: bool = False  # `drive` bounds what an oscillation at the drive may ask for
    gains: dict[str, float] = field(default_factory=dict)  # sensor -> reading per unit of its state, 1 if not here
    shares: dict[str, float] = field(default_factory=dict)  # SI unit of a fault -> the sensor's own unit
    factors: dict[str, float] = field(default_factory=dict)  # kind of fault -> its input per unit of magnitude
    valve_speed: float = math.nan  # rod speed per unit of valve opening, no load [m/s]


@dataclass(frozen=True)
class Technology:
    """An actuator technology. Names of bus sections: `name` is the actuator's, `servo` that of its servo loop."""

    name: str
    article: str  # "a hydraulic", in messages
    modules: Callable[[], tuple[ModuleType | None, ModuleType]]  # blocks of servo (None: it has none) and actuator
    # (what an aircraft's actuators differ in) -> nominal numbers
    design: Callable[[Own], Design]
    # (what an aircraft's actuators differ in; a table per lane of parameters that fly, and one of those that the servo
    # believes; (delta, hm0, hmd) at trim (3, n); travel of the surface [rad]; tick [s]; age of sensors [ticks]) ->
    # [(section, block, PARAMS, STATE)], the servo first
    build: Callable[..., list[tuple]] = lambda *given: []
    servo: str = ""  # without one there is no valve or drive that a fault could enter
    sensors: dict[str, Sensor] = field(default_factory=dict)
    loop_sensor: str = ""  # the one that closes the position loop
    sent: tuple[str, str, str] = ("", "", "")  # what the servo sends: word, meaning, unit
    runaway: str = "rate"  # what runs away: the open "valve", the demanded "rate", or the "command"
    effects: dict[str, Effect] = field(default_factory=dict)  # kind of fault -> what it moves
    kinds: dict[str, Kind] = field(default_factory=dict)  # kinds that only this technology has
    parameters: Callable[[Own], dict[str, float]] = lambda own: {}  # name -> nominal value: what tolerances multiply
    fixed: tuple[str, ...] = ()  # parameters that have no tolerance: stops and steps, nothing that wears
    hinge_error: float = 0.0  # bound of the error of the detectors' hinge-moment model
    # what makes actuator and servo linear, to measure gains
    smooth: tuple[dict[str, float], dict[str, float]] = field(default_factory=lambda: ({}, {}))
    gain_of: str = ""  # technology whose closed loop turns millimetres into u at the valve; "": its own
    # position amplitude [m] per unit that replaces the valve command or drive demand, over (omega [rad/s], own)
    solid_gain: Callable[[float, Own], float] = lambda omega, own: math.nan

    @property
    def tolerances(self) -> tuple[str, ...]:
        """Return the names of the parameters that may be multiplied."""
        return tuple(name for name in self.parameters(()) if name not in self.fixed)

    @property
    def own_sensors(self) -> tuple[str, ...]:
        """Return the sensors that may fail."""
        return tuple(name for name, sensor in self.sensors.items() if sensor.may_fail)
