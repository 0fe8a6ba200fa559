"""The commands of many flights: `campaign`, `compare`, `reproduce`."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Group
from rich.text import Text

from cosim.cli import app as shared
from cosim.cli import flight
from cosim.cli.app import (
    answer,
    argument,
    command,
    flag,
    only_with,
    option,
    out,
    output_option,
    progress,
    reserve,
    whole,
    word,
)
from cosim.files import columns, replace

TEXTS, ROWS = 5, 15  # different errors, and rows that differ, that are printed


@command("Many flights")
def campaign(
    campaign: Annotated[str, argument("CAMPAIGN", "Built-in name or file.")],
    workers: Annotated[int | None, option("N", "Processes. Default: one per core.", min=1)] = None,
    scheduler: Annotated[str | None, option("ADDRESS", "Fly on a Dask cluster: tcp://host:8786.")] = None,
    resume: Annotated[bool, flag("--resume", "Go on in this folder; failed runs fly again.")] = False,
    output: Annotated[Path | None, output_option("DIR", "Default: logs/<campaign>.")] = None,
    signals: Annotated[
        list[str] | None,
        option("WORD", "Write this signal of every flight, with labels: `cosim list signals`, or all. Repeatable."),
    ] = None,
    rate: Annotated[float | None, option("HZ", "With --signals: samples a second. Default: 50.")] = None,
    again: Annotated[str | None, option("ID", "Fly one run again, with a log, and compare its row.", "--rerun")] = None,
    detector: shared.DetectorOption = None,
    json_: shared.JsonOption = False,
) -> None:
    """Fly grids and draws of scenarios, a row per flight.

    Exit status 1: a run ended in an error, or none could be flown.
    """
    from cosim.campaign.engine import run_campaign

    only_with("--signals", signals, rate=rate)
    if again:
        _rerun(campaign, again, json_, out=output, user_detectors=detector or ())
    with progress(f"flying {Path(campaign).stem}", "runs", "preparing the workers") as tell:
        done = run_campaign(
            campaign, workers=workers, scheduler=scheduler, out=output, resume=resume, progress=tell,
            user_detectors=detector or (), signals=signals and [w for w in signals if w != "all"], rate_hz=rate or 50.0,
        )  # fmt: skip
    failed = errors(done.frame)
    answer(json_, {**done.to_dict(), "errors": failed}, lambda _: flown(done, failed))
    none = sum(r["runs"] for r in failed) == done.frame["run"].nunique()
    raise typer.Exit(int(none or any(r["status"] != "infeasible" for r in failed)))


def _rerun(campaign, run, json_, **how):
    """Fly one run again, print it and whether its row repeats, and exit."""
    from cosim.campaign.engine import rerun

    flown, result, repeats, same_code = rerun(campaign, run, **how)
    found = {**result.to_dict(), "run": run, "repeats": repeats, "same_code": same_code}
    answer(json_, found, lambda _: flight.shown(found, flown))
    if repeats is not None and not json_:
        other = "" if same_code else ": the campaign was flown with other code, designs or libraries"
        out.print("its row repeats exactly" if repeats else f"[bold red]its row does not repeat[/]{other}")
    raise typer.Exit(1 if repeats is False else 0)


def flown(result: Any, failed: list[dict]) -> Group:
    """Return what a campaign came to: the table of its detectors, how its runs ended, where the rows are."""
    from cosim.compare import compare
    from cosim.compare.tables import detectors

    status = result.frame.drop_duplicates("run")["status"].value_counts()
    text = f"{result.done} runs: {', '.join(f'{n} {name}' for name, n in status.items())}"
    text += f"; {result.resumed} were there already" if result.resumed else ""
    at = result.parquet if result.frame["id"].notna().any() else None
    shown = [detectors(compare([at.parent]).detectors)] if at else []
    told = [Text(f"{r['runs']} x {r['status']}: {r['error']}", style="red") for r in failed[:TEXTS]]
    if more := sum(r["runs"] for r in failed[TEXTS:]):
        told.append(Text(f"{more} more with {len(failed) - TEXTS} other texts: column error of the rows", style="red"))
    follows = [whole(f"next   cosim compare {word(at.parent)}")] if at else []
    return Group(*shown, Text(text), *told, Text(f"rows   {result.parquet}"), *follows)


def errors(frame: Any) -> list[dict]:
    """Return [{status, error, runs}] of the runs without a flight, the most frequent first."""
    from cosim.campaign.worker import FAILED

    runs = frame.drop_duplicates("run")
    counts = runs[runs["status"].isin(FAILED)].groupby(["status", "error"], sort=True).size()
    counts = counts.sort_values(ascending=False, kind="stable")
    return [{"status": status, "error": text, "runs": int(n)} for (status, text), n in counts.items()]


@command("Many flights")
def compare(
    sources: Annotated[list[Path], argument("PATH", "Logs, a campaign's folder, or two of them side by side.")],
    output: Annotated[Path | None, output_option("DIR", "Folder for report and tables. Default: write none.")] = None,
    detector: shared.DetectorOption = None,
    fault_rate: Annotated[
        list[float] | None, option("PER_HOUR", "What an alarm is worth at so many faults per flight hour.")
    ] = None,
    json_: shared.JsonOption = False,
) -> None:
    """Compare detectors on the same flights: who sees what, when."""
    from cosim.compare import compare as work
    from cosim.judge.result import plain
    from cosim.report import write_comparison
    from cosim.report.compare_page import SIGNS

    if output:
        for name, sign in SIGNS.items():
            reserve(output / name, sign)
    with progress("reading", unit="flights", waiting="preparing") as tell:
        made = work(sources, progress=tell, user_detectors=detector or ())
        if output:
            write_comparison(made, output)
    answer(json_, made.to_dict() | {"predictive": plain(made.predictive(fault_rate or ()))}, compared)


def compared(found: dict) -> Group:
    """Return what a comparison says: `found` is the JSON of `cosim compare`."""
    from cosim.compare.tables import detectors, pairs, predictive  # `--help` needs no pandas

    lost = f"; {found['failed']} could not be flown" if found["failed"] else ""
    parts: list[Any] = [Text(f"{found['runs']} flights, {found['source']}{lost}")]
    parts += [pairs(found["pairs"])] if found["pairs"] else []
    parts += [detectors(found["detectors"]), Text(found["headline"])]
    parts += [predictive(found["predictive"])] if found["predictive"] else []
    return Group(*parts, *(whole(f"{key:<7}{found[key]}") for key in ("report", "table") if found[key]))


@command("Papers")
def reproduce(
    paper: Annotated[str, argument("PAPER", "lu17, jay, sun13, mar10, alwi14 or all.")] = "all",
    output: Annotated[Path, output_option("DIR", "Folder of page and rows.")] = Path("logs"),
    json_: shared.JsonOption = False,
) -> None:
    """Repeat the papers' experiments: paper says, we get, verdict.

    Exit status 1 when a row differs.
    """
    from pandas import DataFrame

    from cosim.papers import chosen, counts
    from cosim.papers import reproduce as work
    from cosim.report import reproduction_report
    from cosim.report.page import PAGE

    chosen(paper)
    page, table = (output / f"reproduce-{paper}.{ending}" for ending in ("html", "csv"))
    listed = columns("paper", "item", "says")
    reserve(page, PAGE)
    reserve(table, listed)
    with progress(f"reproducing {paper}", unit="rows", waiting="preparing") as tell:
        rows, drawings = work(paper, progress=tell)
    reproduction_report(rows, drawings, page)
    frame = DataFrame(map(asdict, rows))
    replace(table, lambda part: frame.to_csv(part, index=False), listed)
    found: dict[str, Any] = {"counts": counts(rows), "report": str(page), "table": str(table)}
    plain = [asdict(r) | {"got": r.got if math.isfinite(r.got) else None} for r in rows]
    answer(json_, {**found, "rows": plain}, lambda _: reproduced(rows, found))
    if found["counts"]["differs"]:
        raise typer.Exit(1)


def reproduced(rows: list[Any], found: dict[str, Any]) -> Group:
    """Return the counts of the verdicts, a line per row that differs, explained or not, and where all rows are."""
    from cosim.papers.tables import VERDICTS
    from cosim.table import number

    total = "   ".join(f"{n} {VERDICTS[v][0]}" for v, n in found["counts"].items())
    off = [r for r in rows if r.verdict != "agrees"]
    lines = [f"{r.paper}, {r.item}: we get {number(r.got)}, {VERDICTS[r.verdict][0]}" for r in off[:ROWS]]
    lines += [f"and {len(off) - ROWS} more"] * (len(off) > ROWS)
    files = (whole(f"{key:<7}{found[key]}, every row") for key in ("report", "table"))
    return Group(*map(Text, (total, *lines)), *files)
