"""Thresholds of the detectors on electromechanical segments from fault-free flights that nothing else uses.

`python -m cosim.training ema`: flights drawn as those of `train_hydraulic`, other seeds, four airs, with
four electromechanical segments of which every symbol is off by up to 5 %, arm and lead by up to 0.3 %, and whose
velocity sensors have the bias that a healthy one may have. PROBABILITY is shared among the tests.

What separates two sizes by design is not trained: the gain of the current (a winding 39 % up is warm, 80 % broken),
the magnets (two tolerances of 5 %), the load that no hinge explains, friction and the current's noise (of which the
limits are noted beside), and the
shares and ratios by which hypotheses are told apart.
"""

from typing import Any

import numpy as np

from cosim.errors import TrimError
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect, fly
from cosim.scenario.catalog import SEGMENTS, toleranced
from cosim.training import flights as drawn
from cosim.training.flights import AIR, DT, FLIGHT_S, NOISE_SCALE, START_S, TOLERANCE
from cosim.training.threshold_fit import PROBABILITY, blocks, exceeded, limit
from cosim.training.trainer import Limits, Training, significant
from fdi.ema import ema_kalman_flight, gains, sensor_noise

FIRST_SEED = 31_000
FLIGHTS = 256  # 8 of every manoeuvre in each air
EXACT = {"arm": 0.003, "lead": 0.003}  # what is machined is off by less
BIAS = 0.0475  # of the velocity sensor, 1e-4 of the rate without load [rad/s]
# both positions less the velocity's integral: 2.1 s of a bias of 1e-3 of no-load, the largest that is learned [m].
# Current less that of the model: 4 % of 7 A, a winding 160 % up, and 1.8 % of the magnets' voltage [A], [A s/rad]. What
# is less is for the gains to tell, and would be called a sensor's before they have
LEASTS = {"th_speed": 2.7e-4, "th_f": 0.285, "rho_f": 0.00112}
LEAST_Z = 2.0  # deviations of a gain: of drives that warm up by 39 % in flight one in 40 may alarm
# test -> thresholds: fixed part, and what grows with a feature
TESTS = {"r_pair": ("pair_threshold",), "r_speed": ("th_speed", "rho_speed"), "r_f": ("th_f", "rho_f")}
ROUGH = ("position", "velocity", "surface")  # sensors whose noise is judged; that of the current is noted beside
NOISIER = 2.0  # times what a healthy sensor shows: what shakes a drive, a jam or a stop, makes good readings rough
GAIN = "z_gain"
SETTLED = round(START_S / DT)  # ticks
NAME = "ema_kalman_flight"
WIRES = [{field: f"{NAME}_in.{lane}.{field}" for field in sources(NAME, lane)} for lane in SEGMENTS]
LOAD, *_ = NOTED = ("load", "friction", "current")  # share of the stall moment, of their thresholds
SHARED = PROBABILITY / (len(TESTS) + len(ROUGH) + 2)


def flights(first_seed: int = FIRST_SEED, number: int = FLIGHTS) -> list[dict[str, Any]]:
    """Return the arguments of `flights.scenario` of every training flight.

    In half of them each parameter of the drive lies anywhere within its tolerance, in half at its edge, up or down.
    """
    out = []
    for k, flight in enumerate(drawn.over_envelope(first_seed, number)):
        rng = np.random.default_rng([flight["seed"], 1])
        share = {n: rng.uniform(-1, 1) for n in toleranced("ema")}
        share = {n: np.sign(x) for n, x in share.items()} if k % 2 else share
        off = {n: float(1 + EXACT.get(n, TOLERANCE) * x) for n, x in share.items()}
        velocity = {"bias_rad_s": float(BIAS * rng.uniform(-1, 1))}
        where = {**flight["flight"], "turbulence": AIR[k // 8 % 4]}
        out.append({**flight, "flight": where, "sensors": {"noise_scale": NOISE_SCALE, "velocity": velocity},
                    "tolerances": {"aero": flight["tolerances"]["aero"], "ema": off}})  # fmt: skip
    return out


def _gain_z(log: np.ndarray, p: Any) -> np.ndarray:
    """Return by how many of its own deviations a gain exceeds its threshold, (ticks,); 0 while it is learned."""
    columns, least = [gains.GAIN, gains.MAGNETS], np.array([p["th_a"], p["th_b"]])
    sd = np.hypot(log["change_sd"][:, columns], log["own_sd"][:, columns])
    beyond = (np.abs(log["change"][:, columns]) - least) / np.maximum(sd, 1e-9)
    return np.where(log["gain_age"] >= gains.LEARN, np.maximum(beyond.max(axis=1), 0.0), 0.0)


def tested(log: np.ndarray, rate: np.ndarray, p: Any) -> dict[str, list]:
    """Return {test: [statistic, features]} of one segment, (ticks,) each; `log` as kept by `survey`, `rate` [rad/s]."""
    features = {"r_speed": [np.abs(rate)], "r_f": [np.sqrt(log["w_power"])]}
    out = {}
    for test, (fixed, *more) in TESTS.items():
        own = features.get(test, [])
        out[test] = [log[test] * sum((p[name] * x for name, x in zip(more, own)), p[fixed]), 1.0, *own]
    out[LOAD] = [np.abs(log["x_hat"][:, 5]) / (0.5 * p["load_max"]), 1.0]
    out["friction"] = [np.maximum(log["r_friction"], 0.0), 1.0]
    *rough, current = np.sqrt(np.maximum(log["rough_power"].T, 0.0))
    out["current"] = [current / sensor_noise.TH_CURRENT, 1.0]
    return out | {name: [row, 1.0] for name, row in zip(ROUGH, rough, strict=True)}


def largest_of(rows: np.ndarray, seconds: int = 8) -> np.ndarray:
    """Return of each `seconds` of blocks the one with the largest statistic: the rest tells a tail nothing."""
    parts = (rows[k : k + seconds] for k in range(0, len(rows), seconds))
    return np.array([part[part[:, 0].argmax()] for part in parts])


def survey(recorded: Any) -> dict[str, Any]:
    """Return {test: blocks of its statistic and features, or largest} over one flight."""
    p = ema_kalman_flight.params()
    p["th_rough"] = 1e9  # a sample counts in full
    fields = ("r_pair", "r_speed", "r_f", "w_power", "gain_age", "change", "change_sd", "own_sd", "x_hat",
              "rough_power", "r_friction")  # fmt: skip
    log = detect(recorded, ema_kalman_flight, WIRES, p, fields)[:, SETTLED:]
    found: dict[str, list] = {test: [] for test in (*TESTS, *ROUGH, *NOTED)}
    z = 0.0
    for wires, own in zip(WIRES, log):
        rate = recorded[wires["y_velocity"]].to_numpy()[SETTLED:]
        for test, (y, *features) in tested(own, rate, p[0]).items():
            found[test].append(largest_of(blocks(y, features, np.ones(len(own), bool), DT)))
        z = max(z, float(_gain_z(own, p[0]).max()))
    filt = {test: np.concatenate(rows).tolist() for test, rows in found.items()}
    return filt | {GAIN: z}


def surveyed(**flight: Any) -> dict[str, Any]:
    """Return what `survey` finds in one flight; where its point does not trim, in that of the next one that does."""
    rng = np.random.default_rng(flight["seed"])
    own = {"technology": ("ema",) * 4, "detectors": {"enabled": [NAME]}}
    signals = [path for wires in WIRES for path in wires.values()]
    while True:
        try:
            return survey(fly(drawn.scenario(**flight | own), signals))
        except TrimError:
            flight = {**flight, "flight": {**flight["flight"], **drawn.envelope(rng)}}


def limits(values: list[dict]) -> Limits:
    """Return the thresholds that follow from what `surveyed` found in every flight."""
    weights: dict[str, list[float]] = {}
    found: dict[str, Any] = {}
    for test in (*TESTS, *ROUGH, *NOTED):
        w, found[test] = limit([np.array(v[test]) for v in values], SHARED)
        weights[test] = w.tolist()
    made: dict[str, Any] = {name: max(weight, LEASTS.get(name, 0.0)) for test, names in TESTS.items()
                            for name, weight in zip(names, weights[test], strict=True)}  # fmt: skip
    # which of two positions is wrong is told by the velocity's integral, no better than by what that may be off itself
    made["pair_threshold"] = max(made["pair_threshold"], made["th_speed"])
    largest = np.array([v[GAIN] for v in values])
    made[GAIN] = max(exceeded(largest, SHARED), LEAST_Z)
    made["th_rough"] = [NOISIER * weights[test][0] for test in ROUGH]
    for test in NOTED:
        found[test]["limit"] = weights[test][0]
    found["r_speed"]["least"], found["r_f"]["least"] = LEASTS["th_speed"], [LEASTS["th_f"], LEASTS["rho_f"]]
    found[LOAD]["held"] = "0.4 of the stall moment"
    found[GAIN] = {"largest": float(largest.max()), "least": LEAST_Z}
    return {NAME: ({"flight": significant(made)}, {"found": found})}


EMA = Training(FIRST_SEED, FLIGHTS, flights, surveyed, limits, {
    "probability_per_flight": PROBABILITY, "flight_s": FLIGHT_S, "segments": 4, "air": list(AIR),
    "noise_scale": NOISE_SCALE, "tolerance": TOLERANCE,
})  # fmt: skip
