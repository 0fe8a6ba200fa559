"""Make a readable log of what a killed run, a full disk or a damaged disk has left."""

import os
from pathlib import Path
from typing import Any

from mcap.records import Metadata

from cosim.files import LOG, replace

from .format import log_error
from .log_file import LogFile
from .walker import load, scan


def recover(path: str | Path, out: str | Path) -> dict[str, Any]:
    """Write every whole chunk of the log at `path` to a new log at `out` and return a report.

    The report: `out`, `chunks`, `ticks`, `duration_s`, `complete` (nothing of the run was lost), `lost`, a list of
    {offset, bytes, reason}, and `cut`, that all of it stands behind the last whole chunk. The new log holds it as
    metadata `recovered`. Raises LogError when nothing can be read, or `out` is the log itself; or when it cannot be
    written, and what was there stays.
    """
    if os.path.exists(out) and os.path.exists(path) and os.path.samefile(path, out):
        raise log_error("a log cannot be recovered onto itself", os.fspath(out), remedy="Give another place (-o).")
    found = scan(path, tolerant=True)
    result = found.metadata.get("result") if found.whole else None
    ticks = sum(found.ticks(chunk)[1] for chunk in found.chunks)
    texts = {f"lost {i}": "{bytes} bytes at {offset}: {reason}".format(**d) for i, d in enumerate(found.damage)}
    replace(out, lambda part: _rewrite(found, part, {"ticks": str(ticks), **texts}, result), LOG)
    last = found.chunks[-1] if found.chunks else None
    return {
        "out": os.fspath(out), "chunks": len(found.chunks), "ticks": ticks,
        "duration_s": (last.end_ns + found.dt_ns) / 1e9 if last else 0.0, "complete": result is not None,
        "lost": found.damage, "cut": last is not None and all(d["offset"] >= last.end for d in found.damage),
    }  # fmt: skip


def _rewrite(found, out, recovered, result):
    """Write a log of what was found; chunks are copied as they are compressed."""
    file = LogFile(out, kept=False)
    kept = [r for r in found.records if not (isinstance(r, Metadata) and r.name == "recovered")]
    try:
        with open(found.path, "rb") as old:
            file.preamble([*kept, Metadata("recovered", recovered)])
            for chunk in found.chunks:
                data, content = load(found, old, chunk)
                times, index = (chunk.start_ns, chunk.end_ns), found.layout.index(content, *found.ticks(chunk))
                file.chunk(data, chunk.compression, times, chunk.size, chunk.crc, index)
        file.finish({"result": result} if result else {})
    finally:
        file.drop()
