"""Two campaigns side by side: a detector before and after a change, or the same detectors on other flights.

Each detector stands under its name with its campaign's: "parity (before)". Flights are the same where their scenarios
are but for the detectors. If any are in both campaigns, only those count, and of the detectors only those whose rows
are not all the same; otherwise everything counts, and nothing is paired.
"""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import pandas as pd

from cosim.compare import paired
from cosim.compare import rows as compare_rows
from cosim.errors import CosimError

TOLD = (
    *("detected", "delay_s", "isolated_class", "outcome", "time_to_right_s", "alarm_share", "false_alarms"),
    "standing_s",
)
AT = ["run", "fault", "id"]


def labels(folders: list[Path]) -> list[str]:
    """Return a name for each folder: its own, with as much of its path as they need to differ."""
    parts = [f.resolve().parts for f in folders]
    return next(["/".join(p[-n:]) for p in parts] for n in range(1, 99) if parts[0][-n:] != parts[1][-n:])


def flights(rows: pd.DataFrame, tomls: Mapping[str, str]) -> pd.DataFrame:
    """Return `rows` with each run named after its flight: a digest of its scenario without the detectors.

    Raises CosimError where two runs are the same flight.
    """
    named = {run: compare_rows.flight(tomls[run]) for run in rows["run"].unique()}
    if len({*named.values()}) < len(named):
        raise CosimError("a flight stands twice: its campaign varies its detectors", place="compare",
                         remedy="Compare campaigns that fly each flight once")  # fmt: skip
    return rows.assign(run=rows["run"].map(named))


def joined(each: list[pd.DataFrame], names: list[str]) -> tuple[pd.DataFrame, list[dict], str]:
    """Return (rows of both, paired.Pair of each detector as a dict, what was left out, in words).

    `each` are rows of `flights`, `names` what their campaigns are called.
    """
    common = set(each[0]["run"]) & set(each[1]["run"])
    told, same = "no flight in both: nothing is paired", []
    if common:
        alone = [own["run"].nunique() - len(common) for own in each]
        each = [own[own["run"].isin(common)] for own in each]
        told, same = f"{len(common)} flights in both", _same(*each)
        if not {*each[0]["id"], *each[1]["id"]} - {*same}:
            told, same = f"{len(common)} flights in both, every detector the same in all of them", []
        each = [own[~own["id"].isin(same)] for own in each]
        told += "".join(f", {n} only in {name} left out" for n, name in zip(alone, names) if n)
        told += f"; left out, as the same in all of them: {', '.join(same)}" if same else ""
    both = pd.concat([own.assign(id=[f"{i} ({name})" for i in own["id"]]) for own, name in zip(each, names)])
    order = {name: i for i, name in enumerate(dict.fromkeys([*each[0]["id"], *each[1]["id"]]))}
    both = both.sort_values("id", key=lambda ids: ids.map(lambda i: order[i.partition(" ")[0]]), kind="stable")
    shared = [i for i in order if all((own["id"] == i).any() for own in each)] if common else []
    made = [asdict(p) for i in shared for p in paired.pair(both, *(f"{i} ({name})" for name in names))]
    return both.reset_index(drop=True), made, told


def _same(a, b):
    """Return the detectors whose rows are the same in both."""
    one, other = (own.set_index(AT)[list(TOLD)].sort_index() for own in (a, b))
    return [i for i in dict.fromkeys(a["id"]) if _of(one, i).equals(_of(other, i))]


def _of(rows, name):
    return rows[rows.index.get_level_values("id") == name]
