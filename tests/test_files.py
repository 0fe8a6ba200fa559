"""What decides about rows and kernels is digested; files are replaced whole; caches are the user's alone."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cosim.cli.app import reserve
from cosim.errors import OutputError
from cosim.files import beside, replace_text

ROOT = Path(__file__).resolve().parent.parent
DIGESTS = """
import json, sys
from pathlib import Path
from actuators import kernels
from cosim.campaign import store

def digests():
    for cached in (store.fingerprint, kernels.sources):
        cached.cache_clear()
    return store.fingerprint()["digest"], kernels.sources()

out = {"": digests()}
for name in sys.argv[1:]:
    path = Path(name)
    before = path.read_bytes()
    path.write_bytes(before + b"\\n")
    out[name] = digests()
    path.write_bytes(before)
print(json.dumps(out))
"""
DECIDING = [
    "cosim/flight/blocks/law/__init__.py",
    "cosim/flight/blocks/law/pitch.py",
    "cosim/flight/blocks/law/design.py",
    "cosim/flight/tick.py",
    "cosim/flight/blocks/sensors.py",
    "cosim/judge/result.py",
    "cosim/campaign/worker.py",
    "cosim/scenario/catalog.py",
    "fdi/common/record.py",
    "fdi/common/decision.py",
    "fdi/thresholds/iotsekf.json",
    "actuators/hydraulic/servo.py",
    "aircraft/transport/aerodynamics.xml",
]
PAGE = "cosim/report/page.py"


def test_every_file_that_can_change_a_row_or_an_array_changes_its_digest(tmp_path):
    for name in ("actuators", "fdi", "cosim", "aircraft"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    env = os.environ | {"PYTHONPATH": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "home")}
    env.pop("NUMBA_CACHE_DIR", None)
    command = [sys.executable, "-c", DIGESTS, *DECIDING, PAGE]
    told = subprocess.run(command, env=env, cwd=tmp_path, capture_output=True, text=True, check=True)
    found = json.loads(told.stdout)
    row, arrays = found.pop("")
    assert found.pop(PAGE) == [row, arrays]  # decides about no row
    assert {name for name, (digest, _) in found.items() if digest == row} == set()
    stay = {name for name, (_, digest) in found.items() if digest == arrays}
    assert stay == {name for name in DECIDING if not name.endswith(".py") or "campaign" in name}


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="owners are a matter of POSIX")
def test_a_cache_that_others_can_write_to_is_not_used(tmp_path, monkeypatch):
    from actuators import kernels

    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    kernels.cache.cache_clear()
    own = tmp_path / "cosim-kernels"
    assert kernels.cache() == own and own.stat().st_mode & 0o777 == 0o700
    for spoil in (lambda: own.chmod(0o777), lambda: (own.rmdir(), own.symlink_to(tmp_path))):
        spoil()
        kernels.cache.cache_clear()
        assert kernels.cache() is None
    kernels.cache.cache_clear()


def test_a_replaced_file_keeps_its_mode_and_a_link_its_target(tmp_path):
    path, link = tmp_path / "a.txt", tmp_path / "link.txt"
    path.write_text("a")
    path.chmod(0o640)
    link.symlink_to(path)
    replace_text(link, "b")
    assert path.read_text() == "b" and path.stat().st_mode & 0o777 == 0o640 and link.is_symlink()


def test_an_interrupt_leaves_nothing_and_what_was_there_stays(tmp_path):
    (tmp_path / "a.txt").write_text("mine")
    with pytest.raises(KeyboardInterrupt), beside(tmp_path / "a.txt") as part:
        part.write_text("half")
        raise KeyboardInterrupt
    assert [p.read_text() for p in tmp_path.iterdir()] == ["mine"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes with names")
def test_a_pipe_is_no_output_and_a_look_at_a_place_leaves_only_its_folder(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for write in (lambda path: reserve(path, None), lambda path: replace_text(path, "")):
        with pytest.raises(OutputError, match="pipe: is no regular file"):
            write(tmp_path / "pipe")
    reserve(tmp_path / "new" / "a.mcap", None, log=True)
    assert not list((tmp_path / "new").iterdir())
