"""What `joint` made of its campaign, as the table of its page: python -m cosim.report.joint_page logs/joint

A row for each kind of fault, apart those of which no rate was counted and those of pairs: faults, those seen by any
other detector and by the verdict, those where it came after the second of them, and its places as in
`cosim.compare.stats.place_word`. Below it how many flights have a false alarm, of the verdict and of any detector that
it reads, and its own per valid hour.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from cosim.compare import read
from cosim.compare import rows as compare_rows
from cosim.compare.metrics import rate
from cosim.compare.stats import place_word
from cosim.report import markdown
from cosim.table import Row, Table
from cosim.training.train_joint import NOT_LEARNED
from fdi import joint as room
from fdi.joint.places import AIRCRAFT, LOCAL

PAGE = Path(room.__file__).with_name("README.md")
COUNTS = ("faults", "seen", "joint", "late", "right", "coarse", "open", "wrong")
HEAD = ("faults", "n", "seen by any", "alarmed", "after the second", "place right", "coarser", "not given", "wrong")
TICK_S = 0.006  # `joint` hears an alarm in the same tick or the next one


def kind(part: str, family: str) -> str:
    """Return the row of the table for a fault of a part of the campaign."""
    apart = {NOT_LEARNED[0]: "of pairs", NOT_LEARNED[1]: "kinds that no rate has seen"}
    return next((word for name, word in apart.items() if part.startswith(name)), family)


def counts(rows: pd.DataFrame, parts: dict[str, str]) -> dict[str, dict[str, int]]:
    """Return {kind: COUNTS} from rows per flight, fault and detector (cosim/compare/rows.py) and {run: part}."""
    out: dict[str, dict[str, int]] = {}
    for (run, _), own in rows[rows["case"].notna()].groupby(["run", "fault"]):
        mine = own[own["id"] == "joint"].iloc[0]
        others = np.sort(own[own["id"].isin((*LOCAL, *AIRCRAFT)) & own["concerned"] & own["detected"]]["delay_s"])
        for word in (kind(parts[run], mine["family"]), "all"):
            found = out.setdefault(word, dict.fromkeys(COUNTS, 0))
            found["faults"] += 1
            found["seen"] += bool(len(others))
            if mine["detected"]:
                found["joint"] += 1
                found["late"] += bool(len(others) > 1 and mine["delay_s"] > others[1] + TICK_S)
                found[place_word(mine)] += 1
    return out


def text(folder: str | Path) -> str:
    """Return table and false alarms of a campaign in `folder` with `joint`, as Markdown."""
    frame, _, tomls, *_ = read([folder])
    rows = compare_rows.tidy(frame, tomls)
    found = counts(rows, dict(zip(frame["run"], frame["label.part"], strict=True)))
    order = [*compare_rows.FAMILIES, kind(NOT_LEARNED[1], ""), kind(NOT_LEARNED[0], ""), "all"]
    made = Table("", *HEAD, rows=[Row((k, *found[k].values())) for k in order if k in found])
    falsely = {who: rows[rows["id"].isin(ids) & (rows["false_alarms"] > 0)]["run"].nunique()
               for who, ids in (("joint", ("joint",)), ("any", (*LOCAL, *AIRCRAFT)))}  # fmt: skip
    mine = rows[rows["id"] == "joint"]
    alarms, hours = int(mine["false_alarms"].sum()), float(mine["hours"].sum())
    most = rate(alarms, hours)[2]
    said = (
        f"Without a fault: `joint` alarms in {falsely['joint']} of {rows['run'].nunique()} flights, some detector that "
        f"it reads in {falsely['any']}; {alarms} alarms in {hours:.1f} valid hours, at most {most:.2g} per hour (95 %)."
    )
    return f"{made.markdown()}\n\n{said}"


if __name__ == "__main__":
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_dir():
        sys.exit("python -m cosim.report.joint_page DIR: the folder of `cosim campaign joint`")
    markdown.replace(PAGE, "joint", text(sys.argv[1]))
    print(f"wrote  {PAGE}")
