"""What is expected of which detector for which fault, and what came of it.

A detector's record says it: designed for, may see, otherwise blind by structure. A case is the fault as a detector
meets it: <technology>.<kind>, with @command or @sensor where an oscillation, runaway, bias or loss of effectiveness
enters before the servo or in the loop's sensor (no suffix: at the valve or drive); <technology>.<sensor> for a fault of
an actuator's sensor; aileron, rudder, stabiliser, engine; sensor.<name> for an aircraft sensor.
"""

import fnmatch
from collections.abc import Mapping

from cosim.scenario import Scenario
from cosim.scenario.catalog import ACTUATOR_SENSORS, LOOP_SENSOR
from fdi import registry
from fdi.common.verdict import NAMES

DESIGNED, MAY, BLIND, UNDECLARED = "designed", "may", "blind", "undeclared"
WORDS = {DESIGNED: "designed for", MAY: "may see", BLIND: "blind by structure", UNDECLARED: "not declared"}
# kinds whose place of entry decides who can see them
ENTERS = ("ofc_liquid", "ofc_solid", "runaway", "bias", "loss_of_effectiveness")


def expected(detector: str, case: str) -> str:
    """Return how `detector` stands to `case`: designed, may, blind; what its record does not say, or a detector without
    one, is not declared."""
    record = _record(detector)
    if not record:
        return UNDECLARED
    told = {DESIGNED: record.designed_for, MAY: record.may_see, BLIND: record.blind_to}
    return next((w for w, cases in told.items() if any(fnmatch.fnmatchcase(case, c) for c in cases)), UNDECLARED)


TRUE = {  # kind of a fault -> verdict classes that name it, the usual one first
    "jam_liquid": ("jam_liquid", "sensor"),
    "jam": ("jam_solid",),
    "hardover": ("runaway",),
    "bias": ("jam_liquid",),  # of the command: the surface stands off by it
    "engine": ("thrust",),
}
LOOP = ("rod", "position")  # sensors whose offset closes a loop in the wrong place: a liquid jam [Lu17]


def true_classes(case: str, kind: str = "") -> tuple[str, ...]:
    """Return the verdict classes that name a case, the usual one first; the same for every detector.

    An actuator that obeys too little (loss of effectiveness, supply, leakage, soft oil, magnets, winding, friction,
    backlash, free float) is "effectiveness". `kind` is that of the fault, where the case does not tell: of another
    surface (jam or runaway) and of a sensor that oscillates in its actuator's loop.
    """
    group, _, rest = case.partition(".")
    what, _, at = (rest or group).partition("@")
    if group in ("aileron", "rudder", "stabiliser"):
        return {"jam": ("jam_solid",), "runaway": ("runaway",)}.get(kind, ("jam_solid", "runaway"))
    if what in LOOP:
        jams, swings = kind in ("", "bias"), kind == "oscillation"
        return ("sensor", *("jam_liquid",) * jams, *("ofc_liquid",) * swings)
    if group == "sensor" or what in ACTUATOR_SENSORS:
        return ("sensor",)
    named = TRUE.get(what, (what,) if what in NAMES else ("effectiveness",) if rest else ())
    return (*named, "sensor") if at == "sensor" and what in ("ofc_liquid", "bias") else named


MECHANICAL = ("jam_solid", "jam", "free_float", "friction", "backlash")  # from the rod to the surface


def inside(case: str) -> str:
    """Return what is wrong inside an elevator's actuator: "valve" (with its oil, "drive" if electromechanical),
    "command", "surface" (all that is mechanical) or "<name>_sensor"; "" for a case of another part."""
    technology, _, rest = case.partition(".")
    kind, _, at = rest.partition("@")
    if not rest or technology in ("sensor", "simple"):
        return ""
    if at == "sensor" or kind == "jam_liquid":
        kind = LOOP_SENSOR.get(technology, "")
    if kind in ACTUATOR_SENSORS or not kind:
        return kind and f"{kind}_sensor"
    return at if at == "command" else "surface" if kind in MECHANICAL else "drive" if technology == "ema" else "valve"


def true_class(case: str) -> str:
    """Return the usual verdict class of a case, "ambiguous" where no class names it."""
    return next(iter(true_classes(case)), "ambiguous")


def group(detector: str, level: str) -> str:
    """Return what a detector draws on, in words; its level where its record does not say."""
    return getattr(_record(detector), "group", "") or f"{level} level"


def level(detector: str) -> str:
    """Return the level of a detector: local, aircraft or both; "" of one without a record."""
    return getattr(_record(detector), "level", "")


def _record(detector):
    """Return the record of a detector, also of "name (campaign)" where two campaigns stand side by side."""
    return registry.find(detector.partition(" ")[0])


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
    words = f"{kind} sensor" if kind in ACTUATOR_SENSORS else kind.replace("ofc_", "OFC ").replace("_", " ")
    return f"{group}: {words}" + (f", in the {at}" if at else "")
