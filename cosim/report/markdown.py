"""Put a generated part of README.md in its place: between two marker comments."""

from pathlib import Path

from cosim import files
from cosim.errors import OutputError
from cosim.files import regular


def markers(name: str) -> tuple[str, str]:
    """Return the two marker comments of part `name`."""
    return f"<!-- {name}: begin -->", f"<!-- {name}: end -->"


def part(text: str, name: str) -> str | None:
    """Return what stands between the markers of `name` in `text`; None where they are not there once each, in order."""
    begin, end = markers(name)
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(end) < text.index(begin):
        return None
    return text.split(begin)[1].split(end)[0].strip("\r\n")


def read(path: str | Path) -> str:
    """Return the text of the file at `path`, line ends as they stand in it. Raises OutputError."""
    path = Path(path)
    regular(path, OutputError)
    try:
        return path.read_bytes().decode("utf-8")
    except OSError as error:
        raise OutputError(f"cannot be read: {error.strerror}", place=str(path)) from None
    except UnicodeDecodeError as error:
        raise OutputError(f"is not UTF-8 at byte {error.start}", place=str(path), remedy="Save it as UTF-8") from None


def put(text: str, name: str, made: str, path: str | Path) -> str:
    """Return `text`, that of the file at `path`, with `made` between the markers of `name`, in the text's line ends.
    Raises OutputError where the markers are not there once each."""
    begin, end = markers(name)
    if part(text, name) is None:
        raise OutputError("has not the two markers", place=str(path), allowed=f"{begin} and {end}, once each")
    line = "\r\n" if "\r\n" in text else "\n"
    inner = f"\n{made}\n".replace("\r\n", "\n").replace("\n", line)
    return f"{text.split(begin)[0]}{begin}{inner}{end}{text.split(end)[1]}"


def save(path: str | Path, text: str) -> None:
    """Write `text` as it stands, its line ends too, to the file at `path`. Raises OutputError."""
    files.replace(path, lambda new: new.write_bytes(text.encode("utf-8", "backslashreplace")))


def replace(path: str | Path, name: str, made: str) -> None:
    """Replace what stands between the markers of `name` in the file at `path`. Raises OutputError."""
    save(path, put(read(path), name, made, path))
