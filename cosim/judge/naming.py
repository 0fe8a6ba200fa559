"""Whether what a lane says is the right name of a fault: its class, and the part that it blames.

A name says the class. `ambiguous` is none, with one exception: where a detector cannot tell the class by structure
(its record expects nothing but `ambiguous`), the part that it blames is the name.
"""

from collections.abc import Iterable

from cosim.judge.coverage import BLIND, DESIGNED, expected

AMBIGUOUS, SENSOR = "ambiguous", "sensor"
BOTH = " and "  # between parts that are blamed together


def right(detector: str, case: str, targets: Iterable[str], level: str, verdict: str, culprit: str) -> bool:
    """Return whether class `verdict` and part `culprit` ("" for none) are the right name of a fault.

    `case` and `targets` are those of the fault (cosim.judge.result.judged).
    """
    classes = set(expected(detector, case).classes)
    if verdict == AMBIGUOUS:
        return classes == {AMBIGUOUS} and culprit != "" and blames(culprit, targets, level)
    if verdict not in classes:
        return False
    return blames(culprit, targets, level) if culprit else verdict != SENSOR


def blames(culprit: str, targets: Iterable[str], level: str) -> bool:
    """Return whether every one of `targets` is what `culprit` names, perhaps several parts with " and " between."""
    return all(any(_is(part, target, level) for part in culprit.split(BOTH)) for target in targets)


def members_of(culprits: Iterable[str], targets: Iterable[str], level: str) -> list[str]:
    """Return those of `culprits` that name at least one of `targets`."""
    targets = list(targets)
    return [c for c in culprits if c and any(_is(c, t, level) for t in targets)]


def outcome(
    detector: str, case: str, *, seen: bool, is_right: bool = False, verdict: str | None = None, able: bool = True
) -> str:
    """Return what came of a case: one word.

    named       seen, and the last name is right
    ambiguous   seen, and called ambiguous or nothing
    misnamed    seen under another name
    missed      designed for it, could judge, and missed it
    quiet       not designed for it, and quiet
    idle        could not judge
    bonus       an alarm though blind to it by structure: not of the fault itself
    """
    word = expected(detector, case).word
    if not seen:
        return "idle" if not able else "missed" if word == DESIGNED else "quiet"
    if word == BLIND:
        return "bonus"
    if is_right:
        return "named"
    return "ambiguous" if verdict in (None, "none", AMBIGUOUS) else "misnamed"


def _is(part, target, level):
    place, *rest = target.split(".")
    if place == "elevator" and level == "local":  # its culprits are sensors; a fault of none may be blamed on any
        return part == rest[1] if len(rest) > 1 else True
    if place == "elevator":
        return part in ("elevator", f"elevator_{rest[0].split('_')[0]}", f"elevator_{rest[0]}")
    if place == "engine":
        return part in ("engine", "thrust", f"engine_{rest[0]}")
    return part == (rest[0] if place == "sensor" else place)
