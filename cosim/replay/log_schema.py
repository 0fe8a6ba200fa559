"""Schema of a log's metadata, validated here once for all readers.

Checksums prove that a log is unchanged, not who wrote it: a forged one has right checksums and
nonsense inside. Every mistake is a LogError with the log's path.
"""

import io
import math
import tokenize
import zipfile
import zlib
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from cosim.errors import CosimError, LogError, did_you_mean
from cosim.flight.detection.parameters import assign, wrong_parameter, wrong_state
from cosim.log import Log
from cosim.scenario import Scenario, parse, user_parts
from cosim.texts import from_json, toml

MOST_S = 36_000.0  # the longest flight that a scenario may ask for
_BAD = (  # what NumPy and zipfile may raise on bytes that are not what they should be
    *(ValueError, EOFError, OSError, SyntaxError, TypeError, OverflowError, MemoryError, RuntimeError),
    *(tokenize.TokenError, zipfile.BadZipFile, zlib.error),
)
_Name = Annotated[str, Field(min_length=1, max_length=100)]
_JUDGED = {"r", "alarm", "verdict", "culprit", "valid"}  # outputs that every detector has
_Word = Annotated[str, Field(max_length=1000)]
_Cases = dict[_Name, Annotated[list[_Name], Field(max_length=20)]]
_ACHIEVED: TypeAdapter = TypeAdapter(dict[str, dict[str, float | None]] | None)
_NOT_RUN: TypeAdapter = TypeAdapter(dict[str, str])
_Three = Annotated[list[str], Field(min_length=3, max_length=3)]


class _Record(BaseModel, strict=True, extra="forbid"):
    """What a log tells of a user detector (cosim/parts), so that it is judged without its code."""

    summary: _Word
    technologies: list[_Name]
    inputs: dict[_Name, _Name]
    group: _Word
    designed_for: _Cases
    may_see: _Cases
    blind: _Word
    blind_to: list[_Name]
    remark: _Word
    estimates: Annotated[list[_Three], Field(max_length=4)]


class _UserDetector(BaseModel, strict=True):
    """Where a user detector came from, what it can blame, its record."""

    form: Literal["python", "block"]
    file: Annotated[str, Field(max_length=200)]
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    culprits: Annotated[list[Annotated[str, Field(max_length=100)]], Field(min_length=1, max_length=64)]
    record: _Record


class _Flew(BaseModel, strict=True):
    """A detector, and what is told of it where it is a user detector."""

    id: _Name
    level: Literal["local", "aircraft", "both"]
    every: Annotated[int, Field(ge=1, le=1_000_000)]
    user_detector: _UserDetector | None = None


class _Detector(_Flew):
    """One detector of a log: its lanes and, per lane, which field of which topic each of its inputs is."""

    lanes: Annotated[list[_Name], Field(min_length=1, max_length=64)]
    inputs: dict[_Name, list[_Three]]


def detectors(log: Log) -> list[dict[str, Any]]:
    """Return what `detectors.json` of a log says, {id, level, lanes, every, inputs, ...} per detector, or raise."""
    if "detectors.json" not in log.attachments:
        remedy = "For data of another source use --map"
        raise LogError("the log describes no detectors", place=str(log.path), remedy=remedy)
    place = f"{log.path}: detectors.json"
    found = from_json(log.attachments["detectors.json"], place=place, error=LogError)
    scenario_tables(log)
    for d in _checked(found, _Detector, place):
        if sorted(d.inputs) != sorted(set(d.lanes)) or len(set(d.lanes)) != len(d.lanes):
            raise LogError(f"is damaged: inputs of {d.id} are not those of its lanes", place=place)
        for lane, inputs in d.inputs.items():
            for _, topic, field in inputs:
                there = topic in log.topics and field in log.topics[topic].fields
                if not there or d.every % log.topics[topic].every:
                    raise LogError(f"is damaged: {d.id} reads {topic}.{field}, which is not there", place=place)
            own = log.topics.get(f"/detectors/{d.id}/{lane}")
            if own is not None and own.every != d.every:
                raise LogError(f"is damaged: {d.id} runs every {d.every} ticks, its topic {own.every}", place=place)
            if d.user_detector and own is not None and (lacking := _JUDGED - set(own.fields)):
                raise LogError(f"is damaged: {own.name} lacks {', '.join(sorted(lacking))}", place=place)
    return found


def user_detectors(text: bytes, place: str) -> list[dict[str, Any]]:
    """Return what a campaign's user_detectors.json says, {id, level, every, user_detector} per detector, or raise."""
    found = from_json(text, place=place, error=LogError)
    _checked(found, _Flew, place)
    return found


def _checked(found, kind, place):
    """Return the entries of a list of detectors as models of `kind`; each is there once."""
    if not isinstance(found, list):
        raise LogError("is not a list of detectors", place=place)
    try:
        made = [kind.model_validate(entry) for entry in found]
    except ValidationError as wrong:
        first = wrong.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise LogError(f"is damaged: {where}: {first['msg']}", place=place) from None
    if len({d.id for d in made}) != len(made):
        raise LogError("is damaged: a detector is there twice", place=place)
    return made


def scenario(log: Log) -> Scenario:
    """Return the scenario of a log, or raise."""
    tables, place = scenario_tables(log), f"{log.path}: scenario.toml"
    user_parts.bring_aircraft(tables, log.attachments, place)
    return parse(tables, place=place)


def scenario_tables(log: Log) -> dict[str, Any]:
    """Return the tables of the scenario in a log, or raise."""
    place = f"{log.path}: scenario.toml"
    if "scenario.toml" not in log.attachments:
        remedy = "`cosim info` shows what it holds"
        raise LogError("was not written by `cosim run`: it holds no scenario", place=str(log.path), remedy=remedy)
    try:
        text = log.attachments["scenario.toml"].decode("utf-8")
    except UnicodeDecodeError as wrong:
        raise LogError(f"is not UTF-8 (byte {wrong.start})", place=place) from None
    found = toml(text, place=place, error=LogError)
    _clock(log, found)
    return found


def _clock(log, tables):
    """Raise LogError where a log's ticks are not those of its scenario: detectors step by them, arrays are as long."""
    rate, duration = tables.get("rate_hz", 200), tables.get("duration_s", MOST_S)
    told = isinstance(rate, int) and isinstance(duration, int | float) and rate > 0
    if not told or round(1e9 / rate) != log.dt_ns:
        raise LogError(f"is damaged: its tick of {log.dt_ns} ns is not that of {rate} Hz", place=str(log.path))
    ticks = sum(log.spans[-1]) if log.spans else 0
    if not ticks <= min(duration, MOST_S) * rate + 1.0:
        raise LogError(f"is damaged: it ends at tick {ticks}, its scenario after {duration} s", place=str(log.path))


def achieved(log: Log) -> dict[str, dict[str, float | None]] | None:
    """Return {segment: {name: number or None}} of the result's `achieved`, None where a log has none, or raise."""
    return _of_result(log, "achieved", _ACHIEVED, "null")


def not_run(log: Log) -> dict[str, str]:
    """Return {detector: why} of those that the scenario asks for and the flight could not have, or raise LogError."""
    return _of_result(log, "not_run", _NOT_RUN, "{}")


def _of_result(log, name, kind, default):
    place = f"{log.path}: result, {name}"
    try:
        return kind.validate_python(from_json((log.result or {}).get(name, default), place=place, error=LogError))
    except ValidationError as wrong:
        raise LogError(f"is damaged: {wrong.errors()[0]['msg']}", place=place) from None


def array(log: Log, name: str) -> np.ndarray:
    """Return the array of attachment <name>.npy, or of <name>.npz with an entry `array`.

    KeyError when it is not there, LogError when it is damaged, of objects, or claims more than is there.
    """
    packed = f"{name}.npy" not in log.attachments
    data = log.attachments[f"{name}.npz" if packed else f"{name}.npy"]
    try:
        found = np.load(io.BytesIO(data), allow_pickle=False)
        return found["array"] if packed else found
    except (*_BAD, KeyError) as wrong:
        raise LogError(f"{name} is damaged: {str(wrong) or type(wrong).__name__}", place=str(log.path)) from wrong


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
    or none."""
    try:
        found = array(log, name)
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
