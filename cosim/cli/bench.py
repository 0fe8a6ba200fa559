"""Two states of the code beside each other, by what `cosim bench --json` measured of each."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.table import Table

from cosim.cli.tables import NOTHING, number, table
from cosim.errors import CosimError
from cosim.texts import from_json, read


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
    t = table("Before and now", "what", "before>", "now>", "now / before>")
    old, new = _numbers(before), _numbers(now)
    for name in dict.fromkeys([*new, *old]):
        a, b = old.get(name), new.get(name)
        t.add_row(name, number(a), number(b), number(b / a) if a and b else NOTHING)
    return t


def _numbers(found):
    """Return {what: number} of an outcome, what is compared."""
    out = {f"{row['name']}, ratio to {row['against']}": row["ratio"] for row in found["cases"] if row["ratio"]}
    out |= {f"{row['id']}, batch [us per step]": row["batch_us"] for row in found["detectors"]}
    out |= {f"start: {name.removesuffix('_s')} [s]": value for name, value in found["startup"].items()}
    for name, what in (("peak_mb", "peak memory [MB]"), ("worker_mb", "memory of a worker [MB]")):
        if found.get(name):
            out[what] = found[name]
    out |= {f"growth over {line['over']} [{line['unit']} each]": line["slope"] for line in found.get("growth", ())}
    for name in ("open_s", "frames_s", "topic_s", "replay_s"):
        if found.get("recorded"):
            out[f"log: {name.removesuffix('_s')} [s]"] = found["recorded"][name]
    return out
