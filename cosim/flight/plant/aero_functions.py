"""Read and evaluate the aerodynamic functions of a JSBSim aircraft, so that no coefficient is typed twice.

    aero = AeroFunctions(folder)
    aero.evaluate("LIFT", {"aero/alpha-rad": 0.1, "velocities/mach": 0.6, ...})

Values may be arrays that broadcast. A property that is not given is, in this order, a function of the file, a
`<property value=>` of one of its systems, or 0 (a surface at rest). Tables hold their end values outside, as JSBSim
does. Units are the file's (lb, ft, rad).
"""

import functools
import hashlib
import operator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

METRICS = {"wingarea": "metrics/Sw-sqft", "wingspan": "metrics/bw-ft", "chord": "metrics/cbarw-ft"}


def _folded(join):
    """Return an operation of any number of operands."""
    return lambda *parts: functools.reduce(join, parts)


_OPERATIONS: dict = {
    "sin": np.sin, "cos": np.cos, "tan": np.tan, "abs": np.abs, "exp": np.exp, "sqrt": np.sqrt, "ln": np.log,
    "quotient": operator.truediv, "pow": operator.pow, "product": _folded(operator.mul), "sum": _folded(operator.add),
    "difference": _folded(operator.sub), "min": _folded(np.minimum), "max": _folded(np.maximum),
}  # fmt: skip


class AeroFunctions:
    """Hold the parsed functions of one aircraft, by axis, and all breakpoints by property."""

    def __init__(self, folder: str | Path):
        """Parse <folder>/<name>.xml and the aerodynamics and systems files that it names."""
        folder = Path(folder)
        self.root = ElementTree.parse(folder / f"{folder.name}.xml").getroot()
        self.defaults = {METRICS[k]: number(self.root, f"metrics/{k}") for k in METRICS}
        for system in self.root.iter("system"):
            tree = ElementTree.parse(folder / "Systems" / f"{system.get('file')}.xml").getroot()
            given = [(p.text or "", p.get("value")) for p in tree.iter("property")]
            self.defaults |= {name.strip(): float(value) for name, value in given if value}
        aero = find(self.root, "aerodynamics")
        if aero.get("file"):
            aero = ElementTree.parse(folder / f"{aero.get('file')}.xml").getroot()
        self.functions = {f.get("name"): f for f in aero.iter("function")}
        self.axes = {axis.get("name"): list(axis.iter("function")) for axis in aero.iter("axis")}
        self.breakpoints = _breakpoints(aero)

    def evaluate(self, axis: str, given: dict) -> float:
        """Return the sum of an axis' functions, lb or lb ft, at the properties `given`."""
        cache = dict(given)
        return functools.reduce(operator.add, (self._function(f, cache) for f in self.axes.get(axis, [])), 0.0)

    def _property(self, name, cache):
        if name not in cache:
            found = self.functions.get(name)
            cache[name] = self.defaults.get(name, 0.0) if found is None else self._function(found, cache)
        return cache[name]

    def _function(self, element, cache):
        parts = [e for e in element if e.tag != "description"]
        if len(parts) != 1:
            raise ValueError(f"function {element.get('name')!r} holds {len(parts)} expressions, not one")
        return self._expression(parts[0], cache)

    def _expression(self, e, cache):
        if e.tag in ("v", "value"):
            return float(e.text)
        if e.tag in ("p", "property"):
            return self._property(e.text.strip(), cache)
        if e.tag == "table":
            names, axes, values = _table(e)
            return _lookup(axes, values, [self._property(name, cache) for name in names])
        if e.tag not in _OPERATIONS:
            raise ValueError(f"<{e.tag}> is not known here")
        return _OPERATIONS[e.tag](*(self._expression(c, cache) for c in e if c.tag != "description"))


def find(element: Any, path: str | Path) -> Any:
    """Return the child at `path`; ValueError when there is none."""
    child = element.find(path)
    if child is None:
        raise ValueError(f"<{element.tag}> has no {path}")
    return child


def number(element: Any, path: str | Path) -> float:
    """Return the number that the child at `path` holds."""
    return float(find(element, path).text or "nan")


def numbers_digest(folder: str | Path) -> str:
    """Return a hash over every number and name in the XML files of an aircraft, blind to layout and comments."""
    digest = hashlib.sha256()
    for path in sorted(Path(folder).rglob("*.xml")):
        for element in ElementTree.parse(path).getroot().iter():
            own = [f"{k}={v}" for k, v in sorted(element.attrib.items())]
            words = [str(element.tag), *own, *(element.text or "").split()]
            digest.update(" ".join(_canonical(w) for w in words).encode() + b"\n")
    return digest.hexdigest()


def _canonical(word):
    try:
        return f"{float(word):.12g}"
    except ValueError:
        return word


@functools.cache
def _table(element):
    """Return (properties, breakpoints, values) of a one- or two-dimensional table."""
    variables = [v for v in element if v.tag == "independentVar"]
    names = [v.text.strip() for v in variables]
    data = element.findall("tableData")
    if len(data) != 1 or not 1 <= len(names) <= 2:
        raise ValueError(f"tables over {', '.join(names)}: only one and two dimensions are read")
    lines = [np.array(line.split(), float) for line in data[0].text.strip().splitlines() if line.strip()]
    if len(names) == 1:
        rows = np.array(lines)
        return names, (rows[:, 0],), rows[:, 1]
    body = np.array(lines[1:])
    return names, (body[:, 0], lines[0]), body[:, 1:]


def _lookup(axes, values, at):
    if len(axes) == 1:
        return np.interp(at[0], axes[0], values)
    (i, f), (j, g) = (_place(axis, x) for axis, x in zip(axes, at))
    low = values[i, j] * (1 - g) + values[i, j + 1] * g
    high = values[i + 1, j] * (1 - g) + values[i + 1, j + 1] * g
    return low * (1 - f) + high * f


def _place(axis, x):
    x = np.clip(x, axis[0], axis[-1])
    i = np.clip(np.searchsorted(axis, x, side="right") - 1, 0, len(axis) - 2)
    return i, (x - axis[i]) / (axis[i + 1] - axis[i])


def _breakpoints(aero):
    """Return {property: sorted breakpoints of all tables over it}."""
    out: dict = {}
    for table in aero.iter("table"):
        names, axes, _ = _table(table)
        for name, axis in zip(names, axes):
            out[name] = np.union1d(out.get(name, []), axis)
    return out
