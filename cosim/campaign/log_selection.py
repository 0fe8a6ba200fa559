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

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # a third of a second: `cosim list` reads campaigns, which name rules
    import pandas as pd

COLUMNS = ("id", "concerned", "false_alarms", "delay_s", "delay_periods", "amplitude_mm", "rod_mm", "r_max_before",
           "estimate_rmse")  # fmt: skip  # of a row, by which runs are chosen
RULES = ("false_alarm", "missed", "late", "residual", "estimate", "departed")


def choose(frame: "pd.DataFrame", keep: dict[str, int]) -> dict[str, list[str]]:
    """Return {run: [rules]} of the runs to keep; `keep` maps a rule to how many runs per detector."""
    out: dict[str, list[str]] = {}
    for rule, count in keep.items():
        worst = _worst(frame, rule)
        groups = [worst] if rule == "departed" else [g for _, g in worst.groupby("id", sort=True)]
        for group in groups:
            for run in group.drop_duplicates("run").head(count)["run"]:
                out.setdefault(run, [])
                if rule not in out[run]:
                    out[run].append(rule)
    return out


def _worst(frame, rule):
    """Return the rows that rule is about, the worst first; ties in the order of the campaign."""
    if rule == "departed":
        return frame[frame["status"].isin(("departed", "diverged"))]
    flown = frame[frame["id"].notna()]
    concerned, late = flown["concerned"].fillna(False).astype(bool), flown["delay_s"].notna()
    rules = {
        "false_alarm": (flown["false_alarms"] > 0, ["false_alarms"]),
        "missed": (concerned & ~late, ["amplitude_mm", "rod_mm"]),
        "late": (concerned & late, ["delay_periods", "delay_s"]),
        "residual": (flown["r_max_before"].notna(), ["r_max_before"]),
        "estimate": (flown["estimate_rmse"].notna(), ["estimate_rmse"]),
    }
    if rule not in rules:
        raise ValueError(f"{rule!r} is no rule; there is {', '.join(RULES)}")
    which, by = rules[rule]
    return flown[which].sort_values(by, ascending=False, kind="stable")
