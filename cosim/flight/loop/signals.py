"""Fly a scenario and keep some signals as a table; run a detector over such a table as often as needed."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from actuators.block import unit
from cosim.errors import told_at_call
from cosim.flight.build import build
from cosim.flight.faults.conditions import resolved
from cosim.flight.fly import record
from cosim.flight.loop.bus import place
from cosim.log.reader import Units
from cosim.parts import rollout_of
from cosim.scenario import Scenario, load_scenario
from cosim.scenario.vocabulary import elements, words

if TYPE_CHECKING:
    import pandas as pd

TRUTH = ("h", "cas", "alpha", "theta", "phi", "q", "nz", "de_lo", "de_li", "de_ri", "de_ro")
COMMON = (*(f"truth.aircraft.{name}" for name in TRUTH), "law.law.de_cmd")  # where no signals are named
CHUNK = 400  # ticks of whole detector states held at once


@told_at_call
def fly(
    scenario: Scenario | str | os.PathLike, signals: Iterable[str] = COMMON, *,
    prepare: Callable[[Any], None] | None = None,
) -> "pd.DataFrame":  # fmt: skip
    """Fly `scenario` without a log and return the named signals, one row per tick, index in seconds.

    `scenario` is what `load_scenario` takes, or gives. `signals` are words of `cosim list signals` (`alpha`,
    `left_inner.rod`) or bus names, "section.lane.field" as in `hydraulic.left_inner.q_rod`; SI units and signs as said
    there or beside the field. `prepare(setup)` may change parameters of the
    built flight before its first tick. `attrs` of the table: `units` {signal: unit}, `dt` [s], `status` and `reason` (a
    flight that departs ends there). Raises ScenarioError for a signal that the flight does not have, TrimError when the
    flight point cannot be flown.
    """
    import pandas as pd

    setup = build(resolved(scenario if isinstance(scenario, Scenario) else load_scenario(scenario)))
    if prepare is not None:
        prepare(setup)
    names = list(dict.fromkeys(signals))
    rows, status, reason = record(setup, names)
    dt = setup.loop.dt
    frame = pd.DataFrame(rows, index=pd.Index(np.arange(len(rows)) * dt, name="t"), columns=names, copy=False)
    units = Units(zip(names, (_unit(setup.loop.bus, place(n)) for n in names)))
    frame.attrs = {"units": units, "dt": dt, "status": status, "reason": reason}
    return frame


def inputs(
    frame: "pd.DataFrame", module: ModuleType, wires: Mapping[str, str] | Sequence[Mapping[str, str]]
) -> np.ndarray:
    """Return the INPUTS of a detector from a flown table, (lanes, ticks); `wires` as for `detect`."""
    lanes = [wires] if isinstance(wires, Mapping) else list(wires)
    fields = elements(module.INPUTS, module.INPUTS.names)
    u = np.zeros((len(lanes), len(frame), len(fields)))
    for lane, own in zip(u, lanes):
        for field, name in own.items():
            lane[:, fields.index(field)] = frame[name]
    return u.view(module.INPUTS)[..., 0]


def detect(
    frame: "pd.DataFrame", module: ModuleType, wires: Mapping[str, str] | Sequence[Mapping[str, str]],
    p: np.ndarray | None = None, fields: Sequence[str] | None = None,
) -> np.ndarray:  # fmt: skip
    """Return what detector `module` makes of a flown table, as in the loop: its STATE after every tick, (ticks,).

    `wires` is {input field: signal}, an element of an array as `field[2]`; a list of them stands for lanes, and the
    result is (lanes, ticks). `p` is one record of PARAMS or one for each lane, by default `module.params()`; `fields`
    names what is kept, by default all. A row has what the servos sent in its tick, a detector of the loop reads what
    they sent the tick before: where a wire is a servo's command, name the detector's input (`iotsekf_in.left_inner.u`).
    """
    u = inputs(frame, module, wires)
    lanes = len(u)
    p = np.resize(module.params() if p is None else p, lanes)
    kind = [(n, "f8", module.STATE[n].shape) for n in fields] if fields is not None else module.STATE
    out = np.zeros(u.shape, kind)
    x, log = module.init(p), np.zeros((lanes, CHUNK), module.STATE)
    rollout = rollout_of(module)
    for a in range(0, len(frame), CHUNK):
        b = min(a + CHUNK, len(frame))
        rollout(x, np.ascontiguousarray(u[:, a:b]), p, frame.attrs["dt"], log[:, : b - a])
        for n in out.dtype.names:
            out[n][:, a:b] = log[n][:, : b - a]
    return out[0] if isinstance(wires, Mapping) else out


def _unit(bus, name):
    """Return the unit of a bus signal, "" where none is known."""
    section, lane, field = name.split(".", 2)
    if section == "sensors" and field in ("y", "y_obs"):
        return words()[lane if lane in words() else lane.rpartition("_")[2]].unit  # of an actuator's: segment_word
    return unit(bus.kinds[section], field)
