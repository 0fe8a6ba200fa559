"""Whether a user's control law flies, repeats, and bears lost measurements: `cosim check law.py`."""

import ast
import math
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pandas as pd

from cosim.errors import CosimError
from cosim.flight.loop.signals import fly
from cosim.flight.plugins.law import SENSORS, SURFACES
from cosim.scenario import load_scenario

LOST_S = 0.5  # that a measurement is lost
STEP = math.radians(0.5)  # of the first elevator command off the trim: more than the noise of the sensors asks for
DOUBLET = "manoeuvre={kind='nz_doublet', start_s=1.0, width_s=1.0, amplitude_g=0.1}"
BASE = ("detectors.enabled=[]", "flight.turbulence=light", DOUBLET)
SEEN = tuple(f"law.law.{field}" for field, *_ in SURFACES.values())
MOTION = ("truth.aircraft.nz", "truth.aircraft.de_li")


def is_law(file: str | Path) -> bool:
    """Tell by its source whether a file is a law: a class `Law`, or a rollout without a detector's record."""
    try:
        tree = ast.parse(Path(file).read_bytes())
    except (OSError, SyntaxError, ValueError):
        return False
    names = {getattr(node, "name", "") for node in tree.body}
    names |= {t.id for node in tree.body for t in getattr(node, "targets", ()) if isinstance(t, ast.Name)}
    names |= {a.asname or a.name for node in tree.body if isinstance(node, ast.ImportFrom) for a in node.names}
    return "Law" in names or ("rollout" in names and "DETECTOR" not in names)


def checks(file: str | Path, tell: Callable[..., None]) -> list[tuple[str, str, str]]:
    """Return (question, "good", "bad" or "note", answer) about the law of a file; `tell(done, total, words)` meanwhile.

    It flies a load-factor doublet in light turbulence, twice, and once while its measurements are lost.
    """
    path = Path(file).resolve()
    tell(0, 3, "while it flew")
    flown, said = _flown(path, 6.0)
    if flown is None:
        return [("flies", "bad", said)]
    out = [("flies", "good", said)]
    tell(1, 3, "while it flew again")
    again, _ = _flown(path, 6.0)
    same = again is not None and np.array_equal(flown.to_numpy(), again.to_numpy(), equal_nan=True)
    told = "twice the same bits" if same else "two flights differ: a seed, a clock, what the first has left behind"
    out.append(("deterministic", "good" if same else "bad", told))
    off = abs(float(flown[SEEN[0]].iloc[0] - flown[MOTION[1]].iloc[0]))
    told = f"its first elevator command is {math.degrees(off):.2g} deg off the trim"
    told += "" if off < STEP else ", which start.elevator holds"
    out.append(("begins at the trim", "good" if off < STEP else "note", told))
    tell(2, 3, "while measurements were lost")
    one = [_lost(name, 1.0 + i * LOST_S) for i, name in enumerate(SENSORS)]
    every = [_lost(name, 1.0 + len(SENSORS) * LOST_S) for name in SENSORS]
    lossy, said = _flown(path, 2.0 + (len(SENSORS) + 1) * LOST_S, [*one, *every])
    told = f"{LOST_S:g} s without each measurement, then without any: {said}"
    return [*out, ("lost samples", "good" if lossy is not None else "bad", told)]


def _lost(name: str, start: float) -> str:
    return f"{{target='sensor.{name}', kind='dropout', start_s={start}, end_s={start + LOST_S}}}"


def _flown(path: Path, seconds: float, faults: Iterable[str] = ()) -> tuple[pd.DataFrame | None, str]:
    """Return (commands and motion of a flight under the law, what it came to); None where it does not fly."""
    own = [f"faults.{i}={fault}" for i, fault in enumerate(faults)]
    changes = [*BASE, f"duration_s={seconds}", f"law.file={path}", *own]
    try:
        found = fly(load_scenario("cruise", changes), [*SEEN, *MOTION])
    except CosimError as error:
        return None, error.problem
    if found.attrs["status"] != "completed":
        return None, f"{found.attrs['status']} after {found.index[-1]:.2f} s: {found.attrs['reason']}"
    n_z = found[MOTION[0]]
    return found, f"{seconds:g} s, n_z {n_z.min():.2f} to {n_z.max():.2f} g"
