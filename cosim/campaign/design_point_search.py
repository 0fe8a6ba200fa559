"""Design-point search: the most probable flight of a campaign's draws in which a detector fails.

    found = likeliest("fault-free", "lpv_smo", flights=200)     # a flight without a fault in which it cries
    found = likeliest("my-faults.toml", "rfafe")                # one with a fault that it misses

The worst case (cosim/campaign/search.py) lies in corners that no aircraft will visit. Here a failure is sought first,
by differential evolution towards the threshold; then what the failure does not need is put back to its mean, half of
the drawn numbers at a time, and the rest is brought nearer, as long as it still fails. What remains away from its mean
is why the detector fails, and how far says how improbable that is; flights with other seeds say how much of it is the
luck of noise and gusts:

    log P = - 1/2 sum z^2 + log(share of other seeds with which it fails)

z = (value - mean) / sigma of every normal draw; what is drawn evenly is all alike. This is repeated from other starts
while flights are left, and the failure with the largest log P is kept.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from cosim.campaign.pool import pool
from cosim.campaign.search import POPULATION, Flights, check, evolve, write
from cosim.campaign.spec import load_campaign
from cosim.campaign.unit_cube import Space
from cosim.files import marked

FIRST_SEED, SEEDS = 7_000_000, 20  # few seeds: what makes a flight fail is to be found, not a lucky one of thousands
TRIALS = 10  # flights per generation of putting back
AGAIN = 10  # flights of what was found, with other seeds
LEAST, MOST = 60, 1000  # flights
FOUND = marked(b"", b'title = "Likeliest failure: ')  # the sign of a scenario that was found
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
    flights: pd.DataFrame  # run, status, failed, r, log_likelihood
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
    campaign: str | Path,
    detector: str,
    *,
    flights: int = 200,
    part: str = "",
    workers: int | None = None,
    out: str | Path | None = None,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Likeliest:
    """Search a campaign, or its part `part`, for the likeliest flight in which `detector` fails.

    It fails in a flight without a fault when it alarms, in one with a fault when it was able to judge and did not
    notice. At most `flights` flights; `out` is the scenario file to write. Raises CampaignError.
    """
    check(detector, flights, LEAST, MOST)
    space = Space(load_campaign(campaign), first_seed=FIRST_SEED, seeds=SEEDS, detectors=(detector,), part=part)
    rng, found = np.random.default_rng(seed), []
    with pool(workers) as executor:
        fly = Failures(space, detector, executor, flights, progress)
        while fly.left >= 2 * POPULATION:
            fly.forget()
            seek(fly, rng)
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
    return Likeliest(word, tuple(found), scenario, table, write(out, scenario, FOUND))


class Failures(Flights):
    """Fly points of a space, and remember the likeliest that failed."""

    best: np.ndarray | None = None
    _cost = NEVER

    def forget(self) -> None:
        """Begin again: no failure is known."""
        self.best, self._cost = None, NEVER

    @property
    def left(self) -> int:
        """Return how many flights are left, those of the last check apart."""
        return self.most - AGAIN - len(self.rows)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Return the cost (n,) of points (n, size): minus log L of a failure, else NEVER and how far it is from one."""
        costs = []
        for row, mine in self.fly(points):
            u = self.points[-1]
            failed, r = self._judged(mine)
            told = self.space.log_likelihood(u)
            row |= {"failed": failed, "r": r, "log_likelihood": told}
            costs.append(-told if failed else NEVER + (r if self.space.faults else -r))
            if failed and -told < self._cost:
                self.best, self._cost = u, -told
        return np.array(costs)

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


def seek(fly: Failures, rng: np.random.Generator) -> None:
    """Go towards the threshold by differential evolution until a generation has a failure."""
    seed, found = int(rng.integers(2**31)), lambda *_, **__: fly.best is not None
    evolve(lambda points: fly(points.T), fly.space.size, fly.left // POPULATION, seed, rng, found)


def put_back(fly: Failures, rng: np.random.Generator) -> None:
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
        fly(np.array(trials))
        share = min(1.0, 1.4 * share) if fly.best is not start else 0.5 * share
        if share < 0.5 / len(away):
            return


def _failure(fly, first):
    """Return the Failure of the best point, flown again with seeds that were not searched."""
    best, many, seeds = fly.best, len(fly.rows), fly.space.seeds
    fly.space.seeds = seeds * 50
    fly(np.array([np.append(best[:-1], (seeds * (i + 2) + 0.5) / fly.space.seeds) for i in range(AGAIN)]))
    fly.space.seeds = seeds
    flown = fly.rows[many:]
    told = fly.space.log_likelihood(best)
    return Failure(best, told, first, fly.space.away(best), sum(row["failed"] for row in flown), len(flown))
