"""Put a generated part of README.md in its place: between two marker comments."""

from pathlib import Path

from cosim.errors import OutputError
from cosim.files import replace_text


def markers(name: str) -> tuple[str, str]:
    """Return the two marker comments of part `name`."""
    return f"<!-- {name}: begin -->", f"<!-- {name}: end -->"


def part(text: str, name: str) -> str | None:
    """Return what stands between the markers of `name` in `text`; None where they are not there once each."""
    begin, end = markers(name)
    if text.count(begin) != 1 or text.count(end) != 1:
        return None
    return text.split(begin)[1].split(end)[0].strip("\n")


def replace(path: str | Path, name: str, made: str) -> None:
    """Replace what stands between the markers of `name` in the file at `path`. Raises OutputError."""
    path = Path(path)
    begin, end = markers(name)
    try:
        text = path.read_text(encoding="utf-8")
        if part(text, name) is None:
            raise OutputError("has not the two markers", place=str(path), allowed=f"{begin} and {end}, once each")
    except OSError as error:
        raise OutputError(f"cannot be read: {error.strerror}", place=str(path)) from None
    except UnicodeDecodeError as error:
        raise OutputError(f"is not UTF-8 at byte {error.start}", place=str(path), remedy="Save it as UTF-8") from None
    replace_text(path, f"{text.split(begin)[0]}{begin}\n{made}\n{end}{text.split(end)[1]}")
