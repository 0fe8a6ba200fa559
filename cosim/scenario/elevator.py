"""[elevator]: technology, feedback and own parameters of every segment."""

from typing import Any, Literal

from pydantic import Field, ValidationInfo

from actuators.technology import Key
from cosim.scenario import catalog as c
from cosim.scenario import tolerance
from cosim.scenario.aircraft import of
from cosim.scenario.problem import MULTIPLIER, Problems, Table, choice, problem

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

    @classmethod
    def filled(cls, raw: dict[str, Any], wrong: Problems, info: ValidationInfo) -> dict[str, Any]:
        """Add technology and feedback of every segment."""
        default, given = of(info).technology, raw.get("feedback", {})
        wrong.unknown(raw, (*default, *cls.model_fields))
        if not isinstance(parameters := raw.get("parameters", {}), dict):
            raise problem("must be a table", key="parameters")
        known = (*(t.name for t in c.SHIPPED), *(info.context or {}).get("actuators", ()))
        technology = {name: raw.get(name, own) for name, own in default.items()}
        for name, word in technology.items():
            if isinstance(word, dict):
                technology[name], own = _with_its_table(name, word)
                parameters = {**parameters, name: own}
            if technology[name] not in known:
                wrong.add("is not one of the choices", key=name, allowed=", ".join(known))
        word = given if isinstance(given, str) else "iotsekf"
        if word not in c.FEEDBACKS:
            wrong.append(choice(word, c.FEEDBACKS, "feedback", key="feedback"))
        sources = given if isinstance(given, dict) else {}
        wrong.unknown(sources, default, "feedback.")
        wrong.unknown(parameters, default, "parameters.")
        filled = {name: word if tech == "hydraulic" else "measured" for name, tech in technology.items()}
        feedback = {**filled, **sources} if isinstance(given, str | dict) else given
        return {**technology, **raw, **technology, "feedback": feedback, "parameters": parameters}

    @property
    def ema_estimate(self) -> str:
        """Return the detector on whose estimate a reconfigured EMA closes."""
        return "ema_kalman" if self.reconfigure == "published" else "ema_kalman_flight"

    def mistakes(self, wrong: Problems, info: ValidationInfo) -> None:
        """Check that filters are of hydraulic actuators, and parameters of that one and near its nominal ones."""
        for name, tech in self.technology.items():
            if tech != "hydraulic" and self.feedback.get(name, "measured") != "measured":
                said = f"{self.feedback[name]} is a filter of hydraulic actuators, {name} is {tech}"
                wrong.add(said, key=f"feedback.{name}", allowed="measured")
        for name, settings in self.parameters.items():
            own = c.TECHNOLOGIES[self.technology[name]]
            nominal = own.parameters(of(info).own(own.name)).items()
            keys = {k: _near(k, v) for k, v in nominal if k not in own.fixed}
            what = f"{own.article} actuator"
            units = {key: unit for key, (_, unit) in tolerance.meanings(own.name).items()}
            for part, values in settings:
                wrong.numbers(values, keys, what, f"parameters.{name}.{part}.", units)

    @property
    def technology(self) -> dict[str, str]:
        """Return {segment: technology} in the order of the segments."""
        return dict(self.model_extra or {})


def _with_its_table(name, given):
    """Return (technology, table of its Settings) of [elevator.<segment>.<technology>]."""
    if len(given) != 1 or not isinstance(next(iter(given.values())), dict):
        raise problem("must be a technology with its table", key=name, allowed=f"[elevator.{name}.<technology>]")
    ((technology, table),) = given.items()
    both = {key: value for key, value in table.items() if key not in Settings.model_fields}
    parts = {part: table.get(part, {}) for part in Settings.model_fields}
    return technology, {part: {**both, **own} if isinstance(own, dict) else own for part, own in parts.items()}


def _near(name, nominal):
    """Return the Key of a parameter that may differ from its nominal value as a multiplier may; a backlash is 0."""
    low, high = sorted((MULTIPLIER.low * nominal, MULTIPLIER.high * nominal))
    return Key(name, low, high) if nominal else Key(name, 0.0, 0.1)
