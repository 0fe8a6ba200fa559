"""False alarms per valid hour as a curve over the threshold, of every detector, down to 1e-9, three ways.

    found = false_alarms(hours=100.0, folder="logs/false-alarms")       # flies on where it was left

Of a flight without a fault the largest of every detector's statistic is kept (cosim/campaign/fault_free.py). Level c
stands for all thresholds of the detector times c: c = 1 is the detector as it ships. One peak per flight: flights are
independent, what happens in one is not.

    counted     peaks at or beyond c, exact Poisson interval
    extremes    generalised Pareto tail of the highest peaks (cosim/compare/extreme_value.py)
    crossings   where the residual is stationary and Gaussian by test (cosim/compare/extreme_value.py)

The tail is also fitted to half of the flights, drawn, and held against the count of the rest. All of it is of this
model: of this aircraft, these sensors, gusts and tolerances, in this mix of flights.
"""

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cosim.campaign.fault_free import FaultFreeFlight, fly, space
from cosim.campaign.jobs import work
from cosim.campaign.spec import Space, shipped
from cosim.compare import extreme_value
from cosim.compare.extreme_value import Gaussian, gaussian
from cosim.compare.metrics import rate
from cosim.errors import CampaignError
from cosim.flight.plugins import loaded
from fdi import registry

HELD_OUT = (1.0, 0.3, 0.1)  # per hour: where the fit of half of the flights is held against the count of the rest
WANTED = 1e-9  # per hour: what a failure condition of the worst class is allowed
LEVELS = 60  # of a curve
LIMITS = {  # detectors whose threshold is no number: what it grows with
    "rfafe": "the command",
    "rfafe_airframe": "the command",
    "lpv_smo": "the distance from trim and the gusts",
    "control_redundancy": "what moves its rows",
    "kinematic": "roll and yaw rate",
    "iotsekf": "the command and the load",
    "position_monitor": "the model's lag",
    "ofc_monitor": "the command's motion",
    "ema_kalman_flight": "the motor's speed and effort",
}


def false_alarms(
    *, hours: float = 100.0, campaign: str = "fault-free", detectors: Sequence[str] = (),
    folder: str | Path | None = None, workers: int | None = None, progress: Callable[[int, int], None] | None = None,
) -> dict:  # fmt: skip
    """Fly `hours` of a fault-free campaign and return plain data: hours, flights, and an entry per detector.

    `folder` keeps what is flown, so that a killed or shorter measurement goes on; `detectors` are ids, by default all
    that ship, and user files: another version of a file is flown anew. Of a user's detector every crossing of
    its threshold counts, also one that it does not confirm. Raises CampaignError for an unknown detector, or a campaign
    with faults or parts; GuestError for a file without a detector.
    """
    files = [str(Path(name).resolve()) for name in detectors if Path(name).suffix == ".py"]
    ids, guests = [name for name in detectors if Path(name).suffix != ".py"], loaded(files)
    for name in ids:
        shipped(name, ("or a file of your own",))
    made = space(campaign)
    if made.faults:
        raise CampaignError("has faults", place=campaign, remedy="Take a campaign of fault-free flights")
    flights = _flights(made, hours * 3600.0)
    said = "".join([repr(made.campaign), *(g.sha256 for g in guests)])
    digest = hashlib.sha256(said.encode()).hexdigest()[:16]
    also = [name for name in ids if name in registry.ON_REQUEST]
    own = ({"files": files} if files else {}) | ({"also": also} if also else {})
    jobs = [(fly, {"campaign": campaign, "number": n, "digest": digest, **own}) for n in range(flights)]
    flown = work(jobs, folder=folder, workers=workers, progress=progress, read=FaultFreeFlight.read)
    return summary(flown, campaign, [*ids, *(g.DETECTOR.id for g in guests)] or registry.DEFAULT)


def _flights(made: Space, seconds: float) -> int:
    """Return how many flights of a space last for `seconds` or more, at least one."""
    number, left = 0, seconds
    while number == 0 or left > 1e-6:
        left -= made.number(number).duration_s
        number += 1
    return number


def summary(flown: Sequence[FaultFreeFlight], campaign: str, detectors: Sequence[str]) -> dict:
    """Return the plain data of a measurement: what was flown, and `curve` of every detector that was there."""
    done = [f for f in flown if f.lanes]
    there = [name for name in detectors if any(name in f.lanes for f in done)]
    return {
        "campaign": campaign, "flights": len(done), "hours": sum(f.seconds for f in done) / 3600.0,
        "infeasible": sum(f.status == "infeasible" for f in flown),
        "departed": sum(f.status not in ("completed", "infeasible") for f in flown),
        "detectors": [curve(name, done) for name in there],
    }  # fmt: skip


def curve(name: str, flown: Sequence[FaultFreeFlight]) -> dict:
    """Return the plain data of one detector: the curve, what it rests on, and what is against it."""
    lanes = [f.lanes[name] for f in flown if name in f.lanes]
    hours = sum(lane.valid_s for lane in lanes) / 3600.0
    peak, alarms = np.array([lane.peak for lane in lanes]), sum(lane.alarms for lane in lanes)
    tail = extreme_value.fit(peak, hours) if hours else extreme_value.Tail(0.0, note="never judges")
    moments = [m for lane in lanes for m in lane.moments]
    exact = gaussian(moments, flown[0].dt) if moments else Gaussian(flown[0].dt, note="its statistic has no sign")
    levels = _levels(peak, tail)
    out = {
        "id": name,
        "level": registry.record(name).level,
        "hours": hours,
        "flights": len(lanes),
        "alarms": alarms,
        "alarms_per_hour": rate(alarms, hours)._asdict() if hours else None,
        "largest": float(peak.max()),
        "highest": np.sort(peak)[::-1][: 2 * extreme_value.PEAKS].round(6).tolist(),
        "fit": {"note": tail.note, "peaks": tail.k, "from": tail.u, "sigma": tail.sigma, "shape": tail.shape._asdict(),
                "anderson_darling": tail.ad},
        "gaussian": exact.note or None,
        "stability": extreme_value.stability(peak, hours) if hours else [],
        "curve": _curve(levels, peak, hours, tail, exact),
        "held_out": _held_out(lanes),
    }  # fmt: skip
    out["agree"] = _agree(out["curve"], float(peak.max()))
    out["at_threshold"] = _at(1.0, peak, hours, tail)
    out["needed"] = None if tail.note else tail.level(WANTED)._asdict()
    out["against"] = against(name, out, sum(lane.silent for lane in lanes))
    out["certified"] = not out["against"]
    return out


def against(name: str, found: dict, silent: int) -> list[str]:
    """Return what is against calling WANTED per hour shown, in words; nothing: it is."""
    out, now = [], found["at_threshold"]
    if found["fit"]["note"]:
        out.append(f"no curve: {found['fit']['note']}")
    if limit := LIMITS.get(name):
        out.append(f"its threshold grows with {limit}")
    if silent:
        out.append(f"alarmed in {silent} flights with its statistic below 1")
    out += [f"{pair} do not agree" for pair, agree in found["agree"].items() if not agree]
    if [h for h in found["held_out"] if not h["agree"]]:
        out.append("half of the flights do not predict the others")
    if now is None or not now["high"] <= WANTED:
        out.append("never judges" if now is None else f"{WANTED:.0e} per hour is not shown".replace("e-0", "e-"))
    return out


def _at(c, peak, hours, tail):
    """Return the rate at one level: by the tail where it holds, else counted."""
    if not hours:
        return None
    far = not tail.note and c >= tail.u
    found = tail.rate(c) if far else extreme_value.counted(peak, hours, c)
    return {k: float(v[0]) for k, v in found._asdict().items()} | {"by": "extremes" if far else "counted"}


def _levels(peak, tail):
    """Return the levels of a curve: from where one flight in two reaches to where the tail is at WANTED."""
    low, high = float(np.median(peak)), float(peak.max())
    if not tail.note:
        far = tail.level(WANTED)
        high = max(high, min(far.high, 50.0 * max(high, 1.0)))
    low = max(low, 1e-3 * high, 1e-6)
    return np.geomspace(low, max(1.2 * high, 1.2 * low, 1.2), LEVELS)


def _curve(levels, peak, hours, tail, exact):
    out: dict[str, Any] = {"c": levels.tolist()}
    if not hours:
        return out
    out["counted"] = {k: v.tolist() for k, v in extreme_value.counted(peak, hours, levels)._asdict().items()}
    if not tail.note:
        on = levels >= tail.u
        found = tail.rate(levels[on])
        out["extremes"] = {k: [None] * int((~on).sum()) + v.tolist() for k, v in found._asdict().items()}
    if not exact.note:
        out["crossings"] = {k: v.tolist() for k, v in exact.rate(levels)._asdict().items()}
    return out


def _agree(curve, largest):
    """Return {ways: whether they agree}: intervals meet up to the largest peak; a bound is not below the extremes."""
    tail, out = curve.get("extremes"), {}
    on = [i for i, v in enumerate(tail["value"]) if v is not None] if tail else []
    if on:
        seen, reached = curve["counted"], (i for i in on if curve["c"][i] <= largest)
        out["counted and extremes"] = all(tail["low"][i] <= seen["high"][i] and seen["low"][i] <= tail["high"][i]
                                          for i in reached)  # fmt: skip
    if on and (bound := curve.get("crossings")):
        out["crossings and extremes"] = all(bound["high"][i] >= tail["low"][i] for i in on)
    return out


def _held_out(lanes):
    """Fit to half of the flights, count in the others; they agree where the two intervals meet."""
    order = np.random.default_rng(0).permutation(len(lanes))  # every other flight would part the manoeuvres
    fitted, rest = ([lanes[i] for i in half] for half in (order[::2], order[1::2]))
    hours = [sum(lane.valid_s for lane in half) / 3600.0 for half in (fitted, rest)]
    if not all(hours):
        return []
    peak = [np.array([lane.peak for lane in half]) for half in (fitted, rest)]
    tail = extreme_value.fit(peak[0], hours[0])
    out = []
    for wanted in HELD_OUT:
        if tail.note or wanted > tail.k / tail.hours:
            continue
        c = tail.level(wanted).value
        predicted, seen = tail.rate(c), extreme_value.counted(peak[1], hours[1], c)
        (low, high), (least, most) = ((float(b.low[0]), float(b.high[0])) for b in (predicted, seen))
        out.append({"rate": wanted, "level": c, "low": low, "high": high,
                    "counted": round(float(seen.value[0]) * hours[1]), "hours": hours[1], "counted_low": least,
                    "counted_high": most, "agree": low <= most and least <= high})  # fmt: skip
    return out
