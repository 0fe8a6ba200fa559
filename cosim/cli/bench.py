"""The command that measures what everything costs, its tables, and two states of the code beside each other."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from rich.console import Group
from rich.text import Text

from cosim.cli.app import answer, app, err
from cosim.cli.output import JsonOption, flag, option
from cosim.cli.tables import progress as bar
from cosim.errors import CosimError
from cosim.table import DASH, Table, number
from cosim.texts import from_json, read


@app.command()
def bench(
    rounds: Annotated[int, option(None, "Rounds of interleaved timing.", min=3)] = 15,
    memory: Annotated[bool, flag("--memory/--no-memory", "Fly ten minutes for the peak memory.")] = True,
    beside: Annotated[Path | None, option("FILE", "Beside what --json wrote to FILE.", "--compare")] = None,
    json_: JsonOption = False,
) -> None:
    """Measure what a tick, a start and a flight's memory cost."""
    from cosim.bench import bench as work

    before = read_bench(beside) if beside else None
    with bar(err, "measuring", unit="") as progress:
        found = work(rounds=rounds, memory=memory, progress=progress)
    answer(json_, found, lambda _: compared(before, found) if before else shown(found))


def read_bench(path: Path) -> dict[str, Any]:
    """Return what `cosim bench --json` wrote to a file. Raises CosimError for another file."""
    try:
        found = from_json(read(path), place=str(path))
        if not all(value is None or isinstance(value, int | float) for value in _numbers(found).values()):
            raise TypeError
    except (CosimError, OSError, KeyError, TypeError, AttributeError) as error:
        remedy = "Write one: cosim bench --json > before.json"
        raise CosimError("is no outcome of `cosim bench --json`", place=str(path), remedy=remedy) from error
    return found


def compared(before: Mapping[str, Any], now: Mapping[str, Any]) -> Table:
    """Return the table of both: ratios to a yardstick of their own run, seconds, and the quotient now / before."""
    t = Table("Before and now", "what", "before>", "now>", "now / before>")
    old, new = _numbers(before), _numbers(now)
    for name in dict.fromkeys([*new, *old]):
        a, b = old.get(name), new.get(name)
        t.add(name, number(a), number(b), number(b / a) if a and b else DASH)
    return t


def _numbers(found):
    """Return {what: number} of an outcome, what is compared."""
    out = {f"{row['name']}, ratio to {row['against']}": row["ratio"] for row in found["cases"] if row["ratio"]}
    out |= {f"{row['id']}, batch [us per step]": row["batch_us"] for row in found["detectors"]}
    out |= {f"start: {name.removesuffix('_s')} [s]": value for name, value in found["startup"].items()}
    for name, what in (("peak_mb", "peak memory [MB]"), ("worker_mb", "memory of a worker [MB]")):
        if found.get(name):
            out[what] = found[name]
    for name, value in (found.get("per_flown_second") or {}).items():
        if value:
            out[f"{name.removesuffix('_kb')} per flown second [kB]"] = value
    for name in ("open_s", "frames_s", "topic_s", "parquet_s", "replay_s", "replay_cpu_s"):
        if name in (found.get("recorded") or {}):
            out[f"log: {name.removesuffix('_s')} [s]"] = found["recorded"][name]
    return out


def shown(found: dict[str, Any]) -> Group:
    """Return the tables of `cosim bench`."""
    t = Table("Cost per tick", "case", "µs/tick>", "ratio>", "spread>", "to")
    for r in found["cases"]:
        spread = DASH if r["spread"] is None else f"{100 * r['spread']:.0f} %"
        t.add(r["name"], number(r["us_per_tick"]), number(r["ratio"]), spread, r["against"] or "")
    recorded = found.get("recorded")
    again = recorded["replay_us"] if recorded else {}
    d = Table("Detectors, per step and lane", "detector", "lanes>", "live µs>", "batch µs>", "replay µs>")
    for r in found["detectors"]:
        costs = (r["live_us"], r["batch_us"], again.get(r["id"]))
        d.add(r["id"], str(r["lanes"]), *map(number, costs))
    rate, start = found["realtime_factor"], found["startup"]
    all_, minutes = f"{rate['with_detectors']:.0f} x", found["memory_flight_s"] / 60
    lines = [
        f"real time      {rate['lockstep']:.0f} x, with all eleven detectors {all_}, on one of {found['cores']} cores",
        f"warm start     {start['first_tick_cpu_s']:.2f} s of the processor to the first tick, "
        f"{start['run_cpu_s']:.2f} s for a run of 1 s, {start['flight_cpu_s']:.2f} s for the default flight and its "
        f"report; help {start['help_cpu_s']:.2f} s",
    ]
    if found["peak_mb"] is not None:
        lines += [
            f"peak memory    {number(found['peak_mb'])} MB in a flight of {minutes:.0f} minutes; a campaign's "
            f"worker {number(found['worker_mb'])} MB",
            f"a flown second {number(found['per_flown_second']['log_kb'])} kB of log, "
            f"{number(found['per_flown_second']['memory_kb'])} kB of memory",
        ]
    if recorded:
        r = recorded
        lines += [
            f"reading        {r['open_s'] + r['frames_s']:.2f} s for {r['minutes']:.0f} minutes of every signal "
            f"({r['values_mb']:.0f} MB of numbers) into pandas, {(r['open_s'] + r['frames_s']) / r['parquet_s']:.1f} "
            f"times pyarrow's for the same from Parquet; one topic {r['topic_s']:.2f} s",
            f"replay         {r['detectors_realtime']:.0f} x real time for every detector, "
            f"{r['replay_realtime']:.0f} x with reading and comparing",
        ]
    return Group(t, d, Text("\n".join(lines)))
