"""Windows of recorded flights with faults of the catalogue: two parts of the page that real_flights.py writes.

Commands: the elevator motion of a recording becomes the command of our actuator, by band-limited interpolation, since
samples held from tick to tick would look like an oscillation at the recording's rate. Its speed and angle of attack,
less the difference between the two aircraft's means, make the hinge moment by the transport's model. Beside them the
same faults on windows of simulated flights.
Sensors: a fault acts on an aircraft signal of the recording from FAULT_S of a window to its end; what is counted is the
share of windows in which an alarm begins after FAULT_S, with a fault and without.
Windows do not overlap, and none is both fault-free and faulty.
"""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from recorded_bench import Ride, move
from scipy.signal import resample_poly

from cosim.compare.metrics import rate
from cosim.flight.blocks import faults as f
from cosim.flight.blocks import hinge_model
from cosim.flight.build import build
from cosim.flight.detection import detectors
from cosim.flight.faults import inject
from cosim.flight.loop.signals import fly
from cosim.judge import coverage
from cosim.judge.alarms import onsets
from cosim.judge.detection import watch_of
from cosim.judge.result import judge, judged
from cosim.replay import clock
from cosim.replay.detector_replay import output_names
from cosim.replay.map import prepare, run, run_all
from cosim.scenario import Scenario, load_scenario

LEVEL = 0.95  # of the intervals of alarms per hour
SEGMENT, DT, WINDOW_S, SHORT_S, FAULT_S = "left_inner", 0.005, 60.0, 30.0, 20.0
FREE = 3  # every third window is fault-free
COMMANDS = ("liquid-ofc", "solid-ofc", "solid-jam", "runaway")  # scenarios, with their amplitudes
SENSORS = ("alpha-bias", "alpha-freeze", "alpha-drift", "q-noise", "theta-dropout", "cas-scale", "nz-oscillation")
SLOWEST = 60.0  # [m/s]: below, the aircraft is on the ground
FLIGHT_S, SIMULATED = 600.0, 12  # length and number of the simulated flights
BATCH = 48  # lanes at a time: bounds the memory
Recorded = list[tuple[Path, Path]]  # recordings, each with its map


def bounds(count: int, hours: float) -> tuple[float, float]:
    """Return the exact interval of a Poisson rate per hour, at LEVEL: one-sided where nothing was counted."""
    if hours <= 0.0:
        return 0.0, float("inf")
    found = rate(count, hours, LEVEL if count else 2.0 * LEVEL - 1.0)
    return found.low, found.high


def kinds(n: int, faults: Any) -> list[str]:
    """Return the fault of each of n windows, "" for none."""
    return ["" if k % FREE == 0 else faults[(k - k // FREE - 1) % len(faults)] for k in range(n)]


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
    start, every = FAULT_S * seconds / WINDOW_S, kinds(len(found), COMMANDS)
    free = load_scenario("cruise", [f"duration_s={seconds:g}"])
    broken = {name: load_scenario(name, [f"duration_s={seconds:g}", f"faults.0.start_s={start:g}"])
              for name in COMMANDS}  # fmt: skip
    cases = {c for s in broken.values() for c in coverage.cases(s)}
    installed = [d for d in detectors.chosen(free) if SEGMENT in d.lanes and
                 any(coverage.expected(d.id, c) != coverage.BLIND for c in cases)]  # fmt: skip
    for a in range(0, len(found), BATCH):
        own, kind = found[a : a + BATCH], every[a : a + BATCH]
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


def table(sets: dict[str, list[Ride]]) -> list[str]:
    """Return the lines of a table: a row for each detector and fault, a column for each of the sets {head: rides}."""
    told: dict[tuple[str, str], dict[str, list]] = {}
    for seed, (head, found) in enumerate(sets.items(), 1):
        for name, fault, entry, hours in ridden(found, seed):
            told.setdefault((name, fault), {}).setdefault(head, []).append((entry, hours))
    out = [f"| detector | fault | {' | '.join(sets)} |", "|---|---|" + "---|" * len(sets)]
    for (name, fault), own in sorted(told.items()):
        cells = (_cell(own[head], fault) if head in own else "–" for head in sets)
        out.append(f"| `{name}` | {fault or 'none'} | {' | '.join(cells)} |")
    return out


def _cell(rows, fault):
    """Return what the windows of one detector and fault came to."""
    wrong, n = sum(e["false_alarms"] for e, _ in rows), len(rows)
    if not fault:
        low, high = bounds(wrong, sum(h for _, h in rows))
        return f"{wrong} false alarms in {n}: {low:.2g} to {high:.2g} per hour"
    late = [e["detection_delay_s"] for e, _ in rows if e["detection_delay_s"] is not None]
    delay = f", {np.median(late):.2f} s ({max(late):.2f})" if late else ""
    false = f", {wrong} false alarms" if wrong else ""
    return f"{len(late)} of {n}, {sum(bool(e['right']) for e, _ in rows)} right{delay}{false}"


def broken(value: np.ndarray, valid: np.ndarray, lane: Any, a: int, n: int, dt: float, seed: int) -> None:
    """Let the fault of `lane` act on samples a to a + n of a signal and its flag, in place, as a sensor does
    (cosim/flight/blocks/sensors.py)."""
    u, x = np.zeros((1, n), f.INPUTS), f.init(lane.p)
    u["t"] = np.arange(n) * dt
    log = np.zeros((1, n), f.STATE)
    f.rollout(x, u, lane.p, dt, log)
    for place, source in lane.places:
        on, what = log[source][0], place.rpartition(".")[2][2:]
        here = value[a : a + n]
        first = int(np.argmax(on > 0.0))
        if what == "add":
            here += on
        elif what == "scale":
            here *= 1.0 + on
        elif what == "noise":
            here += on * np.random.default_rng(seed).standard_normal(n)
        elif what == "freeze":
            here[on > 0.0] = here[first]
        elif what == "drop":
            here[on > 0.0] = np.nan
            valid[a : a + n][on > 0.0] = 0.0


def counted(path: Path, map_path: Path, scenarios: dict[str, Scenario]) -> list[tuple[str, str, bool, bool]]:
    """Return (detector, fault or "", whether it was valid, whether an alarm began) of every window of a recording."""
    made = prepare(path, map_path)
    made.values = {name: (np.array(v), np.array(ok)) for name, (v, ok) in made.values.items()}
    size, late = round(WINDOW_S / made.dt), round(FAULT_S / made.dt)
    known = [name for name in scenarios if _signal(scenarios[name]) in made.values]
    every = kinds(made.n // size, known)
    for k, name in enumerate(every):
        if name:
            lane = inject.lanes(scenarios[name])[0]
            value, valid = made.values[_signal(scenarios[name])]
            broken(value, valid, lane, k * size, size, made.dt, k)
    out = []
    for d, _, _, again in run_all(made, {})[0]:
        names = output_names(d)
        valid, rises = again[:, names.index("valid")] > 0.5, onsets(again[:, names.index("alarm")]) * d.every
        for k, name in enumerate(every):
            a, b = k * size + late, (k + 1) * size
            good = bool(valid[a // d.every : b // d.every].mean() > 0.5)
            out.append((d.id, name, good, bool(np.any((rises >= a) & (rises < b)))))
    return out


def _signal(scenario):
    return scenario.faults[0].target.rpartition(".")[2]


CONCLUSION = """\
Thresholds learned in simulation carry over to commands that nobody here made: detectors inside the actuator
raise no more false alarms on recorded motion than on simulated. How soon a jam is seen depends on how much
the command moves: recorded cruise moves less than a simulated doublet, and a monitor that waits for a
difference of command and position waits longer, or for ever. Thresholds of detectors that hold a model of the
airframe do not carry over to another airframe: see the alarms per hour above."""


def command_part(there: Recorded, seconds: float) -> list[str]:
    """Return the lines about recorded commands, [] where no recording has any; `seconds` last the sets together."""
    recorded = [r for path, m in there for r in rides(path, m)]
    if not recorded:
        return []
    short = [r for path, m in there for r in rides(path, m, SHORT_S)]
    own = simulated(max(1, -(-len(recorded) // round(FLIGHT_S / WINDOW_S))))[: len(recorded)]
    return [
        "## Recorded elevator motion as the command of our hydraulic actuator", "",
        f"{len(recorded)} windows of {WINDOW_S:g} s, disjoint, every {FREE}rd fault-free; a fault begins {FAULT_S:g} s "
        "after its window does. That is all",
        "that is airborne, without a gap and with a speed and an angle of attack in the sets. 200 are not to be had:",
        f"all recordings above together, time on the ground and gaps included, last {seconds:.0f} s, which is "
        f"{seconds / WINDOW_S:.0f} windows.",
        f"Hence the same recordings once more, cut into {len(short)} disjoint windows of {SHORT_S:g} s with the fault "
        f"from {FAULT_S * SHORT_S / WINDOW_S:g} s on, and",
        f"the same faults on {len(own)} windows of {WINDOW_S:g} s of simulated flights (transport, doublets, no to "
        "moderate turbulence).", "",
        "The command is the recorded deflection, interpolated within its band; hinge moment by the transport's model",
        "at the recorded speed and change of angle of attack; each window's actuator is up to 5 % off, the detectors'",
        "hinge moment up to 20 %. A deflection is smoother than a command: an actuator has filtered it already.",
        "A cell: windows in which the fault was seen, in which its name was right, delay (median, largest); alarms",
        "that were false where there was one. Each column's seed is its number.", "",
        *table({"recorded, 60 s": recorded, "recorded, 30 s": short, "simulated, 60 s": own}), "",
        *CONCLUSION.splitlines(), "",
    ]  # fmt: skip


def sensor_part(there: Recorded) -> list[str]:
    """Return the lines about sensor faults, [] where no recording has any signal of them."""
    keys = [f"duration_s={WINDOW_S:g}", f"faults.0.start_s={FAULT_S:g}", f"faults.0.end_s={WINDOW_S:g}"]
    scenarios = {name: load_scenario(name, keys) for name in SENSORS}
    found = [row for path, m in there for row in counted(path, m, scenarios)]
    if not found:
        return []
    out = [
        "## Sensor faults on recorded aircraft signals", "",
        f"Windows of {WINDOW_S:g} s, every {FREE}rd without a fault; a fault acts from {FAULT_S:g} s of its window to "
        "its end. An alarm that stands",
        "all along begins in no window: `kinematic` does not fit these recordings, as said above.", "",
        "| detector | fault | is it designed for it | valid windows | an alarm begins in |", "|---|---|---|---|---|",
    ]  # fmt: skip
    for name in dict.fromkeys(row[0] for row in found):
        for fault in ("", *SENSORS):
            own = [row for row in found if row[0] == name and row[1] == fault and row[2]]
            case = coverage.cases(scenarios[fault])[0] if fault else ""
            word = coverage.expected(name, case) if fault else "–"
            out.append(f"| `{name}` | {fault or 'none'} | {word} | {len(own)} | {sum(row[3] for row in own)} |")
    return [*out, ""]
