"""The lines about the faults of a flight: what was asked for, where it entered, and how far the elevator moved."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from rich.text import Text

if TYPE_CHECKING:  # `--help` needs no scenario
    from cosim.scenario import Scenario

OTHERS = ", with the other faults"
LITTLE, MUCH = 0.8, 1.25  # achieved over asked, beyond which a note says so

WHY = {  # place of entry -> why the elevator moves otherwise
    "valve": "valve or drive can do so much, and the servo works against it",
    "command": "the servo follows a fast command in part, or overshoots",
    "sensor": "the servo follows a fast reading in part, or overshoots",
}


def lines(scenario: "Scenario", achieved: dict | None) -> list:
    """Return the Texts about the faults of `scenario`; `achieved` {segment: peaks and amplitudes}, or None."""
    if not scenario.faults:
        return [Text("no fault", style="dim")]
    out = []
    for i, f in enumerate(scenario.faults):
        own = _own(f)
        until = "" if f.end_s is None else f" to {f.end_s:g} s"
        at = f.entry(scenario.elevator.technology)
        where = "".join(f" {w} {v}" for w, v in (("at", at), ("path", f.path)) if v)
        began = f.start_s < scenario.duration_s
        onset = f"from {f.start_s:g} s{until}" if began or f.when is None else "which never began"
        text = f"{f.kind} on {f.target}{where}, {onset}{'' if f.when is None else f', when {f.when}'}"
        moved = {n: (achieved or {})[n] for n in _segments(f) if began and n in (achieved or {})}
        reached, note = _achieved(scenario, i, moved) if moved else ("", "")
        name = f"fault {i}  " if len(scenario.faults) > 1 else "fault  "  # as in --set faults.1.kind
        out.append(Text.assemble((name, "red"), text, f"  ({own})" if own else "", reached))
        if note:
            out.append(Text(f"note   {note}", style="yellow"))
    return out


def broke(scenario: "Scenario", i: int, achieved: dict | None) -> str:
    """Return what fault `i` broke, when, and how large it became, or what was asked for where no elevator moved."""
    f = scenario.faults[i]
    moved = {n: (achieved or {})[n] for n in _segments(f) if n in (achieved or {})}
    reached = _achieved(scenario, i, moved)[0] if moved else ""
    size = reached.removeprefix("; achieved ").removesuffix(OTHERS) or _own(f)
    return f"{f.kind} on {f.target} from {f.start_s:g} s" + (f", {size}" if size else "")


def consequences(found: Mapping[str, float] | None) -> list[Text]:
    """Return the line about what the faults did to the aircraft; none without a fault that began."""
    if not found:
        return []
    f = found
    outside = f"{f['outside_s']:.1f} s out of bounds" if f["outside_s"] else "within bounds"
    told = (
        f"n_z {f['nz_min_g']:.2f} to {f['nz_max_g']:.2f} g, {f['altitude_lost_m']:.0f} m lost, "
        f"bank {f['bank_deg']:.1f} deg, speed -{f['speed_lost_kt']:.0f} +{f['speed_gained_kt']:.0f} kt, "
        f"hinge {f['hinge_max_nm'] / 1e3:.1f} kN m, {outside}"
    )
    return [Text.assemble(("effect ", "red"), told)]


def _own(fault):
    """Return a fault's own numbers, as they stand in the scenario."""
    given = (fault.model_extra or {}).items()
    return ", ".join(f"{k} {v:g}" for k, v in given if not (k == "phase_deg" and v == 0.0))


def _segments(fault):
    """Return the elevator segments that a fault acts on; none for one that only a monitor sees."""
    on = fault.parsed.place in ("elevator", "actuator_sensor") and fault.path != "monitor"
    return fault.parsed.names if on else ()


def _achieved(scenario, i, moved):
    """Return (words for how far fault `i` moved its segments `moved`, a note where that is not what was asked for)."""
    f, extra = scenario.faults[i], scenario.faults[i].model_extra or {}
    swings = all(m["amplitude_deg"] is not None for m in moved.values())
    keys = ("amplitude_mm", "amplitude_deg") if swings else ("rod_mm", "surface_deg")
    given = {key: [m[key] for m in moved.values() if m[key] is not None] for key in keys}
    found = [f"{_span(v)} {key.rpartition('_')[2]}" for key, v in given.items() if v]
    if not found:
        return "", ""
    others = any(set(_segments(g)) & moved.keys() for j, g in enumerate(scenario.faults) if j != i)
    words = f"; achieved {'' if swings else 'at most '}{', '.join(found)}{OTHERS * others}"
    if not (swings and f.kind.startswith("ofc")):
        return words, ""
    travel = extra["amplitude_travel"] * math.degrees(scenario.aircraft.travel) if "amplitude_travel" in extra else None
    for key, asked in zip(keys, (extra.get("amplitude_mm"), extra.get("amplitude_deg", travel))):
        if asked and given[key] and not all(LITTLE <= v / asked <= MUCH for v in given[key]):
            unit = key.rpartition("_")[2]
            share = " to ".join(dict.fromkeys(f"{100.0 * v / asked:.0f}" for v in (min(given[key]), max(given[key]))))
            return words, f"faults.{i}: asked for {asked:g} {unit}, achieved {share} % of it; {WHY[f.at]}"
    return words, ""


def _span(values):
    """Return "6.0", or "5.1 to 6.0" of several segments."""
    low, high = (f"{v:.1f}" if v >= 1.0 else f"{v:.2g}" for v in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"
