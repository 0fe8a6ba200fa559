"""Make a readable log of what a killed run, a full disk or a damaged disk has left."""

import dataclasses
import io
import os
from pathlib import Path
from typing import Any

from .compression import compressor
from .format import Limits, log_error
from .load import drop_damaged_chunks, load_chunk
from .message_layout import HEAD
from .record_writer import Sink
from .records import pack_chunk
from .validate import scan


def recover(path: str | Path, out: str | Path, *, limits: Any = None) -> dict[str, Any]:
    """Write every whole chunk of the log at `path` to a new log at `out` and return a report.

    The report: `out`, `chunks`, `ticks`, `duration_s`, `complete` (nothing of the run was lost), `parameters_intact`
    (all before the first tick is as written), `lost`, a list of {offset, bytes, reason}, and `cut`, that all of it
    stands behind the last whole chunk. The new log holds it as metadata `recovered`.
    Raises LogError when nothing can be read, or `out` is the log itself; or when it cannot be written, and what was
    there stays.
    """
    if os.path.exists(out) and os.path.exists(path) and os.path.samefile(path, out):
        raise log_error("a log cannot be recovered onto itself", os.fspath(out), remedy="Give another place (-o).")
    found = scan(path, limits or Limits(), tolerant=True)
    drop_damaged_chunks(found)
    metadata = {r.name: r.metadata for _, _, r in found.metadata if r.name not in ("preamble", "recovered")}
    result = metadata.pop("result", None)
    result = result if found.whole else None
    ticks = sum(found.ticks(chunk)[1] for chunk in found.chunks)
    lost = [{"offset": d.offset, "bytes": d.length, "reason": d.reason} for d in found.damage]
    texts = {"ticks": str(ticks), "parameters_intact": str(found.trusted).lower()}
    texts |= {f"lost {i}": f"{d.length} bytes at {d.offset}: {d.reason}" for i, d in enumerate(found.damage)}
    _rewrite(found, out, {**metadata, "recovered": texts}, result)
    last = found.chunks[-1] if found.chunks else None
    cut = last is not None and all(d.offset >= last.offset + last.length + last.index_length for d in found.damage)
    end = (last.end_ns + found.dt_ns) / 1e9 if last else 0.0
    return {
        "out": os.fspath(out), "chunks": len(found.chunks), "ticks": ticks, "duration_s": end,
        "complete": result is not None, "parameters_intact": found.trusted, "lost": lost, "cut": cut,
    }  # fmt: skip


def compact(path: str | Path, out: str | Path, *, limits: Any = None) -> dict[str, Any]:
    """Write the log at `path` to `out` with the same samples in fewer bytes, and return {out, bytes, before}.

    Every message, time and attachment, and so the hash of the content, is as it was; replay gives the same bits. `out`
    may be the log itself. Raises LogError for a log that is not whole, or when `out` cannot be written.
    """
    found, before = scan(path, limits or Limits()), os.path.getsize(path)
    metadata = {r.name: r.metadata for _, _, r in found.metadata if r.name != "preamble"}
    result = metadata.pop("result", None)
    _rewrite(found, out, metadata, result, compressor("zstd"))
    return {"out": os.fspath(out), "bytes": os.path.getsize(out), "before": before}


def _rewrite(found, out, metadata, result, compress=None):
    """Write a log of what was found; chunks are copied as they are compressed, or anew, their indexes made anew."""
    declared = [(c.topic, s.name, s.data, c.metadata) for s, c in zip(found.schemas, found.channels)]
    attachments = {r.name: (r.media_type, r.data) for _, _, r in found.attachments}
    sink = Sink(out, kept=False)
    try:
        with open(found.path, "rb") as file:
            sink.preamble(declared, metadata, attachments)
            for chunk in found.chunks:
                sink.chunk(*_repack(found, file, chunk, sink.offset, compress))
        if result is not None:
            sink.metadata("result", result)
        sink.finish()
    finally:
        sink.drop()


def _repack(found, file, chunk, offset, compress):
    file.seek(chunk.data_offset)
    held = file.read(chunk.data_size)  # once: what is checked is what is copied, whatever happens to the log meanwhile
    plan, content, tail = load_chunk(found, io.BytesIO(held), dataclasses.replace(chunk, data_offset=0))
    entries: dict = {}
    at, (k0, n) = plan.size, found.ticks(chunk)
    for channel, k, data in tail:
        entries.setdefault(channel, []).append((k * found.dt_ns, at))
        at += HEAD.itemsize + len(data)
    data, kind = ([compress(content)], "zstd") if compress else ([held], chunk.compression)
    return pack_chunk(found.layout, content, data, kind, k0, n, entries, offset)
