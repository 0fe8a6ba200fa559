"""Thresholds of the two monitors of a hydraulic segment from fault-free flights that nothing else uses.

The flights are at points, in manoeuvres as those of `train_aircraft`, begun at 5 to 35 s: FLIGHTS of 60 s, three
levels of turbulence, aircraft and actuator up to 5 % off, noise NOISE_SCALE, four hydraulic segments each. Those of
the crossing counter are at SPEEDS, half of them at corners of the actuator's tolerances, in half of these the three
symbols that matter most as WORST says. What the servo's response is on the mean, and how far a healthy one departs
from it, comes from the same flights; where the manoeuvres of one call for little, it counts little. Each statistic is
held against the motion that it may grow with, at PROBABILITY of a false alarm per flight and detector
(`threshold_fit`). The position monitor of electromechanical segments is trained by `train_ema`.

    cosim train monitors --check      fly the training set, say what would change
    cosim train monitors              and write fdi/thresholds/*.json
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from actuators.block import kernel
from cosim.training.flights import (
    DT,
    FLIGHT_S,
    NOISE_SCALE,
    POINT,
    START_S,
    TOLERANCE,
    TURBULENCE,
    draw,
    drawn_manoeuvre,
    fly_hydraulic,
    somewhere,
    watch,
)
from cosim.training.threshold_fit import PROBABILITY, blocks, exceeded, limit
from cosim.training.trainer import Trained, Training
from fdi.monitors import ofc_monitor, position_monitor

FLIGHTS, FIRST_SEED = 384, 21_000
GRID = np.geomspace(0.1e-3, 8e-3, 32)  # thresholds tried for the crossing counter [m]
LEAST = 0.5e-3  # of the crossing counter's threshold: three times the noise of its residual, 0.17 mm at most [m]
SPEEDS = (180.0, 365.0)  # calibrated airspeed [kt]
# The signs for which a servo misses its reference most: each lowers the rod's speed per valve opening, which is
# phi_n sqrt(P_s) / A_p
WORST = {"A_p": 1.0, "phi_n": -1.0, "P_s": -1.0}
SHARES = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3)  # of the reference's motion, tried beside them


def survey_ofc_monitor(recorded: Any) -> dict[str, np.ndarray]:
    """Return of a flight (band, share) the largest threshold of GRID [m] at which a band still counts an oscillation
    beyond it and each of SHARES of the reference's motion, 0 for none, (band,) that motion's mean [m], and (segments,
    N) the response that is learned at the end.
    """
    p, out = ofc_monitor.params(threshold=1.0), np.zeros((ofc_monitor.B, len(SHARES)))  # no alarm: it learns throughout
    log = watch(recorded, ofc_monitor, p, ("e_band", "ref_peak", "unknown", "limited", "response"))
    for b, k in np.ndindex(out.shape):
        p["share"] = SHARES[k]
        low, high = -1, len(GRID)  # the largest that counts is at or above low, below high
        while high - low > 1:
            middle = (low + high) // 2
            p["threshold"] = GRID[middle]
            counts = any(_counts(ofc_monitor.init(p)[0], p[0], b, own["e_band"][:, b], own["ref_peak"][:, b],
                                 np.maximum(own["unknown"], own["limited"]), DT) for own in log)  # fmt: skip
            low, high = (middle, high) if counts else (low, middle)
        out[b, k] = GRID[low] if low >= 0 else 0.0
    return {"threshold": out, "motion": log["ref_peak"].mean(axis=(0, 1)), "response": log["response"][:, -1]}


@kernel
def _counts(x, p, b, e, motion, unknown, dt):
    """Return whether a residual (ticks,) beside the reference's `motion`, of a response of which the share `unknown` is
    not known yet, ever makes an oscillation in band `b`."""
    x.ages[:] = x.lasts[:] = ofc_monitor.LONG_AGO
    for k in range(len(e)):
        x.e_band[b] = e[k]
        x.ref_peak[b] = motion[k]
        x.unknown = unknown[k]
        if ofc_monitor.count(x, p, b, dt):
            return True
    return False


def survey_position_monitor(recorded: Any) -> np.ndarray:
    """Return the blocks of one flight (blocks, 3): of each second the largest deviation [rad] of any segment that lasts
    for the confirmation time, 1, and the model's lag there [rad]."""
    p = position_monitor.params(threshold=1.0, share=0.0)
    log = watch(recorded, position_monitor, p, ("r", "lag"))[:, round(START_S / DT) :]
    hold, on = float(p["t_confirm"][0]), np.ones(log.shape[1], bool)
    found = np.stack([blocks(np.maximum(np.abs(own["r"]), 1e-9), [1.0, own["lag"]], on, DT, hold) for own in log])
    return np.take_along_axis(found, found[:, :, :1].argmax(axis=0)[None], axis=0)[0]


def flights(first_seed: int = FIRST_SEED, number: int = FLIGHTS) -> list[dict[str, Any]]:
    """Return the arguments of `flights.scenario` of every flight but for its point, which `somewhere` draws."""
    return [draw(first_seed + k, point=POINT, manoeuvre=drawn_manoeuvre(k, first_seed),
                 turbulence=TURBULENCE[k // 8 % 3], sensors={"noise_scale": NOISE_SCALE})
            for k in range(number)]  # fmt: skip


def cornered(flight: dict[str, Any], first_seed: int = FIRST_SEED) -> dict[str, Any]:
    """Return a flight of `flights` as the crossing counter's is: every second group of 24, each manoeuvre in each air,
    at a corner of the actuator's tolerances.
    """
    own, which = flight["tolerances"]["hydraulic"], (flight["seed"] - first_seed) // 24 % 4
    if which % 2 == 0:
        return flight
    rng = np.random.default_rng([flight["seed"], 3])
    sign = {name: rng.choice((-1.0, 1.0)) for name in own} | (WORST if which == 3 else {})
    corner = {name: float(1.0 + TOLERANCE * sign[name]) for name in own}
    return flight | {"tolerances": flight["tolerances"] | {"hydraulic": corner}}


def surveyed(**flight: Any) -> dict[str, Any]:
    """Return what the surveys find in one flight, as plain data."""
    counted = survey_ofc_monitor(fly_hydraulic(**somewhere(cornered(flight), SPEEDS)))
    ofc = {key: value.tolist() for key, value in counted.items()}
    deviations = survey_position_monitor(fly_hydraulic(**somewhere(flight)))
    return {"ofc_monitor": ofc, "position_monitor": deviations.tolist()}


def collect(first_seed: int, number: int, run: Callable[..., Any]) -> list[dict[str, Any]]:
    """Return what `surveyed` finds in every flight."""
    return run([(surveyed, flight) for flight in flights(first_seed, number)])


def limits(flown: list[dict[str, Any]]) -> list[Trained]:
    """Return the thresholds at PROBABILITY of what `surveyed` found in every flight."""
    w, how = limit([np.array(f["position_monitor"]) for f in flown], PROBABILITY)
    ofc = [{key: np.array(value) for key, value in f["ofc_monitor"].items()} for f in flown]
    motion = np.mean([f["motion"] for f in ofc], axis=0)
    fields, largest = _shared(np.array([f["threshold"] for f in ofc]), motion)
    learned = np.array([f["response"] for f in ofc])  # (flights, segments, N)
    moved = np.array([f["motion"] for f in ofc]).sum(axis=1) ** 2
    usual = np.average(learned.mean(axis=1), axis=0, weights=moved)
    departs = ofc_monitor.departure(learned - usual).max(axis=1)
    fields |= {"usual": usual.tolist(), "most": exceeded(departs, PROBABILITY)}
    position = dict(zip(("threshold", "share"), w.tolist(), strict=True))
    return [Trained("position_monitor", "flight", position, {"found": how}),
            Trained("ofc_monitor", "flight", fields, {"found": {
                "largest": largest, "departure": float(departs.max())}})]  # fmt: skip


def _shared(found, motion):
    """Return threshold and share of each band, of SHARES the one with the least limit at the mean `motion` (band,) of
    the reference, and the largest that was seen there; `found` (flights, band, share)."""
    each = np.array([[exceeded(found[:, b, k], PROBABILITY / ofc_monitor.B) for k in range(len(SHARES))]
                     for b in range(ofc_monitor.B)])  # fmt: skip
    each = np.maximum(each, LEAST)
    best = (each + np.array(SHARES) * motion[:, None]).argmin(axis=1)
    band = np.arange(ofc_monitor.B)
    fields = {"threshold": each[band, best].tolist(), "share": np.array(SHARES)[best].tolist()}
    return fields, found.max(axis=0)[band, best].tolist()


TRAINING = Training("monitors", FIRST_SEED, FLIGHTS, collect, limits, {
    "probability_per_flight": PROBABILITY, "flight_s": FLIGHT_S, "segments": 4, "noise_scale": NOISE_SCALE,
})  # fmt: skip
