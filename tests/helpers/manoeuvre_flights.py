"""Flights of every manoeuvre at the papers' points and at the corners of mass, CG, altitude and speed."""

from typing import Any

import numpy as np

from cosim.flight.loop.signals import fly
from cosim.flight.plant.point import SIX
from cosim.scenario import load_scenario

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
TRUTH = ("alpha", "theta", "phi", "nz", "h", "cas", "de_li")


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
