"""What the functions that measure a paper's rows share: inputs of a block, overrides of a flight, numbers in words."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from cosim.flight.plant.point import SIX


def worst(found: Mapping[str, float], form: str = "{} {:.1g}") -> tuple[float, str]:
    """Return (the largest of {what: number}, all of them in words)."""
    return max(found.values()), ", ".join(form.format(*each) for each in found.items())


def farthest(found: Iterable[float]) -> float:
    """Return the number that is farthest from 1."""
    return max(found, key=lambda x: abs(x - 1.0))


def share_of(right: Sequence[bool]) -> tuple[float, str]:
    """Return (share of runs that are right [%], its 95 % interval in words)."""
    from scipy.stats import binomtest  # half a second of import that other papers do not need

    interval = binomtest(sum(right), len(right)).proportion_ci(method="wilson")
    return 100.0 * sum(right) / len(right), f"95 % in {100 * interval.low:.0f} .. {100 * interval.high:.0f}"


def apart(ours: Any, theirs: Any) -> float:
    """Return the largest difference of two arrays over the largest size in the second."""
    return float(np.abs(np.asarray(ours) - theirs).max() / np.abs(theirs).max())


def at_point(point: str) -> list[str]:
    """Return the overrides of a scenario that is flown at a point of SIX."""
    return [f"flight.{k}={v}" for k, v in SIX[point].items()]


def all_valid(block: Any, *shape: int) -> np.ndarray:
    """Return INPUTS of a block in `shape`, zero but for what says that a signal is valid."""
    u = np.zeros(shape or 1, block.INPUTS)
    for name in u.dtype.names:
        if name.endswith("_valid"):
            u[name] = 1.0
    return u
