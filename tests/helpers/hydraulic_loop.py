"""Lu17 in the loop and over ten minutes: what a servo closes on, and filters that drift against those that do not."""

from typing import Any

import numpy as np

from actuators.common import linkage
from actuators.constants import RAD_PER_DEG
from cosim.flight.loop.signals import detect, fly
from cosim.scenario.catalog import SEGMENTS
from cosim.training.flights import DT, POINT, draw, scenario, watch
from fdi.common import verdict
from fdi.ema import ema_kalman, ema_kalman_flight
from fdi.hydraulic import iotsekf, rtsekf, rtsekf_flight

FEEDBACKS = (("measured", False), ("measured", True), ("iotsekf", False), ("rtsekf", False), ("rtsekf_flight", False))
ONSET, END = 12.0, 30.0  # [s]
BIAS_MM = 5.0
JAM = {"target": "elevator.left_inner", "kind": "jam_liquid", "start_s": ONSET, "bias_mm": BIAS_MM}
DOUBLET = {"kind": "nz_doublet", "start_s": 14.0, "width_s": 3.0, "amplitude_g": 0.15}  # scenario liquid-jam
WATCHED = ("iotsekf", "rtsekf_flight")
LONG_S = 600.0


def feedback_flight(feedback: Any, reconfigure: bool, seed: int) -> dict[str, bool | float]:
    """Fly a liquid jam, the same without it, and the same on measurements without it; return what differs.

    tracking_deg: largest distance of the left inner surface from the servo's reference without fault; nz_free_g: n_z
    without fault against `measured`; peak_deg, late_deg, nz_g: surface and n_z with the jam against without it, late
    from 2 s on; and which detectors say `sensor`.
    """
    names = ["hydraulic.left_inner.delta", "truth.aircraft.nz", "servo.left_inner.r"]
    said = [f"{name}.left_inner.verdict" for name in WATCHED]
    arguments = draw(seed, point=POINT, manoeuvre=DOUBLET, turbulence="light", duration=END)

    def flown(feedback, reconfigure, faults, names):
        elevator = {**dict.fromkeys(SEGMENTS, "hydraulic"), "feedback": feedback, "reconfigure": reconfigure}
        asked = scenario(**arguments, faults=faults, elevator=elevator, detectors={"enabled": list(WATCHED)})
        return fly(asked, names).to_numpy()

    plain = flown("measured", False, [], names)
    free = flown(feedback, reconfigure, [], names)
    jam = flown(feedback, reconfigure, [JAM], [*names, *said])
    k, late, settled = round(ONSET / DT), round((ONSET + 2.0) / DT), round(2.0 / DT)
    off = np.abs(jam[:, :3] - free)
    tracking = np.abs(free[settled:, 0] - free[settled:, 2] / linkage.ARM)
    return {
        "tracking_deg": float(tracking.max() / RAD_PER_DEG),
        "nz_free_g": float(np.abs(free - plain)[:, 1].max()),
        "peak_deg": float(off[k:, 0].max() / RAD_PER_DEG),
        "late_deg": float(off[late:, 0].max() / RAD_PER_DEG),
        "nz_g": float(off[k:, 1].max()),
        **{name: bool((jam[k:, 3 + i] == verdict.SENSOR).any()) for i, name in enumerate(WATCHED)},
    }


def long_flight(seed: int) -> dict[str, dict[str, list[float]] | list[int]]:
    """Fly ten minutes with doublets in light turbulence; return what each filter's test or error grows to, by minute.

    {"minutes": [...], "rows": {what: [largest within that minute]}}; minute 0 is the first ten seconds.
    """
    segments, electric = ("left_outer", "left_inner"), ("right_inner", "right_outer")
    wires = [{n: f"ema_kalman_flight_in.{s}.{n}" for n in ema_kalman_flight.INPUTS.names} for s in electric]
    rods = [f"hydraulic.{s}.q_rod" for s in segments]
    names = [*(f"iotsekf_in.{s}.{n}" for s in segments for n in iotsekf.INPUTS.names), *rods,
             *(path for lane in wires for path in lane.values())]  # fmt: skip
    arguments = draw(seed, point=POINT, manoeuvre={"kind": "nz_doublet"}, turbulence="light", duration=LONG_S)
    v = fly(scenario(**arguments, technology=("hydraulic", "hydraulic", "ema", "ema"),
                     detectors={"enabled": ["iotsekf", "ema_kalman_flight"]}), names)  # fmt: skip
    rows = {}
    for load, word in ((0, "load ignored, as published"), (1, "hinge-moment model")):
        log = watch(v, rtsekf, rtsekf.params(load=load), ("f_hat", "q_now"), segments)
        rows[f"rtsekf, {word}: |f_hat| [mm]"] = 1e3 * np.abs(log["f_hat"])
    log = watch(v, rtsekf_flight, rtsekf_flight.params(), ("f_hat", "q_now"), segments)
    rows["rtsekf_flight: |rod estimate - rod| [mm]"] = 1e3 * np.abs(log["q_now"] - v[rods].to_numpy().T)
    rows["rtsekf_flight: |mean f_hat of the last 5 s| [mm]"] = 1e3 * _mean(log["f_hat"])
    log = detect(v, ema_kalman, _only(wires, ema_kalman), ema_kalman.params("elevator"), ("eta_bar", "R1"))
    rows["ema_kalman: |R1| [mm], threshold 0.5"] = 1e3 * np.abs(log["R1"])
    rows["ema_kalman: |innovation mean|, threshold 3"] = np.abs(log["eta_bar"])
    log = detect(v, ema_kalman_flight, wires, ema_kalman_flight.params(), ("r", "R1"))
    rows["ema_kalman_flight: |R1| [mm]"] = 1e3 * np.abs(log["R1"])
    rows["ema_kalman_flight: largest test over its threshold"] = log["r"]
    minutes = [0, *range(1, round(LONG_S / 60.0) + 1)]
    edges = [(2.0, 10.0), *((60.0 * (i - 1) + (2.0 if i == 1 else 0.0), 60.0 * i) for i in minutes[1:])]
    ticks = [(round(a / DT), round(b / DT)) for a, b in edges]
    return {"minutes": minutes, "rows": {k: [float(r[:, a:b].max()) for a, b in ticks] for k, r in rows.items()}}


def _only(wires, module):
    """Return the wires of the inputs that a module has."""
    return [{n: path for n, path in lane.items() if n in module.INPUTS.names} for lane in wires]


def _mean(f):
    n = round(5.0 / DT)
    total = np.cumsum(np.concatenate([np.zeros((len(f), 1)), f], axis=1), axis=1)
    mean = (total[:, n:] - total[:, :-n]) / n
    return np.abs(np.concatenate([np.zeros((len(f), n - 1)), mean], axis=1))
