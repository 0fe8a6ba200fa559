"""What a slip in a call from Python says: plain words, and a text where a list of one is meant."""

import pytest

import cosim
from cosim.errors import ScenarioError


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("api") / "a.mcap"
    result = cosim.simulate("cruise", log=path, timed=False)  # a name is as good as what load_scenario makes of it
    assert result.status == "completed"
    return cosim.open_log(path)


def test_one_override_may_be_a_text():
    assert cosim.load_scenario("cruise", "duration_s=3") == cosim.load_scenario("cruise", ["duration_s=3"])
    with pytest.raises(ScenarioError, match=r"overrides: 3 is no text; allowed: texts like 'faults.0.frequency_hz=3'"):
        cosim.load_scenario("cruise", [3])


def test_what_is_no_scenario_is_refused_in_words():
    with pytest.raises(TypeError, match=r"3 is no scenario: give what cosim.load_scenario returns"):
        cosim.simulate(3)
    with pytest.raises(ScenarioError, match="no built-in scenario"):
        cosim.simulate("cruse")


def test_a_topic_is_no_field(log):
    with pytest.raises(KeyError) as error:
        log.fields("/truth/aircraft")
    said = "'/truth/aircraft' names no field, which is '/topic.field', such as '/truth/aircraft.alpha'"
    assert str(error.value) == f"{said}; log.frame('/truth/aircraft') gives the whole topic"
    with pytest.raises(KeyError, match="'alpha' names no field"):
        log.fields("alpha")
    assert list(log.fields("/truth/aircraft.alpha").columns) == ["/truth/aircraft.alpha"]


def test_what_is_not_there_is_answered_with_what_is_near(log):
    for call, word, near in (
        (log.frame, "/truth/aircaft", "/truth/aircraft"),
        (log.fields, "/truth/aircraft.alfa", "alpha"),
        (log.array, "truth/aircraft", "/truth/aircraft"),
    ):
        with pytest.raises(KeyError) as error:
            call(word)
        text = str(error.value)
        assert near in text.split("near: ")[1] and len(text) < 300
    assert f"{len(log.topics)} topics" in text


def test_frames_carry_units(log):
    frame = log.frame("/truth/aircraft")
    assert frame.attrs["units"] == dict(zip(frame.columns, log.topics["/truth/aircraft"].units))
    assert frame.attrs["units"]["alpha"] == "rad" and frame.attrs["units"]["h"] == "m"
    names = ["/truth/aircraft.alpha", "/sensors/aircraft.n_z"]
    assert log.fields(names).attrs["units"] == dict(zip(names, ("rad", "g")))
