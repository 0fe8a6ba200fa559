"""Worst-case search: a global optimiser tries to make a detector alarm without a fault, and writes down what it finds.

    found = search("fault-free", "rfafe", flights=300)      # found.scenario, found.r, found.false_alarms

The space is that of a campaign file without faults: every draw, every key of its grid and the seed are coordinates of
the unit cube. Differential evolution (scipy) maximises the largest |r| of any lane of the detector over the whole
flight; a generation is flown in parallel. Random campaigns show what is likely, this shows what is possible; 300
flights in a space of dozens of coordinates prove nothing when they find nothing.

Seeds start at SEARCH_SEED: what is found here belongs neither to training nor to evaluation.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import differential_evolution

from cosim.campaign.draw import unit_cube
from cosim.campaign.flights import run_many
from cosim.campaign.pool import pool
from cosim.campaign.spec import load_campaign
from cosim.campaign.unit_cube import Space
from cosim.campaign.worker import run_id
from cosim.errors import CampaignError, did_you_mean
from cosim.files import marked, replace_text
from fdi.registry import SHIPPED

SEARCH_SEED, SEEDS = 2_000_000, 100_000
POPULATION = 20  # flights per generation: 14 generations in 300 flights
MOST_FLIGHTS = 300


@dataclass(frozen=True)
class Found:
    """The worst flight: its scenario, largest |r| over the threshold, alarms; `flights` has every flight in order."""

    scenario: object
    r: float
    false_alarms: int
    flights: pd.DataFrame  # run, r, false_alarms, status
    file: Path | None

    def to_dict(self) -> dict:
        """Return plain data for JSON."""
        about = {"scenario": str(self.file) if self.file else None, "r": self.r, "false_alarms": self.false_alarms}
        return {**about, "flights": len(self.flights), "first_r": float(self.flights["r"].iloc[:POPULATION].max())}


def search(
    campaign: str | Path,
    detector: str,
    *,
    flights: int = MOST_FLIGHTS,
    workers: int | None = None,
    out: str | Path | None = None,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Found:
    """Search the fault-free space of a campaign for the flight in which `detector` comes nearest to an alarm.

    At most `flights` flights (>= 2 generations of POPULATION). `out` is the scenario file to write, None for none.
    `progress(done, total)` counts flights. Raises CampaignError for an unknown detector or a campaign with faults.
    """
    if detector not in SHIPPED:
        near = did_you_mean(detector, SHIPPED)
        raise CampaignError(f"{detector!r} is no detector", allowed=", ".join(SHIPPED), remedy=near)
    if not 2 * POPULATION <= flights <= MOST_FLIGHTS:
        raise CampaignError(f"{flights} flights", place="search", allowed=f"{2 * POPULATION} to {MOST_FLIGHTS}")
    made = load_campaign(campaign)
    space = Space(made, first_seed=SEARCH_SEED, seeds=SEEDS, detectors=(detector,))
    if space.faults:
        raise CampaignError("has faults", place=made.name, remedy="Search a campaign of fault-free flights")
    generations = flights // POPULATION
    with pool(workers) as executor:
        evaluate = _Evaluate(space, detector, executor, progress, generations * POPULATION)
        differential_evolution(
            evaluate,
            [(0.0, 1.0)] * space.size,
            init=unit_cube(POPULATION, space.size, sampling="latin_hypercube", seed=seed),
            maxiter=generations - 1,
            tol=0.0,
            polish=False,
            vectorized=True,
            updating="deferred",
            seed=np.random.default_rng(seed),
        )
    table = pd.DataFrame(evaluate.rows)
    worst = table.loc[table["r"].idxmax()]
    scenario = evaluate.scenarios[worst["run"]]
    title = f"Worst case of {detector} without a fault: |r| reaches {worst['r']:.2f} of its threshold ({made.name})"
    scenario = scenario.model_copy(update={"title": title})
    return Found(scenario, float(worst["r"]), int(worst["false_alarms"]), table, _write(out, scenario))


class _Evaluate:
    """Fly a generation and return minus the largest |r| of each flight; a flight without a result counts 0."""

    def __init__(self, space, detector, executor, progress, total):
        self.space, self.detector, self.executor = space, detector, executor
        self.progress, self.total = progress, total
        self.rows, self.scenarios = [], {}

    def __call__(self, points):
        scenarios = [self.space(u) for u in points.T]
        ids = [run_id(s) for s in scenarios]
        self.scenarios |= dict(zip(ids, scenarios))
        frame = run_many(scenarios, executor=self.executor, achieved=False).frame
        mine = frame[(frame["id"] == self.detector) & (frame["status"] == "completed")].groupby("run")
        r, alarms = mine["r_max_before"].max(), mine["false_alarms"].sum()
        status = frame.drop_duplicates("run").set_index("run")["status"]
        for run in ids:
            about = {"run": run, "status": status[run]}
            self.rows.append({**about, "r": float(r.get(run, 0.0)), "false_alarms": int(alarms.get(run, 0))})
        if self.progress:
            self.progress(len(self.rows), self.total)
        return np.array([-float(r.get(run, 0.0)) for run in ids])


FOUND = marked(b"", b'title = "Worst case of')  # the sign of a scenario that was found


def _write(out, scenario):
    if out is None:
        return None
    replace_text(out, scenario.expanded_toml(), FOUND)
    return Path(out)
