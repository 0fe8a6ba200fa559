"""The scenario: a frozen tree of tables. Feet, knots, tonnes and degrees end here; properties without a unit are SI."""

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo, model_validator

from actuators.constants import M_PER_FT, M_S_PER_KT
from cosim.errors import did_you_mean
from cosim.scenario import catalog as c
from cosim.scenario import conflict, tolerance, toml
from cosim.scenario.aircraft import DEFAULT, Aircraft, bundled, load_aircraft, of
from cosim.scenario.fault import Fault
from cosim.scenario.manoeuvre import Cruise, Manoeuvre
from cosim.scenario.own_actuator import OwnActuator
from cosim.scenario.problem import choice, problem
from cosim.scenario.tolerance import toleranced
from fdi.registry import GUESTS, SHIPPED

Feedback = Literal["measured", "iotsekf", "rtsekf", "rtsekf_flight"]
# Thresholds are trained at 200 Hz. At 50 Hz these two alarm in a hard manoeuvre without a fault, and up to 80 Hz both
# pass their thresholds
SLOW_HZ, NEED_MORE = 100, ("rfafe", "ofc_monitor")
MULTIPLIER = c.Key("multiplier", 0.2, 5.0)
SPEEDS = ("cas_kt", "mach", "tas_kt")
PATHS = (("climb_fpm", "gamma_deg"), ("bank_deg", "turn_deg_s"))  # of each pair one, or none


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Flight(_Table):
    """The point at which the aircraft is trimmed, and the air it flies through."""

    aircraft: str = DEFAULT  # a bundled name, or a folder with aircraft.toml
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


class Settings(_Table):
    """Parameters of one segment's actuator [SI]: of what flies, and of what servo and filters believe it to be."""

    truth: dict[str, float] = {}
    model: dict[str, float] = {}


class Elevator(_Table):
    """The elevator segments, by the aircraft's names: actuator technology and servo feedback."""

    model_config = ConfigDict(frozen=True, extra="allow", strict=True)
    __pydantic_extra__: dict[str, str]

    # what each segment's servo closes on; a word is for every hydraulic segment, iotsekf where nothing is said
    feedback: dict[str, Feedback]
    # on a sensor verdict the loop closes on the healthy estimate; "published": an EMA's on that of [Jay] as published
    reconfigure: bool | Literal["published"] = False
    compensate: bool = False  # while iotsekf alarms its estimate of the input fault is taken off the valve command
    # segment -> its own parameters; also written [elevator.<segment>.<technology>] name = value, or .truth and .model
    parameters: dict[str, Settings] = {}

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, raw: Any, info: ValidationInfo) -> Any:
        if not isinstance(raw, dict):
            return raw
        aircraft, default = of(info), of(info).technology
        _known_keys(raw, (*default, *cls.model_fields))
        raw = _settings(raw, default)
        technology = {name: raw.get(name, own) for name, own in default.items()}
        for name, tech in technology.items():
            if not isinstance(tech, str) or tech not in c.TECHNOLOGIES:
                raise problem("is not one of the choices", key=name, allowed=", ".join(c.TECHNOLOGIES))
        given = raw.get("feedback", {})
        word = given if isinstance(given, str) else "iotsekf"
        if word not in c.FEEDBACKS:
            raise choice(word, c.FEEDBACKS, "feedback", key="feedback")
        if not isinstance(given, str | dict):
            return raw
        filled = {name: word if tech == "hydraulic" else "measured" for name, tech in technology.items()}
        if isinstance(given, dict):
            _known_keys(given, default, "feedback.")
            filled |= given
        _check_settings(raw["parameters"], technology, aircraft)
        return {**technology, **raw, "feedback": filled}

    @property
    def ema_estimate(self) -> str:
        """Return the detector on whose estimate a reconfigured EMA closes."""
        return "ema_kalman" if self.reconfigure == "published" else "ema_kalman_flight"

    @model_validator(mode="after")
    def _filters_are_hydraulic(self):
        for name, tech in self.technology.items():
            if tech != "hydraulic" and self.feedback[name] != "measured":
                said = f"{self.feedback[name]} is a filter of hydraulic actuators, {name} is {tech}"
                raise problem(said, key=f"feedback.{name}", allowed="measured")
        return self

    @property
    def technology(self) -> dict[str, str]:
        """Return {segment: technology} in the order of the segments."""
        return dict(self.model_extra or {})


def _settings(raw, segments):
    """Return `raw` with every [elevator.<segment>.<technology>] as the word and an entry of `parameters`."""
    given = raw.get("parameters") or {}
    out, parameters = dict(raw), dict(given) if isinstance(given, dict) else {}
    for name in segments:
        if not isinstance(raw.get(name), dict):
            continue
        if len(raw[name]) != 1 or not isinstance(next(iter(raw[name].values())), dict):
            raise problem("must be a technology with its table", key=name, allowed=f"[elevator.{name}.<technology>]")
        ((out[name], table),) = raw[name].items()
        both = {k: v for k, v in table.items() if k not in Settings.model_fields}
        own = {part: table.get(part, {}) for part in Settings.model_fields}
        if not all(isinstance(values, dict) for values in own.values()):
            raise problem("must be a table", key=name, allowed=f"[elevator.{name}.<technology>.<part>]")
        parameters[name] = {part: {**both, **values} for part, values in own.items()}
    return {**out, "parameters": parameters}


def _check_settings(parameters, technology, aircraft):
    """Raise for a parameter that the segment's actuator has not, or a value far from its nominal one."""
    _known_keys(parameters, technology, "parameters.")
    for name, table in parameters.items():
        tech, tables = c.TECHNOLOGIES[technology[name]], table if isinstance(table, dict) else {}
        nominal = {k: v for k, v in tech.parameters(aircraft.own(tech.name)).items() if k not in tech.fixed}
        for part, values in tables.items():
            for key, value in values.items() if isinstance(values, dict) else ():
                place = f"parameters.{name}.{part}.{key}"
                if key not in nominal:
                    raise choice(key, nominal, f"parameter of {tech.article} actuator", key=place)
                _within(value, nominal[key], place, tolerance.meanings(tech.name)[key][1])


def _within(value, nominal, place, unit):
    low, high = sorted((MULTIPLIER.low * nominal, MULTIPLIER.high * nominal))
    low, high = (0.0, 0.1) if nominal == 0.0 else (low, high)  # a backlash
    said = f"{low:.4g} to {high:.4g} {unit}".strip()
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise problem("must be a valid number", key=place, allowed=said)
    if not low <= value <= high:
        raise problem("is out of range", key=place, allowed=said)


def _known_keys(table, known, path=""):
    for key in table:
        if key not in known:
            raise problem(
                "unknown key", key=f"{path}{key}", allowed=", ".join(known), remedy=did_you_mean(key, known)
            )


@dataclass(frozen=True)
class SensorSetting:
    """A sensor's own deviations from its set, in its own unit; None means as in the set. `scale` is the error (0 is
    exact).
    """

    sigma: float | None = None
    bias: float | None = None
    scale: float | None = None
    delay: float | None = None
    quantum: float | None = None


class Sensors(_Table):
    """The sensor set, and a table per sensor that deviates from it."""

    model_config = ConfigDict(frozen=True, extra="allow", strict=True, allow_inf_nan=False)
    __pydantic_extra__: dict[str, dict[str, float]]

    set: Literal["transport"] = "transport"
    noise_scale: Annotated[float, Field(ge=0.0, le=100.0)] = 1.0
    reconstructed: bool = False  # the law flies on n_z and alpha less what lpv_smo estimates of faults

    @model_validator(mode="after")
    def _known(self):
        units = {**c.SENSORS, **c.ACTUATOR_SENSORS}
        for name, table in (self.model_extra or {}).items():
            if name not in units:
                raise choice(name, units, "sensor", key=name)
            keys = _sensor_keys(units[name])
            for key, value in table.items():
                if key not in keys:
                    raise problem(
                        "unknown key", key=f"{name}.{key}", allowed=", ".join(keys), remedy=did_you_mean(key, keys)
                    )
                if not keys[key].accepts(value):
                    raise problem("is out of range", key=f"{name}.{key}", allowed=keys[key].range)
        return self

    def setting(self, name: str, own: Any = lambda unit: 1.0) -> SensorSetting:
        """Return the SensorSetting of sensor `name`; `own(unit)` is what one SI `unit`, or share of a nominal value
        ("of supply", ...), is in the sensor's own unit.
        """
        table = (self.model_extra or {}).get(name, {})
        keys = _sensor_keys({**c.SENSORS, **c.ACTUATOR_SENSORS}[name])
        values = {k.split("_")[0]: v * keys[k].factor * own(keys[k].si) for k, v in table.items()}
        if "scale" in values:
            values["scale"] -= 1.0
        return SensorSetting(**values)


def _sensor_keys(units):
    keys = [c.Key("scale", 0.5, 2.0), c.Key("delay_s", 0.0, 0.15, 1.0, "s")]
    for u in units:
        keys += [
            c.Key(f"sigma_{u.suffix}", 0.0, u.limit, u.factor, u.si),
            c.Key(f"bias_{u.suffix}", -u.limit, u.limit, u.factor, u.si),
            c.Key(f"quantum_{u.suffix}", 0.0, u.limit, u.factor, u.si),
        ]
    return {k.name: k for k in keys}


class Tolerances(_Table):
    """Multipliers of what flies against its nominal value: aerodynamic coefficients, actuator parameters."""

    model_config = ConfigDict(frozen=True, extra="allow", strict=True, allow_inf_nan=False)
    __pydantic_extra__: dict[str, dict[str, float]]

    aero: dict[str, float] = {}

    @model_validator(mode="before")
    @classmethod
    def _every_group(cls, raw: Any) -> Any:
        """A table for each technology that has parameters: {technology: {parameter: multiplier}}."""
        if not isinstance(raw, dict):
            return raw
        groups = [name for name, t in c.TECHNOLOGIES.items() if t.servo]
        _known_keys(raw, ("aero", *groups))
        return {"aero": {}, **{name: {} for name in groups}, **raw}

    @model_validator(mode="after")
    def _known(self, info: ValidationInfo):
        for group, table in self:
            for name, value in table.items():
                known = of(info).multipliers if group == "aero" else toleranced(group)
                if name not in known:
                    raise choice(name, known, "parameter that has a tolerance", key=f"{group}.{name}")
                if not MULTIPLIER.accepts(value):
                    raise problem("is out of range", key=f"{group}.{name}", allowed=MULTIPLIER.range)
        return self


def _parameter(value):
    """Return a detector's parameter: a finite number, true or false, or a word."""
    if isinstance(value, bool | str):
        return value
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise problem("is no finite number", allowed="a finite number")
    return float(value)


Parameter = Annotated[Any, BeforeValidator(_parameter)]


class Law(_Table):
    """The control law: a file with one's own, or gains of the shipped one (cosim/flight/own_law.py)."""

    model_config = ConfigDict(frozen=True, extra="allow", strict=True, allow_inf_nan=False)
    __pydantic_extra__: dict[str, float]

    file: str | None = None

    @property
    def gains(self) -> dict[str, float]:
        """Return {gain: value} as written."""
        return dict(self.model_extra or {})


class Detectors(_Table):
    """The detectors that run, and a table of parameters for each."""

    model_config = ConfigDict(frozen=True, extra="allow", strict=True, allow_inf_nan=False)
    __pydantic_extra__: dict[str, dict[str, Parameter]]

    enabled: Annotated[tuple[str, ...], Field(strict=False)] = tuple(SHIPPED)

    @model_validator(mode="before")
    @classmethod
    def _every(cls, data):
        """Enable every detector there is, those of the table's files among them, where none is chosen."""
        if isinstance(data, dict) and "enabled" not in data:
            named = [name for name, own in data.items() if isinstance(own, dict) and "file" in own]
            own = {n: {"file": g.file, "sha256": g.sha256} for n, g in GUESTS.items() if g.file and n not in data}
            return {"enabled": [*SHIPPED, *dict.fromkeys((*GUESTS, *named))], **own, **data}
        return data

    @model_validator(mode="after")
    def _known(self):
        for i, name in enumerate(self.enabled):
            if not self._may_be(name):
                raise choice(name, (*SHIPPED, *GUESTS), "detector", key=f"enabled.{i}")
            if name in self.enabled[:i]:
                raise problem(f"{name!r} is listed twice", key=f"enabled.{i}", remedy="Remove one")
        for name in self.model_extra or {}:
            if not self._may_be(name):
                raise choice(name, ("enabled", *SHIPPED, *GUESTS), "detector", key=name)
        return self

    def _may_be(self, name):
        """Tell whether `name` is a detector, or one whose file the scenario names."""
        return name in SHIPPED or name in GUESTS or "file" in self.table(name)

    def table(self, name: str) -> Any:
        """Return {parameter: value} of detector `name` as written; of a guest its file and digest are among them."""
        return dict((self.model_extra or {}).get(name, {}))


class Scenario(_Table):
    """A flight: where, with what, doing what, and what goes wrong."""

    title: str = ""
    duration_s: Annotated[float, Field(gt=0.0, le=36000.0)] = 30.0
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 1
    rate_hz: Annotated[int, Field(ge=50, le=2000)] = 200
    flight: Flight
    manoeuvre: Manoeuvre = Cruise()
    actuators: dict[str, OwnActuator] = {}  # technologies that the scenario brings along
    elevator: Elevator
    law: Law = Law.model_validate({})
    sensors: Sensors = Sensors.model_validate({})
    tolerances: Tolerances = Tolerances.model_validate({})
    faults: Annotated[tuple[Fault, ...], Field(strict=False)] = ()
    detectors: Detectors = Field(default_factory=lambda: Detectors.model_validate({}))  # guests may have come since

    @model_validator(mode="before")
    @classmethod
    def _every_segment(cls, raw: Any) -> Any:
        return {**raw, "elevator": raw.get("elevator", {})} if isinstance(raw, dict) else raw

    @model_validator(mode="after")
    def _together(self):
        if not self.ticks:
            said = f"is less than a tick at {self.rate_hz} Hz"
            raise problem(said, key="duration_s", allowed=f"{self.dt:g} to 36000")
        conflict.check(self.faults, self.elevator.technology)
        for i, fault in enumerate(self.faults):
            for other in fault.others():
                if other == i or other >= len(self.faults):
                    said = "a fault cannot wait for itself" if other == i else f"there is no fault {other}"
                    allowed = ", ".join(f"fault.{k}" for k in range(len(self.faults)) if k != i)
                    raise problem(said, key=f"faults.{i}.when", allowed=allowed)
        return self

    @property
    def running(self) -> tuple[str, ...]:
        """Return the detectors that run: those enabled, and the filters that servos close on."""
        feedback = dict.fromkeys(self.elevator.feedback.values())
        closed: list[str] = [name for name in feedback if name != "measured"]
        if self.elevator.reconfigure and "ema" in self.elevator.technology.values():
            closed.append(self.elevator.ema_estimate)
        hydraulic = [n for n, t in self.elevator.technology.items() if t == "hydraulic"]
        if self.elevator.reconfigure and any(self.elevator.feedback[n] == "measured" for n in hydraulic):
            closed.append("rtsekf_flight")
        if self.elevator.compensate and hydraulic:
            closed.append("iotsekf")
        if self.sensors.reconstructed:
            closed.append("lpv_smo")
        return tuple(dict.fromkeys([*self.detectors.enabled, *closed]))

    @property
    def brought(self) -> tuple[str, ...]:
        """Return the files and folders of aircraft, law and actuators that are not shipped: to fly is to run them."""
        own = [self.flight.aircraft] if self.flight.aircraft not in bundled() else []
        own += [a.file or a.fmu or "" for a in self.actuators.values()]
        return (*own, self.law.file) if self.law.file else tuple(own)

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

    def injections(self) -> Any:
        """Return the faults as a flat tuple of Injection: one per fault and member of its target, SI."""
        return tuple(j for i, f in enumerate(self.faults) for j in f.injections(i, self.elevator.technology))

    def warnings(self) -> list[str]:
        """Return lines about what is legal and probably not meant."""
        late = [(i, f) for i, f in enumerate(self.faults) if f.start_s >= self.duration_s and not f.waits]
        lines = [
            f"faults.{i} ({f.kind}) starts at {f.start_s:g} s, after the flight's end at {self.duration_s:g} s"
            if f.when is None
            else f"faults.{i} ({f.kind}) never began: {f.when} did not come true"
            for i, f in late
        ]
        coarse = [name for name in NEED_MORE if name in self.running]
        if self.rate_hz < SLOW_HZ and coarse:
            said = f"below {SLOW_HZ} {', '.join(coarse)} may alarm in a manoeuvre without a fault"
            lines.append(f"rate_hz = {self.rate_hz}: {said}")
        for i, f in enumerate(self.faults):
            rate, limit = ((f.model_extra or {}).get(k, 0.0) for k in ("rate_deg_s", "limit_deg"))
            if rate * limit < 0.0 and f.target != "stabiliser":  # the others trim at zero
                said = f"drives away from limit_deg = {limit:g}: a surface that is past it stays there"
                lines.append(f"faults.{i} (runaway) {said}")
        return lines

    def expanded_toml(self) -> Any:
        """Return the whole scenario with every default as TOML; loading it gives an equal scenario."""
        return toml.dumps(self.model_dump(mode="python", exclude_none=True))
