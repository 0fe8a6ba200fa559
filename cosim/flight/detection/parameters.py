"""Parameters of a detector: set by name, refused alike before a flight and on a replay, and checked where
compiled code uses them as indices.

Compiled code trusts an index; a wrong one reads or writes other memory, or ends the process. Parameters can come from a
scenario, a command line or a log, states from a log. A detector's record says which they are.
"""

import functools
from typing import Any

import numpy as np

from cosim.errors import did_you_mean
from cosim.flight.detection.detector_context import site
from cosim.scenario.catalog import DEFAULT_TECHNOLOGY
from fdi import registry


def assign(record: Any, module: Any, p: Any, name: str, value: Any, dt: float, *, error: Any, place: str) -> None:
    """Set parameter `name` of all lanes in PARAMS `p`: a number, all elements of an array, or one of them, `name[i,j]`.

    Raises `error` (a CosimError) at `place`.
    """
    base, bracket, index = name.partition("[")
    if base not in p.dtype.names or bool(bracket) != index.endswith("]"):
        known = [*record.options, *(n + "[i]" * bool(p.dtype[n].shape) for n in p.dtype.names)]
        remedy = did_you_mean(base, [*record.options, *p.dtype.names])
        raise error("no such parameter", place=place, allowed=", ".join(known), remedy=remedy)
    if option := record.belongs.get(base):
        raise error("is set with the thresholds that belong to it", place=place,
                    allowed=f"{option} = {', '.join(map(repr, record.options[option]))}",
                    remedy=f"Set detectors.{record.id}.{option} in the scenario")  # fmt: skip
    shape = p.dtype[base].shape
    span = parameter_range(base, record, module, dt)
    if span is not None and not (span[0] <= value <= span[1] and value == round(value)):
        said = f"a whole number from {span[0]:g} to {span[1]:g}"
        raise error(f"index {value:g} is out of range", place=place, allowed=said)
    try:
        at = tuple(int(i) for i in index.rstrip("]").split(",")) if index else ()
        p[base][(slice(None), *at)] = value
    except (ValueError, IndexError) as wrong:
        said = f"a number, elements of shape {shape}" if shape else "a number"
        raise error(f"{value!r} cannot be set", place=place, allowed=said) from wrong


def parameter_range(name: str, record: Any, module: Any, dt: float) -> tuple[Any, ...] | None:
    """Return (lowest, highest) that parameter `name` may be, both whole; None for any number."""
    if name in record.looks_back:
        return 0.0, module.STATE[record.looks_back[name]].shape[0] - 1.0
    if name in record.sizes:
        least, largest = _designed(record.id, dt)[name]
        return min(record.sizes[name], least), largest
    return None


def wrong_parameter(record: Any, module: Any, p: np.ndarray, dt: float) -> tuple[Any, ...] | None:
    """Return (name, value, lowest, highest) of the first index in PARAMS `p` that does not fit; None when all do."""
    for name in module.PARAMS.names:
        span = parameter_range(name, record, module, dt)
        if span is not None and not _whole(p[name], *span):
            return name, _first(p[name], *span), *span
    return None


def wrong_state(record: Any, module: Any, x: np.ndarray) -> tuple[str, float, float, float] | None:
    """Return (name, value, lowest, highest) of the first index in STATE `x` that does not fit; None when all do."""
    spans = {"isolated_part": len(module.ISOLABLE_PARTS) - 1.0}
    spans |= {name: module.STATE[array].shape[axis] - 1.0 for name, (array, axis) in record.places.items()}
    for name, high in spans.items():
        if not _whole(x[name], 0.0, high):
            return name, _first(x[name], 0.0, high), 0.0, high
    return None


def _whole(values, low, high):
    values = np.asarray(values)
    return bool(np.all((values >= low) & (values <= high) & (values == np.round(values))))


def _first(values, low, high):
    values = np.ravel(values)
    return float(next(v for v in values if not _whole(v, low, high)))


@functools.cache
def _designed(detector, dt):
    """Return {size: (least, largest)} over the designs of every choice a scenario has: no more fits the arrays."""
    record = registry.record(detector)
    lane = next((n for n, t in DEFAULT_TECHNOLOGY.items() if t in record.technologies), "")
    words: list[dict] = [{}] + [{name: word} for name, allowed in record.options.items() for word in allowed]
    made = [record.fit(site(dt, lane, DEFAULT_TECHNOLOGY), **w) for w in words]
    return {n: (float(min(p[n].min() for p in made)), float(max(p[n].max() for p in made))) for n in record.sizes}
