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

import ast
import contextlib
import functools
import hashlib
import os
import stat
import tempfile
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core import config as _config

config: Any = _config  # its options are made at run time
_ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("actuators", "fdi", "cosim")


def dtype(fields):
    """Return a structured dtype whose scalars have attribute access, in plain Python as in a kernel.

    `fields` is a list of (name, "f8"), (name, "f8", unit), (name, "f8", shape) or (name, "f8", shape, unit); a number
    without a unit has "-", and `unit` finds it again. Raises ValueError for any other element type: one float64 vector
    holds a whole tick, and the log and the replay rely on that.
    """
    units = {f[0]: f[-1] for f in fields if len(f) > 2 and isinstance(f[-1], str)}
    made = np.dtype((np.record, [f[:-1] if f[0] in units else f for f in fields]))
    for name in made.names or ():
        base = made[name].base
        if base != np.float64:
            raise ValueError(f"field {name!r} is {base}; every field of a block is f8")
        if hasattr(np.record, name):
            raise ValueError(f"field {name!r} shadows an attribute of np.record; choose another name")
    return np.dtype(made, metadata={"units": units})


def unit(kind, field):
    """Return the unit of `field`, or of an element `field[i]`, of dtype `kind`; "" where its declaration has none."""
    return ((kind.metadata or {}).get("units") or {}).get(field.partition("[")[0], "")


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
def _imports(path):
    """Return the names that the source at `path` imports, wherever it does so; packages of ours that hold them too."""
    package = path.relative_to(_ROOT).parts[:-1] if path.is_relative_to(_ROOT) else ()
    out = set()
    for node in ast.walk(ast.parse(_source(path))):
        if isinstance(node, ast.Import):
            out |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            base = ".".join((*above, *([node.module] if node.module else ())))
            out |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    return frozenset(out)


def _files(name):
    """Return the files of ours that importing `name` runs: its module or package, and the packages around it."""
    parts = name.split(".")
    if parts[0] not in PACKAGES:
        return
    for i in range(1, len(parts) + 1):
        stem = _ROOT.joinpath(*parts[:i])
        yield from (stem.with_suffix(".py"), stem / "__init__.py")


@functools.cache
def closure(path):
    """Return the set of our source files that `path` imports, directly or not, itself included."""
    seen, todo = set(), [path]
    while todo:
        here = todo.pop()
        if here not in seen and here.is_file():
            seen.add(here)
            todo += [file for name in _imports(here) for file in _files(name)]
    return seen


def private(folder):
    """Return whether `folder` is a directory of this user's that nobody else may write to, made when it is missing.

    Compiled code is loaded by unpickling what lies there: whoever can write to it, or replace it, runs code as us.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        about = folder.lstat()
    except (OSError, RuntimeError):
        return False
    if not stat.S_ISDIR(about.st_mode):
        return False
    if not hasattr(os, "getuid"):  # Windows: a user's own profile is closed to others by default
        return True
    return about.st_uid == os.getuid() and not about.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _cache_roots():
    """Yield where compiled kernels may lie, best first: where the user says, the user's cache, a folder of the user's
    own among the temporary files."""
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        if os.environ.get(name):
            yield Path(os.environ[name]) / "cosim-kernels"
    with contextlib.suppress(RuntimeError):  # a user without a home
        yield Path.home() / ".cache" / "cosim-kernels"
    if hasattr(os, "getuid"):
        yield Path(tempfile.gettempdir()) / f"cosim-kernels-{os.getuid()}"


@functools.cache
def cache_root():
    """Return the folder for compiled kernels, None where no folder is this user's alone."""
    return next((root for root in _cache_roots() if private(root) and os.access(root, os.W_OK)), None)


@functools.cache
def _cache_dir(path):
    """Name a cache folder by the sources a kernel is compiled from: Numba itself misses a change in a callee's file."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(closure(path)):
        digest.update(_source(source))
    root = cache_root()
    folder = root and root / digest.hexdigest()[:16]
    return str(folder) if folder and private(folder) and _all_private(folder) else None


def _all_private(folder):
    """Tell whether every file in `folder` is this user's: a folder that was once open may hold another's."""
    if not hasattr(os, "getuid"):
        return True
    return all(file.lstat().st_uid == os.getuid() for file in folder.rglob("*"))


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
