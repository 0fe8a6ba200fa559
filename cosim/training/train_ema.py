"""Thresholds of the detectors on electromechanical segments from fault-free flights that nothing else uses.

The flights are drawn as those of `train_lu17`, from other seeds, with four electromechanical segments whose motors are
off by up to 5 % and whose velocity sensors have the bias that a healthy one may have. A threshold is MARGIN, for the
filter's tests WIDE, times the largest statistic of any segment in any flight. What separates two sizes by design is not
trained: the gain of the current (a winding 39 % up is warm, 80 % broken), the magnets (a tolerance of 5 %), the load
that no hinge explains.

    cosim train ema --check      fly the training set, say what would change
    cosim train ema              and write fdi/thresholds/*.json
"""

import json
from typing import Any

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.campaign.jobs import work
from cosim.files import replace_text
from cosim.flight.signals import detect
from cosim.scenario.catalog import SEGMENTS
from cosim.training.flights import DT, SYMBOLS, TOLERANCE, ema_wires, fly_ema
from cosim.training.train_lu17 import FOLDER, MARGIN, NOISE_SCALE, START_S, fitting, training
from fdi.common import compact
from fdi.ema import ema_kalman_flight
from fdi.monitors import position_monitor

TRAINING = 31_000  # first seed
WIDE = 1.8  # margin of the filter's tests: the faults that it is for are far larger, severe air is not in the set
FLIGHTS = 192  # 8 of every manoeuvre in each air
BIAS = 0.0475  # of the velocity sensor, 1e-4 of the rate without load [rad/s]
LEAST = 0.5 * RAD_PER_DEG  # threshold of the position monitor: rigging and a step that is not quite followed [rad]
# statistic over its threshold -> threshold that it sets, and what grows with it
TESTS = {"r_pair": ("pair_threshold",), "r_speed": ("th_speed", "rho_speed"), "r_f": ("th_f", "rho_f"),
         "r_velocity": ("th_vel", "rho_vel", "rho_rate"), "r_jump": ("th_jump",)}  # fmt: skip


def flights(first_seed: int = TRAINING, number: int = FLIGHTS) -> list[dict[str, Any]]:
    """Return the arguments of `flights.scenario` of every training flight."""
    out = []
    for flight in training(first_seed, number):
        rng = np.random.default_rng([flight["seed"], 1])
        off = {name: float(1 + TOLERANCE * rng.uniform(-1, 1)) for name in SYMBOLS}
        velocity = {"bias_rad_s": float(BIAS * rng.uniform(-1, 1))}
        out.append({**flight, "sensors": {"noise_scale": NOISE_SCALE, "velocity": velocity},
                    "tolerances": {"aero": flight["tolerances"]["aero"], "ema": off}})  # fmt: skip
    return out


def _gain_z(sums: np.ndarray, p: Any) -> float:
    """Return by how many of its own deviations a gain exceeds its threshold; `sums` (..., 6) of `drive.gains`."""
    _, fd, fw, dd, dw, ww = np.moveaxis(sums, -1, 0)
    det = dd * ww - dw * dw
    good = det > 1e-6 * dd * ww
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (fd * ww - fw * dw) / det, (fw * dd - fd * dw) / det / p["b_motor"]
        da, db = p["sigma_f"] * np.sqrt(ww / det), p["sigma_f"] * np.sqrt(dd / det) / p["b_motor"]
        z = np.maximum((np.abs(a) - p["th_a"]) / da, (np.abs(b) - p["th_b"]) / db)
    return float(np.max(z[good], initial=0.0))


def survey(recorded: Any) -> dict[str, dict[str, float]]:
    """Return {detector: {threshold: largest statistic over one flight}}, of the position monitor one that lasts."""
    lanes = lambda name: [ema_wires(name, s) for s in SEGMENTS]  # noqa: E731
    p = ema_kalman_flight.params()
    log = detect(recorded, ema_kalman_flight, lanes("ema_kalman_flight"), p, (*TESTS, "gain_sum"))
    late = log[:, round(START_S / DT) :]
    filt = {names[0]: float(late[test].max() * p[names[0]][0]) for test, names in TESTS.items()}
    filt["z_gain"] = _gain_z(late["gain_sum"][:, ::20], p[0])
    q = position_monitor.params("flight_ema")
    log = detect(recorded, position_monitor, lanes("position_monitor"), q, ("r", "lag"))[:, round(START_S / DT) :]
    own = q["share"][0] * log["lag"]
    deviation = np.abs(log["r"]) * (q["threshold"][0] + own) - own
    n = round(q["t_confirm"][0] / DT)
    windows = np.lib.stride_tricks.sliding_window_view(deviation, n, axis=1)
    return {"ema_kalman_flight": filt, "position_monitor": {"threshold": float(windows.min(axis=2).max())}}


def surveyed(**flight: Any) -> dict[str, dict[str, float]]:
    """Return what `survey` finds in one flight."""
    return survey(fitting(fly_ema, flight))


def train(*, first_seed: int = TRAINING, number: int = FLIGHTS, **how: Any) -> dict:
    """Fly the training set; return {"largest": {detector: {statistic: largest}}, "flights", "first_seed"}."""
    most: dict = {}
    for flown in work([(surveyed, flight) for flight in flights(first_seed, number)], **how):
        for name, values in flown.items():
            kept = most.setdefault(name, {})
            for key, value in values.items():
                kept[key] = max(kept.get(key, 0.0), value)
    return {"largest": most, "flights": number, "first_seed": first_seed}


def _stored(name):
    data = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    return data, data["flight_ema" if name == "position_monitor" else "flight"]


def trained(found: dict) -> dict[str, dict[str, float]]:
    """Return {detector: {threshold: trained}} of what `train` found."""
    largest, (_, own) = found["largest"], _stored("ema_kalman_flight")
    new = {name: WIDE * largest["ema_kalman_flight"][names[0]] * own[name] / own[names[0]]
           for names in TESTS.values() for name in names}  # fmt: skip
    new["z_gain"] = max(MARGIN * largest["ema_kalman_flight"]["z_gain"], 3.0)
    monitor = max(MARGIN * largest["position_monitor"]["threshold"], LEAST)
    return {"ema_kalman_flight": new, "position_monitor": {"threshold": monitor}}


def store(found: dict) -> None:
    """Write what `train` found into the files that the detectors read, each with how it was found."""
    how = {"flights": found["flights"], "first_seed": found["first_seed"], "margin": MARGIN, "flight_s": 60.0,
           "segments": 4}  # fmt: skip
    for name, values in trained(found).items():
        data, target = _stored(name)
        target |= {key: float(f"{value:.4g}") for key, value in values.items()}
        margin = MARGIN if name == "position_monitor" else WIDE
        largest = {k: float(f"{v:.4g}") for k, v in found["largest"][name].items()}
        told = {**how, "margin": margin, "largest": largest}
        if name == "position_monitor":
            data["training"]["ema"] = told
        else:
            data["training"] = told
        replace_text(FOLDER / f"{name}.json", compact.text(data))


def changes(found: dict) -> list[tuple]:
    """Return [(file, set, field, stored, trained)] of every threshold that `store` would write."""
    out = []
    for name, values in trained(found).items():
        _, held = _stored(name)
        which = "flight_ema" if name == "position_monitor" else "flight"
        out += [(name, which, key, held[key], value) for key, value in values.items()]
    return out
