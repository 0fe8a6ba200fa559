"""What has to be said beside the verdicts on a recording: whose design judged, on what, for how long not, and when an
alarm speaks against the model rather than against the aircraft."""

from typing import Any

import numpy as np

from cosim.replay.detector_replay import columns
from fdi import registry
from fdi.common import why as reason

TOLD_S = 1.0  # shorter times out of range are not told
FROM_START_S = 60.0  # an alarm that comes so soon after the detector's first valid sample, ...
FROM_START = 0.1  # ... or within such a share of its valid time,
MOST = 0.5  # and stands for such a share of it, speaks against the model


def caveats(m: Any, scenario: Any, done: list, dt: float, t_0: float) -> list[str]:
    """Return sentences about the lanes that ran, [(detector, lane, inputs, outputs (n, fields))]; times are the
    recording's."""
    return [*_designs(m, scenario, done), *_proxies(m, done), *_lanes(done, dt, t_0)]


def _designs(m, scenario, done):
    """Tell of detectors that hold the model of another aircraft than the one that was recorded."""
    own, recorded = scenario.aircraft.name, m.aircraft
    if recorded == own:
        return []
    told = dict.fromkeys(
        d.id for d, *_ in done if d.level == "aircraft" and d.id in registry.SHIPPED and not d.record.any_aircraft
    )
    if not told:
        return []
    if recorded:
        who = f"designed for another aircraft, {own}, than the recording's, {recorded}"
    else:
        who = f"designed for the {own}, and the map does not say which aircraft flew (aircraft = ...)"
    return [f"{', '.join(told)}: {who}: an alarm may come from that"]


def _proxies(m, done):
    """Tell which detectors stand on a channel that is not what they take it for."""
    twice: dict[str, list[str]] = {}
    for name, signal in m.signals.items():
        if signal.channel:
            twice.setdefault(signal.channel, []).append(name)
    stands = {name: f"a proxy, {s.stands_on}" for name, s in m.signals.items() if s.stands_on}
    for channel, names in twice.items():
        for name in names[1:]:
            if name.endswith(("alpha_ground", "v_ground", "h_inertial")):
                stands.setdefault(name, f"a proxy, the same channel {channel} as {names[0]}")
    out = []
    for name, what in stands.items():
        readers = dict.fromkeys(d.id for d, lane, *_ in done if any(w.signal.word == name for w in d.inputs(lane)))
        if readers:
            out.append(f"{', '.join(readers)}: {name} stands on {what}: what it judges by it is no proof")
    return out


def _lanes(done, dt, t_0):
    out = []
    for d, lane, _, again in done:
        names = columns_of(d)
        step = dt * d.every
        valid = again[:, names.index("valid")] > 0.5
        said = f"{d.id} of {d.target(lane).removeprefix('elevator.').replace('_', ' ')}"
        if "why" in names:
            codes, count = np.unique(again[~valid, names.index("why")], return_counts=True)
            out += [
                f"{said}: {reason.words(code)} for {n * step:.4g} s of {len(again) * step:.4g} s, not valid there"
                for code, n in zip(codes, count)
                if code not in (reason.VALID, reason.NOT_READY, reason.NOT_FINITE) and n * step >= TOLD_S
            ]
        broken = ~np.isfinite(again).all(axis=1)
        if "why" in names:
            broken |= again[:, names.index("why")] == reason.NOT_FINITE
        if broken.any():
            out.append(f"{said}: its numbers are not finite from {t_0 + np.argmax(broken) * step:.6g} s on: not valid")
        if valid.any():
            out += _standing(said, valid, again[:, names.index("alarm")] > 0.5, step, t_0)
    return out


def _standing(said, valid, alarm, step, t_0):
    """Tell of an alarm that covers most of a recording from its start."""
    on = np.flatnonzero(valid & alarm)
    all_, first = np.flatnonzero(valid), int(np.argmax(valid))
    if len(on) < MOST * len(all_):
        return []
    waited = np.count_nonzero(valid[: on[0]])
    if waited * step > FROM_START_S and waited > FROM_START * len(all_):
        return []
    return [
        f"{said}: alarms for {100.0 * len(on) / len(all_):.0f} % of its valid time, from {t_0 + on[0] * step:.6g} s "
        f"(valid from {t_0 + first * step:.6g} s): more likely a model, unit or sign that does not fit than a fault; "
        "check the map's units and signs, then design for this aircraft (cosim design --aircraft)"
    ]


def columns_of(d: Any) -> list[str]:
    """Return the names of a detector's outputs as they stand in its rows."""
    kind, out = d.module.STATE, []
    for name in kind.names:
        if name in d.module.OUTPUTS:
            count = len(columns(kind, (name,)))
            out += [name if kind[name].shape == () else f"{name}_{i}" for i in range(count)]
    return out
