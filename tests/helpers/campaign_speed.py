"""How much faster several processes fly a campaign than one, and whether they find the same:

    python tests/helpers/campaign_speed.py fault-free

It flies the campaign twice without keeping logs, first on every core, then on one. The start of the processes counts.
On a quiet machine only: anything else that works there falsifies the ratio.
"""

import json
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import pandas as pd

from cosim.campaign.flights import run_many
from cosim.campaign.pool import cores
from cosim.campaign.spec import load_campaign


def measure(
    scenarios: Sequence[Any], workers: int | None, progress: Callable[..., Any] | None = None
) -> dict[str, Any]:
    """Fly `scenarios` in `workers` processes; return {workers, flights, wall_s, flown_s, outcomes, rows}."""
    begin = time.perf_counter()
    done = run_many(scenarios, workers=workers, progress=progress)
    wall = time.perf_counter() - begin
    runs = done.frame.drop_duplicates("run")
    outcomes = {str(k): int(n) for k, n in runs["status"].value_counts().items()}
    flown = float(runs["sim_time_s"].fillna(0.0).sum())
    return {"workers": workers, "flights": len(runs), "wall_s": wall, "flown_s": flown, "outcomes": outcomes,
            "rows": done.frame}  # fmt: skip


def same(a: Any, b: Any) -> bool:
    """Tell whether two frames of rows are equal, bit for bit."""
    try:
        pd.testing.assert_frame_equal(a, b, check_exact=True)
    except AssertionError:
        return False
    return True


def compare(
    campaign: str, *, workers: int | None = None, every: int = 1, progress: Callable[..., Any] | None = None
) -> dict:
    """Fly every `every`th flight of a campaign on `workers` processes (default: one per core), then on one.

    Returns {"campaign", "cases" (two of `measure` without their rows), "ratio", "equal", "crashed"}.
    """
    scenarios = load_campaign(campaign).scenarios()[0][::every]
    cases = [measure(scenarios, n, progress) for n in (workers or cores(), 1)]
    several, one = (case.pop("rows") for case in cases)
    return {
        "campaign": campaign,
        "cases": cases,
        "ratio": cases[1]["wall_s"] / cases[0]["wall_s"],
        "equal": same(several, one),
        "crashed": sum(case["outcomes"].get(k, 0) for case in cases for k in ("crashed", "error")),
    }


if __name__ == "__main__":
    print(json.dumps(compare(sys.argv[1])))
