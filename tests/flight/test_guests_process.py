"""A detector that ends, crashes, fills or holds its process: what asks about it says so in one line, and lives."""

import logging
import threading
from pathlib import Path

import pytest

import cosim
from cosim.flight.plugins import GuestError, load, watchdog, with_detectors
from cosim.flight.plugins.check import check, trial
from cosim.flight.plugins.plain import SLOW
from cosim.log import open_log
from fdi import registry

CLASS = """
import ctypes, os, threading, time

class Hostile:
    id, level, technologies, inputs = "hostile", "local", ("hydraulic",), ("rod",)
    steps = 0

    def __init__(self, dt):
        pass

    def update(self, t, y):
        Hostile.steps += 1
        if Hostile.steps == 100:
            DO
"""
WAYS = {
    "exit": ("os._exit(7)", "ended its process with exit status 7"),
    "crash": ("ctypes.string_at(0)", "crashed its process with SIGSEGV (hostile.py:"),
    "loop": ("while True: pass", "a step was interrupted after 0.5 s (hostile.py:"),
    "sleep": ("time.sleep(1000)", "a step was interrupted after 0.5 s (hostile.py:"),
    "memory": ("b'x' * (1 << 36)", "MemoryError"),
    "files": ("os.closerange(3, 200)", "closed files of its process"),
    "thread": ("threading.Thread(target=time.sleep, args=(99,), name='mine').start()", "leaves the thread 'mine'"),
}


@pytest.fixture
def hostile(tmp_path):
    """Return what writes the file of a detector that does something at its hundredth step."""

    def written(do):
        path = tmp_path / "hostile.py"
        path.write_text(CLASS.replace("DO", do))
        return path

    yield written
    registry.GUESTS.pop("hostile", None)


@pytest.mark.parametrize("way", WAYS)
def test_what_ends_its_process_is_one_line_about_the_detector(way, hostile):
    do, said = WAYS[way]
    with pytest.raises(GuestError) as told:
        (check if way == "exit" else trial)(hostile(do))
    assert said in str(told.value) and "hostile" in str(told.value) and "\n" not in str(told.value)
    assert told.value.fatal and "hostile" not in registry.GUESTS  # nothing of it has run here


def test_what_hangs_while_it_is_loaded_is_one_line(tmp_path):
    (tmp_path / "asleep.py").write_text("import time\ntime.sleep(1000)\n")
    with pytest.raises(GuestError, match=r"asleep\.py: has not come back for 3 s while it was loaded"):
        trial(tmp_path / "asleep.py", patience_s=3.0)


@pytest.mark.parametrize("way", ["loop", "sleep"])
def test_a_step_that_does_not_end_is_interrupted_and_dropped_and_the_flight_goes_on(way, hostile, tmp_path):
    scenario = with_detectors(cosim.load_scenario("cruise", ["duration_s=1"]), [hostile(WAYS[way][0])])
    result = cosim.simulate(scenario, log=tmp_path / "a.mcap", timed=False)
    assert result.status == "completed" and open_log(tmp_path / "a.mcap").complete
    assert "hostile is dropped on" in result.extra["notes"][0] and "interrupted" in result.extra["notes"][0]
    status = open_log(tmp_path / "a.mcap").array("/detectors/hostile/left_inner")[-1]
    assert SLOW in status


def test_a_step_that_cannot_be_interrupted_is_named(hostile, monkeypatch, caplog):
    """Within 1.2 s of sleep no signal is heard: it is a thread's."""
    monkeypatch.setattr(watchdog, "NAMED_S", 0.1)
    runner = load(hostile("time.sleep(1.2)")).runner(limited=True, lanes=("left_inner",))
    guest = runner.guest
    p, done = guest.DETECTOR.fit(None), threading.Event()

    def fly():
        import numpy as np

        with watchdog.watched([runner]):
            runner(guest.init(p), np.zeros((1, 100), guest.INPUTS), p, 0.005)
        done.set()

    with caplog.at_level(logging.WARNING, "cosim"):
        threading.Thread(target=fly, daemon=True).start()
        assert done.wait(30)
    assert "hostile: the step at 0.495 s on left_inner has not come back for 1 s" in caplog.text


def test_a_log_whose_file_the_detector_closed_says_whose_code_flew(hostile, tmp_path):
    scenario = with_detectors(cosim.load_scenario("cruise", ["duration_s=1"]), [hostile(closing(tmp_path))])
    with pytest.raises(cosim.CosimError, match="was closed by code that flew in its flight: hostile"):
        cosim.simulate(scenario, log=tmp_path / "a.mcap", timed=False)


def closing(folder: Path) -> str:
    """Return code that closes the files open in a folder, as os.closerange does with all."""
    own = f"os.path.dirname(os.path.realpath('/proc/self/fd/' + n)) == {str(folder)!r}"
    return f"[os.close(int(n)) for n in os.listdir('/proc/self/fd') if {own}]"
