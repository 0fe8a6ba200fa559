"""Interactive flight: step it, read it, inject and heal faults, keep a log that replays.

    with cosim.Flight("cruise", log="flight.mcap") as flight:
        flight.step(2000)
        fault = flight.inject(target="elevator.left_inner", kind="jam_solid")
        while flight.signals["n_z"] > 0.9 and flight.step(200):
            ...
        flight.heal(fault)
        flight.step(1000)
    print(flight.result())

What is injected becomes a fault of the flight's scenario that starts now. The flight is then built anew from that
scenario and flown to now, a hundred times as fast as the clock, and found to be the same to the last bit. So nothing of
the loop needs to know about it, and the log, which is flown once more when the flight is closed, is byte for byte that
of `cosim run` on `flight.flown()`. Until then LOG.flown.toml holds the scenario as it was changed last.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import ScenarioError, told_at_call
from cosim.files import LOG, claim, marked, replace_text
from cosim.flight.build import build
from cosim.flight.faults.conditions import resolved
from cosim.flight.fly import advance
from cosim.flight.loop.bus import Bus
from cosim.flight.simulate import simulate
from cosim.flight.tick import order
from cosim.judge.result import Result
from cosim.scenario import Scenario, load_scenario, parse
from cosim.scenario.fault import NEVER_S
from cosim.scenario.load import retitled

HEAD = "# The scenario of a flight as it was changed by hand; `cosim run` flies it again.\n"
CHANGED = marked(HEAD.encode())


class Signals:
    """The numbers of the tick flown last, by name; SI and radians.

    A name is a word of `cosim list signals` ("n_z", "left_inner.rod": what is measured) or of the bus
    ("truth.aircraft.nz").
    """

    __iter__ = None  # a signal is asked for by its name: Python would ask for 0, 1, 2, ...

    def __init__(self, bus: Bus, values: np.ndarray):
        self._bus, self._values = bus, values

    def __getitem__(self, name: str) -> float:
        """Return the value of a signal; raises ScenarioError that says what is near."""
        return float(self._values[self._bus.index(name)])


class Flight:
    """Fly a scenario tick by tick; faults are injected and healed while it flies.

    `scenario` is a Scenario or what `cosim.load_scenario` takes, `log` the path of the log that is written when the
    flight is closed, or None; a flight that is killed flies again by LOG.flown.toml. `scenario` of the flight holds
    what was injected, `setup` is the built flight, another one after `inject` and `heal`, `tick` and `time` [s] count
    what was flown, `values` is the bus of the tick flown last, `status` "flying", "completed", "departed" or
    "diverged". Raises TrimError when the point cannot be flown.
    """

    @told_at_call
    def __init__(self, scenario: Scenario | str | os.PathLike, *, log: str | os.PathLike | None = None):
        self.log, self._changed = log, Path(f"{os.fspath(log or '')}.flown.toml")  # while there is no log
        for path, sign in ((log, LOG), (self._changed, CHANGED)) if log is not None else ():
            claim(path, sign)
        self.scenario = resolved(scenario if isinstance(scenario, Scenario) else load_scenario(scenario))
        self.tick, self.status, self.reason = 0, "flying", ""
        self.setup, self._tape = self._built(self.scenario)
        self.values = self.setup.loop.v.copy()
        self._result: Result | None = None

    def __repr__(self) -> str:
        return f"Flight: {self.status} at {self.time:g} of {self.scenario.duration_s:g} s, {self.told()}"

    def told(self) -> str:
        """Return the faults of the flight in words."""
        return ", ".join(f"{f.kind} on {f.target} from {f.start_s:g} s" for f in self.scenario.faults) or "no fault"

    @property
    def time(self) -> float:
        """Return the time of the next tick [s]."""
        return self.tick * self.scenario.dt

    @property
    def signals(self) -> Signals:
        """Return the numbers of the tick flown last; before the first those of the trim."""
        return Signals(self.setup.loop.bus, self.values)

    def step(self, n: int = 1) -> int:
        """Fly up to `n` ticks and return how many: fewer at the scenario's end and when the aircraft departs."""
        first, end = self.tick, min(self.tick + n, self.scenario.ticks)
        if self.status != "flying" or end <= first:
            return 0
        self._result = None
        self.tick, status, reason = advance(self.setup.loop, self._tape, range(first, end))
        if status == "interrupted":
            raise KeyboardInterrupt
        self.status, self.reason = status or ("flying" if self.tick < self.scenario.ticks else "completed"), reason
        return self.tick - first

    def _built(self, scenario):
        """Return (a built flight of a scenario, its tape), flown to now."""
        setup = build(scenario)
        tape = order(setup.loop, self._keep)
        advance(setup.loop, tape, range(self.tick))
        return setup, tape

    def _keep(self, v):
        self.values = v.copy()

    @told_at_call
    def inject(self, /, **fault: Any) -> int:
        """Break something from the next tick on and return the number of the fault.

        `fault` has the keys of [[faults]] in a scenario, but `start_s` (left out: now), or `when`. Raises ScenarioError
        as a scenario with this fault would, and for a start that has passed.
        """
        if "when" not in fault:
            fault.setdefault("start_s", self.time)
        elif self.tick and isinstance(fault["when"], str):  # waits from now on, also for what was true before
            fault["when"] = f"t > {(self.tick - 0.5) * self.scenario.dt:.9g} and ({fault['when']})"
        start = fault.get("start_s", self.time)
        if isinstance(start, int | float) and start < self.time - 0.5 * self.scenario.dt:
            raise ScenarioError(f"{start:g} s has passed", place="start_s", allowed=f"from {self.time:g} s on")
        faults = self._tables()
        self._refly([*faults, fault])
        return len(faults)

    @told_at_call
    def heal(self, fault: int) -> int:
        """End fault number `fault` now and return it. Raises ScenarioError if unknown or ended."""
        faults = self._tables()
        if fault not in range(len(faults)):
            raise ScenarioError("no fault of this number", place=f"fault {fault}", allowed=f"0 to {len(faults) - 1}")
        own = faults[int(fault)]
        begun = own.get("start_s", NEVER_S) < self.time
        if not begun or own.get("end_s", np.inf) <= self.time:
            raise ScenarioError("is healed already" if begun else "has not begun", place=f"fault {fault}")
        own["end_s"] = self.time
        self._refly(faults)
        return int(fault)

    def _tables(self):
        """Return the faults as tables; one whose condition has not come true yet waits on."""
        tables = [f.model_dump(exclude_none=True) for f in self.scenario.faults]
        for t in tables:
            if "when" in t and t["start_s"] >= self.time:
                del t["start_s"]
        return tables

    def _refly(self, faults):
        if self.status != "flying":
            raise ScenarioError(f"the flight is {self.status}", place=f"at {self.time:g} s")
        table = self.scenario.model_dump(mode="json", exclude_none=True)
        changed = resolved(retitled(parse({**table, "faults": faults}, place="inject")))
        setup, tape = self._built(changed)
        if setup.loop.truth.tobytes() != self.setup.loop.truth.tobytes():  # a fault to come changes nothing
            raise ScenarioError("the flight to here would be another one with this fault", place="inject")
        self.scenario, self.setup, self._tape, self._result = changed, setup, tape, None
        if self.log is not None:
            replace_text(self._changed, HEAD + changed.expanded_toml(), CHANGED)

    def flown(self) -> Scenario:
        """Return the scenario of what was flown so far: with every fault, ending now."""
        whole = self.tick >= self.scenario.ticks
        return self.scenario if whole else self.scenario.model_copy(update={"duration_s": self.time})

    def result(self, **how: Any) -> Result:
        """Return the Result of what was flown so far, and write the log of it, if there is to be one.

        Costs the flight once more, and once without its faults; `how` is for `simulate`. Raises ScenarioError before
        the first step.
        """
        if not self.tick:
            raise ScenarioError("nothing was flown yet", remedy="Call step() first")
        if self._result is None:
            self._result = simulate(self.flown(), log=self.log, achieved=True, **{"timed": False, **how})
            if self.log is not None and self._result.status != "interrupted":
                self._changed.unlink(missing_ok=True)
        return self._result

    def close(self) -> None:
        """Write the log, if there is to be one."""
        if self.log is not None and self.tick:
            self.result()

    def __enter__(self) -> "Flight":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
