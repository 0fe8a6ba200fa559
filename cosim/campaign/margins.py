"""Margins of a detector: how far what it believes may be off until it alarms without a fault, or loses one.

    found = margins("iotsekf", workers=2)      # a row per axis

An axis is one thing that a detector takes to be known, with rungs of growing error: each symbol of its actuator, all
aerodynamic coefficients at random corners, the mass and the centre of gravity that it is told, the age of its readings,
the rate, the air. Everything else is nominal. On every rung `flights` flights without a fault and as many with one that
the detector is designed for (the first such one of FAULTS) are flown, always with the same seeds and corners. An axis
goes on until both have happened; the last rung at which neither had is what is shown of it.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.campaign.flights import run_many
from cosim.campaign.pool import pool
from cosim.campaign.spec import shipped
from cosim.campaign.worker import run_id
from cosim.errors import CampaignError
from cosim.flight.blocks.sensors import TRANSPORT
from cosim.judge import coverage
from cosim.scenario import load_scenario
from cosim.scenario.catalog import DEFAULT_TECHNOLOGY, SENSORS_OF
from cosim.scenario.tolerance import toleranced
from cosim.scenario.toml import inline
from cosim.table import Column, Table, of
from fdi import registry

FIRST_SEED, FLIGHTS, START_S = 2_500_000, 2, 20.0
BASE = {"duration_s": 34.0, "flight.turbulence": "light", "manoeuvre.kind": "nz_doublet", "manoeuvre.start_s": 12.0}
SHARES = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3)  # of a symbol, of all coefficients, of the mass
FAULTS: tuple[dict[str, Any], ...] = (
    {"target": "elevator.left_inner", "kind": "ofc_liquid", "amplitude_mm": 2.0, "frequency_hz": 1.0},
    {"target": "elevator.right_inner", "kind": "ofc_liquid", "amplitude_mm": 0.6, "frequency_hz": 1.0},
    {"target": "elevator.right_inner.position", "kind": "bias", "path": "loop", "bias_mm": 2.0},
    {"target": "elevator.left_inner.rod", "kind": "bias", "path": "monitor", "bias_mm": 3.0},
    {"target": "elevator.left_inner", "kind": "runaway", "rate_deg_s": 8.0},
    {"target": "sensor.theta", "kind": "bias", "path": "observers", "bias_deg": 1.5},
    {"target": "engine.4", "kind": "thrust_loss", "loss_pct": 100.0},
)
# what it alarms on only where all elevators have it
WHOLE: dict[str, Any] = {
    "target": "elevator.all", "kind": "ofc_liquid", "at": "command", "amplitude_deg": 1.5, "frequency_hz": 1.0,
}  # fmt: skip
WIDE = ("rfafe", "rfafe_airframe", "lpv_smo")


@dataclass(frozen=True)
class Axis:
    """One thing that may be off: its rungs, and what a rung changes of the flight with number `k`."""

    name: str
    unit: str
    rungs: tuple
    keys: Callable[[Any, int], dict[str, Any]]


def axes(detector: str) -> list[Axis]:
    """Return the axes of a detector: of its actuator's symbols where it is local, of the aircraft's where it is not."""
    own = registry.record(detector)
    up, out = tuple(100.0 * s for s in SHARES), []
    factors = {f"{t} {symbol}": f"tolerances.{t}.{symbol}" for t in own.technologies for symbol in toleranced(t)}
    if not own.technologies:
        out.append(Axis("all coefficients, random corners", "%", up, _corner))
        factors = {f"{word} that it is told": f"sensors.{word}.scale" for word in ("mass", "cg")}
    for name, key in factors.items():
        turn = lambda percent, k, key=key: {key: 1.0 + percent / 100.0}  # noqa: E731
        out += [Axis(name, "%", up, turn), Axis(name, "%", tuple(-v for v in up), turn)]
    names = {word.rpartition(".")[2] for word in own.inputs.values()}
    there = [n for t in own.technologies for n in SENSORS_OF[t]] if own.technologies else TRANSPORT
    read = {w: TRANSPORT[w][2] if w in TRANSPORT else 0.0 for w in there if w in names}
    if read:
        out.append(Axis("age of its readings", "s more", (0.01, 0.02, 0.05, 0.1),
                        lambda v, k: {f"sensors.{w}.delay_s": v + late for w, late in read.items()}))  # fmt: skip
    out += [Axis("rate", "Hz", rungs, lambda v, k: {"rate_hz": v}) for rungs in ((100, 50), (400, 1000))]
    return [*out, Axis("air", "", ("moderate", "severe"), lambda v, k: {"flight.turbulence": v})]


def _corner(share, k):
    rng = np.random.default_rng([FIRST_SEED, k])
    return {f"tolerances.aero.{n}": float(1.0 + share / 100.0 * rng.choice((-1.0, 1.0))) for n in toleranced("aero")}


def fault(detector: str) -> dict[str, Any]:
    """Return the fault that a detector has to keep seeing; CampaignError where it is designed for none."""
    own = [WHOLE] if detector in WIDE else FAULTS
    for one in own:
        case = coverage.case_of(one["kind"], one["target"], DEFAULT_TECHNOLOGY, one.get("at", ""))
        if coverage.expected(detector, case) == coverage.DESIGNED:
            return one | {"start_s": START_S}
    raise CampaignError("is designed for none of the faults that margins are measured with", place=detector)


@dataclass
class Margin:
    """What is shown of an axis: the last rung without a false alarm, the first with one, the same of a lost fault."""

    axis: str
    unit: str
    silent_to: Any = None  # None: on no rung
    alarms_from: Any = None
    sees_to: Any = None
    loses_from: Any = None


def margins(
    detector: str, *, flights: int = FLIGHTS, workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Margin]:  # fmt: skip
    """Return the Margin of every axis of a shipped detector, the nominal one first. `progress(done, total)` counts
    flights; the total falls as axes end. Raises CampaignError for an unknown detector."""
    own = "One of your own cannot be taken: what it believes is not known"
    shipped(detector, remedy=own if detector.endswith(".py") else "")
    broken = fault(detector)
    every = [Axis("nothing", "", (0,), lambda v, k: {}), *axes(detector)]
    out, done = [Margin(a.name, a.unit) for a in every], 0
    with pool(workers) as executor:
        for rung in range(max(len(a.rungs) for a in every)):
            going = [i for i, (a, m) in enumerate(zip(every, out)) if rung < len(a.rungs) and
                     (m.alarms_from is None or m.loses_from is None)]  # fmt: skip
            made = {(i, k, bad): _scenario(detector, every[i].keys(every[i].rungs[rung], k), k, broken if bad else None)
                    for i in going for k in range(flights) for bad in (False, True)}  # fmt: skip
            frame = run_many(list(made.values()), executor=executor, achieved=False).frame
            done += len(made)
            if progress:
                progress(done, done + sum(len(every[i].rungs) - rung - 1 for i in going) * 2 * flights)
            mine = frame[frame["id"] == detector].groupby("run")
            alarms, seen = mine["false_alarms"].sum(), mine["delay_s"].apply(lambda d: d.notna().any())
            for i in going:
                value = every[i].rungs[rung]
                cried = any(alarms.get(run_id(made[i, k, bad]), 0) for k in range(flights) for bad in (False, True))
                lost = not all(seen.get(run_id(made[i, k, True]), False) for k in range(flights))
                m = out[i]
                if m.alarms_from is None:
                    m.alarms_from, m.silent_to = (value, m.silent_to) if cried else (None, value)
                if m.loses_from is None:
                    m.loses_from, m.sees_to = (value, m.sees_to) if lost else (None, value)
    return out


def _scenario(detector, keys, k, broken):
    """Return flight `k` with these keys, and with a fault where one is given."""
    words = (word.split(".")[0] for word in registry.record(detector).inputs.values() if word.count(".") == 2)
    read = {*words} & {*registry.DEFAULT}  # those that it reads fly, too
    enabled = [name for name in registry.SHIPPED if name in read] + [detector]
    own = {**BASE, "seed": FIRST_SEED + k, "detectors.enabled": enabled, **keys}
    pairs = [f"{key}={inline(value)}" for key, value in own.items()]
    return load_scenario("cruise", [*pairs, f"faults=[{inline(broken)}]"] if broken else pairs)


def table(found: list[Margin]) -> Table:
    """Return the Table of margins; what stayed silent and seeing on every rung of a share stands in one row."""
    calm = [m for m in found if m.unit == "%" and m.alarms_from is None and m.loses_from is None]
    most = max((abs(m.silent_to) for m in calm if m.silent_to is not None), default=0.0)
    names = sorted({m.axis for m in calm} - {m.axis for m in found if m not in calm})
    found = [m for m in found if m.axis not in names]
    found += [Margin(f"each of the other {len(names)}", "%", f"±{most:g}", None, f"±{most:g}")] if names else []

    def said(key):
        return lambda m: "–" if m[key] is None else f"{m[key]:+g}" if isinstance(m[key], float) else str(m[key])

    columns = (
        Column("off", lambda m: f"{m['axis']}, {m['unit']}" if m["unit"] else m["axis"], right=False),
        Column("silent to", said("silent_to")), Column("alarms from", said("alarms_from"), doc="without a fault"),
        Column("sees to", said("sees_to")),
        Column("loses from", said("loses_from"), doc="a fault that it is designed for"),
    )  # fmt: skip
    return of(columns, [dataclasses.asdict(m) for m in found], caption="–: on no rung that was flown.")
