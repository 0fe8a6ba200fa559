"""Commands on a disk that is full: one line with path and remedy, what was there is whole, nothing stray is left."""

import contextlib
import resource
import signal

import pytest
from typer.testing import CliRunner

import cosim
from cosim.cli.commands import app
from cosim.log import open_log, recover

GENERATOR = b'<!doctype html><meta name="generator" content="cosim">'
SHORT = ["duration_s=3", "faults.0.start_s=1", "detectors.enabled=['iotsekf']", "elevator.feedback=measured"]


@contextlib.contextmanager
def room(size):
    """Let no file grow beyond `size` bytes, as a full disk would."""
    before, ignored = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    path = tmp_path_factory.mktemp("flight") / "flight.mcap"
    cosim.simulate(cosim.load_scenario("liquid-ofc", SHORT), log=path, timed=False)
    return path


def refused(size, path, *words):
    """Run a command with room for so many bytes; return the one line that says where it failed and what to do."""
    with room(size):
        result = CliRunner().invoke(app, [str(word) for word in (*words, "-o", path)])
    assert result.exit_code == 2 and isinstance(result.exception, SystemExit), result.exception
    assert result.stderr.count("\n") == 1 and str(path) in result.stderr and "Free " in result.stderr, result.stderr
    return result.stderr


@pytest.mark.parametrize("size", [0, 200_000])
@pytest.mark.parametrize("name", ["report", "replay", "recover"])
def test_one_result_of_one_log(name, size, flight, tmp_path):
    out = tmp_path / ("page.html" if name == "report" else "out.mcap")
    before = GENERATOR if name == "report" else flight.read_bytes()[:500]
    out.write_bytes(before)  # one of before
    assert "recover" not in refused(size, out, name, flight).replace("recovered", "")
    assert [p.name for p in tmp_path.iterdir()] == [out.name] and out.read_bytes() == before


def test_a_flight_keeps_its_ticks_or_nothing(flight, tmp_path):
    words = ["run", "liquid-ofc", *(word for key in SHORT for word in ("-s", key))]
    log, old = tmp_path / "x.mcap", flight.read_bytes()[:100_000]
    log.write_bytes(old)  # of a flight before
    assert "recover" not in refused(300_000, log, *words)  # less than what comes before the first tick
    assert [p.name for p in tmp_path.iterdir()] == ["x.mcap"]
    assert f"`cosim recover {log}.part`" in refused(1_600_000, log, *words)
    assert log.read_bytes() == old
    again = CliRunner().invoke(app, [*words, "-o", str(log)])
    assert again.exit_code == 2 and f"{log}.part is there" in again.stderr
    recover(tmp_path / "x.mcap.part", tmp_path / "back.mcap")
    assert open_log(tmp_path / "back.mcap").n_ticks > 100
