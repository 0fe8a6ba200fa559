"""Whether a user's control law flies, repeats, and bears lost measurements: `cosim check law.py`."""

import ast
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cosim.errors import CosimError
from cosim.flight.loop.signals import fly
from cosim.flight.plugins.law import SENSORS, SURFACES
from cosim.scenario import load_scenario

if TYPE_CHECKING:
    import pandas as pd

FLIGHT_S = 20.0  # several periods of the short-period mode after the doublet
ASKED = 0.1  # [g] of the doublet
GUSTS = 0.5  # [g] largest change of load factor that is called light turbulence (WMO-No. 958, AMDAR)
SETTLED_S = 5.0  # from when on nothing is asked
GROWTH = 2.0  # of the load factor's RMS, from the first half of the rest to its second: the same gusts for every law
LOST_S = 0.5  # that a measurement is lost
STEP = math.radians(0.5)  # of the first elevator command off the trim: more than the noise of the sensors asks for
DOUBLET = "manoeuvre={kind='nz_doublet', start_s=1.0, width_s=1.0, amplitude_g=" + f"{ASKED:g}}}"
BASE = ("detectors.enabled=[]", "flight.turbulence=light", DOUBLET)
SEEN = tuple(f"law.law.{field}" for field, *_ in SURFACES.values())
MOTION = ("truth.aircraft.nz", "truth.aircraft.de_li")


def is_law(file: str | Path) -> bool:
    """Tell by its source whether a file is a law: a class `Law`, or a rollout without a detector's record or an
    actuator's init_at."""
    try:
        tree = ast.parse(Path(file).read_bytes())
    except (OSError, SyntaxError, ValueError):
        return False
    names = {getattr(node, "name", "") for node in tree.body}
    names |= {t.id for node in tree.body for t in getattr(node, "targets", ()) if isinstance(t, ast.Name)}
    names |= {a.asname or a.name for node in tree.body if isinstance(node, ast.ImportFrom) for a in node.names}
    return "Law" in names or ("rollout" in names and not names & {"DETECTOR", "init_at"})


def checks(file: str | Path, tell: Callable[..., None]) -> list[tuple[str, str, str]]:
    """Return (question, "good", "bad" or "note", answer) about the law of a file; `tell(done, total, words)` meanwhile.

    It flies a load-factor doublet in light turbulence, twice, and once while its measurements are lost. It flies, where
    the load factor stays within what was asked and what such gusts do, and does not grow.
    """
    path = Path(file).resolve()
    tell(0, 3, "while it flew")
    flown, said = _flown(path, FLIGHT_S)
    if flown is None:
        return [("flies", "bad", said)]
    wrong = _strays(flown)
    off = abs(float(flown[SEEN[0]].iloc[0] - flown[MOTION[1]].iloc[0]))
    told = f"its first elevator command is {math.degrees(off):.2g} deg off the trim"
    told += "" if off < STEP else ", which start.elevator holds"
    begins = ("begins at the trim", "good" if off < STEP else "note", told)
    if wrong:
        return [("flies", "bad", f"{wrong}: {said}"), begins]
    out = [("flies", "good", said)]
    tell(1, 3, "while it flew again")
    again, _ = _flown(path, FLIGHT_S)
    same = again is not None and np.array_equal(flown[: len(again)].to_numpy(), again.to_numpy(), equal_nan=True)
    told = "twice the same bits" if same else "two flights differ: a seed, a clock, what the first has left behind"
    out += [("deterministic", "good" if same else "bad", told), begins]
    tell(2, 3, "while measurements were lost")
    one = [_lost(name, 1.0 + i * LOST_S) for i, name in enumerate(SENSORS)]
    every = [_lost(name, 1.0 + len(SENSORS) * LOST_S) for name in SENSORS]
    lossy, said = _flown(path, 2.0 + (len(SENSORS) + 1) * LOST_S, [*one, *every])
    told = f"{LOST_S:g} s without each measurement, then without any: {said}"
    return [*out, ("lost samples", "good" if lossy is not None else "bad", told)]


def _strays(flown: "pd.DataFrame") -> str:
    """Return what a flight's load factor does that no flight under control does, "" for nothing."""
    t, away = flown.index.to_numpy(), flown[MOTION[0]].to_numpy() - 1.0
    if np.abs(away).max() > ASKED + GUSTS:
        return f"{np.abs(away).max():.2f} g away from level flight where {ASKED:g} g are asked in light turbulence"
    half = 0.5 * (SETTLED_S + FLIGHT_S)
    first, second = (math.sqrt(np.mean(away[part] ** 2)) for part in ((t >= SETTLED_S) & (t < half), t >= half))
    grows = f"its load factor grows {second / first:.1f} times in {half - SETTLED_S:g} s"
    return grows if second > GROWTH * first else ""


def _lost(name: str, start: float) -> str:
    return f"{{target='sensor.{name}', kind='dropout', start_s={start}, end_s={start + LOST_S}}}"


def _flown(path: Path, seconds: float, faults: Iterable[str] = ()) -> "tuple[pd.DataFrame | None, str]":
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
    return found, f"{seconds:g} s, n_z {n_z.min():.2f} to {n_z.max():.2f} g, asked {1 - ASKED:g} to {1 + ASKED:g} g"
