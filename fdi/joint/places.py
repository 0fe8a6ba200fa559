"""Places of a fault, and the hypotheses of `fdi.joint.joint`: what may be wrong there, and which lanes look at it.

A place is a part that can be blamed: valve (drive of an electromechanical segment), command, surface (all that is
mechanical, from the rod to the surface) or a sensor of a segment; the command of a side or of all elevators; a sensor
of the aircraft, an engine, another surface. A hypothesis is a place and a class. Its `kind` is what the same fault is
on every segment: `hydraulic.drive.ofc_liquid`; by kind its records are looked up and its rates are counted.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

SEGMENTS = ("left_outer", "left_inner", "right_inner", "right_outer")
TWO = {"left_inner": "left", "right_inner": "right"}  # segments of an aircraft that has one on each side
LOCAL = ("iotsekf", "rtsekf", "rtsekf_flight", "ofc_monitor", "ema_kalman_flight", "position_monitor")
AIRCRAFT = ("rfafe", "rfafe_airframe", "lpv_smo", "control_redundancy", "kinematic")
WIDE = ("aircraft", "second")  # lanes of no segment; "second": the other sensor that a detector names beside its first
LANES = (*((name, s) for s in SEGMENTS for name in LOCAL), *((name, "aircraft") for name in AIRCRAFT),
         ("kinematic", "second"))  # fmt: skip
SENSORS = {"hydraulic": ("rod", "surface", "pressure"), "ema": ("position", "velocity", "current", "surface")}
DRIVE = {"hydraulic": "valve", "ema": "drive"}
CLASSES = {"drive": ("ofc_liquid", "ofc_solid", "runaway", "effectiveness"), "surface": ("jam_solid", "effectiveness"),
           "command": ("ofc_liquid", "ofc_solid", "jam_liquid", "runaway")}  # fmt: skip
AIRFRAME = (
    "p", "q", "r", "phi", "theta", "psi", "n_x", "n_z", "hdot", "h_inertial", "h_baro", "tas", "cas", "mach",
    "alpha_ground", "v_ground", "alpha", "beta", "n_y",
)  # fmt: skip
ENGINES = ("engine_1", "engine_2", "engine_3", "engine_4", "engine")
OTHERS = ("rudder", "aileron", "stabiliser")

_PARTS = tuple(dict.fromkeys(
    [*DRIVE.values(), "command", "surface", *(f"{s}_sensor" for own in SENSORS.values() for s in own)]
))  # fmt: skip
_BASES = (*SEGMENTS, "left", "right")
_OWN = tuple(f"elevator_{base}_{part}" for base in _BASES for part in _PARTS)
PLACES = (*_OWN, "elevator_command", *AIRFRAME, *ENGINES, *OTHERS)
SETS: dict[str, tuple[str, ...]] = {  # what is said while it may be any of several, the smallest first
    "q or theta": ("q", "theta"),
    **{f"elevator_{s}": tuple(p for p in PLACES if p.startswith(f"elevator_{s}_")) for s in SEGMENTS},
    **{f"elevator_{s}": tuple(p for p in PLACES if p.startswith(f"elevator_{s}_")) for s in ("left", "right")},
    "engine": ENGINES,
    "sensor": AIRFRAME,
    "elevator": tuple(p for p in PLACES if p.startswith("elevator")),
}
CULPRITS = ("", *PLACES, *(name for name in SETS if name not in PLACES))

CAUSES = {  # what else than its usual cause a class may have in a part: cases of the records, each seen by others
    "hydraulic.drive.effectiveness": ("supply_pressure_drop", "internal_leakage", "air_in_oil"),
    "ema.drive.effectiveness": ("winding_resistance",),
    **{f"{own}.surface.effectiveness": ("friction", "backlash") for own in DRIVE},
}  # fmt: skip
CASE = {  # part and class of a kind -> case of the records (cosim/judge/coverage.py)
    "drive.effectiveness": "loss_of_effectiveness", "surface.effectiveness": "free_float",
    "surface.jam_solid": "jam_solid", "command.jam_liquid": "bias@command", "drive.runaway": "runaway",
    **{f"command.{c}": f"{c}@command" for c in ("ofc_liquid", "ofc_solid", "runaway")},
}  # fmt: skip


@dataclass(frozen=True)
class Hypothesis:
    """What may be wrong: `place` of PLACES, verdict class, kind, and the segments that it moves."""

    place: str
    verdict: str
    kind: str
    segments: tuple[str, ...] = ()

    @property
    def side(self) -> str:
        """Return "left" or "right", "" where it is of both or of none."""
        sides = {s.split("_")[0] for s in self.segments}
        return sides.pop() if len(sides) == 1 else ""


def case(kind: str, technology: str = "hydraulic") -> str:
    """Return the case that a detector's record has for a kind; `technology` where it is of several segments."""
    group, _, rest = kind.partition(".")
    part, _, verdict = rest.partition(".")
    if group in ("sensor", "surface"):
        return kind if group == "sensor" else rest
    if group == "engine":
        return "engine"
    own = group if group in DRIVE else technology
    if part.endswith("_sensor"):
        return f"{own}.{part.removesuffix('_sensor')}"
    if (own, part, verdict) == ("ema", "drive", "runaway"):
        return "ema.hardover"
    return f"{own}.{CASE.get(f'{part}.{verdict}', verdict)}"


def segments(technology: Mapping[str, str]) -> dict[str, str]:
    """Return {one of SEGMENTS: technology} of {segment: technology} of an aircraft with four segments or with two."""
    back = {own: s for s, own in TWO.items()}
    return {back.get(s, s): t for s, t in technology.items() if back.get(s, s) in SEGMENTS and t in DRIVE}


def hypotheses(technology: Mapping[str, str]) -> list[Hypothesis]:
    """Return every Hypothesis for an aircraft with elevator segments {segment: technology}."""
    here, out = segments(technology), []
    two = "left" in technology or "right" in technology
    for s, own in here.items():
        base = f"elevator_{TWO[s] if two else s}"
        for part, classes in CLASSES.items():
            name = DRIVE[own] if part == "drive" else part
            kinds = [(c, f"{own}.{part}.{c}") for c in classes]
            kinds += [(c, f"{own}.{part}.{cause}") for c, kind in kinds for cause in CAUSES.get(kind, ())]
            out += [Hypothesis(f"{base}_{name}", c, kind, (s,)) for c, kind in kinds]
        out += [Hypothesis(f"{base}_{n}_sensor", "sensor", f"{own}.{n}_sensor", (s,)) for n in SENSORS[own]]
    sides = {side: tuple(s for s in here if s.startswith(side)) for side in ("left", "right")}
    groups = {f"elevator_{side}_command": own for side, own in sides.items() if len(own) > 1 and not two}
    groups |= {"elevator_command": tuple(here)} if len(here) > 1 else {}
    for name, reach in groups.items():
        kind = "all" if name == "elevator_command" else "side"
        out += [Hypothesis(name, c, f"{kind}.command.{c}", reach) for c in CLASSES["command"]]
    out += [Hypothesis(name, "sensor", f"sensor.{name}") for name in AIRFRAME]
    out += [Hypothesis(name, "thrust", "engine.one" if name[-1].isdigit() else "engine.all") for name in ENGINES]
    return [*out, *(Hypothesis(name, "jam_solid", f"surface.{name}") for name in OTHERS)]


def turned(name: str, own: Sequence[str]) -> str:
    """Return a name in a fault on segments `own` as it is in the same fault on left_inner, or of the left side, and
    back."""
    if len(own) == 1 and own[0].endswith("outer"):
        name = name.replace("outer", "?").replace("inner", "outer").replace("?", "inner")
    return mirrored(name) if own and all(s.startswith("right") for s in own) else name


def mirrored(name: Any) -> Any:
    """Return a name with left and right exchanged; one of both sides, left and right, stays."""
    if re.match(r"(\w*)left(\w*) and \1right\2\b", name):
        return name
    return name.replace("left", "?").replace("right", "left").replace("?", "right")
