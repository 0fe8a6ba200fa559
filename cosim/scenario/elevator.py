"""[elevator]: technology, feedback and own parameters of every segment."""

from typing import Any, Literal

from pydantic import Field, ModelWrapValidatorHandler, ValidationInfo, model_validator

from cosim.scenario import catalog as c
from cosim.scenario import tolerance
from cosim.scenario.aircraft import of
from cosim.scenario.problem import MULTIPLIER, Mistakes, Table, choice, known_keys, problem

Feedback = Literal["measured", "iotsekf", "rtsekf", "rtsekf_flight"]


class Settings(Table):
    """Parameters of one segment's actuator [SI]: of what flies, and of what servo and filters believe it to be."""

    truth: dict[str, float] = Field(default_factory=dict)
    model: dict[str, float] = Field(default_factory=dict)


class Elevator(Table, extra="allow"):
    """The elevator segments, by the aircraft's names: actuator technology and servo feedback."""

    __pydantic_extra__: dict[str, str]

    # what each segment's servo closes on; a word is for every hydraulic segment, iotsekf where nothing is said
    feedback: dict[str, Feedback]
    # on a sensor verdict the loop closes on the healthy estimate; "published": an EMA's on that of [Jay] as published
    reconfigure: bool | Literal["published"] = False
    compensate: bool = False  # while iotsekf alarms its estimate of the input fault is taken off the valve command
    # segment -> its own parameters; also written [elevator.<segment>.<technology>] name = value, or .truth and .model
    parameters: dict[str, Settings] = Field(default_factory=dict)

    @model_validator(mode="wrap")
    @classmethod
    def _fill(cls, raw: Any, handler: ModelWrapValidatorHandler, info: ValidationInfo) -> Any:
        wrong = Mistakes()
        return wrong.last(handler, cls._filled(raw, info, wrong) if isinstance(raw, dict) else raw)

    @classmethod
    def _filled(cls, raw, info, wrong):
        """Return `raw` with technology and feedback of every segment; what is wrong goes to `wrong`."""
        aircraft, default = of(info), of(info).technology
        with wrong.caught():
            known_keys(raw, (*default, *cls.model_fields))
        with wrong.caught():
            raw = _settings(raw, default)
        technology = {name: raw.get(name, own) for name, own in default.items()}
        known = c.technologies((info.context or {}).get("actuators", c.TECHNOLOGIES))
        for name, tech in technology.items():
            if not isinstance(tech, str) or tech not in known:
                wrong.add("is not one of the choices", key=name, allowed=", ".join(known))
        given = raw.get("feedback", {})
        word = given if isinstance(given, str) else "iotsekf"
        with wrong.caught():
            if word not in c.FEEDBACKS:
                raise choice(word, c.FEEDBACKS, "feedback", key="feedback")
        if wrong.found or not isinstance(given, str | dict):
            return {**raw, "feedback": {} if isinstance(given, str) else given}
        filled = {name: word if tech == "hydraulic" else "measured" for name, tech in technology.items()}
        if isinstance(given, dict):
            with wrong.caught():
                known_keys(given, default, "feedback.")
            filled |= given
        with wrong.caught():
            _check_settings(raw["parameters"], technology, aircraft)
        return {**technology, **raw, "feedback": filled}

    @property
    def ema_estimate(self) -> str:
        """Return the detector on whose estimate a reconfigured EMA closes."""
        return "ema_kalman" if self.reconfigure == "published" else "ema_kalman_flight"

    @model_validator(mode="after")
    def _filters_are_hydraulic(self):
        wrong = Mistakes()
        for name, tech in self.technology.items():
            if tech != "hydraulic" and self.feedback.get(name, "measured") != "measured":
                said = f"{self.feedback[name]} is a filter of hydraulic actuators, {name} is {tech}"
                wrong.add(said, key=f"feedback.{name}", allowed="measured")
        wrong.check()
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
    """Raise for every parameter that the segment's actuator has not, or a value far from its nominal one."""
    known_keys(parameters, technology, "parameters.")
    wrong = Mistakes()
    for name, table in parameters.items():
        tech, tables = c.TECHNOLOGIES[technology[name]], table if isinstance(table, dict) else {}
        nominal = {k: v for k, v in tech.parameters(aircraft.own(tech.name)).items() if k not in tech.fixed}
        for part, values in tables.items():
            for key, value in values.items() if isinstance(values, dict) else ():
                place = f"parameters.{name}.{part}.{key}"
                with wrong.caught():
                    if key not in nominal:
                        raise choice(key, nominal, f"parameter of {tech.article} actuator", key=place)
                    _within(value, nominal[key], place, tolerance.meanings(tech.name)[key][1])
    wrong.check()


def _within(value, nominal, place, unit):
    low, high = sorted((MULTIPLIER.low * nominal, MULTIPLIER.high * nominal))
    low, high = (0.0, 0.1) if nominal == 0.0 else (low, high)  # a backlash
    said = f"{low:.4g} to {high:.4g} {unit}".strip()
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise problem("must be a valid number", key=place, allowed=said)
    if not low <= value <= high:
        raise problem("is out of range", key=place, allowed=said)
