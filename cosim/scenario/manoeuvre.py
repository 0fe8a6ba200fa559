"""Manoeuvres that a scenario can fly: each kind has its own few numbers, as a kind of fault has."""

from typing import Annotated, Any

from pydantic import PlainValidator, ValidationInfo

from actuators.technology import Key, Kind
from cosim.errors import did_you_mean
from cosim.scenario.inputs import RANGES, Inputs
from cosim.scenario.problem import Problems, Table, problem

_START = Key("start_s", 0.0, 36000.0, default=5.0)
_GENTLE = Key("amplitude_g", -1.5, 1.5, default=0.15)  # stays inside the load factor that Alwi14's point C has left


def _length(name: str, default: float) -> Key:
    return Key(name, 0.0, 3600.0, open_low=True, default=default)


KINDS = {
    "cruise": Kind("Hold the trimmed flight, hands off"),
    "aoa_protection": Kind(
        "Pull the stick (a share of full travel) and hold it: the angle-of-attack protection takes over",
        keys=(_START, _length("duration_s", 20.0), Key("stick", 0.1, 1.0, default=1.0))),
    "nose_up": Kind(
        "Pull abruptly for a short time",
        keys=(_START, _length("duration_s", 2.0), Key("amplitude_g", 0.05, 1.5, default=0.5))),
    "pitch_protection": Kind(
        "Pull gently for long, until the pitch-attitude protection takes over",
        keys=(_START, _length("duration_s", 20.0), Key("amplitude_g", 0.05, 1.0, default=0.3))),
    "coordinated_turn": Kind(
        "Bank, hold, and roll out",
        keys=(_START, _length("duration_s", 60.0), Key("bank_deg", -60.0, 60.0, default=30.0))),
    "yaw_angle": Kind(
        "Change the heading by an angle and hold it (heading-hold mode)",
        keys=(_START, Key("heading_deg", -180.0, 180.0, default=10.0))),
    "nz_doublet": Kind(
        "Demand load factor up and down, each for a width", keys=(_START, _length("width_s", 3.0), _GENTLE)),
    "three_two_one_one": Kind(
        "Alternate pulses of 3, 2, 1 and 1 units, as a load-factor demand or added to the elevator command",
        keys=(_START, _length("unit_s", 1.0)), one_of=(_GENTLE, Key("amplitude_deg", -15.0, 15.0))),
    "inputs": Kind("Fly a table of one's own stick, bank, throttle and stabiliser inputs, or a CSV file with them"),
}  # fmt: skip
HOLD_SPEED = ("coordinated_turn", "yaw_angle")  # where nothing else is said


def keys_of(kind: str) -> tuple[str, ...]:
    """Return the keys of a kind of manoeuvre."""
    if kind == "inputs":
        return tuple({**Inputs.model_fields, **RANGES})
    return "kind", "hold_speed", *(key.name for key in (*KINDS[kind].keys, *KINDS[kind].one_of))


class Manoeuvre(Table, extra="allow"):
    """What the pilot does: a kind of KINDS with its numbers."""

    __pydantic_extra__: dict[str, Any]

    hold_speed: bool  # the throttles hold the speed; a climb, descent or turn from the start has it anyway
    kind: str

    @classmethod
    def filled(cls, raw: dict[str, Any], wrong: Problems, info: ValidationInfo) -> dict[str, Any]:
        """Add the defaults of its kind."""
        given = KINDS[raw["kind"]].filled({"hold_speed": raw["kind"] in HOLD_SPEED, **raw})
        return {**{key: given[key] for key in keys_of(raw["kind"]) if key in given}, **given}

    def mistakes(self, wrong: Problems, info: ValidationInfo) -> None:
        """Check the kind's own numbers."""
        wrong.of_kind(KINDS[self.kind], self.model_extra or {}, self.kind, Manoeuvre.model_fields)


def _of_its_kind(raw: Any, info: ValidationInfo) -> Any:
    """Return the manoeuvre of a table, of the class that its kind names."""
    if not isinstance(raw, dict):
        raise problem("must be a table")
    kind, choices = raw.get("kind"), ", ".join(KINDS)
    if not isinstance(kind, str) or kind not in KINDS:
        said = "is no manoeuvre" if "kind" in raw else "is missing"
        raise problem(said, key="kind", allowed=choices, remedy=did_you_mean(kind or "", KINDS))
    return (Inputs if kind == "inputs" else Manoeuvre).model_validate(raw, context=info.context)


AnyManoeuvre = Annotated[Any, PlainValidator(_of_its_kind)]
CRUISE = Manoeuvre.model_validate({"kind": "cruise"})
