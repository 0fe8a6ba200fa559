"""Recorded commands through our actuators, with faults: a part of the page that cosim/replay/real.py writes.

The elevator motion of a recording becomes the command, by band-limited interpolation: samples held from tick to tick
would look like an oscillation at the recording's rate. Its speed and angle of attack, less the difference between the
two aircraft's means, make the hinge moment by the transport's model. Windows of WINDOW_S do not overlap, and none is
both fault-free and faulty. Beside them the same faults on windows of simulated flights.
"""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import resample_poly

from cosim.flight.blocks import hinge_model
from cosim.flight.build import build
from cosim.flight.detection import detectors
from cosim.flight.loop.signals import fly
from cosim.judge import coverage
from cosim.judge.detection import watch_of
from cosim.judge.result import judge, judged
from cosim.replay import clock
from cosim.replay.bench import Ride, move
from cosim.replay.detector_replay import output_names
from cosim.replay.map import prepare, run
from cosim.replay.real import MAPS, bounds, recordings
from cosim.scenario import load_scenario

SEGMENT, DT, WINDOW_S, SHORT_S, FAULT_S = "left_inner", 0.005, 60.0, 30.0, 20.0
FAULTS = ("liquid-ofc", "solid-ofc", "solid-jam", "runaway")  # scenarios, with their amplitudes
FREE = 3  # every third window is fault-free
SETS = ("citation", "attas", "attas_stall")  # with deflection, speed and angle of attack, 60 s and more
SLOWEST = 60.0  # [m/s]: below, the aircraft is on the ground
FLIGHT_S, SIMULATED = 600.0, 12  # length and number of the simulated flights
BATCH = 48  # lanes at a time: bounds the memory


def band_limited(t: np.ndarray, y: np.ndarray, dt: float) -> tuple[float, np.ndarray]:
    """Return (first time, samples every `dt`) of samples y at times t [s]: nothing above half the recorded rate."""
    step = clock.interval(t)
    good = np.isfinite(y)
    even = np.interp(np.arange(t[0], t[-1] + 0.5 * step, step), t[good], y[good])
    ratio = Fraction(step / dt).limit_denominator(1000)
    return float(t[0]), resample_poly(even - even[0], ratio.numerator, ratio.denominator, padtype="line") + even[0]


def rides(path: Path, map_path: Path, seconds: float = WINDOW_S) -> list[Ride]:
    """Return the Rides of a recording: its windows of `seconds` that are airborne and without a gap."""
    made = prepare(path, map_path)
    got: dict[str, Any] = {}
    for name in ("de_cmd", "alpha", "cas", "q"):
        t, y, _ = made.channels[name]
        got[name] = band_limited(t, made.map.signals[name].factor(made.sources[name].unit) * y, DT)
    t = made.channels["de_cmd"][0]
    gaps = t[1:][np.diff(t) > 5.0 * clock.interval(t)]
    start = max(first for first, _ in got.values())
    cut = {name: y[round((start - first) / DT) :] for name, (first, y) in got.items()}
    size, n = round(seconds / DT), min(map(len, cut.values()))
    low, high = load_scenario("cruise").aircraft.travels["elevator"]
    out = []
    for a in range(0, n - size + 1, size):
        own = {name: y[a : a + size] for name, y in cut.items()}
        here = start + a * DT
        whole = not np.any((gaps > here) & (gaps <= here + seconds)) and np.isfinite(list(own.values())).all()
        if whole and own["cas"].min() > SLOWEST:
            command = np.clip(own["de_cmd"], low, high)
            out.append(Ride(command, own["alpha"], own["cas"], own["q"], f"{path.name}, {here:.0f} s"))
    return out


def simulated(number: int = SIMULATED) -> list[Ride]:
    """Return the Rides of `number` fault-free flights of FLIGHT_S, in three levels of turbulence."""
    names = ["law.law.de_cmd", "truth.aircraft.alpha", "truth.aircraft.cas", "truth.aircraft.q"]
    size, out = round(WINDOW_S / DT), []
    for k in range(number):
        air = ("none", "light", "moderate")[k % 3]
        keys = [f"seed={900 + k}", f"duration_s={FLIGHT_S:g}", f"flight.turbulence={air}", "detectors.enabled=[]",
                "manoeuvre.kind=nz_doublet", "manoeuvre.start_s=30"]  # fmt: skip
        flown = fly(load_scenario("cruise", keys), names)
        for a in range(0, len(flown) - size + 1, size):
            command, alpha, cas, q = (flown[n].to_numpy()[a : a + size] for n in names)
            out.append(Ride(command, alpha, cas, q, f"simulated {k + 1}, {a * DT:.0f} s"))
    return out


def loads(found: list[Ride], rng: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the hinge moments (2, lanes, ticks) that the actuators meet, and those that the detectors' model says."""
    setup = build(load_scenario("cruise", ["detectors.enabled=[]"]))
    hinge: Any = setup.loop.hinge
    p = hinge.p[setup.loop.bus.lanes["hinge_model"].index(SEGMENT)]
    u = np.zeros((len(found), len(found[0].command)), hinge_model.INPUTS)
    for name in ("alpha", "cas", "q"):
        u[name], u[f"{name}_valid"] = [getattr(r, name) for r in found], 1.0
    u["alpha"] += p["alpha_0"] - u["alpha"].mean(axis=1, keepdims=True)
    own = np.repeat(p[None], len(found))
    own["k"] = 1.0
    log = np.zeros(u.shape, hinge_model.STATE)
    hinge_model.rollout(hinge_model.init(own), u, own, DT, log)
    truth = np.array([log["hm0"], log["hmd"]])
    return truth, truth * (1.0 + 0.2 * rng.uniform(-1.0, 1.0, (1, len(found), 1)))


def ridden(found: list[Ride], seed: int) -> Iterable[tuple[str, str, dict, float]]:
    """Yield (detector, fault or "", its entry of `judge`, hours) of each detector on each window."""
    seconds = len(found[0].command) * DT
    start = FAULT_S * seconds / WINDOW_S
    free = load_scenario("cruise", [f"duration_s={seconds:g}"])
    broken = {name: load_scenario(name, [f"duration_s={seconds:g}", f"faults.0.start_s={start:g}"])
              for name in FAULTS}  # fmt: skip
    kinds = ["" if k % FREE == 0 else FAULTS[(k - k // FREE - 1) % len(FAULTS)] for k in range(len(found))]
    cases = {c for s in broken.values() for c in coverage.cases(s)}
    installed = [d for d in detectors.chosen(free) if SEGMENT in d.lanes and
                 any(coverage.expected(d.id, c) != coverage.BLIND for c in cases)]  # fmt: skip
    for a in range(0, len(found), BATCH):
        own, kind = found[a : a + BATCH], kinds[a : a + BATCH]
        truth, told = loads(own, np.random.default_rng([seed, a]))
        scenarios = [broken[k] if k else free for k in kind]
        seen = move(own, scenarios, truth, SEGMENT, seed + a)
        seen |= {f"{SEGMENT}.hm0": told[0], f"{SEGMENT}.hmd": told[1], "de_cmd": np.array([r.command for r in own])}
        for d in installed:
            p = d.params(free, DT)[d.lanes.index(SEGMENT)][None]
            names = output_names(d)
            watch = watch_of(d.id, d.level, d.target(SEGMENT), d.module.CULPRITS, {n: i for i, n in enumerate(names)})
            for i, name in enumerate(kind):
                u = np.zeros((1, len(own[i].command)), d.module.INPUTS)
                for w in d.inputs(SEGMENT):
                    u[w.field] = 1.0 if w.flag else seen[w.signal.word][i]
                again = run(d, SEGMENT, u, p, DT)
                yield d.id, name, judge(watch, again, DT * d.every, judged(scenarios[i])), seconds / 3600.0


def table(found: list[Ride], seed: int) -> list[str]:
    """Return the lines of a table: a row for each detector and fault, and one for its false alarms."""
    told: dict[tuple[str, str], list] = {}
    for name, fault, entry, hours in ridden(found, seed):
        told.setdefault((name, fault), []).append((entry, hours))
    head = "detector | fault | windows | seen | right name | delay s, median (largest) | false alarms | in windows"
    out = [f"| {head} |", "|---|---|---|---|---|---|---|---|"]
    for (name, fault), rows in sorted(told.items()):
        wrong = sum(e["false_alarms"] for e, _ in rows)
        with_one = sum(e["false_alarms"] > 0 for e, _ in rows)
        if not fault:
            low, high = bounds(wrong, sum(h for _, h in rows))
            rate = f"{wrong}: {low:.2g} to {high:.2g} per hour"
            out.append(f"| `{name}` | none | {len(rows)} | – | – | – | {rate} | {with_one} |")
            continue
        late = [e["detection_delay_s"] for e, _ in rows if e["detection_delay_s"] is not None]
        delay = f"{np.median(late):.2f} ({max(late):.2f})" if late else "–"
        right = sum(bool(e["right"]) for e, _ in rows)
        out.append(f"| `{name}` | {fault} | {len(rows)} | {len(late)} | {right} | {delay} | {wrong} | {with_one} |")
    return out


def page(folder: Path) -> str:
    """Return the part of the page about recorded commands, "" where no set has any."""
    there = [(path, MAPS / f"{s.map}.toml") for s, path in recordings(folder) if s.map in SETS]
    recorded = [r for path, m in there for r in rides(path, m)]
    if not recorded:
        return ""
    short = [r for path, m in there for r in rides(path, m, SHORT_S)]
    own = simulated(max(1, -(-len(recorded) // round(FLIGHT_S / WINDOW_S))))[: len(recorded)]
    return "\n".join([
        "## Recorded elevator motion as the command of our hydraulic actuator", "",
        f"{len(recorded)} windows of {WINDOW_S:g} s, disjoint, every {FREE}rd fault-free; a fault begins {FAULT_S:g} s "
        "after its window does. That is all",
        "that is airborne, without a gap and with a speed and an angle of attack in the sets. The command is the",
        "recorded deflection, interpolated within its band; hinge moment by the transport's model at the recorded",
        "speed and change of angle of attack; each window's actuator is up to 5 % off, the detectors' hinge moment up",
        "to 20 %. A deflection is smoother than a command: an actuator has filtered it already.", "",
        *table(recorded, 1), "",
        f"The same recordings cut into {len(short)} disjoint windows of {SHORT_S:g} s, the fault from "
        f"{FAULT_S * SHORT_S / WINDOW_S:g} s on:", "",
        *table(short, 3), "",
        f"The same on {len(own)} windows of simulated flights (transport, doublets, no to moderate turbulence):", "",
        *table(own, 2), "",
    ])  # fmt: skip
