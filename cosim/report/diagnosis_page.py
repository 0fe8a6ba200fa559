"""The page of a recording that `cosim replay --map` diagnosed: verdicts, time line, detectors, and what they read."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from cosim.errors import LogError
from cosim.judge.lanes import SHOWN, verdicts
from cosim.log import open_log
from cosim.replay.detector_replay import judged_lane
from cosim.replay.recording import Lane, LoggedFlight, words
from cosim.report.figure import Figure
from cosim.report.flight import detectors, panels, timeline
from cosim.report.page import page, write
from cosim.scenario import vocabulary
from fdi import registry

DETECTORS = (
    "Left: the largest test statistic of each lane within intervals of a 600th of the recording, on a logarithmic "
    "scale; the dashed line is the threshold. Right: the fault estimate; pale: not valid by its own flag."
)
FITS_PCT = 50.0  # a filter that is valid for less of a recording models another actuator or aircraft
REPLAYED, INPUT = "/replay/detectors/", "/input/"


class Watched:
    """What the detectors said of a recording, by the names that figures of a flight use; nobody knows its faults."""

    intervals: tuple = ()
    faults: tuple = ()
    knows_faults = False
    scenario = SimpleNamespace(faults=())

    def __init__(self, path: str | Path):
        """Read the log that `cosim replay --map` wrote to `path`. Raises LogError for another."""
        self.log = open_log(path, tolerant=True)
        names = [n for n in self.log.topics if n.startswith((REPLAYED, INPUT))]
        if "map.toml" not in self.log.attachments or not names:
            remedy = "cosim replay RECORDING --map MAP -o LOG writes one"
            raise LogError("is no log of a diagnosis", place=str(path), remedy=remedy)
        if self.log.gaps:
            raise LogError("ticks are missing", place=str(path), remedy="cosim replay RECORDING --map MAP.toml -o LOG")
        self._arrays = {n: self.log.array(n) for n in names}
        self.dt = self.log.dt_ns / 1e9
        self.t0 = float(self.log.metadata.get("run", {}).get("start_s", 0.0))
        self.end = self.t0 + (self.log.n_ticks - 1) * self.dt
        self.map = self.log.attachments["map.toml"].decode(errors="replace")
        told = {n: json.loads((self.log.result or {}).get(n, "[]")) for n in ("detectors", "caveats", "not_run")}
        self.verdicts = {(v["id"], v["target"]): v for v in told["detectors"]}
        self.caveats = list(map(str, told["caveats"]))
        self.lacking = [f"{lane} {why}" for lane, why in dict(told["not_run"]).items()]
        lanes = (self._lane(n) for n in names if n.startswith(REPLAYED))
        self.lanes = sorted(lanes, key=lambda lane: lane.level != "aircraft")

    def _lane(self, topic: str) -> Lane:
        name, _, lane = topic.removeprefix(REPLAYED).partition("/")
        info, rows = self.log.topics[topic], self._arrays[topic]
        level = "aircraft" if lane == "aircraft" else "local"
        main = next((n for n in info.fields if n.startswith("f_hat")), "")
        isolable_parts = getattr(registry.find(name), "isolable_parts", ())
        judged = judged_lane(name, level, lane, isolable_parts, info.fields)
        own = Lane(judged, lane, info.every, info.units, len(rows), main, self.dt)
        own.add(rows)
        alarm = bool(self.verdicts.get((name, own.target), {}).get("alarm"))
        own.entry = {"concerned": alarm, "able": True, "alarm": alarm}
        return own

    def inputs(self) -> dict[str, tuple[str, np.ndarray]]:
        """Return {signal, by its name in a map: (unit, samples)} of what was read, each once."""
        out: dict[str, tuple[str, np.ndarray]] = {}
        for topic, rows in self._arrays.items():
            if topic.startswith(INPUT):
                name, _, lane = topic.removeprefix(INPUT).partition("/")
                own = registry.records()[name].inputs if name in registry.records() else {}
                for field, unit, y in zip(self.log.topics[topic].fields, self.log.topics[topic].units, rows.T):
                    if field in own:
                        local = vocabulary.words()[own[field]].technologies
                        out.setdefault(f"{lane}.{own[field]}" if local else own[field], (unit, y))
        return out


def diagnosis_report(log: str | Path, output: str | Path) -> Path:
    """Write the page of a diagnosis to the file `output`; returns its Path. Raises LogError, OutputError."""
    watched = Watched(log)
    flown = cast(LoggedFlight, watched)  # for the figures, which read these of its attributes alone
    line, alarms, _ = timeline(flown)
    own, chips = detectors(flown)
    lacking = {"title": "Detectors that did not run", "content": watched.lacking}
    sections: list[tuple[str, list]] = [
        ("What the detectors said, and when", [line, verdicts(list(watched.verdicts.values()))]),
        ("What to keep in mind", [watched.caveats]),
        ("What lacks a signal", [lacking if watched.lacking else None]),
        ("Detectors", [DETECTORS, *own]),
        ("What they read", [_inputs(watched), {"title": "map.toml", "source": watched.map}]),
    ]
    return write(
        output,
        page(
            title=watched.log.metadata.get("run", {}).get("title", "Diagnosis"),
            subtitle=f"{watched.t0:.6g} to {watched.end:.6g} s of the recording, at {1 / watched.dt:.6g} Hz",
            summary=_summary(watched), sections=sections, chips=chips, span=[watched.t0, watched.end],
            start=watched.t0, alarms=alarms,
        ),
    )  # fmt: skip


def _summary(watched: Watched) -> list[tuple[str, list[Any]]]:
    """Return the summary: what fits the recording first, by the time of its alarm."""
    alarmed = [(lane, watched.verdicts[lane.id, lane.target]) for lane in watched.lanes if lane.entry["alarm"]]
    alarmed.sort(key=lambda pair: (pair[1]["valid_pct"] < FITS_PCT, pair[1]["first_alarm_s"]))
    quiet = [lane.name for lane in watched.lanes if not lane.entry["alarm"]]
    said = [_said(lane, told) for lane, told in alarmed]
    return [("Noticed", said or ["nobody"]), ("Quiet", [", ".join(quiet)] if quiet else [])]


def _said(lane, told):
    name = words((told["isolated"] or {}).get("class", "alarm"))
    model = "another aircraft's" if lane.level == "aircraft" else "another actuator's"
    care = "" if told["valid_pct"] >= FITS_PCT else f"; valid for {told['valid_pct']:.2g} % only: its model is {model}"
    return f"{lane.name} at {told['first_alarm_s']:.3f} s: {name}{care}"


def _inputs(watched: Watched) -> Figure:
    """Return the figure of every signal that a detector read, with units people use."""
    read = {n: (*SHOWN.get(unit, (unit, 1.0)), y) for n, (unit, y) in watched.inputs().items()}
    told = "As the detectors read them: resampled to their tick, in our signs; gaps are invalid."
    height, units = 90 + 150 * -(-len(read) // 2), [unit for unit, *_ in read.values()]
    figure = panels(cast(LoggedFlight, watched), "inputs", told, height, list(read), units, 2)
    for i, (name, (_, factor, y)) in enumerate(read.items(), 1):
        figure.curve(watched.t0, watched.dt, factor * y, name=name, panel=i, legend=False)
        figure.least(i, [factor * y], 1e-9)
    return figure
