"""Faults that cannot be together, or not on the actuator that flies: refused, never ignored."""

from collections.abc import Mapping

from cosim.scenario import catalog as c
from cosim.scenario.fault import Fault
from cosim.scenario.problem import Mistakes, problem


def check(faults: Mapping[int, Fault], technology: dict[str, str]) -> None:
    """Raise for every fault {its number: Fault} that its actuator cannot have, or that overlaps another in what it
    takes over; when one that waits for its condition will do so is not known yet.
    """
    wrong = Mistakes()
    taken: list[tuple[Fault, tuple, int]] = []
    for i, fault in faults.items():
        with wrong.caught():
            _possible(i, fault, technology)
        what = fault.spec.exclusive
        if not what or fault.waits:
            continue
        if what == "at":  # a runaway to a limit moves the command, whatever it starts from (flight/faults/inject.py)
            what = "command" if "limit_deg" in (fault.model_extra or {}) else fault.at
        for name in fault.parsed.names:
            claim = (fault.parsed.place, name, fault.parsed.sensor, what)
            for other, claimed, index in taken:
                if claimed == claim and fault.start_s < other.end and other.start_s < fault.end:
                    said = f"{fault.kind} and faults.{index} ({other.kind}) take over {fault.target} at the same time"
                    remedy = f"Set faults.{index}.end_s before this start, or remove one"
                    wrong.add(said, key=f"faults.{i}.start_s", remedy=remedy)
            taken.append((fault, claim, i))
    wrong.check()

def _possible(i, fault, technology):
    if fault.parsed.place not in ("elevator", "actuator_sensor"):
        return
    for name in fault.parsed.names:
        own, sensor, fits = technology[name], fault.parsed.sensor, fault.spec.technologies
        where, said, allowed = f"elevator.{name} is {_article(own)} actuator", "", ""
        if sensor and sensor not in c.SENSORS_OF[own]:
            fits = [t for t in c.TECHNOLOGIES if sensor in c.SENSORS_OF[t]]
            key, said = "target", f"{where} and has no sensor {sensor!r}"
            allowed = ", ".join(c.SENSORS_OF[own]) or "none"
        elif fits and own not in fits:
            key, said = "kind", f"{where}, {fault.kind} is a fault of {' or '.join(map(_article, fits))} one"
        elif not c.TECHNOLOGIES[own].inlet and fault.at in ("valve", "sensor"):
            key, said, allowed, fits = "at", f"{where}, which has no {fault.at}", "command", ["hydraulic"]
        if said:
            remedy = f'Choose another target, or set elevator.{name} = "{fits[0]}"'
            raise problem(said, key=f"faults.{i}.{key}", allowed=allowed, remedy=remedy)


def _article(technology):
    return c.TECHNOLOGIES[technology].article
