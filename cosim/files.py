"""Atomic file replacement: a file stays as it was or becomes whole, and what the project did not write stays."""

import contextlib
import errno
import os
import secrets
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from cosim.errors import CosimError, OutputError

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
SPACE = "Free space there, or choose another place"
PART = ".cosim-part-"  # how the name of a file begins that is not whole yet
LEFT = ".part"  # what follows the name of a log that is not whole yet: of a killed flight it stays

# -- what may be replaced: a file that the project wrote in the same format

Sign = Callable[[Path], bool]  # tells whether a file that is there was written by the project, in one format


def marked(*marks: bytes) -> Sign:
    """Return the sign of files that begin with the first of `marks` and hold the others in their first 4 kB."""

    def holds(path):
        with path.open("rb") as file:
            head = file.read(4096).lstrip()
        return head.startswith(marks[0]) and all(mark in head for mark in marks)

    return holds


LOG = marked(b"\x89MCAP0", b"cosim-log ")  # the sign of a log that the project wrote, be it whole or not
PAGE = marked(b"<!doctype html", b'<meta name="generator" content="cosim">')  # of a page


def columns(*names: str) -> Sign:
    """Return the sign of tables, Parquet or CSV, whose first columns are `names`."""

    def holds(path):
        if path.suffix == ".parquet":
            import pyarrow as pa
            import pyarrow.parquet as pq

            try:
                with path.open("rb") as file:
                    return pq.read_schema(file).names[: len(names)] == [*names]
            except (pa.ArrowException, ValueError):
                return False
        return marked(",".join(names).encode())(path)

    return holds


def claim(path: str | os.PathLike, sign: Sign | None = None) -> None:
    """Raise OutputError where nothing may be written to `path`.

    That is a folder, a device, a pipe, and a file of which `sign` says that the project did not write it. None: `path`
    lies in a folder of the project's.
    """
    path = Path(path)
    if path.is_dir():
        raise OutputError("is a folder, not a file", place=str(path), remedy=f"Choose a file: -o {path / 'name'}")
    regular(path, OutputError)
    if sign is None or not path.is_file():
        return
    try:
        own = not path.stat().st_size or sign(path)
    except OSError:  # may perhaps be written, not read
        own = False
    if not own:
        raise OutputError("is there already: not written by cosim in this format, or perhaps edited", place=str(path),
                          remedy="Choose another place, or remove it")  # fmt: skip


# -- writing


@contextlib.contextmanager
def beside(path: str | os.PathLike, sign: Sign | None = None) -> Iterator[Path]:
    """Give the name of a new file beside `path` to be written, and put it in its place when it is whole; see `claim`.

    What is there stays until then. Raises OutputError when it cannot be written; nothing is left beside `path` then.
    """
    claim(path, sign)
    target = Path(os.path.realpath(path))  # behind a link stands the file that is meant
    part = target.with_name(f"{PART}{secrets.token_hex(4)}{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        part.open("xb").close()
        yield part
        settle(part, target)
    except CosimError as error:
        error.place = error.place.replace(str(part), str(path))
        raise
    except OSError as error:
        raise failed(error, path) from None
    finally:
        with contextlib.suppress(OSError):
            part.unlink()


def settle(part: str | os.PathLike, path: str | os.PathLike) -> None:
    """Put a whole file in its place, on the disk and with the mode of what stood there. Raises OSError."""
    part, path = Path(part), Path(os.path.realpath(path))
    with part.open("rb+") as file:
        os.fsync(file.fileno())
    if path.exists():
        part.chmod(path.stat().st_mode & 0o777)
    part.replace(path)


def left_by(path: str | os.PathLike) -> Path:
    """Return where a log is written until it is whole, and where a killed flight leaves it."""
    return Path(f"{os.path.realpath(path)}{LEFT}")


def failed(error: OSError, path: str | os.PathLike) -> OutputError:
    """Return the OutputError of a file that cannot be written."""
    if isinstance(error, FileExistsError | NotADirectoryError):
        return OutputError("its folder is a file", place=str(path), remedy="Choose another place")
    if error.errno == errno.ENAMETOOLONG:
        return OutputError("its name is longer than a file's may be", place=str(path), remedy="Choose a shorter one")
    remedy = SPACE if error.errno in FULL else "Choose another place"
    return OutputError(f"cannot be written: {error.strerror or error}", place=str(path), remedy=remedy)


def replace(path: str | os.PathLike, make: Callable[..., Any], sign: Sign | None = None) -> Any:
    """Let `make(part)` write a file beside `path`, then put it in its place; see `beside`."""
    with beside(path, sign) as part:
        return make(part)


def replace_text(path: str | os.PathLike, text: str, sign: Sign | None = None) -> None:
    """Put `text` into the file at `path`, in UTF-8, what a file's name has of other bytes escaped; see `beside`."""
    replace(path, lambda part: part.write_text(text, encoding="utf-8", errors="backslashreplace"), sign)


def regular(path: str | os.PathLike, error: Any) -> None:
    """Raise `error` where `path` is there but no regular file: a pipe waits for ever, a device has no end."""
    path = Path(path)
    try:
        found = path.stat()
    except OSError:
        return  # what opens it says why
    if not stat.S_ISREG(found.st_mode):
        raise error(f"is {'a folder' if path.is_dir() else 'no regular file'}", place=str(path))
