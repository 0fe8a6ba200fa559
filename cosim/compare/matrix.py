"""The built-in matrix of `cosim compare`: fault-free flights, a grid of oscillations, and every built-in fault.

All fly at point E of [Alwi14], where every detector is within what it is made for, and every fault starts after 22 s,
when the slowest of them has learned its offsets (20 s, fdi/control_redundancy/control_redundancy.py). Seeds are those
of an evaluation.
"""

import tomllib

from cosim.campaign.inventory import builtin_names
from cosim.campaign.spec import EVALUATION_SEED
from cosim.flight.plant.point import SIX
from cosim.scenario import Scenario, load_scenario, parse
from cosim.scenario.override import apply
from cosim.scenario.toml import inline

POINT = {f"flight.{k}": v for k, v in SIX["E"].items()}
SHIFT_S = 12.0  # of faults and manoeuvres of the built-in scenarios, most of which break at 10 or 12 s
OFC_START_S, OFC_END_S = 22.0, 36.0
FREQUENCIES_HZ = (0.5, 1.0, 2.0, 5.0)
AMPLITUDES_MM = (0.6, 2.0, 6.0)  # 0.6 mm: the smallest that the industrial benchmark names (notes of the project)
MANOEUVRES: tuple[dict, ...] = (
    {"kind": "cruise"},
    {"kind": "nz_doublet", "start_s": 24.0, "width_s": 3.0, "amplitude_g": 0.15},
    {"kind": "three_two_one_one", "start_s": 24.0, "unit_s": 1.5, "amplitude_g": 0.15},
    {"kind": "coordinated_turn", "start_s": 22.0, "duration_s": 10.0, "bank_deg": 20.0},
)
AIR = ("none", "light")


def matrix() -> list[Scenario]:
    """Return the scenarios of the built-in comparison."""
    out = [*fault_free(), *oscillations(), *builtin()]
    return [_set(s, {"seed": EVALUATION_SEED + i}) for i, s in enumerate(out)]


def fault_free(repeats: int = 2) -> list[Scenario]:
    """Return flights without a fault: manoeuvres x air, and the same with every manoeuvre of the built-in faults. The
    second kind says what a manoeuvre alone does to a detector, so that its alarm is not taken for the fault's."""
    base = load_scenario("cruise", _overrides(POINT | {"duration_s": OFC_END_S}))
    each = [{f"manoeuvre.{k}": v for k, v in m.items()} for m in MANOEUVRES]
    plain = [_set(base, m | {"flight.turbulence": air}) for _ in range(repeats) for m in each for air in AIR]
    flown = {s.model_copy(update={"title": "", "faults": ()}).expanded_toml(): s for s in builtin()}
    own = [_set(s.model_copy(update={"faults": ()}), {"flight.turbulence": air}) for s in flown.values() for air in AIR]
    return [s.model_copy(update={"title": f"No fault: {s.manoeuvre.kind.replace('_', ' ')}"}) for s in plain + own]


def oscillations() -> list[Scenario]:
    """Return liquid oscillations at the valve: frequency x amplitude on one segment, larger ones on a side."""
    base = load_scenario("liquid-ofc", _overrides(POINT | {"duration_s": OFC_END_S, "faults.0.start_s": OFC_START_S}))
    out = []
    for target, amplitudes in (("elevator.left_inner", AMPLITUDES_MM), ("elevator.left", AMPLITUDES_MM[1:])):
        for i, hz in enumerate(FREQUENCIES_HZ):
            for j, mm in enumerate(amplitudes):
                changes = {"faults.0.target": target, "faults.0.frequency_hz": hz, "faults.0.amplitude_mm": mm}
                out.append(_set(base, changes | {"flight.turbulence": AIR[(i + j) % 2]}))
    return out


def builtin() -> list[Scenario]:
    """Return every built-in scenario with a single fault, at the matrix's flight point and SHIFT_S later."""
    out = []
    for name in builtin_names():
        s = load_scenario(name)
        if len(s.faults) != 1 or name == "liquid-ofc":
            continue
        f, changes = s.faults[0], {"duration_s": s.duration_s + SHIFT_S}
        changes["faults.0.start_s"] = f.start_s + SHIFT_S
        if f.end_s is not None:
            changes["faults.0.end_s"] = f.end_s + SHIFT_S
        if hasattr(s.manoeuvre, "start_s"):
            changes["manoeuvre.start_s"] = s.manoeuvre.start_s + SHIFT_S
        point = POINT if s.flight.cas_kt is not None else {}  # one without a speed as CAS keeps its own point
        out.append(load_scenario(name, _overrides(point | changes)))
    return out


def _overrides(changes):
    return [f"{k}={inline(v)}" for k, v in changes.items()]


def _set(scenario, changes):
    table = tomllib.loads(scenario.expanded_toml())
    if "manoeuvre.kind" in changes:
        table["manoeuvre"] = {}
    return parse(apply(table, _overrides(changes)), place="compare")
