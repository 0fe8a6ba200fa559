"""One fault of a scenario: parsed target, checked parameters, and the SI numbers that the loop injects."""

import dataclasses
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import ValidationInfo

from actuators.constants import RAD_PER_DEG
from actuators.technology import Key, Kind
from cosim.errors import ScenarioError, did_you_mean
from cosim.scenario import catalog as c
from cosim.scenario.aircraft import Aircraft, load_aircraft, of
from cosim.scenario.condition import condition, other_fault, signals
from cosim.scenario.problem import Duration, Problems, Seconds, Table, choice, problem

COMMON = ("target", "kind", "start_s", "when", "lasts_s", "end_s", "ramp_s")
NEVER_S = 36000.0  # the onset of a fault that waits for its condition; no flight is longer


@dataclass(frozen=True)
class Injection:
    """A fault on one member of its target, in SI, for the loop.

    `magnitude` is what the kind is about, in `unit`: amplitude of an oscillation, bias, drift per second, rate of a
    runaway [rad/s], share lost or gained [fraction], added noise; of a `scale` fault the factor minus 1, so that zero
    always means healthy; NaN when the kind has none. Units "u" (of the valve) and "of ..." refer to the actuator's
    nominal values. `limit` is the end of a runaway or NaN.
    """

    fault: int  # index in the scenario's list
    kind: str
    place: str  # elevator, actuator_sensor, surface, engine, sensor
    name: str  # left_outer, ..., aileron.left, ..., 1, ..., alpha, ...
    sensor: str  # of a part or of the aircraft, or ""
    at: str  # valve, command, sensor, or ""
    path: str  # all, observers, loop, monitor, or ""
    start: float  # [s]
    end: float  # [s], inf when never healed
    ramp: float  # [s]
    magnitude: float
    unit: str
    omega: float = math.nan  # [rad/s]
    phase: float = 0.0  # [rad]
    shape: str = c.SHAPES[0]  # of an oscillation
    sweep: float = 0.0  # of a chirp's frequency [rad/s^2]
    limit: float = math.nan  # [rad]


@dataclass(frozen=True)
class Target:
    """What a fault acts on: `place` elevator, actuator_sensor, surface, engine or sensor; `names` of the members."""

    place: str
    names: tuple[str, ...]
    sensor: str = ""

    @property
    def kinds(self) -> dict[str, Kind]:
        """Return {kind: Kind} that this place can have."""
        if self.sensor:
            kinds = c.sensor_kinds({**c.SENSORS, **c.ACTUATOR_SENSORS}[self.sensor])
            closes = self.place == "actuator_sensor" and self.sensor in c.LOOP_SENSOR.values()
            return kinds | ({"jam_liquid": c.ELEVATOR_KINDS["jam_liquid"]} if closes else {})
        return {"elevator": c.ELEVATOR_KINDS, "surface": c.SURFACE_KINDS, "engine": c.ENGINE_KINDS}[self.place]

    def paths(self, kind: str) -> tuple[str, ...]:
        """Return the paths that a `kind` can have, the default first: a liquid jam is a fault of the loop."""
        return c.PATHS.get(self.place, ())[: 1 if kind == "jam_liquid" else None]


def targets(aircraft: Aircraft) -> dict[str, Target]:
    """Return {name: Target} of every target that a fault on `aircraft` may name: parts, their groups, their sensors."""
    segments = {**{name: (name,) for name in aircraft.segments}, **aircraft.groups}
    engines = {**{name: (name,) for name in aircraft.engine_names}, "all": aircraft.engine_names}
    return {
        **{f"elevator.{n}": Target("elevator", names) for n, names in segments.items()},
        **{f"elevator.{n}.{sensor}": Target("actuator_sensor", names, sensor)
           for n, names in segments.items() for sensor in c.ACTUATOR_SENSORS},
        **{name: Target("surface", (name,)) for name in c.SURFACES},
        **{f"engine.{n}": Target("engine", names) for n, names in engines.items()},
        **{f"sensor.{name}": Target("sensor", (name,), name) for name in c.SENSORS},
    }  # fmt: skip


def target_of(text: str, aircraft: Aircraft) -> Target:
    """Return the Target that `text` names; an unknown part raises the error that lists what there is."""
    known = targets(aircraft)
    if text in known:
        return known[text]
    beside = [t for t in known if "." in text and t.rpartition(".")[0] == text.rpartition(".")[0]]
    allowed = ", ".join(beside or ("elevator.<segment or group>[.<sensor>]", *c.SURFACES, "engine.<number>",
                                   "engine.all", "sensor.<name>"))  # fmt: skip
    remedy = did_you_mean(text, known) or "`cosim list targets` shows every target"
    raise problem(f"{text!r} is no part of this aircraft", key="target", allowed=allowed, remedy=remedy)


class Fault(Table, extra="allow"):
    """A fault as written: common keys are fields, the kind's own numbers are checked against the catalog."""

    __pydantic_extra__: dict[str, Any]

    target: str
    kind: str
    start_s: Seconds
    when: str | None = None
    lasts_s: Duration | None = None  # of one with a condition, until it heals
    end_s: Seconds | None = None
    ramp_s: Seconds = 0.0
    at: str | None = None
    path: str | None = None
    shape: Literal["sine", "square", "triangle", "chirp"] | None = None
    _aircraft: Aircraft

    def model_post_init(self, context: Any) -> None:
        """Remember whose part the target names."""
        self._aircraft = (context or {}).get("aircraft") or load_aircraft()

    @classmethod
    def filled(cls, raw: dict[str, Any], wrong: Problems, info: ValidationInfo) -> dict[str, Any]:
        """Add the defaults of its kind."""
        target, name = raw.get("target"), raw.get("kind")
        if not isinstance(target, str) or not isinstance(name, str):
            return raw  # pydantic says what is missing or of the wrong type
        place = target_of(target, of(info))
        if name not in place.kinds:
            raise choice(name, place.kinds, f"fault of {target}", key="kind")
        kind = place.kinds[name]
        waits = {"start_s": NEVER_S} if isinstance(raw.get("when"), str) else {}
        ways = {"at": kind.at[:1], "path": place.paths(name)[:1]}
        first = {key: way[0] for key, way in ways.items() if way and raw.get(key) is None}
        return kind.filled({**waits, **raw, **first})

    def mistakes(self, wrong: Problems, info: ValidationInfo) -> None:
        """Check the kind's own numbers, and that the keys fit together."""
        kind, own = self.spec, self.model_extra or {}
        sweep, oscillates = c.SWEEP.name, self.kind in c.OSCILLATIONS
        ways = ("at", "place of entry", self.at, kind.at), ("path", "path", self.path, self.parsed.paths(self.kind))
        for key, what, given, allowed in ways:
            wrong.require(given in (allowed or (None,)), f"{given!r} is no {what} of {self.kind} on {self.target}",
                          key=key, allowed=", ".join(allowed) or "none: leave it out")
        shaped = oscillates or self.shape is None
        wrong.require(shaped, f"{self.kind} has no shape", key="shape", allowed="no such key", remedy="Remove shape")
        swept = not oscillates or self.shape == "chirp" or sweep not in own
        wrong.require(swept, "is for a chirp", key=sweep, remedy="Say shape = 'chirp'")
        if self.shape == "chirp" and oscillates:
            kind = dataclasses.replace(kind, keys=(*kind.keys, c.SWEEP))
        if self.at in kind.at and self.kind.startswith("ofc_"):
            here = c.AMPLITUDES_AT[self.at or ""]
            kind = dataclasses.replace(kind, one_of=tuple(k for k in kind.one_of if k.name in here))
        where = f"{self.kind} at {self.at!r}" if self.at else self.kind
        wrong.of_kind(kind, own, where, COMMON, self._optional)
        self._times(wrong)

    def _times(self, wrong):
        """Check onset, end and ramp, and the condition in place of an onset."""
        lasting = self.end - self.start_s
        try:
            if self.when is not None:
                condition(self.when)
        except ScenarioError as error:
            wrong.add(error.problem, key="when", allowed=error.allowed, remedy=error.remedy)
        wrong.require(self.when is not None or self.lasts_s is None, "is for a fault with a condition", key="lasts_s",
                      remedy="Say end_s")
        wrong.require(not self.waits or self.end_s is None, "a fault that waits has no end yet", key="end_s",
                      remedy="Say lasts_s")
        wrong.require(lasting > 0.0, f"the fault ends at {self.end:g} s, not after its start", key="end_s",
                      allowed=f"above start_s = {self.start_s:g}")
        wrong.require(self.ramp_s <= lasting or lasting <= 0.0, "the ramp is longer than the fault", key="ramp_s",
                      allowed=f"0 to {lasting:g}")
        wrong.require(not self.ramp_s or not self.spec.switched, f"{self.kind} does not support ramp_s", key="ramp_s",
                      allowed="0", remedy="Remove ramp_s")

    @property
    def _optional(self) -> tuple[Key, ...]:
        """Return the keys that it may have: a runaway's limit is by default the stop that it drives to."""
        if self.kind != "runaway":
            return ()
        return (Key("limit_deg", *self._aircraft.travels_deg[self.target.split(".")[0]], RAD_PER_DEG, "rad"),)

    @property
    def waits(self) -> bool:
        """Return whether the onset is still to be found: that of its condition `when`."""
        return self.when is not None and self.start_s == NEVER_S

    @property
    def end(self) -> float:
        """Return when it is healed [s], inf for never."""
        return math.inf if self.end_s is None else self.end_s

    def at_time(self, start_s: float) -> "Fault":
        """Return this fault with its onset at `start_s` [s]."""
        ends = {} if self.lasts_s is None else {"end_s": min(start_s + self.lasts_s, NEVER_S)}
        return self.model_copy(update={"start_s": start_s, **ends})

    @functools.cached_property
    def parsed(self) -> Target:
        """Return the Target."""
        return target_of(self.target, self._aircraft)

    @property
    def spec(self) -> Kind:
        """Return the Kind from the catalog."""
        return self.parsed.kinds[self.kind]

    @property
    def claims(self) -> set[tuple[str, ...]]:
        """Return what it takes over while it is there: (place, name, sensor, what) of each member."""
        target, what, limited = self.parsed, self.spec.exclusive, "limit_deg" in (self.model_extra or {})
        if what == "at":  # a runaway to a limit moves the command, whatever it starts from (flight/faults/inject.py)
            what = "command" if limited else self.at or ""
        return {(target.place, name, target.sensor, what) for name in target.names if what and not self.waits}

    @property
    def period_s(self) -> float | None:
        """Return the period of an oscillation [s], or None."""
        hz = (self.model_extra or {}).get("frequency_hz")
        return 1.0 / hz if hz else None

    def entry(self, technology: dict[str, str]) -> str:
        """Return where it enters, as words: `at`, but the command where a runaway has a limit or no valve."""
        if self.kind != "runaway" or self.at != "valve":
            return self.at or ""
        limited = "limit_deg" in (self.model_extra or {})
        held = (c.TECHNOLOGIES[technology[n]].runaway == "valve" for n in self.parsed.names)
        return " or ".join(dict.fromkeys("valve" if valve and not limited else "command" for valve in held))

    def injections(self, index: int, technology: dict[str, str]) -> list[Injection]:
        """Return the list of Injection, one per member; `technology` maps segment to its actuator."""
        target, spec, numbers = self.parsed, self.spec, self.model_extra or {}
        key = next((k for k in spec.one_of if k.name in numbers), None)
        magnitude, unit = (numbers[key.name] * key.factor, key.si) if key else (math.nan, "")
        if unit == "of travel":
            magnitude, unit = magnitude * self._aircraft.travel, "rad"
        if self.kind == "scale":
            magnitude -= 1.0
        known = (*spec.keys, c.SWEEP, *self._optional)
        si = {k.name: numbers[k.name] * k.factor for k in known if k.name in numbers}
        common: dict[str, Any] = {
            "fault": index, "kind": self.kind, "at": self.at or "", "path": self.path or "",
            "start": self.start_s, "end": self.end, "ramp": self.ramp_s, "magnitude": magnitude, "unit": unit,
            "omega": si.get("frequency_hz", math.nan), "phase": si.get("phase_deg", 0.0),
            "shape": self.shape or c.SHAPES[0], "sweep": si.get("chirp_hz_s", 0.0),
            "limit": si.get("limit_deg", math.nan),
        }  # fmt: skip
        on_loop_sensor = not target.sensor and (self.kind == "jam_liquid" or self.at == "sensor")
        sensors = {n: c.LOOP_SENSOR[technology[n]] if on_loop_sensor else target.sensor for n in target.names}
        return [Injection(place=target.place, name=n, sensor=sensor, **common) for n, sensor in sensors.items()]


def check_together(faults: Sequence[Fault], technology: dict[str, str], wrong: Problems) -> None:
    """Add what is wrong with every fault that its actuator cannot have, that waits for one that there is not, or that
    overlaps another in what it takes over; when one that waits for its condition will do so is not known yet."""
    for i, fault in enumerate(faults):
        _check_technology(f"faults.{i}", fault, technology, wrong)
        names = signals(condition(fault.when)) if fault.when is not None else ()
        for number in (number for number in map(other_fault, names) if number is not None):
            said = "a fault cannot wait for itself" if number == i else f"there is no fault {number}"
            allowed = ", ".join(f"fault.{k}" for k in range(len(faults)) if k != i)
            wrong.require(i != number < len(faults), said, key=f"faults.{i}.when", allowed=allowed)
        for j, other in enumerate(faults[:i]):
            apart = fault.start_s >= other.end or other.start_s >= fault.end or not fault.claims & other.claims
            said = f"{fault.kind} and faults.{j} ({other.kind}) take over {fault.target} at the same time"
            remedy = f"Set faults.{j}.end_s before this start, or remove one"
            wrong.require(apart, said, key=f"faults.{i}.start_s", remedy=remedy)


def _check_technology(place, fault, technology, wrong):
    """Add why the actuator of a member of the target cannot have a fault."""
    target, having = fault.parsed, fault.spec.technologies
    others = " or ".join(c.TECHNOLOGIES[name].article for name in having)
    measuring = [t.name for t in c.TECHNOLOGIES.values() if target.sensor in t.own_sensors]
    for name in target.names if target.place in ("elevator", "actuator_sensor") else ():
        own = c.TECHNOLOGIES[technology[name]]
        has_none = target.sensor and target.sensor not in own.own_sensors
        refused = (  # whether, key, why, allowed, technologies that can have it
            (has_none, "target", f" and has no sensor {target.sensor!r}", own.own_sensors or ("none",), measuring),
            (having and own.name not in having, "kind", f", {fault.kind} is a fault of {others} one", (), having),
            (not own.servo and fault.at in ("valve", "sensor"), "at", f", which has no {fault.at}", ("command",),
             ("hydraulic",)),
        )  # fmt: skip
        for key, why, allowed, fits in (row for is_wrong, *row in refused if is_wrong):
            said = f"elevator.{name} is {own.article} actuator{why}"
            remedy = f'Choose another target, or set elevator.{name} = "{fits[0]}"'
            wrong.add(said, key=f"{place}.{key}", allowed=", ".join(allowed), remedy=remedy)
