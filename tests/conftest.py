"""Flights that many tests look at, flown once per session and process."""

import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest

import cosim
from cosim.campaign import engine
from cosim.campaign.pool import THREADS, finished
from cosim.flight.loop import compiling
from fdi import registry

for _name in THREADS:  # read by the processes that pytest starts: each is a core's already
    os.environ.setdefault(_name, "1")
# a wall clock's limit per example fails on a busy machine, and says nothing of what is tested
hypothesis.settings.register_profile("unhurried", deadline=None)
hypothesis.settings.load_profile("unhurried")
os.environ.setdefault("COSIM_TRACEBACK", "1")  # a failing test shows where in the library
# some images forbid it: every run would rewrite and compile the tests again, each process of it our sources
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


def pytest_configure(config: pytest.Config) -> None:
    """Compile what the whole suite flies before its processes start: each would compile the same at the same time."""
    if config.args_source is pytest.Config.ArgsSource.TESTPATHS and not hasattr(config, "workerinput"):
        compiling.prepare(
            cosim.load_scenario("cruise", ["elevator.left_outer=ema", f"detectors.enabled={list(registry.records())}"]),
            lambda i, n: print(f"\rcompiled {i} of {n}", end="\n" if i == n else "", flush=True),
        )


@pytest.fixture(autouse=True)
def no_user_detectors() -> Iterator[None]:
    """Forget the detectors that a test registers: they are the process's, and would fly in the next test."""
    yield
    registry.USER_DETECTORS.clear()


@pytest.fixture
def one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let commands fly their campaigns in this process: to start a worker costs more than a few short flights."""
    monkeypatch.setattr(engine, "finished", lambda calls, **how: finished(calls, workers=0))


@pytest.fixture(scope="session")
def cruise_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the log of the built-in scenario `cruise`: 30 s in light turbulence without a fault."""
    path = tmp_path_factory.mktemp("cruise") / "cruise.mcap"
    assert cosim.simulate("cruise", log=path, timed=False).status == "completed"
    return path


@pytest.fixture(scope="session")
def short_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the log of six seconds with every detector, a doublet, and a fault from 3 s on."""
    path = tmp_path_factory.mktemp("short") / "flight.mcap"
    keys = ("duration_s=6", "faults.0.start_s=3", "manoeuvre.kind=nz_doublet", "manoeuvre.start_s=1")
    cosim.simulate(cosim.load_scenario("liquid-ofc", keys), log=path, timed=False)
    return path


@pytest.fixture(scope="session")
def liquid_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the log of the built-in scenario `liquid-ofc`: 30 s, from 12 s an oscillation of the left inner valve."""
    path = tmp_path_factory.mktemp("liquid") / "liquid-ofc.mcap"
    assert cosim.simulate("liquid-ofc", log=path, timed=False).status == "completed"
    return path


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Name the optional programs that this machine does not have: tests that need one were skipped."""
    programs = {
        "a browser": ("chromium", "chromium-browser", "google-chrome"),
        "a C compiler": ("cc", "gcc"),
        "node": ("node",),
        "rerun": ("rerun",),
    }
    missing = [name for name, commands in programs.items() if not any(map(shutil.which, commands))]
    if missing:
        terminalreporter.write_line(f"optional programs not found, their tests were skipped: {', '.join(missing)}")
