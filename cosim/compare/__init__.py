"""Compare aircraft-level with local diagnosis on the same flights: who sees what, how soon, how surely.

found = compare()                        # the built-in matrix
found = compare(["a.mcap", "b.mcap"])    # logs
found = compare(["logs/my-campaign"])    # a campaign's folder
"""

from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from cosim.compare import rows as compare_rows
from cosim.compare import stats as compare_stats
from cosim.errors import CosimError
from cosim.files import replace
from cosim.judge.result import plain


class CompareError(CosimError):
    """Something that cannot be compared."""


@dataclass
class Comparison:
    """Rows per run and detector (cosim/compare/rows.py), statistics per detector, and where they were written."""

    rows: pd.DataFrame
    detectors: list
    runs: int
    failed: int
    source: str
    timing: pd.DataFrame | None = None
    report: Path | None = None
    table: Path | None = None
    notes: list = field(default_factory=list)

    def to_dict(self):
        """Return the JSON of `cosim compare`."""
        about = {
            "report": str(self.report) if self.report else None,
            "table": str(self.table) if self.table else None,
            "runs": self.runs,
        }
        return plain({**about, "failed": self.failed, "source": self.source, "detectors": self.detectors})


def compare(sources=(), *, out=None, workers=None, progress=None):
    """Return the Comparison of logs, of one campaign's folder or folder of logs, or of the built-in matrix.

    With `out` the rows go to `out`/compare.parquet and .csv, the report to `out`/compare.html. `progress(done, total)`
    counts flights. Raises CompareError, CampaignError, LogError, OutputError.
    """
    frame, timing, tomls, source = read(sources, workers=workers, progress=progress)
    rows = compare_rows.tidy(frame, tomls)
    if rows.empty:
        raise CompareError("no flight has a detector to compare", place=source)
    failed = int(frame.drop_duplicates("run")["status"].isin(("infeasible", "error", "crashed")).sum())
    found = Comparison(rows, compare_stats.detectors(rows, timing), frame["run"].nunique(), failed, source, timing)
    if out is not None:
        write(found, Path(out))
    return found


def read(sources, *, workers=None, progress=None):
    """Return (rows per lane, timing or None, {run: TOML}, name) of what is to be compared."""
    sources = [Path(s) for s in sources]
    if not sources:
        from cosim.campaign import run_many
        from cosim.compare.matrix import matrix

        scenarios = matrix()
        result = run_many(scenarios, workers=workers, progress=progress)
        return *compare_rows.of_result(result, scenarios), "built-in matrix"
    folders = [s for s in sources if s.is_dir()]
    if len(folders) == 1 == len(sources):
        logs = sorted(folders[0].glob("*.mcap"))
        if (folders[0] / "scenarios.parquet").is_file() or not logs:
            return *compare_rows.of_campaign(folders[0]), str(folders[0])
        sources = logs
    elif folders:
        raise CompareError("is a folder beside other sources", place=str(folders[0]), remedy="Give logs, or one folder")
    frame, tomls = compare_rows.of_logs(sources, progress)
    return frame, None, tomls, f"{len(sources)} log{'s' * (len(sources) != 1)}"


def write(found, out):
    """Write table and report of a Comparison into folder `out`. Raises OutputError."""
    from cosim.report import comparison_report

    replace(out / "compare.parquet", lambda part: found.rows.to_parquet(part, index=False))
    replace(out / "compare.csv", lambda part: found.rows.to_csv(part, index=False))
    found.table = out / "compare.parquet"
    found.report = comparison_report(found, out / "compare.html")
