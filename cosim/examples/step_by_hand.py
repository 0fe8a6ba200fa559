"""Fly tick by tick: watch the signals, break an elevator when the aircraft is steady, mend it, and keep the log."""

import cosim

with cosim.Flight(cosim.load_scenario("cruise", ["duration_s=20"]), log="by-hand.mcap") as flight:
    flight.step(1000)  # 5 s at 200 Hz
    fault = flight.inject(target="elevator.left_inner", kind="jam_solid")
    while flight.time < 12.0 and flight.step(200):
        measured = flight.signals  # words of `cosim list signals`, or names of the bus
        print(f"{flight.time:4.1f} s  n_z {measured['n_z']:.3f} g  rod {1e3 * measured['left_inner.rod']:.2f} mm")
    flight.heal(fault)
    flight.step(600)

result = flight.result()
print(result)
print(result.to_dict()["consequences"])
