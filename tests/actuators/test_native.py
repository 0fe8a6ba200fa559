"""Machine code of the blocks: compiled on all cores, stored, and loaded by a process that never imports Numba."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = """
import json, sys
import numpy as np
from actuators import object_cache
from actuators.precompile import compile_ahead
from cosim.flight.blocks import hinge_model, manoeuvre
told = []
asked = [m.rollout.native for m in (hinge_model, manoeuvre)]
told.append(compile_ahead(asked, lambda done, total: told.append([done, total])))
p = np.zeros(2, manoeuvre.PARAMS)
u, log = np.zeros((2, 3), manoeuvre.INPUTS), np.zeros((2, 3), manoeuvre.STATE)
manoeuvre.rollout(manoeuvre.init(p), u, p, 0.005, log)
print(json.dumps([told, object_cache.counts, "numba" in sys.modules, log.view("f8").ravel().tolist()]))
"""


@pytest.mark.skipif(len(getattr(os, "sched_getaffinity", lambda _: [0])(0)) < 2, reason="one core compiles as it goes")
def test_what_one_process_compiled_another_loads_without_numba(tmp_path):
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", SCRIPT]
    first, second = (
        json.loads(subprocess.run(command, env=env, capture_output=True, text=True, check=True).stdout)
        for _ in range(2)
    )
    assert first[0] == [[0, 2], [1, 2], [2, 2], 2]
    assert second[0] == [0]
    for told in (first, second):
        assert told[1:3] == [{"compiled": 0, "loaded": 1}, False]
    assert first[3] == second[3]


def test_code_that_is_not_as_written_is_not_loaded(tmp_path):
    """A power cut leaves files cut or empty, a disk flips bits: LLVM would end the process."""
    from actuators import object_cache

    file = tmp_path / "x.o"
    object_cache.write_whole(file, b"code")
    whole = file.read_bytes()
    assert object_cache.read_whole(file) == b"code"
    for held in (b"", whole[:-1], whole + b"x", whole.replace(b"c", b"d"), bytes(len(whole))):
        file.write_bytes(held)
        assert object_cache.read_whole(file) is None


def test_a_release_brings_code_that_is_taken_before_the_cache_unless_a_bit_of_it_is_wrong(tmp_path):
    """What lies in the package's own folder is compiled by nobody; with a flipped bit the kernel is compiled again."""
    script = """
import sys
from pathlib import Path
from actuators import object_cache
from cosim.flight.blocks import hinge_model
object_cache.SHIPPED = Path(sys.argv[1])
native, made = hinge_model.rollout.native, Path(sys.argv[2])
shipped, own = native.files()
if made.is_file():
    shipped.parent.mkdir(parents=True, exist_ok=True)
    shipped.write_bytes(made.read_bytes())
    own.unlink(missing_ok=True)
native.address
if own.is_file():
    made.write_bytes(own.read_bytes())
print(object_cache.counts["compiled"])
"""
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)}
    made = tmp_path / "made"

    def compiled():
        words = [sys.executable, "-c", script, str(tmp_path / "objects"), str(made)]
        return int(subprocess.run(words, env=env, capture_output=True, text=True, check=True).stdout)

    assert [compiled(), compiled()] == [1, 0]
    held = bytearray(made.read_bytes())
    held[len(held) // 2] ^= 1
    made.write_bytes(held)
    assert compiled() == 1
