"""Keep an estimator as plain numbers in `fdi/designs/`, so that a flight needs no solver."""

from dataclasses import asdict, fields, replace
from typing import Any

import numpy as np

from fdi.common.compact import read
from fdi.rfafe.discrete import Discrete, discretise
from fdi.rfafe.synthesis import Design, Region, Report

_COMPLEX = ("fixed_modes", "eigenvalues_N", "eigenvalues_loop")


def to_plain(design: Any) -> Any:
    """Return a Design as nested dicts and lists that JSON can hold; complex numbers become [re, im]."""

    def plain(value):
        if isinstance(value, np.ndarray):
            return value.tolist()
        if isinstance(value, dict):
            return {k: plain(v) for k, v in value.items()}
        if isinstance(value, tuple | list):
            return [plain(v) for v in value]
        return [value.real, value.imag] if isinstance(value, complex) else value

    return plain(asdict(design))


def from_plain(plain: Any) -> Any:
    """Return the Design of `to_plain`; ValueError when a field is missing; of an older one some are not used."""
    sizes = {"n": len(plain["A"]), "m": len(plain["C"]), "r": _width(plain["B"]), "q": _width(plain["E"])}
    shapes = {"E": ("n", "q"), "B": ("n", "r"), "D": ("m", "r")}

    def matrix(name, value):
        out = np.array(value, float)
        return out.reshape([sizes[s] for s in shapes[name]]) if name in shapes else out

    report = dict(plain["report"])
    for name in _COMPLEX:
        report[name] = tuple(complex(*pair) for pair in report[name])
    report["tracking"] = tuple((hz, complex(*pair)) for hz, pair in report["tracking"])
    report["singular_CE"], report["bandwidth"] = tuple(report["singular_CE"]), tuple(report["bandwidth"])
    made = {"region": _make(Region, plain["region"]), "report": _make(Report, report)}
    made["discrete"] = _make(Discrete, {k: v if k == "dt" else matrix(k, v) for k, v in plain["discrete"].items()})
    numbers = {k: v if isinstance(v, float | int) else matrix(k, v) for k, v in plain.items() if k not in made}
    return _make(Design, {**numbers, **made})


def choose(stored: Any, technology: Any, dt: Any) -> Any:
    """Return (Design, entry) for `technology` of a stored file (name or content), its discrete form made for `dt` [s].

    `technology` is that of both sides, or "left/right"; a file without any pair is of a form that knows no sides and
    takes sides that differ as "mixed". Raises ValueError for a technology that the file lacks.
    """
    stored = read(stored) if isinstance(stored, str) else stored
    key = _key(technology, stored)
    if key not in stored["designs"]:
        raise ValueError(_no_design(technology, stored))
    entry = stored["designs"][key]
    design = from_plain(entry["design"])
    return design if design.dt == dt else at_tick(design, dt), entry


def lacks(name: str, technologies: Any, own: Any) -> str:
    """Return why design `name` of folder `own` (None: the bundled one) has none for these elevators, or ""."""
    kind, stored = side_kinds(technologies), read(name, own)
    return "" if _key(kind, stored) in stored["designs"] else _no_design(kind, stored)


def _key(technology, stored):
    """Return the key of a design in `stored`: a file without any pair knows no sides."""
    pairs = any("/" in kind for kind in stored["designs"])
    return "mixed" if "/" in technology and not pairs else technology


def _no_design(kind, stored):
    return f"no design for {kind} elevators; there is {', '.join(sorted(stored['designs']))}"


def at_tick(design: Any, dt: float) -> Any:
    """Return `design` with its discrete form for ticks of `dt` seconds: no solver is needed for that."""
    d = design
    discrete = discretise(N=d.N, T=d.T, K=d.K, H=d.H, C=d.C, B=d.B, D=d.D, TF=d.T @ d.F, gain=d.Gamma @ d.M,
                          alpha=d.alpha, dt=dt)
    return replace(design, dt=dt, discrete=discrete)


def _make(kind, values):
    names = [f.name for f in fields(kind)]
    if lacks := sorted(set(names) - set(values)):
        raise ValueError(f"a stored {kind.__name__} lacks {lacks}; mend: `python -m cosim.training designs`")
    return kind(**{name: values[name] for name in names})


def _width(rows):
    return len(rows[0]) if rows else 0


def side_kinds(technologies: Any) -> Any:
    """Return the key of the stored design for elevators of `technologies`, {segment: technology}: one word when both
    sides are alike, a kind or "mixed", else "left/right".
    """
    left, right = (_kind([t for s, t in technologies.items() if s.startswith(side)]) for side in ("left", "right"))
    return left if left == right else f"{left}/{right}"


def _kind(kinds):
    """Return the kind of a side with segments of these kinds."""
    return kinds[0] if len(set(kinds)) == 1 else "mixed"
