"""What `cosim campaign` shows: a line per detector, from the same rows that the Parquet file holds; without faults, how
near each detector came to an alarm.
"""

import math

import pandas as pd
from rich.console import Group
from rich.table import Table as RichTable
from rich.text import Text

from cosim.campaign import CampaignResult
from cosim.cli.tables import number, table
from cosim.compare.metrics import delays, proportion

FAILED = ("infeasible", "error", "crashed")
TEXTS = 5  # different errors that are printed


def campaign(result: CampaignResult) -> Group:
    """Return the table of a campaign's outcome."""
    frame = result.frame
    lanes = frame[frame["id"].notna()]
    t = table(
        "", "detector", "level", "faults>", "detected>", "median delay s>", "periods>", "false flights>", "95 % bound>"
    )
    for (level, name), rows in lanes.groupby(["level", "id"], sort=True):
        mine = rows[rows["concerned"].astype(bool)]
        false = rows.groupby("run")["false_alarms"].max() > 0
        bound = proportion(int(false.sum()), len(false)).high
        found = mine["delay_s"].dropna()
        median = [_median(mine[key]) for key in ("delay_s", "delay_periods")]
        t.add_row(
            name, level, str(len(mine)), str(len(found)), number(median[0]), number(median[1]),
            f"{int(false.sum())}/{len(false)}", f"{100 * bound:.1f} %",
        )  # fmt: skip
    t.caption_justify = "left"
    t.caption = (
        "faults: that concern the detector, per actuator it watches, also those it is not made for (`cosim compare` "
        "counts those it is, once per flight); median delay: a missed fault is endless, - where half are missed; "
        "false flights: with a false alarm; bound: Clopper-Pearson, per flight"
    )
    status = frame.drop_duplicates("run")["status"].value_counts()
    line = ", ".join(f"{n} {name}" for name, n in status.items())
    text = f"{result.done} runs: {line}" + (f"; {result.resumed} were there already" if result.resumed else "")
    more = [] if lanes["concerned"].any() or lanes.empty else [nearest(lanes)]
    shown = [] if lanes.empty else [t]
    return Group(*shown, *more, Text(text), *_told(errors(frame)), Text(f"rows   {result.parquet}"))


def _median(late):
    """Return the median of delays of which a missed one (NaN) is endless; None when that is the median, or no fault."""
    found = delays(late.to_numpy()).median if len(late) else math.inf
    return found if math.isfinite(found) else None


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


def nearest(lanes: pd.DataFrame) -> RichTable:
    """Return the table of the MOST largest |r| over its threshold of each detector, one per flight, and where it was.

    A statistic beyond its threshold is an alarm only after its confirmation.
    """
    t = table(f"the {MOST} flights in which each came nearest to an alarm: largest |r|, 1 is the threshold", "detector",
              *(f"{i + 1}>" for i in range(MOST)), "the first: seed, manoeuvre, turbulence")
    t.caption, t.caption_justify = "beyond 1 without an alarm: not for the confirmation time", "left"
    for (_, name), rows in lanes.groupby(["level", "id"], sort=True):
        by_run = rows.sort_values("r_max_before", ascending=False).drop_duplicates("run").head(MOST)
        first = by_run.iloc[0]
        where = [str(first[k]) for k in ("seed", "manoeuvre.kind", "flight.turbulence", "target") if k in by_run]
        most = [number(None if v != v else v) for v in by_run["r_max_before"]]
        t.add_row(name, *most, *[number(None)] * (MOST - len(most)), " ".join(where))
    return t
