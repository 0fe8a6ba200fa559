"""Compare aircraft-level with local diagnosis on the same flights: who sees what, how soon, how surely.

Computes only; `cosim.report.write_comparison` writes table and page.

found = compare(["a.mcap", "b.mcap"])    # logs
found = compare(["logs/my-campaign"])    # a campaign's folder
found = compare(["logs/a", "logs/b"])    # two of them, side by side
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import pandas as pd

from cosim.compare import metrics, tables
from cosim.compare import rows as compare_rows
from cosim.compare import stats as compare_stats
from cosim.errors import CosimError, did_you_mean, told_at_call
from cosim.judge.result import plain
from cosim.parts import loaded


@dataclass
class Comparison:
    """Rows per run and detector (cosim/compare/rows.py), statistics per detector, and where they were written, if."""

    rows: pd.DataFrame  # a row per run, fault and detector
    detectors: list  # a dict per detector: counts, delays [s], false alarms, bounds
    runs: int  # flights
    failed: int  # runs without a flight
    source: str  # where the flights are from, in words
    two: bool = False  # campaigns side by side: each detector stands twice
    title: str = ""  # of the campaign
    pairs: Sequence[dict] = ()  # cosim.compare.stats.pair of each detector on the flights that both campaigns have
    report: Path | None = None  # the page, if one was written
    table: Path | None = None  # the Parquet file of the rows, if one was written

    def __repr__(self) -> str:
        return f"Comparison: {self.runs} flights, {self.source}\n{tables.detectors(self.detectors).markdown()}"

    def _repr_html_(self) -> str:
        return tables.detectors(self.detectors)._repr_html_()

    @cached_property
    def families(self) -> list[dict]:
        """Return what each detector made of each kind of fault (cosim.compare.stats.families)."""
        return compare_stats.families(self.rows)

    @cached_property
    def sizes(self) -> list[dict]:
        """Return how large an oscillation must be for each level (cosim.compare.stats.sizes)."""
        return [] if self.two else compare_stats.sizes(compare_stats.by_group(self.rows, self.detectors))

    @cached_property
    def levels(self) -> list[dict]:
        """Return which level saw how many faults of each kind (cosim.compare.stats.by_level)."""
        return [] if self.two else compare_stats.by_level(self.rows, self.detectors)

    @property
    def headline(self) -> str:
        """Return what the flights say in a sentence: which level, or of two campaigns which of both, saw more."""
        if self.two:
            parted = [p for p in self.pairs if p["only_a"] or p["only_b"]]
            said = "{a} alone in {only_a}, {b} alone in {only_b} of {n} faults"
            same = "Every detector saw the same faults in both" if self.pairs else "No fault was flown in both"
            return f"{'; '.join(said.format(**p) for p in parted) or same}."
        n = {key: sum(d[key] for d in self.levels) for key in ("faults", "local", "aircraft", "both", "nobody")}
        loud = ", ".join(d["id"] for d in self.detectors if not d["credible"])
        told = (f"Of {n['faults']} faults the local level alone saw {n['local']}, the aircraft level alone "
                f"{n['aircraft']}, both {n['both']}, neither {n['nobody']}")  # fmt: skip
        care = f"; left out, as it alarms in more than half of the fault-free flights: {loud}" if loud else ""
        return f"{told if n['faults'] else 'No fault was flown'}{care}."

    def predictive(self, fault_rates: Sequence[float]) -> list[dict]:
        """Return {id, fault_rate, value, low, high}: the share of a detector's alarms behind which there is a fault,
        where such faults come `fault_rates` times per flight hour (cosim.compare.metrics.predictive_value). Without
        bounds, nan, where no fault is one that it was designed for or no hour shows false alarms. Raises CosimError
        for a rate that is not positive and finite."""
        for rate in (rate for rate in fault_rates if not 0.0 < rate < math.inf):
            raise CosimError(f"{rate:g} faults per flight hour", place="fault_rates", allowed="above 0")
        value = metrics.predictive_value
        return [{"id": d["id"], "fault_rate": rate,
                 **value(d["detected"], d["designed"], d["false_alarms"], d["hours"], rate)._asdict()}
                for d in self.detectors for rate in fault_rates]  # fmt: skip

    def roc(self, detectors: Sequence[str] = ()) -> pd.DataFrame:
        """Return the operating points of `detectors` (default: all), a row per threshold on the largest |r| of each
        flight, before confirmation, with exact 95 % intervals (cosim.compare.stats.operating_points). Raises CosimError
        without fault-free flights or faults: a ROC needs both."""
        found = compare_stats.operating_points(self._of(detectors or self._ids))
        if found.empty:
            told = "has no detector with both fault-free flights and faults that it was designed for"
            raise CosimError(told, place="roc", remedy="Fly both: [[part]] in a campaign (cosim/campaign/README.md)")
        return found

    def pod(self, detectors: Sequence[str] = ()) -> pd.DataFrame:
        """Return probability of detection over achieved amplitude [mm of rod] with bounds, by kind of oscillation and
        frequency (cosim.compare.stats.curves), of each level or of `detectors`: there a flight in which it was not
        valid counts as missed."""
        own = self._of(detectors)
        each = own.assign(group=own["id"], seen=own["detected"], able=own["concerned"])
        return compare_stats.curves(each if detectors else compare_stats.by_group(self.rows, self.detectors))

    @property
    def _ids(self):
        return [d["id"] for d in self.detectors]

    def _of(self, detectors):
        for name in (name for name in detectors if name not in self._ids):
            raise CosimError("is no detector of these flights", place=name, allowed=", ".join(self._ids),
                               remedy=did_you_mean(name, self._ids))  # fmt: skip
        return self.rows[self.rows["id"].isin(detectors)]

    def to_dict(self, fault_rates: Sequence[float] = ()) -> dict:
        """Return the JSON of `cosim compare`, with what an alarm is worth at `fault_rates` (`predictive`)."""
        files = {key: str(path) if path else None for key, path in (("report", self.report), ("table", self.table))}
        keys = ("runs", "failed", "source", "headline", "detectors", "families", "levels", "sizes", "pairs")
        return plain(files | {key: getattr(self, key) for key in keys} | {"predictive": self.predictive(fault_rates)})


@told_at_call
def compare(
    sources: Iterable[str | Path], *, progress: Callable[[int, int], None] | None = None,
    user_detectors: Iterable[str | Path] = (),
) -> Comparison:  # fmt: skip
    """Return the Comparison of logs, of one campaign's folder or folder of logs, or of two campaigns side by side.

    `progress(done, total)` counts flights. `user_detectors` are files of further detectors (cosim/parts), run on logs
    as they were flown. Raises CosimError.
    """
    paths = [Path(s) for s in sources]
    if len(paths) == 2 and all(map(_is_campaign, paths)):
        return _side_by_side(paths)
    if any(p.is_dir() for p in paths[1:]) or (len(paths) > 1 and paths[0].is_dir()):
        remedy = "Give logs, one folder, or the folders of two campaigns"
        raise CosimError("a folder stands beside other sources", place=" ".join(map(str, paths)), remedy=remedy)
    logs = sorted(paths[0].glob("*.mcap")) if paths[0].is_dir() else paths
    if not logs or _is_campaign(paths[0]):
        if user_detectors:
            raise CosimError("holds rows, no flights to run a detector on", place=str(paths[0]),
                               remedy="Fly the campaign with --detector")  # fmt: skip
        rows, timing, runs, failed, title, tomls = compare_rows.of_campaign(paths[0])
        source = f"{paths[0]}{f'; {len(tomls) - runs} more are not flown yet' if len(tomls) > runs else ''}"
        return Comparison(rows, compare_stats.detectors(rows, timing), runs, failed, source, title=title)
    frame, tomls, notes = compare_rows.of_logs(logs, progress, loaded(user_detectors))
    source = f"{len(logs)} log{'s' * (len(logs) != 1)}"
    source += "".join(f"; {said}: {', '.join(names)}" for said, names in notes.items() if names)
    rows = compare_rows.tidy(frame, tomls, source)
    return Comparison(rows, compare_stats.detectors(rows), frame["run"].nunique(), 0, source)


def _is_campaign(path):
    return (path / "scenarios.parquet").is_file()


# Two campaigns side by side are a detector before and after a change, or the same detectors on other flights. Each
# stands under its name with its campaign's: "parity (before)". Flights are the same where their scenarios are but for
# the detectors. If any are in both campaigns, only those count, and of the detectors only those whose rows are not all
# the same; otherwise everything counts, and nothing is paired.

SAME = (  # columns in which the rows of a detector that is the same in both campaigns are equal
    *("run", "fault", "id", "detected", "delay_s", "isolated_class", "outcome", "time_to_right_s", "alarm_share"),
    *("false_alarms", "standing_s"),
)


def _side_by_side(folders):
    if folders[0].resolve() == folders[1].resolve():
        raise CosimError("is named twice", place=str(folders[0]), remedy="Give the folders of two campaigns")
    parts = [f.resolve().parts for f in folders]  # as much of each path as they need to differ
    names = next(["/".join(p[-n:]) for p in parts] for n in range(1, 99) if parts[0][-n:] != parts[1][-n:])
    each, times, failed = [], [], 0
    for folder, name in zip(folders, names):
        rows, timing, _, lost, _, tomls = compare_rows.of_campaign(folder)
        each.append(_named_by_flight(rows, tomls))
        times.append(timing.dropna(subset=["id"]).assign(id=lambda t, name=name: t["id"] + f" ({name})"))
        failed += lost
    rows, pairs, told = _joined(each, names)
    source, stats = f"{' and '.join(map(str, folders))}: {told}", compare_stats.detectors(rows, pd.concat(times))
    return Comparison(rows, stats, rows["run"].nunique(), failed, source, two=True, pairs=pairs)


def _named_by_flight(rows, tomls):
    """Return `rows` with each run named after its flight: a digest of its scenario without the detectors."""
    named = {run: compare_rows.flight(tomls[run]) for run in rows["run"].unique()}
    if len({*named.values()}) < len(named):
        raise CosimError("a flight stands twice: its campaign varies its detectors", place="compare",
                         remedy="Compare campaigns that fly each flight once")  # fmt: skip
    return rows.assign(run=rows["run"].map(named))


def _joined(each, names):
    """Return (rows of both, the pair of each detector, what was left out, in words)."""
    common = set(each[0]["run"]) & set(each[1]["run"])
    told = f"{len(common)} flights in both" if common else "no flight in both: nothing is paired"
    if common:
        told += "".join(f", {n} only in {name} left out" for own, name in zip(each, names)
                        if (n := own["run"].nunique() - len(common)))  # fmt: skip
        each = [own[own["run"].isin(common)] for own in each]
        either = each[0][[*SAME]].merge(each[1][[*SAME]], how="outer", indicator="both")
        differ = set(either.loc[either["both"] != "both", "id"])
        same = [name for name in each[0]["id"].unique() if name not in differ]
        told += f"; left out, as the same in all of them: {', '.join(same)}" if same and differ else ""
        told += "" if differ else ", every detector the same in all of them"
        each = [own[own["id"].isin(differ)] if differ else own for own in each]
    order = list(pd.concat(each)["id"].unique())
    both = pd.concat([own.assign(id=own["id"] + f" ({name})") for own, name in zip(each, names)])
    both = both.sort_values("id", key=lambda ids: ids.str.partition(" ")[0].map(order.index), kind="stable")
    shared = [i for i in order if all((own["id"] == i).any() for own in each)] if common else []
    pairs = [p for i in shared for p in compare_stats.pair(both, *(f"{i} ({name})" for name in names))]
    return both.reset_index(drop=True), pairs, told
