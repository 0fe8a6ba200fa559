"""A second judge: names, delays and standing alarms from a log's frames alone, by no code of cosim.judge."""

import tomllib

import cosim
from fdi import registry
from fdi.common.verdict import NAMES

ONE = {"jam": "jam_solid", "hardover": "runaway", "thrust_loss": "thrust", "bias": "jam_liquid"}
OWN = ("ofc_liquid", "ofc_solid", "jam_solid", "jam_liquid", "runaway")  # named by a class of the same word
READ = ("bias", "scale", "drift", "freeze", "noise", "oscillation", "dropout")
SWUNG = {"bias": "jam_liquid", "oscillation": "ofc_liquid"}  # what a sensor that closes the loop makes of them


def classes(kind, sensor, at=""):
    """Return the classes that name a fault of `kind` on `sensor`, "" for the actuator, which enters `at` a place."""
    if sensor and kind in READ:
        return {"sensor"} | ({SWUNG[kind]} if sensor in ("rod", "position") and kind in SWUNG else set())
    if kind == "jam_liquid":  # the sensor that closes the loop
        return {kind, "sensor"}
    own = {kind if kind in OWN else ONE.get(kind, "effectiveness")}
    return own | {"sensor"} if at == "sensor" and kind in ("ofc_liquid", "bias") else own


def word(fault, level, lane, verdict, part):
    """Return "right", "wrong" or "ambiguous" of a class and a part that a lane names."""
    place, *rest = fault["target"].split(".")
    sensor = rest[1] if place == "elevator" and len(rest) > 1 else rest[0] if place == "sensor" else ""
    at = fault.get("at", "")
    parts = {sensor, "rod", "position"} if fault["kind"] == "jam_liquid" or at == "sensor" else {sensor}
    if level == "aircraft" and place != "sensor":
        parts = {place, f"{place}_{rest[0]}", f"{place}_{rest[0].split('_')[0]}"} if rest else {place}
        parts |= {"thrust"} if place == "engine" else set()
        parts |= {"elevator_left and elevator_right"} if fault["target"] == "elevator.all" else set()
    good = verdict in classes(fault["kind"], sensor, at)
    if " or " in part and parts & {*part.split(" or ")}:  # a set that holds it
        part = ""
    given = part or level == "local"
    if not good and verdict not in ("ambiguous", "none"):
        return "wrong"
    if part and part not in parts:
        return "wrong"
    no_part = verdict == "sensor" and not part
    return "right" if good and given and not no_part and part in parts else "ambiguous"


def judged(path):
    """Return {(detector, lane): {seen, delay, word, standing}} of every lane that the one fault of a log concerns."""
    log, out = cosim.open_log(path), {}
    (fault,) = tomllib.loads(log.attachments["scenario.toml"].decode())["faults"]
    start, end = fault["start_s"], fault.get("end_s", float("inf"))
    for topic in (t for t in log.topics if t.startswith("/detectors/")):
        detector, lane = topic.split("/")[2:4]
        level = "aircraft" if lane == "aircraft" else "local"
        at = (*fault["target"].split("."), "")[1]
        if level == "local" and at not in (lane, lane.split("_")[0], "all"):
            continue
        f = log.frame(topic, fields=["alarm", "verdict", "isolated_part"])
        t, up = f.index.to_numpy(), f["alarm"].to_numpy() > 0.5
        rises = t[up & ~(f["alarm"].shift(fill_value=0.0).to_numpy() > 0.5)]
        rises = rises[(rises >= start - 1e-6) & (rises < end + 2.0)]
        one = out[detector, lane] = {"seen": bool(len(rises)), "delay": None, "word": None, "standing": bool(up[-1])}
        if one["seen"]:
            one["delay"] = rises[0] - start
            named = f[up & (t >= rises[0] - 1e-6) & (t < end - 1e-6) & (f["verdict"].to_numpy() > 0.5)]
            tail = named[named.index > named.index[-1] - 1.0] if len(named) else named
            most = tail.groupby(["verdict", "isolated_part"]).size()
            if len(tail) and 2 * most.max() >= len(tail):
                verdict, isolated_part = most.idxmax()
                part = registry.module(detector).ISOLABLE_PARTS[int(isolated_part)]
                one["word"] = word(fault, level, lane, NAMES[int(verdict)], part)
    return out
