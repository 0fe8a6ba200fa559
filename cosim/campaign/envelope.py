"""The envelope: where the aircraft trims, with what in hand, and where its elevator actuators stall.

A point that does not trim carries the reason; one that does carries alpha, stabiliser, throttle and, per technology,
the angles at which the hinge moment of a segment in that flight equals the actuator's stall moment,
M_stall = |HM0 + HM_delta delta|, cut at the travel. Friction, which helps an actuator to hold, is left out.
"""

import concurrent.futures as cf
import itertools
import math
from collections.abc import Callable
from typing import Any

import pandas as pd

from cosim.campaign.pool import pool
from cosim.errors import TrimError
from cosim.flight.plant.plant import FlightPoint, Plant
from cosim.scenario.aircraft import load_aircraft
from cosim.scenario.catalog import TECHNOLOGIES
from cosim.table import Column, Table, of

REASONS = {  # the first word of a TrimError -> what it means on a map
    "stall": "stall: the wing gives less lift than level flight needs",
    "thrust": "thrust: the engines cannot hold speed and altitude",
    "speed": "Mach beyond the aerodynamic data (0.95)",
    "stabiliser": "stabiliser beyond its travel, -13 to +4 deg",
}
MASSES_T, CGS_PCT = (200.0, 260.0, 320.0, 375.0, 405.0), (25.0, 30.0, 36.0)
ALTITUDES_FT = tuple(5000.0 * k for k in range(9))
SPEEDS_KT = tuple(150.0 + 15.0 * k for k in range(17))
SPANS = ("cas_kt", "mach", "alpha_deg", "stabilizer_deg", "throttle")
# technology -> at the surface [N m]; a plain actuator knows no load
STALL_MOMENT = {name: t.design(()).stall_moment for name, t in TECHNOLOGIES.items() if t.servo}


def trim_map(
    masses_t: tuple[float, ...] = MASSES_T, cgs_pct: tuple[float, ...] = CGS_PCT,
    altitudes_ft: tuple[float, ...] = ALTITUDES_FT, cas_kt: tuple[float, ...] = SPEEDS_KT, *, workers: int | None = 0,
    progress: Callable[..., Any] | None = None,
) -> Any:  # fmt: skip
    """Return a table of every combination of the four.

    Columns: mass_t, cg_pct, altitude_ft, cas_kt, reason ("" when it trims, a key of REASONS, or "none found"), why (the
    whole message), mach, alpha_deg, stabilizer_deg, throttle; <technology>_up_deg and _down_deg, the reach of
    the segment that reaches least. `workers` processes, None for one per core, 0 for this one; `progress(done, total)`
    counts points.
    """
    points = list(itertools.product(masses_t, cgs_pct, altitudes_ft, cas_kt))
    rows: list = []
    with pool(workers) as here:
        for future in cf.as_completed([here.submit(_point, *point) for point in points]):
            rows.append(future.result())
            if progress:
                progress(len(rows), len(points))
    return pd.DataFrame(rows).sort_values(["mass_t", "cg_pct", "altitude_ft", "cas_kt"], ignore_index=True)


def _point(mass, cg, altitude, cas):
    row = {"mass_t": mass, "cg_pct": cg, "altitude_ft": altitude, "cas_kt": float(cas), "reason": "", "why": ""}
    plant = Plant(FlightPoint.at(mass, cg, altitude, cas_kt=cas))
    try:
        trim = plant.trim()
    except TrimError as error:
        word = error.problem.split(":")[0]
        return row | {"reason": word if word in REASONS else "none found", "why": error.problem}
    truth = plant.truth()[0]
    row |= {"mach": float(truth.mach), "alpha_deg": math.degrees(trim.alpha), "throttle": trim.throttle}
    row["stabilizer_deg"] = math.degrees(trim.stabilizer)
    for technology, moment in STALL_MOMENT.items():
        held = [reach(truth[f"hm0_{s}"], truth[f"hmd_{s}"], moment) for s in plant.aircraft.short.values()]
        row[f"{technology}_up_deg"] = max(up for up, _ in held)
        row[f"{technology}_down_deg"] = min(down for _, down in held)
    return row


def reach(hm0: float, hmd: float, stall_moment: Any) -> tuple[float, float]:
    """Return the (up, down) angles [deg] that `stall_moment` [N m] holds against HM0 + HM_delta delta, hmd < 0."""
    low, high = (math.degrees(v) for v in load_aircraft().travels["elevator"])
    up = math.degrees((stall_moment - hm0) / hmd)  # trailing edge up: the air drives down with +stall_moment
    down = math.degrees((-stall_moment - hm0) / hmd)
    return max(up, low), min(down, high)


def summary(table: Any) -> dict[str, Any]:
    """Return plain data of a trim map: counts, reasons, speeds flown per mass, where each technology loses travel.

    stalls: technology -> {up, down}: lowest CAS [kt] at which a segment does not reach the end of its travel that way,
    null where it always does, and the least angle [deg] that it reaches.
    """
    low, high = (math.degrees(v) for v in load_aircraft().travels["elevator"])
    good = table[table["reason"] == ""]
    stalls: dict = {}
    for technology in STALL_MOMENT:
        up, down = good[f"{technology}_up_deg"], good[f"{technology}_down_deg"]
        ways = {"up": (up > low + 1e-9, up.max()), "down": (down < high - 1e-9, down.min())}
        stalls[technology] = {
            way: {"from_kt": float(good.loc[short, "cas_kt"].min()) if short.any() else None, "reach_deg": float(worst)}
            for way, (short, worst) in ways.items()
        }
    return {
        "points": len(table),
        "trimmed": len(good),
        "reasons": {str(k): int(n) for k, n in table.loc[table["reason"] != "", "reason"].value_counts().items()},
        "masses": [{"mass_t": float(m), "trimmed": len(part), "highest_ft": float(part["altitude_ft"].max()),
                    **{name: [float(part[name].min()), float(part[name].max())] for name in SPANS}}
                   for m, part in good.groupby("mass_t")],
        "stalls": stalls,
    }  # fmt: skip


def masses(found: dict[str, Any]) -> Table:
    """Return the Table of `summary` by mass: what is flown."""

    def span(key, digits, factor=1.0):
        return lambda m: " to ".join(f"{factor * v:.{digits}f}" for v in m[key])

    columns = (
        Column("mass", lambda m: f"{m['mass_t']:.0f}", "t"), Column("points", "trimmed"),
        Column("speed", span("cas_kt", 0), "kt CAS"), Column("Mach", span("mach", 2)),
        Column("highest", lambda m: f"{m['highest_ft']:,.0f}", "ft"),
        Column("angle of attack", span("alpha_deg", 1), "deg"), Column("stabiliser", span("stabilizer_deg", 1), "deg"),
        Column("throttle", span("throttle", 0, 100.0), "%"),
    )  # fmt: skip
    return of(columns, found["masses"])
