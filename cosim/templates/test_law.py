"""Tests of NAME: it follows a demanded load factor and keeps the wings level. Run with pytest."""

from pathlib import Path

import cosim

FILE = Path(__file__).with_name("NAME.py")
DOUBLET = ["manoeuvre.kind=nz_doublet", "manoeuvre.start_s=1", "manoeuvre.width_s=1.5", "manoeuvre.amplitude_g=0.2"]


def test_it_follows_a_doublet_with_wings_level() -> None:
    """0.2 g up for 1.5 s, then down."""
    only = ["duration_s=5", "flight.turbulence=none", "detectors.enabled=[]", f"law.file={FILE}"]
    only += ["elevator.feedback=measured"]
    seen = cosim.fly(cosim.load_scenario("cruise", [*only, *DOUBLET]), ["truth.aircraft.nz", "truth.aircraft.phi"])
    n_z, bank = seen["truth.aircraft.nz"], seen["truth.aircraft.phi"]
    assert n_z.loc[1.75:2.75].mean() > 1.05 and n_z.loc[3.5:4.25].mean() < 0.97
    assert bank.abs().max() < 0.05
