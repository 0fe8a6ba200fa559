"""What a log says of its flight: the scenario, the detectors, their parameters and first states.

A log's checksums prove that this is what was written; what another version wrote is an error of one line.
"""

import io
import math
from typing import Any

import numpy as np

from cosim.errors import CosimError, LogError, among
from cosim.flight.detection.parameters import assign, beyond, parameter_spans, state_spans
from cosim.log import Log
from cosim.scenario import Scenario, parse, user_parts
from cosim.texts import from_json, toml

SOUGHT = ("id", "level", "every", "lanes", "inputs")  # of a detector
LATEST_S = 2**63 / 1e9  # a log's time is 64 bits of nanoseconds


class ReplayError(CosimError):
    """A replay that cannot be made, or would compare nothing."""


def detectors(log: Log) -> list[dict[str, Any]]:
    """Return what `detectors.json` of a log says, {id, level, lanes, every, inputs, ...} per detector, or raise."""
    if "detectors.json" not in log.attachments:
        remedy = "For data of another source use --map"
        raise LogError("the log describes no detectors", place=str(log.path), remedy=remedy)
    place = f"{log.path}: detectors.json"
    found = from_json(log.attachments["detectors.json"], place=place, error=LogError)
    if not isinstance(found, list) or not all(isinstance(d, dict) and d.keys() >= {*SOUGHT} for d in found):
        raise LogError(f"is no list of detectors with {', '.join(SOUGHT)}", place=place)
    return found


def scenario(log: Log) -> Scenario:
    """Return the scenario of a log, or raise."""
    tables, place = scenario_tables(log), f"{log.path}: scenario.toml"
    user_parts.bring_aircraft(tables, log.attachments, place)
    made = parse(tables, place=place)
    if round(1e9 * made.dt) != log.dt_ns:
        raise LogError(f"its tick of {log.dt_ns} ns is not that of {made.rate_hz} Hz", place=place)
    return made


def scenario_tables(log: Log) -> dict[str, Any]:
    """Return the tables of the scenario in a log, or raise."""
    if "scenario.toml" not in log.attachments:
        remedy = "`cosim info` shows what it holds"
        raise LogError("was not written by `cosim run`: it holds no scenario", place=str(log.path), remedy=remedy)
    text = log.attachments["scenario.toml"].decode("utf-8", "replace")
    return toml(text, place=f"{log.path}: scenario.toml", error=LogError)


def of_result(log: Log, name: str) -> Any:
    """Return what the result of a log holds as `name`, None where it has none: `achieved` {segment: {name: number or
    None}}, `not_run` {detector: why} of those that the scenario asks for and the flight could not have."""
    return from_json((log.result or {}).get(name, "null"), place=f"{log.path}: result, {name}", error=LogError)


def older(log: Log, what: str) -> LogError:
    """Return the LogError for `what` of a detector in a log that another version wrote."""
    software = log.metadata.get("run", {}).get("software", "another version")
    remedy = f"The log was written by {software}, which replays it; --detectors chooses others of it"
    return LogError(f"{what} is of another layout than this version's", place=str(log.path), remedy=remedy)


def attached(log: Log, name: str, kind: Any, lanes: int) -> np.ndarray:
    """Return the structured array (lanes,) in attachment `name`.npy, or .npz with an entry `array`, of dtype `kind`.
    Raises LogError for another layout, or none."""
    data = next((log.attachments[n] for n in (f"{name}.npy", f"{name}.npz") if n in log.attachments), None)
    if data is None:
        remedy = ("The original was cut or damaged there: fly the scenario again" if "recovered" in log.metadata
                  else "`cosim run` did not write it; see `cosim replay --map`")  # fmt: skip
        raise LogError(f"the log lacks {name}", place=str(log.path), remedy=remedy)
    try:
        found = np.load(io.BytesIO(data))
    except (ValueError, EOFError) as wrong:
        raise LogError(f"{name} is no array: {wrong}", place=str(log.path)) from wrong
    found = found if isinstance(found, np.ndarray) else found["array"]
    if found.dtype != kind or found.shape != (lanes,):
        changed = ", ".join(sorted(set(kind.names) ^ set(found.dtype.names or ())))
        raise older(log, f"{name} ({changed or 'its arrays'})")
    return found


def trusted(place: str, record: Any, module: Any, x: np.ndarray, p: np.ndarray | None = None, dt: float = 0.0) -> None:
    """Raise LogError when a number in the states or parameters of a log would index beyond the detector's arrays."""
    of_parameters = None if p is None else beyond(p, parameter_spans(record, module, dt))
    for name, value, low, high in filter(None, (beyond(x, state_spans(record, module)), of_parameters)):
        said = f"{record.id}.{name} = {value:g} would reach beyond the detector's arrays"
        raise LogError(said, place=place, allowed=f"{low:g} to {high:g}")


def check_start(start_s: float) -> None:
    """Raise ReplayError for a start that is no time, or beyond any that a log can hold."""
    if not abs(start_s) < LATEST_S:
        raise ReplayError(f"{start_s} is no time", place="--from", allowed=f"seconds, below {LATEST_S:.3g}")


def chosen_overrides(chosen: Any, changes: Any) -> None:
    """Raise ReplayError for parameters {detector: ...} of a detector that is not among the `chosen` (None: all), or
    where none is chosen."""
    if chosen in ([], ()):
        raise ReplayError("no detector is named", place="--detectors", remedy="Leave it out for all")
    for name in changes or () if chosen else ():
        said = f"{name} is not among the detectors that run, its parameters would change nothing"
        among(name, chosen, said, error=ReplayError, place="--set")


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
