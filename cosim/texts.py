"""Read TOML and JSON that others wrote: bounded in size, depth and digits; each mistake one error with its place.

The parsers themselves raise more than their own errors (deep nesting, integers of thousands of digits), and what they
let through breaks whoever walks it: dotted keys nest without end, integers grow beyond a float. Both end here.
"""

import collections
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


def toml_lines(text: str) -> dict[tuple[str, ...], int]:
    """Return {parts of a key: its line from 1} of every key, table and list entry of valid TOML `text`; an entry of a
    list has its index as a part.
    """
    found: dict[tuple[str, ...], int] = {}
    last: dict[tuple[str, ...], int] = {}  # index of the newest table of a list of tables
    tokens = _tokens(text)
    table: tuple[str, ...] = ()
    while tokens:
        line, word = tokens[0]
        if word == "\n":
            tokens.popleft()
        elif word == "[":
            several = len(tokens) > 1 and tokens[1][1] == "["
            for _ in range(1 + several):
                tokens.popleft()
            parts, table = _toml_key(tokens), ()
            for n, part in enumerate(parts, 1):
                table += (part,)
                if several and n == len(parts):
                    last[table] = last.get(table, -1) + 1
                if table in last:
                    found.setdefault(table, line)
                    table += (str(last[table]),)
                found.setdefault(table, line)
            while tokens and tokens[0][1] != "\n":
                tokens.popleft()
        else:
            _toml_pair(tokens, table, found)
    return found


_TOKEN = re.compile(
    r'[ \t\r]+|#[^\n]*|(?P<token>\n|"""(?:\\.|[^\\])*?"{3,5}|\'{3}.*?\'{3,5}|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\''
    r'|[\[\]{}=,.]|[^\s\[\]{}=,."\'#]+)',
    re.S,
)


def _tokens(text):
    """Return the tokens of TOML as a queue of (line, token), without blanks and comments."""
    out: collections.deque[tuple[int, str]] = collections.deque()
    line = 1
    for match in _TOKEN.finditer(text):
        if match["token"]:
            out.append((line, match["token"]))
        line += match[0].count("\n")
    return out


def _toml_key(tokens):
    parts = []
    while True:
        word = tokens.popleft()[1]
        parts.append(tomllib.loads(f"x={word}")["x"] if word[0] in "\"'" else word)
        if not tokens or tokens[0][1] != ".":
            return parts
        tokens.popleft()


def _toml_pair(tokens, table, found):
    line = tokens[0][0]
    for part in _toml_key(tokens):
        table += (part,)
        found.setdefault(table, line)
    tokens.popleft()  # =
    _toml_value(tokens, table, found)


def _toml_value(tokens, path, found):
    """Take a value from the queue; what a list or a table in braces holds is found, too."""
    opened = tokens[0][1]
    if opened not in ("[", "{"):
        while tokens and tokens[0][1] not in (",", "]", "}", "\n"):
            tokens.popleft()
        return
    tokens.popleft()
    n = 0
    while tokens[0][1] not in ("]", "}"):
        if tokens[0][1] in (",", "\n"):
            tokens.popleft()
        elif opened == "{":
            _toml_pair(tokens, path, found)
        else:
            found[*path, str(n)] = tokens[0][0]
            _toml_value(tokens, (*path, str(n)), found)
            n += 1
    tokens.popleft()


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


def unpaired_surrogate(text: str) -> bool:
    """Tell whether `text` contains an unpaired surrogate, as JSON and a command line may: no file can be written with
    it."""
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
        elif isinstance(node, str) and unpaired_surrogate(node):
            raise error("contains an unpaired surrogate", place=place, remedy="Write it in UTF-8")
        elif isinstance(node, int) and not -INTEGER <= node < INTEGER:
            raise error("holds an integer beyond 64 bits", place=place, remedy="Write it as a float")
    return value


def _said(wrong: BaseException) -> str:
    if isinstance(wrong, RecursionError):
        return "nested too deeply"
    return "an integer with too many digits" if "limit" in str(wrong) and "digits" in str(wrong) else str(wrong)
