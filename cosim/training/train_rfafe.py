"""Thresholds of the Sun13 estimators from fault-free flights that nothing else uses.

`python -m cosim.training rfafe`: flights at six points (that of Sun13, A to E of Alwi14) or of the envelope, six
manoeuvres begun at 5 to 35 s and three levels of turbulence, 60 s long, each coefficient and each symbol of the
actuators up to 5 % off; in turn all elevators are hydraulic, or the right ones electromechanical. A threshold is MARGIN
times the largest amplitude of f_hat, less the command's share, that any flight holds for nearly as many fits in a row
as make an alarm, each of the shape that passes for an oscillation. `rfafe_airframe` is trained at its design's point.
"""

import math
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from actuators.block import kernel
from cosim.scenario.aircraft import DEFAULT, load_aircraft
from cosim.scenario.catalog import toleranced
from cosim.training import flights as drawn
from cosim.training.flights import FLIGHT_S, MANOEUVRES, MODULES, NOISE_SCALE, POINT, POINTS, TOLERANCE, TURBULENCE
from cosim.training.rfafe import point_of
from cosim.training.train_ema import EXACT
from cosim.training.trainer import Limits, Training
from fdi.common import bank
from fdi.rfafe.decision import NF

ELEVATORS = (("hydraulic",) * 4, ("hydraulic", "hydraulic", "ema", "ema"))  # in turn; the second is the default
MARGIN = 1.25  # 1.2 times the maximum of 40 flights left 1 alarm in 300
RESERVE = 0.3  # of the largest amplitude that only its shape refused: no threshold hangs on the shape alone
SPARE = 2  # thresholds stand on so many fits in a row less than an alarm takes
LEAST = math.radians(0.05)  # two and a half sigma of one position sample
SHARES = np.linspace(0.0, 2.0, 11)  # of the command, to choose from
RATE = 30.0  # within that of the servos [deg/s]
ONSET_S = 12.0  # of the oscillations whose answer is measured: both estimators judge by then [s]
# four of every combination in training, with other seeds; two in the evaluation
SETS = (4, len(POINTS), len(MANOEUVRES), len(TURBULENCE))
FIRST_SEED = 1000


def flight(first_seed: int, index: int) -> dict[str, Any]:
    """Return the arguments of `scenario` for flight `index` of a set: each point, manoeuvre and air once, hydraulic,
    then with EMA on the right, then both again with the points drawn over the envelope."""
    repeat, at, kind, air = np.unravel_index(index, SETS)
    seed = first_seed + index
    rng = np.random.default_rng([seed, 1])
    start = {"start_s": float(rng.uniform(5.0, 35.0))} if MANOEUVRES[kind] != "cruise" else {}
    made = drawn.draw(seed, point=POINTS[at], manoeuvre={"kind": MANOEUVRES[kind], **start}, turbulence=TURBULENCE[air])
    made["tolerances"]["ema"] = {n: float(1.0 + EXACT.get(n, TOLERANCE) * rng.uniform(-1.0, 1.0))
                                 for n in toleranced("ema")}  # fmt: skip
    made |= {"technology": ELEVATORS[repeat % len(ELEVATORS)], "sensors": {"noise_scale": NOISE_SCALE}}
    return drawn.somewhere(made) if repeat >= len(ELEVATORS) else made


def surveyed(**flown: Any) -> dict[str, list]:
    """Fly and return {estimator: what `survey` returns}."""
    frame = drawn.fly_aircraft(**flown)
    return {name: survey(frame, name, drawn.fitted(name, flown["technology"])) for name in MODULES}


@kernel
def _fits(log, p, out):
    """Fill out (fits, 5) with estimate and frequency, tick, |f_hat|, |command|, right shape of every renewed fit;
    return n."""
    n = 0
    for i in range(log.size):
        if log[i].valid < 0.5:
            continue
        for k in range(bank.K):
            if log[i].bank_new[k] < 0.5:
                continue
            for j in range(int(p.nf)):
                out[n, 0], out[n, 1] = j * bank.K + k, i
                out[n, 2], out[n, 3] = bank.amplitude(log[i], k, j), bank.amplitude(log[i], k, NF)
                out[n, 4] = 1.0 if bank.shaped(log[i], p, k, j, 0.0) or bank.shaped(log[i], p, k, j, 1.0) else 0.0
                n += 1
    return n


def survey(recorded: Any, name: str, p: Any) -> list:
    """Return [runs (share, frequency), any (share, frequency), slow] of a fault-free flight, amplitudes in SI.

    runs: the largest amplitude, less share times the command's, that lasts for SPARE fits less than make an alarm, all
    of an oscillation's shape: what a threshold must not be below. any: the largest of any fit, whatever its shape.
    slow: the largest slow part, less its share of the command.
    """
    log = drawn.estimate(recorded, name, p)
    out = np.zeros((40 * len(log), 5))  # at most a few fits a tick
    fits = out[: _fits.compiled(log, p[0], out)]
    step = (p["bank_block"][0][p["bank_level"][0].astype(int)] * p["bank_stride"][0]).astype(int)
    hits = int(p["hits"][0]) - SPARE
    runs, whatever = np.zeros((len(SHARES), bank.K)), np.zeros((len(SHARES), bank.K))
    for of in range(int(p["nf"][0]) * bank.K):
        _, tick, f, u, passes = fits[fits[:, 0] == of].T
        k = of % bank.K
        for j, share in enumerate(SHARES):
            beyond = f - share * u
            whatever[j, k] = max(whatever[j, k], beyond.max(initial=0.0))
            if len(tick) >= hits:
                lasting = sliding_window_view(np.where(passes > 0.5, beyond, 0.0), hits).min(axis=1)
                in_a_row = tick[hits - 1 :] - tick[: 1 - hits or None] == (hits - 1) * step[k]
                runs[j, k] = max(runs[j, k], lasting[in_a_row].max(initial=0.0))
    late = log[log["valid"] > 0.5]
    command = p["unit"][0] * np.abs(late["u"][:, :1])  # both sides have one command
    slow = np.abs(late["slow"][:, : int(p["nf"][0])]) - p["static_share"][0] * command
    return [runs.tolist(), whatever.tolist(), float(slow.max(initial=0.0))]


def answers(aircraft: str = DEFAULT) -> dict[str, np.ndarray]:
    """Return {estimator: (frequency,)} how much command the law answers an oscillation of one hydraulic segment with,
    over the amplitude of f_hat, in still air at the point of the designs: it is lost by the threshold's share."""
    own, found = load_aircraft(aircraft), []
    technology = ("hydraulic",) * len(own.segments)
    p = {name: drawn.fitted(name, technology, aircraft) for name in MODULES}
    segment = own.segments[len(own.segments) // 2 - 1]
    for k, hz in enumerate(bank.frequencies()):
        fault = {"target": f"elevator.{segment}", "kind": "ofc_liquid", "at": "command", "start_s": ONSET_S,
                 "amplitude_deg": min(4.0, RATE / (2.0 * math.pi * hz)), "frequency_hz": float(hz)}  # fmt: skip
        frame = drawn.fly_level(duration=ONSET_S + max(8.0 / hz, 3.0), faults=[fault], technology=technology,
                                flight=own.points[point_of(own)], aircraft=aircraft)  # fmt: skip
        last = [drawn.estimate(frame, name, p[name])[-1] for name in MODULES]
        f, u = (np.array([math.hypot(x["bank_cos"][i, k], x["bank_sin"][i, k]) for x in last]) for i in (0, NF))
        found.append(u / np.maximum(f, 1e-12))
    return dict(zip(MODULES, np.transpose(found)))


def fields(found: list[list], answer: np.ndarray) -> tuple[dict, dict]:
    """Return the trained fields of an estimator and the record of how they were found: `found` is what `survey` says of
    each flight, `answer` what `answered` does at each frequency.

    A larger share of the command lets the threshold be lower, but the law answers a fault with command: the share is
    taken at which the least oscillation passes, threshold / (1 - share answer).
    """
    runs, whatever, static = (np.max(part, axis=0) for part in zip(*found))
    static = float(static)
    threshold = np.maximum(np.maximum(MARGIN * runs, RESERVE * whatever), LEAST)
    left = 1.0 - SHARES[:, None] * answer
    best = np.argmin(np.where(left > 0.05, threshold / np.maximum(left, 0.05), np.inf), axis=0)
    at = (best, np.arange(bank.K))
    made = {"bank_threshold": threshold[at].tolist(), "bank_share": SHARES[best].tolist(), "th_static": MARGIN * static}
    how = {"flights": len(found),
           "largest": runs[at].tolist(), "largest_any_shape": whatever[at].tolist(), "largest_static": static,
           "answer": answer.tolist(), "frequency_hz": bank.frequencies().tolist()}  # fmt: skip
    return made, how


def limits(found: dict[str, list], aircraft: str = DEFAULT) -> Limits:
    """Return the thresholds of what `survey` found in every flight, {estimator: [...]}."""
    answer, out = answers(aircraft), {}
    for name, rows in found.items():
        made, how = fields(rows, answer[name])
        out[name] = ({"flight": made}, how)
    return out


def limits_of_set(flown: list[dict]) -> Limits:
    """Return the thresholds of what `surveyed` found in the first flights of a set: of rfafe_airframe in those at
    Sun13's point."""
    places = (np.unravel_index(i, SETS)[:2] for i in range(len(flown)))
    here = [f for f, (repeat, at) in zip(flown, places) if repeat < len(ELEVATORS) and POINTS[at] == POINT]
    return limits({name: [f[name] for f in of] for name, of in (("rfafe", flown), ("rfafe_airframe", here))})


def flights(first_seed: int, number: int) -> list[dict[str, Any]]:
    """Return the arguments of `scenario` of the first flights of a set."""
    return [flight(first_seed, i) for i in range(number)]


RFAFE = Training(FIRST_SEED, math.prod(SETS), flights, surveyed, limits_of_set,
                 {"flight_s": FLIGHT_S, "margin": MARGIN})  # fmt: skip
