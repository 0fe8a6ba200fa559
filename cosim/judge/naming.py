"""Whether a name given to a fault is right: its class and its place, each right, wrong or not given.

The truth is the fault's alone (`true_classes`, `true_places`), never a detector's record, so that names compare
between detectors. `ambiguous` is a class not given. A place counts by what it excludes: an engine or a sensor by its
number or name (channel), an actuator by segment, side or axis, and what is wrong inside it (channel: valve, command,
surface, a sensor), the finest of which is `level`. A set of parts ("q or theta", "sensor") that holds the right one is
a place not given, at level `set`; one that does not is wrong.
"""

import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from cosim.judge.coverage import BLIND, DESIGNED, expected, inside, true_classes
from cosim.scenario.catalog import LOOP_SENSOR

AMBIGUOUS, SENSOR = "ambiguous", "sensor"
RIGHT, WRONG, NOT_GIVEN = "right", "wrong", "not given"
# levels of a place, from coarse to fine
SET, AXIS, SIDE, SEGMENT, CHANNEL = "set", "axis", "side", "segment", "channel"
LEVELS = ("", SET, AXIS, SIDE, SEGMENT, CHANNEL)
BOTH = " and "  # between parts that are blamed together
EITHER = " or "  # between parts of which one is blamed


@dataclass(frozen=True)
class Name:
    """How a name stands to a fault."""

    class_: str  # RIGHT, WRONG or NOT_GIVEN
    place: str  # likewise
    level: str  # finest level at which the place is right, "" where it is not
    elsewhere: bool = False  # it names another fault that is there, and not this one

    @property
    def right(self) -> bool:
        """Whether both class and place are right."""
        return self.class_ == RIGHT and self.place == RIGHT

    @property
    def wrong(self) -> bool:
        """Whether class or place is wrong."""
        return WRONG in (self.class_, self.place)


def name_of(fault: Mapping, level: str, verdict: str, part: str, others: Sequence[Mapping] = ()) -> Name:
    """Return how class `verdict` and `part` ("" for none, several with BOTH between) stand to `fault`.

    `fault` has `case`, `kind` and `targets` (cosim.judge.result.judged), `level` is the detector's, "local" on the
    segment that it watches or "aircraft". Every part blamed must be one of this fault or of the `others`, which are
    there at the same time: an accused part that is healthy makes the place wrong. What names one of the `others` and
    not this fault is said of that one.
    """
    mine = _name(fault, level, verdict, part, others)
    theirs = [] if mine.right else [_name(f, level, verdict, part, (fault,)) for f in others]
    if any(name.right or (part and name.place == RIGHT and mine.place == WRONG) for name in theirs):
        return Name(NOT_GIVEN, NOT_GIVEN, "", elsewhere=True)
    return mine


def _name(fault, level, verdict, part, others):
    """Return the Name of what is said, taken as said of `fault`."""
    right = verdict in true_classes(fault.get("case") or "", fault.get("kind") or "")
    class_ = NOT_GIVEN if verdict in ("none", AMBIGUOUS) else RIGHT if right else WRONG
    if part:
        return Name(class_, *_place(fault, level, part.split(BOTH), others))
    if level == "local" and verdict != SENSOR:  # the segment that it watches is the place; which sensor is the name
        return Name(class_, RIGHT, SEGMENT)
    return Name(class_, NOT_GIVEN, "")


def _place(fault, level, parts, others):
    """Return (RIGHT, WRONG or NOT_GIVEN; finest level) of the places `parts` for `fault`."""
    accused = all(any(members_of([p], f, level) for f in (fault, *others)) for p in parts)
    finest = [max((_level(p, t, level, fault) for p in parts), key=LEVELS.index) for t in true_places(fault)]
    if not accused or "" in finest:
        return WRONG, ""
    return (NOT_GIVEN, SET) if SET in finest else (RIGHT, min(finest, key=LEVELS.index))


def blames(part: str, fault: Mapping, level: str) -> bool:
    """Return whether every place of `fault` is one that `part` names, perhaps several with BOTH between."""
    parts = [p for p in part.split(BOTH) if p]
    return bool(parts) and all(any(_level(p, t, level, fault) for p in parts) for t in true_places(fault))


def members_of(parts: Iterable[str], fault: Mapping, level: str) -> list[str]:
    """Return those of `parts` that name at least one place of `fault`."""
    return [p for p in parts if p and any(_level(p, t, level, fault) for t in true_places(fault))]


def alike(faults: Iterable[Mapping]) -> list[list[Mapping]]:
    """Return `faults` in groups that no name can tell apart: of one case and kind on the same targets."""
    groups: dict[tuple, list[Mapping]] = {}
    for f in faults:
        groups.setdefault((f.get("case"), f.get("kind"), f["targets"]), []).append(f)
    return list(groups.values())


def parts_of(fault: Mapping) -> set[str]:
    """Return the parts that a fault acts on: of an actuator's sensor the actuator."""
    return {".".join(target.split(".")[:2]) for target in fault["targets"]}


def true_places(fault: Mapping) -> tuple[str, ...]:
    """Return where a fault is: its targets, with the sensor that closes the loop where that is what is wrong."""
    technology, _, kind = (fault.get("case") or "").partition(".")
    loop = LOOP_SENSOR.get(technology, "") if kind == "jam_liquid" or kind.endswith("@sensor") else ""
    return tuple(f"{t}.{loop}" if loop and t.count(".") == 1 else t for t in fault["targets"])


def _level(part, target, level, fault):
    """Return at which of LEVELS `part` names `target` of `fault`, "" where it names another place."""
    names = _names(target, level, fault.get("case") or "", fault["targets"])
    if EITHER in part:
        return SET if any(p in names for p in part.split(EITHER)) else ""
    return names.get(part, "")


@functools.lru_cache(maxsize=4096)
def _names(target, level, case, targets):
    """Return {part: its one of LEVELS} of the names that a detector of `level` has for `target`, one of the `targets`
    of a fault."""
    place, *rest = target.split(".")
    if place == "engine":
        return {"engine": AXIS, "thrust": AXIS} | {f"engine_{n}": CHANNEL for n in rest}
    if place == "sensor":
        return ({SENSOR: SET} if level != "local" else {}) | {rest[0]: CHANNEL}
    if place != "elevator":
        return {place: AXIS, "_".join((place, *rest)): CHANNEL}
    if level == "local":
        return {sensor: CHANNEL for sensor in rest[1:]}
    segments = {t.split(".")[1] for t in targets}
    sides, side = {s.split("_")[0] for s in segments}, rest[0].split("_")[0]
    names = {"elevator": AXIS, f"elevator_{side}": SIDE, f"elevator_{rest[0]}": SEGMENT}
    whole = {AXIS: len(sides) > 1, SIDE: len(sides) == 1 < len(segments), SEGMENT: True}
    within = {f"{n}_{inside(case)}": CHANNEL if whole[at] else at for n, at in names.items()} if inside(case) else {}
    return names | within


def outcome(
    detector: str, case: str, *, seen: bool, class_: str = NOT_GIVEN, place: str = NOT_GIVEN, able: bool = True,
    masked: bool = False,
) -> str:  # fmt: skip
    """Return what came of a case: one word.

    named       seen, class and place of the last name right
    ambiguous   seen, nothing wrong in the name, but class or place not given
    misnamed    seen, class or place wrong
    missed      designed for it, could judge, and missed it
    masked      likewise, but the alarm of an earlier fault of the same part stood all the time
    quiet       not designed for it, and quiet
    not_valid   could not judge
    bonus       an alarm though blind to it by structure: not of the fault itself
    """
    word = expected(detector, case)
    if not seen:
        return "not_valid" if not able else "quiet" if word != DESIGNED else "masked" if masked else "missed"
    if word == BLIND:
        return "bonus"
    given = Name(class_, place, "")
    return "misnamed" if given.wrong else "named" if given.right else "ambiguous"
