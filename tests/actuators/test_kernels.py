"""Compiled kernels and computed arrays on disk: found again by what they depend on, never where they are damaged."""

import importlib.util
import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import numba
import numpy as np
import pytest

from actuators import kernels
from actuators.kernels import _reads, cached_array, forget, reached
from cosim.flight.loop import compiling

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = """
import json, sys
from pathlib import Path
import numpy as np
from actuators import kernels
from cosim.flight.blocks import hinge_model, manoeuvre
kernels.SHIPPED = Path(sys.argv[1])
told = []
asked = [m.rollout.native for m in (hinge_model, manoeuvre)]
told.append(kernels.compile_ahead(asked, lambda done, total: told.append([done, total])))
p = np.zeros(2, manoeuvre.PARAMS)
u, log = np.zeros((2, 3), manoeuvre.INPUTS), np.zeros((2, 3), manoeuvre.STATE)
manoeuvre.rollout(manoeuvre.init(p), u, p, 0.005, log)
files = [*map(str, asked[1].files)]
print(json.dumps([told, "numba" in sys.modules, log.view("f8").ravel().tolist(), files]))
"""


@pytest.mark.skipif(kernels.cores() < 2, reason="one core compiles as it goes")
def test_a_kernel_is_compiled_once_and_loaded_from_the_release_or_the_cache_unless_a_bit_is_wrong(tmp_path):
    """A process that loads machine code never imports Numba; LLVM would end the process for half a file."""
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}

    def run():
        command = [sys.executable, "-c", SCRIPT, str(tmp_path / "objects")]
        return json.loads(subprocess.run(command, env=env, capture_output=True, text=True, check=True).stdout)

    first, second = run(), run()
    assert first[0] == [[0, 2], [1, 2], [2, 2], 2] and second[0] == [0]
    assert first[1:3] == second[1:3] and not second[1]
    shipped, own = map(Path, first[3])
    shipped.parent.mkdir(parents=True)
    own.rename(shipped)
    assert run()[1:3] == first[1:3]
    held = bytearray(shipped.read_bytes())
    held[len(held) // 2] ^= 1
    shipped.write_bytes(held)
    damaged = run()
    assert damaged[1] and damaged[2] == first[2]


def test_what_another_thread_compiles_beside_a_kernel_is_compiled_as_ever():
    told = []
    thread = threading.Thread(target=lambda: told.append(numba.njit(lambda x: 2.0 * x)(1.5)))
    with kernels._intermediate_code_only():
        thread.start()
        thread.join(1.0)
    thread.join()
    assert told == [3.0]


def test_a_computed_array_is_found_again_bit_for_bit_and_computed_anew_where_anything_differs(tmp_path, monkeypatch):
    monkeypatch.setattr(kernels, "cache", lambda name: tmp_path)
    calls = []

    def ask(key):
        return cached_array(key, float, lambda: calls.append(key) or np.array([0.1, np.nan, -0.0]), __file__)

    first, again = ask("a"), ask("a")
    assert first.tobytes() == again.tobytes() and calls == ["a"]
    again[0] = 9.0  # nobody else's
    assert ask("a")[0] == 0.1
    (file,) = tmp_path.glob("*.kept")
    file.write_bytes(file.read_bytes()[:-1])
    assert ask("a")[0] == 0.1 and calls == ["a", "a"]
    ask("b")
    monkeypatch.setattr(kernels, "_processor", lambda: "another")
    ask("b")
    monkeypatch.setattr(kernels, "ARRAYS", 4)  # a study over many points leaves no more
    for key in range(5):
        ask(key)
    assert len(list(tmp_path.glob("*.kept"))) == 4
    monkeypatch.setattr(kernels, "cache", lambda name: None)
    assert ask("b")[0] == 0.1 and calls == ["a", "a", "b", "b", *range(5), "b"]


OWN = """
import math
from . import gains
from .gains import LIMIT, half

SHARES = np.array([0.5, 0.25])
WORDS = ("a", "b")
UNREAD = 1.0


def made(factor):
    def scaled(value):
        return factor * value  # of what is around it
    return scaled


twice = made(2.0)


def unread(x):
    return gains.UNREAD


def step(x, u, p, dt):
    rest = [half(value) for value in (u,
                                      LIMIT)]
    x[0] = math.tanh(rest[0]) * gains.GAIN * SHARES[1] + twice(len(WORDS))
    return x
""".replace("import math", "import math\n\nimport numpy as np\n")
GAINS = "LIMIT = 3\nGAIN = 4.0\nUNREAD = 5.0\n\n\ndef half(value):\n    return quarter(value) * 2\n\n\n"
GAINS += "def quarter(value):\n    return value / 4\n"


def key(folder, own=OWN, gains=GAINS):
    """Return the digest of `step` of a package that is written and imported anew."""
    folder.mkdir(exist_ok=True)
    (folder / "gains.py").write_text(gains)
    (folder / "__init__.py").write_text(own)
    forget()
    for name in ("own_key", "own_key.gains"):
        sys.modules.pop(name, None)
    spec = importlib.util.spec_from_file_location(
        "own_key", folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    sys.modules["own_key"] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return reached(module.step)


@pytest.mark.parametrize(
    "old, new",
    [
        ("LIMIT = 3", "LIMIT = 3.0"), ("GAIN = 4.0", "GAIN = 4.5"), ("value / 4", "value / 5"), ("* 2\n", "* 2.5\n"),
        ("0.25]", "0.26]"), ('("a", "b")', '("a", "c")'), ("made(2.0)", "made(3.0)"),
        ("factor * value", "factor + value"), ("(u,\n", "(p,\n"), ("math.tanh", "math.sinh"), ("LIMIT)]", "-LIMIT)]"),
    ],
)  # fmt: skip
def test_a_constant_or_a_callee_that_changes_is_other_code(old, new, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    before = key(tmp_path / "a")
    assert (old in OWN) + (old in GAINS) == 1
    assert key(tmp_path / "a", OWN.replace(old, new), GAINS.replace(old, new)) != before


@pytest.mark.parametrize(
    "old, new",
    [("UNREAD = 1.0", "UNREAD = 2.0"), ("UNREAD = 5.0", "UNREAD = 6.0"), ("return gains.UNREAD", "return 1"),
     ("import math\n", '"""Another text."""\n\nimport json\nimport math\n')],
)  # fmt: skip
def test_what_a_kernel_does_not_reach_does_not_compile_it_again(old, new, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    before = key(tmp_path / "a")
    assert key(tmp_path / "b", OWN.replace(old, new), GAINS.replace(old, new)) == before


@pytest.mark.parametrize("name", compiling.shipped())
def test_every_constant_of_a_shipped_kernel_is_in_its_digest(name, monkeypatch):
    """Of each function that it reaches one constant is changed, and one callee is taken for another."""
    roots = compiling.shipped()[name].rollout.native.roots
    before, todo, seen = reached(*roots), [root.py_func for root in roots if hasattr(root, "py_func")], set()
    while todo:
        function = todo.pop()
        if function in seen:
            continue
        seen.add(function)
        read = [(n, getattr(v, "py_func", v)) for n, v in _reads(function)]
        todo += [v for _, v in read if hasattr(v, "__code__")]
        own = {n: v for n, v in read if n in function.__globals__}
        numbers = [n for n, v in own.items() if isinstance(v, int | float)]
        callees = [n for n, v in own.items() if hasattr(v, "__code__")]
        for n, other in [*((n, own[n] + 0.5) for n in numbers[:1]), *((n, np.hypot) for n in callees[:1])]:
            with monkeypatch.context() as patch:
                patch.setitem(function.__globals__, n, other)
                assert reached(*roots) != before, (function, n)
    assert reached(*roots) == before
