"""The vocabulary of signals: one word for what a detector reads, a map names, a log holds and a page shows.

A detector's record says `inputs = {"y_rod": "rod", "u": "valve_command"}`. A word of an actuator means that of the
detector's own lane; `left_outer.surface` names one segment, as a map does. Each word has its meaning and sign, its SI
unit, its place on the bus of a flight and its place in the log.

An output of another detector is named `detector.lane.output`, as in "iotsekf.left_inner.alarm" or
"lpv_smo.aircraft.r"; `iotsekf.alarm` is that of the reader's own lane, and `lpv_smo.r` that of the aircraft.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from cosim.errors import did_you_mean
from cosim.scenario import catalog as c
from fdi import registry

AIRCRAFT = {  # sensors of the aircraft: what they measure and which way is positive
    "alpha": "angle of attack, nose up +",
    "beta": "sideslip, wind from the right +",
    "cas": "calibrated airspeed",
    "tas": "true airspeed",
    "mach": "Mach number",
    "h_baro": "barometric altitude",
    "h_inertial": "inertial altitude",
    "hdot": "vertical speed, up +",
    "alpha_ground": "angle of attack over the ground, nose up +",
    "v_ground": "speed over the ground",
    "p": "roll rate, right wing down +",
    "q": "pitch rate, nose up +",
    "r": "yaw rate, nose right +",
    "phi": "bank angle, right wing down +",
    "theta": "pitch angle, nose up +",
    "psi": "heading",
    "n_x": "load factor along the body, forward +",
    "n_y": "load factor across the body, right +",
    "n_z": "load factor, up +, 1 in level flight",
    "pdot": "roll acceleration",
    "qdot": "pitch acceleration, nose up +",
    "rdot": "yaw acceleration",
    **{f"n1_{i}": f"fan speed of engine {i}" for i in range(1, 5)},
    "mass": "mass, by the fuel system",
    "cg": "centre of gravity, fraction of the mean chord from its leading edge",
}
COMMANDS = {  # of the control law
    "de_cmd": "elevator command, trailing edge down +",
    "da_cmd": "aileron command, + rolls right",
    "dr_cmd": "rudder command, + yaws left",
    "stab_cmd": "stabiliser command, trailing edge down +",
    "throttle_cmd": "throttle command, 0 to 1",
}
HINGE = {  # of the hinge-moment model on measured air data, + drives the trailing edge down
    "hm0": ("modelled hinge moment at zero deflection", "N m"),
    "hmd": ("its slope over the surface angle", "N m/rad"),
}


@dataclass(frozen=True)
class Signal:
    """A word; `{lane}` in its places is the segment."""

    word: str
    kind: str  # "sensor", "command" of the law, "sent" by a servo, "model", "detector"
    meaning: str
    unit: str
    source: str  # on the bus
    flag: str  # of its validity on the bus, or ""
    topic: str  # in the log
    field: str
    technologies: tuple = ()  # of the actuators that have it, empty for the aircraft's

    def at(self, lane: str) -> Any:
        """Return this signal of one segment, with its full name as word; one of the aircraft as it is."""
        if not self.technologies:
            return self
        there = {name: getattr(self, name).format(lane=lane) for name in ("source", "flag", "topic")}
        return replace(self, word=f"{lane}.{self.word}", **there)


def words() -> dict[str, Signal]:
    """Return {word: Signal} of everything that a detector may read."""
    return _words(tuple(c.TECHNOLOGIES))


@functools.cache
def _words(names):
    return {signal.word: signal for signal in _signals([c.TECHNOLOGIES[name] for name in names])}


def _signals(technologies):
    for name, meaning in AIRCRAFT.items():
        unit, bus = c.SENSORS[name][0].si, f"sensors.{name}"
        yield Signal(name, "sensor", meaning, unit, f"{bus}.y_obs", f"{bus}.valid_obs", "/sensors/aircraft", name)
    for name, meaning in COMMANDS.items():
        unit = "-" if name == "throttle_cmd" else "rad"
        yield Signal(name, "command", meaning, unit, f"law.law.{name}", "", "/law", name)
    for name, (own, *_) in c.ACTUATOR_SENSORS.items():
        has = tuple(t.name for t in technologies if name in t.sensors)
        meaning = next(t.sensors[name].meaning for t in reversed(technologies) if name in t.sensors)
        unit, bus = "-" if own.si.startswith("of ") else own.si, f"sensors.{{lane}}_{name}"
        yield Signal(name, "sensor", meaning, unit, f"{bus}.y_obs", f"{bus}.valid_obs", "/sensors/{lane}", name, has)
    for t in technologies:
        name, meaning, unit = t.sent
        place = f"{t.name}_in.{{lane}}.u", "", f"/actuators/{t.name}/{{lane}}", "u_held", (t.name,)
        if name:
            yield Signal(name, "sent", meaning, unit, *place)
    for name, (meaning, unit) in HINGE.items():
        has = tuple(t.name for t in technologies)
        yield Signal(name, "model", meaning, unit, f"hinge_model.{{lane}}.{name}", "", "/hinge/{lane}", name, has)


def find(name: str, lane: str = "") -> Signal:
    """Return the Signal of `name`: a word, of segment `lane` where it is an actuator's, `segment.word`, or an output of
    a detector. Whether that one flies and has it is checked before a flight: a user's may be loaded later.

    Raises KeyError with what it might have been.
    """
    if detector_of(name):
        return _output(name, lane)
    segment, _, word = name.rpartition(".")
    known = words()
    if word not in known or "." in segment or (segment and not known[word].technologies):
        raise KeyError(". ".join(filter(None, (f"{name!r} is no signal", did_you_mean(name, known)))))
    return known[word].at(segment or lane)


def detector_of(name: str) -> str:
    """Return the id of the detector whose output `name` is, "" for any other signal."""
    parts = name.split(".")
    return parts[0] if len(parts) == 3 or (len(parts) == 2 and registry.known(parts[0])) else ""


def _output(name, lane):
    from actuators.block import unit as unit_of  # a scenario without such a signal needs no NumPy

    detector, *place, field = name.split(".")
    own = registry.module(detector) if registry.known(detector) else None
    local = not place and own is not None and own.DETECTOR.level == "local"
    at = place[0] if place else (lane or "{lane}") if local else "aircraft"
    unit, source = (unit_of(own.STATE, field) if own is not None else "") or "-", f"{detector}.{at}.{field}"
    has = own.DETECTOR.technologies if local and own is not None else ()
    meaning = f"output of {detector}"
    return Signal(source, "detector", meaning, unit, source, "", f"/detectors/{detector}/{at}", column(field), has)


def elements(kind: Any, names: Sequence[str]) -> list[str]:
    """Return the elements of fields `names` of a record, in memory order; those of an array as `name[i]`."""
    own = [(name, kind[name]) for name in kind.names if name in names]
    return [f"{n}[{i}]" if k.shape else n for n, k in own for i in range(k.itemsize // 8)]


def inventory() -> list[dict[str, str]]:
    """Return [{name, kind, unit, summary, topic, field}] of the vocabulary, for `cosim list signals`."""
    return [
        {"name": s.word, "kind": s.kind, "unit": s.unit,
         "summary": s.meaning + (f"; of an actuator: {', '.join(s.technologies)}" if s.technologies else ""),
         "topic": s.topic.format(lane="<segment>"), "field": s.field}
        for s in words().values()
    ]  # fmt: skip


# Where the sections of the bus stand in the log; those that are not named here are an actuator's or a detector's
TOPICS = {
    "truth": "/truth/{lane}", "surfaces": "/truth/surfaces", "pilot": "/law/pilot", "law": "/law",
    "hinge_model": "/hinge/{lane}", "faults": "/faults/f{lane}",
}  # fmt: skip


def topic(section: str, lane: str) -> str:
    """Return the topic of the log that holds a lane of a section of the bus."""
    for tech in c.TECHNOLOGIES.values():
        if section in (tech.name, tech.servo):
            return f"/actuators/{tech.name}/{lane}" + "/servo" * (section == tech.servo)
    place = TOPICS.get(section, "/detectors/{section}/{lane}")
    return place.format(section=section, lane=lane)


def column(field: str) -> str:
    """Return what the log calls a field of the bus: `x[3]` is `x_3`."""
    return field.replace("[", "_").rstrip("]")


def place(name: str) -> tuple[Any, ...]:
    """Return (topic, field) of the log for a name `section.lane.field` of the bus."""
    section, lane, field = name.split(".", 2)
    if section.endswith("_in") and field == "u":  # still the command held over the last tick
        return topic(section.removesuffix("_in"), lane), "u_held"
    return topic(section, lane), column(field)
