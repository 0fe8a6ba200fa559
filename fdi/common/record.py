"""The record of a detector: what a loop, a log, a judgement and a report need to know about it, in its own module.

A module of a detector is a block (actuators/block.py) with ISOLABLE_PARTS, the names of what it can blame, the first
being "" for none, and DETECTOR, its record. A loop that flies it makes its parameters by `DETECTOR.fit(site)`.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

# of the detectors that ship
GROUPS = ("airframe motion", "elevator positions", "actuator filters", "monitors", "both levels")
TICK = 0.005  # of the flights that thresholds were trained on [s]
LEARN_S = 8.0  # for which observers of the aircraft learn in flight: the papers' faults come at 10 s [s]
Cases = Mapping[str, tuple[str, ...]]  # case -> verdict classes that name it right


@dataclass(frozen=True)
class Site:
    """What a loop tells a detector about the place where it is to work."""

    dt: float  # its tick [s]
    lane: str = ""  # the actuator that it watches; "" at aircraft level
    technology: str = ""  # of that actuator
    technologies: Mapping[str, str] = field(default_factory=dict)  # of all elevator segments
    delay: Callable[[str], float] = lambda word: 0.0  # age of a measurement [s], by its word
    aircraft: Callable[[], Any] = lambda: None  # what is known of the aircraft: force model, gyration, its actuators
    # parameters of the watched actuator, as far as they are believed to differ from its technology's design [SI]
    actuator: Mapping[str, float] = field(default_factory=dict)
    # folder of an aircraft with designs/ and thresholds/ of its own, None: those that `fdi` brings are this aircraft's
    own: Any = None
    travel: tuple[float, float] | None = None  # stops of the elevator [rad], None: those of the technology's design

    def known(self, names: Sequence[Any]) -> dict[str, float]:
        """Return those parameters of the actuator that are among `names`."""
        return {name: value for name, value in self.actuator.items() if name in (names or ())}

    def ticks(self, word: str) -> float:
        """Return how many ticks the measurement `word` is old."""
        return float(math.ceil(self.delay(word) / self.dt - 1e-9))


@dataclass(frozen=True)
class Estimate:
    """What an output estimates: `of` a word of the vocabulary (the fault in that reading), "valve" (what acts there
    less what the servo sent), "elevator", "elevator.left", "elevator.right" (deflection less that of a healthy
    elevator) or "thrust" (fraction of the total)."""

    of: str
    output: str
    unit: str


@dataclass(frozen=True)
class Detector:
    """One detector. Which verdicts are right stands by case, `<technology>.<kind>` (cosim/judge/coverage.py), `*` for
    any text; a case in neither table is one that the detector is blind to by its structure.
    """

    id: str
    # "local": a lane per actuator of its technologies; "aircraft": one; "both": one that reads detectors of both
    level: str
    summary: str
    inputs: Mapping[str, str]  # field of INPUTS -> word of the signal vocabulary; flags follow: <field>_valid
    technologies: tuple[str, ...] = ()
    group: str = ""  # what it draws on: with whom it stands in a comparison; default: its level
    designed_for: Cases = field(default_factory=dict)
    may_see: Cases = field(default_factory=dict)  # they can move the statistic, depending on size and motion
    blind: str = ""  # why it is blind to the rest
    blind_to: tuple[str, ...] = ("*",)  # cases that it is blind to where it is neither; beyond them: not declared
    estimates: tuple[Estimate, ...] = ()
    # parameters and states that compiled code uses as indices:
    looks_back: Mapping[str, str] = field(default_factory=dict)  # parameter: how far back -> array of STATE
    sizes: Mapping[str, float] = field(default_factory=dict)  # parameter: size or position -> its least value
    places: Mapping[str, tuple[str, int]] = field(default_factory=dict)  # state: position -> array of STATE, axis
    options: Mapping[str, tuple] = field(default_factory=dict)  # parameter that a scenario chooses by a word -> words
    belongs: Mapping[str, str] = field(default_factory=dict)  # parameter -> option that sets it, with all that follows
    any_aircraft: bool = False  # at aircraft level: made without a model of one, so that it flies on every aircraft
    design: str = ""  # the stored design that it flies with, if any
    # ({segment: technology}, folder as `Site.own`) -> why no stored design fits these elevators, or ""
    lacks: Callable[[Mapping[str, str], Any], str] = lambda technologies, own: ""
    # word of an input -> (least, largest) [SI]: outside it is not valid, learns nothing, and `why` says so
    range: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # whether it flies where a detector among its inputs does not: that input is then 0 all the time
    may_lack: bool = False
    shares: tuple[tuple[str, ...], ...] = ()  # isolable_parts whose faults one equation cannot tell apart
    # what it tells beyond class and part: output -> its value -> kinds of fault that it then means where the class
    # is open, or the part of the isolated_part, "" for all of it
    finer: Mapping[str, Mapping[int, tuple[str, ...] | str]] = field(default_factory=dict)
    # parameters where a recording has the command of a valve or motor less often than every tick
    slow: Mapping[str, float] = field(default_factory=dict)
    every: int = 1  # ticks of the loop from step to step
    fit: Callable = field(default=lambda site, **options: None)  # (site, **options) -> PARAMS of one lane
