"""The likeliest failure: what it does not need is back at its mean, what it needs is just enough; it flies again."""

import pytest

from cosim.campaign.search import AGAIN, likeliest
from cosim.campaign.spec import Space, load_campaign
from cosim.campaign.worker import fly, run_id
from cosim.errors import CosimError
from cosim.scenario import load_scenario

SPACE = """
base = "cruise"
[set]
duration_s = 2.0
"flight.turbulence" = "none"
[draw]
"sensors.surface.bias_deg" = { mean = 0.0, sigma = 0.3, low = -2.0, high = 2.0 }
"tolerances.aero.CL_ds" = { mean = 1.0, sigma = 0.02 }
"tolerances.aero.Cn_beta" = { mean = 1.0, sigma = 0.02 }
"""
MISSED = """
base = "cruise"
[set]
duration_s = 2.5
"flight.turbulence" = "none"
"faults.0.target" = "elevator.left_inner"
"faults.0.kind" = "bias"
"faults.0.start_s" = 1.0
[draw]
"faults.0.bias_deg" = { mean = 1.2, sigma = 0.3, low = 0.05, high = 2.0 }
"tolerances.aero.CL_ds" = { mean = 1.0, sigma = 0.02 }
"tolerances.aero.Cn_beta" = { mean = 1.0, sigma = 0.02 }
"""


@pytest.fixture(scope="module")
def cries(tmp_path_factory):
    """A surface sensor whose bias is what makes the position monitor cry."""
    folder = tmp_path_factory.mktemp("likeliest")
    (folder / "space.toml").write_text(SPACE)
    return likeliest(folder / "space.toml", "position_monitor", flights=80, out=folder / "found.toml", workers=0)


def test_the_failure_needs_just_what_it_needs(cries):
    best = cries.failures[0]
    bias = best.away["sensors.surface.bias_deg"]
    assert cries.failure == "cries" and 1.0 < abs(bias) < 2.6
    assert best.log_likelihood > -0.5 * bias**2 - 0.5  # nothing else is far from its mean
    assert best.log_likelihood > best.first + 1.0  # the first one had every tolerance somewhere
    assert best.flown == AGAIN and len(cries.flights) <= 80


def test_it_is_a_scenario_that_fails_when_it_is_flown(cries):
    scenario = load_scenario(str(cries.file))
    assert scenario == cries.scenario and "position_monitor cries" in scenario.title
    rows, _ = fly(run_id(scenario), scenario, False)
    assert sum(r["false_alarms"] for r in rows if r["id"] == "position_monitor") > 0


def test_a_fault_that_is_missed_is_found_by_what_the_campaign_draws(tmp_path):
    (tmp_path / "missed.toml").write_text(MISSED)
    found = likeliest(tmp_path / "missed.toml", "position_monitor", flights=100, workers=0)
    assert found.failure == "misses"
    away = found.failures[0].away
    assert next(iter(away)) == "faults.0.bias_deg" and away["faults.0.bias_deg"] < -0.5
    assert found.failures[0].log_likelihood > found.failures[0].first


def test_where_nothing_fails_it_says_how_near_it_came(tmp_path):
    file = tmp_path / "quiet.toml"
    file.write_text(SPACE.replace("sigma = 0.3", "sigma = 0.01"))
    found = likeliest(file, "position_monitor", flights=60, workers=0, out=tmp_path / "none.toml")
    assert found.scenario is None and found.failures == () and not (tmp_path / "none.toml").exists()
    assert 0.0 < found.to_dict()["nearest"] < 1.0
    with pytest.raises(CosimError, match="60 to"):
        likeliest(file, "position_monitor", flights=10)


def test_points_know_how_likely_they_are(tmp_path):
    (tmp_path / "c.toml").write_text(SPACE)
    space = Space(load_campaign(tmp_path / "c.toml"), first_seed=1)
    u = [0.9] * space.size
    z = space.sigmas(u)
    assert space.log_likelihood(u) == pytest.approx(-0.5 * sum(v * v for v in z.values()))
    half = space.sigmas(space.nearer(u, list(space.normal), 0.5))
    assert all(half[i] == pytest.approx(0.5 * z[i]) for i in z)
    assert space.log_likelihood(space.nearer(u, list(space.normal), 0.0)) == pytest.approx(0.0)
