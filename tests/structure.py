"""Parser of the source for test_structure.py: imports, cycles, public functions without type hints."""

import ast
import functools
import graphlib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("cosim", "fdi", "actuators")


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


def unhinted() -> list[str]:
    """Return the public functions with an argument, or a result, without a type hint; programs that users start from
    are left out."""
    paths = [p for p in sources(*PACKAGES) if p.parent.name not in ("examples", "templates")]
    return [name for path in paths for name, node in public_functions(path) if bare_arguments(node)]
