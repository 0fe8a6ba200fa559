"""The text of an exception that user code raised."""

import os
import traceback
from pathlib import Path


def sentence(error: BaseException, part: str | os.PathLike = "") -> str:
    """Return in one line what user code raised, with the last line that it passed of the file or folder `part`."""
    try:
        said = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException:  # its own text is a user's code, too
        said = type(error).__name__
    own = os.path.realpath(part) if part else os.sep
    here = [f for f in traceback.extract_tb(error.__traceback__) if os.path.realpath(f.filename).startswith(own)]
    return f"{said} ({Path(here[-1].filename).name}:{here[-1].lineno})" if part and here else said
