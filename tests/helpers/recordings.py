"""Recordings as others make them: MCAP files of JSON messages."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mcap.writer import Writer

ZERO = 1_700_000_000_000_000_000  # [ns]


def write_json(path: Path, messages: Iterable[tuple[str, int, Any]], published: Any = None, **how: Any) -> Path:
    """Write (channel, log time [ns], message) to an MCAP file; "/act B" is a second channel of the topic /act.

    `published` gives the publish time of a log time, `how` is the writer's.
    """
    with path.open("wb") as file:
        writer, channels = Writer(file, **how), {}
        writer.start()
        schema = writer.register_schema("x", "jsonschema", b"{}")
        for name, at, message in messages:
            if name not in channels:
                channels[name] = writer.register_channel(name.split()[0], "json", schema, {"callerid": name})
            sent = published(at) if published else at
            writer.add_message(channels[name], at, json.dumps(message).encode(), sent)
        writer.finish()
    return path
