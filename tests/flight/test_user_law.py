"""Own laws: gains of the shipped one, a class in a file, a compiled block; what is wrong with one is told."""

import json
import textwrap

import numpy as np
import pytest
from typer.testing import CliRunner

import cosim
from cosim.campaign.inventory import inventory
from cosim.cli import commands as cli
from cosim.errors import ScenarioError
from cosim.flight.loop.wiring import DEMANDS
from cosim.flight.user_law import SENSORS, SURFACES, TRIM, gains

SHORT = ["duration_s=6", "detectors.enabled=[]", "elevator.feedback=measured", "manoeuvre.kind=nz_doublet",
         "manoeuvre.start_s=1", "manoeuvre.width_s=1.5", "manoeuvre.amplitude_g=0.2"]  # fmt: skip
SEEN = ["truth.aircraft.nz", "law.law.de_cmd", "truth.aircraft.phi"]


def flown(*changes):
    return cosim.fly(cosim.load_scenario("cruise", [*SHORT, *changes]), SEEN).to_numpy()


def test_a_gain_of_the_shipped_law_is_the_scenarios():
    own, shipped = flown("law.k_nz=0.0", "law.k_i=0.02"), flown()
    assert np.abs(own[:, 1] - shipped[:, 1]).max() > np.radians(0.1)
    assert "k_nz" in gains() and "alpha_0" not in gains()
    with pytest.raises(ScenarioError, match=r"law\.k_nzz = 1: no such gain.*Did you mean 'k_nz'"):
        flown("law.k_nzz=1.0")


PLAIN = '''
    class Law:
        """Pitch-rate damping and a load factor by feed-forward; wings level."""

        def __init__(self, dt, start):
            self.start = start

        def update(self, t, y, ask):
            elevator = self.start.elevator - 0.06 * ask.nz_dem + 0.3 * y.q
            return {"elevator": elevator, "aileron": -1.0 * y.phi - 1.0 * y.p, "stabiliser": self.start.stabiliser}
'''


def test_a_law_in_plain_python_flies(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(textwrap.dedent(PLAIN))
    own = flown(f"law.file={path}", "flight.turbulence=none")
    assert np.ptp(own[:, 0]) > 0.15 and np.abs(own[:, 2]).max() < np.radians(3.0)
    up, down = (own[k - 20 : k + 20, 0].mean() - own[0, 0] for k in (490, 800))  # at the end of each pulse
    assert up > 0.1 and down < -0.05


def test_a_compiled_law_of_the_shipped_records_flies_like_the_shipped_one(tmp_path):
    path = tmp_path / "same.py"
    path.write_text("from cosim.flight.blocks.law import rollout\n")
    np.testing.assert_array_equal(flown(f"law.file={path}"), flown())


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('"aileron"', '"flaps"', r"commands flaps = .*; allowed: numbers of elevator, aileron, rudder"),
        ("return {", "return {'rudder': [1.0], ", r"commands rudder = \[1\.0\]; allowed: numbers of elevator"),
        ("y.q", "y.qq", r"mine\.py: at 0\.000 s AttributeError"),
        ("elevator = ", "elevator = 1 / (t < 0.5) + ", r"mine\.py: at 0\.500 s ZeroDivisionError: division by zero"),
        ("return {", "return None and {", r"at 0\.000 s TypeError: update answers NoneType; allowed: a dictionary"),
        ("self.start = start", "raise SystemExit(3)", r"at 0\.000 s SystemExit: 3"),
        ("class Law", "raise SystemExit\nclass Law", r"mine\.py: does not run: SystemExit \(mine\.py:2\)$"),
        ("class Law", "class Lore", r"has neither a class Law nor a rollout"),
    ],
)
def test_a_wrong_law_is_told(tmp_path, old, new, says):
    path = tmp_path / "mine.py"
    path.write_text(textwrap.dedent(PLAIN).replace(old, new))
    with pytest.raises(ScenarioError, match=says):
        flown(f"law.file={path}")


def test_commands_are_cut_and_what_is_no_number_is_held(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(textwrap.dedent(PLAIN).replace("return {", "return {'throttle': float('nan'), 'rudder': 9.0, "))
    s = cosim.load_scenario("cruise", [*SHORT, "duration_s=0.2", f"law.file={path}"])
    found = cosim.fly(s, ["law.law.throttle_cmd", "law.law.dr_cmd"]).to_numpy()
    assert np.ptp(found[:, 0]) == 0.0 and 0.2 < found[0, 0] < 0.9
    assert found[-1, 1] == pytest.approx(s.aircraft.travels["rudder"][1])
    told = "mine.py: throttle = nan at 0.000 s; a command that is not finite keeps its last value"
    assert cosim.simulate(s).extra["notes"] == [told]


def test_what_a_law_may_read_and_command_is_listed():
    assert {"alpha", "q", "n_z", "cas"} < set(SENSORS)
    assert tuple(SURFACES) == ("elevator", "aileron", "rudder", "stabiliser", "throttle")
    listed = {r["name"] for r in inventory()["law"] if r["unit"] and r["summary"]}
    every = [*(f"y.{n}" for n in SENSORS), *(f"ask.{n}" for n in DEMANDS), *(f"start.{n}" for n in TRIM)]
    assert listed == {*every, *(f'"{n}"' for n in SURFACES)}
    told = CliRunner().invoke(cli.app, ["list", "law"]).stdout
    assert all(name in told for name in listed)


def checked(tmp_path, old="", new=""):
    path = tmp_path / "mine.py"
    path.write_text(textwrap.dedent(PLAIN).replace(old, new))
    found = json.loads(CliRunner().invoke(cli.app, ["check", str(path), "--json"]).stdout)
    return found["keeps"], {line["question"]: (line["result"], line["answer"]) for line in found["checks"]}


def test_a_law_is_checked_by_flying_it(tmp_path):
    keeps, lines = checked(tmp_path)
    assert keeps and {result for result, _ in lines.values()} == {"good"}
    assert list(lines) == ["runs", "deterministic", "lost samples"]


@pytest.mark.parametrize(
    ("old", "new", "question", "says"),
    [
        ("y.q", "y.qq", "runs", "`cosim list law` has every name"),
        ("0.3 * y.q", "-3.0 * y.q", "runs", "departed after"),  # flies for 6 s
        ("0.3 * y.q", "-1.0 * y.q", "runs", "g are asked in light turbulence"),
        ("self.start = start", "self.start = start; import random; self.start.elevator += 1e-4 * random.random()",
         "deterministic", "two flights differ"),
        ("0.3 * y.q", "0.3 * (0.0 if y.q == y.q else 1 / 0)", "lost samples", "ZeroDivisionError"),
    ],
)  # fmt: skip
def test_a_check_says_what_a_law_does_not_keep(tmp_path, old, new, question, says):
    keeps, lines = checked(tmp_path, old, new)
    assert says in lines[question][1] and lines[question][0] == "bad" and not keeps
