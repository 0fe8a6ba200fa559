"""What the detectors of an EMA say of a fault: first, right and last name, when the alarm ends, what is reconfigured.

Every flight (`ema_cases`) has a fault of its own on each segment; each segment is a run of the tables, with exact
(Clopper-Pearson) 95 % intervals. `ambiguous` never counts as a right name. Flights of other seeds, DEVELOPMENT on, were
used to make the decisions; those of the tables begin at FIRST.

    cosim study ema_names
"""

from collections import Counter, defaultdict
from itertools import pairwise
from typing import Any

import numpy as np

from actuators.constants import RAD_PER_DEG
from actuators.ema import jay
from cosim.papers.studies import Options, Question, Table, naming
from cosim.papers.studies.ema_cases import FAMILIES, NOISE, SIZED, flown
from cosim.papers.studies.naming import named, share
from cosim.scenario.catalog import SEGMENTS
from cosim.training.flights import DT, EMA, ema_wires
from fdi import registry

ABOUT = "How the detectors of an EMA name faults, and when their alarms end; times are for one free core."
# first seeds; the sets from 8,400,000 and from 9,100,000 on were flown before the last decisions
DEVELOPMENT, FIRST = 6_000_000, 9_400_000
SETTLED = 2.0  # [s]
ARM, LEAD = jay.values()["arm"], jay.values()["lead"]
RIGHT = {
    "liquid": "ofc_liquid", "solid": "ofc_solid", "hardover": "runaway", "runaway": "runaway", "jam": "jam_solid",
    "screw": "jam_solid", **dict.fromkeys(("drift", "scale", "position", "position_ofc"), "sensor position"),
    **dict.fromkeys(("velocity", "velocity_scale"), "sensor velocity"), "surface": "sensor surface",
    **dict.fromkeys(("current", "current_scale", "current_ofc"), "sensor current"),
    **{name: f"sensor {name.removesuffix('_noise')}" for name in NOISE},
}  # fmt: skip
# right or ambiguous is what is asked
WEAR = ("resistance", "resistance_160", "magnets", "backlash", "drive_loss", "free_float")
AT_COMMAND = ("command_loss", "runaway")  # before the demand: the position monitor's
MOVING = 4.0 * RAD_PER_DEG  # a segment whose healthy command changes by so much moves
EXCITED = 0.3 * RAD_PER_DEG  # a position that is off by so much shows a scale; a surface held so far away a jam
EXCITED_RATE = 0.02 * jay.LIMITS["elevator"][1] / jay.values()["K_B"]  # the bias that is asked for [rad/s]
EXCITED_CURRENT = 0.5  # five deviations of the current's noise [A]
LOST_VOLTAGE = jay.values()["K_B"] / (jay.values()["K_ic"] + jay.values()["R"])  # [A s/rad]


def _excited(lane, frame, segment, a, b):
    """Return when the fault shows: a scale by the size of what it scales, weaker magnets by the current that their
    voltage would have kept away, a jam by the distance from the reference."""
    screw = frame[f"ema.{segment}.motor"].to_numpy()[a:b]
    position, rate = LEAD * screw / ARM, np.gradient(screw, DT)
    if lane["name"] == "scale":
        return 0.25 * np.abs(position) > EXCITED
    if lane["name"] == "velocity_scale":
        return 0.25 * np.abs(rate) > EXCITED_RATE
    if lane["name"] == "magnets":
        return 0.4 * LOST_VOLTAGE * np.abs(rate) > EXCITED_CURRENT
    if lane["name"] in ("jam", "screw"):
        return np.abs(frame[f"ema_servo.{segment}.r"].to_numpy()[a:b] - position) > EXCITED
    return np.ones(b - a, bool)


def outcome(lane: dict[str, Any], log: np.ndarray, frame: Any, segment: str, culprits: Any) -> dict[str, Any]:
    """Return what came of a fault, as plain data; times [s] count from its onset, None for never."""
    fault, n = lane["faults"][-1], len(log)
    a = min(int(np.ceil(fault["start_s"] / DT - 1e-6)), n - 1)
    b = min(int(np.ceil(fault.get("end_s", n * DT) / DT - 1e-6)), n)
    alarm = log["alarm"] > 0.5
    out = {"early": bool(alarm[round(SETTLED / DT) : a].any()), "delay": None, "first": "none", "last": "none",
           "right_after": None, "changes": 0, "standing": None, "withdrawn": None, "reconf_after": None,
           "shown_after": None, "moves": float(np.ptp(frame["law.law.de_cmd"].to_numpy()[a:b]))}  # fmt: skip
    shown = _excited(lane, frame, segment, a, b)
    if shown.any():
        out["shown_after"] = float(np.argmax(shown)) * DT
    on = np.flatnonzero(alarm[a:b])
    if not len(on):
        return out
    names = [named(c, w, culprits) for c, w in zip(log["verdict"][a:b], log["culprit"][a:b])]
    said = [names[k] for k in on]
    wanted = RIGHT.get(lane["name"], "effectiveness")
    k = int(on[0])
    hit = next((int(j) for j, name in zip(on, said) if name == wanted), None)
    shown = shown[k:]
    out |= {"delay": k * DT, "first": said[0], "last": said[-1], "right_after": None if hit is None else hit * DT,
            "changes": sum(x != y for x, y in pairwise(said)),
            "standing": float(alarm[a + k : b][shown].mean()) if shown.any() else None}  # fmt: skip
    if b < n:
        after = np.flatnonzero(alarm[b:])
        out["withdrawn"] = 0.0 if not len(after) else (int(after[-1]) + 1) * DT if after[-1] < n - b - 1 else np.inf
    if "reconf" in (log.dtype.names or ()) and (log["reconf"][a:b] > 0.5).any():
        out["reconf_after"] = float(np.argmax(log["reconf"][a:b] > 0.5)) * DT
    return out


def watched(frame: Any) -> dict[str, np.ndarray]:
    """Return {detector: log (segments, ticks)} of what the detectors make of a flown table."""
    from cosim.flight.signals import detect

    out = {}
    for name in EMA:
        module, extra = registry.module(name), ("reconf",) if name == "ema_kalman_flight" else ()
        p = module.params("flight_ema") if name == "position_monitor" else module.params()
        lanes = [ema_wires(name, s) for s in SEGMENTS]
        out[name] = detect(frame, module, lanes, p, ("alarm", "verdict", "culprit", *extra))
    return out


def fly_one(family: str, k: int, seed: int, reconfigure: bool = False) -> list[Any]:
    """Fly flight `k` of a family; return [[segment's draw, air, {detector: outcome}]] of its segments."""
    frame, lanes, air = flown(family, k, seed, reconfigure)
    logs = watched(frame)
    return [[lane, air, {name: outcome(lane, log[i], frame, SEGMENTS[i], registry.module(name).CULPRITS)
                         for name, log in logs.items()}] for i, lane in enumerate(lanes)]  # fmt: skip


def fly_size(name: str, k: int, seed: int) -> list[Any]:
    """Fly flight `k` with four sizes of fault `name`; return [[size, seen and not misnamed]]."""
    frame, lanes, _ = flown(name, k, seed)
    log = watched(frame)["ema_kalman_flight"]
    out = []
    for i, lane in enumerate(lanes):
        o = outcome(lane, log[i], frame, SEGMENTS[i], registry.module("ema_kalman_flight").CULPRITS)
        right = RIGHT.get(name, "effectiveness")
        out.append([lane["size"], o["last"] in ((right, "ambiguous") if name in WEAR else (right,))])
    return out


def fly_free(k: int, seed: int, air: str | None = None) -> list[Any]:
    """Fly flight `k` without a fault; return [air, {detector: [names that it gave, seconds of alarm]}]."""
    frame, _, said = flown("free", k, seed, air=air)
    return [said, naming.cried(watched(frame))]


def _quantiles(values):
    finite = [np.inf if x is None else x for x in values]
    return [float(np.quantile(finite, q, method="higher")) for q in (0.5, 0.95)] if finite else [None, None]


def _names(runs, detector, only):
    found = defaultdict(list)
    for lane, _, o in runs:
        if "lost" not in lane and only(lane["name"]) and not lane["healed"]:
            found[lane["name"]].append(o[detector])
    rows, times = [], []
    for name in sorted(found):
        own, good = found[name], RIGHT.get(name, "effectiveness")
        seen = [o for o in own if o["delay"] is not None]
        standing = [o["standing"] for o in seen if o["standing"] is not None]
        rows.append([name, share(len(seen), len(own)), share(sum(o["first"] in (good, "ambiguous") for o in seen),
                     len(seen)), share(sum(o["last"] == good for o in seen), len(own)),
                     share(sum(o["last"] in (good, "ambiguous") for o in seen), len(own)),
                     ", ".join(f"{k} {n}" for k, n in Counter(o["last"] for o in own).items())])  # fmt: skip
        times.append([name, *_quantiles([o["delay"] for o in own]), *_quantiles([o["right_after"] for o in own]),
                      *_quantiles(_after_it_shows(own)), share(sum(o["changes"] <= 1 for o in seen), len(seen)),
                      share(sum(x >= 0.95 for x in standing), len(standing))])  # fmt: skip
    return [Table(f"{detector}: names", ("fault", "seen", "first right or ambiguous", "last right",
                  "last right or ambiguous", "last"), rows),
            Table(f"{detector}: times [s], median and 95 %", ("fault", "alarm>", "95 %>", "right name>", "95 %>",
                  "after it shows>", "95 %>", "one change at most", "stands while it shows"), times)]  # fmt: skip


def _after_it_shows(own):
    """Return the times to the right name from when each fault shows, of those that do; None where it is not given."""
    return [None if o["right_after"] is None else max(o["right_after"] - o["shown_after"], 0.0)
            for o in own if o["shown_after"] is not None]  # fmt: skip


def _withdrawn(runs, detector="ema_kalman_flight", only=lambda name: name not in AT_COMMAND):
    found = defaultdict(list)
    for lane, air, o in runs:
        own = o[detector]
        if lane["healed"] and only(lane["name"]) and own["delay"] is not None:
            found[lane["name"], air].append(own)
            found["all", ""].append(own)
    rows = [[name, air, share(sum(o["withdrawn"] <= 3.0 for o in own), len(own)),
             float(np.median([o["withdrawn"] for o in own])), float(max(o["withdrawn"] for o in own))]
            for (name, air), own in sorted(found.items())]  # fmt: skip
    return Table(f"{detector}: alarm withdrawn within 3 s after the fault heals",
                 ("fault", "air", "in time", "median [s]>", "latest [s]>"), rows)


def _incipient(runs):
    drift = [(abs(lane["faults"][-1]["drift_deg_s"]), o["ema_kalman_flight"]) for lane, _, o in runs
             if lane["name"] == "drift"]  # fmt: skip
    off = [np.inf if o["reconf_after"] is None else o["reconf_after"] * rate for rate, o in drift]
    rows = [[f"{low:g} to {high:g}", share(sum(x < 1.0 for x in own), len(own)), *_quantiles(own)]
            for low, high in ((0.02, 0.06), (0.06, 0.2), (0.2, 0.5))
            for own in [[x for x, (rate, _) in zip(off, drift) if low <= rate <= high]]]  # fmt: skip
    return Table("drift of the position [deg/s]: reconfigured before 1 deg, and how far off by then",
                 ("rate", "before 1 deg", "median [deg]>", "95 %>"), rows)


def _command(runs):
    rows = []
    for name in AT_COMMAND:
        own = [o["position_monitor"] for lane, _, o in runs if lane["name"] == name and not lane["healed"]]
        moving = [o for o in own if o["moves"] >= MOVING]
        seen = [o for o in moving if o["delay"] is not None]
        rows.append([name, len(own), share(len(seen), len(moving)), *_quantiles([o["delay"] for o in moving]),
                     ", ".join(f"{k} {n}" for k, n in Counter(o["last"] for o in seen).items())])
    return Table("position_monitor: faults before the demand, of a segment that is asked to move by 4 deg",
                 ("fault", "runs>", "seen where it moves", "median [s]>", "95 %>", "last"), rows)


def _lost(runs):
    found = defaultdict(list)
    for lane, _, o in runs:
        if "lost" in lane:
            found[lane["lost"], lane["name"]].append(o["ema_kalman_flight"])
    rows = [[f"{first}, then {name}", share(sum(not o["early"] for o in own), len(own)),
             share(sum(o["last"] in (RIGHT[name], "ambiguous") for o in own), len(own)),
             *_quantiles([o["delay"] for o in own]), ", ".join(f"{k} {n}" for k, n in
                                                               Counter(o["last"] for o in own).items())]
            for (first, name), own in sorted(found.items())]  # fmt: skip
    return Table("ema_kalman_flight: a sensor is lost at 5 s, a fault comes later",
                 ("", "no alarm at the loss", "right or ambiguous", "median [s]>", "95 %>", "last"), rows)


def _faults(options, values):
    runs = [run for flight in values for run in flight]
    return [*_names(runs, "ema_kalman_flight", lambda name: name not in AT_COMMAND), _withdrawn(runs), _incipient(runs),
            _command(runs), _withdrawn(runs, "position_monitor", lambda name: name in AT_COMMAND),
            *_names(runs, "position_monitor", lambda name: True), _lost(runs)]  # fmt: skip


def _reconfigured(options, values):
    runs = [run for flight in values for run in flight]
    return [*_names(runs, "ema_kalman_flight", lambda name: True), _incipient(runs)]


def _sizes(options, values):
    from cosim.compare.pod import fit

    rows, left = [], iter(values)
    for name, (key, low, high) in SIZED.items():
        runs = [run for _ in range(options.seeds) for run in next(left)]
        pod = fit(np.array([s for s, _ in runs]), np.array([seen for _, seen in runs]))
        rows.append([name, f"{key}, {low:g} to {high:g}", share(sum(s for _, s in runs), len(runs)), pod.a90,
                     pod.a90_95, pod.note])  # fmt: skip
    return [Table("size from which on 9 of 10 are named, of wear also as ambiguous: fit, and at 95 % confidence",
                  ("fault", "sizes drawn", "named", "a90>", "a90/95>", ""), rows)]  # fmt: skip


def _free(options, values):
    return [naming.free_table(values)]


def _jobs(reconfigure, families):
    def jobs(o: Options):
        return [(fly_one, {"family": f, "k": k, "seed": FIRST, "reconfigure": reconfigure})
                for f in families for k in range(o.seeds)]  # fmt: skip

    return jobs


def _size_jobs(o):
    return [(fly_size, {"name": name, "k": k, "seed": FIRST}) for name in SIZED for k in range(o.seeds)]


def questions() -> list[Question]:
    """Return the Questions of the study."""
    faulty = tuple(f for f in FAMILIES if f != "free")
    return [
        Question("names", "every fault, servos on their measurement (6 min)", _jobs(False, faulty), _faults, seeds=45),
        Question("estimate", "faults of sensors, the loop reconfigured (1 min)", _jobs(True, ("sensor",)),
                 _reconfigured, seeds=30),
        Question("sizes", "probability of a right name by size (3 min)", _size_jobs, _sizes, seeds=24),
        Question("free", "flights without a fault, still air to moderate (3 min)", lambda o: [
            (fly_free, {"k": k, "seed": FIRST}) for k in range(o.seeds)], _free, seeds=120),
        Question("severe", "the same in severe turbulence (1 min)", lambda o: [
            (fly_free, {"k": k, "seed": FIRST + 500_000, "air": "severe"}) for k in range(o.seeds)], _free, seeds=40),
    ]  # fmt: skip
