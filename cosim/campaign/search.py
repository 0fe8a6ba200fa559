"""Worst-case search: a global optimiser tries to make a detector alarm without a fault, and writes down what it finds.

    found = search("fault-free", "rfafe", flights=300)      # found.scenario, found.r, found.false_alarms

The space is that of a campaign file without faults: every draw, every key of its grid and the seed are coordinates of
the unit cube. Differential evolution (scipy) maximises the largest |r| of any lane of the detector over the whole
flight; a generation is flown in parallel. Random campaigns show what is likely, this shows what is possible; 300
flights in a space of dozens of coordinates prove nothing when they find nothing.

Seeds start at SEARCH_SEED: what is found here belongs neither to training nor to evaluation.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import differential_evolution

from cosim.campaign.draw import unit_cube
from cosim.campaign.flights import run_many
from cosim.campaign.pool import pool
from cosim.campaign.spec import load_campaign
from cosim.campaign.unit_cube import Space, shipped
from cosim.campaign.worker import run_id
from cosim.errors import CampaignError
from cosim.files import marked, replace_text

SEARCH_SEED, SEEDS = 2_000_000, 100_000
POPULATION = 20  # flights per generation: 14 generations in 300 flights
MOST_FLIGHTS = 300
FOUND = marked(b"", b'title = "Worst case of')  # the sign of a scenario that was found


@dataclass(frozen=True)
class Found:
    """The worst flight: its scenario, largest |r| over the threshold, alarms; `flights` has every flight in order."""

    scenario: object
    r: float
    false_alarms: int
    flights: pd.DataFrame  # run, status, r, false_alarms
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
    check(detector, flights, 2 * POPULATION, MOST_FLIGHTS)
    made = load_campaign(campaign)
    space = Space(made, first_seed=SEARCH_SEED, seeds=SEEDS, detectors=(detector,))
    if space.faults:
        raise CampaignError("has faults", place=made.name, remedy="Search a campaign of fault-free flights")
    generations = flights // POPULATION
    with pool(workers) as executor:
        fly = Flights(space, detector, executor, generations * POPULATION, progress)
        evolve(lambda points: _alarm(fly, points), space.size, generations, seed, np.random.default_rng(seed))
    table = pd.DataFrame(fly.rows)
    worst = table.loc[table["r"].idxmax()]
    title = f"Worst case of {detector} without a fault: |r| reaches {worst['r']:.2f} of its threshold ({made.name})"
    scenario = space(fly.points[worst.name]).model_copy(update={"title": title})
    file = write(out, scenario, FOUND)
    return Found(scenario, float(worst["r"]), int(worst["false_alarms"]), table, file)


def check(detector: str, flights: int, least: int, most: int) -> None:
    """Raise CampaignError for a detector that does not ship, or a number of flights that no search takes."""
    shipped(detector)
    if not least <= flights <= most:
        raise CampaignError(f"{flights} flights", place="search", allowed=f"{least} to {most}")


def write(out: str | Path | None, scenario: object, sign: Callable) -> Path | None:
    """Write a scenario that was found to `out`, known by its `sign`; return the Path, None for none."""
    if out is None:
        return None
    replace_text(out, scenario.expanded_toml(), sign)  # type: ignore[attr-defined]
    return Path(out)


class Flights:
    """Fly points of a space; `rows` has a dict per flight, `points` where it was."""

    def __init__(
        self,
        space: Space,
        detector: str,
        executor: Executor,
        most: int,
        progress: Callable[[int, int], None] | None,
    ):
        """Fly at most `most` points of `space` with `detector` alone, on the processes of `executor`."""
        self.space, self.detector, self.executor = space, detector, executor
        self.most, self.progress = most, progress
        self.rows: list[dict] = []
        self.points: list[np.ndarray] = []

    def fly(self, points: np.ndarray) -> Iterator[tuple[dict, pd.DataFrame]]:
        """Yield (row, the detector's lanes where the flight was completed) of each of points (n, size)."""
        scenarios = [self.space(u) for u in points]
        frame = run_many(scenarios, executor=self.executor, achieved=False).frame
        for u, run in zip(points, map(run_id, scenarios)):
            own = frame[frame["run"] == run]
            self.points.append(np.array(u))
            self.rows.append({"run": run, "status": own["status"].iloc[0]})
            yield self.rows[-1], own[(own["id"] == self.detector) & (own["status"] == "completed")]
        if self.progress:
            self.progress(min(len(self.rows), self.most), self.most)


def evolve(
    cost: Callable, size: int, generations: int, seed: int, rng: np.random.Generator, until: Callable | None = None
) -> None:
    """Minimise `cost` of points (size, n) of the unit cube by differential evolution, until(...) is true at most."""
    differential_evolution(
        cost,
        [(0.0, 1.0)] * size,
        init=unit_cube(POPULATION, size, sampling="latin_hypercube", seed=seed),
        maxiter=max(generations - 1, 0),
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
        seed=rng,
        callback=until,
    )


def _alarm(fly, points):
    """Return minus the largest |r| of each flight; one without a result counts 0."""
    costs = []
    for row, mine in fly.fly(points.T):
        row["r"] = float(mine["r_max_before"].max()) if len(mine) else 0.0
        row["false_alarms"] = int(mine["false_alarms"].sum())
        costs.append(-row["r"])
    return np.array(costs)
