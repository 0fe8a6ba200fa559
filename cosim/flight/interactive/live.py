"""Real-time flight with viewers that may inject faults: `cosim run --live`.

Viewers call the services /inject, with the keys of a fault as JSON, /heal {"fault": 0} and
/speed {"value": 2}; the layout beside the log has a panel for each, filled in. It is a `Flight` that does it: what is
injected is a fault of the scenario from that tick on, and the log, written at the end, is that of the scenario that
the flight came to.
"""

import os
import time
from collections.abc import Callable
from typing import Any

from cosim.errors import CosimError
from cosim.flight.interactive.stepping import Flight
from cosim.flight.loop.recorder import pose, topics
from cosim.judge.result import Result
from cosim.scenario import Scenario
from cosim.scenario.fault import Fault

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
    fault = Fault.model_json_schema() | {"required": ["target", "kind"]}  # its start is now where none is given
    number = {"type": "integer", "minimum": 0, "description": "number of the fault, as /inject answered; from 0"}
    pace = {"type": "number", "minimum": low, "maximum": high, "description": "times the clock's"}
    return {
        "inject": (fault, {"target": f"elevator.{segment}", "kind": "jam_solid"}),
        "heal": ({"type": "object", "required": ["fault"], "properties": {"fault": number}}, {"fault": 0}),
        "speed": ({"type": "object", "required": ["value"], "properties": {"value": pace}}, {"value": 4}),
    }


def fly_live(
    scenario: Scenario, *, port: int, log: str | os.PathLike | None = None, speed: float = 1.0,
    ready: Callable[[Any], None] | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> tuple[Result, Scenario]:  # fmt: skip
    """Fly `scenario` at `speed` times the clock's, served on `port` of this machine, and return what `simulate` does,
    and the scenario that the flight came to.

    `ready(server)` is called when viewers may come, to `server.url`, which has a token. Ctrl-C ends the
    flight there; its log is whole, its status "interrupted". Raises OutputError when it cannot be served, TrimError and
    LogError as `simulate`.
    """
    from cosim.log.live import Control, Live

    speed, ended = checked_speed(speed), False
    flight = Flight(scenario, log=log)

    def told(**more):
        live.declare(topics(flight.setup), pose(flight.setup.loop.bus))
        return {**more, "tick": flight.tick, "t": flight.time, "faults": flight.told()}

    def inject(given):
        return told(fault=flight.inject(**given))

    def heal(given):
        return told(fault=flight.heal(given.get("fault")))

    def pace(given):
        live.pace.change(checked_speed(given.get("value")), flight.tick)
        return told(speed=live.pace.speed)

    about: dict[str, Any] = {"dt_ns": round(scenario.dt * 1e9), "pose": pose(flight.setup.loop.bus),
                             "name": scenario.title or "cosim"}  # fmt: skip
    calls = {"inject": inject, "heal": heal, "speed": pace}
    controls = {name: Control(do, *requests(scenario)[name]) for name, do in calls.items()}
    began = time.perf_counter()
    with Live(topics(flight.setup), port=port, speed=speed, controls=controls, **about) as live:
        if ready:
            ready(live)
        try:
            while flight.step():
                live.append(flight.values)
                live.serve()
                if progress and flight.tick % EVERY == 0:
                    progress(flight.time, scenario.duration_s)
        except KeyboardInterrupt:
            ended = True
    if not flight.tick:
        raise KeyboardInterrupt
    wall = time.perf_counter() - began
    result = flight.result(timed=True, progress=progress)
    result.wall_time_s = wall  # that of the flight that was seen
    if ended and result.status == "completed":
        result.status, result.reason = "interrupted", f"at {flight.time:.2f} s by the user"
    return result, flight.flown()
