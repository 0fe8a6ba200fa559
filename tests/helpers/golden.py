"""Fly the golden flights: `python tests/helpers/golden.py` writes logs/golden/*.mcap anew, with a text fingerprint
beside each.

The tests replay them bit for bit, so a change of any detector's numbers shows. A change that is meant is a commit of
its own: run the command, look at the difference of the fingerprints, commit both. Each log is short, has one fault,
and holds only what a replay reads: the detectors' inputs, outputs, whole states and parameters.
"""

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cosim.log import LogWriter, Topic, fingerprint, open_log
from cosim.replay.detector_replay import describe

FOLDER = Path(__file__).resolve().parents[2] / "logs" / "golden"
HYDRAULIC = ("iotsekf", "rtsekf", "rtsekf_flight", "position_monitor", "ofc_monitor")
EMA = ("ema_kalman", "ema_kalman_flight", "position_monitor")
AIRCRAFT = ("rfafe", "rfafe_airframe", "lpv_smo")


@dataclass(frozen=True)
class Golden:
    """One golden flight: a built-in scenario, what is changed of it, and the detectors that must have alarmed."""

    scenario: str
    changes: tuple
    detectors: tuple
    alarmed: tuple


def _only(segment, technology):
    segments = ("left_outer", "left_inner", "right_inner", "right_outer")
    return tuple(f"elevator.{s}={technology if s == segment else 'simple'}" for s in segments)


_SHORT = ("duration_s=5", "faults.0.start_s=2")

FLIGHTS = {
    "hydraulic-ofc": Golden("liquid-ofc", (*_only("left_inner", "hydraulic"), *_SHORT), HYDRAULIC, ("iotsekf",)),
    "ema-position-bias": Golden(
        "ema-position-bias", (*_only("right_inner", "ema"), *_SHORT), EMA, ("ema_kalman_flight",)
    ),
    "aircraft-bias": Golden("alwi14-simultaneous", _SHORT, AIRCRAFT, ("rfafe",)),
}


def fly(name: str, folder: Path = FOLDER) -> Path:
    """Fly golden flight `name`; write <name>.mcap and its fingerprint <name>.txt, and return the log's path."""
    from cosim.flight.simulate import simulate
    from cosim.scenario import load_scenario

    golden, folder = FLIGHTS[name], Path(folder)
    enabled = ",".join(f'"{d}"' for d in golden.detectors)
    scenario = load_scenario(
        golden.scenario,
        [*golden.changes, f"detectors.enabled=[{enabled}]", "elevator.feedback=measured", "elevator.reconfigure=false"],
    )
    folder.mkdir(parents=True, exist_ok=True)
    out = folder / f"{name}.mcap"
    with tempfile.TemporaryDirectory() as temporary:
        whole = Path(temporary) / "whole.mcap"
        simulate(scenario, log=whole, timed=False)
        thin(whole, out)
    out.with_suffix(".txt").write_text(fingerprint(open_log(out)))
    return out


def thin(path: str | Path, out: Any) -> Any:
    """Copy of a log only what a replay of its detectors reads."""
    log = open_log(path)
    wired = describe(log)
    fields: dict = {}
    for w in wired:
        for _, source, column in w.inputs:
            fields.setdefault(source, {})[column] = None
    kept = {name: [f for f in info.fields if f in fields.get(name, ())] for name, info in log.topics.items()}
    kept |= {name: list(log.topics[name].fields) for w in wired for name in (w.topic, w.hidden)}
    topics, columns, at = [], [], 0
    for name, names in kept.items():
        if names:
            info, places = log.topics[name], [log.topics[name].fields.index(f) for f in names]
            units = [info.units[i] for i in places]
            topics.append(
                Topic(
                    name,
                    tuple(names),
                    tuple(units),
                    np.arange(at, at + len(names)),
                    info.every,
                    info.group,
                    info.description,
                )
            )
            values = np.zeros((log.n_ticks, len(names)))
            values[:: info.every] = log.array(name)[:, places]
            columns.append(values)
            at += len(names)
    begun = tuple(f"{w.id}.{part}.np" for w in wired for part in ("params", "initial"))
    wanted = [n for n in log.attachments if n in ("scenario.toml", "detectors.json") or n.startswith(begun)]
    attachments = {n: (log.media_types[n], log.attachments[n]) for n in wanted}
    metadata = {n: log.metadata[n] for n in ("run", "libraries") if n in log.metadata}
    with LogWriter(
        out,
        topics,
        n_values=at,
        dt_ns=log.dt_ns,
        metadata=metadata,
        attachments=attachments,
        rows_per_chunk=500,
        compression="zstd",
    ) as w:
        for row in np.concatenate(columns, axis=1):
            w.append(row)
        w.close(result={k: v for k, v in (log.result or {}).items() if k != "content"})


if __name__ == "__main__":
    for flight in sys.argv[1:] or FLIGHTS:
        fly(flight)
