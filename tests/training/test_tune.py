"""`cosim train DETECTOR --tune`: replays are what flies, and the set that is found keeps the criterion."""

import pytest
from typer.testing import CliRunner

from cosim.cli import commands as cli
from cosim.errors import DesignError
from cosim.flight.loop.signals import fly
from cosim.judge.alarms import detection
from cosim.training import tune

CAMPAIGN, NAME = "aircraft-faults", "control_redundancy"


@pytest.fixture(scope="module")
def flights():
    return tune.flights(CAMPAIGN, NAME, 700_000, 3)


def test_a_replay_sees_the_fault_when_the_flight_does(flights):
    free, faulty = flights[0], flights[3]
    assert not free.scenario.faults and faulty.scenario.faults[0].target == "engine.all"
    alarm = fly(faulty.scenario, [f"{NAME}.aircraft.alarm"])[f"{NAME}.aircraft.alarm"].to_numpy()
    at = detection(alarm, round(22.0 / 0.005))
    found = faulty.replay({})
    assert found.seen == (at is not None) and found.faults == 1
    assert found.delay_s == pytest.approx(at * 0.005 - 22.0 if at else 14.0)
    assert free.replay({}).exposed_s > 20.0


def test_numbers_change_what_is_seen_and_when(flights):
    as_it_is, deaf, slow = (tune.score(flights, v) for v in ({}, {"threshold": 1.0}, {"t_confirm": 3.0}))
    assert as_it_is.seen > 0 == deaf.seen and deaf.delay_s == 14.0
    assert as_it_is.delay_s + 0.5 < slow.delay_s < deaf.delay_s


def test_no_flight_without_a_fault_counts_nothing():
    """As where none of the few that are drawn can be flown."""
    assert tune.score([], {}) == tune.Score(0, 0, 0.0, 0, 0.0)


def test_the_set_that_is_found_is_within_the_rate_and_no_later(flights, monkeypatch):
    monkeypatch.setattr(tune, "ROUNDS", 1)
    monkeypatch.setattr(tune, "OTHER_SEED", 700_000)
    values, told = tune.tune(NAME, {"t_confirm": (0.1, 0.3)}, campaign=CAMPAIGN, false_per_hour=0.0, most=1)
    scores = dict(told)
    assert 0.1 <= values["t_confirm"] <= 0.3
    assert scores["training, tuned"].false == 0
    assert scores["training, tuned"].delay_s <= scores["training, in use"].delay_s
    assert scores["other, tuned"] == scores["training, tuned"]  # the same flights, here


@pytest.mark.parametrize("spans", [{"t_confirm": (0.3, 0.1)}, {"t_confirm": (0.0, 0.1)}])
def test_a_span_that_cannot_be_is_told(spans):
    with pytest.raises(DesignError, match="LOW < HIGH"):
        tune.tune(NAME, spans, campaign=CAMPAIGN, false_per_hour=0.0, most=1)


def test_mistakes_of_the_command_line_are_told():
    for asked, said in (("t_confirm=1:x", "no span"), ("nothing=1:2", "no such parameter")):
        told = CliRunner().invoke(cli.app, ["train", NAME, "--tune", asked, "--flights", "2"])
        assert told.exit_code != 0 and said in " ".join((told.output + str(told.exception)).split())
    with pytest.raises(DesignError, match="no flight with a fault"):
        tune.flights("fault-free", NAME, 700_000, 1)
