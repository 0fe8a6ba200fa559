"""Fault-free noise of the two Sun13 estimators: predicted from the sensors, own and through the loop, and flown."""

import numpy as np

from cosim.papers.studies.aircraft_level.table import Table
from cosim.training import rfafe_noise
from cosim.training.rfafe import DEG
from cosim.training.rfafe_flights import estimate, record
from fdi.rfafe.store import read

SEEDS = (1, 2, 3, 4, 5)
SECONDS, SETTLED = 40.0, 3.0


def run(*, seeds=SEEDS, **_):
    """Return the tables: standard deviations, and which sensor they come from."""
    parts = rfafe_noise.predicted()
    rows = []
    flown = [record(duration=SECONDS, seed=s) for s in seeds]
    for name, field in rfafe_noise.FIELD.items():
        own = read(name)["designs"]["hydraulic"]["noise_deg"][0]
        loop = rfafe_noise.total(parts[name])
        got = [float(np.std(estimate(r, name)[field][r.t > SETTLED]) / DEG) for r in flown]
        rows.append((name, own, loop, min(got), max(got), max(got) / own, max(got) / loop))
    head = ("estimator", "own sensors [deg]", "through the loop [deg]", "flown, least", "flown, most", "most / own",
            "most / loop")  # fmt: skip
    note = "at most 1.2 times the prediction is wanted; friction is in the flights, not in the prediction"
    first = Table(f"fault-free in still air, {len(seeds)} flights of {SECONDS:g} s: standard deviation of f_hat", head,
                  rows, (note,))  # fmt: skip
    sensors = sorted(parts["rfafe"], key=lambda s: -max(p[s] for p in parts.values()))
    shares = [(s, *(parts[n][s] for n in parts)) for s in sensors if max(p[s] for p in parts.values()) > 1e-3]
    return [first, Table("by sensor [deg]", ("sensor", *parts), shares)]
