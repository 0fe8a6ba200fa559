"""One fault of a scenario: parsed target, checked parameters, and the SI numbers that the loop injects."""

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, ValidationInfo, model_validator

from cosim.errors import ScenarioError, did_you_mean
from cosim.scenario import catalog as c
from cosim.scenario.aircraft import Aircraft, load_aircraft, of
from cosim.scenario.condition import condition, other_fault
from cosim.scenario.problem import choice, problem
from cosim.scenario.target import parse_target

COMMON = ("target", "kind", "start_s", "when", "lasts_s", "end_s", "ramp_s")
NEVER_S = 36000.0  # the onset of a fault that waits for its condition
Seconds = Annotated[float, Field(ge=0.0, le=36000.0)]


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


class Fault(BaseModel):
    """A fault as written: common keys are fields, the kind's own numbers are checked against the catalog."""

    model_config = ConfigDict(frozen=True, extra="allow", strict=True, allow_inf_nan=False)
    __pydantic_extra__: dict[str, float]

    target: str
    kind: str
    start_s: Seconds
    when: str | None = None
    lasts_s: Annotated[float, Field(gt=0.0, le=36000.0)] | None = None  # of one with a condition, until it heals
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
    def _against_catalog(cls, raw: Any, info: ValidationInfo) -> Any:
        if isinstance(raw, dict) and isinstance(raw.get("when"), str):
            raw = {"start_s": NEVER_S, **raw}
        if not isinstance(raw, dict) or not all(isinstance(raw.get(k), str) for k in ("target", "kind")):
            return raw  # pydantic says what is missing or of the wrong type
        aircraft = of(info)
        target = parse_target(raw["target"], aircraft)
        kind = _kind(target, raw)
        full = {**raw, **_place(target, kind, raw)}
        for key in c.optional_keys(raw["kind"], raw["target"], aircraft):
            if key.name in full:
                _number(full[key.name], key)
        _shape(raw["kind"], full)
        _magnitudes(raw["kind"], kind, full, aircraft)
        return full

    @property
    def waits(self) -> bool:
        """Return whether the onset is still to be found: that of its condition `when`."""
        return self.when is not None and self.start_s == NEVER_S

    def at_time(self, start_s: float) -> "Fault":
        """Return this fault with its onset at `start_s` [s]."""
        ends = {} if self.lasts_s is None else {"end_s": start_s + self.lasts_s}
        return self.model_copy(update={"start_s": start_s, **ends})

    @model_validator(mode="after")
    def _condition(self):
        if self.when is not None:
            try:
                condition(self.when)
            except ScenarioError as error:
                raise problem(error.problem, key="when", allowed=error.allowed, remedy=error.remedy) from None
            if self.waits and self.end_s is not None:
                raise problem("a fault that waits has no end yet", key="end_s", remedy="Say lasts_s")
        elif self.lasts_s is not None:
            raise problem("is for a fault with a condition", key="lasts_s", remedy="Say end_s")
        return self

    def others(self) -> list[int]:
        """Return the numbers of the faults that its condition looks at."""
        seen = (other_fault(name) for name in condition(self.when).signals()) if self.when is not None else ()
        return [number for number in seen if number is not None]

    @model_validator(mode="after")
    def _times(self):
        if self.end_s is not None and self.end_s <= self.start_s:
            raise problem(
                f"the fault ends at {self.end_s:g} s, not after its start",
                key="end_s",
                allowed=f"above start_s = {self.start_s:g}",
            )
        if self.ramp_s and self.spec.switched:
            raise problem(f"{self.kind} is switched at once", key="ramp_s", allowed="0", remedy="Remove ramp_s")
        if self.end_s is not None and self.ramp_s > self.end_s - self.start_s:
            raise problem(
                "the ramp is longer than the fault", key="ramp_s", allowed=f"0 to {self.end_s - self.start_s:g}"
            )
        return self

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
        si = {
            k.name: numbers[k.name] * k.factor
            for k in (*spec.keys, *c.optional_keys(self.kind, self.target, self._aircraft))
            if k.name in numbers
        }
        target, out = self.parsed, []
        for name in target.names:
            sensor = target.sensor
            if not sensor and (self.kind == "jam_liquid" or self.at == "sensor"):
                sensor = c.LOOP_SENSOR[technology[name]]
            out.append(
                Injection(
                    fault=index,
                    kind=self.kind,
                    place=target.place,
                    name=name,
                    sensor=sensor,
                    at=self.at or "",
                    path=self.path or "",
                    start=self.start_s,
                    end=math.inf if self.end_s is None else self.end_s,
                    ramp=self.ramp_s,
                    magnitude=magnitude,
                    unit=unit,
                    omega=si.get("frequency_hz", math.nan),
                    phase=si.get("phase_deg", 0.0),
                    shape=self.shape or c.SHAPES[0],
                    sweep=si.get("chirp_hz_s", 0.0),
                    limit=si.get("limit_deg", math.nan),
                )
            )
        return out


def _kind(target, raw):
    kinds = target.kinds
    if raw["kind"] in kinds:
        return kinds[raw["kind"]]
    if raw["kind"] not in c.ALL_KINDS:
        raise choice(raw["kind"], kinds, "kind of fault", key="kind")
    where = {
        "surface": "a surface other than the elevator",
        "actuator_sensor": "an actuator's sensor",
        "sensor": "an aircraft sensor",
    }
    place = where.get(target.place, f"an {target.place}")
    raise problem(f"{raw['kind']!r} is no fault of {place} ({raw['target']})", key="kind", allowed=", ".join(kinds))


def _place(target, kind, raw):
    """Return the keys `at` and `path` with their defaults, or raise when the kind has none or not this one."""
    out = {}
    if kind.at:
        out["at"] = raw.get("at") or kind.at[0]
        if out["at"] not in kind.at:
            why = (
                " (a sensor adds to its reading, it cannot replace it)"
                if (raw["kind"], out["at"]) == ("ofc_solid", "sensor")
                else ""
            )
            raise problem(f"{raw['kind']} cannot enter at {out['at']!r}{why}", key="at", allowed=", ".join(kind.at))
    elif raw.get("at") is not None:
        raise problem(f"{raw['kind']} has no place of entry", key="at", remedy="Remove at")
    paths: tuple[str, ...] = {"sensor": c.SENSOR_PATHS, "actuator_sensor": c.ACTUATOR_PATHS}.get(target.place, ())
    if paths:
        out["path"] = raw.get("path") or paths[0]
        if raw["kind"] == "jam_liquid":
            paths = paths[:1]
        if out["path"] not in paths:
            raise problem(
                f"{out['path']!r} is no path of {raw['kind']} on {raw['target']}", key="path", allowed=", ".join(paths)
            )
    elif raw.get("path") is not None:
        raise problem(
            f"{raw['kind']} on {raw['target']} has no path; only sensor faults have", key="path", remedy="Remove path"
        )
    return out


def _shape(name, full):
    """Check the shape of an oscillation, and that a chirp, and nothing else, says how its frequency changes."""
    given = full.get("shape")
    if given is not None and name not in c.OSCILLATIONS:
        raise problem(f"{name} has no shape", key="shape", allowed="no such key", remedy="Remove shape")
    if given is not None and given not in c.SHAPES:
        raise choice(given, c.SHAPES, "shape", key="shape")
    if given == "chirp" and c.SWEEP.name not in full:
        raise problem(f"a chirp needs {c.SWEEP.name}", key=c.SWEEP.name, allowed=c.SWEEP.range)
    if given != "chirp" and name in c.OSCILLATIONS and c.SWEEP.name in full:
        raise problem("is for a chirp", key=c.SWEEP.name, remedy="Say shape = 'chirp'")


def _number(value, key):
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise problem("is no number", key=key.name, allowed=key.range)
    if not key.accepts(float(value)):
        raise problem("is out of range", key=key.name, allowed=key.range)


def _magnitudes(name, kind, full, aircraft):
    """Check the kind's own numbers (one of `one_of`, all `keys`, nothing else); fill defaults in place."""
    one_of = kind.one_of
    if name.startswith("ofc_"):
        one_of = tuple(k for k in one_of if k.name in c.AMPLITUDES_AT[full["at"]])
    optional = c.optional_keys(name, full["target"], aircraft)
    known = [k.name for k in (*one_of, *kind.keys, *optional)]
    for key in full:
        if key not in (*COMMON, "at", "path", "shape", *known):
            remedy = did_you_mean(key, [*known, *COMMON])
            at = f" at {full['at']!r}" if key in (k.name for k in kind.one_of) else ""
            raise problem(
                f"unknown key for {name}{at}", key=key, allowed=", ".join(known) or "no further key", remedy=remedy
            )
    given = [k for k in one_of if k.name in full]
    if one_of and len(given) != 1:
        names = ", ".join(k.name for k in one_of)
        if not given:
            raise problem(
                f"{name} needs {'one of ' if len(one_of) > 1 else ''}{names}",
                key=one_of[0].name,
                allowed=one_of[0].range,
            )
        raise problem(
            f"{' and '.join(k.name for k in given)} say the same thing twice",
            key=given[1].name,
            remedy="Keep one of them",
        )
    for key in kind.keys:
        if key.default is None and key.name not in full:
            raise problem(f"{name} needs {key.name}", key=key.name, allowed=key.range)
        full.setdefault(key.name, key.default)
    for key in (*given, *kind.keys):
        _number(full[key.name], key)
        full[key.name] = float(full[key.name])
