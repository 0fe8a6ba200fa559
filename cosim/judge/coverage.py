"""What is expected of which detector for which fault, and what came of it.

A detector's record says it: designed for, may see, otherwise blind by structure. A case is the fault as a detector
meets it: <technology>.<kind>, with @command or @sensor where an oscillation, runaway, bias or loss of effectiveness
enters before the servo or in the loop's sensor (no suffix: at the valve or drive); <technology>.<sensor> for a fault of
an actuator's sensor; aileron, rudder, stabiliser, engine; sensor.<name> for an aircraft sensor.
"""

import fnmatch
from collections.abc import Mapping
from dataclasses import dataclass

from cosim.scenario import Scenario
from cosim.scenario.catalog import ACTUATOR_SENSORS
from fdi import registry
from fdi.common.verdict import NAMES

DESIGNED, MAY, BLIND, UNDECLARED = "designed", "may", "blind", "undeclared"
WORDS = {DESIGNED: "designed for", MAY: "may see", BLIND: "blind by structure", UNDECLARED: "not declared"}
# kinds whose place of entry decides who can see them
ENTERS = ("ofc_liquid", "ofc_solid", "runaway", "bias", "loss_of_effectiveness")
PARTS = {
    "rod": "rod sensor",
    "surface": "surface sensor",
    "pressure": "pressure sensor",
    "velocity": "velocity sensor",
    "position": "position sensor",
    "current": "current sensor",
}


@dataclass(frozen=True)
class Expected:
    """How a detector stands to a case: `word` (designed, may, ...), and the verdict `classes` that are right."""

    word: str
    classes: tuple = ()


def expected(detector: str, case: str) -> Expected:
    """Return the Expected of `detector` for `case`; what its record does not say, or a detector without one, is not
    declared, and the fault's own class would be right."""
    record = registry.find(detector)
    for word, table in ((DESIGNED, record.designed_for), (MAY, record.may_see)) if record else ():
        for pattern, classes in table.items():
            if fnmatch.fnmatchcase(case, pattern):
                return Expected(word, tuple(classes))
    if record and any(fnmatch.fnmatchcase(case, pattern) for pattern in record.blind_to):
        return Expected(BLIND)
    return Expected(UNDECLARED, (true_class(case),))


def true_class(case: str) -> str:
    """Return the verdict class that names a case: its kind where that is a class, "sensor" for a sensor's fault."""
    group, _, rest = case.partition(".")
    kind = (rest or group).partition("@")[0]
    if group == "sensor" or kind in ACTUATOR_SENSORS:
        return "sensor"
    others = {"engine": "thrust", "jam": "jam_solid", "rudder": "jam_solid", "aileron": "jam_solid"}
    return kind if kind in NAMES else others.get(kind, "effectiveness" if rest else "ambiguous")


def group(detector: str, level: str) -> str:
    """Return what a detector draws on, in words; its level where its record does not say."""
    return getattr(registry.find(detector), "group", "") or f"{level} level"


def remark(detector: str) -> str:
    """Return what has to be said whenever results of a detector are shown, or an empty text."""
    return getattr(registry.find(detector), "remark", "")


def case_of(kind: str, target: str, technology: Mapping[str, str], at: str = "", limit: bool = False) -> str:
    """Return the case of a fault: `target` as a scenario writes it, `technology` {segment: name}.

    `at` is the place of entry, `limit` whether a runaway goes to a limit (the command then runs, not the valve). A
    target of several segments is named after its first one.
    """
    place, *rest = target.split(".")
    if place != "elevator":
        return {"sensor": f"sensor.{rest[0]}" if rest else "sensor"}.get(place, place)
    segment = next((s for s in technology if s == rest[0] or s.startswith(rest[0] + "_") or rest[0] == "all"), rest[0])
    tech = technology.get(segment, "simple")
    if len(rest) > 1:
        return f"{tech}.{rest[1]}"
    if kind == "runaway" and (limit or tech == "ema"):  # inject: without a valve, or to a limit, the demand runs
        at = "command"
    tail = f"@{at}" if kind in ENTERS and at in ("command", "sensor") else ""
    return f"{tech}.{kind}{tail}"


def cases(scenario: Scenario) -> list[str]:
    """Return the case of each fault of a scenario, in its order."""
    technology = scenario.elevator.technology
    return [
        case_of(f.kind, f.target, technology, f.at or "", "limit_deg" in (f.model_extra or {})) for f in scenario.faults
    ]


def label(case: str) -> str:
    """Return a case in words: "hydraulic: OFC liquid", "sensor alpha"."""
    group, _, rest = case.partition(".")
    if not rest:
        return group
    if group == "sensor":
        return f"aircraft sensor {rest}"
    kind, _, at = rest.partition("@")
    words = PARTS.get(kind, kind.replace("ofc_", "OFC ").replace("_", " "))
    return f"{group}: {words}" + (f", in the {at}" if at else "")
