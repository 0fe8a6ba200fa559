"""Several boxes of the schedule, each with its own affine model and observer: one file for all of them."""

import dataclasses
import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from fdi.common import compact
from fdi.lpv_smo.model import LpvModel
from fdi.lpv_smo.synthesis import Design, array, digest

MODEL = ("A", "B", "C", "D", "box", "trim")
DIGITS = 10  # significant ones of the numbers in the file


def rounded(model: Any) -> Any:
    """Return `model` with the numbers that the file will hold: a design belongs to these."""
    return dataclasses.replace(model, **{k: _short(getattr(model, k)) for k in MODEL})


def save(pairs: Sequence[Any], path: str | Path, **facts: Any) -> None:
    """Write the list `pairs` of (LpvModel, Design) as JSON to `path`, with `facts` (numbers, strings) beside them."""
    held = []
    for model, made in pairs:
        one = {"model_sha256": digest(model), "model": {k: getattr(model, k).tolist() for k in MODEL}}
        plain = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in dataclasses.asdict(made).items()}
        held.append(one | {"design": plain})
    Path(path).write_text(compact.text({**facts, "boxes": held}), encoding="utf-8")


def load(path: str | Path | None = None) -> list[tuple[LpvModel, Design]]:
    """Return [(LpvModel, Design), ...] of `path`, by default those stored for this aircraft.

    Raises FileNotFoundError when there is none, ValueError when a design was made for another model than beside it.
    """
    source = resources.files("fdi").joinpath("designs", "lpv_smo_boxes.json") if path is None else Path(path)
    if not source.is_file():
        raise FileNotFoundError("no stored boxes of the LPV design; make them with: cosim design")
    out = []
    for one in json.loads(source.read_text(encoding="utf-8"))["boxes"]:
        A, B, C, D, box, trim = (np.array(one["model"][k]) for k in MODEL)
        model = LpvModel(A, B, C, D, box, trim)
        if digest(model) != one["model_sha256"]:
            raise ValueError("a stored box of the LPV design does not belong to its model; mend: cosim design")
        out.append((model, Design(**{k: array(v) for k, v in one["design"].items()})))
    return out


def _short(values):
    values = np.asarray(values, float)
    return np.array([float(f"{v:.{DIGITS - 1}e}") for v in values.ravel()]).reshape(values.shape)
