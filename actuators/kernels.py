"""Compiled kernels and computed arrays: made once, kept on disk, found by what they depend on.

Numba compiles a function of addresses and numbers; what it made is stripped to the one function and stored as an object
file behind the digest of its contents. A process that finds the file loads it with LLVM alone, in a millisecond and
without Numba: the same machine code, so the same bits. The functions follow Numba's convention in C:

    int f(void **nothing, void **nothing, arguments ...)

Machine code is named by the functions and constants that its kernel reaches, an array by the sources of all that flies,
the versions of the libraries, the processor and the arguments.
"""

import ctypes
import functools
import hashlib
import linecache
import os
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from importlib import metadata
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
# folders whose sources decide what a flight comes to: what is computed from them is worked out anew with any change
FLYING = ("actuators", "fdi", *(f"cosim/{room}" for room in ("flight", "judge", "log", "parts", "scenario")))
LIBRARIES = ("numpy", "scipy", "numba", "llvmlite")
INTRINSICS = ROOT / "actuators/numba_intrinsics.py"
SHIPPED = Path(__file__).with_name("objects")  # machine code that a release brings, in a folder per target
BASE = "x86-64-v3"  # of x86-64 since 2013, where a tick costs 2 % more than compiled for this processor; with v2, 12 %
NEEDED = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")  # of a processor that does BASE
ARRAYS = 100  # of one file's computations on disk: a study over thousands of points leaves no more
# how Numba compiles what no Python calls; without its memory: what would make an array is refused
JIT: Any = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "_nrt": False}
version = functools.cache(metadata.version)

_ENTRY = "entry"
_nothing = ctypes.create_string_buffer(16)  # where a function would put its result and its exception: it has neither
NOTHING = ctypes.addressof(_nothing), ctypes.addressof(_nothing) + 8
_loaded: list[Any] = []


class Native:
    """A compiled function: `address`, and `call`, which takes its arguments as ctypes does.

    `make()` returns the Python function; it is called only when nothing is stored. `place` is where another process
    finds this object, "module:name", `kinds` the ctypes of its arguments. What is stored is named by what `make` and
    `roots` reach: functions, dtypes.
    """

    def __init__(self, place: str, kinds: tuple, make: Callable, *roots: Any):
        self.place, self.roots, self._kinds, self._make = place, roots, kinds, make

    @functools.cached_property
    def address(self) -> int:
        """Return the address of the machine code; compiles when there is none for these sources and this machine."""
        code = next(filter(None, map(read_whole, self.files)), None)
        if code is None:
            code = _compile(self._make(), self._kinds)
            for file in self.files[1:]:
                write_whole(file, code)
        return _load(code)

    @functools.cached_property
    def call(self) -> Callable:
        """Return the function; other threads of Python run on meanwhile."""
        kinds = ctypes.c_void_p, ctypes.c_void_p, *self._kinds
        return functools.partial(ctypes.CFUNCTYPE(ctypes.c_int, *kinds)(self.address), *NOTHING)

    def ready(self) -> bool:
        """Tell whether the machine code is loaded or stored."""
        return "address" in vars(self) or any(file.is_file() for file in self.files)

    @functools.cached_property
    def files(self) -> list[Path]:
        """Return where the machine code may be: in the package, then in the user's cache where there is one."""
        own = cache(f"code-{target()}-numba-{version('numba')}")
        made_of = reached(self._make, _compile, INTRINSICS.read_bytes(), *self.roots)
        name = f"{self.place.partition(':')[0]}-{made_of[:16]}.code"
        return [SHIPPED / target() / name, *([own / name] if own else [])]


def cores() -> int:
    """Return how many processes this process may keep busy."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


# of a process that compiles and ends: to search its memory for cycles would take a tenth of its time
_WORK = """
import functools, gc, importlib, sys
gc.disable()
module, _, path = sys.argv[1].partition(":")
functools.reduce(getattr, path.split("."), importlib.import_module(module)).address
"""


def compile_ahead(wanted: Iterable[Native], progress: Callable[[int, int], None] | None = None) -> int:
    """Compile those of `wanted` that are not stored yet, each in a process of its own, as many at a time as there are
    cores; return how many there were.

    `progress(done, total)` counts them. One alone, or all on a machine of one core, are left to their first use. What
    a process cannot compile is left too: the error then stands where it belongs.
    """
    missing = [native for native in dict.fromkeys(wanted) if not native.ready()]
    workers = min(cores(), len(missing))
    if workers < 2 or not missing[0].files[1:]:
        return 0
    tell, pool = progress or (lambda done, total: None), ThreadPoolExecutor(workers)

    def compiled(native):
        with suppress(OSError):
            subprocess.run(**python(_WORK, native.place), stdin=subprocess.DEVNULL, capture_output=True)

    tell(0, len(missing))
    try:
        for done, _ in enumerate(pool.map(compiled, missing), 1):
            tell(done, len(missing))
    finally:
        pool.shutdown(cancel_futures=True)  # after Ctrl-C, which ends the processes too, none begins
    return len(missing)


def python(code: str, *arguments: str, **more: str) -> dict[str, Any]:
    """Return `args` and `env` of a process of Python that runs `code`, with `more` in its environment: it finds our
    packages wherever this one found them, and imports nothing from the current folder (-P)."""
    path = os.pathsep.join((str(ROOT), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))))
    env = {**os.environ, "PYTHONPATH": path, **more}
    return {"args": [sys.executable, "-P", "-c", code, *arguments], "env": env}


@functools.cache
def target() -> str:
    """Return for what machine code is compiled: the base of x86-64 under Linux, elsewhere this very processor."""
    import llvmlite.binding as llvm

    linux = llvm.get_process_triple().startswith("x86_64") and sys.platform == "linux"
    return f"linux-{BASE}" if linux and all(map(llvm.get_host_cpu_features().get, NEEDED)) else _processor()


@functools.cache
def _processor():
    """Return a digest of what machine code depends on beside its sources: processor, system, compiler."""
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features().flatten()
    about = llvm.get_process_triple(), llvm.get_host_cpu_name(), features, version("llvmlite")
    return hashlib.sha256("\n".join(about).encode()).hexdigest()[:12]


def _machine(own):
    """Return LLVM's target machine for `target()`; `own` is Numba's, of this very processor."""
    import llvmlite.binding as llvm

    if target() != f"linux-{BASE}":
        return own
    how: Any = {"opt": 3, "reloc": "static", "codemodel": "jitdefault", "jit": True}
    return llvm.Target.from_default_triple().create_target_machine(cpu=BASE, features="", **how)


def _compile(function, kinds):
    """Return the object code of `function` for arguments of ctypes `kinds`: a list of what it calls, then ELF."""
    import llvmlite.binding as llvm
    import numba
    from numba.core.typing.ctypes_utils import from_ctypes

    made = numba.njit(**JIT)(function)
    with _intermediate_code_only():
        made.compile(numba.types.void(*map(from_ctypes, kinds)))
    (found,) = made.overloads.values()
    name = found.fndesc.llvm_func_name
    module = llvm.parse_assembly(str(found.library._final_module))
    for i, each in enumerate((*module.functions, *module.global_variables)):
        if each.name == name:
            each.name = _ENTRY
        elif not each.is_declaration:
            each.linkage = llvm.Linkage.internal
            each.name = f"_{i}"  # Numba's names count what a process has compiled before
    machine = _machine(found.library.codegen._tm)
    options = llvm.create_pipeline_tuning_options(speed_level=3)  # what nobody else calls is inlined: a tenth less time
    builder = llvm.create_pass_builder(machine, options)
    passes = builder.getModulePassManager()
    passes.add_strip_dead_prototype_pass()
    passes.run(module, builder)
    called = [f.name for f in module.functions if f.is_declaration and not f.name.startswith("llvm.")]
    return "\n".join(called).encode() + b"\0" + machine.emit_object(module)


@contextmanager
def _intermediate_code_only():
    """Let Numba stop before machine code: it would optimise and assemble every function that a kernel calls for itself,
    where only the kernel as a whole is run (a third of the time).

    Numba's own lock is held meanwhile: what another thread compiles waits, and is compiled as ever."""
    from unittest.mock import patch

    from numba.core import codegen, cpu
    from numba.core.compiler_lock import global_compiler_lock

    def linked(context, library, fndesc, env):
        library._ensure_finalized()
        return [].append  # stands for the function: Numba wants a built-in one, and nobody calls it

    def whole(library):
        library._finalized = True

    with (
        global_compiler_lock,
        patch.object(cpu.CPUContext, "get_executable", linked),
        patch.object(codegen.CPUCodeLibrary, "_finalize_final_module", whole),
        patch.object(codegen.CPUCodeLibrary, "_optimize_final_module", lambda library: None),
    ):
        yield


def _load(code):
    """Return the address of the entry in object code."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)  # from here on LLVM knows the C library
    called, _, data = code.partition(b"\0")
    if not all(llvm.address_of_symbol(name.decode()) for name in called.split()):
        from numba.core.registry import cpu_target

        _ = cpu_target.target_context  # Numba's helpers are known by name once it is there
    engine.add_object_file(llvm.ObjectFileRef.from_data(data))
    engine.finalize_object()
    _loaded.append(engine)  # the code lives as long as its engine
    return engine.get_function_address(_ENTRY)


# -- what they depend on


@functools.cache
def sources() -> str:
    """Return a digest of all sources of FLYING."""
    paths = sorted(path for name in FLYING for path in (ROOT / name).rglob("*.py"))
    return hashlib.sha256(b"".join(hashlib.sha256(path.read_bytes()).digest() for path in paths)).hexdigest()


def forget() -> None:
    """Read the sources again where they are asked for next: one of a user's has changed."""
    linecache.clearcache()
    sources.cache_clear()


def reached(*roots: Any) -> str:
    """Return a digest of `roots`, functions and constants, of every function that these call, directly or not, and of
    the constants that they read: the lines of a function, the value of a constant.

    Its code says which names a function reads; its lines are the same in every version of Python.
    """
    told, seen, todo = set(), set(), [("", root) for root in roots]
    while todo:
        name, value = todo.pop()
        value = getattr(value, "py_func", getattr(value, "__func__", value))
        if not isinstance(value, FunctionType) or value.__module__.partition(".")[0] in LIBRARIES:
            told.add(f"{name} {_value(value)}")
        elif value not in seen:
            seen.add(value)
            told.add(_lines(value))
            todo += [(f"{value.__module__}.{value.__qualname__} {name}", read) for name, read in _reads(value)]
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
    text = linecache.getlines(codes[0].co_filename)[codes[0].co_firstlineno - 1 : last]
    if not text:  # typed in
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
    if isinstance(value, np.ndarray):
        return f"{value.dtype.descr} {value.shape} {value.tobytes().hex()}"
    if isinstance(value, np.dtype):
        return repr(value.descr)
    if isinstance(value, (int, float, str, bytes, tuple, dict, np.generic, type(None))):
        return repr(value)
    return f"{type(value).__name__} {getattr(value, '__name__', '')}"


# -- on disk


def cached_array(key: object, kind: Any, compute: Callable[[], np.ndarray], file: str) -> np.ndarray:
    """Return `compute()`, an array (n,) of dtype `kind`, from disk where it is there.

    `file` is the source file that computes it, `key` the arguments, equal when their repr is.
    """
    folder, stem = cache(sources()[:16]), Path(file).stem
    if folder is None:
        return compute()
    about = key, np.dtype(kind).descr, _processor(), *map(version, ("numpy", "scipy", "jsbsim"))
    digest = hashlib.sha256(repr(about).encode("utf-8", "surrogateescape")).hexdigest()
    path = folder / f"{stem}-{digest[:24]}.kept"
    numbers = read_whole(path)
    if numbers is not None:
        return np.frombuffer(numbers, kind).copy()
    made = np.ascontiguousarray(compute(), kind)
    if len(list(folder.glob(f"{stem}-*.kept"))) < ARRAYS:
        write_whole(path, made.tobytes())
    return made


_DIGEST = 32  # bytes before what is stored: its SHA-256, for LLVM would crash on half a file


def read_whole(file: Path) -> bytes | None:
    """Return what `write_whole` put into a file, None where there is none or it is not what was written."""
    try:
        held = file.read_bytes()
    except OSError:
        return None
    return held[_DIGEST:] if held[:_DIGEST] == hashlib.sha256(held[_DIGEST:]).digest() else None


def write_whole(file: Path, data: bytes) -> None:
    """Put `data` behind its digest there, whole or not at all; a folder that takes no file costs only time."""
    with suppress(OSError):
        handle, beside = tempfile.mkstemp(dir=file.parent, suffix=".part")
        with os.fdopen(handle, "wb") as out:
            out.write(hashlib.sha256(data).digest() + data)
        os.replace(beside, file)


@functools.cache
def cache(name: str = "") -> Path | None:
    """Return the folder `name` of the cache, made where it is missing: in NUMBA_CACHE_DIR, else in XDG_CACHE_HOME, else
    in the user's cache. None where that is not this user's alone: whoever can write there runs code as us."""
    given = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    root = Path(given, "cosim-kernels")
    usable = root.is_absolute() and _private(root) and os.access(root, os.W_OK)
    return root / name if usable and _private(root / name) else None


def _private(folder):
    """Tell whether `folder`, made when it is missing, is a directory of this user's that nobody else may write to."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        about = folder.lstat()
    except (OSError, RuntimeError):
        return False
    if not hasattr(os, "getuid"):  # Windows: a user's own profile is closed to others by default
        return True
    return stat.S_ISDIR(about.st_mode) and about.st_uid == os.getuid() and not about.st_mode & 0o022
