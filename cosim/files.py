"""Files of the user's: each is there as it was or as it should be, never half of it, and has one writer at a time."""

import contextlib
import errno
import os
import stat
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from cosim.errors import CosimError, OutputError

try:
    import fcntl
except ImportError:  # where there are no such locks, nobody is kept out
    fcntl = None  # type: ignore[assignment]


FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
SPACE = "Free space there, or choose another place"
PART = ".cosim-part-"  # how the name of a file begins that `beside` has not finished


def replace(path: str | Path, make: Callable[..., Any]) -> Any:
    """Let `make(part)` write a file beside `path`, then put it in its place; see `beside`."""
    with beside(path) as part:
        return make(part)


@contextlib.contextmanager
def beside(path: str | Path) -> Iterator[Path]:
    """Give the name of a file beside `path` to be written, and put it in its place when it is whole.

    What is there stays until then. Raises OutputError when it cannot be written, or another run writes it; nothing is
    left beside `path` then.
    """
    path = Path(os.path.realpath(path))  # behind a link stands the file that is meant
    part = path
    try:
        if path.exists() and not path.is_file():  # a device or a pipe: nothing of it can be lost, nor put in its place
            with _heard(path):
                yield path
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        _alone(path)
        handle, name = tempfile.mkstemp(prefix=PART, suffix=path.suffix, dir=path.parent)
        os.close(handle)
        part = Path(name)
        try:
            yield part
            with part.open("rb+") as file:
                os.fsync(file.fileno())
            part.chmod(path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_umask())
            part.replace(path)
        except BaseException:
            with contextlib.suppress(OSError):
                part.unlink()
            raise
    except CosimError as error:
        error.place = error.place.replace(str(part), str(path))
        raise
    except OSError as error:
        remedy = SPACE if error.errno in FULL else "Choose another place"
        raise OutputError(f"cannot be written: {error.strerror or error}", place=str(path), remedy=remedy) from None


@contextlib.contextmanager
def _heard(path):
    """Hold a pipe open while it is written; raise OSError where nobody reads it: opening it would wait for ever."""
    pipe = os.open(path, os.O_WRONLY | os.O_NONBLOCK) if path.is_fifo() else None
    try:
        yield
    finally:
        if pipe is not None:
            os.close(pipe)


def _alone(path):
    """Raise OutputError while another run writes `path`."""
    with contextlib.suppress(OSError), path.open("rb") as file:
        if not locked(file):
            raise OutputError(TAKEN, place=str(path), remedy=OTHER)


def regular(path: str | Path, error: Any) -> None:
    """Raise `error` where `path` is there but no regular file: a pipe waits for ever, a device has no end."""
    path = Path(path)
    try:
        found = path.stat()
    except OSError:
        return  # what opens it says why
    if not stat.S_ISREG(found.st_mode):
        raise error(f"is {'a folder' if path.is_dir() else 'no regular file'}", place=str(path))


def replace_text(path: str | Path, text: str) -> None:
    """Put `text` into the file at `path`, in UTF-8, what a file's name has of other bytes escaped; see `replace`."""
    replace(path, lambda part: part.write_text(text, encoding="utf-8", errors="backslashreplace"))


def _umask():
    mask = os.umask(0)
    os.umask(mask)
    return mask


# -- one writer per file: an advisory lock goes with the process, so that no stale one can be left behind

TAKEN = "is being written by another run"
OTHER = "Choose another -o, or wait for it"
_WAIT_S, _TRIES = 0.05, 4  # `reserve` of another run holds the lock for less


def sweep(folder: Path) -> None:
    """Remove what `beside` of killed processes has left in `folder`, where nobody else writes."""
    for path in folder.glob(f"{PART}*"):
        if path.is_file():
            path.unlink()


@contextlib.contextmanager
def held(folder: Path) -> Iterator[None]:
    """Keep other processes out of a folder that they would hold as well. Raises OutputError when one has it."""
    if fcntl is None:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # a file system that has no locks lets everybody in
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise OutputError(TAKEN, place=str(folder), remedy=OTHER) from None
        yield
    finally:
        os.close(handle)


def locked(file: Any) -> bool:
    """Tell whether the open `file` is now this process's alone; a file system without locks says yes."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a device, or a file system that has none
        return True
    return True


def open_alone(path: str | Path) -> Any:
    """Open `path` to be written anew, unbuffered; None when another process writes it, whose content stays.

    Raises OSError.
    """
    for attempt in range(_TRIES):
        if attempt:
            time.sleep(_WAIT_S)
        file = open(path, "wb", buffering=0, opener=_untouched)
        try:
            if locked(file) and _still_there(file, path):
                about = os.fstat(file.fileno())
                if about.st_nlink > 1:  # under its other name, in somebody's copy of hard links, it stays
                    os.unlink(os.path.realpath(path))
                    file.close()
                    continue
                if about.st_size:
                    file.truncate(0)
                return file
        except BaseException:
            file.close()
            raise
        file.close()
    return None


def _untouched(path, flags):
    return os.open(path, flags & ~os.O_TRUNC, 0o666)


def _still_there(file, path):
    """Tell whether `path` is still the file that was opened: it may have been removed before the lock was taken."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), os.stat(path))
    except FileNotFoundError:
        return False
