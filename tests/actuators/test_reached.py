"""What names stored machine code: every function and constant that a kernel reaches, and nothing else."""

import importlib.util
import sys

import numpy as np
import pytest

from actuators.source_hash import _reads, forget, reached
from cosim.flight.loop import compiling

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
    roots = compiling.shipped()[name].rollout.native._roots
    before, todo, seen = reached(*roots), [root.py_func for root in roots], set()
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
