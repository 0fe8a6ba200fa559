"""Whether a detector, or a control law, keeps the contract that ours keep: `cosim check mine.py`.

It is run on the signals of a real flight with a fault, several times, in pieces, with another future and with lost
samples. "bad" is a breach, "note" something to know.
"""

import copy
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from actuators import subprocess_env
from cosim.errors import CosimError
from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import wires, with_sources
from cosim.flight.loop.signals import fly, inputs
from cosim.flight.plugins import GuestError, load
from cosim.flight.plugins.check_law import checks, is_law
from cosim.flight.plugins.plain import PlainDetector
from cosim.flight.plugins.watchdog import watched
from cosim.scenario import Scenario, load_scenario
from cosim.scenario.catalog import SEGMENTS
from fdi.common.verdict import class_name

FAULT_S, FLIGHT_S = 3.0, 6.0
FAULTS = {  # flown beside the oscillation until a detector alarms: one of every place that a fault can be at
    "a jam": "target='elevator.left_inner', kind='jam_solid'",
    "a runaway": "target='elevator.left_inner', kind='runaway', rate_deg_s=20.0",
    "a bias of the surface sensor": "target='elevator.left_inner.surface', kind='bias', bias_deg=5, path='monitor'",
    "a bias of the angle of attack": "target='sensor.alpha', kind='bias', path='observers', bias_deg=5.0",
    "a loss of thrust": "target='engine.1', kind='thrust_loss', loss_pct=80.0",
}
PATIENCE_S = 300.0  # for one question: a few flights' worth of steps, and a compiler before the first
SLOW_US = 1000.0  # of a step: from here on it decides how fast a flight is


def check(
    file: str | os.PathLike, *, progress: Callable[[float, float], None] | None = None, patience_s: float = PATIENCE_S
) -> dict[str, Any]:
    """Return {id, file, keeps, checks: [{question, result, answer}]} of a detector's file or a control law's; result is
    good, bad or note.

    It runs in a process of its own. Raises GuestError for a file that is neither, and for one that ends or crashes
    that process, takes all its memory, or is not back from a question after `patience_s` [s].
    """
    return _asked(file, True, patience_s, progress)


def trial(file: str | os.PathLike, *, patience_s: float = PATIENCE_S) -> None:
    """Run the detector of a file through one flight, in a process of its own; raises GuestError as `check` does, with
    `fatal` set where the process was lost."""
    _asked(file, False, patience_s, None)


def _asked(file, whole, patience_s, progress):
    function, told = "cosim.flight.plugins.check:answer", (str(file), whole)
    try:  # whoever goes on after a trial loads the file, and tells of it
        made = subprocess_env.call(function, *told, patience_s=patience_s, progress=progress, logged=whole)
    except subprocess_env.Lost as error:
        raise _fatal(str(error), file) from None
    if "error" in made:
        *words, fatal = made["error"]
        wrong = GuestError(words[0], **dict(zip(("place", "allowed", "remedy"), words[1:])))
        wrong.fatal = fatal
        raise wrong
    return made


def _fatal(said, file, remedy=""):
    error = GuestError(said, place=str(file), remedy=remedy)
    error.fatal = True
    return error


def answer(
    file: str, whole: bool, *, tell: Callable[..., None], hangs: Callable[[str], None], trace: Any
) -> dict[str, Any]:
    """Return what `check` does, or {"error": what a CosimError holds}, in the process of the detector; unless `whole`
    no question is asked."""
    try:
        if whole and is_law(file):
            rows = [dict(zip(("question", "result", "answer"), row)) for row in checks(file, tell)]
            keeps = all(row["result"] != "bad" for row in rows)
            return {"id": Path(file).stem, "file": str(Path(file)), "lane": "law", "keeps": keeps, "checks": rows}
        return _checked(file, whole, tell, hangs, trace)
    except CosimError as error:
        fatal = getattr(error, "fatal", False)
        return {"error": (error.problem, error.place, error.allowed, error.remedy, fatal)}


def _checked(file, whole, tell, hangs, trace):
    guest = load(file)
    tell(0, 1, "while it was wired")
    lane, u, p, dt = _flown(guest)
    questions = (_runs, _names, _same, _causal, _one_by_one, _apart, _restarts, _reads, _loses, _costs)
    checks = []
    for i, question in enumerate(questions):
        tell(i, len(questions), f"at question {i + 1} of {len(questions)}")
        if not i:
            _stays(guest, file, u, p, dt, hangs, trace)
            if not whole:
                return {}
        checks.append(question(guest, u, p, dt))
        if i == 0 and checks[0]["result"] == "bad":
            break  # every other question would say the same
    keeps = all(line["result"] != "bad" for line in checks)
    return {"id": guest.DETECTOR.id, "file": str(Path(file)), "lane": lane, "keeps": keeps, "checks": checks}


def _stays(guest, file, u, p, dt, hangs, trace):
    """Raise GuestError where a plain detector does not come back by itself, takes all memory, or leaves a thread."""
    if isinstance(guest, PlainDetector):
        rollout = guest.runner(limited=True)
        with watched([rollout], lost=lambda _, text: hangs(text), trace=trace):
            rollout(guest.init(p), u, p, dt, np.zeros(u.shape, guest.STATE))
        if rollout.fatal:
            raise _fatal(rollout.fatal, file, "A flight drops it")
    left = [t.name for t in threading.enumerate() if not t.daemon and t is not threading.main_thread()]
    if left:
        said = f"leaves the thread {left[0]!r} running: the process of a flight would not end"
        raise _fatal(said, file, "Start it with daemon=True")


def _scenario(technology: str, fault: str = "") -> Scenario:
    """Return a short flight on elevators of `technology`, with a doublet, light turbulence and a `fault`.

    `fault` is a fault of FAULTS; by default it is an oscillation.
    """
    kind = technology or "hydraulic"
    own = "{" + ", ".join(f"{s}='{kind}'" for s in SEGMENTS) + "}"
    at, size = ("command", "amplitude_deg=1.0") if kind == "simple" else ("valve", "amplitude_mm=6.0")
    fault = fault or f"target='elevator.left_inner', kind='ofc_liquid', at='{at}', frequency_hz=2.0, {size}"
    fault = f"{{start_s={FAULT_S}, {fault}}}"
    doublet = "manoeuvre={kind='nz_doublet', start_s=1.0, width_s=1.0, amplitude_g=0.1}"
    return load_scenario("cruise", [f"duration_s={FLIGHT_S}", f"elevator={own}", "flight.turbulence=light", doublet,
                                    "detectors.enabled=[]", f"faults.0={fault}"])  # fmt: skip


def _flown(guest, fault=""):
    """Return (lane, INPUTS (1, ticks) of a flight with `fault`, PARAMS, dt) for one lane of a guest."""
    own = guest.DETECTOR
    scenario = _scenario(own.technologies[0] if own.technologies else "", fault)
    lane = "left_inner" if own.level == "local" else ""
    read = {w.field: w.source for w in wires(own, lane, guest)}
    above = with_sources([own.id])[:-1]  # detectors that it reads
    if above:
        own_detectors = scenario.detectors.model_copy(update={"enabled": tuple(above)})
        scenario = scenario.model_copy(update={"detectors": own_detectors})
    frame = fly(scenario, [*read.values()])
    u = inputs(frame, guest, read)
    p = own.fit(site(scenario.dt * own.every, lane, scenario.elevator.technology))
    return lane or "aircraft", np.ascontiguousarray(u[:, :: own.every]), p, scenario.dt * own.every


def _run(guest, u, p, dt, pieces=()):
    """Return (outputs (ticks, n), problem, notes) of a fresh lane on `u`, in pieces that end at the ticks given."""
    rollout = guest.runner() if isinstance(guest, PlainDetector) else guest.own_rollout
    x, log = guest.init(p), np.zeros(u.shape, guest.STATE)
    for a, b in zip((0, *pieces), (*pieces, u.shape[1])):
        rollout(x, u[:, a:b], p, dt, log[:, a:b])
    return _outputs(guest, log), getattr(rollout, "problem", ""), getattr(rollout, "notes", [])


def _outputs(guest, log):
    return np.stack([log[0][n].reshape(log.shape[1], -1)[:, j] for n in guest.OUTPUTS
                     for j in range(guest.STATE[n].itemsize // 8)], axis=1)  # fmt: skip


def _line(question, good, answer, note=False):
    return {"question": question, "result": "good" if good else "note" if note else "bad", "answer": answer}


def _differ(a, b):
    """Return the first row in which two arrays differ bit for bit, None when they do not."""
    wrong = (np.ascontiguousarray(a).view(np.int64) != np.ascontiguousarray(b).view(np.int64)).any(axis=1)
    return int(np.flatnonzero(wrong)[0]) if wrong.any() else None


def _runs(guest, u, p, dt):
    out, problem, _ = _run(guest, u, p, dt)
    names = list(guest.OUTPUTS)
    r = out[:, names.index("r")]
    finite = bool(np.isfinite(r).all())
    said = problem or ("" if finite else f"r is not finite at {np.flatnonzero(~np.isfinite(r))[0] * dt:.3f} s")
    alarms = int(np.count_nonzero(np.diff(np.r_[0.0, out[:, names.index("alarm")]]) > 0.5))
    told = f"{len(out)} steps, largest r {r.max():.2g}, {alarms} alarms"
    return _line("runs through a flight", not said, said or told)


def _names(guest, u, p, dt):
    """Fly the faults of FAULTS, one after the other, until an alarm is raised: its verdict is a class then."""
    question, flown = "verdict is a class", ["an oscillation"]
    bare = guest.DETECTOR.technologies[:1] == ("simple",)  # a segment without sensors
    faults = iter([(name, fault) for name, fault in FAULTS.items() if not (bare and "inner.surface" in fault)])
    while True:
        out, problem, _ = _run(guest, u, p, dt)
        on = out[:, list(guest.OUTPUTS).index("alarm")] > 0.5
        if problem:
            return _line(question, False, f"with {flown[-1]}: {problem}")
        if on.any():
            codes = np.unique(out[on, list(guest.OUTPUTS).index("verdict")])
            unknown = [f"{c:g}" for c in codes if class_name(c) == "unknown"]
            said = f"code {', '.join(unknown)} is no class" if unknown else ", ".join(class_name(c) for c in codes)
            return _line(question, not unknown, f"with {flown[-1]}: {said}")
        name, fault = next(faults, ("", ""))
        if not name:
            said = f"no alarm in {len(flown)} flights ({', '.join(flown)}): the verdict is not checked"
            return _line(question, False, f"{said}; `cosim list classes` has its words", note=True)
        flown.append(name)
        _, u, p, dt = _flown(guest, fault)


def _same(guest, u, p, dt):
    at = _differ(_run(guest, u, p, dt)[0], _run(guest, u, p, dt)[0])
    said = "twice the same bits" if at is None else f"two runs differ at {at * dt:.3f} s: a seed, a clock, a global"
    return _line("deterministic", at is None, said)


def _causal(guest, u, p, dt):
    """Alter the future: what was said before it must not change."""
    whole = _run(guest, u, p, dt)[0]
    for cut in (u.shape[1] // 4, u.shape[1] // 2, u.shape[1] - 1):
        other = u.copy()
        other[:, cut:] = other[:, cut:][:, ::-1] if cut < u.shape[1] - 1 else np.zeros(1, u.dtype)
        at = _differ(whole[:cut], _run(guest, other, p, dt)[0][:cut])
        if at is not None:
            said = f"what it says at {at * dt:.3f} s depends on what is measured from {cut * dt:.3f} s on"
            return _line("causal", False, said)
    return _line("causal", True, "another future leaves the past as it was")


def _one_by_one(guest, u, p, dt):
    at = _differ(_run(guest, u, p, dt)[0], _run(guest, u, p, dt, range(1, u.shape[1]))[0])
    said = "the same bits" if at is None else f"tick by tick differs from all at once at {at * dt:.3f} s"
    return _line("live as in replay", at is None, said)


def _apart(guest, u, p, dt):
    """Two lanes side by side, the second on other measurements: the first must not notice."""
    both = np.concatenate([u, u[:, ::-1]])
    at = _differ(_run(guest, u, p, dt)[0], _run(guest, both, np.repeat(p, 2), dt)[0])
    said = "lanes do not touch each other" if at is None else "one lane changes another: something is shared"
    return _line("one object per lane", at is None, said)


def _restarts(guest, u, p, dt):
    """Go on from a snapshot of half the flight."""
    half, whole = u.shape[1] // 2, _run(guest, u, p, dt)[0]
    x, log = guest.init(p), np.zeros(u.shape, guest.STATE)
    rollout = guest.runner() if isinstance(guest, PlainDetector) else guest.rollout
    rollout(x, u[:, :half], p, dt, log[:, :half])
    try:
        again, x = copy.deepcopy(rollout) if isinstance(guest, PlainDetector) else rollout, x.copy()
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever user code raises
        said = f"cannot be copied ({type(error).__name__}): a replay begins with the flight"
        return _line("restartable from a snapshot", False, said, note=True)
    rollout(guest.init(p), u[:, half:], p, dt, np.zeros_like(log[:, half:]))  # the original goes elsewhere
    again(x, u[:, half:], p, dt, log[:, half:])
    at = _differ(whole[half:], _outputs(guest, log)[half:])
    said = "goes on with the same bits" if at is None else f"differs {at * dt:.3f} s after it"
    return _line("restartable from a snapshot", at is None, said, note=isinstance(guest, PlainDetector))


def _reads(guest, u, p, dt):
    given, own = u.copy(), p.copy()
    _run(guest, given, own, dt)
    same = given.tobytes() == u.tobytes() and own.tobytes() == p.tobytes()
    return _line("only reads its inputs", same, "inputs stay as they were" if same else "it writes to its inputs")


def _loses(guest, u, p, dt):
    """Lose each measurement for half a second, then all of them."""
    names, lost = u.dtype.names, slice(u.shape[1] // 4, u.shape[1] // 4 + max(1, round(0.5 / dt)))
    flags = [n for n in names if n.endswith("_valid")]
    for one in (*(n for n in names if n not in flags), names):
        other, gone = u.copy(), (one,) if isinstance(one, str) else [n for n in one if n not in flags]
        for name in gone:
            other[name][:, lost] = np.nan
            for flag in (f for f in flags if f.removesuffix("_valid") in (name, name.removeprefix("y_"))):
                other[flag][:, lost] = 0.0
        out, problem, notes = _run(guest, other, p, dt)
        r = out[:, list(guest.OUTPUTS).index("r")]
        what = "every input" if len(gone) > 1 else gone[0]
        if problem or not np.isfinite(r).all():
            told = problem or f"r is not finite from {np.flatnonzero(~np.isfinite(r))[0] * dt:.3f} s on"
            return _line("lost samples", False, f"without {what} for half a second: {told}")
        if notes:
            told = f"without {what} r is NaN: it is not valid meanwhile"
            return _line("lost samples", False, told, note=True)
    return _line("lost samples", True, "half a second without an input, or all: r stays finite")


def _costs(guest, u, p, dt):
    """Time the steps: of each the shortest of three passes, without the other work of the machine; mean and longest
    are of the same times."""
    took = np.full((3, u.shape[1]), np.inf)
    for each in took:
        runner = guest.runner() if isinstance(guest, PlainDetector) else guest.rollout
        x, log = guest.init(p), np.zeros((1, 1), guest.STATE)
        for k in range(u.shape[1]):
            now = u[:, k : k + 1]
            begin = time.perf_counter()
            runner(x, now, p, dt, log)
            each[k] = time.perf_counter() - begin
    steps = took.min(axis=0)[1:]
    mean, worst = steps.mean() * 1e6, steps.max()
    late = ", longer than it" if worst > dt else ""
    said = f"{mean:.2f} us a step; the tick is {dt * 1e6:.0f} us, the longest step {worst * 1e6:.2f} us{late}"
    return _line("time of a step", mean < SLOW_US and not late, said, note=True)
