"""Sensor faults of the catalogue on the aircraft signals of recordings: a part of the page that cosim/replay/real.py
writes.

A recording is cut into windows; every third one stays as it is, in the others a fault acts from FAULT_S on to the end.
What is counted is the share of windows in which a detector begins an alarm after FAULT_S, with a fault and without.
"""

from pathlib import Path
from typing import Any

import numpy as np

from cosim.flight.blocks import faults as f
from cosim.flight.faults import inject
from cosim.judge import coverage
from cosim.judge.alarms import onsets
from cosim.replay.detector_replay import output_names
from cosim.replay.map import prepare, run_all
from cosim.replay.real import MAPS, recordings
from cosim.replay.real_commands import FAULT_S, FREE, WINDOW_S
from cosim.scenario import Scenario, load_scenario

FAULTS = ("alpha-bias", "alpha-freeze", "alpha-drift", "q-noise", "theta-dropout", "cas-scale", "nz-oscillation")
SETS = ("citation", "attas_stall")


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
    kinds = ["" if k % FREE == 0 else known[(k - k // FREE - 1) % len(known)] for k in range(made.n // size)]
    for k, name in enumerate(kinds):
        if name:
            lane = inject.lanes(scenarios[name])[0]
            value, valid = made.values[_signal(scenarios[name])]
            broken(value, valid, lane, k * size, size, made.dt, k)
    out = []
    for d, _, _, again in run_all(made, {})[0]:
        names = output_names(d)
        valid, rises = again[:, names.index("valid")] > 0.5, onsets(again[:, names.index("alarm")]) * d.every
        for k, name in enumerate(kinds):
            a, b = k * size + late, (k + 1) * size
            good = bool(valid[a // d.every : b // d.every].mean() > 0.5)
            out.append((d.id, name, good, bool(np.any((rises >= a) & (rises < b)))))
    return out


def _signal(scenario):
    return scenario.faults[0].target.rpartition(".")[2]


def page(folder: Path) -> str:
    """Return the part of the page about sensor faults, "" where no set has any."""
    keys = [f"duration_s={WINDOW_S:g}", f"faults.0.start_s={FAULT_S:g}", f"faults.0.end_s={WINDOW_S:g}"]
    scenarios = {name: load_scenario(name, keys) for name in FAULTS}
    found = [row for s, path in recordings(folder) if s.map in SETS
             for row in counted(path, MAPS / f"{s.map}.toml", scenarios)]  # fmt: skip
    head = "| detector | fault | is it designed for it | valid windows | an alarm begins in |"
    lines = [head, "|---|---|---|---|---|"]
    for name in dict.fromkeys(row[0] for row in found):
        for fault in ("", *FAULTS):
            own = [row for row in found if row[0] == name and row[1] == fault and row[2]]
            case = coverage.cases(scenarios[fault])[0] if fault else ""
            word = coverage.expected(name, case) if fault else "–"
            lines.append(f"| `{name}` | {fault or 'none'} | {word} | {len(own)} | {sum(row[3] for row in own)} |")
    if not found:
        return ""
    return "\n".join([
        "## Sensor faults on recorded aircraft signals", "",
        f"Windows of {WINDOW_S:g} s of the Citation and the ATTAS, every {FREE}rd without a fault; a fault acts from "
        f"{FAULT_S:g} s of its window to its end.",
        "An alarm that stands all along begins in no window: `kinematic` does not fit these recordings, as said above.",
        "", *lines, "",
    ])  # fmt: skip
