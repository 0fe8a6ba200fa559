"""Write a fault of your own into a scenario, and find from which size on it is noticed.

The same keys stand in a TOML file, in --set on the command line, and here.
"""

import cosim

FAULT = {
    "target": "elevator.left_inner",  # `cosim list targets`
    "kind": "ofc_liquid",  # `cosim list faults`
    "at": "command",
    "start_s": 8.0,
    "frequency_hz": 1.5,
    "phase_deg": 90.0,
}

for amplitude_mm in (0.5, 2.0, 8.0):
    keys = [f"faults.0.{key}={value}" for key, value in {**FAULT, "amplitude_mm": amplitude_mm}.items()]
    scenario = cosim.load_scenario("cruise", ["duration_s=16", "flight.turbulence=none", *keys])
    result = cosim.simulate(scenario, achieved=True, timed=False).to_dict()
    seen = {d["id"]: d["detection_delay_s"] for d in result["detectors"] if d["detection_delay_s"] is not None}
    moved = result["achieved"]["left_inner"]["amplitude_mm"]
    print(f"{amplitude_mm:4.1f} mm asked, {moved:5.2f} mm achieved, seen by {seen or 'nobody'}")
