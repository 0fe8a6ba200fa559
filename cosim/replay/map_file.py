"""The map of `cosim replay --map`: which channels of a foreign recording are which of our signals, in which unit.

README.md has an example and what each key means. Signals are named by the words of cosim/scenario/vocabulary.py:
sensors (`alpha`), sensors of an actuator (`left_inner.rod`), commands of the law (`de_cmd`), the command sent to an
actuator (`left_inner.valve_command`), the modelled hinge moment (`left_inner.hm0`, `.hmd`), or in place of these two a
measured one (`left_inner.hinge_moment`). In SI,

    value = sign scale (unit -> SI) channel + offset

A channel is a column of the table, or `/topic.field` of an MCAP file.
"""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo

from cosim.replay.log_schema import ReplayError
from cosim.scenario.problem import Origin, Problems, Table, checked, within
from cosim.texts import read, toml


class Signal(Table, strict=False):
    """One signal of the map: a channel and how its numbers become SI, or a constant in SI."""

    channel: str | None = None
    constant: float | None = None
    absent: bool = False  # no channel of the recording holds it: the detectors read a sensor that is lost all along
    unit: str | None = None  # default: the signal's SI unit
    scale: float = 1.0
    sign: Literal[1, -1] = 1
    offset: float = 0.0  # [SI]
    resample: Literal["linear", "hold"] | None = None  # between samples farther apart than a tick
    max_gap_s: Annotated[float, within(0.0, open_low=True)] | None = None
    valid: str | None = None  # channel above 0.5 where the sample is one
    missing: float | None = None  # a number of the channel that stands for a lost sample, -9999 say
    held: bool = False  # of a command to an actuator: what acted until the sample's time; else what is sent at it

    def mistakes(self, wrong: Problems, info: ValidationInfo) -> None:
        """Check that the numbers have one source."""
        if sum((self.channel is not None, self.constant is not None, self.absent)) != 1:
            wrong.add("needs a channel or a constant, or absent = true")


class Map(Table, strict=False):
    """A map file; `flight`, `elevator` and `detectors` are a scenario's tables and checked as such."""

    title: str = ""
    rate_hz: Annotated[int, within(50, 2000)] = 200
    time: str | None = None  # the clock: a column or field, "NAME [us]" with its unit, log_time or publish_time
    aircraft: str = ""  # that was recorded: of a detector designed for another one the caveats say so
    flight: dict = Field(default_factory=dict)
    elevator: dict = Field(default_factory=dict)
    detectors: dict = Field(default_factory=dict)
    signals: dict[str, Signal]


def load_map(path: str | Path) -> tuple[Map, str]:
    """Return (Map, its text) of a TOML file. Raises ReplayError with file and key."""
    place = str(path)
    try:
        text = read(path, error=ReplayError, what="map")
    except FileNotFoundError:
        raise ReplayError("there is no such file", place=place) from None
    table = toml(text, place=place, error=ReplayError)
    return checked(Map, table, Origin(place, text), ReplayError), text
