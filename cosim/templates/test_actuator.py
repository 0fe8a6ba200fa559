"""Tests of NAME: it flies in place of a segment and follows its command with the lag that is set. Run with pytest."""

from pathlib import Path

import cosim

FILE = Path(__file__).with_name("NAME.py")
SEEN = ["law.law.de_cmd", "truth.aircraft.de_li"]
MANOEUVRE = ["manoeuvre.kind=nz_doublet", "manoeuvre.start_s=0.5"]
ONLY = ["duration_s=3", "detectors.enabled=[]", "elevator.feedback=measured", "elevator.left_inner=NAME", *MANOEUVRE]


def test_a_longer_lag_follows_less() -> None:
    """The largest distance of surface and command grows with tau."""
    away = []
    for tau in (0.05, 0.3):
        own = [f"actuators.NAME.file={FILE}", f"actuators.NAME.parameters.tau={tau}"]
        seen = cosim.fly(cosim.load_scenario("cruise", [*own, *ONLY]), SEEN)
        away.append((seen[SEEN[0]] - seen[SEEN[1]]).loc[0.5:].abs().max())
    assert 0.0 < away[0] < away[1]
