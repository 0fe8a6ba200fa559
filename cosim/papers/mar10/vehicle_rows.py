"""[Mar10] on a flying vehicle of the talk's pattern (vehicle.py): 27 residuals, slides 12 to 15, "no tuning required".

Slide 11's draws, 20 a scenario. Beside them the transport's rows, on which most of the 27 do not exist.
"""

import functools
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.papers.drawing import Curve, Drawing, Panel
from cosim.papers.mar10 import isolation, vehicle
from cosim.papers.mar10.isolation import Choices
from cosim.papers.measured import share_of, worst

DRAWS = 20
ROLL, BANK = "delta_l", 20 * RAD_PER_DEG
RAW = Choices(mean_s=vehicle.DT)  # static residuals, sample by sample


@functools.cache
def _flights(number: int) -> list[vehicle.VehicleFlight]:
    return [vehicle.fly(number, draw) for draw in range(DRAWS)]


def blind() -> tuple[float, str]:
    """Return (families that fire for a fault that their signature does not have, those that do fire for theirs)."""
    wrong, seen = [], []
    for name in vehicle.EFFECTORS:
        flown = vehicle.fly_with(((name, 12.0),), 0.25, bank=BANK if name == ROLL else 0.0)
        families, r, tau, _ = isolation.residuals(flown, flown.u_c, Choices())
        fired = (np.abs(r) > tau)[round(12.5 / vehicle.DT) :].any(0)
        j = vehicle.EFFECTORS.index(name)
        wrong += [f.name for f, on in zip(families, fired) if on and not f.signature[j]]
        seen.append(f"{name}: {sum(fired)} of {sum(f.signature[j] for f in families)}")
    return len(wrong), "fire for theirs: " + ", ".join(seen)


def roll_fins() -> tuple[float, str]:
    """Return the share of draws [%] in which roll fins that lock at 12 s, in rolls to 20 deg and back, are named."""
    flights = [vehicle.fly_with(((ROLL, 12.0),), 0.0, (4, draw + 1), BANK) for draw in range(DRAWS)]
    said, right, others = _said(flights, ((ROLL, 12.0),), RAW)
    delay = np.median([names[0][0] - 12.0 for names, ok in zip(said, right) if ok] or [np.nan])
    return share_of(right)[0], f"after {delay:.2f} s{others}"


def _said(flights: list[vehicle.VehicleFlight], truth: Sequence, choice: Choices) -> tuple[list, list[bool], str]:
    """Return ([names of a flight], whether each is right, the others' most common two in words)."""
    said = [isolation.isolate(flown, choice).names for flown in flights]
    right = [
        [n for _, n in names] == [n for n, _ in truth] and all(t >= at for (t, _), (_, at) in zip(names, truth))
        for names in said
    ]
    others = Counter(", ".join(n for _, n in names) or "nothing" for names, ok in zip(said, right) if not ok)
    return said, right, "".join(f"; {names} in {n}" for names, n in others.most_common(2))


def _right(number: int, choice: Choices) -> tuple[float, str]:
    _, right, others = _said(_flights(number), vehicle.FAULTS.get(number, ()), choice)
    share, interval = share_of(right)
    return share, interval + others


def drawings() -> list[Drawing]:
    """Return the Drawings beside slides 12 to 15: the path of each scenario, and every family over its threshold."""
    return [_drawing(number) for number in vehicle.FAULTS]


def _drawing(number: int) -> Drawing:
    flown = vehicle.fly(number)
    families, r, tau, _ = isolation.residuals(flown, flown.u_c, Choices())
    said = isolation.isolate(flown)
    over, dt = np.where(flown.t[:, None] >= 4.0, r / tau, np.nan)[::4], 4 * vehicle.DT
    shown = [Panel("height", "m", (Curve("flown", flown.height[::4], dt=dt),))]
    for family, y in zip(families, over.T):
        name = f"{family.name}: {''.join(map(str, family.signature))}"
        shown.append(Panel(name, "", (Curve("residual over threshold", y, dt=dt),), (1.0, -1.0), 1.5))
    truth = "; ".join(f"{name} at {at:g} s" for name, at in vehicle.FAULTS[number])
    named = "; ".join(f"{name} at {at:.1f} s" for at, name in said.names) or "nothing"
    return Drawing(
        "mar10",
        f"slide {12 + number}",
        f"A vehicle of the talk's pattern, scenario {number}",
        f"Truth: {truth}. Named: {named}. Each family of residuals by its signature (delta_l, delta_m, delta_n, eta), "
        "with the nominal commands; thresholds are the sum of slide 11's uncertainties.",
        tuple(shown),
        onset=vehicle.FAULTS[number][0][1],
        span=(4.0, vehicle.END),
        row_px=140,
        look="the dashed bounds: each family crosses them for the faults of its signature and for no other.",
    )


def isolated(scenario: int) -> tuple[float, str]:
    """Return the share of draws [%] of a scenario with the right effectors in order, raw samples."""
    return _right(scenario, RAW)


def alarms() -> tuple[float, str]:
    """Return the share of draws [%] without a fault that name an effector, raw samples."""
    share, note = _right(0, RAW)
    return 100.0 - share, note


def identified() -> float:
    """Return the thrust loss that scenario 1 identifies with the nominal coefficients [%]."""
    return 100 * isolation.isolate(vehicle.fly(1)).loss


def least(**choice: Any) -> tuple[float, str]:
    """Return the share of draws that are right [%], least of three scenarios and of no fault; `choice` of Choices."""
    found = {f"scenario {n}" if n else "no fault": _right(n, Choices(**choice))[0] for n in (0, *vehicle.FAULTS)}
    return min(found.values()), worst(found, "{} {:.0f}")[1]
