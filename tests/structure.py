"""How the source is built, counted: `python tests/structure.py` prints it, `--rooms` writes the tables of files.

Floors of the imports inside cosim, lines, file sizes, public functions without docstring or type hints.
test_structure.py holds what must stay.
"""

import argparse
import ast
import functools
import graphlib
import importlib
import inspect
import re
import statistics
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("cosim", "fdi", "actuators")
API = ROOT / "cosim" / "API.md"
BEGIN, END = "<!-- files: begin -->", "<!-- files: end -->"
COLUMNS = ROOT / "cosim" / "campaign" / "README.md"


def sources(*folders: str) -> list[Path]:
    """Return the Python files of `folders` of the repository, sorted."""
    return sorted(p for name in folders for p in (ROOT / name).rglob("*.py"))


def module(path: Path) -> str:
    """Return the dotted name of a source file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@functools.cache
def parsed(path: Path) -> ast.Module:
    """Return the syntax tree of a source file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def imports(path: Path) -> set[str]:
    """Return what a source file imports, wherever it does so: modules, and names in them."""
    package = path.relative_to(ROOT).parts[:-1]
    out = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            out |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            base = ".".join((*above, *([node.module] if node.module else ())))
            out |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    return out


def layers() -> list[str]:
    """Return the rooms of cosim from the roof down, as the import contract has them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    return next(c["layers"] for c in contracts["contracts"] if c.get("containers") == ["cosim"])


def rooms() -> list[str]:
    """Return the rooms of cosim: folders of modules that other rooms may import."""
    return sorted(p.parent.name for p in (ROOT / "cosim").glob("*/__init__.py"))


def loose_modules() -> int:
    """Return how many modules of cosim lie in no room."""
    return len(list((ROOT / "cosim").glob("*.py"))) - 1


def floors() -> int:
    """Return the number of floors of the rooms: the longest way down through their imports, which the contract orders.
    """
    names, below = layers(), {}
    for path in sources("cosim"):
        here, *_ = [*module(path).split(".")[1:], ""]
        found = {name.split(".")[1] for name in imports(path) if name.startswith("cosim.")}
        below.setdefault(here, set()).update(found - {here})
    height: dict[str, int] = {}
    for room in reversed(names):
        height[room] = 1 + max((height.get(to, 0) for to in below.get(room, ())), default=0)
    return max(height.values())


def cycle() -> list[str]:
    """Return the modules of a cycle of imports, late ones among them, in order; [] where there is none.

    A package that imports its own modules is no cycle with them: an import of `room.module` is one of the module.
    """
    paths = {module(path): path for path in sources(*PACKAGES)}
    graph = {}
    for name, path in paths.items():
        found = imports(path) & paths.keys()
        graph[name] = {other for other in found - {name} if not any(deeper.startswith(other + ".") for deeper in found)}
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return list(error.args[1])
    return []


def statements(room: Path) -> int:
    """Return how many statements the Python files of a folder have."""
    return sum(isinstance(node, ast.stmt) for path in room.rglob("*.py") for node in ast.walk(parsed(path)))


def public_functions(path: Path) -> Iterator[tuple[str, ast.FunctionDef]]:
    """Yield (name, definition) of the public functions and methods of a source file."""

    def walk(body, prefix):
        for node in body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                yield from walk(node.body, f"{prefix}{node.name}.")
            elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                if not node.name.startswith("_") or node.name in ("__init__", "__call__"):
                    yield f"{prefix}{node.name}", node

    yield from walk(parsed(path).body, f"{module(path)}.")


def is_kernel(node: ast.FunctionDef) -> bool:
    """Return whether a function is compiled: its arguments are records, whose dtypes say what they are."""
    names = [d.func if isinstance(d, ast.Call) else d for d in node.decorator_list]
    return any((n.id if isinstance(n, ast.Name) else getattr(n, "attr", "")) == "kernel" for n in names)


def bare_arguments(node: ast.FunctionDef) -> list[str]:
    """Return the arguments of a function without a type hint, "return" among them; none for a kernel."""
    if is_kernel(node):
        return []
    a = node.args
    every = [*a.posonlyargs, *a.args, *a.kwonlyargs, *filter(None, (a.vararg, a.kwarg))]
    bare = [x.arg for i, x in enumerate(every) if x.annotation is None and not (i == 0 and x.arg in ("self", "cls"))]
    return bare + (["return"] if node.returns is None and node.name != "__init__" else [])


def hinted() -> list[Path]:
    """Return the source files whose public functions have type hints: all but the programs that users start from."""
    return [p for p in sources(*PACKAGES) if p.parent.name not in ("examples", "templates")]


def without(check, paths: list[Path]) -> list[str]:
    """Return the public functions of the files for which `check(definition)` is true."""
    return [name for path in paths for name, node in public_functions(path) if check(node)]


def undocumented() -> list[str]:
    """Return the public functions without a docstring."""
    dunder = ("__init__", "__call__")
    return without(lambda node: not ast.get_docstring(node) and node.name not in dunder, sources(*PACKAGES))


def unhinted() -> list[str]:
    """Return the public functions with an argument, or a result, without a type hint."""
    return without(lambda node: bool(bare_arguments(node)), hinted())


def counts() -> dict[str, object]:
    """Return the counts as {what: number or words}."""
    size = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in sources(*PACKAGES)}
    tests = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in sources("tests")}
    largest = max(size, key=lambda p: size[p])
    every = [node for path in size for _, node in public_functions(path)]
    hints = [bare_arguments(node) for path in hinted() for _, node in public_functions(path)]
    return {
        "rooms of cosim": len(rooms()),
        "loose modules of cosim": loose_modules(),
        "floors": floors(),
        "cycles of imports": " -> ".join(cycle()) or "none",
        "source files": len(size),
        "lines of source": sum(size.values()),
        "lines of tests": sum(tests.values()),
        "largest file": f"{size[largest]} {largest.relative_to(ROOT)}",
        "median file": statistics.median(size.values()),
        "files over 300 lines": sum(n > 300 for n in size.values()),
        "public functions": len(every),
        "of them kernels": sum(map(is_kernel, every)),
        "without docstring": len(undocumented()),
        "not wholly hinted": sum(map(bool, hints)),
        "arguments and results without a hint": sum(map(len, hints)),
    }


def first_sentence(path: Path) -> str:
    """Return the first paragraph of a module's docstring as one line."""
    text = ast.get_docstring(parsed(path)) or ""
    return " ".join(text.split("\n\n")[0].split()).replace("|", "\\|")


def files_table(folder: Path) -> str:
    """Return the table of a folder's modules, from their docstrings."""
    own = [p for p in sorted(folder.glob("*.py")) if p.name != "__main__.py"]
    told = [(p.name, first_sentence(p)) for p in own]
    below = [(f"{p.name}/", first_sentence(p / "__init__.py")) for p in sorted(folder.iterdir()) if is_package(p)]
    rows = [f"| [`{name}`]({name}) | {text} |" for name, text in told + below if text]
    return "\n".join(["| file | what it is |", "|---|---|", *rows])


def is_package(path: Path) -> bool:
    """Return whether `path` is a folder with an __init__.py."""
    return (path / "__init__.py").is_file()


def readmes() -> list[Path]:
    """Return the READMEs with a table of files."""
    found = [p for name in (*PACKAGES, "tests") for p in sorted((ROOT / name).rglob("README.md"))]
    return [p for p in found if BEGIN in p.read_text(encoding="utf-8")]


def with_table(path: Path) -> str:
    """Return the text of a README with the table of its folder's files as they are."""
    before, rest = path.read_text(encoding="utf-8").split(BEGIN)
    return f"{before}{BEGIN}\n{files_table(path.parent)}\n{END}{rest.split(END)[1]}"


MORE = (  # beside the names of cosim itself: what programs use of the rooms
    "cosim.campaign.run.run_campaign", "cosim.campaign.dataset.make", "cosim.compare.compare", "cosim.replay.replay",
    "cosim.replay.map.diagnose", "cosim.report.flight_report", "cosim.report.comparison_report",
    "actuators.block.dtype", "actuators.block.kernel", "actuators.block.entry", "actuators.block.record",
    "fdi.common.record.Detector", "fdi.common.record.Estimate", "fdi.common.record.Site",
)  # fmt: skip


def api() -> str:
    """Return cosim/API.md: signature and docstring of every public name."""
    import cosim

    named = {f"cosim.{name}": getattr(cosim, name) for name in cosim.__all__}
    for name in MORE:
        room, _, last = name.rpartition(".")
        named[name] = getattr(importlib.import_module(room), last)
    head = "Made from the docstrings by `python tests/structure.py --rooms`. Units are SI where none is said."
    return f"# The public names\n\n{head}\n" + "".join(_entry(name, value) for name, value in named.items())


def _entry(name: str, value: object) -> str:
    """Return the section of a function, or of a class with its public methods."""
    out = f"\n## {name}{_signature(value)}\n\n```text\n{inspect.getdoc(value)}\n```\n"
    for own, method in sorted(vars(value).items()) if inspect.isclass(value) else ():
        made = method.fget if isinstance(method, property) else method
        if not own.startswith("_") and inspect.isfunction(made) and made.__doc__:
            call = "" if isinstance(method, property) else _signature(made)
            out += f"\n- `{own}{call}`: {' '.join((inspect.getdoc(made) or '').split())}"
    return out.rstrip() + "\n"


def _signature(value: object) -> str:
    """Return the call of a function or class as its source has it; "" of an exception or a table of fields."""
    if inspect.isclass(value) and (issubclass(value, Exception) or hasattr(value, "model_fields")):
        return ""
    text = str(inspect.signature(value))  # type: ignore[arg-type]
    text = re.sub(r"<function .*? at 0x[0-9a-f]+>", "...", text)  # Site.<lambda> has brackets of its own
    return re.sub(r"<(\w+ [^>]*|factory)>", "...", text).replace("typing.", "").replace("pathlib.", "").replace("'", "")


def with_columns() -> str:
    """Return the README of campaigns with the table of a row's columns as they are."""
    from cosim.judge.row import FIELDS

    head, rest = COLUMNS.read_text(encoding="utf-8").split("<!-- columns: begin -->")
    rows = [f"| `{f.name}` | {f.unit} | {f.meaning.replace('|', chr(92) + '|')} |" for f in FIELDS]
    made = "\n".join(["| column | unit | meaning |", "|---|---|---|", *rows])
    return f"{head}<!-- columns: begin -->\n{made}\n<!-- columns: end -->{rest.split('<!-- columns: end -->')[1]}"


def main() -> None:
    """Print the counts; with --rooms write the tables of files and the page of public names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rooms", action="store_true", help="write the tables of files and cosim/API.md")
    given = parser.parse_args()
    if given.rooms:
        for path in readmes():
            path.write_text(with_table(path), encoding="utf-8")
        API.write_text(api(), encoding="utf-8")
        COLUMNS.write_text(with_columns(), encoding="utf-8")
    for what, value in counts().items():
        print(f"{what:38}{value}")
    for room in [*(ROOT / "cosim" / name for name in rooms()), *(ROOT / name for name in (*PACKAGES[1:], "tests"))]:
        lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in room.rglob("*.py"))
        print(f"{room.relative_to(ROOT)!s:20}{lines:8} lines{statements(room):8} statements")


if __name__ == "__main__":
    sys.exit(main())
