"""Every manoeuvre at the papers' points and at the corners of mass, CG, altitude and speed: does any flight depart?

    cosim study manoeuvres                    all three questions, 6 min on one core
    cosim study manoeuvres table              the table, in still air and moderate turbulence

Flights are fault-free, without detectors; the actuators, sensors and the law are those of any flight.
"""

from typing import Any

import numpy as np

from actuators.constants import M_PER_FT, M_S_PER_KT, RAD_PER_DEG
from cosim.flight.plant.point import SIX
from cosim.flight.signals import fly
from cosim.papers.studies import Question
from cosim.scenario import load_scenario

ABOUT = (__doc__ or "").partition("\n")[0]  # python -OO keeps none
KEYS = ("mass_t", "cg_pct", "altitude_ft", "cas_kt")
CORNERS = {  # of mass and CG, and of altitude and speed
    "light fore": dict(zip(KEYS, (200, 25, 20000, 250))),
    "light aft": dict(zip(KEYS, (200, 36, 20000, 250))),
    "heavy fore": dict(zip(KEYS, (405, 25, 20000, 290))),
    "heavy aft": dict(zip(KEYS, (405, 36, 20000, 290))),
    "low slow": dict(zip(KEYS, (200, 30, 2000, 160))),
    "low fast": dict(zip(KEYS, (260, 30, 5000, 340))),
    "high slow": dict(zip(KEYS, (200, 30, 36000, 200))),
    "high fast": dict(zip(KEYS, (260, 30, 36000, 270))),
    "heavy low fast": dict(zip(KEYS, (405, 30, 5000, 340))),
}
POINTS = SIX | CORNERS
SLOW_KT = {"sun13": 150, "A": 170, "B": 175, "C": 210, "D": 235, "E": 190}  # where full back-stick ends at alpha_max
KINDS = ("cruise", "aoa_protection", "nose_up", "pitch_protection", "coordinated_turn", "yaw_angle", "nz_doublet",
         "three_two_one_one")  # fmt: skip
TRUTH = ("alpha", "theta", "phi", "nz", "h", "cas", "de_li")
FIRST_SEED = 3


def flown(point: str, kind: str, *, seconds: float, air: str, seed: int, **more: Any) -> tuple[Any, ...]:
    """Fly one manoeuvre; return (table of TRUTH, de_cmd and protection, parameters of the law); SI, rad."""
    keys = {
        **{f"flight.{k}": v for k, v in POINTS[point].items()}, "flight.turbulence": air, "manoeuvre.kind": kind,
        "duration_s": seconds, "seed": seed, "detectors.enabled": "[]", **more,
    }  # fmt: skip
    law = []
    names = [*(f"truth.aircraft.{n}" for n in TRUTH), "law.law.de_cmd", "law.law.protection"]
    table = fly(load_scenario("cruise", [f"{k}={v}" for k, v in keys.items()]), names,
                prepare=lambda setup: law.append(setup.loop.law.p[0]))  # fmt: skip
    return table.rename(columns=lambda name: name.rpartition(".")[2]), law[0]


def _span(x, unit=1.0):
    return [float(np.min(x) / unit), float(np.max(x) / unit)]


def manoeuvre(point: str, kind: str, air: str, seed: int) -> dict[str, Any]:
    """Return what happened in 60 s of one manoeuvre: spans of load factor, angles [deg], altitude [ft], speed [kt]."""
    f, p = flown(point, kind, seconds=60.0, air=air, seed=seed)
    deg = RAD_PER_DEG
    return {
        "status": f.attrs["status"], "reason": f.attrs["reason"], "nz": _span(f["nz"]), "alpha": _span(f["alpha"], deg),
        "alpha_max": float(p.alpha_max / deg), "theta": _span(f["theta"], deg), "phi": _span(f["phi"], deg),
        "h": _span(f["h"] - f["h"].iloc[0], M_PER_FT), "cas": _span(f["cas"], M_S_PER_KT), "de": _span(f["de_li"], deg),
    }  # fmt: skip


def pull(point: str, air: str, seed: int) -> dict[str, Any]:
    """Return the elevator's work in a pull to alpha_max from a low speed, and in cruise there [deg, deg/s rms]."""
    keys: dict[str, Any] = {"seconds": 26.0, "air": air, "seed": seed, "flight.cas_kt": SLOW_KT[point]}
    f, p = flown(point, "aoa_protection", **keys)
    still, _ = flown(point, "cruise", **keys)
    late = slice(round(8.0 / 0.005), round(25.0 / 0.005))
    angle = [np.degrees(x["de_li"].to_numpy()[late]) for x in (f, still)]
    rate = [float(np.sqrt(np.mean(np.square(np.diff(a) / 0.005)))) for a in angle]
    de = np.degrees(f["de_cmd"].to_numpy()[late])
    ends = np.degrees([p.de_min, p.de_max])
    return {
        "status": f.attrs["status"], "command": _span(de), "rate": rate[0], "cruise": rate[1],
        "stop": float(np.mean((de <= ends[0]) | (de >= ends[1]))),
        "above": float(np.degrees((f["alpha"].to_numpy() - p.alpha_max)[late].max())),
        "protected": float(np.mean(f["protection"].to_numpy()[late] == 1.0)),
    }  # fmt: skip


def turn(point: str, seed: int) -> dict[str, Any]:
    """Return the altitude lost and gained in 60 s at 30 degrees of bank in light turbulence [ft]."""
    f, _ = flown(point, "coordinated_turn", seconds=75.0, air="light", seed=seed)
    return {"status": f.attrs["status"], "h": _span(f["h"] - f["h"].iloc[0], M_PER_FT)}


def _cases(*lists):
    out: list = [()]
    for values in lists:
        out = [(*case, v) for case in out for v in values]
    return out


TABLE = _cases(POINTS, KINDS, ("none", "moderate"))
PULLS = _cases(SLOW_KT, ("none", "light", "moderate", "severe"))


def _table_jobs(options):
    return [(manoeuvre, {"point": p, "kind": k, "air": a, "seed": FIRST_SEED}) for p, k, a in TABLE]


def _between(span, digits=0):
    return f"{span[0]:.{digits}f} to {span[1]:.{digits}f}"


def _table(options, values):
    rows = [
        (p, k, a, _between(v["nz"], 2), f"{_between(v['alpha'], 1)} ({v['alpha_max']:.1f})", _between(v["theta"]),
         _between(v["phi"]), _between(v["de"], 1), _between(v["h"]), _between(v["cas"]), v["reason"] or v["status"])
        for (p, k, a), v in zip(TABLE, values)
    ]  # fmt: skip
    columns = ("point", "manoeuvre", "air", "n_z g>", "alpha (limit) deg>", "theta deg>", "phi deg>", "elevator deg>",
               "altitude ft>", "CAS kt>", "outcome")  # fmt: skip
    told = []
    for air in ("none", "moderate"):
        own = [v for (_, _, a), v in zip(TABLE, values) if a == air]
        told.append((air, len(own), sum(v["status"] == "completed" for v in own), max(v["nz"][1] for v in own),
                     max(v["alpha"][1] - v["alpha_max"] for v in own)))  # fmt: skip
    totals = ("air", "flights>", "completed>", "largest n_z g>", "alpha above its limit deg>")
    return [("Every manoeuvre, 60 s, fault-free", columns, rows), ("All of them", totals, told)]


def _seeds(options):
    return range(FIRST_SEED, FIRST_SEED + options.seeds)


def _pull_jobs(options):
    return [(pull, {"point": p, "air": a, "seed": s}) for p, a in PULLS for s in _seeds(options)]


def _pulls(options, values):
    rows = []
    for i, (point, air) in enumerate(PULLS):
        own = values[i * options.seeds : (i + 1) * options.seeds]
        low, high = min(v["command"][0] for v in own), max(v["command"][1] for v in own)
        rows.append((point, SLOW_KT[point], air, _between((low, high), 1), f"{100 * max(v['stop'] for v in own):.1f}",
                     max(v["rate"] for v in own), max(v["cruise"] for v in own), max(v["above"] for v in own),
                     f"{100 * min(v['protected'] for v in own):.0f}"))  # fmt: skip
    columns = ("point", "CAS kt>", "air", "elevator command deg>", "at a stop %>", "rate deg/s rms>", "in cruise>",
               "alpha above alpha_max deg>", "protected %>")  # fmt: skip
    return [(f"Full back-stick to alpha_max, worst of {options.seeds} flights", columns, rows)]


def _turn_jobs(options):
    return [(turn, {"point": p, "seed": s}) for p in SIX for s in _seeds(options)]


def _turns(options, values):
    rows = []
    for i, point in enumerate(SIX):
        own = values[i * options.seeds : (i + 1) * options.seeds]
        done = sum(v["status"] == "completed" for v in own)
        rows.append((point, f"{done}/{len(own)}", _between((min(v["h"][0] for v in own), max(v["h"][1] for v in own)))))
    return [("30 deg of bank for 60 s in light turbulence", ("point", "completed>", "altitude ft>"), rows)]


def questions() -> list[Question]:
    """Return the Questions of the study."""
    return [
        Question("table", "eight manoeuvres, fifteen points, still and moderate air: 240 flights, 2 min", _table_jobs,
                 _table, 10),
        Question("protection", "full back-stick at low speed in gusts: what the elevator does, 3 min", _pull_jobs,
                 _pulls, 10),
        Question("turns", "30 deg of bank in light turbulence: altitude kept, 1 min", _turn_jobs, _turns, 10),
    ]  # fmt: skip
