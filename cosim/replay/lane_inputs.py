"""Inputs of a detector lane from the signals of a recording; a valve command is moved to the time at which it acts.

A command that is logged late, or sent where the map says that it acted until then (`held`), is some ticks off. A filter
of the actuator takes what that leaves in the pressure for a fault. The delay is the one with which the filter foresees
the pressure best: of up to MOST ticks either way and quarters up to one tick from there, the one with the least squared
innovation over its variance. What counts is the time before the alarm that is left with it, and if that is short, a
fault is there that may look like a delay: the command stays.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import wires
from cosim.replay.detector_replay import inputs, output_names, replay_lane, unlogged
from fdi import registry

FILTER, COMMAND, INNOVATION, ALARM = "iotsekf", "valve_command", "nis_dp", "alarm"
LOOKED_S, SETTLES_S = 5.0, 1.0  # of the recording: looked at, of it until the filter has settled
LEAST_S = 1.0  # of it settled and without an alarm
MOST, STEP = 2, 0.25  # ticks
CLIPPED = 25.0  # a wild sample counts for no more
BETTER = 0.9  # of the innovation with the command as it is recorded: above, that one is right
PARTS = 4  # of the time looked at, in each of which it is less: a fault that begins meanwhile is no delay


def lane_inputs(module: Any, own: Iterable, values: Mapping[str, Any], n: int) -> np.ndarray:
    """Return INPUTS (1, n) of one lane with Wires `own`; what has no flag of its own holds its last valid value."""
    read = []
    for w in (w for w in own if w.signal.kind != "detector" or w.signal.word in values):
        value, valid = values[w.signal.word]
        gaps = np.where(valid > 0.0, value, np.nan) if w.signal.flag else _held(value, valid)
        read.append((w.field, valid if w.flag else gaps))
    return inputs(module, n, read)


def _held(value, valid):
    """Return a command without gaps: the last valid value, before the first one that first one."""
    good = np.flatnonzero(valid > 0.0)
    if not len(good):
        return np.zeros_like(value)
    last = np.searchsorted(good, np.arange(len(value)), side="right") - 1
    return value[good[np.maximum(last, 0)]]


def delays(scenario: Any, values: Mapping[str, Any], n: int, dt: float) -> dict[str, float]:
    """Return {valve command: ticks by which it is recorded too early, negative: too late}, of those that are, from
    {signal: (values (n,), valid (n,))} at ticks of `dt` [s]."""
    record, module, out = registry.record(FILTER), registry.module(FILTER), {}
    technologies, believed = scenario.elevator.technology, scenario.elevator.parameters
    for lane, technology in technologies.items():
        own = wires(record, lane, aircraft=scenario.aircraft)
        if technology not in record.technologies or any(w.signal.word not in values for w in own):
            continue
        model = believed[lane].model if lane in believed else None
        p = record.fit(site(dt, lane, technologies, scenario.aircraft, model))
        u = lane_inputs(module, own, values, n)[:, : round(LOOKED_S / dt)]
        if found := _delay(record, lane, module, u, p, dt):
            out[f"{lane}.{COMMAND}"] = found
    return out


def _delay(record, lane, module, u, p, dt):
    """Return the delay [ticks] with which the filter foresees the pressure best."""
    command = next(field for field, word in record.inputs.items() if word == COMMAND)
    names, settled = output_names(unlogged(record, lane, module, u, p)), round(SETTLES_S / dt)

    def looked(ticks):
        tried = u.copy()
        tried[command][0] = _moved(u[command][0], ticks)
        out = replay_lane(unlogged(record, lane, module, tried, p), dt)[0][settled:]
        return np.minimum(out[:, names.index(INNOVATION)], CLIPPED), out[:, names.index(ALARM)] > 0.5

    def left(ticks):
        return looked(ticks)[0].sum()

    whole = min(np.arange(-MOST, MOST + 1.0), key=left)
    best = min(whole + np.arange(-1.0, 1.0 + STEP, STEP), key=left)
    (now, _), (then, alarm) = looked(0.0), looked(best)
    quiet = int(np.argmax(alarm)) if alarm.any() else len(alarm)
    if quiet < round(LEAST_S / dt):
        return 0.0
    now, then = (np.array([part.sum() for part in np.array_split(e[:quiet], PARTS)]) for e in (now, then))
    return best if then.sum() < BETTER * now.sum() and (then < now).all() else 0.0


def in_time(values: Mapping[str, Any], late: Mapping[str, float]) -> dict[str, Any]:
    """Return `values` with each command of `late` {name: ticks} later by that."""
    return {**values, **{name: (_moved(_held(*values[name]), by), values[name][1]) for name, by in late.items()}}


def _moved(y, ticks):
    """Return samples y (n,) later by `ticks`, the first or the last one held."""
    at = np.arange(len(y), dtype=float)
    return np.interp(at - ticks, at, y)
