"""Whether a detector, a control law or an aircraft keeps the contract that ours keep: `cosim check mine.py`.

A detector is run on the signals of a real flight with a fault, twice, tick by tick, with another future and with lost
samples; a law flies. "bad" is a breach, "note" something to know.
"""

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.errors import CosimError
from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import sources_of, wires
from cosim.flight.loop.signals import fly, inputs
from cosim.flight.plant import check as of_aircraft
from cosim.flight.user_law import SENSORS, SURFACES
from cosim.parts import PartError, load, rollout_of
from cosim.scenario import Scenario, load_scenario, user_parts
from cosim.scenario.aircraft import bundled
from cosim.scenario.catalog import SEGMENTS

if TYPE_CHECKING:
    import pandas as pd

FAULT_S, FLIGHT_S = 3.0, 6.0
LAW_S = 20.0  # several periods of the short-period mode after the doublet
ASKED = 0.1  # [g] of the doublet
GUSTS = 0.5  # [g] largest change of load factor that is called light turbulence (WMO-No. 958, AMDAR)
LOST_S = 0.5  # that a measurement is lost
DOUBLET = "manoeuvre={kind='nz_doublet', start_s=1.0, width_s=1.0, amplitude_g=" + f"{ASKED:g}}}"
BASE = ("detectors.enabled=[]", "flight.turbulence=light", DOUBLET)
QUESTIONS = "runs", "deterministic", "causal", "live as in replay", "lost samples"
SEEN = (*(f"law.law.{field}" for field, *_ in SURFACES.values()), "truth.aircraft.nz")


def check(what: str | os.PathLike, *, progress: Callable[[float, float], None] | None = None) -> dict[str, Any]:
    """Return {id, file, keeps, checks: [{question, result, answer}]} of a detector's file, a control law's, or the
    folder or the name of an aircraft; result is good, bad or note. Raises PartError for any other
    file.
    """
    path, name = Path(os.path.expanduser(what)), str(what)
    if name in bundled() or (path.is_dir() and not (path / "__init__.py").is_file()):
        rows = of_aircraft.rows(name)
    elif path.exists() and _is_law(user_parts.load(path, lambda text: PartError(text, place=name))[0]):
        name, rows = path.stem, _of_law(path.resolve())
    else:
        part = load(what)
        name, rows = part.DETECTOR.id, _of_detector(part)
    checks = []
    for row in rows:
        checks.append(dict(zip(("question", "result", "answer"), row)))
        if progress:
            progress(len(checks), max(len(checks), len(QUESTIONS)))
    return {"id": name, "file": str(Path(what)), "keeps": all(row["result"] != "bad" for row in checks),
            "checks": checks}  # fmt: skip


def _is_law(module):
    other = hasattr(module, "DETECTOR") or hasattr(module, "init_at")
    return hasattr(module, "Law") or (hasattr(module, "rollout") and not other)


def _said(question, wrong, good, otherwise="bad"):
    """Return a row: what is wrong, or that nothing is."""
    return question, otherwise if wrong else "good", wrong or good


def _of_detector(part):
    """Yield a row for each of QUESTIONS about a detector; only the first where it does not run."""
    u, p, dt = _signals(part)
    names = list(part.OUTPUTS)
    r = [n for n in names for _ in range(part.STATE[n].itemsize // 8)].index("r")

    def run(given, pieces=()):
        """Return (outputs (ticks, n), why it was dropped or is not finite, notes) of a fresh lane, in pieces."""
        rollout, x, log = rollout_of(part), part.init(p), np.zeros(given.shape, part.STATE)
        for a, b in zip((0, *pieces), (*pieces, given.shape[1])):
            rollout(x, given[:, a:b], p, dt, log[:, a:b])
        out = np.concatenate([log[0][n].reshape(log.shape[1], -1) for n in names], axis=1)
        notes, lost = getattr(rollout, "notes", []), np.flatnonzero(~np.isfinite(out[:, r]))
        why = f"r is not finite at {lost[0] * dt:.3f} s" if len(lost) else ""
        return out, notes[-1] if getattr(rollout, "dropped", ()) else why, notes

    runs, deterministic, causal, live, loses = QUESTIONS
    whole, why, _ = run(u)
    alarms = np.count_nonzero(np.diff(np.r_[0.0, whole[:, names.index("alarm")]]) > 0.5)
    yield _said(runs, why, f"{len(whole)} steps, largest r {whole[:, r].max():.2g}, {alarms} alarms")
    if why:
        return
    at = _apart(whole, run(u)[0], dt)
    yield _said(deterministic, at and f"two runs differ at {at}: a seed, a clock, a global", "twice the same bits")
    cut = u.shape[1] // 2
    other = u.copy()
    other[:, cut:] = other[:, cut:][:, ::-1]
    at = _apart(whole[:cut], run(other)[0][:cut], dt)
    said = f"what it says at {at} depends on what is measured from {cut * dt:.3f} s on"
    yield _said(causal, at and said, "another future leaves the past as it was")
    at = _apart(whole, run(u, range(1, u.shape[1]))[0], dt)
    yield _said(live, at and f"tick by tick differs from all at once at {at}", "the same bits")
    yield _without_samples(loses, run, u, round(LOST_S / dt))


def _without_samples(question, run, u, ticks):
    noted = ""
    for what, other in _lossy(u, ticks):
        _, why, notes = run(other)
        if why:
            return question, "bad", f"without {what} for half a second: {why}"
        noted = noted or (f"without {what}: {notes[0]}" if notes else "")
    return _said(question, noted, "half a second without an input, or all: r stays finite", "note")


def _apart(a, b, dt):
    """Return the time of the first row in which two arrays differ bit for bit, "" when they do not."""
    wrong = (np.ascontiguousarray(a).view(np.int64) != np.ascontiguousarray(b).view(np.int64)).any(axis=1)
    return f"{np.argmax(wrong) * dt:.3f} s" if wrong.any() else ""


def _lossy(u, ticks):
    """Yield (what is lost, inputs) with each measurement lost for some ticks, then with all of them lost."""
    names, lost = u.dtype.names, slice(u.shape[1] // 4, u.shape[1] // 4 + max(1, ticks))
    flags = {n: {f"{n}_valid", f"{n.removeprefix('y_')}_valid"}.intersection(names)
             for n in names if not n.endswith("_valid")}  # fmt: skip
    for what, gone in (*((name, [name]) for name in flags), ("every input", flags)):
        other = u.copy()
        for name in gone:
            other[name][:, lost] = np.nan
            for flag in flags[name]:
                other[flag][:, lost] = 0.0
        yield what, other


def _signals(part):
    """Return (INPUTS (1, ticks) of a short flight with an oscillation, PARAMS, dt) for one lane of a detector."""
    own = part.DETECTOR
    scenario = _scenario(own.technologies[0] if own.technologies else "hydraulic")
    lane = "left_inner" if own.level == "local" else ""
    read = {w.field: w.source for w in wires(own, lane, part)}
    enabled = scenario.detectors.model_copy(update={"enabled": tuple(sources_of(own))})
    scenario = scenario.model_copy(update={"detectors": enabled})
    u = inputs(fly(scenario, [*read.values()]), part, read)
    dt = scenario.dt * own.every
    return np.ascontiguousarray(u[:, :: own.every]), own.fit(site(dt, lane, scenario.elevator.technology)), dt


def _scenario(technology: str) -> Scenario:
    own = "{" + ", ".join(f"{s}='{technology}'" for s in SEGMENTS) + "}"
    at, size = ("command", "amplitude_deg=1.0") if technology == "simple" else ("valve", "amplitude_mm=6.0")
    kind = f"target='elevator.left_inner', kind='ofc_liquid', at='{at}', frequency_hz=2.0, {size}"
    fault = f"faults.0={{start_s={FAULT_S}, {kind}}}"
    return load_scenario("cruise", [*BASE, f"duration_s={FLIGHT_S}", f"elevator={own}", fault])


def _of_law(path):
    """Yield a row for each question about a law that can be asked: it flies a load-factor doublet in light turbulence,
    twice, and once while its measurements are lost."""
    runs, deterministic, *_, loses = QUESTIONS
    flown, said = _flown(path, LAW_S)
    if flown is None:
        yield runs, "bad", said
        return
    away = np.abs(flown[SEEN[-1]] - 1.0).max()
    strays = f"{away:.2f} g away from level flight where {ASKED:g} g are asked in light turbulence: {said}"
    yield _said(runs, strays if away > ASKED + GUSTS else "", said)
    wrong = "two flights differ: a seed, a clock, what the first has left behind"
    yield _said(deterministic, "" if flown.equals(_flown(path, LAW_S)[0]) else wrong, "twice the same bits")
    one = [_lost(name, 1.0 + i * LOST_S) for i, name in enumerate(SENSORS)]
    every = [_lost(name, 1.0 + len(SENSORS) * LOST_S) for name in SENSORS]
    lossy, said = _flown(path, 2.0 + (len(SENSORS) + 1) * LOST_S, [*one, *every])
    told = f"{LOST_S:g} s without each measurement, then without any: {said}"
    yield _said(loses, told if lossy is None else "", told)


def _lost(name: str, start: float) -> str:
    return f"{{target='sensor.{name}', kind='dropout', start_s={start}, end_s={start + LOST_S}}}"


def _flown(path: Path, seconds: float, faults: Iterable[str] = ()) -> "tuple[pd.DataFrame | None, str]":
    """Return (commands and load factor of a flight under the law, what it came to); None where it does not fly."""
    own = [f"faults.{i}={fault}" for i, fault in enumerate(faults)]
    try:
        found = fly(load_scenario("cruise", [*BASE, f"duration_s={seconds}", f"law.file={path}", *own]), SEEN)
    except CosimError as error:
        return None, error.problem
    if found.attrs["status"] != "completed":
        return None, f"{found.attrs['status']} after {found.index[-1]:.2f} s: {found.attrs['reason']}"
    n_z = found[SEEN[-1]]
    return found, f"{seconds:g} s, n_z {n_z.min():.2f} to {n_z.max():.2f} g, asked {1 - ASKED:g} to {1 + ASKED:g} g"
