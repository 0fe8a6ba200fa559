"""One fault of a scenario: parsed target, checked parameters, and the SI numbers that the loop injects."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import PrivateAttr, ValidationInfo, model_validator

from cosim.errors import ScenarioError, did_you_mean
from cosim.scenario import catalog as c
from cosim.scenario.aircraft import Aircraft, load_aircraft, of
from cosim.scenario.condition import condition, other_fault
from cosim.scenario.problem import Duration, Problems, Seconds, Table, choice, problem

COMMON = ("target", "kind", "start_s", "when", "lasts_s", "end_s", "ramp_s")
NEVER_S = 36000.0  # the onset of a fault that waits for its condition


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
    at: Literal["valve", "command", "sensor"] | None = None
    path: Literal["all", "observers", "loop", "monitor"] | None = None
    shape: Literal["sine", "square", "triangle", "chirp"] | None = None
    _aircraft: Aircraft = PrivateAttr(default_factory=load_aircraft)

    def model_post_init(self, context: Any) -> None:
        """Remember whose parts the target names."""
        self._aircraft = (context or {}).get("aircraft") or load_aircraft()

    @model_validator(mode="before")
    @classmethod
    def _filled(cls, raw: Any, info: ValidationInfo) -> Any:
        """Add the defaults of its kind."""
        if isinstance(raw, dict) and isinstance(raw.get("when"), str):
            raw = {"start_s": NEVER_S, **raw}
        if not isinstance(raw, dict) or not all(isinstance(raw.get(k), str) for k in ("target", "kind")):
            return raw  # pydantic says what is missing or of the wrong type
        target = parse_target(raw["target"], of(info))
        if raw["kind"] not in c.ALL_KINDS:
            raise choice(raw["kind"], target.kinds, "kind of fault", key="kind")
        if raw["kind"] not in target.kinds:
            said = f"{raw['kind']!r} is no fault of {raw['target']}"
            raise problem(said, key="kind", allowed=", ".join(target.kinds))
        kind = target.kinds[raw["kind"]]
        defaults = {k.name: k.default for k in kind.keys if k.default is not None and k.name not in raw}
        whole = {k: float(v) for k, v in raw.items() if type(v) is int and k not in cls.model_fields}
        return {**raw, **_place(target, kind, raw), **whole, **defaults}

    @model_validator(mode="after")
    def _numbers(self):
        """Check the kind's own numbers: one of `one_of`, all `keys`, nothing else."""
        kind, own, wrong = self.spec, self.model_extra or {}, Problems()
        optional = c.optional_keys(self.kind, self.target, self._aircraft)
        here = c.AMPLITUDES_AT[self.at or ""] if self.kind.startswith("ofc_") else [k.name for k in kind.one_of]
        one_of = [k for k in kind.one_of if k.name in here]
        known = {k.name: k for k in (*one_of, *kind.keys, *optional)}
        meant = set()  # what an unknown key explains
        for key in (key for key in own if key not in known):
            remedy = did_you_mean(key, [*known, *COMMON])
            elsewhere = key in (k.name for k in kind.one_of)  # the amplitude of another place
            meant |= {k.name for k in one_of} if elsewhere else {*remedy.split("'")[1:2]}
            said = f"unknown key for {self.kind}{f' at {self.at!r}' if elsewhere else ''}"
            wrong.add(said, key=key, allowed=", ".join(known) or "no further key", remedy=remedy)
        names, given = [k.name for k in one_of], [k.name for k in one_of if k.name in own]
        if len(given) > 1:
            wrong.add(f"{' and '.join(given)} say the same thing twice", key=given[1], remedy="Keep one of them")
        elif one_of and not given and not meant & {*names}:
            said = f"{self.kind} needs {'one of ' if len(names) > 1 else ''}{', '.join(names)}"
            wrong.add(said, key=names[0], allowed=one_of[0].range)
        for key in (k for k in kind.keys if k.name not in own and k.name not in meant):
            wrong.add(f"{self.kind} needs {key.name}", key=key.name, allowed=key.range)
        for name in (name for name in own if name in known):
            wrong.number(own[name], known[name])
        sweep = c.SWEEP.name
        if self.shape is not None and self.kind not in c.OSCILLATIONS:
            wrong.add(f"{self.kind} has no shape", key="shape", allowed="no such key", remedy="Remove shape")
        elif self.shape == "chirp" and sweep not in own:
            wrong.add(f"a chirp needs {sweep}", key=sweep, allowed=c.SWEEP.range)
        elif self.shape != "chirp" and sweep in known and sweep in own:
            wrong.add("is for a chirp", key=sweep, remedy="Say shape = 'chirp'")
        self._times(wrong)
        wrong.check()
        return self

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
        ends = {} if self.lasts_s is None else {"end_s": start_s + self.lasts_s}
        return self.model_copy(update={"start_s": start_s, **ends})

    def others(self) -> list[int]:
        """Return the numbers of the faults that its condition looks at."""
        seen = (other_fault(name) for name in condition(self.when).signals()) if self.when is not None else ()
        return [number for number in seen if number is not None]

    def _times(self, wrong):
        """Check onset, end and ramp, and the condition in place of an onset."""
        if self.when is not None:
            try:
                condition(self.when)
            except ScenarioError as error:
                wrong.add(error.problem, key="when", allowed=error.allowed, remedy=error.remedy)
        if self.when is None and self.lasts_s is not None:
            wrong.add("is for a fault with a condition", key="lasts_s", remedy="Say end_s")
        if self.waits and self.end_s is not None:
            wrong.add("a fault that waits has no end yet", key="end_s", remedy="Say lasts_s")
        elif self.end_s is not None and self.end_s <= self.start_s:
            said = f"the fault ends at {self.end_s:g} s, not after its start"
            wrong.add(said, key="end_s", allowed=f"above start_s = {self.start_s:g}")
        elif self.ramp_s > self.end - self.start_s:
            wrong.add("the ramp is longer than the fault", key="ramp_s", allowed=f"0 to {self.end - self.start_s:g}")
        if self.ramp_s and self.spec.switched:
            wrong.add(f"{self.kind} does not support ramp_s", key="ramp_s", allowed="0", remedy="Remove ramp_s")

    @property
    def parsed(self) -> Any:
        """Return the Target."""
        return parse_target(self.target, self._aircraft)

    @property
    def spec(self) -> Any:
        """Return the Kind from the catalog."""
        return self.parsed.kinds[self.kind]

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
        ways = ("valve" if valve and not limited else "command" for valve in held)
        return " or ".join(dict.fromkeys(ways))

    def injections(self, index: int, technology: dict[str, str]) -> list[Injection]:
        """Return the list of Injection, one per member; `technology` maps segment to its actuator."""
        spec, numbers = self.spec, self.model_extra or {}
        key = next((k for k in spec.one_of if k.name in numbers), None)
        magnitude, unit = (numbers[key.name] * key.factor, key.si) if key else (math.nan, "")
        if unit == "of travel":
            magnitude, unit = magnitude * self._aircraft.travel, "rad"
        if self.kind == "scale":
            magnitude -= 1.0
        known = (*spec.keys, *c.optional_keys(self.kind, self.target, self._aircraft))
        si = {k.name: numbers[k.name] * k.factor for k in known if k.name in numbers}
        common: dict[str, Any] = {
            "fault": index, "kind": self.kind, "at": self.at or "", "path": self.path or "",
            "start": self.start_s, "end": self.end, "ramp": self.ramp_s, "magnitude": magnitude, "unit": unit,
            "omega": si.get("frequency_hz", math.nan), "phase": si.get("phase_deg", 0.0),
            "shape": self.shape or c.SHAPES[0], "sweep": si.get("chirp_hz_s", 0.0),
            "limit": si.get("limit_deg", math.nan),
        }  # fmt: skip
        target, out = self.parsed, []
        for name in target.names:
            sensor = target.sensor
            if not sensor and (self.kind == "jam_liquid" or self.at == "sensor"):
                sensor = c.LOOP_SENSOR[technology[name]]
            out.append(Injection(place=target.place, name=name, sensor=sensor, **common))
        return out


def _place(target, kind, raw):
    """Return the keys `at` and `path` with their defaults, or raise when the kind has none or not this one."""
    out, name = {}, raw["kind"]
    if kind.at:
        out["at"] = at = kind.at[0] if raw.get("at") is None else raw["at"]
        if at not in kind.at:
            adds = (name, at) == ("ofc_solid", "sensor")
            why = " (a sensor adds to its reading, it cannot replace it)" if adds else ""
            raise problem(f"{name} cannot enter at {at!r}{why}", key="at", allowed=", ".join(kind.at))
    elif raw.get("at") is not None:
        raise problem(f"{name} has no place of entry", key="at", remedy="Remove at")
    paths: tuple[str, ...] = {"sensor": c.SENSOR_PATHS, "actuator_sensor": c.ACTUATOR_PATHS}.get(target.place, ())
    where = f"{name} on {raw['target']}"
    if paths:
        out["path"] = path = paths[0] if raw.get("path") is None else raw["path"]
        paths = paths[:1] if name == "jam_liquid" else paths
        if path not in paths:
            raise problem(f"{path!r} is no path of {where}", key="path", allowed=", ".join(paths))
    elif raw.get("path") is not None:
        raise problem(f"{where} has no path; only sensor faults have", key="path", remedy="Remove path")
    return out


@dataclass(frozen=True)
class Target:
    """What a fault acts on: `place` elevator, actuator_sensor, surface, engine or sensor; `names` of the members."""

    place: str
    names: tuple[str, ...]
    sensor: str = ""

    @property
    def kinds(self) -> dict:
        """Return {kind: Kind} that this place can have."""
        if self.place == "actuator_sensor":
            kinds = c.sensor_kinds(c.ACTUATOR_SENSORS[self.sensor])
            if self.sensor in c.LOOP_SENSOR.values():
                kinds["jam_liquid"] = c.ELEVATOR_KINDS["jam_liquid"]
            return kinds
        if self.place == "sensor":
            return c.sensor_kinds(c.SENSORS[self.sensor])
        return {"elevator": c.ELEVATOR_KINDS, "surface": c.SURFACE_KINDS, "engine": c.ENGINE_KINDS}[self.place]


def targets(aircraft: Aircraft) -> list[str]:
    """Return every target that a fault on `aircraft` may name: parts, their groups, their sensors."""
    parts = [f"elevator.{n}" for n in (*aircraft.segments, *aircraft.groups)]
    sensors = [f"{part}.{sensor}" for part in parts for sensor in c.ACTUATOR_SENSORS]
    engines = [f"engine.{n}" for n in (*aircraft.engine_names, "all")]
    return [*parts, *sensors, *c.SURFACES, *engines, *(f"sensor.{n}" for n in c.SENSORS)]


def parse_target(text: str, aircraft: Aircraft) -> Target:
    """Return the Target that `text` names; an unknown part raises the error that lists what there is."""
    known = targets(aircraft)
    if text not in known:
        beside = [t for t in known if t.rpartition(".")[0] == text.rpartition(".")[0]] if "." in text else []
        allowed = ", ".join(beside or ("elevator.<segment or group>[.<sensor>]", *c.SURFACES, "engine.<number>",
                                       "engine.all", "sensor.<name>"))  # fmt: skip
        remedy = did_you_mean(text, known) or "`cosim list targets` shows every target"
        raise problem(f"{text!r} is no part of this aircraft", key="target", allowed=allowed, remedy=remedy)
    head, _, rest = text.partition(".")
    part, _, sensor = rest.partition(".")
    if head == "elevator":
        return Target("actuator_sensor" if sensor else "elevator", aircraft.groups.get(part, (part,)), sensor)
    if head == "engine":
        return Target("engine", aircraft.engine_names if part == "all" else (part,))
    return Target("sensor", (rest,), rest) if head == "sensor" else Target("surface", (text,))


def check_together(faults: Sequence[Fault], technology: dict[str, str]) -> None:
    """Raise for every fault that its actuator cannot have, that waits for one that there is not, or that overlaps
    another in what it takes over; when one that waits for its condition will do so is not known yet."""
    wrong = Problems()
    taken: list[tuple[Fault, tuple, int]] = []
    for i, fault in enumerate(faults):
        _possible(i, fault, technology, wrong)
        for number in (n for n in fault.others() if n == i or n >= len(faults)):
            said = "a fault cannot wait for itself" if number == i else f"there is no fault {number}"
            allowed = ", ".join(f"fault.{k}" for k in range(len(faults)) if k != i)
            wrong.add(said, key=f"faults.{i}.when", allowed=allowed)
        what = fault.spec.exclusive
        if not what or fault.waits:
            continue
        if what == "at":  # a runaway to a limit moves the command, whatever it starts from (flight/faults/inject.py)
            what = "command" if "limit_deg" in (fault.model_extra or {}) else fault.at
        for name in fault.parsed.names:
            claim = (fault.parsed.place, name, fault.parsed.sensor, what)
            for other, claimed, index in taken:
                if claimed == claim and fault.start_s < other.end and other.start_s < fault.end:
                    said = f"{fault.kind} and faults.{index} ({other.kind}) take over {fault.target} at the same time"
                    remedy = f"Set faults.{index}.end_s before this start, or remove one"
                    wrong.add(said, key=f"faults.{i}.start_s", remedy=remedy)
            taken.append((fault, claim, i))
    wrong.check()


def _possible(i, fault, technology, wrong):
    if fault.parsed.place not in ("elevator", "actuator_sensor"):
        return
    for name in fault.parsed.names:
        own, sensor, fits = c.TECHNOLOGIES[technology[name]], fault.parsed.sensor, fault.spec.technologies
        where, said, allowed = f"elevator.{name} is {own.article} actuator", "", ""
        if sensor and sensor not in own.own_sensors:
            fits = [t.name for t in c.TECHNOLOGIES.values() if sensor in t.own_sensors]
            key, said, allowed = "target", f"{where} and has no sensor {sensor!r}", ", ".join(own.own_sensors) or "none"
        elif fits and own.name not in fits:
            others = " or ".join(c.TECHNOLOGIES[t].article for t in fits)
            key, said = "kind", f"{where}, {fault.kind} is a fault of {others} one"
        elif not own.inlet and fault.at in ("valve", "sensor"):
            key, said, allowed, fits = "at", f"{where}, which has no {fault.at}", "command", ["hydraulic"]
        if said:
            remedy = f'Choose another target, or set elevator.{name} = "{fits[0]}"'
            wrong.add(said, key=f"faults.{i}.{key}", allowed=allowed, remedy=remedy)
            return
