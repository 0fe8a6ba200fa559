"""Flights that begin in a climb, a descent or a turn, and a fault that waits for something.

The trim is steady: bank, vertical speed and airspeed stay as they begin, until a demand changes.
"""

import math

import cosim

TRUTH = {name: f"truth.aircraft.{name}" for name in ("nz", "phi", "hdot", "cas")}
keys = ["duration_s=20", "flight.turbulence=none", "detectors.enabled=[]"]
for start in (["flight.climb_fpm=1000"], ["flight.bank_deg=30"], ["flight.turn_deg_s=1.5", "flight.gamma_deg=-1"]):
    flown = cosim.fly(cosim.load_scenario("cruise", [*keys, *start]), TRUTH.values())
    nz, phi, hdot, cas = flown.iloc[-1]
    bank = f"bank {math.degrees(phi):.1f} deg, n_z {nz:.3f} for 1/cos(bank) = {1 / math.cos(phi):.3f}"
    print(f"{', '.join(start)}: {bank}, {hdot:+.2f} m/s, {cas / 0.5144:.1f} kt")

fault = "{target='elevator.left_inner', kind='jam_solid', when='t > 3 and n_z > 1.1', lasts_s=4}"
then = "{target='rudder', kind='jam', when='fault.0.since > 2'}"
waiting = ["duration_s=12", "flight.bank_deg=30", f"faults.0={fault}", f"faults.1={then}"]
result = cosim.simulate(cosim.load_scenario("cruise", waiting))
print([(f["kind"], f["target"], f["start_s"]) for f in result.faults])
