"""Two searches of a campaign's draws: the worst flight without a fault, the most probable in which a detector fails.

    found = search("fault-free", "rfafe", flights=300)          # found.scenario, found.r, found.false_alarms
    found = likeliest("fault-free", "lpv_smo", flights=200)     # a flight without a fault in which it cries
    found = likeliest("my-faults.toml", "rfafe")                # one with a fault that it misses

Every draw, every key of the grid and the seed are coordinates of the unit cube, in which differential evolution (scipy)
flies a generation in parallel; seeds belong neither to training nor to evaluation. `search` maximises the largest |r|
of any lane: random campaigns show what is likely, this what is possible; 300 flights in a space of dozens of
coordinates prove nothing when they find nothing.

That worst case lies in corners that no aircraft will visit. `likeliest` seeks a failure first; then what the failure
does not need is put back to its mean, half of the drawn numbers at a time, and the rest is brought nearer, as long as
it still fails. What remains away from its mean is why the detector fails, and how far says how improbable that is;
flights with other seeds say how much of it is the luck of noise and gusts:

    log P = - 1/2 sum z^2 + log(share of other seeds with which it fails)

z = (value - mean) / sigma of every normal draw; what is drawn evenly is all alike. This is repeated from other starts
while flights are left, and the failure with the largest log P is kept.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import differential_evolution

from cosim.campaign.draw import unit_cube
from cosim.campaign.flights import run_many
from cosim.campaign.pool import pool
from cosim.campaign.spec import Space, load_campaign, shipped
from cosim.campaign.worker import run_id
from cosim.errors import CampaignError
from cosim.files import marked, replace_text

SEARCH_SEED = 2_000_000
POPULATION = 20  # flights per generation: 14 generations in 300 flights
MOST_FLIGHTS = 300
WORST = marked(b"", b'title = "Worst case of')  # the sign of a scenario that was found


@dataclass(frozen=True)
class Found:
    """The worst flight: its scenario, largest |r| over the threshold, alarms; `flights` has every flight in order."""

    scenario: object
    r: float
    false_alarms: int
    flights: pd.DataFrame  # run, status, failed, r, false_alarms, log_likelihood
    file: Path | None

    def to_dict(self) -> dict:
        """Return plain data for JSON."""
        about = {"scenario": str(self.file) if self.file else None, "r": self.r, "false_alarms": self.false_alarms}
        return {**about, "flights": len(self.flights), "first_r": float(self.flights["r"].iloc[:POPULATION].max())}


def search(
    campaign: str | Path, detector: str, *, flights: int = MOST_FLIGHTS, workers: int | None = None,
    out: str | Path | None = None, seed: int = 1, progress: Callable[[int, int], None] | None = None,
) -> Found:  # fmt: skip
    """Search the fault-free space of a campaign for the flight in which `detector` comes nearest to an alarm.

    At most `flights` flights (>= 2 generations of POPULATION). `out` is the scenario file to write, None for none.
    `progress(done, total)` counts flights. Raises CampaignError for an unknown detector or a campaign with faults.
    """
    check(detector, flights, 2 * POPULATION, MOST_FLIGHTS)
    made = load_campaign(campaign)
    space = Space(made, first_seed=SEARCH_SEED, detectors=(detector,))
    if space.faults:
        raise CampaignError("has faults", place=made.name, remedy="Search a campaign of fault-free flights")
    generations = flights // POPULATION
    with pool(workers) as executor:
        fly = Flights(space, detector, executor, generations * POPULATION, progress)
        rng = np.random.default_rng(seed)
        evolve(lambda u: np.array([-row["r"] for row in fly.fly(u.T)]), space.size, generations, seed, rng)
    table = pd.DataFrame(fly.rows)
    worst = table.loc[table["r"].idxmax()]
    title = f"Worst case of {detector} without a fault: |r| reaches {worst['r']:.2f} of its threshold ({made.name})"
    scenario = space(fly.points[worst.name]).model_copy(update={"title": title})
    return Found(scenario, float(worst["r"]), int(worst["false_alarms"]), table, write(out, scenario, WORST))


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
    """Fly points of a space; `rows` has a dict per flight, `points` where it was, `best` the likeliest that failed."""

    def __init__(
        self, space: Space, detector: str, executor: Executor, most: int, progress: Callable[[int, int], None] | None,
    ):  # fmt: skip
        """Fly at most `most` points of `space` with `detector` alone, on the processes of `executor`."""
        self.space, self.detector, self.executor = space, detector, executor
        self.most, self.progress = most, progress
        self.rows: list[dict] = []
        self.points: list[np.ndarray] = []
        self.best: np.ndarray | None = None

    def fly(self, points: np.ndarray) -> list[dict]:
        """Return the rows of points (n, size): run, status, failed, r, false_alarms, log_likelihood."""
        scenarios = [self.space(u) for u in points]
        frame = run_many(scenarios, executor=self.executor, achieved=False).frame
        for u, run in zip(points, map(run_id, scenarios)):
            own = frame[frame["run"] == run]
            mine = own[(own["id"] == self.detector) & (own["status"] == "completed")]
            failed, r = self._judged(mine)
            told = {"run": run, "status": own["status"].iloc[0], "failed": failed, "r": r}
            told["false_alarms"] = int(mine["false_alarms"].sum())
            self.points.append(np.array(u))
            self.rows.append({**told, "log_likelihood": self.space.log_likelihood(u)})
        if self.progress:
            self.progress(min(len(self.rows), self.most), self.most)
        return self.rows[-len(points) :]

    def _judged(self, mine):
        """Return (failed, largest |r| where it counts) of the detector's lanes in one flight."""
        if self.space.faults:
            mine = mine[mine["concerned"].astype(bool)]
            if not len(mine):
                return False, 1.0
            r = mine["r_max_after"].max()
            missed = bool(mine["delay_s"].isna().all() and mine["able"].astype(bool).any())
            return missed, float(r) if np.isfinite(r) else 1.0
        return bool(mine["false_alarms"].sum() > 0), float(mine["r_max_before"].max()) if len(mine) else 0.0

    @property
    def left(self) -> int:
        """Return how many flights are left, those of the last check apart."""
        return self.most - AGAIN - len(self.rows)

    def seek(self, points: np.ndarray) -> np.ndarray:
        """Return the cost (n,) of points (n, size): minus log L of a failure, else NEVER and how far it is from one."""
        costs = []
        for u, row in zip(points, self.fly(points)):
            told = row["log_likelihood"]
            costs.append(-told if row["failed"] else NEVER + (row["r"] if self.space.faults else -row["r"]))
            if row["failed"] and (self.best is None or told > self.space.log_likelihood(self.best)):
                self.best = np.array(u)
        return np.array(costs)


def evolve(
    cost: Callable, size: int, generations: int, seed: int, rng: np.random.Generator, until: Callable | None = None
) -> None:
    """Minimise `cost` of points (size, n) of the unit cube by differential evolution, until(...) is true at most."""
    differential_evolution(
        cost, [(0.0, 1.0)] * size, init=unit_cube(POPULATION, size, sampling="latin_hypercube", seed=seed),
        maxiter=max(generations - 1, 0), tol=0.0, polish=False, vectorized=True, updating="deferred", seed=rng,
        callback=until,
    )  # fmt: skip


FIRST_SEED, SEEDS = 7_000_000, 20  # few seeds: what makes a flight fail is to be found, not a lucky one of thousands
TRIALS = 10  # flights per generation of putting back
AGAIN = 10  # flights of what was found, with other seeds
LEAST, MOST = 60, 1000  # flights
LIKELIEST = marked(b"", b'title = "Likeliest failure: ')  # the sign of a scenario that was found
NEVER = 1e3  # cost of a flight that does not fail, on top of how far it is from that


@dataclass(frozen=True)
class Failure:
    """One failure: a point of the space, what it needs, how often it comes with other seeds."""

    u: np.ndarray
    log_likelihood: float  # of the draws, over that of the likeliest flight
    first: float  # the same of the failure before anything was put back
    away: dict[str, float]  # draws away from their means, in sigma
    failed: int  # of `flown` flights with other seeds
    flown: int

    @property
    def log_p(self) -> float:
        """Return log P as above, with half a flight added to what failed: none of ten is not never."""
        return self.log_likelihood + float(np.log((self.failed + 0.5) / (self.flown + 1.0)))

    def to_dict(self) -> dict:
        """Return plain data for JSON."""
        kept = ("log_likelihood", "first", "away", "failed", "flown", "log_p")
        return {k: getattr(self, k) for k in kept}


@dataclass(frozen=True)
class Likeliest:
    """What was found; without `failures`, the likeliest first, no flight failed."""

    failure: str  # "cries" or "misses"
    failures: tuple[Failure, ...]
    scenario: object
    flights: pd.DataFrame  # as of `Found`
    file: Path | None

    def to_dict(self) -> dict:
        """Return plain data for JSON."""
        return {
            "scenario": str(self.file) if self.file else None,
            "failure": self.failure,
            "failures": [f.to_dict() for f in self.failures],
            "flights": len(self.flights),
            "nearest": float(self.flights["r"].min() if self.failure == "misses" else self.flights["r"].max()),
        }


def likeliest(
    campaign: str | Path, detector: str, *, flights: int = 200, part: str = "", workers: int | None = None,
    out: str | Path | None = None, seed: int = 1, progress: Callable[[int, int], None] | None = None,
) -> Likeliest:  # fmt: skip
    """Search a campaign, or its part `part`, for the likeliest flight in which `detector` fails.

    It fails in a flight without a fault when it alarms, in one with a fault when it was able to judge and did not
    notice. At most `flights` flights; `out` is the scenario file to write. Raises CampaignError.
    """
    check(detector, flights, LEAST, MOST)
    space = Space(load_campaign(campaign), first_seed=FIRST_SEED, seeds=SEEDS, detectors=(detector,), part=part)
    rng = np.random.default_rng(seed)
    found: list[Failure] = []
    with pool(workers) as executor:
        fly = Flights(space, detector, executor, flights, progress)
        while fly.left >= 2 * POPULATION:
            fly.best = None  # begin again, towards the threshold, until a generation has a failure
            evolve(lambda u: fly.seek(u.T), space.size, fly.left // POPULATION, int(rng.integers(2**31)), rng,
                   lambda *_, **__: fly.best is not None)  # fmt: skip
            if fly.best is not None:
                first = space.log_likelihood(fly.best)
                put_back(fly, rng)
                found.append(_failure(fly, first))
    found.sort(key=lambda f: -f.log_p)
    word = "misses" if space.faults else "cries"
    table = pd.DataFrame(fly.rows)
    if not found:
        return Likeliest(word, (), None, table, None)
    about = "a fault that" if space.faults else "a flight without a fault in which"
    title = f"Likeliest failure: {about} {detector} {word}, log P = {found[0].log_p:.1f} ({space.campaign.name})"
    scenario = space(found[0].u).model_copy(update={"title": title})
    return Likeliest(word, tuple(found), scenario, table, write(out, scenario, LIKELIEST))


def put_back(fly: Flights, rng: np.random.Generator) -> None:
    """Put normal draws back to their means, or nearer, as long as the flight still fails."""
    share = 1.0  # of the draws that are put back at once
    while fly.left >= TRIALS and fly.best is not None:
        start = fly.best
        away = [i for i in fly.space.normal if abs(fly.space.sigmas(start)[i]) > 0.05]
        if not away:
            return
        trials = []
        for i in range(TRIALS):
            chosen = rng.random(len(away)) < share
            chosen[rng.integers(len(away))] = True
            nearer = 0.0 if i % 2 == 0 else rng.uniform(0.3, 0.9)
            trials.append(fly.space.nearer(start, np.array(away)[chosen].tolist(), nearer))
        fly.seek(np.array(trials))
        share = min(1.0, 1.4 * share) if fly.best is not start else 0.5 * share
        if share < 0.5 / len(away):
            return


def _failure(fly, first):
    """Return the Failure of the best point, flown again with seeds that were not searched."""
    best, seeds = fly.best, fly.space.seeds
    fly.space.seeds = seeds * 50
    flown = fly.fly(np.array([np.append(best[:-1], (seeds * (i + 2) + 0.5) / fly.space.seeds) for i in range(AGAIN)]))
    fly.space.seeds = seeds
    told = fly.space.log_likelihood(best)
    return Failure(best, told, first, fly.space.away(best), sum(row["failed"] for row in flown), len(flown))
