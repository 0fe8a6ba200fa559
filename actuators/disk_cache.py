"""Disk cache of computed arrays, beside the compiled kernels.

What is kept is named by all that it depends on: the sources of a flight, the versions of NumPy and SciPy,
the processor, what the environment tells the libraries of linear algebra, and the arguments.
"""

import functools
import hashlib
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from actuators.object_cache import processor
from actuators.source_hash import installed, private_folder, read_whole, sources, write_whole

LIBRARIES = "OMP_", "OPENBLAS_", "MKL_", "BLIS_", "NPY_"  # variables on which the last bit of a sum depends
MOST = 100  # of a source's results on disk: a study over thousands of points leaves no more


def kept(key: object, kind: Any, make: Callable[[], np.ndarray], source: str) -> np.ndarray:
    """Return `make()`, an array (n,) of dtype `kind`, from disk where it is there.

    `source` is the file that works it out, `key` the arguments, equal when their repr is.
    """
    file = _file(repr((key, np.dtype(kind).descr)), source)
    if file is None:
        return make()
    size = np.dtype(kind).itemsize
    numbers = read_whole(file)
    if numbers is not None and len(numbers) % size == 0:
        return np.frombuffer(numbers, kind).copy()
    made = np.ascontiguousarray(make(), kind)
    with suppress(OSError):
        if sum(1 for _ in file.parent.glob(f"{Path(source).stem}-*.kept")) < MOST:
            write_whole(file, made.tobytes())
    return made


@functools.cache
def contents(folder: Path, stamps: object = None) -> str:
    """Return a digest of all files in a folder, by which to know what was worked out from it; it is taken anew for
    other `stamps`."""
    found = hashlib.sha256()
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        found.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return found.hexdigest()


def _file(said, source) -> Path | None:
    folder = private_folder(sources()[:16])
    told = "\n".join([said, _machine(), Path(source).stem])
    digest = hashlib.sha256(told.encode("utf-8", "surrogateescape")).hexdigest()
    return folder / f"{Path(source).stem}-{digest[:24]}.kept" if folder else None


@functools.cache
def _machine() -> str:
    versions = [installed(name) for name in ("numpy", "scipy", "jsbsim")]
    given = sorted(f"{name}={value}" for name, value in os.environ.items() if name.startswith(LIBRARIES))
    return " ".join([processor(), *versions, *given])
