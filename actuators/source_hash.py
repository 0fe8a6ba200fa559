"""Hash of the sources that a compiled kernel or a computed array depends on, and the cache folders."""

import contextlib
import functools
import hashlib
import os
import stat
import tempfile
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
# folders whose sources decide what a flight comes to: what is computed from them is worked out anew with any change
FLYING = ("actuators", "fdi", *(f"cosim/{room}" for room in ("flight", "judge", "log", "parts", "scenario")))
LIBRARIES = ("numpy", "scipy", "numba", "llvmlite")
MAKERS = ("block.py", "object_cache.py", "numba_intrinsics.py")  # what makes a kernel of a step
_DIGEST = 32  # bytes before what is stored: its SHA-256, for LLVM would crash on half a file


@functools.cache
def _source(path):
    return path.read_bytes()


def digest_of(paths: Iterable[Path]) -> str:
    """Return a digest of the contents of files."""
    return hashlib.sha256(b"".join(hashlib.sha256(_source(path)).digest() for path in paths)).hexdigest()


@functools.cache
def sources() -> str:
    """Return a digest of all sources of FLYING."""
    return digest_of(sorted(path for name in FLYING for path in (ROOT / name).rglob("*.py")))


@functools.cache
def installed(name: str) -> str:
    """Return the version of an installed library."""
    return version(name)


def made_of(names: Iterable[str] = ()) -> str:
    """Return a digest of what makes machine code of a kernel, and of the files `names` in the project's folder."""
    return digest_of([*(ROOT / "actuators" / name for name in MAKERS), *(ROOT / name for name in names)])


def reached(*roots: Any) -> str:
    """Return a digest of the functions `roots`, of every function that they call, directly or not, and of the constants
    that these read (the lines of a function, the value of a constant), and of what makes machine code of them.

    Its code says which names a function reads; its lines are the same in every version of Python.
    """
    told = {made_of()}
    seen: dict[Any, None] = {}
    todo = [getattr(root, "py_func", root) for root in roots]
    while todo:
        function = todo.pop()
        if function in seen:
            continue
        seen[function] = None
        told.add(_lines(function))
        for name, value in _reads(function):
            value = getattr(value, "py_func", value)
            if isinstance(value, FunctionType) and value.__module__.partition(".")[0] not in LIBRARIES:
                todo.append(value)
            else:
                told.add(f"{function.__module__}.{function.__qualname__} {name} {_value(value)}")
    return hashlib.sha256("\0".join(sorted(told)).encode()).hexdigest()


def _codes(code):
    yield code
    for each in code.co_consts:
        if isinstance(each, CodeType):
            yield from _codes(each)


def _lines(function):
    """Return the module, the name and the source lines of a function."""
    codes = list(_codes(function.__code__))
    last = max(line or 0 for code in codes for position in code.co_positions() for line in position[:2])
    path = Path(codes[0].co_filename)
    if path.is_file():
        text = _source(path).decode("utf-8", "replace").splitlines()[codes[0].co_firstlineno - 1 : last]
    else:  # typed in, not in a file
        text = [code.co_code.hex() + repr([c for c in code.co_consts if not isinstance(c, CodeType)]) for code in codes]
    return "\n".join([f"{function.__module__}.{function.__qualname__}", *text])


def _reads(function):
    """Yield (name, value) of what a function reads from its module, from modules there, and from around it."""
    names = sorted({name for code in _codes(function.__code__) for name in code.co_names})
    spaces, seen = [("", function.__globals__)], set()
    while spaces:
        at, space = spaces.pop()
        for name in filter(space.__contains__, names):
            if not isinstance(value := space[name], ModuleType):
                yield at + name, value
            elif value not in seen:
                seen.add(value)
                spaces.append((f"{at}{name}.", vars(value)))
    around = zip(function.__code__.co_freevars, function.__closure__ or ())
    yield from ((name, cell.cell_contents) for name, cell in around)


def _value(value):
    """Return a text that is another for another value; of what a library brings its name."""
    import numpy as np  # a scenario is read without it

    if isinstance(value, np.ndarray):
        return f"{value.dtype.descr} {value.shape} {value.tobytes().hex()}"
    if isinstance(value, np.dtype):
        return repr(value.descr)
    if isinstance(value, (int, float, str, bytes, tuple, np.generic, type(None))):
        return repr(value)
    return f"{type(value).__name__} {getattr(value, '__name__', '')}"


def read_whole(file: Path | None) -> bytes | None:
    """Return what `write_whole` put into a file, None where there is none or it is not what was written."""
    try:
        held = file.read_bytes() if file else b""
    except OSError:
        return None
    told, data = held[:_DIGEST], held[_DIGEST:]
    return data if told == hashlib.sha256(data).digest() else None


def write_whole(file: Path, data: bytes) -> None:
    """Put `data` behind its digest there, whole or not at all; a folder that takes no file costs only time."""
    with contextlib.suppress(OSError):
        handle, beside = tempfile.mkstemp(dir=file.parent, suffix=".part")
        with os.fdopen(handle, "wb") as out:
            out.write(hashlib.sha256(data).digest() + data)
        os.replace(beside, file)


def forget() -> None:
    """Read the sources again where they are asked for next: one of a user's has changed."""
    for cached in (_source, sources):
        cached.cache_clear()


def private(folder: Path) -> bool:
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


@functools.cache
def cache_root() -> Path | None:
    """Return the folder for compiled kernels, None where no folder is this user's alone: NUMBA_CACHE_DIR or
    XDG_CACHE_HOME, the user's cache."""
    given = (os.environ[name] for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME") if os.environ.get(name))
    roots = [*map(Path, given), Path(os.path.expanduser("~/.cache"))]
    found = (root / "cosim-kernels" for root in roots if root.is_absolute())
    return next((root for root in found if private(root) and os.access(root, os.W_OK)), None)


@functools.cache
def private_folder(name: str) -> Path | None:
    """Return a folder of the cache, made where it is missing; None where others may write to it."""
    folder = (root := cache_root()) and root / name
    return folder if folder and private(folder) else None
