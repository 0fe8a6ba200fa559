"""Two detectors compared fairly: on the same flights.

Flights in which both see the fault, or neither, say nothing of which is better; the exact test of McNemar asks of the
others whether they part evenly. How much better is a bootstrap over the flights, each drawn with what both made of it.

Two campaigns side by side are a detector before and after a change, or the same detectors on other flights. Each stands
under its name with its campaign's: "parity (before)". Flights are the same where their scenarios are but for the
detectors. If any are in both campaigns, only those count, and of the detectors only those whose rows are not all the
same; otherwise everything counts, and nothing is paired.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import binomtest

from cosim.compare import rows as compare_rows
from cosim.errors import CosimError

DRAWS = 2000  # of the bootstrap
LEAST = 5  # flights


def pair(rows: pd.DataFrame, a: str, b: str) -> list[dict]:
    """Return what the flights say of detectors `a` and `b`, over the faults that concern both and to which neither is
    blind: n flights, seen by one alone, McNemar's two-sided p, and the share of flights that a sees less that of b,
    with its 95 % interval; [] without such a fault. `rows` are those of cosim/compare/rows.py."""
    use = rows[rows["case"].notna() & rows["concerned"] & (rows["word"] != "blind")]
    seen = [use[use["id"] == name].set_index(["run", "fault"])["detected"] for name in (a, b)]
    one, other = (own.loc[seen[0].index.intersection(seen[1].index)].to_numpy(bool) for own in seen)
    n, only_a, only_b = len(one), int(np.sum(one & ~other)), int(np.sum(other & ~one))
    about: dict = {"a": a, "b": b, "n": n, "only_a": only_a, "only_b": only_b}
    about |= dict.fromkeys(("p", "difference", "low", "high"))
    if n >= LEAST:
        about["p"] = float(binomtest(only_a, only_a + only_b).pvalue) if only_a + only_b else 1.0
        about["difference"] = (only_a - only_b) / n
        about["low"], about["high"] = bootstrap(one.astype(float) - other)
    return [about] if n else []


def bootstrap(difference: np.ndarray, confidence: float = 0.95) -> tuple[float, float]:
    """Return the percentile interval of the mean of `difference` (flights,), paired; the same draws every time."""
    rng = np.random.default_rng(0)
    drawn = rng.integers(0, len(difference), (DRAWS, len(difference)))
    means = difference[drawn].mean(axis=1)
    low, high = np.quantile(means, [(1 - confidence) / 2, (1 + confidence) / 2])
    return float(low), float(high)


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
    """Return `rows` with each run named after its flight: a digest of its scenario without the detectors. Raises
    CosimError where two runs are the same flight."""
    named = {run: compare_rows.flight(tomls[run]) for run in rows["run"].unique()}
    if len({*named.values()}) < len(named):
        raise CosimError("a flight stands twice: its campaign varies its detectors", place="compare",
                         remedy="Compare campaigns that fly each flight once")  # fmt: skip
    return rows.assign(run=rows["run"].map(named))


def joined(each: list[pd.DataFrame], names: list[str]) -> tuple[pd.DataFrame, list[dict], str]:
    """Return (rows of both, `pair` of each detector, what was left out, in words). `each` are rows of
    `flights`, `names` what their campaigns are called."""
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
    made = [p for i in shared for p in pair(both, *(f"{i} ({name})" for name in names))]
    return both.reset_index(drop=True), made, told


def _same(a, b):
    one, other = (own.set_index(AT)[list(TOLD)].sort_index() for own in (a, b))
    of = lambda rows, name: rows[rows.index.get_level_values("id") == name]  # noqa: E731
    return [i for i in dict.fromkeys(a["id"]) if of(one, i).equals(of(other, i))]
