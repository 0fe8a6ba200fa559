"""The smallest lock offset and thrust loss that control redundancy finds, effector by effector.

A surface drives to an angle off its trim at 20 deg/s and stands there, or thrust is lost, at 24 s, in level flight or
in the doublet of +-0.3 g; coefficients 5 % off and IMU errors as in `redundancy`. Found: the right effector is the
first declared, within `WITHIN` seconds, in every draw, at this size and at every larger one. The law works against the
fault (its integrators, the manoeuvre), so that the angle by which the surface misses its command grows: that is what
residuals see, and it is given for the moment of the declaration.
"""

import math

import numpy as np

from cosim.campaign.jobs import many
from cosim.flight import airframe_wires
from cosim.papers.mar10 import flights
from cosim.papers.recorded import Flown
from cosim.papers.studies.aircraft_level.redundancy import found
from cosim.papers.studies.aircraft_level.table import Table
from fdi.control_redundancy import control_redundancy

DRAWS, WITHIN, ONSET = 10, 10.0, 24.0  # [s]
OPTIONS = {"force": {}, "force+moment": {"rows": "force+moment"}}
RATE = 20.0  # [deg/s]
FLIGHTS = {"level": ("manoeuvre.start_s=60",), "doublet": ()}
SURFACES = {  # target -> surfaces and their command
    "elevator.all": (("de_lo", "de_li", "de_ri", "de_ro"), "de_cmd"), "elevator.left": (("de_lo", "de_li"), "de_cmd"),
    "elevator.left_inner": (("de_li",), "de_cmd"), "aileron.left": (("da_l",), "da_cmd"),
    "aileron.both": (("da_l", "da_r"), "da_cmd"), "rudder": (("dr",), "dr_cmd"),
}  # fmt: skip
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


def declared(flight, target, size, draw):
    """Fly one fault; return, per set of OPTIONS, what is declared: [[time, effector, missed angle [deg]], ...].

    The missed angle is the mean over the half second before, of the surfaces at fault; 0 for engines.
    """
    wires = airframe_wires.control_redundancy()
    surfaces, command = SURFACES.get(target, ((), "de_cmd"))
    names = [*wires.values(), f"law.law.{command}", *(f"truth.aircraft.{s}" for s in surfaces)]
    changes = (*faults(target, size), *FLIGHTS[flight], "duration_s=36")
    flown = Flown(flights.scenario(1, draw, changes), names)
    missed = np.zeros(len(flown.t))
    for s in surfaces:
        missed += np.degrees(flown[f"truth.aircraft.{s}"] - flown[f"law.law.{command}"]) / len(surfaces)
    out = []
    for kw in OPTIONS.values():
        log = flown.run(control_redundancy, wires, flights.detector(**kw))
        out.append([[t, n, float(missed[(flown.t > t - 0.5) & (flown.t <= t)].mean())] for t, n in found(flown.t, log)])
    return out


def outcome(target, declarations):
    """Return ("right", "wrong", "ambiguous" or "missed", missed angle at that time or NaN) of one flight."""
    now = [(n, angle) for t, n, angle in declarations if ONSET <= t <= ONSET + WITHIN]
    clear = [d for d in now if d[0] != "ambiguous"]
    if clear:
        return ("right" if clear[0][0] in EFFECTORS[target][1] else "wrong"), clear[0][1]
    return ("ambiguous", now[0][1]) if now else ("missed", math.nan)


def run(*, draws=DRAWS, out=None, workers=2, progress=None):
    """Return the tables: smallest size found, and what came of every size."""
    jobs = [(flight, target, size, d) for flight in FLIGHTS for target, (sizes, _) in EFFECTORS.items()
            for size in sizes for d in range(draws)]  # fmt: skip
    file = None if out is None else out / "smallest.jsonl"
    got = many(declared, jobs, out=file, workers=workers, progress=progress)
    first, rows = [], []
    words = ("right", "wrong", "ambiguous", "missed")
    for i, label in enumerate(OPTIONS):
        for flight in FLIGHTS:
            for target, (sizes, _) in EFFECTORS.items():
                least = alarmed = angle = math.nan
                good = alarm = True
                for size in sorted(sizes, reverse=True):
                    came = [outcome(target, got[flight, target, size, d][i]) for d in range(draws)]
                    named = [w for w, _ in came]
                    good, alarm = good and named.count("right") == draws, alarm and "missed" not in named
                    if good:
                        least, angle = size, float(np.median([abs(a) for _, a in came]))
                    alarmed = size if alarm else alarmed
                    rows.append((label, flight, target, size, *(named.count(w) for w in words)))
                unit = "% of thrust" if target.startswith("engine") else "deg"
                first.append((label, flight, target, unit, least, angle if unit == "deg" else None, alarmed))
    head = ("rows", "flight", "target", "unit", "right effector from", "missed angle then [deg]", "any alarm from")
    title = f"smallest lock or loss found within {WITHIN:g} s in all of {draws} draws"
    what = f"first declaration within {WITHIN:g} s, of {draws} draws"
    return [Table(title, head, first), Table(what, ("rows", "flight", "target", "size", *words), rows)]
