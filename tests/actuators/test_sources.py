"""What sources import is remembered for the next start, by every tree of sources for itself."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = """
import ast, sys
from pathlib import Path
parsed = []
parse, ast.parse = ast.parse, lambda source, *more, **named: parsed.append(1) or parse(source, *more, **named)
from actuators import source_hash
sources.MOST, sources.TREES = 4, 2
for name in ("block", "native", "kept"):
    sources.closure(Path(sources.__file__).with_name(name + ".py"))
print(len(parsed))
"""


def start(tree, cache):
    """Return how many sources a process of this tree had to parse."""
    env = os.environ | {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(tree)}
    told = subprocess.run([sys.executable, "-c", SCRIPT], cwd=tree, env=env, capture_output=True, text=True, check=True)
    return int(told.stdout)


def tree(folder):
    """Return a tree of four sources that import one another, so that a table of four holds just them."""
    package = folder / "actuators"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    shutil.copy(ROOT / "actuators" / "sources.py", package)
    for name, line in (
        ("block", "from actuators import native"),
        ("native", "import actuators.disk_cache"),
        ("kept", ""),
    ):
        (package / f"{name}.py").write_text(f"{line}\n# {folder.name}\n")
    return folder


def test_trees_that_share_a_cache_do_not_push_each_others_sources_out(tmp_path):
    one, other, cache = tree(tmp_path / "one"), tree(tmp_path / "other"), tmp_path / "cache"
    first = start(one, cache), start(other, cache)
    assert min(first) > 2
    assert (start(one, cache), start(other, cache)) == (0, 0)


def test_tables_of_trees_that_are_gone_go(tmp_path):
    cache = tmp_path / "cache"
    for name in ("one", "two", "three"):
        start(tree(tmp_path / name), cache)
    tables = sorted((cache / "cosim-kernels").glob("imports-*.json"))
    assert len(tables) == 2 and all(json.loads(table.read_text()) for table in tables)
    assert start(tmp_path / "three", cache) == 0
