"""The log score of a detector that answers in probabilities: ln of what it gave to the truth, so that honesty pays.

A proper score [Good 1952]: on average nobody gains by saying anything but what they believe. An answer holds until the
next one; where nothing has been said yet every class is as likely.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from fdi.common.verdict import NAMES

LEAST = 1e-6  # no answer counts as less: a single certain error would otherwise be endless
UNSAID = math.log(1.0 / len(NAMES))


def log_score(
    told: Sequence[tuple[int, Mapping[str, float]]], classes: Sequence[str], first: int, last: int
) -> float | None:
    """Return the mean of ln p(any of `classes`) over the ticks first <= k < last; None without a tick.

    `told` is [(tick, {class: probability})] in order of time.
    """
    if last <= first:
        return None
    if not told:
        return UNSAID
    at = np.array([k for k, _ in told])
    p = np.array([sum(said.get(c, 0.0) for c in classes) for _, said in told], float)
    each = np.concatenate([[UNSAID], np.log(np.clip(p, LEAST, 1.0))])
    return float(np.mean(each[np.searchsorted(at, np.arange(first, last), side="right")]))
