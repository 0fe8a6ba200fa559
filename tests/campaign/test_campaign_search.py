"""Worst-case search: it climbs, it repeats, and what it finds flies again to the same number."""

import pytest

from cosim.campaign.pool import pool
from cosim.campaign.search import POPULATION, SEARCH_SEED, search
from cosim.campaign.worker import fly, run_id
from cosim.errors import CosimError
from cosim.scenario import load_scenario

SPACE = """
base = "cruise"
[set]
duration_s = 4.0
"flight.turbulence" = "none"
"sensors.noise_scale" = 0.0  # a seed's own noise would move r as far as a fifth of the bias
[grid]
manoeuvre = [{ "manoeuvre.kind" = "cruise" }, { "manoeuvre.kind" = "nz_doublet", "manoeuvre.start_s" = 1.0 }]
[draw]
"sensors.surface.bias_deg" = { low = 0.0, high = 1.0 }
"""


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """A search of two generations in which the surface sensor's bias is what brings the monitor to its threshold."""
    folder = tmp_path_factory.mktemp("search")
    (folder / "space.toml").write_text(SPACE)
    return search(
        folder / "space.toml", "position_monitor", flights=2 * POPULATION, out=folder / "worst.toml", workers=0
    )


def test_search_finds_the_corner_that_random_flights_do_not(found):
    first = found.flights["r"].iloc[:POPULATION]
    assert found.r == found.flights["r"].max() >= first.max() > first.median()
    assert found.flights["r"].iloc[POPULATION:].median() > first.median()  # it climbs
    assert found.scenario.sensors.setting("surface").bias > 0.9 * 3.14159 / 180
    assert found.scenario.seed >= SEARCH_SEED and len(found.flights) == 2 * POPULATION


def test_what_it_finds_is_a_scenario_that_flies_to_the_same_number(found):
    scenario = load_scenario(str(found.file))
    assert scenario == found.scenario and "position_monitor" in scenario.title
    rows, _ = fly(run_id(scenario), scenario, False)
    assert max(r["r_max_before"] for r in rows if r["id"] == "position_monitor") == found.r


def test_what_cannot_be_searched_is_refused(tmp_path):
    path = tmp_path / "c.toml"
    path.write_text(SPACE)
    with pytest.raises(CosimError, match="Did you mean"):
        search(path, "position_montor")
    with pytest.raises(CosimError, match="40 to 300"):
        search(path, "position_monitor", flights=301)
    path.write_text("base = 'liquid-ofc'\n")
    with pytest.raises(CosimError, match="has faults"):
        search(path, "position_monitor")
    with pytest.raises(CosimError, match="part"):
        search("aircraft-vs-local", "position_monitor")


def test_the_pool_starts_with_one_thread_per_process_and_leaves_no_trace():
    import os

    before = os.environ.get("OMP_NUM_THREADS")
    with pool(1) as here:
        assert here.submit(os.getenv, "OMP_NUM_THREADS").result() == "1"
    assert os.environ.get("OMP_NUM_THREADS") == before
