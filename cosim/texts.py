"""Read TOML and JSON that others wrote: bounded in size, depth and digits; each mistake one error with its place.

The parsers themselves raise more than their own errors (deep nesting, integers of thousands of digits), and what they
let through breaks whoever walks it: dotted keys nest without end, integers grow beyond a float. Both end here.
"""

import datetime
import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cosim.errors import CosimError
from cosim.files import regular

LARGEST = 1_000_000  # bytes of a file of ours: a page of text
DEPTH = 16  # tables and lists inside one another
INTEGER = 2**63  # largest magnitude
_SURROGATE = re.compile("[\ud800-\udfff]")
_PART = r"[\w\"'-]"  # of a key
# it starts where a part does and takes nothing back: a long word is read once, not once from each of its letters
_DOTTED = re.compile(rf"(?<!{_PART})(?:{_PART}++[ \t]*+\.[ \t]*+){{{2 * DEPTH}}}")


def toml(text: str, *, place: str, error: type[CosimError] = CosimError) -> dict[str, Any]:
    """Return the tables of TOML `text`; raises `error` at `place`."""
    if len(text) > LARGEST:
        raise error("is too large", place=place, allowed="up to 1 MB")
    if _DOTTED.search(text):
        raise error("not valid TOML: a key with too many dots", place=place, allowed=f"{DEPTH} levels")
    try:
        return _bounded(tomllib.loads(text), place, error)
    except (ValueError, RecursionError, OverflowError) as wrong:
        raise error(f"not valid TOML: {_said(wrong)}", place=place) from None


def from_json(text: str | bytes, *, place: str, error: type[CosimError] = CosimError, largest: int = LARGEST) -> Any:
    """Return the value of JSON `text` of at most `largest` bytes; raises `error` at `place`."""
    if len(text) > largest:
        raise error("is too large", place=place, allowed=f"up to {largest / 1e6:g} MB")
    try:
        return _bounded(json.loads(text), place, error)
    except (ValueError, RecursionError, OverflowError) as wrong:  # UnicodeDecodeError is a ValueError
        raise error(f"not valid JSON: {_said(wrong)}", place=place) from None


def read(path: str | Path, *, error: type[CosimError] = CosimError, what: str = "file") -> str:
    """Return the text of a regular file of at most 1 MB in UTF-8; raises `error`, FileNotFoundError stays itself."""
    path = Path(path)
    try:
        regular(path, error)
        with path.open("rb") as file:
            raw = file.read(LARGEST + 1)
        if len(raw) > LARGEST:
            raise error(f"too large for a {what}", place=str(path), allowed="up to 1 MB")
        return raw.decode("utf-8-sig")
    except FileNotFoundError:
        raise
    except UnicodeDecodeError as wrong:
        raise error(f"is not UTF-8 text (byte {wrong.start})", place=str(path), remedy="Save it as UTF-8") from None
    except (OSError, ValueError) as wrong:
        raise error(f"cannot be read: {getattr(wrong, 'strerror', None) or wrong}", place=str(path)) from None


def half_letter(text: str) -> bool:
    """Tell whether `text` holds a lone surrogate, as JSON and a command line may: no file can be written with it."""
    return not text.isascii() and _SURROGATE.search(text) is not None


def _bounded(value: Any, place: str, error: type[CosimError]) -> Any:
    """Return `value` when nothing in it is too deep or too large; without recursion, whatever it holds."""
    todo = [(value, 0)]
    while todo:
        node, depth = todo.pop()
        if depth > DEPTH:
            raise error("is nested too deeply", place=place, allowed=f"{DEPTH} levels")
        if isinstance(node, Mapping):
            todo += [(item, depth + 1) for pair in node.items() for item in pair]
        elif isinstance(node, list):
            todo += [(item, depth + 1) for item in node]
        elif isinstance(node, datetime.date | datetime.time):
            raise error(f"holds a date or a time, {node}", place=place, remedy="Write it as text, in quotes")
        elif isinstance(node, str) and half_letter(node):
            raise error("holds half a letter (a lone surrogate)", place=place, remedy="Write it in UTF-8")
        elif isinstance(node, int) and not -INTEGER <= node < INTEGER:
            raise error("holds an integer beyond 64 bits", place=place, remedy="Write it as a float")
    return value


def _said(wrong: BaseException) -> str:
    if isinstance(wrong, RecursionError):
        return "nested too deeply"
    return "an integer with too many digits" if "limit" in str(wrong) and "digits" in str(wrong) else str(wrong)
