"""The signals of a flight with labels beside them, as a Parquet file: a data set for those who train a detector.

A row is a sample, every n-th tick as it was flown, without a filter: t_s, the signals, what acts (LABELS), and for each
elevator segment by how much its deflection differs from that of the same flight without faults. A signal is NaN while
its sensor is invalid, and in a flight whose actuator has none. Units and meanings are metadata of the columns.
"""

import hashlib
import io
import json
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

import cosim.flight.loop.signals
from cosim.errors import CampaignError, did_you_mean
from cosim.flight.faults.conditions import resolved
from cosim.flight.faults.inject import lanes
from cosim.scenario import Scenario
from cosim.scenario.flight import AIR
from cosim.scenario.vocabulary import Signal, find, words

LABELS = (  # name, type, unit, meaning
    ("faults_active", pa.int8(), "-", "number of faults that act at this sample"),
    ("fault_kind", pa.string(), "-", "kind of the fault that acts, of several joined by +, empty without one"),
    ("fault_place", pa.string(), "-", "its target, and behind @ where it enters"),
    ("fault_injected", pa.float32(), "of the place", "its signal, where it enters"),
)
SHARES = ("train", "test", "train", "validation", "train")  # of every five points, in the order of their digests


def chosen(scenarios: Iterable[Scenario], asked: Sequence[str], rate_hz: float) -> tuple[str, ...]:
    """Return the columns that the words `asked` mean, all without any: a word of an actuator stands for each segment
    that has it. Raises CampaignError for a word that no flight has, or a rate that a flight cannot give."""
    there: dict[str, Signal] = {}
    for scenario in scenarios:
        _every(scenario, rate_hz)
        for word, signal in words().items():
            for segment in _segments(scenario, signal) if signal.technologies else ("",):
                there.setdefault(f"{segment}.{word}" if segment else word, signal)
    out = []
    for name in asked or there:
        found = [c for c in there if c == name or c.partition(".")[2] == name]
        if not found:
            near = did_you_mean(name, [*there, *words()])
            raise CampaignError("no flight of this campaign has it", place=f"--signals {name}", remedy=near)
        out += found
    return tuple(sorted(set(out)))


def splits(scenarios: Iterable[Scenario], labels: Iterable[dict]) -> list[str]:
    """Return train, validation or test for each flight; all flights of a flight point are in one of them."""
    points = [
        str(label.get("point") or json.dumps(s.flight.model_dump(exclude=set(AIR)), default=str))
        for s, label in zip(scenarios, labels)
    ]
    order = sorted(set(points), key=lambda name: hashlib.sha256(name.encode()).hexdigest())
    share = {name: SHARES[i % len(SHARES)] for i, name in enumerate(order)}
    return [share[name] for name in points]


def parquet(scenario: Scenario, columns: Sequence[str], rate_hz: float) -> bytes:
    """Fly a scenario with and without its faults, without detectors; return the Parquet file of its signals and labels.
    Raises TrimError for a point without a steady flight."""
    quiet = scenario.detectors.model_copy(update={"enabled": ()})  # but those that a servo closes on
    scenario = resolved(scenario.model_copy(update={"detectors": quiet}))
    moved = {f"achieved_{seg}": f"{tech}.{seg}.delta" for seg, tech in scenario.elevator.technology.items()}
    found = {name: find(name) for name in columns if _has(scenario, name)}
    faults = [f"faults.{lane.name}.{field}" for lane in lanes(scenario) for field in ("active", "f_inj")]
    flags = [s.flag for s in found.values() if s.flag]
    sources = dict.fromkeys([*(s.source for s in found.values()), *flags, *faults, *moved.values()])
    flown = cosim.flight.loop.signals.fly(scenario, list(sources))
    fault_free = scenario.model_copy(update={"title": "", "faults": ()})
    healthy = cosim.flight.loop.signals.fly(fault_free, list(moved.values())) if scenario.faults else flown
    fields, values = [_field("t_s", pa.float64(), "s", "time since the start")], [flown.index.to_numpy()]
    for name in columns:
        values.append(_signal(flown, found[name]) if name in found else np.full(len(flown), np.nan))
        fields.append(_field(name, pa.float32(), find(name).unit, find(name).meaning))
    values += _labels(scenario, flown)
    fields += [_field(*label) for label in LABELS]
    for name, source in moved.items():
        values.append((flown[source] - healthy[source].reindex(flown.index)).to_numpy())  # NaN beyond the end of either
        meaning = "deflection less that of the same flight without faults, trailing edge down +"
        fields.append(_field(name, pa.float32(), "rad", meaning))
    every = _every(scenario, rate_hz)
    arrays = [pa.array(column[::every]).cast(field.type) for column, field in zip(values, fields)]
    out = io.BytesIO()
    pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), out, compression="zstd")
    return out.getvalue()


def _every(scenario, rate_hz):
    """Return how many ticks lie between two samples. Raises CampaignError."""
    n = scenario.rate_hz / rate_hz if rate_hz > 0 else 0.0
    if n < 1 or abs(n - round(n)) > 1e-9:
        allowed = ", ".join(f"{scenario.rate_hz / k:g}" for k in (1, 2, 4, 5, 10, 20))
        said = f"the flights run at {scenario.rate_hz:g} Hz, of which it must be a whole part"
        raise CampaignError(said, place=f"--rate {rate_hz:g}", allowed=f"{allowed}, ... Hz")
    return round(n)


def _segments(scenario, signal):
    return [seg for seg, tech in scenario.elevator.technology.items() if tech in signal.technologies]


def _has(scenario, name):
    """Tell whether the flight has the signal of a column."""
    segment, _, word = name.rpartition(".")
    return not segment or segment in _segments(scenario, words()[word])


def _field(name, kind, unit, meaning):
    return pa.field(name, kind, metadata={"unit": unit, "meaning": meaning})


def _signal(flown, signal):
    values = flown[signal.source].to_numpy(copy=True)
    if signal.flag:
        values[flown[signal.flag].to_numpy() < 0.5] = np.nan
    return values


def _labels(scenario, flown):
    """Return the columns LABELS."""
    own: dict[int, list[str]] = {}
    for lane in lanes(scenario):
        own.setdefault(lane.fault, []).append(f"faults.{lane.name}")
    n = len(flown)
    active, injected = np.zeros(n), np.zeros(n)
    kind, place = pd.Series("", range(n)), pd.Series("", range(n))
    for i, buses in own.items():
        on = np.any([flown[f"{bus}.active"] > 0.5 for bus in buses], axis=0)
        fault: Any = scenario.faults[i]
        first = on & (active == 0)
        injected[first] = flown[f"{buses[0]}.f_inj"].to_numpy()[first]
        for column, word in ((kind, fault.kind), (place, fault.target + (f"@{fault.at}" if fault.at else ""))):
            column[first] = word
            column[on & ~first] += f"+{word}"
        active += on
    return [active, kind.to_numpy(object), place.to_numpy(object), injected]
