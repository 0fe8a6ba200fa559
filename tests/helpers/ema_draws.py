"""Draws of the EMA bench: a 3-2-1-1 of 4 deg under its own load, with a hinge-moment model that is 30 % wrong in both
parts, +-5 % on the actuator's symbols, 0.5 to 1.5 times the friction and a velocity bias up to 1e-4 of no-load."""

from typing import Any

import numpy as np
from ema_bench import DT, NO_LOAD, SIGMA, Flight, fly_bench, script, three_two_one_one

from fdi.common import verdict
from fdi.ema.ema_kalman_flight import ISOLABLE_PARTS

SECONDS, START, END = 16.0, 5.0, 10.0
T = np.arange(round(SECONDS / DT)) * DT
ON = (T >= START) & (T < END)
SYMBOLS = ("K_T", "K_B", "R", "J_M", "J_N", "B_M")


def sine(size: float, hz: float) -> Any:
    """Return a sine of the time [s]."""
    return lambda t: size * np.sin(2 * np.pi * hz * t)


def drawn(seed: int, *, command: Any = None, noise: float = 1.0, heals: bool = True, **fields: Any) -> Flight:
    """Return a flown draw with `fields` of the script from START to END, or to the end; numbers or functions of the
    time since START. `command` is a function of the time [s]."""
    rng = np.random.default_rng(seed)
    pulses = sum(three_two_one_one(T, start=s) for s in (1.0, START - 0.4, END + 0.5))
    tick = script(SECONDS, command=pulses if command is None else command(T), factor=rng.choice([0.7, 1.3], 2),
                  hm0=rng.uniform(-2500.0, 2500.0), hmd=-rng.uniform(10e3, 30e3), rng=rng,
                  bias=rng.uniform(-1.0, 1.0) * 1e-4 * NO_LOAD, sigma=tuple(noise * s for s in SIGMA))  # fmt: skip
    on = ON if heals else T >= START
    for name, value in fields.items():
        tick[name][on] = value(T[on] - START) if callable(value) else value
    off = {name: 1.0 + 0.05 * rng.choice([-1.0, 1.0]) for name in SYMBOLS}
    return fly_bench(tick, tolerance=off, friction=rng.uniform(0.5, 1.5), reconfigure=False)


def said(log: np.ndarray) -> list[str]:
    """Return the names from START to END, without repetitions."""
    told = zip(log["verdict"][ON].astype(int), log["isolated_part"][ON].astype(int))
    names = [verdict.NAMES[c] + (f" {ISOLABLE_PARTS[w]}" if w else "") for c, w in told]
    return [b for a, b in zip([None, *names], names) if a != b and b != "none"]
