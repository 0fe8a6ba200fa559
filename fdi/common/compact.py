"""The text of what is stored in `fdi/designs/` and `fdi/thresholds/`: JSON, compact enough to read and to compare."""

import json
import textwrap

WIDTH = 120  # of a line


def text(data: dict) -> str:
    """Return `data` as JSON: what fits stands on one line, long lists of numbers wrap; numbers keep their bits."""
    return _text(json.loads(json.dumps(data)), 0) + "\n"  # tuples are lists, too


def _text(value, depth):
    whole = json.dumps(value)
    if len(whole) + depth <= WIDTH or not isinstance(value, dict | list):
        return whole
    inner = " " * (depth + 1)
    between = f",\n{inner}"
    if isinstance(value, dict):
        return "{" + between.join(f"{json.dumps(k)}: {_text(v, depth + 1)}" for k, v in value.items()) + "}"
    if any(isinstance(v, dict | list) for v in value):
        return "[" + between.join(_text(v, depth + 1) for v in value) + "]"
    return "[" + textwrap.fill(whole[1:-1], WIDTH - depth - 1, subsequent_indent=inner, break_on_hyphens=False) + "]"
