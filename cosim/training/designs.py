"""Stored designs: what there is, how it is made from the aircraft in the tree, and whether it still belongs to it.

A design is a JSON file in `fdi/designs/` with a digest of the numbers it was made from, as parsed from the aircraft's
XML and the actuators' parameters: a comment or a blank in a file changes nothing, a coefficient does.
"""

import functools
import hashlib
import importlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import fdi
from actuators.ema import actuator as ema
from actuators.ema import servo as ema_servo
from actuators.hydraulic import actuator as hydraulic
from actuators.hydraulic import servo
from cosim.files import replace_text
from cosim.flight.detection import stored_designs
from cosim.flight.plant.aero_functions import numbers_digest
from cosim.scenario.aircraft import load_aircraft
from fdi.common import compact

FOLDER = Path(fdi.__file__).resolve().parent / "designs"


@dataclass(frozen=True)
class Maker:
    """Where a design comes from: `module`.`function`(progress) returns what the file holds but for its `digest`.

    Where the module has a function `wrong`(held), it says what is wrong with the numbers, "" for nothing.
    """

    module: str
    function: str
    what: str
    digest: str = "source"  # the key of its digest, of `DIGESTS`


DESIGNS = {
    "rfafe": Maker("cosim.training.rfafe", "published", "Sun13 estimator with elevator positions"),
    "rfafe_airframe": Maker("cosim.training.rfafe", "airframe", "Sun13 estimator on airframe outputs"),
    "lpv_smo": Maker("cosim.training.lpv", "single", "Alwi14 LPV model and observer", "aircraft_sha256"),
    "lpv_smo_boxes": Maker("cosim.training.lpv", "several", "the same over the whole trim envelope", "aircraft_sha256"),
}


def build(name: str, *, folder: str | Path = FOLDER, progress: Callable[..., Any] | None = None) -> Path:
    """Make design `name` anew, write it, return its path; `progress(text)` hears each step. KeyError: unknown name."""
    maker, tell = DESIGNS[name], progress or (lambda text: None)
    tell(f"{name}: {maker.what}")
    made = getattr(importlib.import_module(maker.module), maker.function)(lambda text: tell(f"{name}: {text}"))
    path = Path(folder) / f"{name}.json"
    replace_text(path, compact.text({maker.digest: DIGESTS[maker.digest](), **made}))
    return path


def check(name: str, *, folder: Any = FOLDER) -> str:
    """Return "" when the stored design `name` belongs to the aircraft in the tree and holds, else what is wrong."""
    maker, path = DESIGNS[name], Path(folder) / f"{name}.json"
    if not path.is_file():
        return f"there is no {path.name}; make it with: python -m cosim.training designs"
    try:
        held = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        return f"{path.name} cannot be read: {error}"
    if held.get(maker.digest) != DIGESTS[maker.digest]():
        return f"{path.name} was made from another aircraft or other actuators; mend: python -m cosim.training designs"
    return getattr(importlib.import_module(maker.module), "wrong", lambda held: "")(held)


@functools.cache
def source() -> str:
    """Return the digest of the aircraft's numbers and the actuators' and servos' nominal parameters."""
    found = hashlib.sha256(stored_designs.digest(load_aircraft()).encode())
    for module in (hydraulic, servo, ema, ema_servo):
        p = module.params()
        # v_run is how fast a runaway fault may be: of no healthy motion
        for value in np.concatenate([np.ravel(p[name]) for name in p.dtype.names if name != "v_run"]):
            found.update(f"{value:.6e};".encode())  # gains come from linear algebra: last digits are the processor's
    return found.hexdigest()


# the digest of all that decides about a design: the Sun13 estimators' also of the actuators
DIGESTS: dict[str, Callable[[], str]] = {
    "source": source, "aircraft_sha256": lambda: numbers_digest(load_aircraft().folder),
}  # fmt: skip
