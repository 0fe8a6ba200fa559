"""Files of the user's: each is there as it was or as it should be, never half of it."""

import contextlib
import os
import tempfile
from pathlib import Path

from cosim.errors import OutputError


def replace(path, make):
    """Let `make(part)` write a file beside `path`, then put it in its place; what is there stays until it is whole.

    Raises OutputError when it cannot be written; nothing is left beside `path` then.
    """
    path = Path(path).resolve()  # behind a link stands the file that is meant
    try:
        if path.exists() and not path.is_file():  # a device or a pipe: nothing of it can be lost, nor put in its place
            return make(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=path.suffix, dir=path.parent)
        os.close(handle)
        part = Path(name)
        try:
            make(part)
            with part.open("rb+") as file:
                os.fsync(file.fileno())
            part.chmod(path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_umask())
            part.replace(path)
        except BaseException:
            with contextlib.suppress(OSError):
                part.unlink()
            raise
    except OSError as error:
        remedy = "Free space there, or choose another place"
        raise OutputError(f"cannot be written: {error.strerror or error}", place=str(path), remedy=remedy) from None


def replace_text(path, text):
    """Put `text` into the file at `path`, in UTF-8; see `replace`."""
    replace(path, lambda part: part.write_text(text, encoding="utf-8"))


def _umask():
    mask = os.umask(0)
    os.umask(mask)
    return mask
