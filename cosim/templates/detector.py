"""NAME: a detector of your own. `cosim run --detector NAME.py` flies it beside the others."""


class CLASS:
    """rod against surface: a fault of one of the two sensors pulls them apart"""

    id, level, technologies = "NAME", "local", ("hydraulic",)
    inputs = ("rod", "surface")  # of this actuator; `cosim list signals` has every word
    designed_for = ("rod", "surface")  # faults of these sensors; or kinds of fault: `cosim list faults`
    blind = ("ofc_liquid", "ofc_solid")  # what it cannot see; or a text: why it sees nothing else
    isolable_parts = ("rod", "surface")

    def __init__(self, dt, arm=0.30, threshold=0.004, confirm_s=0.1):  # set in a scenario: detectors.NAME.threshold
        self.dt, self.arm, self.threshold, self.confirm_s = dt, arm, threshold, confirm_s
        self.before, self.away, self.isolated_part = None, 0.0, ""

    def update(self, t, y):
        """Judge the measurements of time t [s]: SI, NaN while invalid."""
        now = (y.rod, self.arm * y.surface)
        if now[0] != now[0] or now[1] != now[1]:  # a sample is missing
            return {"valid": False}
        r = abs(now[0] - now[1]) / self.threshold
        if r > 1.0 and self.away == 0.0 and self.before:  # which of the two has jumped?
            moved = [abs(a - b) for a, b in zip(now, self.before)]
            self.isolated_part = self.isolable_parts[moved.index(max(moved))]
        self.before, self.away = now, self.away + self.dt if r > 1.0 else 0.0
        if self.away <= self.confirm_s:
            return {"r": r, "alarm": False}
        return {"r": r, "alarm": True, "verdict": "sensor", "isolated_part": self.isolated_part}
