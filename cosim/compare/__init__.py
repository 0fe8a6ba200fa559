"""Compare aircraft-level with local diagnosis on the same flights: who sees what, how soon, how surely.

Computes only; `cosim.report.write_comparison` writes table and page.

found = compare(["a.mcap", "b.mcap"])    # logs
found = compare(["logs/my-campaign"])    # a campaign's folder
found = compare(["logs/a", "logs/b"])    # two of them, side by side: cosim/compare/paired.py
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from cosim.campaign.worker import FAILED
from cosim.compare import figures, metrics, paired, tables
from cosim.compare import rows as compare_rows
from cosim.compare import stats as compare_stats
from cosim.errors import CosimError, told_at_call
from cosim.judge.result import plain
from cosim.parts import loaded


class CompareError(CosimError):
    """Something that cannot be compared."""


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
    pairs: Sequence[dict] = ()  # cosim.compare.paired.Pair of each detector on the flights that both campaigns have
    report: Path | None = None  # the page, if one was written
    table: Path | None = None  # the Parquet file of the rows, if one was written

    def __repr__(self) -> str:
        rows = [f"  {d['id']:20}{d['detected']:>5} of {d['designed']:<5} seen" for d in self.detectors]
        return "\n".join([f"Comparison: {self.runs} flights, {self.source}", *rows])

    def _repr_html_(self) -> str:
        return tables.detectors(self.detectors).upto(4)._repr_html_()

    @cached_property
    def families(self) -> list[dict]:
        """Return what each detector made of each kind of fault (cosim.compare.stats.families)."""
        return compare_stats.families(self.rows)

    @cached_property
    def sizes(self) -> list[dict]:
        """Return how large an oscillation must be for each level (cosim.compare.stats.sizes)."""
        return compare_stats.sizes(compare_stats.by_group(self.rows, self.detectors))

    @cached_property
    def levels(self) -> list[dict]:
        """Return which level saw how many faults of each kind (cosim.compare.stats.by_level)."""
        return compare_stats.by_level(self.rows, self.detectors)

    def predictive(self, fault_rates: Sequence[float]) -> list[dict]:
        """Return {id, fault_rate, value, low, high}: the share of a detector's alarms behind which there is a fault,
        where such faults come `fault_rates` times per flight hour (cosim.compare.metrics.predictive_value). Without
        bounds, nan, where no fault is one that it was designed for or no hour shows false alarms. Raises CompareError
        for a rate that is not above 0 and at most 1000."""
        for rate in (rate for rate in fault_rates if not 0.0 < rate <= 1000.0):
            said = f"{rate:g} faults per flight hour"
            raise CompareError(said, place="--fault-rate", allowed="above 0, at most 1000")
        out = []
        for d, rate in ((d, rate) for d in self.detectors for rate in fault_rates):
            about = d["detected"], d["designed"], d["false_alarms"], d["hours"], rate
            found = metrics.predictive_value(*about) if d["hours"] > 0.0 else metrics.UNKNOWN
            out.append({"id": d["id"], "fault_rate": rate, **found._asdict()})
        return out

    def roc(self, detectors: Sequence[str] = ()) -> pd.DataFrame:
        """Return the operating points of `detectors` (default: all), a row per threshold, with exact 95 % intervals
        (cosim.compare.figures.roc). Raises CosimError without fault-free flights or faults."""
        return figures.roc(self.rows, detectors)

    def pod(self, detectors: Sequence[str] = ()) -> pd.DataFrame:
        """Return probability of detection over achieved amplitude [mm of rod] with bounds, by kind of oscillation and
        frequency, of each level or of `detectors` (cosim.compare.figures.curves)."""
        return figures.curves(self.rows, self.detectors, detectors)

    def figure(self, kind: str, detectors: Sequence[str] = ()) -> Any:
        """Return the matplotlib Figure "roc" or "pod" with its bounds, one column of a journal wide.
        `figure("roc").savefig("roc.pdf")` writes vectors. Needs the extra `plot`; raises CosimError without it."""
        return figures.figure(kind, self.rows, self.detectors, detectors)

    def to_dict(self) -> dict:
        """Return the JSON of `cosim compare`."""
        files = {key: str(path) if path else None for key, path in (("report", self.report), ("table", self.table))}
        about = {"runs": self.runs, "failed": self.failed, "source": self.source, "detectors": self.detectors}
        levels, sizes = ([], []) if self.two else (self.levels, self.sizes)
        told = {"families": self.families, "levels": levels, "sizes": sizes, "pairs": self.pairs}
        return plain({**files, **about, **told})


@told_at_call
def compare(
    sources: Iterable[str | Path], *, progress: Callable[[int, int], None] | None = None,
    guests: Iterable[str | Path] = (),
) -> Comparison:  # fmt: skip
    """Return the Comparison of logs, of one campaign's folder or folder of logs, or of two campaigns side by side.

    `progress(done, total)` counts flights. `guests` are files of further detectors (cosim/parts), run on logs
    as they were flown. Raises CompareError, CampaignError, LogError, GuestError.
    """
    paths = [Path(s) for s in sources]
    if len(paths) == 2 and all((p / "scenarios.parquet").is_file() for p in paths):
        return _side_by_side(paths, guests)
    frame, timing, tomls, source, title = read(paths, progress=progress, guests=guests)
    return _made(_tidy(frame, tomls, source), timing, frame["run"].nunique(), [frame], source, title=title)


def _tidy(frame, tomls, source):
    rows = compare_rows.tidy(frame, tomls)
    if rows.empty:
        raise CompareError("no flight has a detector to compare", place=source)
    return rows


def _made(rows, timing, runs, frames, source, **more):
    each = compare_stats.detectors(rows, timing)
    failed = sum(int(frame.drop_duplicates("run")["status"].isin(FAILED).sum()) for frame in frames)
    return Comparison(rows, each, runs, failed, source, **more)


def _side_by_side(folders, guests):
    if folders[0].resolve() == folders[1].resolve():
        raise CompareError("is named twice", place=str(folders[0]), remedy="Give the folders of two campaigns")
    names, each, times, frames = paired.labels(folders), [], [], []
    for folder, name in zip(folders, names):
        frame, timing, tomls, source, _ = read([folder], guests=guests)
        each.append(paired.flights(_tidy(frame, tomls, source), tomls))  # while its records are the ones told
        frames.append(frame)
        if timing is not None:
            known = timing[timing["id"].notna()]
            times.append(known.assign(id=[f"{i} ({name})" for i in known["id"]]))
    rows, pairs, told = paired.joined(each, names)
    source = f"{' and '.join(map(str, folders))}: {told}"
    timing = pd.concat(times) if times else None
    return _made(rows, timing, rows["run"].nunique(), frames, source, two=True, pairs=pairs)


def read(
    sources: Iterable[str | Path], *, progress: Callable[[int, int], None] | None = None, guests: Iterable = ()
) -> tuple:
    """Return (rows per lane, timing or None, {run: TOML}, name, title) of what is to be compared."""
    paths = [Path(s) for s in sources]
    folders, own = [s for s in paths if s.is_dir()], loaded(guests)
    if len(folders) == 1 == len(paths):
        logs = sorted(folders[0].glob("*.mcap"))
        if (folders[0] / "scenarios.parquet").is_file() or not logs:
            if own:
                raise CompareError("holds rows, no flights to run a detector on", place=str(folders[0]),
                                   remedy="Fly the campaign with --detector")  # fmt: skip
            frame, timing, tomls, title = compare_rows.of_campaign(folders[0])
            return frame, timing, tomls, str(folders[0]), title
        paths = logs
    elif folders:
        remedy = "Give logs, one folder, or the folders of two campaigns"
        raise CompareError("is a folder beside other sources", place=str(folders[0]), remedy=remedy)
    frame, tomls = compare_rows.of_logs(paths, progress, own)
    again = frame.attrs["again"]
    told = f"; the same flight again, counted once: {', '.join(again)}" if again else ""
    return frame, None, tomls, f"{len(paths)} log{'s' * (len(paths) != 1)}{told}", ""
