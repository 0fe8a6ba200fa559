"""What may be wrong, as one table: every kind of fault on one segment, a side, all; sensors, engines, other surfaces.

A hypothesis has names from the finest to the coarsest, which are what can be blamed: a part (valve or drive, command,
surface with all that is mechanical, a sensor), its segment or the pair of sensors that one equation has, its side, the
whole. Several segments have a common part where they have one technology.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

SEGMENTS = ("left_outer", "left_inner", "right_inner", "right_outer")
TWO = {"left_inner": "left", "right_inner": "right"}  # segments of an aircraft that has one on each side
TECHNOLOGIES = ("hydraulic", "ema")
HYDRAULIC, EMA = TECHNOLOGIES
LOCAL = ("iotsekf", "rtsekf_flight", "ofc_monitor", "ema_kalman_flight", "position_monitor")
AIRCRAFT = ("rfafe", "lpv_smo", "control_redundancy", "kinematic")
LANES = (*((name, s) for s in SEGMENTS for name in LOCAL), *((name, "aircraft") for name in AIRCRAFT))
SENSORS = {HYDRAULIC: ("rod", "surface", "pressure"), EMA: ("position", "velocity", "current", "surface")}
DRIVE = {HYDRAULIC: "valve", EMA: "drive"}
KINDS = {  # kind of fault of an actuator, with where it enters -> part, verdict class, technologies
    "ofc_liquid": ("drive", "ofc_liquid", TECHNOLOGIES),
    "ofc_solid": ("drive", "ofc_solid", TECHNOLOGIES),
    "runaway": ("drive", "runaway", (HYDRAULIC,)),
    "hardover": ("drive", "runaway", (EMA,)),
    "loss_of_effectiveness": ("drive", "effectiveness", TECHNOLOGIES),
    **dict.fromkeys(("supply_pressure_drop", "internal_leakage", "air_in_oil"),
                    ("drive", "effectiveness", (HYDRAULIC,))),
    **dict.fromkeys(("winding_resistance", "magnet_loss"), ("drive", "effectiveness", (EMA,))),
    "jam_solid": ("surface", "jam_solid", TECHNOLOGIES),
    **dict.fromkeys(("free_float", "friction", "backlash"), ("surface", "effectiveness", TECHNOLOGIES)),
    "ofc_liquid@command": ("command", "ofc_liquid", TECHNOLOGIES),
    "ofc_solid@command": ("command", "ofc_solid", TECHNOLOGIES),
    "runaway@command": ("command", "runaway", TECHNOLOGIES),
    "bias@command": ("command", "jam_liquid", TECHNOLOGIES),
    "loss_of_effectiveness@command": ("command", "effectiveness", TECHNOLOGIES),
    "jam_liquid": ("loop sensor", "sensor", TECHNOLOGIES),  # rod or position, in which the servo's loop closes
    "pressure": ("sensor", "sensor", (HYDRAULIC,)),
    **dict.fromkeys(("velocity", "current"), ("sensor", "sensor", (EMA,))),
    "surface": ("sensor", "sensor", TECHNOLOGIES),
}  # fmt: skip
SAME = {  # kinds that are the same fault as one of KINDS
    "rod": "jam_liquid", "position": "jam_liquid", "ofc_liquid@sensor": "jam_liquid", "bias@sensor": "jam_liquid",
    "jam": "jam_solid",
}  # fmt: skip
PAIRS = (("q", "theta"), ("p", "phi"), ("r", "psi"), ("n_x", "v_ground"))
AIRFRAME = (
    "p", "q", "r", "phi", "theta", "psi", "n_x", "n_z", "hdot", "h_inertial", "h_baro", "tas", "cas", "mach",
    "alpha_ground", "v_ground", "alpha", "beta", "n_y", "pdot", "qdot", "rdot", "n1_1", "n1_2", "n1_3", "n1_4", "mass",
    "cg",
)  # fmt: skip
ENGINES = ("engine_1", "engine_2", "engine_3", "engine_4")
OTHERS = ("rudder", "aileron", "stabiliser")


@dataclass(frozen=True)
class Hypothesis:
    """What may be wrong: `names` from the finest to the coarsest (part, segment or pair, side, whole), "" where there
    is none; verdict class; `case` of the detectors' records; the `key` of its rates; the segments that it moves."""

    names: tuple[str, str, str, str]
    verdict: str
    case: str
    key: str
    segments: tuple[str, ...] = ()

    def on(self, segment: str, technology: str) -> "Hypothesis":
        """Return the same fault as the detectors of one segment meet it."""
        case = f"{technology}.{self.case.partition('.')[2]}"
        return Hypothesis(self.names, self.verdict, case, case, (segment,))


def segments(technology: Mapping[str, str]) -> dict[str, str]:
    """Return {one of SEGMENTS: technology} of {segment: technology} of an aircraft with four segments or with two."""
    back = {own: s for s, own in TWO.items()}
    return {back.get(s, s): t for s, t in technology.items() if back.get(s, s) in SEGMENTS and t in DRIVE}


def hypotheses(technology: Mapping[str, str]) -> list[Hypothesis]:
    """Return every Hypothesis for an aircraft with elevator segments {segment: technology}."""
    here, two = segments(technology), "left" in technology or "right" in technology
    sides = {side: tuple(s for s in here if s.startswith(side)) for side in ("left", "right")}
    groups: dict[str, tuple[str, ...]] = {TWO[s] if two else s: (s,) for s in here}
    groups |= {side: own for side, own in sides.items() if len(own) > 1}
    groups |= {"": tuple(here)} if len(here) > 1 else {}
    out = [h for group, own in groups.items() for h in _actuators(group, own, here)]
    for name in AIRFRAME:
        pair = next((" or ".join(pair) for pair in PAIRS if name in pair), "")
        out.append(Hypothesis((name, pair, "", "sensor"), "sensor", f"sensor.{name}", f"sensor.{name}"))
    out += [Hypothesis((name, "", "", "engine"), "thrust", "engine", "engine") for name in ENGINES]
    out.append(Hypothesis(("", "", "", "engine"), "thrust", "engine", "engine.all"))
    stuck = [Hypothesis((name, "", "", ""), "jam_solid", name, name) for name in OTHERS]
    return [*out, *stuck, *(replace(h, verdict="runaway", key=f"{h.key}.runaway") for h in stuck)]


def _actuators(group, own, here):
    """Return the hypotheses of KINDS on the segments `own`, which are called `group`, "" for all."""
    base, side = f"elevator_{group}".removesuffix("_"), f"elevator_{group.partition('_')[0]}".removesuffix("_")
    technologies = {here[s] for s in own}
    technology, one = here[own[0]], len(technologies) == 1
    coarser = (base if len(own) == 1 else "", side if side != "elevator" else "", "elevator")
    reach = technology if len(own) == 1 else "side" if group else "all"
    out = []
    for kind, (part, verdict, fits) in KINDS.items():
        if not technologies <= set(fits):
            continue
        loop = f"{SENSORS[technology][0]}_sensor"
        name = {"drive": DRIVE[technology], "loop sensor": loop, "sensor": f"{kind}_sensor"}
        common = one or part in ("command", "surface", "sensor")
        names = (f"{base}_{name.get(part, part)}" if common else "", *coarser)
        out.append(Hypothesis(names, verdict, f"{technology}.{kind}", f"{reach}.{kind}", own))
    return out


_LAYOUTS = [dict.fromkeys(own, t) for own in (SEGMENTS, TWO.values()) for t in TECHNOLOGIES]
ISOLABLE_PARTS = ("", *dict.fromkeys(n for t in _LAYOUTS for h in hypotheses(t) for n in h.names if n))


def turned(name: str, own: tuple[str, ...]) -> str:
    """Return a name in a fault on segments `own` as it is in the same fault on left_inner, or of the left side, and
    back."""
    if len(own) == 1 and own[0].endswith("outer"):
        name = name.replace("outer", "?").replace("inner", "outer").replace("?", "inner")
    return mirrored(name) if own and all(s.startswith("right") for s in own) else name


def mirrored(name: str) -> str:
    """Return a name with left and right exchanged; one of both sides, left and right, stays."""
    if "left and" in name:
        return name
    return name.replace("left", "?").replace("right", "left").replace("?", "right")
