"""Fly a detector of your own beside the others, and see it in their table.

In a file of its own the same class flies by `cosim run --detector parity.py`; `cosim new detector parity` writes one.
"""

import cosim


@cosim.register
class Parity:
    """rod against surface: a fault of one of the two sensors pulls them apart"""

    id, level, technologies = "parity", "local", ("hydraulic",)
    inputs = ("rod", "surface")  # `cosim list signals` has every word
    designed_for = ("rod", "surface")

    def __init__(self, dt, arm=0.30, threshold=0.004, confirm_s=0.1):
        self.dt, self.arm, self.threshold, self.confirm_s = dt, arm, threshold, confirm_s
        self.away = 0.0

    def update(self, t, y):
        """Judge the measurements of time t [s]: SI, NaN while a sensor is invalid."""
        r = abs(y.rod - self.arm * y.surface) / self.threshold
        self.away = self.away + self.dt if r > 1.0 else 0.0
        alarm = self.away > self.confirm_s
        return {"r": r, "alarm": alarm, "verdict": "sensor" if alarm else "none"}


fault = "faults.0={target='elevator.left_inner.rod', kind='bias', bias_mm=12, start_s=6, path='monitor'}"
scenario = cosim.load_scenario("cruise", ["duration_s=12", "elevator.feedback=measured", fault])
for lane in cosim.simulate(scenario, log="own_detector.mcap").to_dict()["detectors"]:
    if lane["target"] == "elevator.left_inner":
        said = lane["isolated"]["class"] if lane["isolated"] else "-"
        late = lane["detection_delay_s"]
        told = "quiet" if late is None else f"{late:.2f} s, {said}"
        print(f"{lane['id']:18} {told:16} {lane['step_us']:.2f} us a step")
