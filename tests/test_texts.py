"""TOML and JSON of others: whatever the parsers raise or let through becomes one line, quickly."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import CosimError, ScenarioError
from cosim.scenario import load_scenario
from cosim.texts import from_json, read, toml

BAD = {
    "deep lists": "x = " + "[" * 5000 + "]" * 5000,
    "deep tables": "x = " + "{a = " * 400 + "1" + "}" * 400,
    "dotted keys": ".".join("a" * 1000) + " = 1",
    "dotted header": "[" + ".".join("a" * 900) + "]",
    "digits": "x = " + "9" * 5000,
    "wide": "x = 99999999999999999999999",
    "date": "title = 2020-01-01",
    "time": "x = 10:00:00",
    "large": "# " + "x" * 1_100_000,
    "not TOML": "x = = 1",
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_bad_is_one_line(name, tmp_path):
    with pytest.raises(ScenarioError) as caught:
        toml(BAD[name], place="file.toml", error=ScenarioError)
    assert str(caught.value).startswith("file.toml: ") and len(str(caught.value)) < 300
    path = tmp_path / "bad.toml"
    path.write_text(BAD[name])
    with pytest.raises(CosimError):
        load_scenario(str(path))


NONSENSE = ("manoeuvre.kind=[{}]", "manoeuvre.kind={}", "faults.0=[[]]", "duration_s=" + "9" * 5000,
            "seed=" + "[" * 3000, "elevator=" + "{a=" * 100,
            "title=\udcff", "\udcff=1")  # fmt: skip


@pytest.mark.parametrize("override", NONSENSE)
def test_an_override_of_nonsense_is_one_line(override):
    with pytest.raises(CosimError) as caught:
        load_scenario("cruise", [override])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ['{"a": "x\\ud800"}', '["\\udcff"]', '{"\\ud800": 1}', '"\\udfff"'])
def test_json_with_half_a_letter_is_one_line(text):
    """No file can be written with it: what lets it through breaks whoever writes the result."""
    with pytest.raises(CosimError, match="half a letter"):
        from_json(text, place="x.json")
    assert from_json('"\\ud83d\\ude00 µ"', place="x.json") == "😀 µ"


SCALARS = st.none() | st.booleans() | st.integers() | st.text() | st.floats()


@given(st.recursive(SCALARS, lambda x: st.lists(x) | st.dictionaries(st.text(), x)))
def test_json_is_read_as_it_is_or_refused(value):
    try:
        found = from_json(json.dumps(value), place="x")
    except CosimError:
        return
    assert json.dumps(found) == json.dumps(value)


@given(st.text(max_size=300))
def test_any_text_is_tables_or_one_error(text):
    try:
        assert isinstance(toml(text, place="x"), dict)
    except CosimError as error:
        assert "\n" not in str(error)


def test_only_small_regular_files_of_utf_8_are_read(tmp_path):
    (tmp_path / "latin").write_bytes(b"\xff")
    for path in (tmp_path, tmp_path / "latin", "/dev/zero"):
        with pytest.raises(CosimError):
            read(path)
    with pytest.raises(FileNotFoundError):
        read(tmp_path / "none")
