"""Two detectors compared fairly: on the same flights, as they ship and at an equal false-alarm probability.

Flights in which both see the fault, or neither, say nothing of which is better; the exact test of McNemar asks of the
others whether they part evenly. How much better is a bootstrap over the flights, each drawn with what both made of it.
At equal false-alarm probability each threshold is scaled so that the same share of fault-free flights crosses it
(cosim.compare.stats.equal_thresholds), and seen is a statistic that reaches it after the onset.

Two campaigns side by side are a detector before and after a change, or the same detectors on other flights. Each stands
under its name with its campaign's: "parity (before)". Flights are the same where their scenarios are but for the
detectors. If any are in both campaigns, only those count, and of the detectors only those whose rows are not all the
same; otherwise everything counts, and nothing is paired.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import binomtest

from cosim.compare import rows as compare_rows
from cosim.compare import stats
from cosim.errors import CosimError

DRAWS = 2000  # of the bootstrap
LEAST = 5  # flights


@dataclass(frozen=True)
class Pair:
    """What the flights say of detectors a and b: n flights, seen by one alone, McNemar's two-sided p, and the share of
    flights that a sees less that of b, with its 95 % interval. `latest_s`: how much longer a takes on average, a
    missed fault taken as noticed at the end of the flight."""

    a: str
    b: str
    at: str  # "shipped" or "equal false alarms"
    n: int
    only_a: int
    only_b: int
    p: float | None
    difference: float | None = None
    low: float | None = None
    high: float | None = None
    later_s: float | None = None
    later_low_s: float | None = None
    later_high_s: float | None = None


def pair(rows: pd.DataFrame, a: str, b: str, horizon: pd.Series | None = None) -> list[Pair]:
    """Return the Pairs of detectors `a` and `b`: over the faults that concern both and to which neither is blind.
    `rows` are those of cosim/compare/rows.py; `horizon` {run: seconds from its onset to the end}."""
    use = rows[rows["case"].notna() & rows["concerned"] & (rows["word"] != "blind")]
    each = [use[use["id"] == name].set_index(["run", "fault"]) for name in (a, b)]
    both = each[0].index.intersection(each[1].index)
    if not len(both):
        return []
    one, other = (e.loc[both] for e in each)
    seen = one["detected"].to_numpy(bool), other["detected"].to_numpy(bool)
    late = None
    if horizon is not None:
        end = horizon.loc[both.get_level_values(0)].to_numpy(float)
        late = [np.where(np.isfinite(d), d, end) for d in (one["delay_s"].to_numpy(), other["delay_s"].to_numpy())]
    found = [_pair(a, b, "shipped", seen, late)]
    equal = stats.equal_thresholds(rows)
    c = [equal.get(name, (None,))[0] for name in (a, b)]
    if all(c):
        level = [np.nan_to_num(e["r_fault"].to_numpy(float), nan=-1.0) >= at for e, at in zip((one, other), c)]
        found.append(_pair(a, b, "equal false alarms", level, None))
    return found


def _pair(a, b, at, seen, late):
    seen_a, seen_b = seen
    n, only_a, only_b = len(seen_a), int(np.sum(seen_a & ~seen_b)), int(np.sum(seen_b & ~seen_a))
    if n < LEAST:
        return Pair(a, b, at, n, only_a, only_b, None)
    p = float(binomtest(only_a, only_a + only_b).pvalue) if only_a + only_b else 1.0  # McNemar's exact test
    told = {"difference": (only_a - only_b) / n}
    told["low"], told["high"] = bootstrap(seen_a.astype(float) - seen_b)
    if late is not None:
        longer = late[0] - late[1]
        told["later_s"] = float(longer.mean())
        told["later_low_s"], told["later_high_s"] = bootstrap(longer)
    return Pair(a, b, at, n, only_a, only_b, p, **told)


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
    """Return (rows of both, Pair of each detector as a dict, what was left out, in words). `each` are rows of
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
    made = [asdict(p) for i in shared for p in pair(both, *(f"{i} ({name})" for name in names))]
    return both.reset_index(drop=True), made, told


def _same(a, b):
    one, other = (own.set_index(AT)[list(TOLD)].sort_index() for own in (a, b))
    of = lambda rows, name: rows[rows.index.get_level_values("id") == name]  # noqa: E731
    return [i for i in dict.fromkeys(a["id"]) if of(one, i).equals(of(other, i))]
