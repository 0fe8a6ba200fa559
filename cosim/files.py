"""Atomic file replacement: a file stays as it was or becomes whole, has one writer at a time, and is the project's."""

import contextlib
import errno
import os
import secrets
import stat
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
PART = ".cosim-part-"  # how the name of a file begins that is not whole yet
LEFT = ".part"  # what follows the name of a log that is not whole yet: of a killed flight it stays
TAKEN = "is being written by another run"
OTHER = "Choose another -o, or wait for it"
_WAIT_S, _TRIES = 0.05, 4  # a run that only looks whether it may write holds a lock for less
_half: set[Path] = set()  # parts of this process that are neither in their place nor gone
_stay: set[Path] = set()  # likewise, of logs: they are there for the user
_swept: set[tuple[Path, int]] = set()  # (folder, process): once is enough, a folder may hold 100 000 files

# -- what may be replaced: a file that the project wrote in the same format

Sign = Callable[[Path], bool]  # tells whether a file that is there was written by the project, in one format


def marked(*marks: bytes) -> Sign:
    """Return the sign of files that begin with the first of `marks` and hold the others in their first 4 kB."""

    def holds(path):
        with path.open("rb") as file:
            head = file.read(4096).lstrip()
        return head.startswith(marks[0]) and all(mark in head for mark in marks)

    return holds


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

    That is a folder, a file that another run writes, and a file of which `sign` says that the
    project did not write it. None: `path` lies in a folder of the project's.
    """
    path = Path(path)
    if path.is_dir():
        raise OutputError("is a folder, not a file", place=str(path), remedy=f"Choose a file: -o {path / 'name'}")
    for each in () if path.name.startswith(PART) else (path, left_by(path)):  # a part is its maker's
        with contextlib.suppress(OSError), each.open("rb") if each.is_file() else contextlib.nullcontext() as file:
            if file and not locked(file, shared=True):
                raise OutputError(TAKEN, place=str(path), remedy=OTHER)
    if sign is None or not path.is_file():
        return
    try:
        own = not path.stat().st_size or sign(path)
    except OSError:  # may perhaps be written, not read
        own = False
    if not own:
        raise OutputError("is there already: not written by cosim in this format, or perhaps edited", place=str(path),
                          remedy="Choose another place, or remove it")  # fmt: skip


# -- one writer per file: an advisory lock goes with the process, so that no stale one can be left behind


class Part:
    """A file that is written beside `path`, open and locked as `file`; `done` puts it in its place, `drop` does not.

    `place` is where it stands meanwhile. With `stays` that is a name which a user finds again, `path` + LEFT, and a
    dropped one stays. What is no regular file, a device or a pipe, is written itself: nothing of it can be lost. Raises
    OutputError, see `claim`, and OSError.
    """

    def __init__(self, path: str | os.PathLike, sign: Sign | None = None, *, stays: bool = False):
        claim(path, sign)
        self._itself = os.path.exists(path) and not os.path.isfile(path)
        # behind a link stands the file that is meant
        self.path = Path(path if self._itself else os.path.realpath(path))
        self._stays = stays and not self._itself
        hidden = self.path.with_name(f"{PART}{secrets.token_hex(4)}{self.path.suffix}")
        self.place = self.path if self._itself else left_by(self.path) if stays else hidden
        if not self._itself:
            if not stays:  # a log in a folder that is not there is a slip
                self.path.parent.mkdir(parents=True, exist_ok=True)
            sweep(self.path.parent)
            (_stay if stays else _half).add(self.place)  # first: an interrupt may strike between any two lines
        file = _open_alone(self.place, 0 if self._itself else getattr(os, "O_NOFOLLOW", 0))
        if file is None:
            raise OutputError(TAKEN, place=str(path), remedy=OTHER)
        self.file = file

    def done(self, *, aside: bool = False) -> None:
        """Put the file in its place, on the disk and with the mode of what stood there, or leave it whole at `place`
        (`aside`). Raises OSError."""
        if not self._itself:
            with self.place.open("rb+") as file:  # `file` may be another one by now: a library has put it there
                os.fsync(file.fileno())
            if self.path.exists():
                self.place.chmod(self.path.stat().st_mode & 0o777)
            if not aside:
                self.place.replace(self.path)
        self._forget()
        self.file.close()

    def drop(self, *, stays: bool | None = None) -> None:
        """Close the file and remove it, unless it `stays`."""
        if not self.file.closed and not self._itself and not (self._stays if stays is None else stays):
            for each in (self.place, left_by(self.place)):  # the latter of a log that a flight could not finish here
                with contextlib.suppress(OSError):
                    each.unlink()
            self._forget()
        with contextlib.suppress(OSError):  # code that flew with it may have closed it
            self.file.close()

    def _forget(self):
        for places in (_half, _stay):
            places.discard(self.place)


def interrupted() -> list[Path]:
    """Remove what an interrupt has left half written: it may strike before anybody knows of a part. Return the parts of
    logs that stay, for `cosim recover`."""
    for place in tuple(_half):
        with contextlib.suppress(OSError):
            place.unlink()
    return [place for place in _stay if place.is_file()]


def left_by(path: str | os.PathLike) -> Path:
    """Return where a killed flight leaves what it has written of the log at `path`."""
    return Path(f"{os.path.realpath(path)}{LEFT}")


def sweep(folder: Path) -> None:
    """Remove what killed processes have left half written in `folder`: files of `PART` that nobody holds locked."""
    if fcntl is None or (folder, os.getpid()) in _swept:
        return
    _swept.add((folder, os.getpid()))
    for path in folder.glob(f"{PART}*"):
        with contextlib.suppress(OSError), path.open("rb") as file:
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
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


def locked(file: Any, *, shared: bool = False) -> bool:
    """Tell whether the open `file` is now this process's alone, or `shared` with others that only look.

    A file system without locks says yes.
    """
    if fcntl is None:
        return True
    try:
        fcntl.flock(file.fileno(), (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a device, or a file system that has none
        return True
    return True


def _open_alone(path, flag=0):
    """Open `path` to be written anew, unbuffered; None when another process writes it, whose content stays.

    `flag` O_NOFOLLOW opens no other file behind a link planted there. A pipe that nobody reads is an error.
    """
    flag |= getattr(os, "O_NONBLOCK", 0)
    for attempt in range(_TRIES):
        if attempt:
            time.sleep(_WAIT_S)
        as_it_is = lambda name, flags: os.open(name, flags & ~os.O_TRUNC | flag, 0o666)  # noqa: E731
        file = open(path, "wb", buffering=0, opener=as_it_is)
        try:
            if locked(file) and _still_there(file, path):
                if os.fstat(file.fileno()).st_size:
                    file.truncate(0)
                return file
        except BaseException:
            file.close()
            raise
        file.close()
    return None


def _still_there(file, path):
    """Tell whether `path` is still the file that was opened: it may have been removed before the lock was taken."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), os.stat(path))
    except FileNotFoundError:
        return False


# -- writing


@contextlib.contextmanager
def beside(path: str | os.PathLike, sign: Sign | None = None) -> Iterator[Path]:
    """Give the name of a file beside `path` to be written, and put it in its place when it is whole; see `claim`.

    What is there stays until then. Raises OutputError when it cannot be written; nothing is left beside `path` then.
    """
    part = None
    try:
        part = Part(path, sign)
        try:
            yield part.place
            part.done()
        finally:
            part.drop()
    except CosimError as error:
        error.place = error.place.replace(str(part.place), str(path)) if part else error.place
        error.remedy = SPACE if PART in error.remedy else error.remedy  # nothing is left there to be recovered
        raise
    except OSError as error:
        raise failed(error, path) from None


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
