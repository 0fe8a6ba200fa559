"""What has to be said beside the verdicts on a recording: whose design judged, on what, for how long not, and when an
alarm speaks against the model rather than against the aircraft."""

from typing import Any

import numpy as np

from cosim.replay.detector_replay import output_names
from cosim.replay.units import bare, factors
from fdi import registry
from fdi.common import why as reason

TOLD_S = 1.0  # shorter times out of range are not told
DECIDES_S = 2.0  # that a detector may take to decide, beside the time until it is ready
NEARLY = 0.9  # of the samples
ASKED = {"deg": "degrees", "rad": "radians", "deg/s": "degrees per second", "rad/s": "radians per second",
         "m": "metres", "ft": "feet", "m/s": "metres per second", "kt": "knots", "ft/s": "feet per second",
         "km/h": "kilometres per hour", "ft/min": "feet per minute", "g": "g", "m/s2": "m/s2"}  # fmt: skip
MOST = 0.5  # an alarm that stands for this share of the valid time so far, at any moment, speaks against the model


def caveats(made: Any, done: list) -> list[str]:
    """Return sentences about the lanes that ran on the Prepared recording `made` (cosim/replay/map.py),
    [(detector, lane, inputs, outputs (n, fields))]; times are the recording's."""
    m, aircraft = made.map, made.scenario.aircraft
    own = [*_units(made, done), *_designs(m, aircraft, done)]
    own += [*_mass(aircraft, made.values), *_dead(m, made), *_late(made), *_proxies(m, done)]
    return [*own, *_lanes(done, made.dt, made.t_0)]


def _units(made, done):
    """Ask for the unit of a signal that is out of a detector's range nearly all along, and would not be in another."""
    out: dict[str, list[str]] = {}
    for d in {d.id: d for d, *_ in done}.values():
        for word, (low, high) in d.record.range.items():
            y = made.values[word][0] if word in made.values else np.empty(0)
            y, signal = y[np.isfinite(y)], made.map.signals.get(word)
            if not len(y) or not signal.channel or np.mean((y < low) | (y > high)) < NEARLY:
                continue
            si = made.sources[word].unit
            units = factors(si)
            own = bare(signal.unit or si)
            raw = (y - signal.offset) / units[own]  # as the channel has it
            spans = {u: (raw * f + signal.offset >= low) & (raw * f + signal.offset <= high) for u, f in units.items()}
            fits = [ASKED[u] for u, within in spans.items() if u != own and u in ASKED and np.mean(within) >= NEARLY]
            if fits:
                shown = next(u for u in ("deg", "deg/s", si) if u in units)
                a, b = np.percentile(y, (1.0, 99.0))
                told = [f"{a / units[u]:.3g} to {b / units[u]:.3g} {u}" for u in dict.fromkeys((own, shown))]
                asked = f"{word} {' is '.join(told)}, out of range: is it in {' or '.join(fits)}?"
                out.setdefault(asked, []).append(d.id)
    return [f"{', '.join(names)}: {text}" for text, names in out.items()]


def _mass(aircraft, values):
    """Tell of a mass that the aircraft of the designs never has."""
    y = values["mass"][0] if "mass" in values else np.empty(0)
    if not np.isfinite(y).any():
        return []
    (low, high), middle = aircraft.mass.mass_t, float(np.nanmedian(y)) * 1e-3
    if low <= middle <= high:
        return []
    return [f"the recording's mass, {middle:.4g} t, lies outside the {aircraft.name}'s, {low:g} to {high:g} t: what is "
            "judged by forces or moments is no proof"]  # fmt: skip


def _dead(m, made):
    """Tell of sensors and commands whose channel never changes."""
    out = []
    for name, signal in m.signals.items():
        y = made.channels[name][1] if signal.channel and name in made.channels and name in made.sources else ()
        y = np.asarray(y)[np.isfinite(y)]
        if len(y) > 1 and y.min() == y.max() and made.sources[name].kind != "model" and name not in ("mass", "cg"):
            out.append(f"{name}: channel {signal.channel} is {y[0]:.6g} all along: not connected, or absent = true")
    return out


def _late(made):
    """Tell of valve commands that the detectors were given at another time than that of the recording."""
    out = []
    for name, by in made.delays.items():
        off = f"{1e3 * abs(by) * made.dt:.3g} ms too {'early' if by > 0.0 else 'late'}"
        out.append(f"{name} is recorded {off} for the pressure that answers it, and was moved by it: is `held` right?")
    return out


def _designs(m, aircraft, done):
    """Tell of detectors that hold the model of another aircraft than the one that was recorded."""
    own, recorded = aircraft.name, m.aircraft
    told = dict.fromkeys(
        d.id for d, *_ in done if d.level == "aircraft" and d.id in registry.SHIPPED and not d.record.any_aircraft
    )
    if recorded == own or not told:
        return []
    other = f"designed for another aircraft, {own}, than the recording's, {recorded}"
    unsaid = f"designed for the {own}, and the map does not say which aircraft flew (aircraft = ...)"
    return [f"{', '.join(told)}: {other if recorded else unsaid}: an alarm may come from that"]


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
        names, step = output_names(d), dt * d.every
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
            first = int(np.argmax(broken))
            since, n = f"{t_0 + first * step:.6g} s", np.count_nonzero(broken)
            when = f"from {since} on" if broken[first:].all() else f"for {n * step:.4g} s, first at {since}"
            out.append(f"{said}: its numbers are not finite {when}{'' if valid[broken].all() else ': not valid'}")
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
