"""Time per step of a detector."""

import math
import time
from typing import Any

import numpy as np


def cost(module: Any, x: np.ndarray, u: np.ndarray, p: np.ndarray, dt: float, repeats: int = 200) -> float:
    """Return the microseconds of one step of one lane: the best of three times `repeats` steps, on copies.

    `x`, `p` are STATE and PARAMS (lanes,), `u` INPUTS (lanes, 1) of one tick, `dt` [s].
    """
    x, u, best = x.copy(), np.repeat(u, repeats, axis=1), math.inf
    for _ in range(3):
        begin = time.perf_counter()
        module.rollout(x, u, p, dt)
        best = min(best, time.perf_counter() - begin)
    return best / repeats / len(x) * 1e6
