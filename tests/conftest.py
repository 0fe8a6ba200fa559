"""Flights that many tests look at, flown once per session and process."""

from collections.abc import Iterator
from pathlib import Path

import pytest

import cosim
from fdi import registry


@pytest.fixture(autouse=True)
def no_guests() -> Iterator[None]:
    """Forget the detectors that a test registers: they are the process's, and would fly in the next test."""
    yield
    registry.GUESTS.clear()


@pytest.fixture(scope="session")
def cruise_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the log of the built-in scenario `cruise`: 30 s in light turbulence without a fault."""
    path = tmp_path_factory.mktemp("cruise") / "cruise.mcap"
    assert cosim.simulate("cruise", log=path, timed=False).status == "completed"
    return path


@pytest.fixture(scope="session")
def liquid_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the log of the built-in scenario `liquid-ofc`: 30 s, from 12 s an oscillation of the left inner valve."""
    path = tmp_path_factory.mktemp("liquid") / "liquid-ofc.mcap"
    assert cosim.simulate("liquid-ofc", log=path, timed=False).status == "completed"
    return path
