"""Tables of a pilot's own inputs: read from a CSV or written in the scenario, refused with the row that is wrong."""

import tomllib

import pytest
from flight_point import POINT

from cosim.errors import ScenarioError
from cosim.scenario import load_scenario, parse
from cosim.scenario.manoeuvre import MOST

SET = ["manoeuvre.kind=inputs"]


def of_file(folder, text, *more):
    path = folder / "stick.csv"
    path.write_text(text)
    return load_scenario("cruise", [*SET, f"manoeuvre.file={path}", *more])


def test_a_file_becomes_numbers_of_the_scenario_which_needs_it_no_more(tmp_path):
    own = tmp_path / "mine.toml"
    own.write_text(POINT + '[manoeuvre]\nkind = "inputs"\nfile = "hand.csv"\nbetween = "hold"\n')
    (tmp_path / "hand.csv").write_text("stick , time_s\n0,0\n0.25,1.5\n\n-0.5,2\n")
    s = load_scenario(own)  # from any folder: beside the scenario
    assert s.manoeuvre.time_s == (0.0, 1.5, 2.0) and s.manoeuvre.columns == {"stick": (0.0, 0.25, -0.5)}
    (tmp_path / "hand.csv").unlink()
    (tmp_path / "again.toml").write_text(s.expanded_toml())
    assert load_scenario(tmp_path / "again.toml") == s
    with pytest.raises(ScenarioError, match=r"hand\.csv: no such file"):
        load_scenario(own)


def test_semicolons_with_decimal_commas_and_numbers_in_the_scenario_say_the_same(tmp_path):
    read = of_file(tmp_path, "time_s;throttle_change;bank_deg\n0,5;0;1e1\n2;0,125;-5\n")
    written = ["manoeuvre.time_s=[0.5, 2]", "manoeuvre.throttle_change=[0, 0.125]", "manoeuvre.bank_deg=[10, -5]"]
    assert load_scenario("cruise", [*SET, *written]) == read


@pytest.mark.parametrize(("text", "said"), [
    ("time_s,stick\n0,0\n1,nan\n", r"row 3, stick = nan: is out of range; allowed: -1 to 1"),
    ("time_s,stick\n0,0\ninf,0\n", "row 3, time_s = inf: is out of range"),
    ("time_s,stick\n0,0\n\n2,0\n1,0\n", r"row 5, time_s = 1\.0: does not come after 2"),
    ("time_s,stick\n0,0\n0,0\n", r"row 3, time_s = 0\.0: does not come after 0"),
    ("time_s,stick\n-1,0\n", r"row 2, time_s = -1\.0: is out of range"),
    ("time_s,throttle\n0,0.5\n1,1.01\n", r"row 3, throttle = 1\.01: is out of range; allowed: 0 to 1"),
    ("time_s,stick\n0,0\n1,full\n", "row 3, stick = full: must be a valid number"),
    ("time_s,stick\n0,0\n1\n", r"row 3: 1 values; allowed: 2, as in row 1"),
    ("time_s,pedal\n0,0\n", r"column 'pedal': is no input, or stands twice; allowed: time_s, stick, nz_g"),
    ("time_s,stikc\n0,0\n", "Did you mean 'stick'"),
    ("time_s,stick,stick\n0,0,0\n", "stands twice"),
    ("time_s\n0\n", "no input beside it"),
    ("stick\n0\n", "no column time_s"),
    ("time_s,stick\n", "there are no rows"),
    ("", "no column time_s"),
    ("time_s,stick,nz_g\n0,0,0\n", "stick and nz_g exclude each other"),
    ("time_s,stabiliser_deg\n0,-30\n", "is out of range"),
    ("time_s,stick\n" + "".join(f"{k},0\n" for k in range(MOST // 2 + 1)), "numbers"),
])  # fmt: skip
def test_a_file_that_is_wrong_is_refused_with_its_row(text, said, tmp_path):
    with pytest.raises(ScenarioError, match=said):
        of_file(tmp_path, text)


def test_a_file_takes_the_place_of_numbers_given_before(tmp_path):
    before = ["manoeuvre.time_s=[0]", "manoeuvre.stick=[1]"]
    path = tmp_path / "stick.csv"
    path.write_text("time_s,bank_deg\n0,5\n")
    assert load_scenario("cruise", [*SET, *before, f"manoeuvre.file={path}"]).manoeuvre.columns == {"bank_deg": (5.0,)}
    with pytest.raises(ScenarioError, match="time_s is given beside the file"):
        load_scenario("cruise", [*SET, f"manoeuvre.file={path}", *before])


def test_a_table_that_was_not_found_beside_a_scenario_is_not_read(tmp_path):
    (tmp_path / "stick.csv").write_text("time_s,stick\n0,0\n")
    table = tomllib.loads(POINT) | {"manoeuvre": {"kind": "inputs", "file": str(tmp_path / "stick.csv")}}
    with pytest.raises(ScenarioError, match="was not read"):
        parse(table)  # as one from a log is
