"""Decision thresholds of the detectors: numbers that were trained or published, kept as data in `fdi/thresholds/`.

One file per detector, `<detector>.json`, holds one object per set ("published", "flight") of PARAMS fields in SI, and
under "training" how the flight set was found (seeds, margin, maxima). What was trained for another aircraft lies in
`thresholds/` of that aircraft's folder and replaces the fields that it has.
"""

import json
import math
from importlib import resources
from pathlib import Path
from typing import Any


def thresholds(detector: str, which: str = "flight", own: Any = None) -> dict:
    """Return {PARAMS field: number or row, SI} of set `which`; an unknown set or a bad value raises ValueError.

    `own` is the folder of an aircraft with thresholds of its own, None: those of the aircraft of `fdi`.
    """
    text = resources.files("fdi").joinpath("thresholds", f"{detector}.json").read_text(encoding="utf-8")
    sets = {k: v for k, v in json.loads(text).items() if k != "training"}
    if which not in sets:
        raise ValueError(f"{detector}: threshold set {which!r} is not one of {sorted(sets)}")
    file = Path(own) / "thresholds" / f"{detector}.json" if own else None
    trained = json.loads(file.read_text(encoding="utf-8")).get(which, {}) if file and file.is_file() else {}
    if unknown := trained.keys() - sets[which].keys():
        raise ValueError(f"{file}: {detector} has no threshold {sorted(unknown)[0]!r}")
    found = {**sets[which], **trained}
    for name, value in found.items():
        parts = value if isinstance(value, list) else [value]
        if not all(isinstance(v, int | float) and math.isfinite(v) for v in parts):
            raise ValueError(f"{detector}: threshold {name} = {value!r} is no finite number")
    return found
