"""Real-time flight with viewers that may inject faults: `cosim run --live`.

Viewers that hold the token call the services /inject, with the keys of a fault as JSON, /heal {"fault": 0} and
/speed {"value": 2}, or write the same into the parameters of these names. Each service says by a JSON schema what it
takes and answers; the layout beside the log has a panel for each, filled in. It is a `Flight` that does it: what is
injected is a fault of the scenario from that tick on, and the log, written at the end, is that of the scenario that
the flight came to. `answer` and `faults` among the parameters tell what came of it.
"""

import os
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

from cosim.errors import CosimError
from cosim.flight.interactive.journal import Journal
from cosim.flight.interactive.stepping import Flight
from cosim.flight.loop.recorder import pose, topics
from cosim.flight.simulate import simulate
from cosim.judge.result import Result
from cosim.scenario import Scenario, catalog
from cosim.scenario.aircraft import Aircraft
from cosim.scenario.fault import Fault, parse_target, targets
from cosim.scenario.user_parts import stdout_to_stderr

SPEEDS = 0.01, 1000.0
EVERY = 20  # ticks between two words of progress


def checked_speed(value: Any) -> float:
    """Return `value` as a speed in multiples of the clock's; raises CosimError for another value."""
    low, high = SPEEDS
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise CosimError(f"{value!r} is no speed", place="speed", allowed=f"{low:g} to {high:g} times the clock's")
    return float(value)


def requests(scenario: Scenario) -> dict[str, tuple[dict, dict]]:
    """Return {service: (JSON schema of a request, a first request)} for a flight of `scenario`."""
    low, high = SPEEDS
    segment = next(iter(scenario.aircraft.segments))
    number = {"type": "integer", "minimum": 0, "description": "number of the fault, as /inject answered; from 0"}
    pace = {"type": "number", "minimum": low, "maximum": high, "description": "times the clock's"}
    return {
        "inject": (request_schema(scenario.aircraft), {"target": f"elevator.{segment}", "kind": "jam_solid"}),
        "heal": (_object({"fault": number}, "fault"), {"fault": 0}),
        "speed": (_object({"value": pace}, "value"), {"value": 4}),
    }


def _object(properties, *required):
    return {"type": "object", "required": list(required), "properties": properties, "additionalProperties": False}


def request_schema(aircraft: Aircraft) -> dict[str, Any]:
    """Return the JSON schema of a fault that is injected: the keys of [[faults]], targets and kinds of `aircraft`."""
    told = catalog.KEYS["[[faults]], every kind"]
    keys: dict[str, dict] = {}
    for name, about in Fault.model_json_schema()["properties"].items():
        plain = {**about, **about.get("anyOf", [{}])[0], "description": told.get(name, "")}
        keys[name] = {k: v for k, v in plain.items() if k not in ("anyOf", "default", "title")}
    places = {target: parse_target(target, aircraft).kinds for target in targets(aircraft)}
    kinds = [pair for own in places.values() for pair in own.items()]
    keys["target"] |= {"enum": list(places), "description": "the part that fails"}
    keys["kind"] |= {"enum": list(dict.fromkeys(name for name, _ in kinds)), "description": "`cosim list faults`"}
    keys["start_s"]["description"] += " [s]; left out: now"
    keys["limit_deg"] = {"type": "number", "description": told["limit_deg"]}
    for number, name in ((n, name) for name, kind in kinds for n in (*kind.one_of, *kind.keys)):
        key = keys.setdefault(number.name, {"type": "number", "minimum": number.low, "maximum": number.high, "of": {}})
        key |= {"minimum": min(key["minimum"], number.low), "maximum": max(key["maximum"], number.high)}
        key["of"][name] = None
    for key in keys.values():
        if of := key.pop("of", None):
            key["description"] = f"of {', '.join(of)}"
    return _object(keys, "target", "kind")


def fly_live(
    scenario: Scenario, *, port: int, log: str | os.PathLike | None = None, speed: float = 1.0,
    flightgear: int | None = None, ready: Callable[[Any], None] | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> tuple[Result, Scenario]:  # fmt: skip
    """Fly `scenario` at `speed` times the clock's, served on `port` of this machine, and return what `simulate` does,
    and the scenario that the flight came to.

    `flightgear` is a UDP port of this machine where FlightGear shows the flight (cosim/flight/plant/plant.py).
    `ready(server)` is called when viewers may come (`server.url`, `server.steer_url` with the token). Ctrl-C ends the
    flight there; its log is whole, its status "interrupted". Raises OutputError when it cannot be served, TrimError and
    LogError as `simulate`.
    """
    from cosim.log.live import Control, Live

    speed, ended = checked_speed(speed), False
    flight, journal = Flight(scenario, flightgear=flightgear), Journal(log)

    def told(**more):
        live.shown.declare(topics(flight.setup), pose(flight.setup.loop.bus))
        live.parameters["faults"] = flight.told()
        if flight.tick:
            journal.write(flight.flown, now=True)
        return {**more, "tick": flight.tick, "t": flight.time}

    def inject(given):
        return told(fault=flight.inject(**given))

    def heal(given):
        fault = given["fault"] if "fault" in given else given.get("value")
        if isinstance(fault, bool) or not isinstance(fault, int | float) or fault != int(fault):
            raise CosimError(f"fault must be an index, got {fault!r}", place="heal")
        flight.heal(int(fault))
        return told(fault=int(fault))

    def pace(given):
        live.shown.speed = checked_speed(given.get("value", given.get("speed")))
        live.pace.change(live.shown.speed, flight.tick)
        return told(speed=live.shown.speed)

    where = pose(flight.setup.loop.bus)
    about: dict[str, Any] = {"dt_ns": round(flight.dt * 1e9), "pose": where, "name": scenario.title or "cosim"}
    calls = {"inject": inject, "heal": heal, "speed": pace}
    controls = {name: Control(do, *requests(scenario)[name]) for name, do in calls.items()}
    with Live(topics(flight.setup), port=port, speed=speed, controls=controls, **about) as live:
        live.parameters |= {"faults": flight.told(), "answer": ""}
        if ready:
            ready(live)
        try:
            with stdout_to_stderr() if flight.setup.guests else nullcontext():
                while flight.step():
                    live.append(flight.values)
                    journal.write(flight.flown)
                    live.serve()
                    if progress and flight.tick % EVERY == 0:
                        progress(flight.time, scenario.duration_s)
        except KeyboardInterrupt:
            ended = True
    if not flight.tick:
        raise KeyboardInterrupt
    flown = flight.flown()
    result = simulate(flown, log=log, achieved=True, progress=progress)
    if result.status != "interrupted":  # while its log was written: `cosim recover` writes it
        journal.done()
    if ended and result.status == "completed":
        result.status, result.reason = "interrupted", f"at {flight.time:.2f} s by the user"
    return result, flown
