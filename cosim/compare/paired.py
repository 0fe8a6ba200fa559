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
AT = ["run", "fault", "id"]
TOLD = (  # columns in which the rows of a detector that is the same in both campaigns are equal
    *("detected", "delay_s", "isolated_class", "outcome", "time_to_right_s", "alarm_share", "false_alarms"),
    "standing_s",
)


def pair(rows: pd.DataFrame, a: str, b: str) -> list[dict]:
    """Return what the flights say of detectors `a` and `b`, over the faults that concern both and to which neither is
    blind: n flights, seen by one alone, McNemar's two-sided p, and the share of flights that a sees less that of b,
    with its 95 % interval; [] without such a fault. `rows` are those of cosim/compare/rows.py."""
    use = rows[rows["case"].notna() & rows["concerned"] & (rows["word"] != "blind")]
    seen = use.pivot(index=["run", "fault"], columns="id", values="detected").reindex(columns=[a, b]).dropna()
    more = seen[a].astype(float) - seen[b].astype(float)
    n, only_a, only_b = len(more), int((more > 0).sum()), int((more < 0).sum())
    about: dict = {"a": a, "b": b, "n": n, "only_a": only_a, "only_b": only_b}
    about |= dict.fromkeys(("p", "difference", "low", "high"))
    if n >= LEAST:
        low, high = bootstrap(more.to_numpy())
        p = float(binomtest(only_a, only_a + only_b).pvalue) if only_a + only_b else 1.0
        about |= {"p": p, "difference": (only_a - only_b) / n, "low": low, "high": high}
    return [about] if n else []


def bootstrap(difference: np.ndarray, confidence: float = 0.95) -> tuple[float, float]:
    """Return the percentile interval of the mean of `difference` (flights,), paired; the same draws every time."""
    drawn = np.random.default_rng(0).integers(0, len(difference), (DRAWS, len(difference)))
    low, high = np.quantile(difference[drawn].mean(axis=1), [(1 - confidence) / 2, (1 + confidence) / 2])
    return float(low), float(high)


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
    told = f"{len(common)} flights in both" if common else "no flight in both: nothing is paired"
    if common:
        alone = [own["run"].nunique() - len(common) for own in each]
        each = [own[own["run"].isin(common)] for own in each]
        same, ids = _same(*each), set(each[0]["id"]) | set(each[1]["id"])
        if ids <= {*same}:
            told, same = f"{told}, every detector the same in all of them", []
        each = [own[~own["id"].isin(same)] for own in each]
        told += "".join(f", {n} only in {name} left out" for n, name in zip(alone, names) if n)
        told += f"; left out, as the same in all of them: {', '.join(same)}" if same else ""
    order = list(pd.concat(each)["id"].unique())
    both = pd.concat([own.assign(id=own["id"] + f" ({name})") for own, name in zip(each, names)])
    both = both.sort_values("id", key=lambda ids: ids.str.partition(" ")[0].map(order.index), kind="stable")
    shared = [i for i in order if all((own["id"] == i).any() for own in each)] if common else []
    pairs = [p for i in shared for p in pair(both, *(f"{i} ({name})" for name in names))]
    return both.reset_index(drop=True), pairs, told


def _same(*each):
    """Return the detectors whose rows are equal in both."""
    one, other = (own.set_index(AT)[list(TOLD)].sort_index() for own in each)
    alike = lambda name: (own[own.index.get_level_values("id") == name] for own in (one, other))  # noqa: E731
    return [i for i in each[0]["id"].unique() if pd.DataFrame.equals(*alike(i))]
