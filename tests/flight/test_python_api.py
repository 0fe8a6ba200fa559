"""What a slip in a call from Python says: plain words, and a text where a list of one is meant."""

import inspect
import pickle
import subprocess
import sys

import pytest

import cosim
from cosim.errors import CosimError, ScenarioError


@pytest.fixture(scope="module")
def log(cruise_log):
    return cosim.open_log(cruise_log)


def test_one_override_may_be_a_text():
    assert cosim.load_scenario("cruise", "duration_s=3") == cosim.load_scenario("cruise", ["duration_s=3"])
    with pytest.raises(ScenarioError, match=r"--set 3: is no text in UTF-8\. Example: --set faults\.0\.frequency_hz=3"):
        cosim.load_scenario("cruise", [3])


def test_what_is_no_scenario_is_refused_in_words(capsys):
    with pytest.raises(TypeError, match=r"3 is no scenario: give what cosim.load_scenario returns"):
        cosim.simulate(3)
    with pytest.raises(ScenarioError, match="no built-in scenario"):
        cosim.simulate("cruse")
    short = cosim.load_scenario("cruise", "duration_s=0.1")
    told = cosim.simulate(short, timed=False, progress=lambda t, end: print("flown to", t))
    assert told.status == "completed" and "flown to" in capsys.readouterr().out


def test_a_traceback_of_ours_ends_at_the_users_line(tmp_path, monkeypatch):
    user = tmp_path / "mine.py"
    user.write_text("import cosim\n\ndef study():\n    return cosim.load_scenario('cruse')\n\nstudy()\n")
    for full, frames in (("", 3), ("1", 4)):
        monkeypatch.setenv("COSIM_TRACEBACK", full)
        told = subprocess.run([sys.executable, str(user)], capture_output=True, text=True, check=False).stderr
        assert "return cosim.load_scenario('cruse')" in told and "Did you mean 'cruise'" in told
        assert (told.count('  File "') == frames) == (not full) and told.count("Traceback") == 1
    assert pickle.loads(pickle.dumps(cosim.simulate)) is cosim.simulate
    assert "overrides" in inspect.signature(cosim.load_scenario).parameters


def test_what_is_not_there_is_answered_with_what_is_near(log):
    for call, word, near in (
        (log.frame, "/truth/aircaft", "/truth/aircraft"),
        (lambda word: log.frame("/truth/aircraft", fields=[word]), "alfa", "alpha"),
        (log.array, "truth/aircraft", "/truth/aircraft"),
    ):
        with pytest.raises(KeyError) as error:
            call(word)
        text = str(error.value)
        assert near in text.split("Did you mean")[1] and len(text) < 300
    assert f"all {len(log.topics)}" in text


def test_frames_carry_units(log):
    frame = log.frame("/truth/aircraft")
    assert frame.attrs["units"] == dict(zip(frame.columns, log.topics["/truth/aircraft"].units))
    assert frame.attrs["units"]["alpha"] == "rad" and frame.attrs["units"]["h"] == "m"
    wide = log.frame("/sensors")
    assert wide.attrs["units"]["aircraft.n_z"] == "g" and wide.attrs["units"]["left_inner.rod"] == "m"


def test_results_and_logs_print_themselves(log):
    assert "topics, complete" in repr(log)
    result = cosim.simulate(cosim.load_scenario("cruise", "duration_s=0.2"), timed=False)
    assert repr(result).startswith("Result: completed after 0.2 s")


def test_the_linear_model_is_of_a_scenario_a_name_or_a_point():
    scenario = cosim.load_scenario("cruise")
    A = cosim.linearize(scenario).A
    assert (A == cosim.linearize("cruise").A).all() and A.shape == (10, 10)


def test_the_linear_model_goes_to_control_with_its_names():
    control = pytest.importorskip("control")
    model = cosim.linearize("cruise")
    own = model.to_control(("tas", "alpha", "q", "theta"), ("de_li",), ("nz", "q"))
    assert own.state_labels == ["tas", "alpha", "q", "theta"] and own.input_labels == ["de_li"]
    assert own.output_labels == ["nz", "q"] and isinstance(own, control.StateSpace)
    a, _, c, _ = model.block(("tas", "alpha", "q", "theta"), ("de_li",), ("nz", "q"))
    assert (own.A == a).all() and (own.C == c).all()


def test_a_name_that_a_linear_model_has_not_is_told_with_those_it_has():
    model = cosim.linearize("cruise")
    with pytest.raises(CosimError, match=r"unknown input 'de'; allowed: .*de_li"):
        model.block(["alpha", "q"], ["de"])
