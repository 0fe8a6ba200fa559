"""Write TOML (the standard library only reads it): scalars and lists of them, tables and lists of them."""

import json
import re
from typing import Any


def dumps(table: dict[str, Any], above: str = "") -> str:
    """Return `table` (nested dicts, lists, str, bool, int, float), of the dotted key `above`, as TOML text in its
    order; None is left out."""
    lines, below = [], []
    for key, value in table.items():
        name = f"{above}{_key(key)}"
        if isinstance(value, dict):
            body = dumps(value, f"{name}.")
            below.append(body if body.startswith("\n") else f"\n[{name}]\n{body}")
        elif isinstance(value, list | tuple) and value and isinstance(value[0], dict):
            below += [f"\n[[{name}]]\n{dumps(item, f'{name}.')}" for item in value]
        elif value is not None:
            lines.append(f"{_key(key)} = {inline(value)}\n")
    return "".join(lines + below)


def _key(key):
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else inline(key)


def inline(value: Any) -> str:
    """Return a value as TOML on one line, a table in braces; one that TOML does not have as Python writes it."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(k)} = {inline(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(inline, value)) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f") if isinstance(value, str) else repr(value)
