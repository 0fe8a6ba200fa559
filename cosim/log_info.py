"""What `cosim info` tells about a log, as plain data."""

import os

SCENARIO = "scenario.toml"  # attachment with the expanded scenario


def log_info(path):
    """Return {log, complete, title, status, duration_s, rate_hz, ticks, versions, topics, ...}; raises LogError."""
    from cosim.log import open_log

    log = open_log(path)
    scenario = log.attachments.get(SCENARIO, b"").decode("utf-8", "replace")
    return {
        "log": str(path),
        "complete": log.complete,
        "title": _title(scenario),
        "status": (log.result or {}).get("status", ""),
        "duration_s": log.n_ticks * log.dt_ns / 1e9,
        "rate_hz": 1e9 / log.dt_ns,
        "ticks": log.n_ticks,
        "size_mb": round(os.path.getsize(path) / 1e6, 2),
        "versions": {
            **{k: v for k, v in log.metadata.get("run", {}).items() if k == "software"},
            **log.metadata.get("libraries", {}),
        },
        "result": dict(log.result or {}),
        "topics": [
            {"name": t.name, "rows": t.rows, "every": t.every, "fields": list(t.fields)} for t in log.topics.values()
        ],
        "attachments": list(log.attachments),
        "scenario": scenario,
    }


def _title(scenario):
    import tomllib

    try:
        return tomllib.loads(scenario).get("title", "")
    except tomllib.TOMLDecodeError:
        return ""
