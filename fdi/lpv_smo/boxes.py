"""Several boxes of the schedule, each with its own affine model and observer: one file for all of them."""

from pathlib import Path

import numpy as np

from fdi.common import compact
from fdi.lpv_smo.model import LpvModel
from fdi.lpv_smo.synthesis import Design, pair

DIGITS = 10  # significant ones of the numbers in the file


def rounded(model: LpvModel) -> LpvModel:
    """Return `model` with the numbers that the file will hold, without names: a design belongs to these."""
    held = {k: v for k, v in vars(model).items() if isinstance(v, np.ndarray)}
    short = np.vectorize(lambda v: float(f"{v:.{DIGITS - 1}e}"), otypes=[float])
    return LpvModel(**{k: short(v) for k, v in held.items()})


def load(own: str | Path | None = None) -> list[tuple[LpvModel, Design]]:
    """Return [(LpvModel, Design), ...] of the boxes that are stored; see `fdi.common.compact.read`."""
    return [pair(one) for one in compact.read("lpv_smo_boxes", own)["boxes"]]
