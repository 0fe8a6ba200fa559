"""The scenario: a frozen tree of tables. Feet, knots, tonnes and degrees end here; properties without a unit are SI."""

import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo

from cosim.scenario import catalog as c
from cosim.scenario import toml, user_parts
from cosim.scenario.aircraft import Aircraft, load_aircraft, multipliers, of
from cosim.scenario.elevator import Elevator, OwnActuator
from cosim.scenario.fault import Fault, check_together
from cosim.scenario.flight import Flight
from cosim.scenario.manoeuvre import CRUISE, AnyManoeuvre
from cosim.scenario.problem import MULTIPLIER, Duration, Problems, Table, choice, problem, within
from cosim.scenario.user_parts import UserPart
from fdi.registry import DEFAULT, SHIPPED, USER_DETECTORS


class Sensors(Table, extra="allow"):
    """The sensor set, and a table per sensor that deviates from it."""

    __pydantic_extra__: dict[str, dict[str, float]]
    set: Literal["transport"] = "transport"
    noise_scale: Annotated[float, within(0.0, 100.0)] = 1.0
    reconstructed: bool = False  # the law flies on n_z and alpha less what lpv_smo estimates of faults

    def mistakes(self, wrong: Problems, info: ValidationInfo) -> None:
        """Check the sensors and their numbers."""
        units = {**c.SENSORS, **c.ACTUATOR_SENSORS}
        given = self.model_extra or {}
        wrong.unknown(given, units)
        for name in (name for name in given if name in units):
            wrong.numbers(given[name], _sensor_keys(units[name]), f"sensor {name}", f"{name}.")

    def setting(self, name: str, own: Any = lambda unit: 1.0) -> dict[str, float]:
        """Return {sigma, bias, scale (its error: 0 is exact), delay, quantum} of sensor `name` in its own unit, those
        that deviate from its set; `own(unit)` is what one SI `unit`, or share of a nominal value ("of supply", ...),
        is in the sensor's own unit."""
        keys = _sensor_keys({**c.SENSORS, **c.ACTUATOR_SENSORS}[name])
        given = (self.model_extra or {}).get(name, {})
        values = {k.split("_")[0]: v * keys[k].factor * own(keys[k].si) for k, v in given.items()}
        return values | ({"scale": values["scale"] - 1.0} if "scale" in values else {})


def _sensor_keys(units):
    keys = [c.Key("scale", 0.5, 2.0), c.Key("delay_s", 0.0, 0.15, 1.0, "s")]
    for u in units:
        lows = {"sigma": 0.0, "bias": -u.limit, "quantum": 0.0}
        keys += [c.Key(f"{stem}_{u.suffix}", low, u.limit, u.factor, u.si) for stem, low in lows.items()]
    return {k.name: k for k in keys}


class Tolerances(Table, extra="allow"):
    """Multipliers of what flies against its nominal value: {aero: {coefficient: multiplier}, technology: {parameter:
    multiplier}}."""

    __pydantic_extra__: dict[str, dict[str, float]]
    aero: dict[str, float]

    @classmethod
    def filled(cls, raw: dict[str, Any], wrong: Problems, info: ValidationInfo) -> dict[str, Any]:
        """Check the names and numbers; add a table for each technology that has parameters."""
        groups = ["aero", *(t.name for t in c.SHIPPED if t.servo)]
        wrong.unknown(raw, groups)
        for group in (group for group in groups if raw.get(group) and isinstance(raw[group], dict)):
            known = multipliers(of(info).folder) if group == "aero" else c.toleranced(group)
            wrong.numbers(raw[group], dict.fromkeys(known, MULTIPLIER), group, f"{group}.")
        return {**{name: {} for name in groups}, **raw}


def _parameter(value):
    """Return a detector's parameter: a finite number, true or false, or a word."""
    if isinstance(value, bool | str):
        return value
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise problem("is no finite number", allowed="a finite number")
    return float(value)


Parameter = Annotated[Any, BeforeValidator(_parameter)]


class Law(Table, extra="allow"):
    """The control law: a file with one's own, or gains of the shipped one (cosim/flight/user_law.py)."""

    __pydantic_extra__: dict[str, float]
    file: str | None = None
    sha256: str | None = None
    reallocate: bool = False  # what control_redundancy isolates is flown around by the effectors that are left


class Detectors(Table, extra="allow"):
    """The detectors that run, and a table of parameters for each."""

    __pydantic_extra__: dict[str, dict[str, Parameter]]
    enabled: Annotated[tuple[str, ...], Field(strict=False)] = DEFAULT

    @classmethod
    def filled(cls, raw: dict[str, Any], wrong: Problems, info: ValidationInfo) -> dict[str, Any]:
        """Enable every detector there is, those of the table's files among them, where none is chosen."""
        if "enabled" not in raw:
            users = {n: part for n, part in USER_DETECTORS.items() if part.file and n not in raw}
            raw = {**{n: {"file": part.file, "sha256": part.sha256} for n, part in users.items()}, **raw}
        named = [name for name, own in raw.items() if isinstance(own, dict) and "file" in own]
        raw = {"enabled": [*DEFAULT, *dict.fromkeys((*USER_DETECTORS, *named))], **raw}
        known = (*SHIPPED, *USER_DETECTORS)
        enabled = raw["enabled"] if isinstance(raw["enabled"], list | tuple) else ()
        for i, name in enumerate(enabled):
            if isinstance(name, str) and name not in (*known, *named):
                choices = (*known, "or one of your own by --detector FILE")
                wrong.append(choice(name, choices, "detector", key=f"enabled.{i}"))
            elif name in enabled[:i]:
                wrong.add(f"{name!r} is listed twice", key=f"enabled.{i}", remedy="Remove one")
        wrong.unknown(raw, ("enabled", *known, *named))
        return raw

    def table(self, name: str) -> dict:
        """Return {parameter: value} of detector `name` as written; of a user detector its file and digest, too."""
        return dict((self.model_extra or {}).get(name, {}))


# a log's profile, None for all: that is no part of which flight it is, nor of its id
Profile = Annotated[
    Literal["full", "replay", "signals"] | None, AfterValidator(lambda name: None if name == "full" else name)
]


class Scenario(Table):
    """A flight: where, with what, doing what, and what goes wrong."""

    title: str = ""
    duration_s: Duration = 30.0
    seed: Annotated[int, within(0, 2**31 - 1)] = 1
    rate_hz: Annotated[int, within(50, 2000)] = 200
    log_profile: Profile = None
    flight: Flight
    manoeuvre: AnyManoeuvre = CRUISE
    actuators: dict[str, OwnActuator] = Field(default_factory=dict)  # technologies that the scenario brings along
    elevator: Elevator = Field(default_factory=dict, validate_default=True)
    law: Law = Law.model_validate({})
    sensors: Sensors = Sensors.model_validate({})
    tolerances: Tolerances = Tolerances.model_validate({})
    faults: Annotated[tuple[Fault, ...], Field(strict=False)] = ()
    detectors: Detectors = Field(default_factory=lambda: Detectors.model_validate({}))  # users' may have come since

    def mistakes(self, wrong: Problems, info: ValidationInfo) -> None:
        """Check that there is a tick, and that the faults can be together."""
        wrong.require(self.ticks, f"is less than a tick at {self.rate_hz} Hz", key="duration_s",
                      allowed=f"{self.dt:g} to 36000")
        check_together(self.faults, self.elevator.technology, wrong)

    @property
    def running(self) -> tuple[str, ...]:
        """Return the detectors that run: those enabled, and the filters that servos close on."""
        elevator = self.elevator
        feedback = [elevator.feedback[name] for name, tech in elevator.technology.items() if tech == "hydraulic"]
        closed = [
            *((name, name != "measured") for name in feedback),
            (elevator.ema_estimate, elevator.reconfigure and "ema" in elevator.technology.values()),
            ("rtsekf_flight", elevator.reconfigure and "measured" in feedback),
            ("iotsekf", elevator.compensate and feedback),
            ("lpv_smo", self.sensors.reconstructed),
            ("control_redundancy", self.law.reallocate),
        ]
        return tuple(dict.fromkeys([*self.detectors.enabled, *(name for name, runs in closed if runs)]))

    @property
    def user_parts(self) -> dict[str, UserPart]:
        """Return {key: UserPart} of every file or folder of a user's that it names; a digest not known is empty."""
        found = user_parts.places(self.model_dump(mode="python", exclude_none=True))
        return {at.name: UserPart(at.path.name, at.table.get(at.digest, "")) for at in found}

    @property
    def aircraft(self) -> Aircraft:
        """Return the record of the aircraft that flies."""
        return load_aircraft(self.flight.aircraft)

    @property
    def dt(self) -> float:
        """Return the tick [s]."""
        return 1.0 / self.rate_hz

    @property
    def ticks(self) -> int:
        """Return the number of ticks."""
        return round(self.duration_s * self.rate_hz)

    def __repr__(self) -> str:
        """Return in words what differs from flight to flight; `expanded_toml` has all of it."""
        f, technology = self.flight, self.elevator.technology.items()
        long = f"{self.duration_s:g} s at {self.rate_hz} Hz"
        said = {
            "flight": f"{long}: {f.aircraft}, {f.point}, {f.weather}, {self.manoeuvre.kind}, seed {self.seed}",
            "elevator": ", ".join(f"{segment} {name}" for segment, name in technology),
        }
        for i, x in enumerate(self.faults):
            own = ", ".join(f"{k} {v:g}" for k, v in (x.model_extra or {}).items())
            said[f"fault {i}"] = f"{x.kind} on {x.target} from {x.start_s:g} s{f' ({own})' if own else ''}"
        said["detectors"] = ", ".join(self.running) or "none"
        title = f"Scenario: {self.title or 'without a title'}"
        return "\n".join([title, *(f"  {name:<10} {words}" for name, words in said.items())])

    __str__ = __repr__

    def injections(self) -> tuple:
        """Return the faults as a flat tuple of Injection: one per fault and member of its target, SI."""
        return tuple(j for i, f in enumerate(self.faults) for j in f.injections(i, self.elevator.technology))

    def warnings(self) -> list[str]:
        """Return lines about what is legal and probably not meant."""
        lines = []
        for i, f in enumerate(self.faults):
            first = round(f.start_s / self.dt)  # the nearest tick
            if f.start_s >= self.duration_s and not f.waits:
                late = f"starts at {f.start_s:g} s, after the flight's end at {self.duration_s:g} s"
                never = f"never began: {f.when} did not come true"
                lines.append(f"faults.{i} ({f.kind}) {late if f.when is None else never}")
            elif not f.waits and (first >= self.ticks or first >= f.end / self.dt - 0.5):
                lines.append(f"faults.{i} ({f.kind}) acts in no tick: they are {self.dt:g} s apart")
            rate, limit = ((f.model_extra or {}).get(k, 0.0) for k in ("rate_deg_s", "limit_deg"))
            if rate * limit < 0.0 and f.target != "stabiliser":  # the others trim at zero
                said = f"drives away from limit_deg = {limit:g}: a surface that is past it stays there"
                lines.append(f"faults.{i} (runaway) {said}")
        return lines

    def expanded_toml(self) -> str:
        """Return the whole scenario with every default as TOML; loading it gives an equal scenario."""
        return toml.dumps(self.model_dump(mode="python", exclude_none=True))

    def portable_toml(self, *, aircraft: bool = True) -> str:
        """Return `expanded_toml` with the names of a user's files in place of paths: with their digests
        (`user_parts.identified`) it says which flight it is on every machine. That of an aircraft, without which a
        scenario cannot be read, stays a path where `aircraft` is false.
        """
        table = self.model_dump(mode="python", exclude_none=True)
        for at in user_parts.places(table):
            if aircraft or at.key != "aircraft":
                at.table[at.key] = at.path.name
        return toml.dumps(table)

