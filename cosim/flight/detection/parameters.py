"""Parameters of a detector: set by name, refused alike before a flight and on a replay, and checked where
compiled code uses them as indices.

Compiled code trusts an index; a wrong one reads or writes other memory, or ends the process. Parameters can come from a
scenario, a command line or a log, states from a log. A detector's record says which they are.
"""

import functools
from typing import Any

import numpy as np

from cosim.errors import among
from cosim.flight.detection.detector_context import site
from cosim.scenario.catalog import DEFAULT_TECHNOLOGY
from fdi import registry

Spans = dict[str, tuple[float, float]]  # index -> the lowest and the highest whole number that it may be


def assign(record: Any, module: Any, p: Any, name: str, value: Any, dt: float, *, error: Any, place: str) -> None:
    """Set parameter `name` of all lanes in PARAMS `p`: a number, all elements of an array, or one of them, `name[i,j]`.

    Raises `error` (a CosimError) at `place`.
    """
    base, bracket, index = name.partition("[")
    asked = base if bool(bracket) == index.endswith("]") else name
    among(asked, (*record.options, *p.dtype.names), "no such parameter", error=error, place=place)
    if option := record.belongs.get(base):
        raise error("is set with the thresholds that belong to it", place=place,
                    allowed=f"{option} = {', '.join(map(repr, record.options[option]))}",
                    remedy=f"Set detectors.{record.id}.{option} in the scenario")  # fmt: skip
    try:
        at = tuple(int(i) for i in index.rstrip("]").split(",")) if index else ()
        p[base][(slice(None), *at)] = value
    except (ValueError, IndexError) as wrong:
        shape = p[base].shape[1:] if base in p.dtype.names else ()
        allowed = f"a number, elements of shape {shape}" if shape else "a number"
        raise error(f"{value!r} cannot be set", place=place, allowed=allowed) from wrong
    if found := beyond(p, parameter_spans(record, module, dt)):
        _, number, low, high = found
        allowed = f"a whole number from {low:g} to {high:g}"
        raise error(f"index {number:g} is out of range", place=place, allowed=allowed)


def parameter_spans(record: Any, module: Any, dt: float) -> Spans:
    """Return what the parameters of a detector may be that are used as indices, at a tick of `dt` [s]."""
    back = {name: (0.0, module.STATE[array].shape[0] - 1.0) for name, array in record.looks_back.items()}
    return back | _sizes(record.id, dt) if record.sizes else back


def state_spans(record: Any, module: Any) -> Spans:
    """Return what the states of a detector may be that are used as indices."""
    places = {name: (0.0, module.STATE[array].shape[axis] - 1.0) for name, (array, axis) in record.places.items()}
    return {"isolated_part": (0.0, len(module.ISOLABLE_PARTS) - 1.0), **places}


def beyond(numbers: np.ndarray, spans: Spans) -> tuple[str, float, float, float] | None:
    """Return (name, value, lowest, highest) of the first index in a record array that does not fit; None when all
    do."""
    for name, (low, high) in spans.items():
        values = np.ravel(numbers[name])
        fits = (values >= low) & (values <= high) & (values == np.round(values))
        if not fits.all():
            return name, float(values[~fits][0]), low, high
    return None


@functools.cache
def _sizes(detector, dt):
    """Return the spans of sizes: up to the largest of the designs of every choice that a scenario has, as no more fits
    the arrays."""
    record = registry.record(detector)
    lane = next((n for n, t in DEFAULT_TECHNOLOGY.items() if t in record.technologies), "")
    words: list[dict] = [{}] + [{name: word} for name, allowed in record.options.items() for word in allowed]
    made = [record.fit(site(dt, lane, DEFAULT_TECHNOLOGY), **w) for w in words]
    return {n: (min(least, *(float(p[n].min()) for p in made)), max(float(p[n].max()) for p in made))
            for n, least in record.sizes.items()}  # fmt: skip
