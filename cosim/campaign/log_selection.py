"""Selection of the runs whose log is kept: the worst ones by rule, per detector.

| rule | runs | worst first |
|---|---|---|
| false_alarm | with a false alarm of the detector | most of them |
| missed | a fault that concerns the detector raised no alarm | largest achieved amplitude, then peak |
| late | detected | longest delay in periods, then seconds |
| residual | fault-free until r_max_before was taken | largest r_max_before |
| estimate | with an estimate | largest RMSE |
| departed | departed or diverged, whatever the detector | first in the campaign |

Flights repeat bit for bit, so a log is written by flying the run again: no flight pays for a log that nobody wants.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # a third of a second: `cosim list` reads campaigns, which name rules
    import pandas as pd

COLUMNS = ("id", "concerned", "false_alarms", "delay_s", "delay_periods", "amplitude_mm", "rod_mm", "r_max_before",
           "estimate_rmse")  # fmt: skip  # of a row, by which runs are chosen
RULES: dict[str, tuple[Callable, list[str]]] = {  # which rows of a flight they are about, and by what the worst are
    "false_alarm": (lambda rows, concerned, seen: rows["false_alarms"] > 0, ["false_alarms"]),
    "missed": (lambda rows, concerned, seen: concerned & ~seen, ["amplitude_mm", "rod_mm"]),
    "late": (lambda rows, concerned, seen: concerned & seen, ["delay_periods", "delay_s"]),
    "residual": (lambda rows, concerned, seen: rows["r_max_before"].notna(), ["r_max_before"]),
    "estimate": (lambda rows, concerned, seen: rows["estimate_rmse"].notna(), ["estimate_rmse"]),
    "departed": (lambda rows, concerned, seen: rows["status"].isin(("departed", "diverged")), []),
}


def choose(frame: "pd.DataFrame", keep: dict[str, int]) -> dict[str, list[str]]:
    """Return {run: [rules]} of the runs to keep; `keep` maps a rule to how many runs per detector."""
    out: dict[str, list[str]] = {}
    for rule, count in keep.items():
        worst = _worst(frame, rule)
        groups = [worst] if rule == "departed" else [g for _, g in worst.groupby("id", sort=True)]
        for run in (run for group in groups for run in group.drop_duplicates("run").head(count)["run"]):
            if rule not in out.setdefault(run, []):
                out[run].append(rule)
    return out


def _worst(frame, rule):
    """Return the rows that rule is about, the worst first; ties in the order of the campaign."""
    which, by = RULES[rule]
    rows = frame if rule == "departed" else frame[frame["id"].notna()]
    found = rows[which(rows, rows["concerned"].fillna(False).astype(bool), rows["delay_s"].notna())]
    return found.sort_values(by, ascending=False, kind="stable") if by else found
