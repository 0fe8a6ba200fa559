"""When a fault begins: `when = "n_z > 1.2 and t > 5"`. Read by Python's own parser, never evaluated as code.

    condition   = comparison, joined by `and` and `or`; `and` binds first, parentheses group
    comparison  = signal (< | <= | > | >=) number

A signal is `t` [s], a word of `cosim list signals` ("n_z", "left_inner.rod": what is measured), a name of the bus
("truth.aircraft.nz", "iotsekf.left_inner.alarm"), or another fault's: `fault.0.active` is 1 while fault 0 is there,
`fault.0.since` the seconds since it began. SI units and radians. A signal that is not valid fulfils nothing, nor does
a fault that has not begun.
"""

import ast
import functools
import operator
import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from cosim.errors import ScenarioError
from cosim.scenario import vocabulary

if TYPE_CHECKING:
    import numpy as np

TIME = "t"
OF_FAULT = re.compile(r"fault\.(\d{1,4})\.(active|since)")
LONGEST = 2000  # characters
COMPARE: dict[type, Callable] = {ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge}


def true(tree: ast.expr, values: "Mapping[str, np.ndarray]") -> "np.ndarray":
    """Return at which ticks a condition holds (ticks,), from {signal: values (ticks,)}."""
    if isinstance(tree, ast.BoolOp):
        join = operator.and_ if isinstance(tree.op, ast.And) else operator.or_
        return functools.reduce(join, (true(part, values) for part in tree.values))
    assert isinstance(tree, ast.Compare)
    return COMPARE[type(tree.ops[0])](values[_name(tree.left)], _number(tree.comparators[0]))


def signals(tree: ast.expr) -> tuple[str, ...]:
    """Return the names of the signals of a condition."""
    names = (_name(node.left) for node in ast.walk(tree) if isinstance(node, ast.Compare))
    return tuple(dict.fromkeys(names))


def condition(text: str) -> ast.expr:
    """Return the condition that `text` says: comparisons of signals with numbers, joined by `and` and `or`, as a syntax
    tree. Raises ScenarioError with what is wrong."""
    try:
        if len(text) > LONGEST or "#" in text:  # a comment of Python's
            raise ValueError
        text = re.sub(r"\b(AND|OR)\b", lambda word: word[0].lower(), " ".join(text.split()))
        words = re.sub(r"(?<=[A-Za-z_])\.(?=\d)", "._", text)  # fault.0 becomes a name of Python's
        tree = ast.parse(words, mode="eval").body
        _check(tree)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise _wrong("is no condition") from None
    return tree


def _name(node):
    """Return the name of a signal as it was written."""
    return ast.unparse(node).replace("._", ".")


def _check(node):
    if isinstance(node, ast.BoolOp):
        for part in node.values:
            _check(part)
        return
    compares = isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in COMPARE
    if not compares or not isinstance(node.left, ast.Name | ast.Attribute | ast.Subscript):
        raise _wrong("a part is no comparison of a signal with a number")
    name = _name(node.left)
    if _number(node.comparators[0]) is None:
        raise _wrong(f"{name} is not compared with a number")
    if name.startswith("fault.") and not OF_FAULT.fullmatch(name):
        raise _wrong(f"{name!r} is no signal", "Say fault.0.active or fault.0.since")
    if name == TIME or name.count(".") > 1:
        return
    try:
        signal = vocabulary.find(name)
    except KeyError as error:
        raise _wrong(error.args[0], "`cosim list signals` has them") from None
    if signal.technologies and "." not in name:
        raise _wrong(f"{name!r} needs a segment", f"For example left_inner.{name}")


def _number(node):
    """Return the number that a node of the tree says, None where it says none."""
    try:
        value = ast.literal_eval(node)
    except ValueError:
        return None
    return float(value) if type(value) in (int, float) else None


def other_fault(name: str) -> int | None:
    """Return the number of the fault that a condition's signal is of, None for other signals."""
    found = OF_FAULT.fullmatch(name)
    return int(found[1]) if found else None


def _wrong(problem, remedy=""):
    return ScenarioError(problem, allowed="comparisons such as 'n_z > 1.2', joined by and, or", remedy=remedy)
