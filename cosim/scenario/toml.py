"""Write TOML (the standard library only reads it): scalars and lists of them, tables and lists of them."""

import json
import re
from collections.abc import Sequence
from typing import Any


def dumps(table: dict[str, Any], path: Sequence[str] = ()) -> str:
    """Return `table` (nested dicts, lists, str, bool, int, float) as TOML text in its order; None is left out."""
    lines, below = [], []
    for key, value in table.items():
        name = (*path, key)
        if isinstance(value, dict):
            body = dumps(value, name)
            below.append(body if body.startswith("\n") else f"\n[{_dotted(name)}]\n{body}")
        elif isinstance(value, list | tuple) and value and isinstance(value[0], dict):
            below += [f"\n[[{_dotted(name)}]]\n{dumps(item, name)}" for item in value]
        elif value is not None:
            lines.append(f"{_key(key)} = {inline(value)}\n")
    return "".join(lines + below)


def _dotted(name):
    return ".".join(map(_key, name))


def _key(key):
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _text(key)


def _text(text):
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def inline(value: Any) -> str:
    """Return a value as TOML on one line, a table in braces."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(k)} = {inline(v)}" for k, v in value.items()) + "}"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        return _text(value)
    return "[" + ", ".join(map(inline, value)) + "]"
