"""Files of a user's: loaded in one way, and identified by one digest over all that they are made of.

A detector, law or actuator in Python, an FMU, a folder with an aircraft. The digest of a Python file is that of the
file, of every module that it imports from beside it, and of every file that it opens while it is loaded, or names in a
list `files` at its top: what another library opens past Python, or what is opened later, must stand there. Name and
digest say which file is meant; the path says only where it lies on this machine.
"""

import hashlib
import importlib.util
import logging
import os
import sys
import sysconfig
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, redirect_stdout
from functools import cache
from importlib import machinery
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from actuators.source_hash import cache_root, closure, forget
from cosim.errors import CosimError, ScenarioError

BLOCK = 1 << 20  # [byte] read at a time
CHANGED, AGREE = "is not the file that the scenario means: its digest differs", "Read it, then remove or renew sha256"
SYSTEM = tuple(Path(p) for p in ("/proc", "/sys", "/dev", "/etc", "/usr", "/lib", "/run"))  # nothing there is a user's
OURS = Path(__file__).resolve().parents[2]


class UserFile(NamedTuple):
    """Which file of a user's is meant: its name, the SHA-256 over all that it is made of."""

    name: str
    sha256: str


class Loaded(NamedTuple):
    """A Python file that was run: its module, what it is, the files that it is made of."""

    module: ModuleType
    file: UserFile
    files: tuple[Path, ...]


class _Load:
    """What is known of a file while, and after, it is loaded."""

    def __init__(self, path: Path):
        self.path, self.home = path, path.parent
        self.used = {path}
        self.loading = True

    def opens(self, path: Path) -> None:
        """Take a file that the code opens into the digest. Raises ScenarioError when that comes too late."""
        if path in self.used or not _counts(path, self.home):
            return
        if not self.loading:
            said = f"opens {path.name} after it was loaded, so that its digest does not tell of it"
            raise ScenarioError(said, place=self.path.name, remedy=f'Say files = ["{path.name}"] at its top')
        self.used.add(path)


_log = logging.getLogger("cosim")  # the command line prints what is told
_lock = threading.RLock()
_loaded: dict[Path, tuple[dict, Loaded]] = {}  # what is loaded stays so until one of its files changes
_digests: dict[Path, tuple[dict, str]] = {}  # of what is only read
_owners: dict[str, _Load] = {}  # source file -> the load that ran it
_beside: dict[str, ModuleType] = {}  # modules that loads have brought into the process


def found(name: str, folder: Path | None, place: str) -> str:
    """Return the path of a file of a user's, from beside the scenario (`folder`) or from here. Raises ScenarioError."""
    path = Path(os.path.expanduser(name))
    for here in (folder / path if folder else path, path):
        if os.path.isfile(here):
            return os.path.abspath(here)
    raise ScenarioError("no such file", place=f"{place} = {name}")


def identity(path: str | os.PathLike, error: Callable[[str], Exception] | None = None) -> UserFile:
    """Return what the file or folder at `path` is; a Python file is loaded as `load` does. Raises ScenarioError."""
    path = Path(os.path.realpath(os.path.expanduser(path)))
    if path.suffix == ".py" and path.is_file():
        return load(path, error).file
    with _lock:
        held, files = _digests.get(path), _all(path)
        stamps = _stamps(files)
        if held is None or held[0] != stamps:
            held = _digests[path] = stamps, _digest(files, path if path.is_dir() else path.parent)
            if path.suffix == ".fmu":
                _announce(UserFile(path.name, held[1]))
    return UserFile(path.name, held[1])


def identity_unrun(folder: Path) -> str:
    """Return the digest of a file of which `folder` holds all that it is made of and nothing else, hidden files among
    it; nothing is run."""
    return _digest([path for path in folder.rglob("*") if not path.is_dir()], folder)


def contents(path: str | os.PathLike) -> dict[str, Path]:
    """Return {name: path} of what a file or folder is made of, names from its folder on; a Python file is loaded. What
    lies elsewhere is left out."""
    path = Path(os.path.realpath(os.path.expanduser(path)))
    files = load(path).files if path.suffix == ".py" else _all(path)
    return {file.relative_to(path.parent).as_posix(): file for file in files if path.parent in file.parents}


def load(path: str | os.PathLike, error: Callable[[str], Exception] | None = None) -> Loaded:
    """Run a Python file once per content of all that it is made of; its neighbours can be imported.

    Whatever it raises becomes `error(text)`, by default a ScenarioError that names it.
    """
    path = Path(os.path.realpath(os.path.expanduser(path)))
    made = error or (lambda text: ScenarioError(text, place=str(path)))
    if path.suffix != ".py":
        raise made("is no Python file; allowed: a file that ends in .py")
    with _lock:
        if path in _loaded and _loaded[path][0] == _stamps(_loaded[path][1].files):
            return _loaded[path][1]
        if path in _loaded:
            forget()  # compiled code of the file as it was
        done = _load(path, made)
        _loaded[path] = _stamps(done.files), done
        if OURS / "cosim" not in path.parents:
            _announce(done.file)
        return done


def _announce(file):
    _log.info("runs code: %s, sha256 %s", *file)


def identity_of_source(path: Path) -> str:
    """Return the digest of a source that a program has imported itself: with the neighbours that it imports."""
    path = Path(os.path.realpath(path))
    return _digest({path} | {p for p in closure(path) if path.parent in p.parents}, path.parent)


def opened(path: str | os.PathLike) -> None:
    """Tell that the user's code that is running opens `path` by a library that Python does not see."""
    _tell(path, sys._getframe(1))


def aside() -> AbstractContextManager:
    """Send what a user's code prints to standard error: standard output is the program's own."""
    return redirect_stdout(sys.stderr)


def where(error: BaseException, path: Path | None = None) -> str:
    """Return an exception as one line with the last line of user code that it passed."""
    import traceback

    try:
        said = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")
    except KeyboardInterrupt:
        raise
    except BaseException:  # its own text is a user's code, too
        said = type(error).__name__
    if isinstance(error, SyntaxError):
        return f"{said}"
    here = [f for f in traceback.extract_tb(error.__traceback__) if path is None or Path(f.filename).name == path.name]
    return f"{said} ({Path(here[-1].filename).name}:{here[-1].lineno})" if here else said


@contextmanager
def guarded(error: Callable[[str], Exception], path: Path | None = None) -> Iterator[None]:
    """Run a user's code: whatever it raises, but Ctrl-C and an error of ours, is error("does not run: ...")."""
    try:
        with aside():
            yield
    except (KeyboardInterrupt, CosimError):
        raise
    except BaseException as wrong:
        raise error(f"does not run: {where(wrong, path)}") from wrong


def _load(path, error):
    own = _Load(path)
    finder, here = _Beside(own), os.getcwd()
    name = f"cosim_user_{path.stem}_{hashlib.sha256(path.read_bytes()).hexdigest()[:12]}"
    others = {n: sys.modules.pop(n) for n, m in list(sys.modules.items()) if _lies(m, own.home) and n != "__main__"}
    for gone in _beside.keys() - others.keys():
        sys.modules.pop(gone, None)
    before = set(sys.modules)
    _watch()
    _owners[str(path)] = own
    sys.meta_path.insert(next((i for i, f in enumerate(sys.meta_path) if f is machinery.PathFinder), 0), finder)
    spec = importlib.util.spec_from_file_location(name, path, loader=_Source(name, str(path)))
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        with guarded(error, path):
            spec.loader.exec_module(module)
        for declared in _declared(module, error):
            own.opens(declared)
    except BaseException:
        sys.modules.pop(name, None)
        raise
    finally:
        own.loading = False
        if finder in sys.meta_path:
            sys.meta_path.remove(finder)
        os.chdir(here)
        new = {n: m for n, m in sys.modules.items() if n not in before and n != name and _lies(m, own.home)}
        _beside.clear()
        _beside.update(new)
        sys.modules.update({n: m for n, m in others.items() if n not in new and n not in _beside})
    own.used |= {Path(os.path.realpath(str(m.__file__))) for m in new.values()}
    files = tuple(sorted(p for p in own.used if p.is_file()))
    return Loaded(module, UserFile(path.name, _digest(files, own.home)), files)


def _declared(module, error):
    """Return the files that a module names in its list `files`."""
    names = getattr(module, "files", ())
    if not isinstance(names, list | tuple) or not all(isinstance(n, str | os.PathLike) for n in names):
        return []
    paths = [Path(os.path.realpath(Path(module.__file__).parent / n)) for n in names]
    for path, name in zip(paths, names):
        if not path.is_file():
            raise error(f"files: {os.fspath(name)}: no such file")
    return paths


def _lies(module, home):
    """Tell whether a module's source lies in the folder of a user's file, and not in an installation there."""
    file = getattr(module, "__file__", None)
    return isinstance(file, str) and file.startswith(f"{home}{os.sep}") and _counts(Path(os.path.realpath(file)), home)


class _Source(machinery.SourceFileLoader):
    """Compile a source as it stands: compiled code beside it is known by a time in whole seconds, and may be older."""

    def get_code(self, fullname: str) -> Any:
        return self.source_to_code(self.get_data(self.path), self.path)


class _Beside:
    """Find the modules that lie beside a user's file, and in packages there."""

    def __init__(self, own: _Load):
        self._own = own
        self._kinds = (machinery.ExtensionFileLoader, machinery.EXTENSION_SUFFIXES), (_Source, [".py"])

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> machinery.ModuleSpec | None:
        """Return the spec of a module there, None for any other."""
        for folder in [self._own.home] if path is None else path:
            if path is None or self._own.home in Path(os.path.realpath(folder)).parents:
                spec = machinery.FileFinder(str(folder), *self._kinds).find_spec(name)
                if spec is not None and spec.loader is not None and spec.origin:
                    _owners[os.path.realpath(spec.origin)] = _owners[spec.origin] = self._own
                    return spec
        return None


def _installed():
    """Return the folders of Python, of what is installed for it, and of caches."""
    paths = [sys.prefix, sys.base_prefix, *(sysconfig.get_path(n) for n in ("stdlib", "purelib", "platlib"))]
    caches = [os.environ.get(n, "") for n in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")]
    return [Path(os.path.realpath(p)) for p in (*paths, *caches, str(cache_root() or "")) if p]


def _counts(path, home):
    """Tell whether a file is a user's, and not of an installation, a cache or the system."""
    if home in path.parents:
        inside = path.relative_to(home).parts[:-1]
        within = [p for p in _installed() if p in path.parents and home in p.parents]
        return not within and not any(p.startswith(".") or p == "__pycache__" for p in inside)
    if any(root in path.parents for root in (*SYSTEM, OURS, *_installed())):
        return False
    return path.is_file() and not any(p.startswith(".") or p == "__pycache__" for p in path.parts)


@cache
def _watch():
    """Hear from now on of every file that Python opens; such a hook stays for as long as the process lasts."""
    sys.addaudithook(_heard)


def _heard(event, given):
    if event != "open" or not _owners:
        return
    path, mode, flags = given
    if not isinstance(path, str | bytes | os.PathLike):
        return
    written = "r" not in mode if isinstance(mode, str) else isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR)
    if not written:
        _tell(path, sys._getframe(1))


def _tell(path, frame):
    """Tell the load whose code is on the stack that it opens a file; what an import opens is that module's affair."""
    while frame is not None and not frame.f_code.co_filename.startswith("<frozen importlib"):
        own = _owners.get(frame.f_code.co_filename)
        if own is not None:
            own.opens(Path(os.path.realpath(os.fsdecode(path))))
            return
        frame = frame.f_back


def _all(path):
    """Return the file, or every file of a folder but hidden ones and compiled code."""
    if not path.is_dir():
        return (path,)
    every = (Path(top) / name for top, _, names in os.walk(path) for name in names)
    return tuple(sorted(p for p in every if not any(
        part.startswith(".") or part == "__pycache__" for part in p.relative_to(path).parts)))  # fmt: skip


def _stamps(files):
    """Return what changes with every change of a file."""
    out = {}
    for path in files:
        try:
            about = path.stat()
        except OSError:
            continue
        out[path] = about.st_mtime_ns, about.st_ctime_ns, about.st_size, about.st_ino
    return out


def _digest(files, home):
    out = hashlib.sha256()
    for path in sorted(files):
        name = path.relative_to(home).as_posix() if home in path.parents else path.name
        out.update(os.fsencode(name) + b"\0")
        try:
            with path.open("rb") as file:
                while block := file.read(BLOCK):
                    out.update(block)
        except OSError as error:
            raise ScenarioError(f"cannot be read: {error.strerror}", place=str(path)) from None
    return out.hexdigest()
