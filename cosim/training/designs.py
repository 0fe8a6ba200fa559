"""Stored designs: how they are made from an aircraft, and whether they still belong to it.

A design is a JSON file in `designs/` of an aircraft's folder, of the default aircraft in `fdi/`. There each holds a
digest of its own numbers and of those it was made from, as parsed from the aircraft's XML and the actuators'
parameters: a comment or a blank in a file changes nothing, a coefficient does. Of another aircraft `made.json` holds
that of the aircraft's for all.
"""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

import fdi
from actuators.ema import actuator as ema
from actuators.ema import servo as ema_servo
from actuators.hydraulic import actuator as hydraulic
from actuators.hydraulic import servo
from cosim.files import replace_text
from cosim.flight.detection import stored_designs
from cosim.flight.detection.detectors import unfit
from cosim.scenario.aircraft import DEFAULT, Aircraft, load_aircraft
from cosim.training import lpv, rfafe
from fdi import registry
from fdi.common import tuning

FOLDER = Path(fdi.__file__).resolve().parent / "designs"
MAKERS: dict[str, Callable] = {  # design -> what makes it of (progress, name or folder of an aircraft)
    "rfafe": rfafe.published, "rfafe_airframe": rfafe.airframe, "lpv_smo": lpv.single, "lpv_smo_boxes": lpv.several,
}  # fmt: skip


def make(aircraft: str, progress: Callable[[str], None]) -> None:
    """Make and store the designs of an aircraft, a name or a folder; `progress(text)` hears each step.

    Raises DesignError where no flight point of the envelope has a steady flight.
    """
    own = load_aircraft(aircraft)
    for name, maker in MAKERS.items():
        if own.own_designs and name == "lpv_smo":
            continue  # the box of the paper's aircraft
        progress(name)
        made = maker(lambda text, name=name: progress(f"{name}: {text}"), aircraft)
        folder = own.folder / "designs" if own.own_designs else FOLDER
        folder.mkdir(exist_ok=True)
        replace_text(folder / f"{name}.json", tuning.text({"source": source(aircraft, made), **made}))


def check(aircraft: str = DEFAULT, folder: Path = FOLDER) -> dict[str, str]:
    """Return {design, of another aircraft detector: "" where it belongs to the aircraft, else what is wrong}."""
    own = load_aircraft(aircraft)
    if own.own_designs:
        return _of_detectors(own)
    out = {}
    for name in MAKERS:
        file = folder / f"{name}.json"
        held = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
        wrong = "is not there, spoilt, or of another aircraft or actuators; mend: python -m cosim.training designs"
        out[name] = "" if held.pop("source", "") == source(aircraft, held) else wrong
    return out


def _of_detectors(own: Aircraft) -> dict[str, str]:
    level = [r for n in registry.SHIPPED if (r := registry.record(n)).level == "aircraft" and not r.any_aircraft]
    return {record.id: stored_designs.lacking(own, record) for record in level if not unfit(record, own)}


def source(aircraft: str, made: dict) -> str:
    """Return the digest of an aircraft's numbers, the actuators' and servos' nominal parameters, and what was made."""
    found = hashlib.sha256(stored_designs.digest(load_aircraft(aircraft)).encode())
    for module in (hydraulic, servo, ema, ema_servo):
        p = module.params()
        # v_run is how fast a runaway fault may be: of no healthy motion
        for value in np.concatenate([np.ravel(p[name]) for name in p.dtype.names if name != "v_run"]):
            found.update(f"{value:.6e};".encode())  # gains come from linear algebra: last digits are the processor's
    found.update(tuning.text(made).encode())
    return found.hexdigest()
