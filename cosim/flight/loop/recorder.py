"""Recorder of a flight: topics for everything of a tick, attachments for what replay needs."""

import functools
import io
import json
import os
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from actuators.block import unit
from actuators.kernels import version
from cosim.flight.blocks import faults, hinge_model, law, sensors
from cosim.flight.detection import detectors
from cosim.log import LogWriter, Pose, Topic, viewer_layouts
from cosim.scenario import toml, user_parts, vocabulary
from cosim.scenario.catalog import TECHNOLOGIES
from fdi import registry

SNAPSHOT_S = 1.0  # hidden detector states are logged that often
RARE = 5  # of these in a log that a replay reads from its beginning
LARGE = 1 << 18  # [byte] larger parameters are compressed: tables of a force model


def topics(setup: Any) -> list:
    """Return the log's topics: everything of a tick, under names that a reader understands."""
    bus, technology, out = setup.loop.bus, setup.scenario.elevator.technology, []

    def add(name, columns, group, every=1):
        """Add a topic of [(field, unit, position)]."""
        if columns:
            fields, units, index = zip(*columns)
            words = name.split("/")
            channel = "/".join(words[: 3 if words[1] in ("actuators", "detectors", "state") else 2])
            out.append(Topic(name, fields, units, np.array(index), every, group, channel))

    def section(block, lane, fields=None, name=vocabulary.column):
        kind = bus.kinds[block]
        return [(name(f), unit(kind, f), i) for f, i in bus.columns(block, lane, fields)]

    def measured(words, lane, y, valid):
        own = [vocabulary.find(word, lane) for word in words]
        names = [(word, s.unit, bus.index(s.source.replace("y_obs", y))) for word, s in zip(words, own)]
        return names + [(f"{w}_valid", "-", bus.index(s.flag.replace("valid_obs", valid))) for w, s in zip(words, own)]

    add(vocabulary.topic("truth", "aircraft"), section("truth", "aircraft"), "truth")
    add(vocabulary.topic("surfaces", "aircraft"), section("surfaces", "aircraft"), "truth")
    copies = {"/sensors": ("y", "valid"), **({"/observers": ("y_obs", "valid_obs")} if _parted(setup.scenario) else {})}
    for prefix, copy in copies.items():
        add(f"{prefix}/aircraft", measured(sensors.installed(setup.scenario.aircraft), "", *copy), "sensors")
        for seg in technology:
            add(f"{prefix}/{seg}", measured(TECHNOLOGIES[technology[seg]].sensors, seg, *copy), "sensors")
    noise = [(lane, "-", bus.index(f"sensors_in.{lane}.noise")) for lane in bus.lanes["sensors"]]
    add("/sensors/noise", noise, "sensors")
    add(vocabulary.topic("pilot", "pilot"), section("pilot", "pilot"), "law")
    add(vocabulary.topic("law", "law"), section("law", "law", law.OUTPUTS), "law")
    for seg in technology:
        add(vocabulary.topic("hinge_model", seg), section("hinge_model", seg, hinge_model.OUTPUTS), "detectors")
    for b in (*setup.loop.servos, *setup.loop.actuators):
        for lane in bus.lanes[b.name]:
            kind = b.module.INPUTS
            held = [("u_held", unit(kind, "u"), bus.index(f"{b.name}_in.{lane}.u"))] if "u" in kind.names else []
            add(vocabulary.topic(b.name, lane), section(b.name, lane, b.module.OUTPUTS) + held, "actuators")
    for lane in setup.lanes:
        add(vocabulary.topic("faults", lane.name), section("faults", lane.name, faults.OUTPUTS), "faults")
    for d in setup.loop.detectors:
        for lane in bus.lanes[d.name]:
            add(vocabulary.topic(d.name, lane), section(d.name, lane, d.module.OUTPUTS), "detectors", d.every)
            hidden = [n for n in d.module.STATE.names if n not in d.module.OUTPUTS]
            every = max(1, round(SNAPSHOT_S / setup.loop.dt / d.every)) * d.every
            add(f"/state/{d.name}/{lane}", section(d.name, lane, hidden, str), "snapshot", every)
    return out


def _parted(scenario):
    """Tell whether a fault can part the two copies of a sensor: only then the observers' is logged beside the law's."""
    return any(j.path in ("observers", "monitor") for j in scenario.injections())


def _replayed(channels, manifest):
    """Return those of the topics, and of their fields, that a replay of the detectors reads."""
    read = {(topic, f) for d in manifest for wires in d["inputs"].values() for _, topic, f in wires}
    own = {f"/{kind}/{d['id']}/{lane}" for d in manifest for lane in d["lanes"] for kind in ("detectors", "state")}
    out = []
    for t in channels:
        at = [i for i, f in enumerate(t.fields) if t.name in own or (t.name, f) in read]
        names, units = ([each[i] for i in at] for each in (t.fields, t.units))
        every = RARE * t.every if t.name.startswith("/state/") else t.every
        out += [replace(t, fields=names, units=units, index=t.index[at], every=every)] if at else []
    return out


def _drawn(channels, manifest):
    """Return the topics that a page or the judgement reads; no detector can be replayed from them."""
    for d in manifest:
        d["inputs"] = {lane: [] for lane in d["inputs"]}
    return [t for t in channels if not t.name.startswith(("/state/", "/sensors/noise", "/hinge/", "/observers/"))]


PROFILES = {"replay": _replayed, "signals": _drawn}  # of a scenario's `log_profile`: (topics, detectors.json) -> topics


def open_writer(setup: Any, path: str | os.PathLike) -> LogWriter:
    """Return the LogWriter of a flight's log, with what does not change written: scenario, parameters, wiring."""
    import cosim

    loop, channels, profile = setup.loop, topics(setup), setup.scenario.log_profile
    manifest = detectors.manifest(setup.detectors, _parted(setup.scenario))
    if profile:
        channels = PROFILES[profile](channels, manifest)
    blocks = [loop.sensors, loop.pilot, loop.law, loop.hinge, *loop.detectors, *loop.servos, *loop.actuators]
    attachments = {
        "scenario.toml": ("application/toml", _portable(setup.scenario).encode()),
        "detectors.json": ("application/json", json.dumps(manifest, indent=1, sort_keys=True).encode()),
    }
    for b in loop.detectors if profile == "replay" else blocks:
        attachments |= _array(f"{b.name}.params", b.p) | _array(f"{b.name}.initial", b.x)
    attachments |= user_parts.sources(setup.scenario) | ({} if profile == "replay" else viewer_layouts(channels))
    metadata = {
        "run": {
            "title": setup.scenario.title, "software": f"cosim {cosim.__version__}",
            "rate_hz": str(setup.scenario.rate_hz), "seed": str(setup.scenario.seed),
            "ticks": str(setup.scenario.ticks),
            **({"log_profile": profile} if profile else {}),
        },
        "trim": {k: repr(v) for k, v in vars(setup.trim).items() if isinstance(v, float)},
        "libraries": {"jsbsim": version("jsbsim"), "numpy": np.__version__, "numba": version("numba")},
    }  # fmt: skip
    writer = LogWriter(
        path, channels, n_values=len(loop.v), dt_ns=round(loop.dt * 1e9), metadata=metadata, attachments=attachments,
        pose=None if profile == "replay" else pose(loop.bus), compression="zstd" if profile else "lz4",
    )  # fmt: skip
    for f in setup.scenario.faults if profile != "replay" else ():
        start, end = (None if t is None else round(t * setup.scenario.rate_hz) for t in (f.start_s, f.end_s))
        writer.window(start, start, end, kind=f.kind, target=f.target)
    return writer


def pose(bus: Any) -> Pose:
    """Return where in the bus the aircraft's place stands."""
    index = [bus.index(f"truth.aircraft.{n}") for n in ("lat", "lon", "h", "phi", "theta", "psi")]
    return Pose(tuple(index))


def result_texts(result: Any) -> dict[str, Any]:
    """Return the result's texts for the log: nothing in them depends on the machine's clock."""
    kept = [{k: v for k, v in d.items() if k != "step_us"} for d in result.to_dict()["detectors"]]
    return {
        "status": result.status, "reason": result.reason, "sim_time_s": repr(result.sim_time_s),
        "detectors": json.dumps(kept, sort_keys=True),
        "achieved": json.dumps(result.extra.get("achieved"), sort_keys=True),
        **({"not_run": json.dumps(result.extra["not_run"])} if result.extra.get("not_run") else {}),
        **({"notes": json.dumps(result.extra["notes"])} if result.extra.get("notes") else {}),
    }  # fmt: skip


def _portable(scenario):
    """Return the scenario as TOML without folders of this machine: a user detector is named by its file and digest."""
    table = tomllib.loads(scenario.portable_toml())
    for name in scenario.running:
        if name not in registry.SHIPPED:  # registered by a program, and perhaps without a file
            own = table["detectors"].setdefault(name, {"file": Path(registry.module(name).file).name})
            own["sha256"] = registry.module(name).sha256
    return toml.dumps(table)


_bare = functools.cache(np.lib.format.drop_metadata)  # dtypes that differ in their metadata alone are equal


def _array(name, array):
    """Return {attachment: (media type, bytes)} of an array: .npy, or .npz with it as `array` when it is large."""
    out, array = io.BytesIO(), array.view(_bare(array.dtype))
    if array.nbytes > LARGE:
        np.savez_compressed(out, array=array)
        return {f"{name}.npz": ("application/zip", out.getvalue())}
    np.save(out, array, allow_pickle=False)
    return {f"{name}.npy": ("application/x-npy", out.getvalue())}
