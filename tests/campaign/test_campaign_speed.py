"""One process against two on the same flights: the command prints both times, and that the rows are equal."""

import pytest
from typer.testing import CliRunner

from cosim.bench import campaign as campaign_speed
from cosim.cli import commands as cli
from cosim.scenario import load_scenario

FEW = [load_scenario("cruise", ["duration_s=1", "detectors.enabled=[]", f"seed={1_000_000 + i}"]) for i in range(3)]


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_rows_of_this_and_other_processes_are_equal_and_a_changed_value_is_not(workers):
    one, two = (campaign_speed.measure(FEW, n) for n in (0, workers))
    assert one["outcomes"] == {"completed": 3} and one["flown_s"] == pytest.approx(3.0)
    assert campaign_speed.same(one["rows"], two["rows"])
    changed = two["rows"].copy()
    changed.loc[1, "sim_time_s"] += 1e-12
    assert not campaign_speed.same(one["rows"], changed)


def test_command_prints_the_ratio_and_fails_on_a_crash(monkeypatch):
    class Campaign:
        def scenarios(self):
            return FEW, None

    rows = campaign_speed.measure(FEW, 0)["rows"]
    case = {"flights": 3, "flown_s": 3.0, "outcomes": {"completed": 3}, "rows": rows}
    took = {2: 5.0, 1: 9.0}
    monkeypatch.setattr(campaign_speed, "cores", lambda: 2)
    monkeypatch.setattr(campaign_speed, "load_campaign", lambda name: Campaign())
    monkeypatch.setattr(campaign_speed, "measure", lambda s, n, bar: case | {"workers": n, "wall_s": took[n]})
    shown = CliRunner().invoke(cli.app, ["bench", "--campaign", "fault-free"])
    assert shown.exit_code == 0, shown.output
    assert "1.80 times as fast as one process; rows equal; 0 crashed" in shown.stdout
    case["outcomes"] = {"completed": 2, "crashed": 1}
    assert CliRunner().invoke(cli.app, ["bench", "--campaign", "fault-free"]).exit_code == 1
