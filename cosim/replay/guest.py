"""Guests and logs: whose code flew, whose is here, and a guest on a flight that it was not part of.

A log never runs code. What it tells of a guest (cosim/flight/plugins) is enough to judge and to show it; to run it
again its file is given once more, and the digests are compared.
"""

from typing import Any

import numpy as np

from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import wires
from cosim.log import Log
from cosim.replay.detector_replay import inputs, replay_lane, tick_of, unlogged
from cosim.replay.params import ReplayError
from fdi import registry
from fdi.common.record import Detector, Estimate


def tell(entry: dict) -> None:
    """Take from a log's entry of a detector the record of a guest, for judgement and pages."""
    about = entry.get("guest")
    if about and entry["id"] not in registry.SHIPPED:
        own = dict(about["record"])
        own["estimates"] = tuple(Estimate(*e) for e in own["estimates"])
        for name in ("technologies", "blind_to"):
            own[name] = tuple(own[name])
        registry.tell(Detector(id=entry["id"], level=entry["level"], every=entry["every"], **own))


def culprits(entry: dict) -> tuple:
    """Return what a detector of a log can blame."""
    about = entry.get("guest")
    if about and entry["id"] not in registry.SHIPPED:
        return tuple(about["culprits"])
    return registry.module(entry["id"]).CULPRITS if registry.known(entry["id"]) else ("",)


def missing(entry: dict) -> str:
    """Return why a detector of a log cannot be run again, "" when it can."""
    name, about = entry["id"], entry.get("guest") or {}
    if registry.known(name):
        return ""
    return f"{name} is a guest, and its code is not here: give it by --detector {about.get('file') or name}"


def other_code(entry: dict) -> str:
    """Return a sentence when the guest that is here is not the one that flew, else ""."""
    name, about = entry["id"], entry.get("guest")
    if not about or name not in registry.GUESTS or registry.GUESTS[name].sha256 == about["sha256"]:
        return ""
    here = registry.GUESTS[name].sha256
    return f"{name} is not the code that flew: digest {here[:12]} here, {about['sha256'][:12]} in the log"


def outputs(log: Log, guest: Any, technologies: dict[str, str]) -> dict[str, np.ndarray]:
    """Return {lane: outputs (rows, n)} of a guest run on an open log in which it did not fly, from the first tick on.

    Raises ReplayError for a signal that the log lacks, or for a log with gaps.
    """
    own = guest.DETECTOR
    if not log.spans or log.spans[0][0] or sum(log.spans[-1]) != log.n_ticks:
        raise ReplayError("ticks are missing, and a guest begins with the flight", place=str(log.path))
    local = own.level == "local"
    out = {}
    for lane in [s for s, t in technologies.items() if t in own.technologies] if local else ["aircraft"]:
        place = lane if local else ""
        read = wires(own, place)
        columns = ((w.field, _column(log, w.signal.topic, w.signal.field + "_valid" * w.flag)) for w in read)
        p = own.fit(site(tick_of(log), place, technologies))
        u = inputs(guest, log.n_ticks, columns)
        out[lane] = replay_lane(unlogged(own, lane, guest, u, p), tick_of(log))[0]
    return out


def _column(log, topic, field):
    """Return a signal as the observers had it: their own copy where the log has one."""
    for name in (topic.replace("/sensors/", "/observers/"), topic):
        if name in log.topics and field in log.topics[name].fields:
            return log.array(name)[:, log.topics[name].fields.index(field)]
    raise ReplayError(f"the log has no {topic}.{field}", place=str(log.path))
