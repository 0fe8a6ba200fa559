"""What has to be said beside the verdicts on a recording: what is lost, whose design judged, for how long not, and when
an alarm speaks against the model rather than against the aircraft."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.replay import clock
from cosim.replay.detector_replay import elements
from fdi import registry
from fdi.common import why as reason

TOLD_S = 1.0  # shorter times out of range are not told
DECIDES_S = 2.0  # that a detector may take to decide, beside the time until it is ready
MOST = 0.5  # an alarm that stands for this share of the valid time so far, at any moment, speaks against the model


def lost(found: Mapping[str, tuple[NDArray, NDArray, NDArray]]) -> list[str]:
    """Return sentences about the samples that signals {name: (times of its samples, times of its table's rows, valid
    (ticks,))} lack, empty cells and missing rows alike; signals that lack the same stand together."""
    same: dict[str, list[str]] = {}
    for name, (t, rows, valid) in found.items():
        step = clock.interval(t)
        n = clock.lost(np.concatenate([rows[:1] - step, t, rows[-1:] + step])) if len(t) else len(rows)
        share = f"{100.0 * float(valid.mean()):.4g} % of the ticks have a value"
        if n:
            same.setdefault(f"{n:,} of {n + len(t):,} samples lost; {share}", []).append(name)
    return [f"{', '.join(names)}: {told}" for told, names in same.items()]


def caveats(made: Any, done: list) -> list[str]:
    """Return sentences about the lanes that ran on the Prepared recording `made` (cosim/replay/map.py),
    [(detector, lane, inputs, outputs (n, fields))]; times are the recording's."""
    return [*_designs(made.map, made.scenario.aircraft, done), *_lanes(done, made.dt, float(made.at[0]))]


def _designs(m, aircraft, done):
    """Tell of detectors that hold the model of another aircraft than the one that was recorded."""
    own, recorded = aircraft.name, m.aircraft
    told = dict.fromkeys(
        d.id for d, *_ in done
        if d.record.level == "aircraft" and d.id in registry.SHIPPED and not d.record.any_aircraft
    )
    if recorded == own or not told:
        return []
    other = f"designed for another aircraft, {own}, than the recording's, {recorded}"
    unsaid = f"designed for the {own}, and the map does not say which aircraft flew (aircraft = ...)"
    return [f"{', '.join(told)}: {other if recorded else unsaid}: an alarm may come from that"]


def _lanes(done, dt, t_0):
    """Tell of times at which a detector does not judge, and of alarms that cover the recording."""
    out = []
    for d, lane, _, again in done:
        names, step = [name for name, _ in elements(d.module.STATE, d.module.OUTPUTS)], dt * d.record.every
        valid = again[:, names.index("valid")] > 0.5
        why = np.where(valid, reason.VALID, reason.NOT_READY)  # of one that does not say it
        why = again[:, names.index("why")] if "why" in names else why
        said = f"{d.id} of {d.target(lane).removeprefix('elevator.').replace('_', ' ')}"
        for code, n in zip(*np.unique(why[~valid], return_counts=True)):
            if code not in (reason.VALID, reason.NOT_READY, reason.NOT_FINITE) and n * step >= TOLD_S:
                of = f"for {n * step:.4g} s of {len(again) * step:.4g} s"
                out.append(f"{said}: {reason.words(code)} {of}, not valid there")
        broken = ~np.isfinite(again).all(axis=1) | (why == reason.NOT_FINITE)
        if broken.any():
            since = f"{t_0 + int(np.argmax(broken)) * step:.6g} s"
            length = f"{np.count_nonzero(broken) * step:.4g} s"
            out.append(f"{said}: its numbers are not finite for {length}, first at {since}")
        if valid.any():
            waited = int(np.count_nonzero(why[: np.argmax(valid)] == reason.NOT_READY))
            out += _standing(said, valid, again[:, names.index("alarm")] > 0.5, waited, step, t_0)
    return out


def _standing(said, valid, alarm, waited, step, t_0):
    """Tell of an alarm that covers a recording from its start, within the `waited` ticks that the detector needs."""
    on = alarm[valid]
    share = np.cumsum(on) / np.arange(1, len(on) + 1)
    if share[min(2 * int(max(waited, DECIDES_S / step)), len(on)) - 1 :].min() < MOST:
        return []
    began, first = np.flatnonzero(valid)[np.argmax(on)], int(np.argmax(valid))
    share_pct, since, ready = 100.0 * share[-1], t_0 + began * step, t_0 + first * step
    told = f"{said}: alarms for {share_pct:.0f} % of its valid time, from {since:.6g} s (valid from {ready:.6g} s)"
    return [f"{told}: more likely a model, unit or sign that does not fit than a fault; check the map's units and "
            "signs, then design for this aircraft (python -m cosim.training all --aircraft DIR)"]  # fmt: skip
