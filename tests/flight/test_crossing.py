"""Crossing the border to JSBSim by address: only after a trial that found every value equal, and with the same bits."""

import json

import numpy as np
import pytest

from cosim.flight.build import build
from cosim.flight.plant import plant
from cosim.flight.plant import property_pointers as border
from cosim.scenario import load_scenario


@pytest.fixture
def verdict(tmp_path, monkeypatch):
    """Return the file of the verdict, with nothing remembered in this process before or after."""
    file = tmp_path / "border.json"
    monkeypatch.delenv("COSIM_BORDER", raising=False)
    monkeypatch.setattr(border, "_memory", lambda: file)
    border.crossing.cache_clear()
    yield file
    border.crossing.cache_clear()


def test_a_trial_decides_and_is_remembered(verdict, monkeypatch):
    how = border.crossing()
    found = json.loads(verdict.read_text())
    assert (how is not None) == (found["equal"] is True)
    if how is not None:
        assert found["values"] > 10_000
    monkeypatch.setattr(border, "_tried", lambda: pytest.fail("tried again"))
    border.crossing.cache_clear()
    assert border.crossing() == how


@pytest.mark.parametrize("found", [{"equal": False}, None])
def test_python_crosses_after_a_trial_that_failed(found, verdict, monkeypatch):
    monkeypatch.setattr(border, "_tried", lambda: found)
    assert border.crossing() is None
    assert verdict.exists() == (found is not None)  # one that did not end is tried again


@pytest.mark.parametrize("script", ["import os; os.abort()", "raise SystemExit(1)", "print('no verdict')"])
def test_a_trial_that_dies_finds_nothing(script):
    """Not even that the values differ: it may have been killed, and is tried again."""
    assert border._tried(script) is None


def test_a_trial_does_not_import_from_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "numpy.py").write_text("raise SystemExit('not asked for')")
    monkeypatch.chdir(tmp_path)
    assert border._tried("import numpy, cosim; print('{\"equal\": false}')") == {"equal": False}


@pytest.mark.parametrize("text", ["[]", '{"equal": true}', '{"equal": true, "offset": 3}', '{"equal": 1}', "", "\xff",
                                  '{"equal": true, "offset": [16]}', "[" * 9000, None])  # fmt: skip
def test_a_damaged_memory_costs_a_trial(text, verdict, monkeypatch):
    found = {"equal": False}
    monkeypatch.setattr(border, "_tried", lambda: found)
    verdict.mkdir() if text is None else verdict.write_text(text, encoding="latin-1")
    assert border.crossing() is None
    assert text is None or json.loads(verdict.read_text()) == found


def test_both_ways_fly_the_same_bits(monkeypatch):
    weather = ["flight.turbulence=light", "flight.wind_kt=40", "flight.shear_kt_1000ft=9", "flight.climb_fpm=500",
               "flight.gusts.0.start_s=0.3", "flight.gusts.0.speed_fps=30"]  # fmt: skip
    scenario, flown = load_scenario("liquid-ofc", ["faults.0.start_s=0.2", *weather]), []
    for how in (border.crossing(), None):
        monkeypatch.setattr(plant, "crossing", lambda how=how: how)
        loop = build(scenario).loop
        rows = np.empty((300, len(loop.v)))
        for k in range(len(rows)):
            loop.tape().run(k)
            rows[k] = loop.v
        flown.append(rows)
    np.testing.assert_array_equal(*flown)
