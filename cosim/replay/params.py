"""Read a detector's parameters and initial states from a log, and change them."""

import math
from typing import Any

import numpy as np

from cosim.errors import CosimError, LogError, did_you_mean
from cosim.flight.detection.parameters import assign, wrong_parameter, wrong_state
from cosim.log import Log
from cosim.replay import log_schema

LATEST_S = 2**63 / 1e9  # a log's time is 64 bits of nanoseconds


class ReplayError(CosimError):
    """A replay that cannot be made, or would compare nothing."""


LAID_OUT = " is of another layout than this version's"


class LayoutError(LogError):
    """A detector of a log whose parameters, states or outputs are not those of this version."""


def older(log: Log, what: str) -> LayoutError:
    """Return the LayoutError for `what` in a log that another version wrote."""
    software = log.metadata.get("run", {}).get("software", "another version")
    remedy = f"The log was written by {software}, which replays it"
    return LayoutError(f"{what}{LAID_OUT}", place=str(log.path), remedy=remedy)


def attached(log: Log, name: str, kind: Any, lanes: int) -> np.ndarray:
    """Return the structured array (lanes,) in attachment `name`, of dtype `kind`. Raises LogError for another layout,
    or none.
    """
    try:
        found = log_schema.array(log, name)
    except KeyError as error:
        cut = "recovered" in log.metadata and "The original was cut or damaged there: fly the scenario again"
        remedy = cut or "`cosim run` did not write it; see `cosim replay --map`"
        raise LogError(f"the log lacks {name}", place=str(log.path), remedy=remedy) from error
    if found.dtype.names != kind.names or not all(_alike(found.dtype[n], kind[n]) for n in kind.names):
        changed = ", ".join(sorted(set(kind.names) ^ set(found.dtype.names or ())))
        raise older(log, f"{name} ({changed or 'its arrays'})")
    if found.shape != (lanes,):
        raise LogError(f"{name} has the shape {found.shape}", place=str(log.path), allowed=f"({lanes},), a lane each")
    out = np.zeros(found.shape, kind)
    for n in kind.names:
        out[n] = found[n]
    return out


def _alike(found: np.dtype, kind: np.dtype) -> bool:
    """Tell whether numbers of one field's dtype fit into another's."""
    return found == kind or (found.shape == kind.shape and found.base.kind in "biuf" and kind.base.kind in "biuf")


def reaches(place: str, what: str, value: float, low: float, high: float) -> LogError:
    """Return the LogError for a number in a log that would index beyond the detector's arrays."""
    said, remedy = f"{what} = {value:g} would reach beyond the detector's arrays", "`cosim run` did not write this"
    return LogError(said, place=place, allowed=f"{low:g} to {high:g}", remedy=remedy)


def trusted(log: Log, record: Any, module: Any, p: np.ndarray, x: np.ndarray, dt: float) -> None:
    """Raise LogError when a number in the parameters or states of a log would index beyond the detector's arrays."""
    found = {"parameter": wrong_parameter(record, module, p, dt), "state": wrong_state(record, module, x)}
    for what, wrong in found.items():
        if wrong:
            raise reaches(str(log.path), f"{what} {record.id}.{wrong[0]}", *wrong[1:])


def check_start(start_s: float) -> None:
    """Raise ReplayError for a start that is no time, or beyond any that a log can hold."""
    if not abs(start_s) < LATEST_S:
        raise ReplayError(f"{start_s} is no time", place="--from", allowed=f"seconds, below {LATEST_S:.3g}")


def chosen_overrides(chosen: Any, changes: Any) -> None:
    """Raise ReplayError for parameters {detector: ...} of a detector that is not among the `chosen` (None: all)."""
    for name in changes or () if chosen else ():
        if name not in chosen:
            said, allowed = f"{name} is not among the detectors that run, its parameters would change nothing", chosen
            near = did_you_mean(name, chosen)
            raise ReplayError(said, place="--set", allowed=", ".join(allowed), remedy=near)


def overrides(texts: Any) -> Any:
    """Return {detector: {parameter: value}} of texts `detector.parameter=value`. Raises ReplayError."""
    out: dict = {}
    for text in texts:
        key, equals, value = text.partition("=")
        detector, dot, name = key.strip().partition(".")
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not (equals and dot and name) or math.isnan(number):
            raise ReplayError(f"{text!r} sets nothing", place="--set", allowed="detector.parameter=number")
        out.setdefault(detector, {})[name] = number
    return out


def override(record: Any, module: Any, p: np.ndarray, values: dict, dt: float) -> None:
    """Set parameters {name: value} of a detector in its PARAMS `p`; `name[i]` is an element. Raises ReplayError."""
    for name, value in values.items():
        assign(record, module, p, name, value, dt, error=ReplayError, place=f"{record.id}.{name} = {value:g}")
