"""A campaign file of two short flights, for tests of what happens to its folder."""


def two_flights(duration_s: float = 0.5) -> str:
    """Return a campaign of two fault-free flights of `duration_s`, watched by the position monitor."""
    return f"""
base = "cruise"
runs = 2
seed = 3
[set]
duration_s = {duration_s}
"detectors.enabled" = ["position_monitor"]
"elevator.feedback" = "measured"
[draw]
"flight.mass_t" = {{ low = 200.0, high = 300.0 }}
"""
