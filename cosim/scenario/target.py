"""Words that name a part: `elevator.left_inner`, `elevator.right.position`, `rudder`, `engine.2`, `sensor.alpha`."""

from dataclasses import dataclass

from cosim.errors import did_you_mean
from cosim.scenario import catalog as c
from cosim.scenario.aircraft import Aircraft
from cosim.scenario.problem import choice, problem


@dataclass(frozen=True)
class Target:
    """What a fault acts on: `place` elevator, actuator_sensor, surface, engine or sensor; `names` of the members."""

    place: str
    names: tuple[str, ...]
    sensor: str = ""

    @property
    def kinds(self) -> dict:
        """Return {kind: Kind} that this place can have."""
        if self.place == "actuator_sensor":
            kinds = c.sensor_kinds(c.ACTUATOR_SENSORS[self.sensor])
            if self.sensor in c.LOOP_SENSOR.values():
                kinds["jam_liquid"] = c.ELEVATOR_KINDS["jam_liquid"]
            return kinds
        if self.place == "sensor":
            return c.sensor_kinds(c.SENSORS[self.sensor])
        return {"elevator": c.ELEVATOR_KINDS, "surface": c.SURFACE_KINDS, "engine": c.ENGINE_KINDS}[self.place]


def targets(aircraft: Aircraft) -> list[str]:
    """Return every target that a fault on `aircraft` may name: parts, their groups, their sensors."""
    parts = [f"elevator.{n}" for n in (*aircraft.segments, *aircraft.groups)]
    sensors = [f"{part}.{sensor}" for part in parts for sensor in c.ACTUATOR_SENSORS]
    engines = [f"engine.{n}" for n in (*aircraft.engine_names, "all")]
    return [*parts, *sensors, *c.SURFACES, *engines, *(f"sensor.{n}" for n in c.SENSORS)]


def parse_target(text: str, aircraft: Aircraft) -> Target:
    """Return the Target that `text` names; an unknown part raises the error that lists what there is."""
    head, _, rest = text.partition(".")
    segments, groups, engines = aircraft.segments, aircraft.groups, aircraft.engine_names
    if head == "elevator":
        part, _, sensor = rest.partition(".")
        if part not in segments and part not in groups:
            raise choice(
                text, [f"elevator.{n}" for n in (*segments, *groups)], "part of this aircraft", key="target"
            )
        if sensor and sensor not in c.ACTUATOR_SENSORS:
            known = [f"elevator.{part}.{s}" for s in c.ACTUATOR_SENSORS]
            raise choice(text, known, "sensor of an actuator", key="target")
        return Target("actuator_sensor" if sensor else "elevator", groups.get(part, (part,)), sensor)
    if text in c.SURFACES:
        return Target("surface", (text,))
    if head == "engine":
        if rest not in (*engines, "all"):
            raise choice(text, [f"engine.{n}" for n in (*engines, "all")], "engine of this aircraft", key="target")
        return Target("engine", engines if rest == "all" else (rest,))
    if head == "sensor":
        if rest not in c.SENSORS:
            raise choice(text, [f"sensor.{n}" for n in c.SENSORS], "sensor of this aircraft", key="target")
        return Target("sensor", (rest,), rest)
    near = did_you_mean(
        text, [*c.SURFACES, *(f"elevator.{n}" for n in (*segments, *groups)), *(f"sensor.{n}" for n in c.SENSORS)]
    )
    raise problem(
        f"{text!r} is no part of this aircraft",
        key="target",
        remedy=near or "`cosim list` shows every target",
        allowed="elevator.<segment or group>[.<sensor>], "
        + ", ".join(c.SURFACES)
        + f", engine.1 to engine.{engines[-1]}, engine.all, sensor.<name>",
    )
