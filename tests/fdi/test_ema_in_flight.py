"""EMA sensor faults in flight: named, and the loop closed on the estimate."""

import ema_flights
import pytest


def test_a_position_fault_in_flight_is_named_and_the_loop_closed_on_the_estimate():
    found = ema_flights.position_fault("position + 15 deg", 11)
    assert found["named"] == "position" and found["delay_s"] < 0.3 and found["valid"]
    assert found["dnz"] < 0.04 < 0.1 < found["dnz_without"]
    assert found["surface_deg"] < 0.5


@pytest.mark.parametrize("path", ["loop", "monitor"])
def test_a_current_bias_never_reconfigures_and_is_always_named_where_only_the_monitor_has_it(path):
    found = ema_flights.loop_fault("current + 10 % of stall", 11, path)
    assert not found["reconfigured"]
    allowed = ("sensor current", "none", "ambiguous") if path == "loop" else ("sensor current",)
    assert found["names"][-1] in allowed
