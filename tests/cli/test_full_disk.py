"""Commands on a disk that is full: one line with path and remedy, what was there is whole, nothing stray is left."""

import shutil
import subprocess

import pytest
from typer.testing import CliRunner

import cosim
from cosim.cli.commands import app
from cosim.log import open_log, recover

GENERATOR = b'<meta name="generator" content="cosim">'
SHORT = ["duration_s=3", "faults.0.start_s=1", "detectors.enabled=['iotsekf']", "elevator.feedback=measured"]


def command(*args):
    return CliRunner().invoke(app, [str(a) for a in args])


@pytest.fixture(scope="module")
def disk(tmp_path_factory):
    """Return a file system of 4 MB of its own."""
    if shutil.which("mount") is None:
        pytest.skip("no mount")
    path = tmp_path_factory.mktemp("disk")
    told = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", path], capture_output=True, text=True)
    if told.returncode:
        pytest.skip(f"no file system of its own may be mounted here: {told.stderr.strip()}")
    yield path
    subprocess.run(["umount", "-l", path], check=True)


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    path = tmp_path_factory.mktemp("flight") / "flight.mcap"
    cosim.simulate(cosim.load_scenario("liquid-ofc", SHORT), log=path, timed=False)
    return path


@pytest.fixture
def full(disk):
    """Return a function that fills the disk up to so many free bytes, beside files that are the user's."""
    for path in disk.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    (disk / "mine").write_text("mine")

    def fill(free):
        with (disk / "filler").open("wb") as file:
            file.write(bytes(shutil.disk_usage(disk).free - free))

    return fill


def told(result, path):
    """Check that a command has said in one line where it failed and what to do."""
    assert result.exit_code == 2 and isinstance(result.exception, SystemExit), result.exception
    assert result.stderr.count("\n") == 1 and str(path) in result.stderr and "Free " in result.stderr, result.stderr
    return result.stderr


@pytest.mark.parametrize("free", [0, 200_000])
@pytest.mark.parametrize("name", ["report", "replay", "recover"])
def test_one_result_of_one_log(name, free, disk, full, flight):
    out = disk / ("page.html" if name == "report" else "out.mcap")
    before = b"<!doctype html>" + GENERATOR if name == "report" else flight.read_bytes()[:500]
    out.write_bytes(before)  # one of before
    full(free)
    assert "recover" not in told(command(name, flight, "-o", out), out).replace("recovered", "")
    assert sorted(p.name for p in disk.iterdir()) == sorted(["mine", "filler", out.name])
    assert out.read_bytes() == before and (disk / "mine").read_text() == "mine"


def test_a_flight_keeps_its_ticks_or_nothing(disk, full, tmp_path, flight):
    keys = [word for key in SHORT for word in ("-s", key)]
    log, old = disk / "x.mcap", flight.read_bytes()[:100_000]
    log.write_bytes(old)  # of a flight before
    full(300_000)  # less than what comes before the first tick
    assert "recover" not in told(command("run", "liquid-ofc", *keys, "-o", log), log)
    assert sorted(p.name for p in disk.iterdir()) == ["filler", "mine", "x.mcap"]
    (disk / "filler").unlink()
    full(1_600_000)
    assert f"`cosim recover {log}.part`" in told(command("run", "liquid-ofc", *keys, "-o", log), log)
    assert log.read_bytes() == old
    next_one = command("run", "liquid-ofc", *keys, "-o", log)
    assert next_one.exit_code == 2 and f"{log}.part is there" in next_one.stderr
    recover(disk / "x.mcap.part", tmp_path / "back.mcap")
    assert open_log(tmp_path / "back.mcap").n_ticks > 100
    assert sorted(p.name for p in disk.iterdir()) == ["filler", "mine", "x.mcap", "x.mcap.part"]
