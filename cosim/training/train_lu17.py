"""Thresholds of the hydraulic detectors from fault-free flights that nothing else uses.

The flights are those of `flights.flights`: six points, six manoeuvres, three levels of turbulence, 60 s,
aircraft and actuator up to 5 % off, four segments each, DRAWS times; and harsher ones that move the elevator in steps.
A threshold is MARGIN times the largest statistic of any segment in any flight, what scales with the drive left out;
one that needs several samples to agree takes the largest that they agree on. The position monitor
also watches electromechanical segments, which follow hard commands less closely: for it all flights are flown again.

    cosim train hydraulic --check      fly the training set, say what would change
    cosim train hydraulic              and write fdi/thresholds/*.json
"""

import json
from pathlib import Path

import numpy as np
import pandas as pd

import fdi
from cosim.campaign.jobs import work
from cosim.files import replace_text
from cosim.scenario.catalog import SEGMENTS
from cosim.training.flights import DT, POINTS, TURBULENCE, draw, flights, fly_ema, fly_hydraulic, watch, wires
from fdi.common import bank, compact
from fdi.hydraulic import iotsekf
from fdi.monitors import ofc_monitor, position_monitor

MARGIN = 1.25  # 1.2 times the maximum of 40 flights left 1 alarm in 300
DRAWS = 3  # of every combination: 324 flights, the number that evaluation has
TRAINING, EVALUATION = 21_000, 12_000  # first seeds of the two sets
HARSH = 500  # first seed of the harsher flights, after TRAINING
PROTECTIONS = 4  # draws of each protection in moderate turbulence among them
START_S = 2.0  # filters settle
FOLDER = Path(fdi.__file__).parent / "thresholds"
# What noise alone asks for in still air: below it more flights would only find it again [unit of the valve command]
NOISE_SIGMA = 4.5
GRID = np.geomspace(0.2e-3, 8e-3, 24)  # thresholds tried for the crossing counter [m]


def survey_iotsekf(recorded, load):
    """Return {name: largest} over one flight: bank (K,), sum (K,) rms, run; drive's shares left out."""
    p = iotsekf.params(load=load)
    r = p[0]
    fields = ("bank_cos", "bank_sin", "bank_seen", "gain", "gain_den", "f_slow", "u_slow", "valid")
    log = watch(recorded, iotsekf, p, fields)[:, round(START_S / DT) :]
    c = log["bank_cos"][:, :, 0] - log["gain"][..., None] * log["bank_cos"][:, :, 1]
    s = log["bank_sin"][:, :, 0] - log["gain"][..., None] * log["bank_sin"][:, :, 1]
    drive = np.hypot(log["bank_cos"][:, :, 1], log["bank_sin"][:, :, 1])
    share = r["bank_share"] + r["bank_prior"] * r["gain_energy"] / (r["gain_energy"] + log["gain_den"])
    beyond = np.hypot(c, s) - share[..., None] * drive
    full = log["bank_seen"][:, :, r["bank_level"].astype(int)] > r["bank_n"]
    run = np.abs(log["f_slow"]) - r["run_share"] * np.abs(log["u_slow"])
    return {"bank_threshold": np.where(full, beyond, 0.0).max(axis=(0, 1)), "run_threshold": run.max()}


def survey_ofc_monitor(recorded):
    """Return (band,) the largest of GRID at which a band still counts an oscillation in a flight [m], 0 for none."""
    out = np.zeros(ofc_monitor.B)
    for b in range(ofc_monitor.B):
        low, high = -1, len(GRID)  # the largest that counts is at or above low, below high
        while high - low > 1:
            middle = (low + high) // 2
            p = ofc_monitor.params()
            p["threshold"] = 1.0  # the other bands are silent
            p["threshold"][0, b] = GRID[middle]
            counts = (watch(recorded, ofc_monitor, p, ("alarm",))["alarm"] > 0.5).any()
            low, high = (middle, high) if counts else (low, middle)
        out[b] = GRID[low] if low >= 0 else 0.0
    return out


def survey_position_monitor(recorded):
    """Return the largest deviation that lasts for the confirmation time in one flight [rad]."""
    p = position_monitor.params()
    log = watch(recorded, position_monitor, p, ("r",))
    n = round(p["t_confirm"][0] / DT)
    windows = np.lib.stride_tricks.sliding_window_view(np.abs(log["r"][:, round(START_S / DT) :]), n, axis=1)
    return float(windows.min(axis=2).max() * p["threshold"][0])


def survey(recorded):
    """Return every detector's largest statistics over one flight, {detector or set: {name: value}}."""
    out = {f"flight_load{k}": survey_iotsekf(recorded, k) for k in (0, 1, 2)}
    out["ofc_monitor"] = {"threshold": survey_ofc_monitor(recorded)}
    out["position_monitor"] = {"threshold": survey_position_monitor(recorded)}
    return out


def harsh(first_seed):
    """Yield flights with direct elevator pulses and with load-factor doublets, in light and moderate turbulence, and
    more of what drives the elevators fastest and is rare: the protections in moderate turbulence.
    """
    pulses = {"kind": "three_two_one_one", "amplitude_deg": 2.0, "unit_s": 0.5}
    kinds = [(kind, air) for kind in (pulses, {"kind": "nz_doublet"}) for air in TURBULENCE[1:]]
    kinds += [({"kind": kind}, TURBULENCE[-1]) for kind in ("aoa_protection", "pitch_protection")] * PROTECTIONS
    for i, (manoeuvre, turbulence) in enumerate(kinds):
        for j, point in enumerate(POINTS):
            seed = first_seed + i * len(POINTS) + j
            yield draw(seed, point=point, manoeuvre=manoeuvre, turbulence=turbulence)


def surveyed(**flight):
    """Return what `survey` finds in one flight, as plain data."""
    found = survey(fly_hydraulic(**flight))
    return {name: {key: np.asarray(v).tolist() for key, v in values.items()} for name, values in found.items()}


def surveyed_ema(**flight):
    """Return the largest deviation that `position_monitor` sees for long on electromechanical segments, like that."""
    return {"position_monitor_ema": {"threshold": survey_position_monitor(fly_ema(**flight))}}


def training(first_seed=TRAINING, draws=DRAWS):
    """Return the arguments of `flights.scenario` of every training flight."""
    return [*flights(first_seed, draws), *harsh(first_seed + HARSH)]


def train(*, first_seed: int = TRAINING, draws: int = DRAWS, **how) -> dict:
    """Fly the training set; return {"largest": {set: {name: largest}}, "flights": number, "first_seed"}.

    `how`: see `cosim.campaign.jobs.work`.
    """
    hydraulic = training(first_seed, draws)
    jobs = [(surveyed, flight) for flight in hydraulic]
    most: dict = {}
    for flown in work(jobs + [(surveyed_ema, flight) for flight in hydraulic], **how):
        for name, values in flown.items():
            kept = most.setdefault(name, {})
            for key, value in values.items():
                kept[key] = np.maximum(kept.get(key, 0.0), value)
    return {"largest": most, "flights": len(hydraulic), "first_seed": first_seed}


def stored_as(name):
    """Return the threshold set of what training calls `name`."""
    return name if name.startswith("flight") else "flight_ema" if name.endswith("_ema") else "flight"


def store(found: dict) -> None:
    """Write what `train` found into the files that the detectors read, each with how it was found."""
    most = found["largest"]
    how = {"flights": found["flights"], "first_seed": found["first_seed"], "margin": MARGIN, "flight_s": 60.0,
           "segments": 4}  # fmt: skip
    quiet = {k: quiet_floor(k) for k in (0, 1, 2)}
    for file, names in (("iotsekf", [f"flight_load{k}" for k in (0, 1, 2)]), ("ofc_monitor", ["ofc_monitor"]),
                        ("position_monitor", ["position_monitor", "position_monitor_ema"])):
        path = FOLDER / f"{file}.json"
        data = json.loads(path.read_text(encoding="utf-8"))
        for name in names:
            target = data[stored_as(name)]
            for key, value in most[name].items():
                new = MARGIN * np.asarray(value)
                if key == "bank_threshold":
                    new = np.maximum(new, quiet[int(name[-1])]["bank_threshold"])
                target[key] = np.round(new, 7).tolist()
            if file == "iotsekf":
                target["sum_threshold"] = quiet[int(name[-1])]["sum_threshold"]
        largest = {n: {k: np.round(v, 7).tolist() for k, v in most[n].items()} for n in names}
        chosen = {k: v for k, v in data["training"].items() if k == "chosen"}  # what no training finds, and on what
        data["training"] = {**how, "largest": largest, **chosen}
        replace_text(path, compact.text(data))


def quiet_floor(load, seed=1):
    """Return the thresholds that sensor noise alone asks for: a still rod for 60 s, noise of the set `transport`."""
    rng, ticks = np.random.default_rng(seed), round(60.0 / DT)
    p = iotsekf.params(load=load)
    u = np.zeros((4, ticks), iotsekf.INPUTS)
    for name in ("y_rod_valid", "y_surface_valid", "y_dp_valid"):
        u[name] = 1.0
    u["y_rod"] = np.sqrt(p["r_rod"]) * rng.standard_normal((4, ticks))
    u["y_dp"] = np.sqrt(p["r_dp"]) * rng.standard_normal((4, ticks))
    frame = pd.DataFrame({path: u[n][i] for i, s in enumerate(SEGMENTS) for n, path in wires(iotsekf, s).items()})
    frame.attrs["dt"] = DT
    log = watch(frame, iotsekf, p, ("bank_cos", "bank_sin"))[:, round(5.0 / DT) :]
    c, s = log["bank_cos"], log["bank_sin"]
    residual = np.sqrt((c[:, :, 0] ** 2 + s[:, :, 0] ** 2).mean(axis=(0, 1)))
    both = np.sqrt((c.sum(axis=2) ** 2 + s.sum(axis=2) ** 2).mean(axis=(0, 1)))
    assert residual.shape == (bank.K,)
    return {"bank_threshold": NOISE_SIGMA * residual, "sum_threshold": np.round(3.0 * both, 7).tolist()}


def changes(found: dict) -> list[tuple]:
    """Return [(file, set, field, stored, trained)] of every threshold that `store` would write, largest of a row."""
    out = []
    for name, values in found["largest"].items():
        file = name.removesuffix("_ema") if "monitor" in name else "iotsekf"
        held = json.loads((FOLDER / f"{file}.json").read_text(encoding="utf-8"))
        for key, value in values.items():
            stored = np.asarray(held[stored_as(name)][key])
            trained = MARGIN * np.asarray(value)
            k = int(np.argmax(trained / stored)) if stored.ndim else 0
            out.append((file, name, key, float(np.ravel(stored)[k]), float(np.ravel(trained)[k])))
    return out
