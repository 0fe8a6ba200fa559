"""Two runs on one log: the second is told so, and the first one's file stays whole."""

import subprocess
import sys

import pytest

import cosim
from cosim.cli.app import reserve
from cosim.errors import CosimError
from cosim.files import LEFT, TAKEN, Part

pytest.importorskip("fcntl")
RUN = [sys.executable, "-c", "from cosim.cli import main; main()", "run", "cruise", "-s", "detectors.enabled=[]", "-s",
       "elevator.feedback=measured"]  # fmt: skip
HOLD = (
    "import sys; from cosim.log.log_file import LogFile; s = LogFile(sys.argv[1]); s._put(b'\\x89MCAP0\\r\\nfirst'); "
    "print('held', flush=True); sys.stdin.read()"
)


def test_the_second_of_two_runs_is_refused_before_it_touches_the_file(tmp_path):
    log = tmp_path / "a.mcap"
    with subprocess.Popen([sys.executable, "-c", HOLD, log], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as first:
        assert first.stdout.readline() == b"held\n"
        told = subprocess.run([*RUN, "-s", "duration_s=0.1", "-o", log], capture_output=True, text=True)
        assert told.returncode == 2 and told.stderr.count("\n") == 1
        assert f"a.mcap: {TAKEN}" in told.stderr
        with pytest.raises(CosimError, match=TAKEN):  # a run that has come past the command line's own look
            cosim.simulate(cosim.load_scenario("cruise", ["duration_s=0.1"]), log=log, timed=False)
        assert (tmp_path / f"a.mcap{LEFT}").read_bytes() == b"\x89MCAP0\r\nfirst" and not log.exists()
        first.kill()
    (tmp_path / f"a.mcap{LEFT}").write_bytes(b"")
    told = subprocess.run([*RUN, "-s", "duration_s=0.1", "-o", log], capture_output=True, text=True)
    assert told.returncode == 0, told.stderr  # the lock has gone with the process
    assert cosim.open_log(log).complete


def test_reserve_leaves_no_file_and_a_removed_one_is_not_written(tmp_path):
    path = tmp_path / "a.mcap"
    reserve(path, None)
    assert not path.exists()
    part = Part(path, stays=True)
    for again in (reserve, Part):
        with pytest.raises(CosimError, match=TAKEN):
            again(path, None)
    part.place.unlink()
    other = Part(path, stays=True)
    assert other.file.fileno() != part.file.fileno()
    other.drop(stays=False)
    part.drop(stays=False)
    assert not list(tmp_path.iterdir())
