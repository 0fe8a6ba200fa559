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
                if claimed == claim and _overlap(fault, other):
                    said = f"{fault.kind} and faults.{index} ({other.kind}) take over {fault.target} at the same time"
                    remedy = f"Set faults.{index}.end_s before this start, or remove one"
                    wrong.add(said, key=f"faults.{i}.start_s", remedy=remedy)
            taken.append((fault, claim, i))
    wrong.check()


def _overlap(a, b):
    def end(f):
        return float("inf") if f.end_s is None else f.end_s

    return a.start_s < end(b) and b.start_s < end(a)


def _possible(i, fault, technology):
    if fault.parsed.place not in ("elevator", "actuator_sensor"):
        return
    for name in fault.parsed.names:
        own, where = technology[name], f"elevator.{name} is {_article(technology[name])} actuator"
        remedy = f'Choose another target, or set elevator.{name} = "{{}}"'
        if fault.parsed.sensor and fault.parsed.sensor not in c.SENSORS_OF[own]:
            fits = [t for t in c.TECHNOLOGIES if fault.parsed.sensor in c.SENSORS_OF[t]]
            raise problem(
                f"{where} and has no sensor {fault.parsed.sensor!r}",
                key=f"faults.{i}.target",
                allowed=", ".join(c.SENSORS_OF[own]) or "none",
                remedy=remedy.format(fits[0]),
            )
        if fault.spec.technologies and own not in fault.spec.technologies:
            fits = fault.spec.technologies
            raise problem(
                f"{where}, {fault.kind} is a fault of {' or '.join(_article(t) for t in fits)} one",
                key=f"faults.{i}.kind",
                remedy=remedy.format(fits[0]),
            )
        if not c.TECHNOLOGIES[own].inlet and fault.at in ("valve", "sensor"):
            raise problem(
                f"{where}, which has no {fault.at}",
                key=f"faults.{i}.at",
                allowed="command",
                remedy=remedy.format("hydraulic"),
            )


def _article(technology):
    return c.TECHNOLOGIES[technology].article
