"""What a guest keeps: `cosim check` asks it, `cosim new` writes it, a class that does not is refused."""

import itertools
import re
import runpy
import time
import timeit
from pathlib import Path

import numpy as np
import pytest

import cosim
from cosim.errors import CosimError
from cosim.flight.build import build
from cosim.flight.detection.detector_context import site
from cosim.flight.plugins import load, with_detectors
from cosim.flight.plugins.check import _costs, check
from cosim.flight.plugins.contract import record
from cosim.judge import coverage
from cosim.judge.naming import outcome
from fdi import registry

DATA = Path(__file__).parents[1] / "data"
BAD = DATA / "guests" / "misbehaving.py"
BLOCK = DATA / "template_detector.py"
ROD = "faults.0={target='elevator.left_inner.rod', kind='bias', bias_mm=12, start_s=2.5, path='monitor'}"
SHORT = ["duration_s=5", "elevator.feedback=measured", "detectors.enabled=['ofc_monitor']"]


def test_check_detector_says_what_keeps_the_contract_and_what_does_not(parity):
    found = check(parity)
    assert found["keeps"] and {line["result"] for line in found["checks"]} == {"good"} and len(found["checks"]) == 10
    bad = check(DATA / "guests" / "counting.py")
    assert not bad["keeps"]
    failed = {line["question"] for line in bad["checks"] if line["result"] == "bad"}
    assert {"deterministic", "live as in replay"} <= failed
    assert {line["question"]: line["result"] for line in bad["checks"]}["lost samples"] == "note"
    assert check(BLOCK)["keeps"]


JUDGING = """
import cosim

@cosim.register
class Judging:
    id, level, technologies, inputs = "judging", "local", ("hydraulic",), ("rod", "surface")

    def __init__(self, dt, threshold=LIMIT):
        self.threshold = threshold

    def update(self, t, y):
        r = abs(y.rod - 0.30 * y.surface) / self.threshold
        return {"r": r, "alarm": r > 1.0, "verdict": "WORD" if r > 1.0 else "none"}
"""


@pytest.mark.parametrize(
    "limit, word, result, says",
    [
        (0.01, "sensor", "good", "with a bias of the surface sensor: sensor"),
        (0.01, "gremlins", "bad", "with a bias of the surface sensor: "),
        (9.0, "gremlins", "note", "no alarm in 6 flights (an oscillation, a jam, a runaway, a bias of the surface"),
    ],
)
def test_check_detector_flies_faults_until_the_verdict_is_heard_or_says_that_it_was_not(
    tmp_path, limit, word, result, says
):
    (tmp_path / "judging.py").write_text(JUDGING.replace("LIMIT", str(limit)).replace("WORD", word))
    found = check(tmp_path / "judging.py")
    told = next(line for line in found["checks"] if line["question"] == "verdict is a class")
    assert (told["result"], found["keeps"]) == (result, result != "bad") and told["answer"].startswith(says), told
    assert word == "sensor" or "cosim list classes" in told["answer"] or "ofc_liquid" in told["answer"]


PEEK = """

def rollout(x, u, p, dt, log=None):
    for i in range(u.shape[0]):
        for k in range(u.shape[1]):
            step(x[i], u[i, k], p[i], dt)
            x[i].r += 1e-9 * u[i, u.shape[1] - 1].rod
            if log is not None:
                log[i, k] = x[i]
"""


def test_a_step_that_is_longer_than_a_tick_is_noted_whatever_the_mean(tmp_path):
    path = tmp_path / "now_and_then.py"
    source = (DATA / "guests" / "counting.py").read_text()
    assert source.count("def update(self, t, y):\n") == 1
    slow = "def update(self, t, y):\n        if abs(t - 2.0) < 1e-3:\n            import time; time.sleep(0.02)\n"
    path.write_text(source.replace("def update(self, t, y):\n", slow))
    line = next(line for line in check(path)["checks"] if line["question"] == "time of a step")
    assert line["result"] == "note" and "longer than it" in line["answer"]


def test_check_detector_finds_one_that_looks_into_the_future(tmp_path):
    (tmp_path / "peek.py").write_text(BLOCK.read_text() + PEEK)
    found = {line["question"]: line for line in check(tmp_path / "peek.py")["checks"]}
    assert found["causal"]["result"] == "bad" and "depends on what is measured from" in found["causal"]["answer"]
    assert found["live as in replay"]["result"] == "bad"


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
        ({"inputs": ("zzzzzz",)}, "'zzzzzz' is no signal. `cosim"),
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
    cls = type("Own", (), {**plain, **change})
    with pytest.raises(CosimError) as wrong:
        cosim.register(cls)
    assert said in str(wrong.value)


def test_what_a_guest_declares_is_expected_and_the_rest_is_not_declared():
    own = record(type("Own", (), {
        "id": "own", "level": "local", "technologies": ("hydraulic",), "inputs": ("rod",), "blind": ("rudder",),
        "designed_for": ("ofc_liquid",), "may_see": {"hydraulic.rod": "jam_liquid"}, "estimates": "rod",
        "update": lambda self, t, y: None, "__init__": lambda self, dt: None,
    }))  # fmt: skip
    assert own.designed_for == {
        "hydraulic.ofc_liquid": ("ofc_liquid", "ambiguous"),
        "hydraulic.ofc_liquid@*": ("ofc_liquid", "ambiguous"),
    }
    registry.tell(own)
    words = {case: coverage.expected("own", case) for case in
             ("hydraulic.ofc_liquid@command", "hydraulic.rod", "rudder", "engine")}  # fmt: skip
    assert list(words.values()) == ["designed", "may", "blind", "undeclared"]
    assert coverage.WORDS["undeclared"] == "not declared"
    assert outcome("own", "engine", seen=True, class_="right", place="right") == "named"
    assert outcome("own", "engine", seen=False) == "quiet" and outcome("own", "rudder", seen=True) == "bonus"
    assert (own.estimates[0].of, own.estimates[0].unit) == ("rod", "m")


def test_the_longest_step_is_never_shorter_than_the_mean(monkeypatch):
    """Both are of the same passes: where every step takes 5 us, both are 5 us."""
    guest, ticks, clock = load(BLOCK), 40, itertools.accumulate(itertools.chain([5e-6] * 240, itertools.repeat(1e-3)))
    monkeypatch.setattr(time, "perf_counter", lambda: next(clock))
    said = _costs(guest, np.zeros((1, ticks), guest.INPUTS), guest.DETECTOR.fit(site(0.005, "left_inner", {})), 0.005)
    mean, longest = map(float, re.search(r"^([\d.]+) us a step.*longest step ([\d.]+) us", said["answer"]).groups())
    assert mean == longest == pytest.approx(5.0, abs=0.01)


def test_a_guest_that_does_nothing_costs_little(tmp_path):
    """Targets: below 5 us per lane and tick for a class, 1 us compiled; here with room for a loaded machine."""
    (tmp_path / "idle.py").write_text(
        'class Idle:\n    id, level, technologies = "idle", "local", ("hydraulic",)\n    inputs = ("rod",)\n'
        "    def __init__(self, dt):\n        pass\n    def update(self, t, y):\n        return None\n"
    )
    scenario = with_detectors(cosim.load_scenario("cruise", [*SHORT, "duration_s=1"]), [tmp_path / "idle.py", BLOCK])
    setup = build(scenario)
    block = next(d for d in setup.loop.detectors if d.name == "idle")
    best = min(timeit.repeat(block.advance, number=2000, repeat=5)) / 2000 / len(block.x)
    assert best < 20e-6
    setup.time_detectors()
    assert setup.step_us["template"] < 4.0


def test_a_file_that_is_no_python_is_not_run(tmp_path):
    path = tmp_path / "aircraft.xml"
    path.write_text("raise SystemExit('ran')\n")
    with pytest.raises(CosimError, match=r"aircraft\.xml: is no Python code; allowed: a file that ends in \.py"):
        check(path)
