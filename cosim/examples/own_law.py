"""Fly a control law of your own, and the shipped one with another gain, beside it.

`cosim list law` has what a law may read, command and is asked for; `cosim check mine.py` flies it.
"""

from pathlib import Path

import cosim

Path("mine.py").write_text('''
class Law:
    """Pitch-rate damping, load factor by feed-forward, wings level."""

    def __init__(self, dt, start):
        self.start = start

    def update(self, t, y, ask):
        elevator = self.start.elevator - 0.06 * ask.nz_dem + 0.3 * y.q
        return {"elevator": elevator, "aileron": -y.phi - y.p}
''')

flight = ["duration_s=10", "manoeuvre.kind=nz_doublet", "manoeuvre.start_s=2", "manoeuvre.amplitude_g=0.2"]
laws = {"shipped": [], "k_i = 0.01": ["law.k_i=0.01"], "mine": ["law.file=mine.py"]}
for name, changes in laws.items():
    n_z = cosim.fly(cosim.load_scenario("cruise", [*flight, *changes]), ["truth.aircraft.nz"])["truth.aircraft.nz"]
    print(f"{name:18} n_z {n_z.min():.2f} to {n_z.max():.2f} g")
