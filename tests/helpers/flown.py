"""Short flights for tests: fly a scenario without a log and keep the named signals of every tick."""

import math
from types import SimpleNamespace

import numpy as np

import cosim
from cosim.flight.plant.point import SIX

POINTS = SIX | {"low slow": {"mass_t": 200, "cg_pct": 30, "altitude_ft": 2000, "cas_kt": 160}}
LAW = ("de_cmd", "da_cmd", "dr_cmd", "stab_cmd", "throttle_cmd", "protection", "alpha_lim", "n_c")
TRUTH = ("alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "cas", "h", "hdot", "nz", "de_li", "da_l", "dr", "stab")


def scenario(point="sun13", kind="cruise", **more):
    """Return a scenario at `point` without detectors; `more` are keys with "__" for the dot."""
    values = {
        **{f"flight.{k}": v for k, v in POINTS[point].items()},
        "flight.turbulence": "none", "manoeuvre.kind": kind, "detectors.enabled": [], "duration_s": 40.0,
    }  # fmt: skip
    values |= {key.replace("__", "."): value for key, value in more.items()}
    return cosim.load_scenario("cruise", [f"{k}={v}" for k, v in values.items()])


def fault(i, target, kind, start, end, **numbers):
    """Return the keys of fault `i` for `scenario`; `end` None for good."""
    keys = {"target": target, "kind": kind, "start_s": start, **({} if end is None else {"end_s": end}), **numbers}
    return {f"faults__{i}__{k}": v for k, v in keys.items()}


def achieved(s):
    """Return how far the faults of scenario `s` move its elevators."""
    return cosim.simulate(s, achieved=True, timed=False).extra["achieved"]


def fly(s, *more):
    """Fly `s`; return as attributes the signals TRUTH and LAW, the last two parts of `more`, joined by "_", `t` [s],
    `status` and `setup`.
    """
    kept = SimpleNamespace()
    names = {f"truth.aircraft.{n}": n for n in TRUTH} | {f"law.law.{n}": n for n in LAW}
    names |= {n: "_".join(n.split(".")[1:]) for n in more}
    table = cosim.fly(s, list(names), prepare=lambda setup: setattr(kept, "setup", setup))
    for path, name in names.items():
        setattr(kept, name, table[path].to_numpy())
    kept.t, kept.status = table.index.to_numpy(), table.attrs["status"]
    return kept


def deg(x):
    """Return degrees."""
    return np.degrees(x)


def wrapped(psi):
    """Return an angle within half a turn [rad]."""
    return (psi + math.pi) % (2 * math.pi) - math.pi
