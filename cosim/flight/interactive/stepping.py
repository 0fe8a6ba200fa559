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
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import ScenarioError, told_at_call
from cosim.files import LOG, claim, marked, replace_text
from cosim.flight.build import build
from cosim.flight.faults.conditions import resolved
from cosim.flight.fly import CHECK_EVERY, health
from cosim.flight.loop.recorder import topics
from cosim.flight.simulate import simulate
from cosim.judge.result import Result
from cosim.scenario import Scenario, load_scenario, parse, vocabulary
from cosim.scenario.fault import NEVER_S
from cosim.scenario.load import retitled

HEAD = "# The scenario of a flight as it was changed by hand; `cosim run` flies it again.\n"
CHANGED = marked(HEAD.encode())


class Signals(Mapping):
    """The numbers of the tick flown last, by name; SI and radians.

    A name is a word of `cosim list signals` ("n_z", "left_inner.rod": what is measured), a field of the log
    ("/truth/aircraft.nz") or of the bus ("truth.aircraft.nz"). Iterating gives the fields of the log.
    """

    def __init__(self, setup: Any, values: np.ndarray):
        self._bus, self._values = setup.loop.bus, values
        fields = [(f"{t.name}.{f}", int(i)) for t in topics(setup) for f, i in zip(t.fields, t.index)]
        self._places = dict(fields)

    def __getitem__(self, name: str) -> float:
        """Return the value of a signal; raises KeyError that says what is near."""
        if name.startswith("/"):
            if name not in self._places:
                raise KeyError(f"{name}: no such field; `for name in flight.signals` has all")
            return float(self._values[self._places[name]])
        path = name if name.count(".") > 1 else vocabulary.find(name).source
        return float(self._values[self._bus.index(path)])

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def __repr__(self) -> str:
        return f"{len(self)} signals, such as " + ", ".join(f"{n} = {self[n]:.4g}" for n in list(self)[:4])


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
        self.scenario = resolved(scenario if isinstance(scenario, Scenario) else load_scenario(scenario))
        self.log = log
        for path, sign in ((log, LOG), (self._changed, CHANGED)) if log is not None else ():
            claim(path, sign)
        self.tick, self.status, self.reason = 0, "flying", ""
        self.setup = build(self.scenario)
        self.values = self.setup.loop.v.copy()
        self._result: tuple[int, Result] | None = None

    def __repr__(self) -> str:
        return f"Flight: {self.status} at {self.time:g} of {self.scenario.duration_s:g} s, {self.told()}"

    def told(self) -> str:
        """Return the faults of the flight in words."""
        told = [f"{f.kind} on {f.target} from {f.start_s:g} s" for f in self.scenario.faults]
        return ", ".join(told) or "no fault"

    @property
    def dt(self) -> float:
        """Return the length of a tick [s]."""
        return self.scenario.dt

    @property
    def time(self) -> float:
        """Return the time of the next tick [s]."""
        return self.tick * self.dt

    @property
    def signals(self) -> Signals:
        """Return the numbers of the tick flown last; before the first those of the trim."""
        return Signals(self.setup, self.values)

    def step(self, n: int = 1) -> int:
        """Fly up to `n` ticks and return how many: fewer at the scenario's end and when the aircraft departs."""
        first = self.tick
        while self.tick < first + n and self.status == "flying":
            self.setup.loop.tape(self._keep).run(self.tick)
            bad, why = health(self.setup.loop.truth) if self.tick % CHECK_EVERY == 0 else ("", "")
            if bad:
                self.status, self.reason = bad, f"at {self.time:.2f} s {why}"
            self.tick += 1
            if self.tick >= self.scenario.ticks and not bad:
                self.status = "completed"
        return self.tick - first

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
            fault["when"] = f"t > {(self.tick - 0.5) * self.dt:.9g} and ({fault['when']})"
        start = fault.get("start_s", self.time)
        if isinstance(start, int | float) and start < self.time - 0.5 * self.dt:
            raise ScenarioError(f"{start:g} s has passed", place="start_s", allowed=f"from {self.time:g} s on")
        faults = self._tables()
        self._refly([*faults, fault])
        return len(faults)

    @told_at_call
    def heal(self, fault: int) -> None:
        """End fault number `fault` now. Raises ScenarioError if unknown or ended."""
        faults = self._tables()
        if not 0 <= fault < len(faults):
            raise ScenarioError("no fault of this number", place=f"fault {fault}", allowed=f"0 to {len(faults) - 1}")
        if faults[fault].get("end_s", np.inf) <= self.time:
            raise ScenarioError("is healed already", place=f"fault {fault}")
        if faults[fault].get("start_s", NEVER_S) >= self.time:
            raise ScenarioError("has not begun", place=f"fault {fault}")
        faults[fault]["end_s"] = self.time
        self._refly(faults)

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
        setup = build(changed)
        before = self.setup.loop
        for k in range(self.tick):
            setup.loop.tape(self._keep).run(k)
        if setup.loop.truth.tobytes() != before.truth.tobytes():  # cannot be: a fault that is to come changes nothing
            raise ScenarioError("the flight to here would be another one with this fault", place="inject")
        self.scenario, self.setup = changed, setup
        self._result = None
        if self.log is not None:
            replace_text(self._changed, HEAD + changed.expanded_toml(), CHANGED)

    @property
    def _changed(self):
        """Return where the scenario as changed stands until the log is written."""
        return Path(f"{os.fspath(self.log or '')}.flown.toml")

    def flown(self) -> Scenario:
        """Return the scenario of what was flown so far: with every fault, ending now."""
        whole = self.tick >= self.scenario.ticks
        return self.scenario if whole else self.scenario.model_copy(update={"duration_s": self.time})

    def result(self) -> Result:
        """Return the Result of what was flown so far, and write the log of it, if there is to be one.

        Costs the flight once more, and once without its faults. Raises ScenarioError before the first step.
        """
        if not self.tick:
            raise ScenarioError("nothing was flown yet", remedy="Call step() first")
        if self._result is None or self._result[0] != self.tick:
            self._result = self.tick, self.fly_again(timed=False)
        return self._result[1]

    def fly_again(self, **how: Any) -> Result:
        """Fly what was flown once more, write its log and return its Result; `how` is for `simulate`."""
        result = simulate(self.flown(), log=self.log, achieved=True, **how)
        if self.log is not None and result.status != "interrupted":
            self._changed.unlink(missing_ok=True)
        return result

    def close(self) -> None:
        """Write the log, if there is to be one."""
        if self.log is not None and self.tick:
            self.result()

    def __enter__(self) -> "Flight":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
