"""What `cosim campaign` shows: a line per detector, from the same rows that the Parquet file holds; without faults, how
near each detector came to an alarm.
"""

import pandas as pd
from rich.console import Group
from rich.text import Text

from cosim.campaign.engine import CampaignResult
from cosim.campaign.worker import FAILED
from cosim.cli.tables import whole, word
from cosim.compare import compare
from cosim.compare.tables import detectors
from cosim.table import Table

TEXTS = 5  # different errors that are printed


def campaign(result: CampaignResult) -> Group:
    """Return the table of a campaign's outcome."""
    frame = result.frame
    lanes = frame[frame["id"].notna()]
    status = frame.drop_duplicates("run")["status"].value_counts()
    line = ", ".join(f"{n} {name}" for name, n in status.items())
    text = f"{result.done} runs: {line}" + (f"; {result.resumed} were there already" if result.resumed else "")
    more = [] if lanes["concerned"].any() or lanes.empty else [nearest(lanes)]
    shown = [] if lanes.empty or result.parquet is None else [detectors(compare([result.parquet.parent]).detectors)]
    at = None if lanes.empty else result.parquet
    follows = [whole(f"next   cosim compare {word(at.parent)}")] if at else []
    return Group(*shown, *more, Text(text), *_told(errors(frame)), Text(f"rows   {result.parquet}"), *follows)


def errors(frame: pd.DataFrame) -> list[dict]:
    """Return [{status, error, runs}] of the runs without a flight, the most frequent first."""
    runs = frame.drop_duplicates("run")
    counts = runs[runs["status"].isin(FAILED)].groupby(["status", "error"], sort=True).size()
    counts = counts.sort_values(ascending=False, kind="stable")
    return [{"status": status, "error": text, "runs": int(n)} for (status, text), n in counts.items()]


def _told(found):
    lines = [Text(f"{r['runs']} x {r['status']}: {r['error']}", style="red") for r in found[:TEXTS]]
    if more := sum(r["runs"] for r in found[TEXTS:]):
        lines.append(Text(f"{more} more with {len(found) - TEXTS} other texts: column error of the rows", style="red"))
    return lines


def exit_status(frame: pd.DataFrame) -> int:
    """Return 1 when a run ended in an error, or none flew; a point without a steady flight among others is a result."""
    found = errors(frame)
    none_flew = sum(r["runs"] for r in found) == frame["run"].nunique()
    return int(none_flew or any(r["status"] != "infeasible" for r in found))


MOST = 5


def nearest(lanes: pd.DataFrame) -> Table:
    """Return the table of the MOST largest |r| over its threshold of each detector, one per flight, and where it was.

    A statistic beyond its threshold is an alarm only after its confirmation.
    """
    t = Table(f"the {MOST} flights in which each came nearest to an alarm: largest |r|, 1 is the threshold", "detector",
              *(f"{i + 1}>" for i in range(MOST)), "the first: seed, manoeuvre, turbulence")
    t.caption = "beyond 1 without an alarm: not for the confirmation time"
    for (_, name), rows in lanes.groupby(["level", "id"], sort=True):
        by_run = rows.sort_values("r_max_before", ascending=False).drop_duplicates("run").head(MOST)
        first = by_run.iloc[0]
        where = [str(first[k]) for k in ("seed", "manoeuvre.kind", "flight.turbulence", "target") if k in by_run]
        t.add(name, *by_run["r_max_before"], *[None] * (MOST - len(by_run)), " ".join(where))
    return t
