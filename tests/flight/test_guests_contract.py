"""The contract of a user detector: `cosim check` tests it, `cosim new` writes one, others are refused."""

import runpy
import timeit
from pathlib import Path

import pytest

import cosim
from cosim.errors import CosimError
from cosim.flight.build import build
from cosim.flight.check import check
from cosim.judge import coverage
from cosim.judge.naming import outcome
from cosim.parts import with_detectors
from cosim.parts.detector import record_of
from fdi import registry

DATA = Path(__file__).parents[1] / "data"
BLOCK = DATA / "template_detector.py"
SHORT = ["duration_s=5", "elevator.feedback=measured", "detectors.enabled=['ofc_monitor']"]
QUESTIONS = ["runs", "deterministic", "causal", "live as in replay", "lost samples"]
PEEK = """

def rollout(x, u, p, dt, log=None):
    for i in range(u.shape[0]):
        for k in range(u.shape[1]):
            step(x[i], u[i, k], p[i], dt)
"""


def asked(path):
    """Return whether a detector keeps the contract, and {question: (result, answer)}."""
    found = check(path)
    return found["keeps"], {line["question"]: (line["result"], line["answer"]) for line in found["checks"]}


def test_check_says_for_each_question_whether_it_is_kept(parity, tmp_path):
    keeps, told = asked(parity)
    assert keeps and list(told) == QUESTIONS and {result for result, _ in told.values()} == {"good"}
    assert asked(BLOCK)[0]
    (tmp_path / "plain.py").write_text(BLOCK.read_text() + PEEK)  # a block in plain Python
    assert asked(tmp_path / "plain.py")[0]
    keeps, told = asked(DATA / "guests" / "counting.py")
    bad = {question for question, (result, _) in told.items() if result == "bad"}
    assert not keeps and bad >= {"deterministic", "live as in replay"} and told["lost samples"][0] == "note"


def test_check_finds_what_raises_and_what_knows_the_future(parity, tmp_path):
    own = tmp_path / "own.py"
    text, begin = parity.read_text(), "        now = ("
    own.write_text(text.replace(begin, f"        1 / (t < 2.0)\n{begin}"))
    keeps, told = asked(own)
    assert not keeps and list(told) == ["runs"] and "at 2.000 s: ZeroDivisionError" in told["runs"][1]
    flight = "__import__('sys')._getframe(2).f_locals['given'][0]"  # of the caller's caller
    own.write_text(text.replace(f"{begin}y.rod", f"{begin}y.rod + 1e-9 * {flight}[-1, 0]"))
    _, told = asked(own)
    assert told["causal"][0] == "bad" and "depends on what is measured from" in told["causal"][1]
    assert told["live as in replay"][0] == "bad"


def test_new_writes_a_detector_and_a_test_that_passes(parity):
    assert 15 <= len(parity.read_text().splitlines()) <= 40
    tests = runpy.run_path(str(parity.with_name("test_parity.py")))
    assert [tests[name]() for name in tests if name.startswith("test_")] == [None, None]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"id": "Ofc Monitor"}, "id = 'Ofc Monitor'; allowed: lower-case letters"),
        ({"level": "global"}, "level = 'global'; allowed: local, aircraft"),
        ({"technologies": ("pneumatic",)}, "allowed: hydraulic, ema, simple"),
        ({"inputs": ("rodd",)}, "'rodd' is no signal. Did you mean 'rod'?"),
        ({"inputs": ("current",)}, "'current' is of ema only"),
        ({"level": "aircraft"}, "Name the segment"),
        ({"designed_for": ("ofc_fluid",)}, "'ofc_fluid' is no kind of fault"),
        ({"every": 0}, "every = 0"),
        ({"estimates": "speed"}, "estimates = 'speed'"),
        ({"__init__": lambda self: None}, "__init__ does not take dt"),
    ],
)
def test_a_class_that_is_no_detector_is_refused_with_what_is_allowed(change, said):
    plain = {"id": "own", "level": "local", "technologies": ("hydraulic",), "inputs": ("rod",),
             "update": lambda self, t, y: None, "__init__": lambda self, dt: None}  # fmt: skip
    with pytest.raises(CosimError) as wrong:
        cosim.register(type("Own", (), {**plain, **change}))
    assert said in str(wrong.value)


def test_what_a_guest_declares_is_expected_and_the_rest_is_not_declared():
    own = record_of(type("Own", (), {
        "id": "own", "level": "local", "technologies": ("hydraulic",), "inputs": ("rod",), "blind": ("rudder",),
        "designed_for": ("ofc_liquid",), "may_see": {"hydraulic.rod": "jam_liquid"}, "estimates": "rod",
        "update": lambda self, t, y: None, "__init__": lambda self, dt: None,
    }))  # fmt: skip
    registry.tell(own)
    cases = ("hydraulic.ofc_liquid@command", "hydraulic.rod", "rudder", "engine")
    assert [coverage.expected("own", case) for case in cases] == ["designed", "may", "blind", "undeclared"]
    assert own.designed_for["hydraulic.ofc_liquid"] == ("ofc_liquid", "ambiguous")
    assert outcome("own", "engine", seen=False) == "quiet" and outcome("own", "rudder", seen=True) == "bonus"
    assert (own.estimates[0].of, own.estimates[0].unit) == ("rod", "m")


def test_a_guest_that_does_nothing_costs_little(tmp_path):
    """Targets: below 5 us per lane and tick for a class, 1 us compiled; here with room for a loaded machine."""
    (tmp_path / "idle.py").write_text(
        'class Idle:\n    id, level, technologies = "idle", "local", ("hydraulic",)\n    inputs = ("rod",)\n'
        "    def __init__(self, dt):\n        pass\n    def update(self, t, y):\n        return None\n"
    )
    scenario = with_detectors(cosim.load_scenario("cruise", [*SHORT, "duration_s=1"]), [tmp_path / "idle.py", BLOCK])
    setup = build(scenario)
    block = next(d for d in setup.loop.detectors if d.name == "idle")
    assert min(timeit.repeat(block.advance, number=2000, repeat=5)) / 2000 / len(block.x) < 20e-6
    setup.time_detectors()
    assert setup.step_us["template"] < 4.0


def test_a_file_that_is_no_python_is_not_run(tmp_path):
    path = tmp_path / "aircraft.xml"
    path.write_text("raise SystemExit('ran')\n")
    with pytest.raises(CosimError, match=r"aircraft\.xml: is no Python code; allowed: a file that ends in \.py"):
        check(path)
