"""Which EMA sensor fault is named, how soon, how small: `ema_kalman_flight` on the bench under a 3-2-1-1 of 4 deg.

Every draw has its own load (constant part, stiffness and gusts), a hinge-moment model that is 30 % wrong in both
parts, +-5 % on the actuator's symbols, 0.5 to 1.5 times the friction, a velocity bias up to 1e-4 of no-load and an
onset between 1 s before and 3 s after the manoeuvre starts. Thresholds were chosen on seeds below 1000; take others.
What is asked, and the tables, are in `test_ema_in_flight`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from ema_bench import ARM, DT, NO_LOAD, SIGMA, STALL, Flight, fly_bench, script, three_two_one_one

from actuators.constants import RAD_PER_DEG
from fdi.common import verdict
from fdi.ema.ema_kalman import CULPRITS

SECONDS, START = 14.0, 4.0

# name -> (field of the script, size in its unit, sensor that should be named)
FAULTS = {
    "velocity + 10 % of no-load": ("f_v", 0.1 * NO_LOAD, "velocity"),
    "velocity - 10 % of no-load": ("f_v", -0.1 * NO_LOAD, "velocity"),
    "velocity x1.25": ("s_v", 0.25, "velocity"),
    "position + 1 deg": ("f_p", RAD_PER_DEG * ARM, "position"),
    "position + 5 deg": ("f_p", 5 * RAD_PER_DEG * ARM, "position"),
    "position frozen": ("z_p", 1.0, "position"),
    "position x1.25": ("s_p", 0.25, "position"),
    "current + 10 % of stall": ("f_c", 0.1 * STALL, "current"),
    "current x1.25": ("s_c", 0.25, "current"),
    "no fault": ("f_c", 0.0, "none"),
    "winding resistance + 40 %": ("R", 1.4, "none"),
    "K_T - 5 %": ("K_T", 0.95, "none"),
    "K_B - 5 %": ("K_B", 0.95, "none"),
}
SYMBOLS = ("K_T", "K_B", "R", "J_M", "J_N", "B_M")


@dataclass(frozen=True)
class Outcome:
    """What a run ended with: the first sensor named, else the first class, else "none"; delay [s] from the onset."""

    named: str
    delay: float
    reconfigured: bool
    largest: float  # largest test over its threshold


def draw(
    seed: int, fault: Any = "no fault", *, size: Any = None, noise: Any = 1.0, command: Any = None, onset: Any = None
) -> Any:
    """Return (script, keyword arguments of fly_bench, onset [s]) of one draw; `size` replaces the fault's own."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(SECONDS / DT)) * DT
    tick = script(
        SECONDS,
        command=three_two_one_one(t, start=START) if command is None else command(t),
        factor=rng.choice([0.7, 1.3], 2),
        hm0=rng.uniform(-2500.0, 2500.0),
        hmd=-rng.uniform(10e3, 30e3),
        rng=rng,
        bias=rng.uniform(-1.0, 1.0) * 1e-4 * NO_LOAD,
        sigma=tuple(noise * s for s in SIGMA),
    )
    begin = rng.uniform(START - 1.0, START + 3.0) if onset is None else onset
    tolerance = {name: 1.0 + 0.05 * rng.choice([-1.0, 1.0]) for name in SYMBOLS}
    friction = rng.uniform(0.5, 1.5)
    field, own, _ = FAULTS[fault]
    value = own if size is None else size
    if field in SYMBOLS:
        tolerance = {field: value}
    else:
        tick[field][t >= begin] = value
    return tick, {"tolerance": tolerance, "friction": friction}, begin


def outcome(flight: Flight, begin: Any) -> Outcome:
    """Read an Outcome from a flight."""
    log = flight.log
    late = log[round(1.0 / DT) :]
    largest = float(late["r"].max())
    at = int(np.argmax(log["alarm"] > 0.5))
    if log["alarm"][at] <= 0.5:
        return Outcome("none", np.nan, False, largest)
    named = log["culprit"] > 0
    if named.any():
        name = CULPRITS[int(log["culprit"][np.argmax(named)])]
    else:
        name = verdict.class_name(log["verdict"][at])
    return Outcome(name, at * DT - begin, bool(log["reconf"].any()), largest)


def outcomes(fault: Any, seeds: Sequence[Any], **options: Any) -> list[Outcome]:
    """Return the Outcomes of `fault` over `seeds`; `options` go to `draw`."""
    out = []
    for seed in seeds:
        tick, kwargs, begin = draw(seed, fault, **options)
        out.append(outcome(fly_bench(tick, **kwargs), begin))
    return out


def reconfigured(field: Any, size: Any, *, bias: Any, seed: int, seconds: float = 85.0, onset: Any = 20.0) -> Any:
    """Return (Flight, times [s]): a position fault in motion at `onset`, a velocity bias [of no-load], motion later."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds / DT)) * DT
    command = three_two_one_one(t, start=onset - 0.3) + three_two_one_one(t, start=2 * onset, amplitude=2 * RAD_PER_DEG)
    tick = script(
        seconds,
        command=command,
        hm0=rng.uniform(-2500.0, 2500.0),
        hmd=-rng.uniform(10e3, 30e3),
        factor=rng.choice([0.7, 1.3], 2),
        rng=rng,
        bias=bias * NO_LOAD,
    )
    tick[field][t >= onset] = size
    tolerance = {name: 1.0 + 0.05 * rng.choice([-1.0, 1.0]) for name in SYMBOLS}
    return fly_bench(tick, tolerance=tolerance), t

