"""What `cosim campaign` shows: a line per detector, from the same rows that the Parquet file holds; without faults, how
near each detector came to an alarm.
"""

from rich.console import Group
from rich.text import Text

from cosim.cli.tables import number, table
from cosim.metrics import clopper_pearson


def campaign(result):
    """Return the table of a campaign's outcome."""
    frame = result.frame
    lanes = frame[frame["id"].notna()]
    t = table(
        "", "detector", "level", "faults>", "detected>", "median delay s>", "periods>", "false flights>", "95 % bound>"
    )
    for (level, name), rows in lanes.groupby(["level", "id"], sort=True):
        mine = rows[rows["concerned"].astype(bool)]
        false = rows.groupby("run")["false_alarms"].max() > 0
        bound = clopper_pearson(int(false.sum()), len(false)).high
        found = mine["delay_s"].dropna()
        median = [
            None if column.dropna().empty else column.median() for column in (mine["delay_s"], mine["delay_periods"])
        ]
        t.add_row(
            name, level, str(len(mine)), str(len(found)), number(median[0]), number(median[1]),
            f"{int(false.sum())}/{len(false)}", f"{100 * bound:.1f} %",
        )  # fmt: skip
    t.caption, t.caption_justify = "false flights: with a false alarm; bound: Clopper-Pearson, per flight", "left"
    status = frame.drop_duplicates("run")["status"].value_counts()
    line = ", ".join(f"{n} {name}" for name, n in status.items())
    text = f"{result.done} runs: {line}" + (f"; {result.resumed} were there already" if result.resumed else "")
    more = [] if lanes["concerned"].any() or lanes.empty else [nearest(lanes)]
    return Group(t, *more, Text(text), Text(f"rows   {result.parquet}"))


MOST = 5


def nearest(lanes):
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
