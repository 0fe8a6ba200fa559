"""Stored designs and thresholds of an aircraft: `designs/` and `thresholds/` in its folder.

`python -m cosim.training all --aircraft DIR` makes them. `designs/made.json` says from which
numbers: a detector whose design is of other numbers than fly is left out, as one without.
"""

import hashlib
import json
from typing import Any

from cosim.flight.plant.aero_functions import numbers_digest
from cosim.scenario.aircraft import FOLDER, Aircraft, of_folder

FILE = "made.json"


def lacking(aircraft: Aircraft, record: Any) -> str:
    """Return why a detector of the aircraft level has no design for `aircraft`, or ""."""
    bundled = aircraft.folder.parent == FOLDER
    remedy = f"python -m cosim.training all --aircraft {aircraft.name if bundled else aircraft.folder}"
    files = [aircraft.folder / "thresholds" / f"{record.id}.json"]
    files += [aircraft.folder / "designs" / f"{record.design}.json"] if record.design else []
    if not all(file.is_file() for file in files):
        return f"no design for {aircraft.name} (`{remedy}`)"
    try:
        stored = json.loads((aircraft.folder / "designs" / FILE).read_text(encoding="utf-8"))["aircraft_sha256"]
    except (OSError, ValueError, KeyError, TypeError):
        stored = ""
    return "" if stored == digest(aircraft) else f"its design is of other numbers than {aircraft.name} has (`{remedy}`)"


@of_folder
def _digest(folder, text):
    return hashlib.sha256(f"{numbers_digest(folder)} {text}".encode()).hexdigest()


def digest(aircraft: Aircraft) -> str:
    """Return the digest of the numbers of an aircraft that its designs are made from: JSBSim model and record."""
    record = aircraft.model_dump(mode="json", exclude={"folder", "name", "title", "points"})
    return _digest(aircraft.folder, json.dumps(record, sort_keys=True))
