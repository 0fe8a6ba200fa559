"""Hash of the sources that a compiled kernel or a computed array depends on, and the cache folders."""

import contextlib
import functools
import hashlib
import os
import re
import stat
import tempfile
from importlib.metadata import version
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("actuators", "fdi", "cosim")
LIBRARIES = ("numpy", "scipy", "numba", "llvmlite")
MAKERS = ("block.py", "object_cache.py", "numba_intrinsics.py")  # what makes a kernel of a step
# an import, with the names behind it, and what stands before it in its line, with the module of a "from"
IMPORT = re.compile(r"\bimport\b[ \t]*(\((?:[\w\s,]|#[^\n]*)*\)|[^\n;]*)")
FROM = re.compile(r"(?:^|[;:])[ \t]*(?:from\b[ \t]*([.\w]+)[ \t]*)?$", re.MULTILINE)
_DIGEST = 32  # bytes before what is stored: its SHA-256, for LLVM would crash on half a file


@functools.cache
def _source(path):
    return path.read_bytes()


@functools.cache
def _digest(path):
    return hashlib.sha256(_source(path)).digest()


def _imports(path):
    """Return the names that the source at `path` imports, wherever it does so; packages of ours that hold them too.

    What looks like an import inside a string counts as well, which costs a compilation at worst: a parser would take a
    second over the sources of a flight.
    """
    package = path.relative_to(ROOT).parts[:-1] if path.is_relative_to(ROOT) else ()
    text = _source(path).decode("utf-8-sig", "replace").replace("\r\n", "\n").replace("\\\n", " ")
    out = set()
    for found in IMPORT.finditer(text):
        begin = text.rfind("\n", 0, found.start()) + 1
        head = FROM.search(text, begin, found.start())
        names = [part.split()[0] for part in re.sub(r"#[^\n]*|[()]", " ", found[1]).split(",") if part.strip()]
        if head and head[1] is None:
            out |= set(names)
        elif head:
            level = len(head[1]) - len(head[1].lstrip("."))
            above = package[: len(package) - level + 1] if level else ()
            base = ".".join((*above, *filter(None, [head[1].lstrip(".")])))
            out |= {base, *(f"{base}.{name}" for name in names)}
    outside = not path.is_relative_to(ROOT)  # a user's block imports its neighbours, too
    return sorted(name for name in out if outside or name.partition(".")[0] in PACKAGES)


@functools.cache
def _files(name):
    """Return our files that importing `name` runs: its module or package, and the packages around it."""
    parts = name.split(".")
    stems = [os.path.join(ROOT, *parts[:i]) for i in range(1, len(parts) + 1)]
    return tuple(Path(f) for s in stems for f in (f"{s}.py", os.path.join(s, "__init__.py")) if os.path.isfile(f))


@functools.cache
def installed(name: str) -> str:
    """Return the version of an installed library."""
    return version(name)


@functools.cache
def _links(path):
    """Return our files that the source at `path` imports."""
    names = _imports(path)
    found = [file for name in names for file in _files(name)]
    if not path.is_relative_to(ROOT):
        beside = (path.parent.joinpath(*name.split(".")).with_suffix(".py") for name in names)
        found += [file for file in beside if file.is_file()]
    return tuple(dict.fromkeys(found))


def reached(*roots: Any) -> str:
    """Return a digest of the functions `roots`, of every function that they call, directly or not, and of the constants
    that these read (the lines of a function, the value of a constant), and of what makes machine code of them.

    Its code says which names a function reads; its lines are the same in every version of Python.
    """
    told = {_digest(ROOT / "actuators" / name).hex() for name in MAKERS}
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


@functools.cache
def closure(path: Path) -> set:
    """Return the set of our source files that `path` imports, directly or not, itself included."""
    seen, todo = set(), [path] if path.is_file() else []
    while todo:
        here = todo.pop()
        if here not in seen:
            seen.add(here)
            todo += _links(here)
    return seen


def forget() -> None:
    """Read the sources again where they are asked for next: one of a user's has changed."""
    for cached in (_source, _digest, _links, closure, sources, cache_dir):
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


def _cache_roots():
    """Yield where compiled kernels may lie, best first: where the user says, the user's cache, a user folder
    own among the temporary files."""
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        if os.environ.get(name):
            yield Path(os.environ[name]) / "cosim-kernels"
    with contextlib.suppress(RuntimeError):  # a user without a home
        if Path.home().is_absolute():
            yield Path.home() / ".cache" / "cosim-kernels"
    if hasattr(os, "getuid"):
        yield Path(tempfile.gettempdir()) / f"cosim-kernels-{os.getuid()}"


@functools.cache
def cache_root() -> Path | None:
    """Return the folder for compiled kernels, None where no folder is this user's alone."""
    return next((root for root in _cache_roots() if private(root) and os.access(root, os.W_OK)), None)


@functools.cache
def sources(path: str | Path) -> str:
    """Return a digest of the file at `path` and of our files that it imports, directly or not."""
    return hashlib.sha256(b"".join(sorted(map(_digest, closure(path))))).hexdigest()


@functools.cache
def cache_dir(path: str | Path) -> str | None:
    """Return the cache folder of what is worked out by the sources that the file at `path` imports, None for none."""
    return private_folder(sources(path)[:16])


@functools.cache
def private_folder(name: str) -> str | None:
    """Return a folder of the cache, made where it is missing; None where others may write to it."""
    root = cache_root()
    folder = root and root / name
    return str(folder) if folder and private(folder) and _all_private(folder) else None


def _all_private(folder):
    """Tell whether every file in `folder` is this user's and closed to others: it may once have been open to them."""
    if not hasattr(os, "getuid"):
        return True
    reached = folder.lstat().st_mode & (stat.S_IXGRP | stat.S_IXOTH)  # else no other gets to a file, whatever its mode
    told = [file.lstat() for file in folder.rglob("*")]
    open_to = stat.S_IWGRP | stat.S_IWOTH if reached else 0
    return all(t.st_uid == os.getuid() and (stat.S_ISLNK(t.st_mode) or not t.st_mode & open_to) for t in told)
