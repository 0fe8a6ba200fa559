"""One writer per file: an advisory lock that goes with the process, so that no stale one can be left behind."""

import os
import time

try:
    import fcntl
except ImportError:  # where there are no such locks, nobody is kept out
    fcntl = None  # type: ignore[assignment]

TAKEN = "is being written by another run"
OTHER = "Choose another -o, or wait for it"
_WAIT_S, _TRIES = 0.05, 4  # `reserve` of another run holds the lock for less


def locked(file):
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


def open_alone(path):
    """Open `path` to be written anew, unbuffered; None when another process writes it, whose content stays.

    Raises OSError.
    """
    for attempt in range(_TRIES):
        if attempt:
            time.sleep(_WAIT_S)
        file = open(path, "wb", buffering=0, opener=_untouched)
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


def _untouched(path, flags):
    return os.open(path, flags & ~os.O_TRUNC, 0o666)


def _still_there(file, path):
    """Tell whether `path` is still the file that was opened: it may have been removed before the lock was taken."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), os.stat(path))
    except FileNotFoundError:
        return False
