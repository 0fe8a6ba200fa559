"""Manoeuvres a scenario can fly, each with its own few numbers."""

from typing import Annotated, Any, Literal, get_args

from pydantic import Field, PlainValidator, ValidationInfo, model_validator

from cosim.errors import did_you_mean
from cosim.scenario.inputs import Inputs
from cosim.scenario.problem import MISSING, Seconds, Table, problem

Length = Annotated[float, Field(gt=0.0, le=3600.0)]
LoadFactor = Annotated[float, Field(ge=-1.5, le=1.5)]


class _Manoeuvre(Table):
    hold_speed: bool = False  # the throttles hold the speed; a climb, descent or turn from the start has it anyway


class Cruise(_Manoeuvre):
    """Hold the trimmed flight, hands off."""

    kind: Literal["cruise"] = "cruise"


class AoaProtection(_Manoeuvre):
    """Pull the stick (a share of full travel) and hold it: the angle-of-attack protection takes over."""

    kind: Literal["aoa_protection"]
    start_s: Seconds = 5.0
    duration_s: Length = 20.0
    stick: Annotated[float, Field(ge=0.1, le=1.0)] = 1.0


class NoseUp(_Manoeuvre):
    """Pull abruptly for a short time."""

    kind: Literal["nose_up"]
    start_s: Seconds = 5.0
    duration_s: Length = 2.0
    amplitude_g: Annotated[float, Field(ge=0.05, le=1.5)] = 0.5


class PitchProtection(_Manoeuvre):
    """Pull gently for long, until the pitch-attitude protection takes over."""

    kind: Literal["pitch_protection"]
    start_s: Seconds = 5.0
    duration_s: Length = 20.0
    amplitude_g: Annotated[float, Field(ge=0.05, le=1.0)] = 0.3


class CoordinatedTurn(_Manoeuvre):
    """Bank, hold, and roll out."""

    kind: Literal["coordinated_turn"]
    hold_speed: bool = True
    start_s: Seconds = 5.0
    duration_s: Length = 60.0
    bank_deg: Annotated[float, Field(ge=-60.0, le=60.0)] = 30.0


class YawAngle(_Manoeuvre):
    """Change the heading by an angle and hold it (heading-hold mode)."""

    kind: Literal["yaw_angle"]
    hold_speed: bool = True
    start_s: Seconds = 5.0
    heading_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = 10.0


class NzDoublet(_Manoeuvre):
    """Demand load factor up and down, each for a width."""

    kind: Literal["nz_doublet"]
    start_s: Seconds = 5.0
    width_s: Length = 3.0
    amplitude_g: LoadFactor = 0.15


class ThreeTwoOneOne(_Manoeuvre):
    """Alternate pulses of 3, 2, 1 and 1 units, as a load-factor demand or added to the elevator command."""

    kind: Literal["three_two_one_one"]
    start_s: Seconds = 5.0
    unit_s: Length = 1.0
    amplitude_g: LoadFactor | None = None
    amplitude_deg: Annotated[float, Field(ge=-15.0, le=15.0)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _one_amplitude(cls, raw: Any) -> Any:
        given = [k for k in ("amplitude_g", "amplitude_deg") if isinstance(raw, dict) and raw.get(k) is not None]
        if len(given) > 1:
            raise problem(f"{' and '.join(given)} exclude each other", key=given[1], remedy="Keep one of them")
        # stays inside the load factor that Alwi14's point C has left
        return {**raw, "amplitude_g": 0.15} if isinstance(raw, dict) and not given else raw


_EVERY = (
    Cruise, AoaProtection, NoseUp, PitchProtection, CoordinatedTurn, YawAngle, NzDoublet, ThreeTwoOneOne, Inputs
)  # fmt: skip
KINDS: dict[str, type[Table]] = {get_args(kind.model_fields["kind"].annotation)[0]: kind for kind in _EVERY}


def _of_its_kind(raw: Any, info: ValidationInfo) -> Any:
    """Return the manoeuvre of a table, of the class that its kind names."""
    if not isinstance(raw, dict):
        raise problem("must be a table")
    kind, choices = raw.get("kind"), ", ".join(KINDS)
    if not isinstance(kind, str) or kind not in KINDS:
        said = "is no manoeuvre" if "kind" in raw else MISSING
        raise problem(said, key="kind", allowed=choices, remedy=did_you_mean(kind or "", KINDS))
    return KINDS[kind].model_validate(raw, context=info.context)


Manoeuvre = Annotated[Any, PlainValidator(_of_its_kind)]
