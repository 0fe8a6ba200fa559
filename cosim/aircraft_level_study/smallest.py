"""The smallest lock offset and thrust loss that control redundancy finds, effector by effector.

A surface drives to an offset from its trim at 20 deg/s and stands there, or thrust is lost, at 24 s in the doublet of
+-0.3 g, coefficients 5 % off and IMU errors as in `redundancy`. Found: the right effector is the first declared, within
`WITHIN` seconds, in every draw, at this size and at every larger one.
"""

import math

from cosim import airframe_wires
from cosim.aircraft_level_study.jobs import many
from cosim.aircraft_level_study.redundancy import found
from cosim.aircraft_level_study.table import Table
from cosim.reproduce import mar10_flights as flights
from cosim.reproduce.flown import Flown
from fdi import control_redundancy

DRAWS, WITHIN, ONSET = 10, 10.0, 24.0  # [s]
OPTIONS = {"force": {}, "force+moment": {"rows": "force+moment"}}
RATE = 20.0  # [deg/s]
ANGLES, LOSSES = (0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0), (5.0, 10.0, 15.0, 20.0, 25.0, 35.0, 50.0, 100.0)
EFFECTORS = {  # target -> (sizes, what is right)
    "elevator.all": (ANGLES, ("elevator",)),
    "elevator.left": (ANGLES, ("elevator",)),
    "elevator.left_inner": (ANGLES, ("elevator",)),
    "aileron.left": (ANGLES, ("aileron",)),
    "aileron.both": (ANGLES, ("aileron",)),
    "rudder": (ANGLES, ("rudder",)),
    "engine.all": (LOSSES, ("engine",)),
    "engine.1": (LOSSES, ("engine", "engine_1")),
}


def faults(target, size):
    """Return the scenario changes of a fault of `size`: degrees, or per cent of thrust."""
    names = ("aileron.left", "aileron.right") if target == "aileron.both" else (target,)
    out = ["faults=[]"]
    for i, name in enumerate(names):
        given = {"target": name, "start_s": ONSET}
        if name.startswith("engine"):
            given |= {"kind": "thrust_loss", "loss_pct": size}
        else:
            given |= {"kind": "runaway", "rate_deg_s": RATE, "limit_deg": size}
        out += [f"faults.{i}.{k}={v}" for k, v in given.items()]
    return out


def declared(target, size, draw):
    """Fly one fault; return, per set of OPTIONS, what is declared: [[time, effector], ...]."""
    wires = airframe_wires.control_redundancy()
    flown = Flown(flights.scenario(1, draw, (*faults(target, size), "duration_s=36")), wires.values())
    return [found(flown.t, flown.run(control_redundancy, wires, flights.detector(**kw))) for kw in OPTIONS.values()]


def outcome(target, declarations):
    """Return "right", "wrong", "ambiguous" or "missed" of one flight."""
    clear = [n for t, n in declarations if ONSET <= t <= ONSET + WITHIN and n != "ambiguous"]
    if clear:
        return "right" if clear[0] in EFFECTORS[target][1] else "wrong"
    return "ambiguous" if any(ONSET <= t <= ONSET + WITHIN for t, _ in declarations) else "missed"


def run(*, draws=DRAWS, out=None, workers=2, progress=None):
    """Return the tables: smallest size found, and what came of every size."""
    jobs = [(target, size, d) for target, (sizes, _) in EFFECTORS.items() for size in sizes for d in range(draws)]
    file = None if out is None else out / "smallest.jsonl"
    got = many(declared, jobs, out=file, workers=workers, progress=progress)
    first, tables = [], []
    for i, label in enumerate(OPTIONS):
        rows = []
        for target, (sizes, _) in EFFECTORS.items():
            least, alarmed = math.nan, math.nan
            good = alarm = True
            for size in sorted(sizes, reverse=True):
                came = [outcome(target, got[target, size, d][i]) for d in range(draws)]
                good, alarm = good and came.count("right") == draws, alarm and "missed" not in came
                least, alarmed = size if good else least, size if alarm else alarmed
                words = ("right", "wrong", "ambiguous", "missed")
                rows.append((target, size, *(came.count(w) for w in words)))
            unit = "% of thrust" if target.startswith("engine") else "deg"
            first.append((label, target, unit, least, alarmed))
        title = f"{label} rows: first declaration within {WITHIN:g} s, of {draws} draws"
        tables.append(Table(title, ("target", "size", "right", "wrong", "ambiguous", "missed"), rows))
    head = ("rows", "target", "unit", "right effector from", "any alarm from")
    return [Table(f"smallest lock offset or loss found in all of {draws} draws", head, first), *tables]
