"""What decides about rows and kernels is digested; files are replaced whole; caches are the user's alone."""

import json
import os
import pickle
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from cosim import files
from cosim.cli.app import reserve
from cosim.errors import OutputError
from cosim.files import Part, _swept, beside, held, replace_text, sweep

ROOT = Path(__file__).resolve().parent.parent
DIGESTS = """
import json, sys
from pathlib import Path
from actuators import source_hash
from cosim.campaign import engine
from cosim.flight.blocks import law

def digests():
    for cached in (engine.fingerprint, source_hash.closure, source_hash._links, source_hash._source,
                   source_hash._digest, source_hash.sources, source_hash.cache_dir):
        cached.cache_clear()
    return engine.fingerprint()["digest"], source_hash.cache_dir(Path(law.__file__).resolve())

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
# what its kernels are compiled from
IN_THE_LAW = {"cosim/flight/blocks/law/__init__.py", "cosim/flight/blocks/law/pitch.py"}


def test_every_file_that_can_change_a_row_or_a_kernel_changes_its_digest(tmp_path):
    for name in ("actuators", "fdi", "cosim", "aircraft"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    env = os.environ | {"PYTHONPATH": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "home")}
    env.pop("NUMBA_CACHE_DIR", None)
    command = [sys.executable, "-c", DIGESTS, *DECIDING, PAGE]
    told = subprocess.run(command, env=env, cwd=tmp_path, capture_output=True, text=True, check=True)
    found = json.loads(told.stdout)
    row, kernels = found.pop("")
    assert found.pop(PAGE) == [row, kernels]  # decides about no row
    assert {name for name, (digest, _) in found.items() if digest == row} == set()
    assert {name for name, (_, folder) in found.items() if folder != kernels} == IN_THE_LAW


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="owners are a matter of POSIX")
def test_a_cache_that_others_can_write_to_is_not_used(tmp_path, monkeypatch):
    from actuators import source_hash

    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home" / "gone"))
    monkeypatch.setattr(source_hash.tempfile, "gettempdir", lambda: str(tmp_path))
    (tmp_path / "home").write_text("")  # a home that cannot be written
    source_hash.cache_root.cache_clear()
    own = tmp_path / f"cosim-kernels-{os.getuid()}"
    assert source_hash.cache_root() == own and own.stat().st_mode & 0o777 == 0o700
    own.chmod(0o777)
    source_hash.cache_root.cache_clear()
    assert source_hash.cache_root() is None
    own.rmdir()
    (tmp_path / "elsewhere").mkdir()
    own.symlink_to(tmp_path / "elsewhere")
    source_hash.cache_root.cache_clear()
    assert source_hash.cache_root() is None
    source_hash.cache_root.cache_clear()


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root can plant another's file")
def test_a_planted_file_of_another_user_is_never_unpickled(tmp_path):
    from actuators import source_hash

    assert source_hash.private(tmp_path / "cache")
    planted = tmp_path / "cache" / "x.nbi"
    planted.write_bytes(pickle.dumps(os.getcwd))
    assert source_hash._all_private(tmp_path / "cache")
    os.chown(planted, 12345, 12345)
    assert not source_hash._all_private(tmp_path / "cache")


def test_a_file_that_cannot_be_written_whole_stays_as_it_was(tmp_path):
    path = tmp_path / "README.md"
    path.write_text("mine\n" * 10_000)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1024, before[1]))
    try:
        with pytest.raises(OutputError, match=r"README\.md: cannot be written"):
            replace_text(path, "theirs\n" * 10_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)
    assert path.read_text() == "mine\n" * 10_000
    assert [p.name for p in tmp_path.iterdir()] == ["README.md"]


def test_a_replaced_file_keeps_its_mode_and_a_link_its_target(tmp_path):
    path, link = tmp_path / "a.txt", tmp_path / "link.txt"
    path.write_text("a")
    path.chmod(0o640)
    link.symlink_to(path)
    replace_text(link, "b")
    assert path.read_text() == "b" and path.stat().st_mode & 0o777 == 0o640 and link.is_symlink()


def test_what_a_killed_writer_left_is_swept_and_nothing_else(tmp_path):
    with pytest.raises(KeyboardInterrupt), beside(tmp_path / "a.parquet"):
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())
    left, held_now = (Part(tmp_path / "a.parquet") for _ in range(2))
    left.file.close()  # as a kill does
    _swept.clear()
    mine = [tmp_path / name for name in (".hidden", "a.parquet", ".git", ".env.template", ".app.settings.json")]
    for path in mine:
        path.write_text("")
    sweep(tmp_path)
    assert not left.place.exists() and all(path.exists() for path in [*mine, held_now.place])


def test_a_folder_that_is_held_lets_nobody_else_in(tmp_path):
    with held(tmp_path), pytest.raises(OutputError, match="another run"), held(tmp_path):
        pass
    with held(tmp_path):
        pass


def test_an_output_that_nobody_reads_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match="pipe: cannot be written"):
        reserve(tmp_path / "pipe", None)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes with names")
def test_a_pipe_that_nobody_reads_is_refused_and_one_that_is_read_gets_it_whole(tmp_path):
    pipe = tmp_path / "a.html"
    os.mkfifo(pipe)
    with pytest.raises(OutputError, match=r"a\.html: cannot be written: No such device"):
        replace_text(pipe, "lost")
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        replace_text(pipe, "read")
        assert os.read(reader, 100) == b"read"
    finally:
        os.close(reader)


def test_an_interrupt_while_a_part_is_opened_leaves_nothing(tmp_path, monkeypatch):
    opened = files._open_alone

    def struck(*given):
        opened(*given)
        raise KeyboardInterrupt

    monkeypatch.setattr(files, "_open_alone", struck)
    with pytest.raises(KeyboardInterrupt):
        files.replace_text(tmp_path / "x.txt", "x")
    assert list(tmp_path.iterdir())  # nobody has it in hand
    files.interrupted()
    assert not list(tmp_path.iterdir())
