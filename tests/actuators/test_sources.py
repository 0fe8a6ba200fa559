"""What a source imports, and with it the name of the folder of its compiled kernels, is found however it is written."""

import pytest
import structure

from actuators import source_hash

BLOCKS = """
import beside, os.path as path
from beside.one import (  # a bracket (in a comment)
    a as b,  # and another one )
    c,
)
if path: from beside.two import d; import beside.three
try: \\
    from beside.four \\
        import e
except ImportError: import beside.five as five
    \tfrom .six import f
from . import seven
from .import eight
# some import (that no bracket ends
import beside.nine
f(9)
"""
WANTED = (
    "beside", "os.path", "beside.one", "beside.one.a", "beside.one.c", "beside.two", "beside.two.d", "beside.three",
    "beside.four", "beside.four.e", "beside.five", "six", "six.f", "", ".seven", ".eight",
    "beside.nine",
)  # fmt: skip


@pytest.mark.parametrize("text", [BLOCKS, BLOCKS.replace("\n", "\r\n"), "\ufeff" + BLOCKS.lstrip()])
def test_imports_are_found_wherever_they_stand(text, tmp_path):
    path = tmp_path / "block.py"
    path.write_bytes(text.encode() + b"# \xff")
    assert source_hash._imports(path) == sorted(WANTED)


def test_no_import_of_our_own_sources_is_missed():
    for path in (p for name in source_hash.PACKAGES for p in (source_hash.ROOT / name).rglob("*.py")):
        ours = {name for name in structure.imports(path) if name.partition(".")[0] in source_hash.PACKAGES}
        assert ours <= set(source_hash._imports(path)), path
