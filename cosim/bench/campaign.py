"""How much faster several processes fly a campaign than one, and whether they find the same:

    python -m cosim.bench.campaign fault-free

It flies the campaign twice without keeping logs, first on every core (or --workers), then on one, and prints time,
flights by outcome, the ratio, and whether every row is the same. The start of the processes counts. On a quiet machine
only: anything else that works there falsifies the ratio. Exit status 1 when a flight crashed or a row differs.
"""

import argparse
import sys
import time

import pandas as pd

from cosim.campaign import run_many
from cosim.campaign.pool import cores
from cosim.campaign.spec import load_campaign


def measure(scenarios, workers, progress=None):
    """Fly `scenarios` in `workers` processes; return {workers, flights, wall_s, flown_s, outcomes, rows}."""
    begin = time.perf_counter()
    done = run_many(scenarios, workers=workers, progress=progress)
    wall = time.perf_counter() - begin
    runs = done.frame.drop_duplicates("run")
    outcomes = {str(k): int(n) for k, n in runs["status"].value_counts().items()}
    flown = float(runs["sim_time_s"].fillna(0.0).sum())
    return {"workers": workers, "flights": len(runs), "wall_s": wall, "flown_s": flown, "outcomes": outcomes,
            "rows": done.frame}  # fmt: skip


def same(a, b):
    """Tell whether two frames of rows are equal, bit for bit."""
    try:
        pd.testing.assert_frame_equal(a, b, check_exact=True)
    except AssertionError:
        return False
    return True


def main(argv=None):
    """Measure the campaign that the command line names; return the exit status."""
    from rich.console import Console

    from cosim.cli.tables import progress, table

    asked = argparse.ArgumentParser(prog="python -m cosim.bench.campaign", description=__doc__.split("\n\n")[0])
    asked.add_argument("campaign", nargs="?", default="fault-free", help="built-in name or file (fault-free)")
    asked.add_argument("--workers", type=int, default=cores(), help=f"processes (default {cores()})")
    asked.add_argument("--every", type=int, default=1, metavar="N", help="every Nth flight only")
    options = asked.parse_args(argv)
    if options.every < 1 or options.workers < 2:
        asked.error("--every from 1, --workers from 2")
    out, err = Console(), Console(stderr=True)
    scenarios = load_campaign(options.campaign).scenarios()[0][:: options.every]
    cases = []
    for n in (options.workers, 1):
        with progress(err, f"{n} at a time", "flights", "preparing the workers") as bar:
            cases.append(measure(scenarios, n, bar))
    several, one = cases
    equal = same(several["rows"], one["rows"])
    crashed = sum(case["outcomes"].get(k, 0) for case in cases for k in ("crashed", "error"))
    shown = table(options.campaign, "processes", "flights>", "wall s>", "flights/min>", "x real time>", "outcomes")
    for case in cases:
        shown.add_row(
            str(case["workers"]), str(case["flights"]), f"{case['wall_s']:.1f}",
            f"{60 * case['flights'] / case['wall_s']:.0f}", f"{case['flown_s'] / case['wall_s']:.0f}",
            ", ".join(f"{n} {name}" for name, n in case["outcomes"].items()),
        )  # fmt: skip
    out.print(shown)
    ratio = one["wall_s"] / several["wall_s"]
    said = "rows equal" if equal else "rows [red]differ[/]"
    out.print(f"{ratio:.2f} times as fast as one process; {said}; {crashed} crashed")
    return 0 if equal and not crashed else 1


if __name__ == "__main__":
    sys.exit(main())
