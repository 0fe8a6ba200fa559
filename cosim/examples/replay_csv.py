"""Run the detectors on a foreign recording: a CSV in bench units, and the map that explains it.

The table is made here from a flight, as a bench would log it: milliseconds, and degrees with the opposite sign.
"""

from math import degrees
from pathlib import Path

import pandas as pd

import cosim
from cosim.replay.map import diagnose

cosim.simulate(cosim.load_scenario("runaway", ["duration_s=16"]), log="flight.mcap", timed=False)
log = cosim.open_log("flight.mcap")
surface, law = log.frame("/sensors/left_inner")["surface"], log.frame("/law")["de_cmd"]
bench = {"clock_ms": 1000.0 * law.index, "ELEV_CMD_DEG": -degrees(1) * law, "SURF_DEG": -degrees(1) * surface}
pd.DataFrame(bench).to_csv("bench.csv", index=False)

Path("bench.toml").write_text(
    """
rate_hz = 200
time = "clock_ms"

[flight]
mass_t = 200.0
cg_pct = 30.0
altitude_ft = 20000.0
cas_kt = 290.0

[signals]
de_cmd = { channel = "ELEV_CMD_DEG", unit = "deg", sign = -1 }
"left_inner.surface" = { channel = "SURF_DEG", unit = "deg", sign = -1 }
"""
)

found = diagnose("bench.csv", "bench.toml")  # the command line: cosim replay bench.csv --map bench.toml
for detector in found.detectors:
    print(detector["id"], detector["target"], "first alarm at", detector["first_alarm_s"], "s", detector["isolated"])
print(len(found.not_run), "more lack a signal")
