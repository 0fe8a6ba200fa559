"""The page of real flights: made by one command from files of the shape of the sets, and from the sets themselves."""

import os
from pathlib import Path

import numpy as np
import pytest
from real_flights import MAPS, SETS, page, recordings
from real_windows import bounds
from scipy.io import savemat
from scipy.stats import poisson

from cosim.errors import CosimError
from cosim.replay.map import diagnose
from cosim.replay.map_file import load_map

RATE = 25.0


def attas(path):
    """Write 30 s of made-up level flight with the 45 columns of ATTAS."""
    names, t, rng = load_map(MAPS / "attas.toml")[0].columns, np.arange(750) / RATE, np.random.default_rng(1)
    sway = np.sin(1.1 * t)
    own = {
        "T": t, "AZCG": -9.81 + 0.0 * t,
        "ALCG": 4.0 + 0.2 * sway, "THE": 4.0 + 0.4 * sway, "QRGY": 0.44 * np.cos(1.1 * t),
        "VTASCG": 128.0 + 0.0 * t, "VCAS": 196.0 + 0.0 * t, "HQNH": 16000.0 + 0.0 * t, "MACH": 0.4 + 0.0 * t,
        "DELV": 0.1 * sway,
    }  # fmt: skip
    table = np.column_stack([own.get(n, np.zeros(len(t))) + (n != "T") * rng.normal(0, 1e-3, len(t)) for n in names])
    savemat(path, {path.stem: table})


def test_the_page_is_made_from_files_of_the_same_shape(tmp_path):
    (tmp_path / "flt_data").mkdir()
    attas(tmp_path / "flt_data" / "fAttasElv1.mat")
    (tmp_path / "hfb320_1_10.asc").write_text("1 2 3\n4 5 6\n")
    text = page(tmp_path)
    assert "| ATTAS | fAttasElv1.mat | `rfafe_airframe` | 0.008 |" in text
    assert "Nothing judges" in text and "3 columns, and 20 are named" in text
    assert "github.com/josemiguelbento" in text and "no alarm at all would bound the rate" in text
    with pytest.raises(CosimError, match="holds no recording"):
        page(MAPS)


def test_where_nothing_judges_each_detector_has_its_reason(tmp_path):
    t, rng = np.arange(1200) / 100.0, np.random.default_rng(2)
    names = {s.channel for s in load_map(MAPS / "twin_otter.toml")[0].signals.values()}
    table = {
        n: {"v": 150.0, "alt": 5000.0, "mach": 0.14, "an": 1.0}.get(n, 0.0) + rng.normal(0.0, 1e-3, 1200) for n in names
    }
    savemat(tmp_path / "totter_lon_data.mat", {"t": t, **table})
    lines = [line for line in page(tmp_path).splitlines() if "totter_lon_data.mat | `" in line and "no " in line]
    assert any("`rfafe_airframe` | no model: tas is 45.7" in line and "for 51.4 to 340" in line for line in lines)
    assert any("`lpv_smo` | no signal: stab_cmd" in line for line in lines)
    assert any("`position_monitor` | no signal: surface" in line for line in lines) and len(lines) > 8


@pytest.mark.parametrize("s", SETS, ids=lambda s: s.map)
def test_every_set_has_a_map_that_loads(s):
    m, _ = load_map(MAPS / f"{s.map}.toml")
    assert m.aircraft and m.time and {"alpha", "q", "theta", "tas", "de_cmd"} <= set(m.signals)


@pytest.mark.parametrize("count", [0, 1, 7, 56])
def test_bounds_are_those_of_the_poisson_distribution(count):
    low, high = bounds(count, 2.0)
    tail = 0.025 if count else 0.05
    assert poisson.cdf(count, 2.0 * high) == pytest.approx(tail)
    assert low == 0.0 if not count else poisson.sf(count - 1, 2.0 * low) == pytest.approx(tail)


@pytest.mark.slow
@pytest.mark.skipif("COSIM_REAL" not in os.environ, reason="COSIM_REAL=DIR names the folder with the recordings")
def test_the_real_sets_are_read_and_judged():
    found = recordings(Path(os.environ["COSIM_REAL"]))
    assert found
    for s, path in found:
        told = diagnose(path, MAPS / f"{s.map}.toml")
        assert told.detectors and all(np.isfinite(d["r_max"]) for d in told.detectors), path
