"""Tables in a terminal: no number and no name is cut, however narrow it is."""

import io
import re

import pytest
import structure
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from typer.testing import CliRunner

import cosim
from cosim.cli import app, commands, tables
from cosim.table import Table

COUNTS = ("designed", "detected", "named", "ambiguous", "misnamed", "not_valid", "not_excited", "fault_free_alarmed")
FIGURES = {"missed": 0, "motion_s": None, "detection_low": 0.1, "detection_high": 0.9, "why_not_valid": None}
DETECTOR = {
    **dict.fromkeys((*COUNTS, "fault_free_runs"), 1480),
    **dict.fromkeys(("delay_s", "right_s", "standing_s", "step_us", "log_fault"), 1234.5),
    **{"id": "ema_kalman_flight", "availability": 1.0, "false_alarms_per_hour": 236.0, "why_not_valid": None},
    **{"false_alarms_per_hour_high": 987.0, "false_alarms": 1480, "hours": 12.5, "alarms_anyway": 0.1},
    "families": [
        {"family": "hydraulic.ofc_liquid", "unit": "mm", "note": "", "a90": 12.34, "a90_95": 23.45, "delay_s": 12.34,
         "right_s": 23.45, **dict.fromkeys(COUNTS, 1480),
         **FIGURES},
    ],
    **FIGURES,
    "level": "local",
}  # fmt: skip
COMPARED = {"detectors": [DETECTOR], "runs": 2025, "source": "x", "failed": 0, "report": None, "table": None,
            "headline": "No fault was flown.", "pairs": [], "predictive": []}  # fmt: skip


def printed(shown, width):
    console = Console(file=io.StringIO(), width=width, force_terminal=False)
    console.print(shown)
    return console.file.getvalue()


cells = st.from_regex(r"-?[0-9]{1,7}(\.[0-9]{1,3})?", fullmatch=True)


@given(st.lists(st.lists(cells, min_size=3, max_size=3), min_size=1, max_size=16), st.integers(40, 140))
def test_every_number_of_any_table_is_whole_at_any_width(columns, width):
    made = Table("title", "name", *(f"column {chr(97 + i)}>" for i in range(len(columns))))
    for k, name in enumerate(("one", "ema_kalman_flight", "three")):
        made.add(name, *(column[k] for column in columns))
    text = printed(made, width)
    assert "…" not in text and max(map(len, text.splitlines())) <= width
    found = re.findall(r"-?\d+(?:\.\d+)?", text)
    assert sorted(found) == sorted(c for column in columns for c in column)


@pytest.mark.parametrize("width", [20, 40, 80])
def test_a_word_that_is_wider_than_the_terminal_is_folded(width):
    made = Table("", "attachment", "size>")
    made.add("designs/" + "x" * 200, "123456")
    text = printed(made, width)
    assert text.count("x") == 200 and "123456" in text and max(map(len, text.splitlines())) <= width


@pytest.mark.parametrize("width", [80, 100])
def test_compare_shows_every_column_whole(width):
    text = printed(tables.compared(COMPARED), width)
    assert "…" not in text and "987" in text and "ema_kalman_flight" in text


@pytest.mark.parametrize("width", [80, 100])
def test_a_run_shows_names_and_delays_whole_in_25_lines_and_with_details_says_which_columns_are_left_out(width):
    scenario = cosim.load_scenario("liquid-ofc")
    found = cosim.simulate(scenario).to_dict()
    text = printed(tables.run(found | {"log": "logs/liquid-ofc.mcap"}, scenario), width)
    assert "…" not in text and re.search(r"iotsekf +left inner +\d\.\d\d +\d\.\d\d", text)
    assert len(text.splitlines()) <= 25 and "left out" not in text
    assert f"left out of {width} columns" in printed(tables.run(found, scenario, details=True), width)


@pytest.mark.parametrize("topic", ["all", ""])
def test_lists_are_whole_at_80_columns(topic, monkeypatch):
    monkeypatch.setattr(app.out, "_width", 80)
    told = CliRunner().invoke(commands.app, ["list", *topic.split()]).output
    assert "…" not in told and len(told) > 500


def test_one_class_makes_every_table_of_terminal_page_and_readme():
    other = re.compile(r'rich\.table|<t[dr][ >]|"\|-|to_html\(')
    found = {p.name for p in structure.sources("cosim") if other.search(p.read_text("utf-8"))}
    assert found == {"table.py"}
