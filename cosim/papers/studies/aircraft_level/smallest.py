"""The smallest lock offset and thrust loss that control redundancy finds, effector by effector.

A surface drives to an angle off its trim at 20 deg/s and stands there, or thrust is lost, at 24 s, in level flight or
in the doublet of +-0.3 g; coefficients 5 % off and IMU errors as in `cosim.papers.mar10.flights`. Found: the right
effector is the first declared, within `WITHIN` seconds, in every draw, at this size and at every larger one. The law
works against the fault (its integrators, the manoeuvre), so that the angle by which the surface misses its command
grows: that is what residuals see, and it is given for the moment of the declaration.
"""

import math
from typing import Any

import numpy as np

from cosim.flight.detectors import sources
from cosim.flight.signals import detect, fly
from cosim.papers.mar10 import flights
from cosim.papers.studies import Options, Table
from fdi.common.verdict import AMBIGUOUS
from fdi.control_redundancy import control_redundancy

WITHIN, ONSET = 10.0, 24.0  # [s]
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


def faults(target: str, size: int) -> list[str]:
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


def declared(flight: Any, target: str, size: int, draw: Any) -> Any:
    """Fly one fault; return, per set of OPTIONS, what is declared: [[time, effector, missed angle [deg]], ...].

    The missed angle is the mean over the half second before, of the surfaces at fault; 0 for engines.
    """
    wires = sources("control_redundancy")
    surfaces, command = SURFACES.get(target, ((), "de_cmd"))
    names = [*wires.values(), f"law.law.{command}", *(f"truth.aircraft.{s}" for s in surfaces)]
    changes = (*faults(target, size), *FLIGHTS[flight], "duration_s=36")
    flown = fly(flights.scenario(1, draw, changes), names)
    t, missed = flown.index.to_numpy(), np.zeros(len(flown))
    for s in surfaces:
        missed += np.degrees(flown[f"truth.aircraft.{s}"] - flown[f"law.law.{command}"]).to_numpy() / len(surfaces)
    out = []
    for kw in OPTIONS.values():
        log = detect(flown, control_redundancy, wires, flights.detector(**kw))
        out.append([[at, n, float(missed[(t > at - 0.5) & (t <= at)].mean())] for at, n in found(t, log)])
    return out


def found(t: Any, log: Any) -> Any:
    """Return [[time, effector], ...] of a detector's log, in order of time."""
    out = []
    for h, name in enumerate(control_redundancy.EFFECTORS):
        rise = np.flatnonzero(np.diff(np.r_[0.0, log["declared"][:, h]]) > 0)
        out += [[float(t[i]), name] for i in rise]
    unclear = (log["alarm"] > 0.5) & (log["verdict"] == AMBIGUOUS) & (log["culprit"] == 0.0)
    out += [[float(t[i]), "ambiguous"] for i in np.flatnonzero(np.diff(np.r_[0, unclear.astype(int)]) > 0)]
    return sorted(out)


def outcome(target: str, declarations: Any) -> Any:
    """Return ("right", "wrong", "ambiguous" or "missed", missed angle at that time or NaN) of one flight."""
    now = [(n, angle) for t, n, angle in declarations if ONSET <= t <= ONSET + WITHIN]
    clear = [d for d in now if d[0] != "ambiguous"]
    if clear:
        return ("right" if clear[0][0] in EFFECTORS[target][1] else "wrong"), clear[0][1]
    return ("ambiguous", now[0][1]) if now else ("missed", math.nan)


def _cases(draws):
    return [(flight, target, size, d) for flight in FLIGHTS for target, (sizes, _) in EFFECTORS.items()
            for size in sizes for d in range(draws)]  # fmt: skip


def jobs(options: Options) -> list[Any]:
    """Return the flights."""
    return [(declared, dict(zip(("flight", "target", "size", "draw"), key))) for key in _cases(options.seeds)]


def tables(options: Options, values: Any) -> list[Table]:
    """Return the tables: smallest size found, and what came of every size."""
    draws = options.seeds
    got = dict(zip(_cases(draws), values))
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
