"""Tests of NAME: a step after one time constant, and a flight in place of a segment. Run with pytest."""

import importlib.util
from pathlib import Path

import numpy as np

import cosim

FILE = Path(__file__).with_name("NAME.py")
SEEN = ["law.law.de_cmd", "truth.aircraft.de_li"]
ONLY = ["duration_s=3", "detectors.enabled=[]", "elevator.feedback=measured", f"actuators.NAME.file={FILE}"]


def test_a_step_reaches_63_per_cent_after_one_time_constant() -> None:
    """tau = 0.1 s in ticks of 5 ms."""
    spec = importlib.util.spec_from_file_location("NAME", FILE)
    assert spec is not None and spec.loader is not None
    own = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(own)
    p, u = own.params(tau=0.1), np.zeros((1, 1), own.INPUTS).view(np.recarray)
    x = own.init_at(p, 0.0, 0.0, 0.0).view(np.recarray)
    u.command = 1.0
    for _ in range(20):
        own.rollout(x, u, p.view(np.recarray), 0.005)
    assert abs(x.delta[0] - 0.63) < 0.02


def test_it_flies_and_follows_its_command() -> None:
    """3 s with a doublet; [rad]."""
    manoeuvre = ["manoeuvre.kind=nz_doublet", "manoeuvre.start_s=0.5", "elevator.left_inner=NAME"]
    seen = cosim.fly(cosim.load_scenario("cruise", [*ONLY, *manoeuvre]), SEEN)
    assert (seen[SEEN[0]] - seen[SEEN[1]]).abs().mean() < 0.01
