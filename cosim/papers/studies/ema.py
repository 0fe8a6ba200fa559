"""What the EMA study asks: its draws and flights (`ema_draws`, `ema_flights`), and their tables.

    cosim study ema
"""

from dataclasses import replace
from typing import Any

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.papers.studies import Question
from cosim.papers.studies import ema_draws as s
from cosim.papers.studies import ema_flights as flights
from cosim.papers.studies.ema_bench import ARM, DT, NO_LOAD, STALL

ABOUT = "Which EMA sensor fault `ema_kalman_flight` names, and what reconfiguration does."
FIRST = 5000  # seeds of this study: thresholds were chosen below 1000, the tests take 2000 and 3000
BLOCK = 20
SIZES = {
    "velocity + 10 % of no-load": (NO_LOAD, "of no-load", (0.2, 0.1, 0.07, 0.05, 0.04, 0.03, 0.02, 0.01)),
    "velocity x1.25": (1.0, "scale less 1", (0.5, 0.25, 0.2, 0.15, 0.1, 0.07, 0.05)),
    "position + 1 deg": (RAD_PER_DEG * ARM, "deg", (5.0, 2.0, 1.0, 0.6, 0.4, 0.3, 0.2, 0.1)),
    "position x1.25": (1.0, "scale less 1", (1.0, 0.7, 0.5, 0.4, 0.3, 0.25, 0.2, 0.15)),
    "current + 10 % of stall": (STALL, "of stall", (0.2, 0.1, 0.06, 0.04, 0.03, 0.02, 0.01)),
    "current x1.25": (1.0, "scale less 1", (0.5, 0.25, 0.2, 0.15, 0.1, 0.07, 0.05)),
}
SHARES = (0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1)
COMMANDS = {
    "3-2-1-1 of 4 deg": None,
    "sine 10 deg 0.3 Hz": lambda t: 10 * RAD_PER_DEG * np.sin(2 * np.pi * 0.3 * t),
    "sine 8 deg 0.5 Hz": lambda t: 8 * RAD_PER_DEG * np.sin(2 * np.pi * 0.5 * t),
    "at rest": lambda t: 0.0 * t,
}


def draws(
    fault: Any, first: Any, count: int, noise: float = 1.0, size: int | None = None, command: Any = None
) -> list[Any]:
    """Return [(named, delay, reconfigured)] of `count` draws from seed `first`."""
    found = s.outcomes(fault, range(first, first + count), noise=noise, size=size,
                       command=COMMANDS[command] if command else None)
    return [[o.named, o.delay if np.isfinite(o.delay) else None, o.reconfigured] for o in found]


def held(field: str, size: int, bias: float, seed: int, seconds: float) -> dict[str, bool | float | None]:
    """Return a bench run's times and errors after reconfiguration: see `_held`."""
    flown, t = s.reconfigured(field, size, bias=bias, seed=seed, seconds=seconds)
    k = int(np.argmax(flown.log["reconf"] > 0))
    late = (t > t[k] + 2.0) & (t < t[k] + 62.0)
    settled = late & (np.abs(np.gradient(flown.reference, t)) < 1e-3)
    far = np.abs(flown.estimate_error[k:]) > 0.5 * RAD_PER_DEG
    return {
        "surface_deg": float(np.abs(flown.surface - flown.reference)[settled].max() / RAD_PER_DEG),
        "estimate_deg": float(np.abs(flown.estimate_error)[late[1:]].max() / RAD_PER_DEG),
        "until_s": float(int(np.argmax(far)) * DT) if far.any() else None,
        "looked_s": float(t[-1] - t[k]),
        "valid": bool(np.all(flown.log["valid"][late] == 1.0)),
    }


def _blocks(options):
    n = options.seeds
    return [(FIRST + i, min(BLOCK, n - i)) for i in range(0, n, BLOCK)]


def _confusion_jobs(options):
    return [(draws, {"fault": f, "first": a, "count": n, "noise": options.noise})
            for f in s.FAULTS for a, n in _blocks(options)]


def _grouped(values, count):
    n = len(values) // count
    return [[run for block in values[n * i : n * (i + 1)] for run in block] for i in range(count)]


def _confusion(options, values):
    columns = ("none", "velocity", "position", "current", "ambiguous")
    rows = []
    for (fault, (_, _, right)), found in zip(s.FAULTS.items(), _grouped(values, len(s.FAULTS))):
        names = [name for name, _, _ in found]
        delay = sorted(d for name, d, _ in found if name == right and d is not None)
        other = {n: names.count(n) for n in dict.fromkeys(names) if n not in columns}
        middle = [delay[len(delay) // 2], delay[int(0.95 * (len(delay) - 1))]] if delay else [None, None]
        rows.append([fault, right, f"{names.count(right)}/{len(names)}", *(names.count(c) or None for c in columns),
                     ", ".join(f"{k} {v}" for k, v in other.items()), *middle,
                     sum(r for _, _, r in found) or None])
    return [(f"first sensor named, {options.seeds} draws each, hinge model 30 % wrong, noise x{options.noise:g}",
             ("", "should be", "right>", *(f"{c}>" for c in columns), "other", "median [s]>", "95 % [s]>",
              "reconfigured>"), rows)]


def _smallest_jobs(options):
    return [(draws, {"fault": f, "first": FIRST, "count": min(options.seeds, BLOCK * 2), "noise": options.noise,
                     "size": size * unit}) for f, (unit, _, sizes) in SIZES.items() for size in sizes]


def _smallest(options, values):
    rows, left = [], iter(values)
    for fault, (_, unit, sizes) in SIZES.items():
        right = s.FAULTS[fault][2]
        hits = [sum(name == right for name, _, _ in found) / len(found) for found in (next(left) for _ in sizes)]
        least = None
        for size, share in zip(sizes, hits):
            if share < (0.85 if fault == "position x1.25" else 0.95):
                break
            least = size
        told = ", ".join(f"{a:g}: {100 * h:.0f}" for a, h in zip(sizes, hits))
        rows.append([fault.split(" + ")[0], unit, least, told])
    return [("smallest fault from which on the right sensor is named in 95 % of the draws (position scale: 85 %)",
             ("sensor", "size", "smallest>", "size: per cent right"), rows)]


def _bias_jobs(options):
    return [(draws, {"fault": "velocity + 10 % of no-load", "first": FIRST, "count": min(options.seeds, 30),
                     "noise": options.noise, "size": sign * share * NO_LOAD, "command": command})
            for share in SHARES for command in COMMANDS for sign in (1.0, -1.0)]


def _bias(options, values):
    rows, found = [], _grouped(values, len(SHARES))
    for share, runs in zip(SHARES, found):
        names = [name for name, _, _ in runs]
        told = ", ".join(f"{n} {names.count(n)}" for n in sorted(set(names)))
        rows.append([f"{100 * share:g} %", len(runs), sum(r for _, _, r in runs), told])
    return [("velocity bias, share of no-load, in four commands and both signs: never reconfigures",
             ("bias", "draws>", "reconfigured>", "named"), rows)]


HELD = (("f_p", 5 * RAD_PER_DEG * ARM, "+ 5 deg"), ("f_p", 15 * RAD_PER_DEG * ARM, "+ 15 deg"), ("z_p", 1.0, "frozen"))


def _held_jobs(options):
    seeds = range(FIRST, FIRST + min(options.seeds, 20))
    return [(held, {"field": f, "size": size, "bias": bias, "seed": n, "seconds": 320.0 if bias == 1e-3 else 85.0})
            for f, size, _ in HELD for bias in (1e-4, 1e-3) for n in seeds]


def _held(options, values):
    cases = [(name, bias) for _, _, name in HELD for bias in (1e-4, 1e-3)]
    n = len(values) // len(cases)
    rows = []
    for i, (name, bias) in enumerate(cases):
        runs = values[n * i : n * (i + 1)]
        until = sorted(r["until_s"] for r in runs if r["until_s"] is not None)
        first = until[0] if until else f"> {min(r['looked_s'] for r in runs):.0f}"
        rows.append([f"position {name}", f"{bias:g}", n, max(r["surface_deg"] for r in runs),
                     max(r["estimate_deg"] for r in runs), first, len(until), sum(r["valid"] for r in runs)])
    return [("bench, after reconfiguration: largest of all runs from 2 to 62 s after it, and when the estimate is "
             "0.5 deg off", ("fault", "velocity bias [no-load]>", "runs>", "surface - reference [deg]>",
             "estimate [deg]>", "first 0.5 deg off [s]>", "runs that get there>", "valid for 60 s>"), rows)]


def _flight_jobs(options):
    seeds = range(FIRST, FIRST + min(options.seeds, 20))
    return [(flights.position_fault, {"name": f, "seed": n, "noise": options.noise})
            for f in flights.POSITION for n in seeds]


def _flight(options, values):
    n = len(values) // len(flights.POSITION)
    rows = []
    for i, name in enumerate(flights.POSITION):
        runs = values[n * i : n * (i + 1)]
        delay = [r["delay_s"] for r in runs if r["delay_s"] is not None]
        rows.append([name, f"{sum(r['named'] == 'position' for r in runs)}/{n}", max(delay, default=None),
                     max(r["dnz"] for r in runs), min(r["dnz_without"] for r in runs),
                     max(r["dnz_without"] for r in runs), max(r["surface_deg"] for r in runs),
                     max(r["estimate_deg"] for r in runs), f"{sum(r['valid'] for r in runs)}/{n}"])
    return [("in flight, against the same flight without the fault: n_z over 30 s; surface and estimate from 2 to 62 s "
             "after reconfiguration; velocity bias 1e-4 of no-load, rigging up to 0.08 deg",
             ("fault", "position named>", "latest [s]>", "n_z most [g]>", "without reconf. least [g]>", "most [g]>",
              "surface [deg]>", "estimate [deg]>", "valid>"), rows)]


def _loop_jobs(options):
    seeds = range(FIRST, FIRST + min(options.seeds, 10))
    return [(flights.loop_fault, {"name": f, "seed": n, "path": path, "noise": options.noise})
            for f in flights.CURRENT for path in ("loop", "monitor") for n in seeds]


def _loop(options, values):
    cases = [(f, path) for f in flights.CURRENT for path in ("loop", "monitor")]
    n = len(values) // len(cases)
    rows = []
    for i, (name, path) in enumerate(cases):
        runs = values[n * i : n * (i + 1)]
        told = [", ".join(r["names"]) for r in runs]
        rows.append([name, path, sum(r["reconfigured"] for r in runs), max(r["dnz"] for r in runs),
                     max(r["surface_deg"] for r in runs),
                     "; ".join(f"{t} ({told.count(t)})" for t in dict.fromkeys(told))])
    return [(f"current faults in flight, {n} flights each: in the drive's own loop, and on the monitor's copy",
             ("fault", "path", "reconfigured>", "n_z most [g]>", "surface most [deg]>", "verdicts"), rows)]


def questions() -> list[Question]:
    """Return the Questions of the study."""
    made = [
        Question("confusion", "which sensor is named, tolerances, no fault (bench; 1 min)", _confusion_jobs,
                 _confusion),
        Question("smallest", "smallest fault of each sensor (bench; 1 min)", _smallest_jobs, _smallest),
        Question("bias", "velocity biases of 0.2 to 10 % never reconfigure (bench; 1 min)", _bias_jobs, _bias),
        Question("held", "how long the estimate holds after reconfiguration (bench; 1 min)", _held_jobs, _held),
        Question("flight", "position faults in flight, with and without reconfiguration (4 min)", _flight_jobs,
                 _flight),
        Question("loop", "current faults in the loop and on the monitor's copy, in flight (3 min)", _loop_jobs, _loop),
    ]
    return [replace(question, seeds=100) for question in made]
