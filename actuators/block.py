"""The block: the one contract that everything stepped in the testbed keeps.

A block is a module with

    PARAMS, INPUTS, STATE   structured dtypes made by `dtype`, every element f8 (arrays too), unit beside each field
    OUTPUTS                 names of the STATE fields that are logged at every tick; the others are hidden state
    params(...) -> PARAMS   one record, ordinary NumPy/SciPy; design happens here
    init(p) -> STATE        records of the same shape as `p`, the state before the first tick
    step(x, u, p, dt)       kernel: advances one record `x` in place from inputs `u`
    rollout(x, u, p, dt, log)
                            kernel: every lane through every tick; x, p: (lane,), u, log: (lane, tick), log in STATE

`rollout` is the only entry point: live it is called with one tick, in replay with all of them, in a batch with many
lanes, so that one compiled function serves all three and they agree bit for bit.

A kernel is a deterministic function of its arguments: no global state, no I/O, no random numbers, no exceptions.
"""

import functools
import hashlib
import os
import re
import tempfile
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core import config as _config

config: Any = _config  # its options are made at run time
_ROOT = Path(__file__).resolve().parent.parent
_IMPORT = re.compile(
    r"^\s*(?:from\s+(actuators|fdi|cosim)([\w.]*)\s+import\s+(.+)|import\s+(actuators|fdi|cosim)([\w.]*))", re.M
)


def dtype(fields):
    """Return a structured dtype whose scalars have attribute access, in plain Python as in a kernel.

    `fields` is a list of (name, "f8") or (name, "f8", shape). Raises ValueError for any other element type: one float64
    vector holds a whole tick, and the log and the replay rely on that.
    """
    made = np.dtype((np.record, fields))
    for name in made.names or ():
        base = made[name].base
        if base != np.float64:
            raise ValueError(f"field {name!r} is {base}; every field of a block is f8")
        if hasattr(np.record, name):
            raise ValueError(f"field {name!r} shadows an attribute of np.record; choose another name")
    return made


def record(kind, **values):
    """Return a 0-d-like array of shape (1,) of dtype `kind`, zero but for `values`; unknown names raise ValueError."""
    out = np.zeros(1, kind)
    for name, value in values.items():
        out[name][0] = value
    return out


@functools.lru_cache
def _source(path):
    return path.read_bytes()


@functools.cache
def closure(path):
    """Return the set of our source files that `path` imports, directly or not, itself included."""
    seen, todo = set(), [path]
    while todo:
        here = todo.pop()
        if here in seen or not here.is_file():
            continue
        seen.add(here)
        for pkg, rest, names, pkg2, rest2 in _IMPORT.findall(_source(here).decode()):
            stem = _ROOT.joinpath(*((pkg or pkg2) + (rest or rest2)).split("."))
            todo.append(stem.with_suffix(".py"))
            todo.extend(stem / f"{n}.py" for n in re.findall(r"\w+", names))
    return seen


@functools.cache
def _cache_dir(path):
    """Name a cache folder by the sources a kernel is compiled from: Numba itself misses a change in a callee's file."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(closure(path)):
        digest.update(_source(source))
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    for root in (Path(base), Path(tempfile.gettempdir())):
        folder = root / "cosim-kernels" / digest.hexdigest()[:16]
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return str(folder)
    return None


def kernel(function):
    """Compile `function` with Numba, cached on disk by the digest of every source of ours that it depends on."""
    folder = _cache_dir(Path(function.__code__.co_filename).resolve())
    if folder is None or config.DISABLE_JIT:
        return numba.njit(error_model="numpy")(function)
    before = config.CACHE_DIR
    config.CACHE_DIR = folder
    try:
        return numba.njit(cache=True, error_model="numpy")(function)
    finally:
        config.CACHE_DIR = before


def bound(function, *args):
    """Return a call without arguments of kernel `function` on `args`, compiled for their types.

    Numba looks the types up at every call, 0.4 us for a block's records; bound once, a live tick pays only for its
    work.
    """
    if config.DISABLE_JIT:
        return functools.partial(function, *args)
    return functools.partial(function.compile(tuple(map(_type, args))), *args)


_RECORDS: dict[np.dtype, Any] = {}


def _type(value):
    """Return Numba's type of an argument; that of a block's records, 1 ms each, is kept for the next flight."""
    if not isinstance(value, np.ndarray) or value.dtype.names is None:
        return numba.typeof(value)
    if value.dtype not in _RECORDS:
        _RECORDS[value.dtype] = numba.typeof(value).dtype
    flags = value.flags
    layout: Any = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
    return numba.types.Array(_RECORDS[value.dtype], value.ndim, layout, not flags.writeable, aligned=flags.aligned)
