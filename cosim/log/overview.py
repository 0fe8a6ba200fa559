"""What `cosim info` tells about a log, as plain data."""

import os
from pathlib import Path
from typing import Any

SCENARIO = "scenario.toml"  # attachment with the expanded scenario


def log_info(path: str | Path) -> dict[str, Any]:
    """Return {log, complete, problem, title, status, duration_s, rate_hz, ticks, gaps, versions, topics, ...}.

    `problem` says why the strict reader refuses a log, which is then described by what is whole of it. Raises LogError
    when there is nothing to describe.
    """
    from cosim.errors import LogError
    from cosim.log import open_log

    try:
        log, problem = open_log(path), None
    except LogError as error:
        log, problem = open_log(path, tolerant=True), str(error)
    ticks = sum(log.spans[-1]) if log.spans else 0
    scenario = log.attachments.get(SCENARIO, b"").decode("utf-8", "replace")
    return {
        "log": str(path), "complete": log.complete, "problem": problem, "recovered": "recovered" in log.metadata,
        "title": log.metadata.get("run", {}).get("title", ""), "status": (log.result or {}).get("status", ""),
        "duration_s": ticks * log.dt_ns / 1e9, "rate_hz": 1e9 / log.dt_ns if log.dt_ns else 0.0, "ticks": log.n_ticks,
        "gaps": ticks - log.n_ticks, "size_mb": round(os.path.getsize(path) / 1e6, 2),
        "versions": {**{k: v for k, v in log.metadata.get("run", {}).items() if k == "software"},
                     **log.metadata.get("libraries", {})},
        "result": dict(log.result or {}),
        "topics": [{"name": t.name, "rows": t.rows, "every": t.every, "fields": list(t.fields),
                    "units": list(t.units)} for t in log.topics.values()],
        "attachments": list(log.attachments), "scenario": scenario,
    }  # fmt: skip
