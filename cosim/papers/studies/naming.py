"""What the studies of names share: flights over the envelope with a fault of its own on each segment, and their counts.

Points, gusts, noise x 1.2, tolerances of +-5 % (what is machined is off by less) and faults all come from the seed of
the flight. Segments are judged one by one: what they share is the aircraft's motion and its gusts.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pandas as pd
from scipy.stats import beta

from cosim.compare.metrics import proportion
from cosim.errors import TrimError
from cosim.flight.signals import fly
from cosim.papers.studies import Table
from cosim.scenario import parse
from cosim.scenario.catalog import SEGMENTS
from cosim.training.flights import DT, envelope
from fdi import registry
from fdi.common import verdict

ONSET = 12.0  # [s]
NOISE_SCALE, TOLERANCE = 1.2, 0.05
EXACT = {"arm": 0.003, "lead": 0.003}  # tolerance of what is machined
AIR = ("none", "light", "moderate")
HANDS: tuple[dict, ...] = (  # from calm to lively
    {"kind": "cruise"},
    {"kind": "nz_doublet", "amplitude_g": 0.15},
    {"kind": "three_two_one_one", "amplitude_deg": 1.5, "unit_s": 1.0},
    {"kind": "coordinated_turn", "duration_s": 15.0},
    {"kind": "nose_up", "amplitude_g": 0.15},
)
MOVING = HANDS[1:3]  # a jam shows only where the surface is asked to move
FREE_S = 60.0  # of a flight without faults
Family = Callable[[np.random.Generator, int], tuple[list[dict], float, Sequence[dict]]]  # (segments, seconds, hands)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform."""
    return float(low * (high / low) ** rng.uniform())


def signed(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number of either sign, uniform in size."""
    return float(rng.choice([-1.0, 1.0]) * rng.uniform(low, high))


def faulty(draws: Mapping[str, Callable], rng: np.random.Generator, name: str, heal: float | None = None) -> dict:
    """Return a segment {name, healed, faults} with fault `name` of `draws`, which heals after `heal` s or 4 periods."""
    fault = {"start_s": ONSET + float(rng.uniform(0.0, 1.0)), **draws[name](rng)}
    if heal is not None:
        fault["end_s"] = fault["start_s"] + max(heal, 4.0 / fault.get("frequency_hz", np.inf))
    return {"name": name, "healed": heal is not None, "faults": [fault]}


def free(rng: np.random.Generator, k: int) -> tuple[list[dict], float, Sequence[dict]]:
    """Return four healthy segments."""
    return [{"name": "none", "healed": False, "faults": []} for _ in SEGMENTS], FREE_S, HANDS


def drawn(
    families: Mapping[str, Family], family: str, k: int, seed: int, off: Mapping[str, Sequence[str]],
    sensors: Callable[[np.random.Generator], dict] = lambda rng: {},
) -> tuple[dict, list[dict], np.random.Generator]:  # fmt: skip
    """Return (scenario of flight `k` of a family, its segments, rng); `seed` decides all, `off` {group: names} may be
    off, `sensors` draws their settings. The order of `families` is part of the seed.
    """
    rng = np.random.default_rng([seed, list(families).index(family), k])
    lanes, duration, hands = families[family](rng, k)
    lanes = [lanes[i] for i in rng.permutation(4)]
    manoeuvre = {**hands[int(rng.integers(len(hands)))]}
    if manoeuvre["kind"] != "cruise":
        manoeuvre["start_s"] = float(rng.uniform(ONSET - 2.0, ONSET + 4.0) if family != "free" else rng.uniform(5, 30))
    tolerances = {g: {n: float(1 + EXACT.get(n, TOLERANCE) * rng.uniform(-1, 1)) for n in names}
                  for g, names in off.items()}  # fmt: skip
    faults = [{"target": f"elevator.{lane}" + (f".{fault['part']}" if "part" in fault else ""),
               **{key: v for key, v in fault.items() if key != "part"}}
              for lane, own in zip(SEGMENTS, lanes) for fault in own["faults"]]  # fmt: skip
    flight = {"title": family, "duration_s": duration, "manoeuvre": manoeuvre, "seed": seed + k, "faults": faults,
              "tolerances": tolerances, "sensors": {**sensors(rng), "noise_scale": NOISE_SCALE},
              "flight": {**envelope(rng), "turbulence": AIR[k % 3]}}  # fmt: skip
    return flight, lanes, rng


def flown(flight: dict, rng: np.random.Generator, signals: Sequence[str]) -> pd.DataFrame:
    """Fly it and return the `signals`; a point that does not trim is drawn anew."""
    while True:
        try:
            return fly(parse(flight), signals)
        except TrimError:
            flight["flight"] |= envelope(rng)


def named(code: float, culprit: float, culprits: Sequence[str]) -> str:
    """Return the name of a verdict, a sensor's with its culprit."""
    said = verdict.name(code)
    return f"{said} {culprits[int(culprit)]}" if code == verdict.SENSOR else said


def cried(logs: Mapping[str, np.ndarray]) -> dict[str, list]:
    """Return {detector: [names that it gave, seconds of alarm]} of logs (segments, ticks) of a healthy flight."""
    out = {}
    for name, log in logs.items():
        on, culprits = log["alarm"] > 0.5, registry.module(name).CULPRITS
        names = {named(c, w, culprits) for c, w in zip(log["verdict"][on], log["culprit"][on])}
        out[name] = [sorted(names), float(on.sum() * DT)]
    return out


def share(k: int, n: int) -> str | None:
    """Return "k/n = share (low to high)" with the exact 95 % interval, or None where there is no run."""
    found = proportion(k, n)
    return f"{k}/{n} = {found.value:.2f} ({found.low:.2f} to {found.high:.2f})" if n else None


def free_table(values: Sequence[tuple[str, dict]]) -> Table:
    """Return the table of flights without a fault from [(air, what `cried` says)]."""
    rows = []
    for name in values[0][1]:
        bad = [(air, own[name]) for air, own in values if own[name][0]]
        n, hours = len(values), len(values) * FREE_S / 3600.0
        most = float(beta.ppf(0.95, len(bad) + 1, n - len(bad)) * n / hours) if len(bad) < n else None
        told = "; ".join(f"{air}: {' '.join(said)} {s:.1f} s" for air, (said, s) in bad)
        rows.append([name, share(len(bad), n), most, told])
    return Table(f"{len(values)} flights of 60 s without a fault, four segments each",
                 ("detector", "flights with an alarm", "per hour at most>", "what"), rows)  # fmt: skip
