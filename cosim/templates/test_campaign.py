"""Test of NAME: every run can be built, with and without a fault, and one of each flies. Run with pytest."""

from pathlib import Path

import cosim
from cosim.campaign.spec import load_campaign

FILE = Path(__file__).with_name("NAME.toml")


def test_it_has_flights_with_and_without_a_fault_that_fly() -> None:
    """The first of each kind, for 3 s."""
    runs, _ = load_campaign(str(FILE)).scenarios()
    kinds = {bool(scenario.faults): scenario for scenario in reversed(runs)}
    assert set(kinds) == {True, False}
    for scenario in kinds.values():
        assert cosim.simulate(scenario.model_copy(update={"duration_s": 3.0})).status == "completed"
