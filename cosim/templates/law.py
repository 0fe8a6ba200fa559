"""NAME: a control law of your own. `cosim run --set law.file=NAME.py` flies it in place of the shipped one."""


class Law:
    """Pitch-rate damping, load factor by feed-forward, wings level."""

    def __init__(self, dt, start):
        """Begin at the trim: start.elevator, start.stabiliser, start.throttle and more; tick dt [s]."""
        self.start = start

    def update(self, t, y, ask):
        """Return commands [rad, throttle 0..1] for measurements y [SI, NaN while invalid] and what the pilot asks for.

        A command that is left out keeps its last value; `cosim list law` has every name.
        """
        elevator = self.start.elevator - 0.06 * ask.nz_dem + 0.3 * y.q  # trailing edge down +, pitches down
        return {"elevator": elevator, "aileron": -y.phi - y.p}
