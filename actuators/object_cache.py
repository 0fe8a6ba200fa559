"""Object-code cache: functions of pointers and numbers, compiled with Numba, kept on disk, called by address.

Numba compiles; what it made is stripped to the one function and stored as an object file beside the digest of its
sources. A process that finds the file loads it with LLVM alone, in a millisecond and without Numba: the same machine
code, so the same bits. The functions follow Numba's convention in C:

    int f(void **nothing, void **nothing, arguments ...)
"""

import ctypes
import functools
import hashlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from actuators.source_hash import installed, made_of, private_folder, reached, read_whole, write_whole

SHIPPED = Path(__file__).with_name("objects")  # machine code that a release brings, in a folder per target
BASE = "x86-64-v3"  # of x86-64 since 2013, where a tick costs 2 % more than compiled for this processor; with v2, 12 %
NEEDED = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")  # of a processor that does BASE
_ENTRY = "entry"
_nothing = ctypes.create_string_buffer(16)  # where a function would put its result and its exception: it has neither
NOTHING = ctypes.addressof(_nothing), ctypes.addressof(_nothing) + 8
_FREE = "NRT_MemInfo_call_dtor"  # frees an array of Numba's own: kernels make none, what refers to it is never run
_never = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(lambda array: None)
counts = {"compiled": 0, "loaded": 0}


class Native:
    """A compiled function: `address`, and `call`, which takes its arguments as ctypes does.

    `make()` returns (Python function, Numba types of its arguments); it is called only when nothing is stored.
    `source` is the file that it comes from, `name` what tells it from others there, `kinds` the ctypes of its
    arguments, `place` where another process finds this object: "module:name". What is stored is named by what the
    functions `roots` reach, without any by the files `reads` in the project's folder.
    """

    def __init__(self, name: str, source: str | Path, kinds: tuple, make: Callable, place: str, roots: tuple = (),
                 reads: tuple = ()):  # fmt: skip
        self.name, self.source, self._kinds, self._make = name, Path(source).resolve(), kinds, make
        self.place, self._roots, self._reads = place, roots, reads

    @functools.cached_property
    def address(self) -> int:
        """Return the address of the machine code; compiles when there is none for these sources and this machine."""
        code = next(filter(None, map(read_whole, self.files())), None)
        if code is None:
            code = _compile(*self._make())
            counts["compiled"] += 1
            if file := self.file():
                write_whole(file, code)
        else:
            counts["loaded"] += 1
        return _load(code)

    @functools.cached_property
    def call(self) -> Callable:
        """Return the function; the interpreter stays locked while it runs."""
        return self._bound(ctypes.PYFUNCTYPE)

    @functools.cached_property
    def free(self) -> Callable:
        """Return the function; other threads of Python run on meanwhile."""
        return self._bound(ctypes.CFUNCTYPE)

    def _bound(self, convention):
        kinds = ctypes.c_void_p, ctypes.c_void_p, *self._kinds
        return functools.partial(convention(ctypes.c_int, *kinds)(self.address), *NOTHING)

    def ready(self) -> bool:
        """Tell whether the machine code is loaded or stored."""
        if "address" in vars(self):
            return True
        return any(file.is_file() for file in self.files())

    def files(self) -> list[Path]:
        """Return where the machine code may be: what the package brings, then the user's cache."""
        own = private_folder(f"code-{target()}-numba-{installed('numba')}")
        source = reached(*self._roots) if self._roots else made_of(self._reads)
        # not .o: a version that reads no digest before the code would take it for code
        name = f"{self.name}-{source[:16]}.code"
        return [SHIPPED / target() / name, *([own / name] if own else [])]

    def file(self) -> Path | None:
        """Return where the machine code is stored, None where there is no place for it."""
        return file if (file := self.files()[-1]).parent.parent != SHIPPED else None


@functools.cache
def processor() -> str:
    """Return a digest of what machine code depends on beside its sources: processor, system, compiler."""
    import llvmlite
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features().flatten()
    about = llvm.get_process_triple(), llvm.get_host_cpu_name(), features, llvmlite.__version__
    return hashlib.sha256("\n".join(about).encode()).hexdigest()[:12]


@functools.cache
def target() -> str:
    """Return for what machine code is compiled: the base of x86-64 under Linux, elsewhere this very processor."""
    import llvmlite.binding as llvm

    linux = llvm.get_process_triple().startswith("x86_64") and sys.platform == "linux"
    return f"linux-{BASE}" if linux and all(map(llvm.get_host_cpu_features().get, NEEDED)) else processor()


def _machine(own):
    """Return LLVM's target machine for `target()`; `own` is Numba's, of this very processor."""
    import llvmlite.binding as llvm

    if target() != f"linux-{BASE}":
        return own
    how: Any = {"opt": 3, "reloc": "static", "codemodel": "jitdefault", "jit": True}
    return llvm.Target.from_default_triple().create_target_machine(cpu=BASE, features="", **how)


def _compile(function, kinds):
    """Return the object code of `function` for arguments of Numba types `kinds`: a list of what it calls, then ELF."""
    import llvmlite.binding as llvm
    import numba

    only: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    made = numba.njit(error_model="numpy", **only)(function)
    made.compile(numba.types.void(*kinds))
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
    options.loop_vectorization = options.loop_unrolling = True
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    passes = llvm.create_new_module_pass_manager()
    passes.add_strip_dead_prototype_pass()
    passes.run(module, builder)
    called = [f.name for f in module.functions if f.is_declaration and not f.name.startswith("llvm.")]
    return "\n".join(called).encode() + b"\0" + machine.emit_object(module)


_loaded: list[Any] = []


def _load(code):
    """Return the address of the entry in object code."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)  # from here on LLVM knows the C library
    called, _, data = code.partition(b"\0")
    missing = [s.decode() for s in called.split() if llvm.address_of_symbol(s.decode()) is None]
    if missing == [_FREE]:
        llvm.add_symbol(_FREE, ctypes.cast(_never, ctypes.c_void_p).value)
    elif missing:
        from numba.core.registry import cpu_target

        _ = cpu_target.target_context  # Numba's helpers are known by name once it is there
    engine.add_object_file(llvm.ObjectFileRef.from_data(data))
    engine.finalize_object()
    _loaded.append(engine)  # the code lives as long as its engine
    return engine.get_function_address(_ENTRY)
