"""TOML and JSON of others: whatever the parsers raise or let through becomes one line, quickly."""

import contextlib
import json
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import CosimError, ScenarioError
from cosim.scenario import load_scenario
from cosim.scenario.condition import condition
from cosim.scenario.toml import dumps
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


LONG = {
    "word": lambda n: f"title = '{'x' * n}'",
    "comment": lambda n: "# " + "x" * n,
    "key": lambda n: "k" * n + " = 1",
    "blanks": lambda n: "x" + " \t" * (n // 2) + "= 1",
    "dots": lambda n: f"# {('x.' * 31 + 'y ') * (n // 64)}",
    "dots apart": lambda n: "# " + ("x  .  " * 31 + ", ") * (n // 188),
    "words with dots": lambda n: "# " + ".".join(["x" * (n // 31)] * 31),
    "escapes": lambda n: 'x = "' + '\\"' * (n // 2) + '"',
}
READERS = {name: (lambda text: toml(text, place="file.toml"), text) for name, text in LONG.items()} | {
    "written": (lambda text: dumps({text: text}), lambda n: '"' * n),
    "condition": (condition, lambda n: "t" + " " * n + "> 1"),
}


def _work(read, text):
    """Return the least processor time [s] of five readings."""
    took = []
    for _ in range(5):
        start = time.process_time()
        with contextlib.suppress(CosimError):
            read(text)
        took.append(time.process_time() - start)
    return min(took)


@pytest.mark.parametrize("name", READERS)
def test_a_text_four_times_as_long_takes_about_four_times_as_long(name):
    read, text = READERS[name]
    assert _work(read, text(80_000)) < 8.0 * _work(read, text(20_000)) + 1e-3


@pytest.mark.parametrize("key", ["a.", "'a' . ", '"a"\t.', "a-b ."])
@pytest.mark.parametrize("before", ["", "x = 1\n", "x.y = 1\nword "])
def test_a_key_of_32_dots_is_refused_wherever_it_stands(key, before):
    with pytest.raises(CosimError, match="too many dots"):
        toml(f"{before}{key * 32}a = 1", place="file.toml")
    with pytest.raises(CosimError) as caught:
        toml(f"{before}{key * 31}a = 1", place="file.toml")
    assert "too many dots" not in str(caught.value)


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
    with pytest.raises(CosimError, match="unpaired surrogate"):
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
