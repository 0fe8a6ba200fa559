"""Stick, throttle and stabiliser of your own as a table over time.

The table may stand in the scenario or, as here, in a CSV file beside it; a log holds its numbers.
"""

from pathlib import Path

import cosim

Path("stick.csv").write_text("""\
time_s, stick, bank_deg, throttle_change, stabiliser_change_deg
     0,     0,        0,               0,                     0
     5,     0,        0,               0,                     0
     6,  0.05,        0,            0.05,                     0
     9,  0.05,        0,            0.05,                     0
    10,     0,        0,            0.05,                   0.1
    12,     0,       15,            0.05,                   0.1
""")
keys = ["duration_s=30", "manoeuvre.kind=inputs", "manoeuvre.file=stick.csv", "flight.turbulence=none"]
flight = cosim.fly(cosim.load_scenario("cruise", keys), ["truth.aircraft.nz", "truth.aircraft.phi", "law.law.stab_cmd"])
print(flight.iloc[::1000].round(4).to_string())
