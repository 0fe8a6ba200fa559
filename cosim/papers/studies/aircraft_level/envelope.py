"""Detectors of the aircraft level over the trim envelope, on points and seeds that nothing was trained on.

Points are those of the campaigns (cosim/campaigns/points.csv); every coefficient is 5 % off, up or down at random,
noise is 1.2 times that of the set `transport`. A flight without a fault serves several times: errors of sensors that
only the detectors see are added to what it recorded.
"""

import argparse
import csv
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import cosim.campaign
from actuators.constants import RAD_PER_DEG
from cosim.compare.metrics import proportion
from cosim.errors import TrimError
from cosim.flight.detectors import sources
from cosim.flight.signals import detect, fly
from cosim.flight.site import site
from cosim.papers.studies import Table
from cosim.scenario import Scenario
from cosim.scenario.load import load_scenario
from cosim.scenario.tolerance import toleranced
from fdi import registry
from fdi.common.verdict import AMBIGUOUS, SENSOR

POINTS = Path(cosim.campaign.__file__).parents[1] / "campaigns" / "points.csv"
DETECTORS = ("lpv_smo", "control_redundancy", "kinematic", "rfafe_airframe")
AIR = ("none", "light", "moderate")
SEVERE = "severe"  # nothing but false alarms, apart
SWINGS = tuple((hz, *who) for hz in (0.5, 1.0, 2.0) for who in (("elevator.all", 1.0), ("elevator.left", 1.5)))
MANOEUVRES = ("cruise", "coordinated_turn", "yaw_angle", "nz_doublet", "three_two_one_one", "nose_up", "aoa_protection",
              "pitch_protection")  # fmt: skip
FIRST_SEED = 8_600_000
SETTLED, ONSET, END = 8.2, 20.0, 40.0  # [s]
TRIPLE = (
    ("elevator", "f_hat_elevator", 3.0 * RAD_PER_DEG),
    ("n_z", "f_hat_n_z", 0.5),
    ("alpha", "f_hat_alpha", 5.0 * RAD_PER_DEG),
)
# error of a sensor: detector that is asked, sensor, what is added [SI] at a time t since the onset, draws of noise
ERRORS = {
    "theta 1 deg": ("kinematic", "theta", lambda t, n: 1.0 * RAD_PER_DEG + 0 * t),
    "true airspeed 5 m/s": ("kinematic", "tas", lambda t, n: 5.0 + 0 * t),
    "roll rate 1 deg/s": ("kinematic", "p", lambda t, n: 1.0 * RAD_PER_DEG + 0 * t),
    "noise of alpha x 10": ("kinematic", "alpha", lambda t, n: 9 * 1.2 * 0.03 * RAD_PER_DEG * n),
    "noise of n_z x 10": ("kinematic", "n_z", lambda t, n: 9 * 1.2 * 0.007 * n),
    "n_x 0.03 g": ("control_redundancy", "n_x", lambda t, n: 0.03 + 0 * t),
    "n_z drift 0.01 g/s": ("control_redundancy", "n_z", lambda t, n: 0.01 * t),
    "alpha 2 deg": ("control_redundancy", "alpha", lambda t, n: 2.0 * RAD_PER_DEG + 0 * t),
}


def scenario(air: str, manoeuvre: str, seed: int, *more: str) -> Scenario:
    """Return the scenario of one flight: a point of the table, drawn by `seed` with its tolerances."""
    rng = np.random.default_rng(seed)
    with POINTS.open(encoding="utf-8") as file:
        points = list(csv.DictReader(file))
    point = points[int(rng.integers(len(points)))]
    changes = [f"{k}={v}" for k, v in point.items() if k != "name"]
    changes += [f"tolerances.aero.{n}={1 + 0.05 * rng.choice((-1, 1))}" for n in toleranced("aero")]
    given = {"flight.turbulence": air, "manoeuvre.kind": manoeuvre, "seed": seed, "sensors.noise_scale": 1.2,
             "detectors.enabled": "[]"}  # fmt: skip
    if manoeuvre == "coordinated_turn":
        given["manoeuvre.duration_s"] = 35.0
    if manoeuvre == "nose_up":
        given["manoeuvre.amplitude_g"] = 0.3
    return load_scenario("cruise", [*changes, *(f"{k}={v}" for k, v in given.items()), *more])


def _flown(*given):
    wires = [name for d in DETECTORS for name in sources(d).values()]
    try:
        return fly(scenario(*given), wires)
    except TrimError:
        return None


def _watched(frame, name):
    module = registry.module(name)
    at = site(frame.attrs["dt"], "", load_scenario("cruise").elevator.technology)
    return detect(frame, module, sources(name), registry.record(name).fit(at), module.OUTPUTS)


def healthy(air: str, manoeuvre: str, seed: int) -> dict | None:
    """Return, of a flight of 60 s without a fault, {detector: [valid share, alarm]} and {error: [said, delay s]}."""
    frame = _flown(air, manoeuvre, seed, "duration_s=60")
    if frame is None:
        return None
    out, late = {}, frame.index > SETTLED
    for name in DETECTORS:
        log = _watched(frame, name)
        out[name] = [float(log["valid"][late].mean()), bool(log["alarm"].any())]
    if air == SEVERE:
        return {"healthy": out, "errors": {}}
    short = frame[:END]
    short.attrs = frame.attrs
    return {"healthy": out, "errors": {label: _error(short, seed, *case) for label, case in ERRORS.items()}}


def _error(frame, seed, name, sensor, added):
    t = frame.index.to_numpy() - ONSET
    noise = np.random.default_rng(seed + 1).standard_normal(len(t))
    wrong = frame.copy()
    wrong.attrs = frame.attrs
    wrong[f"sensors.{sensor}.y_obs"] += np.where(t >= 0.0, added(t, noise), 0.0)
    log, culprits = _watched(wrong, name), registry.module(name).CULPRITS
    new = np.flatnonzero((log["alarm"] > 0.5) & (t >= 0.0))
    if not len(new):
        return ["none", None]
    if log["alarm"][t < 0.0].any():
        return ["false alarm before", None]
    sure = log[new][log["verdict"][new] != AMBIGUOUS]
    if any(v != SENSOR or culprits[int(c)] != sensor for v, c in zip(sure["verdict"], sure["culprit"], strict=True)):
        return ["wrong", float(t[new[0]])]  # however short
    last = log[-1] if log["alarm"][-1] > 0.5 else log[new[-1]]
    return ["ambiguous" if last["verdict"] == AMBIGUOUS else "right", float(t[new[0]])]


def triple(air: str, manoeuvre: str, seed: int) -> list | None:
    """Return [times to the three names s or None, errors over the faults from 3 s on, valid share, alarm before]."""
    faults = [f"faults.0.{k}={v}" for k, v in {"target": "elevator.all", "kind": "bias", "bias_deg": 3.0,
                                               "start_s": ONSET}.items()]  # fmt: skip
    frame = _flown(air, manoeuvre, seed, f"duration_s={END}", *faults)
    if frame is None:
        return None
    t = frame.index.to_numpy()
    for sensor, size in (("n_z", 0.5), ("alpha", 5.0 * RAD_PER_DEG)):
        frame[f"sensors.{sensor}.y_obs"] += size * (t >= ONSET - 1e-9)
    log = _watched(frame, "lpv_smo")
    named, errors = [], []
    late = (t > ONSET + 3.0) & (log["valid"] > 0.5)
    for name, field, size in TRIPLE:
        on = np.flatnonzero((log[f"alarm_{name}"] > 0.5) & (t >= ONSET))
        named.append(float(t[on[0]] - ONSET) if len(on) else None)
        errors.append(float(np.abs(log[field][late] / size - 1.0).mean()) if late.any() else None)
    return [named, errors, float(log["valid"][t > SETTLED].mean()), bool(log["alarm"][t < ONSET].any())]


def oscillation(hz: float, target: str, size: float, manoeuvre: str, seed: int) -> dict | None:
    """Return {detector: seconds to its alarm or None} of a liquid OFC of `size` [deg] at the command, moderate air."""
    fault = {"target": target, "kind": "ofc_liquid", "at": "command", "amplitude_deg": size, "frequency_hz": hz,
             "start_s": ONSET}  # fmt: skip
    frame = _flown("moderate", manoeuvre, seed, "duration_s=34", *[f"faults.0.{k}={v}" for k, v in fault.items()])
    if frame is None:
        return None
    out, t = {}, frame.index.to_numpy()
    for name, field in (("lpv_smo", "alarm_elevator"), ("rfafe_airframe", "alarm")):
        on = np.flatnonzero((_watched(frame, name)[field] > 0.5) & (t >= ONSET))
        out[name] = float(t[on[0]] - ONSET) if len(on) else None
    return out


def jobs(options: argparse.Namespace) -> list[tuple[Callable[..., Any], dict[str, Any]]]:
    """Return the flights: `seeds` without a fault and as many with three faults in each air, `seeds` in severe air,
    half as many of each oscillation."""
    out: list[tuple[Callable[..., Any], dict[str, Any]]] = []
    seed = FIRST_SEED
    for air in AIR:
        for k in range(options.seeds):
            out.append((healthy, {"air": air, "manoeuvre": MANOEUVRES[k % len(MANOEUVRES)], "seed": seed}))
            out.append((triple, {"air": air, "manoeuvre": ("cruise", "nz_doublet")[k % 2], "seed": seed + 1}))
            seed += 2
    for k in range(options.seeds):
        out.append((healthy, {"air": SEVERE, "manoeuvre": MANOEUVRES[k % len(MANOEUVRES)], "seed": seed + k}))
    seed += options.seeds
    for k in range(options.seeds // 2):
        for hz, target, size in SWINGS:
            case = {"hz": hz, "target": target, "size": size, "manoeuvre": ("cruise", "nz_doublet")[k % 2]}
            out.append((oscillation, {**case, "seed": seed}))
            seed += 1
    return out


def _share(hits, n):
    if not n:
        return "–"
    p = proportion(hits, n)
    return f"{hits}/{n} ({100 * p.low:.0f} to {100 * p.high:.0f} %)"


def tables(options: argparse.Namespace, values: list[Any]) -> list[Table]:
    """Return the Tables; intervals are Clopper and Pearson's at 95 %."""
    done = [(f, a, v) for (f, a), v in zip(jobs(options), values, strict=True) if v is not None]
    quiet = [(a, v) for f, a, v in done if f is healthy]
    three = [(a, v) for f, a, v in done if f is triple]
    rows = []
    for name in DETECTORS:
        for air in (*AIR, SEVERE):
            own = [(a["manoeuvre"], v["healthy"][name]) for a, v in quiet if a["air"] == air]
            calm = [v[0] for m, v in own if not m.endswith("protection")]
            rows.append([name, air, str(len(own)), f"{np.mean([v[0] for _, v in own]):.2f}", f"{np.mean(calm):.2f}",
                         _share(sum(v[1] for _, v in own), len(own))])  # fmt: skip
    faults = []
    for air in AIR:
        own = [v for a, v in three if a["air"] == air]
        last = [max(math.inf if s is None else s for s in v[0]) for v in own]
        errors = np.array([[np.nan if e is None else 100 * e for e in v[1]] for v in own])
        middle, high = np.nanmedian(errors, axis=0), np.nanquantile(errors, 0.95, axis=0)
        faults.append([air, *(_share(sum(s <= most for s in last), len(own)) for most in (1.0, 2.0)),
                       *(f"{m:.1f} / {h:.1f}" for m, h in zip(middle, high))])  # fmt: skip
    named = []
    for label, (name, *_) in ERRORS.items():
        said = [v["errors"][label] for _, v in quiet if v["errors"]]
        words = [w for w, _ in said]
        delays = [d for w, d in said if w == "right"]
        named.append([label, name, _share(words.count("right"), len(said)),
                      *(str(words.count(w)) for w in ("ambiguous", "wrong", "none", "false alarm before")),
                      f"{np.median(delays):.2f}" if delays else "–"])  # fmt: skip
    swung = []
    for hz, target, size in SWINGS:
        flown = [v for f, a, v in done if f is oscillation and (a["hz"], a["target"]) == (hz, target)]
        times = {n: [v[n] for v in flown if v[n] is not None] for n in ("lpv_smo", "rfafe_airframe")}
        when = f"{hz * np.median(times['lpv_smo']):.1f}" if times["lpv_smo"] else "–"
        swung.append([f"{hz:g}", f"{target} {size:g}", *(_share(len(s), len(flown)) for s in times.values()), when])
    return [
        Table("Without a fault, 60 s",
              ("detector", "air", "flights>", "valid>", "without protections>", "with an alarm>"), rows,
              ("valid: share of the time from 8 s on; protections fly beyond the angles at which the aircraft trims",)),
        Table("lpv_smo: elevators 3 deg, n_z 0.5 g and alpha 5 deg at once",
              ("air", "all three named in 1 s>", "in 2 s>", "error of elevator %>", "of n_z %>", "of alpha %>"), faults,
              ("error: mean size from 3 s after the onset on, median / 95 % of the flights",)),
        Table("Errors of sensors, from 20 s on", ("error", "asked", "right>", "ambiguous>", "wrong>", "silent>",
                                                  "alarm before>", "first alarm s>"), named,
              ("right: no other sensor or effector is named at any time",)),
        Table("Oscillating elevators, moderate turbulence, 14 s",
              ("Hz>", "which, deg", "lpv_smo>", "rfafe_airframe>", "lpv_smo's median in periods>"), swung),
    ]  # fmt: skip
