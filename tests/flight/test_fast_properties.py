"""Access to JSBSim's properties by address: only after a comparison that found all values equal, with the same bits."""

import numpy as np
import pytest

from cosim.flight.build import build
from cosim.flight.plant import properties as fast
from cosim.flight.tick import order
from cosim.scenario import load_scenario


@pytest.fixture
def verdict(monkeypatch):
    """Return what the comparison is asked from, with nothing remembered in this process before or after."""
    monkeypatch.delenv("COSIM_BORDER", raising=False)
    fast.fast_access.cache_clear()
    yield lambda found: monkeypatch.setattr(fast, "cached_array", lambda key, kind, compute, file: np.array([found]))
    fast.fast_access.cache_clear()


def test_a_comparison_decides_and_is_remembered(verdict, monkeypatch):
    how = fast.fast_access()
    monkeypatch.setattr(fast, "_verified", lambda: pytest.fail("compared again"))
    fast.fast_access.cache_clear()
    assert fast.fast_access() == how and how in (None, fast.exported())


def test_python_is_called_after_a_comparison_that_failed(verdict):
    verdict(0.0)
    assert fast.fast_access() is None


@pytest.mark.parametrize("script", ["import os; os.abort()", "raise SystemExit(1)", "print('no verdict')"])
def test_a_process_that_dies_finds_nothing(script, verdict, monkeypatch):
    """Not even that the values differ: it may have been killed, and is tried again."""
    found = fast._verified
    monkeypatch.setattr(fast, "_verified", lambda: found(script))
    monkeypatch.setattr(fast, "cached_array", lambda key, kind, compute, file: compute())
    assert fast.fast_access() is None


def test_both_ways_fly_the_same_bits(monkeypatch):
    weather = ["flight.turbulence=light", "flight.wind_kt=40", "flight.shear_kt_1000ft=9", "flight.climb_fpm=500",
               "flight.gusts.0.start_s=0.3", "flight.gusts.0.speed_fps=30"]  # fmt: skip
    scenario, flown = load_scenario("liquid-ofc", ["faults.0.start_s=0.2", *weather]), []
    for how in (fast.fast_access(), None):
        monkeypatch.setattr(fast, "fast_access", lambda how=how: how)
        loop = build(scenario).loop
        rows, tape = np.empty((300, len(loop.v))), order(loop)
        for k in range(len(rows)):
            tape.run(k)
            rows[k] = loop.v
        flown.append(rows)
    np.testing.assert_array_equal(*flown)
