"""What `cosim campaign` shows: a line per detector, from the same rows that the Parquet file holds."""

from rich.console import Group
from rich.text import Text

from cosim.cli_tables import number, table
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
    return Group(t, Text(text), Text(f"rows   {result.parquet}"))
