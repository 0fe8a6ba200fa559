"""What `cosim run` says of a fault: where it entered, and how far the elevator moved for what was asked."""

import pytest
from typer.testing import CliRunner

import cosim
from cosim.cli import commands as cli
from cosim.errors import ScenarioError
from cosim.judge.narrator import faults
from cosim.scenario.aircraft import load_aircraft

NOTHING = {"rod_mm": None, "surface_deg": None, "travel_pct": None, "amplitude_mm": None, "amplitude_deg": None}


def said(achieved, *changes, name="liquid-ofc"):
    return [text for line in faults(cosim.load_scenario(name, changes), achieved) for text in line if text]


def moved(**values):
    return NOTHING | values


def test_a_saturated_valve_is_told_by_the_command(tmp_path):
    keys = ("duration_s=3", "faults.0.start_s=1", "faults.0.amplitude_mm=50", "faults.0.frequency_hz=10")
    words = [w for k in keys for w in ("-s", k)]
    words = ["--details", *(w for k in keys for w in ("-s", k))]
        CliRunner().invoke(cli.app, ["run", "liquid-ofc", *words, "-o", str(tmp_path / "a.mcap")]).stdout
    )
    text = " ".join(told.split())
    assert "(amplitude_mm 50, frequency_hz 10); achieved 6." in text and "note faults.0: asked for 50 mm" in text


def test_amplitudes_for_an_oscillation_and_peaks_for_the_rest():
    one = moved(rod_mm=9.0, surface_deg=1.7, amplitude_mm=7.96, amplitude_deg=1.5)
    (line,) = said({"left_inner": one})
    assert line.endswith("; achieved 8.0 mm, 1.5 deg")
    (line,) = said({"left_inner": moved(rod_mm=9.0, surface_deg=1.7)}, name="solid-jam")
    assert line.endswith("; achieved at most 9.0 mm, 1.7 deg")
    assert "achieved" not in said(None)[0] and "achieved" not in said({"left_inner": NOTHING})[0]


@pytest.mark.parametrize(("share", "told"), [(0.79, True), (0.81, False), (1.24, False), (1.26, True)])
def test_a_note_beyond_80_and_125_per_cent(share, told):
    for key, asked, found in (
        ("amplitude_mm=10", 10.0, {"amplitude_mm": share * 10.0, "amplitude_deg": 9.0}),
        ("amplitude_deg=2", 2.0, {"amplitude_mm": 50.0, "amplitude_deg": share * 2.0}),
        ("amplitude_travel=0.05", 2.0, {"amplitude_mm": 50.0, "amplitude_deg": share * 2.0}),
    ):
        out = said({"left_inner": moved(**found)}, "faults.0.at=command", f"faults.0.{key}")
        assert (len(out) == 2) == told
        assert not told or (f"asked for {asked:g} " in out[1] and f"achieved {100 * share:.0f} % of it" in out[1])


def test_faults_of_one_segment_have_no_share_each_in_what_they_moved_together(tmp_path):
    point = "[flight]\nmass_t = 200.0\ncg_pct = 30.0\naltitude_ft = 20000.0\ncas_kt = 290.0\n"
    swing = "[[faults]]\ntarget = 'elevator.left_inner'\nkind = 'ofc_liquid'\namplitude_mm = 8\nfrequency_hz = 1\n"
    path = tmp_path / "two.toml"
    path.write_text(f"title = 'two'\nduration_s = 30.0\n{point}{swing}start_s = 8\n{swing}start_s = 12\n")
    lines = said({"left_inner": moved(amplitude_mm=16.0, amplitude_deg=3.0)}, name=path)
    assert len(lines) == 2  # without a note
    assert all(text.endswith("; achieved 16.0 mm, 3.0 deg, with the other faults") for text in lines)


def test_several_segments_are_a_span():
    both = {n: moved(amplitude_mm=a, amplitude_deg=1.0) for n, a in (("left_inner", 8.0), ("left_outer", 7.0))}
    (line,) = said(both, "faults.0.target=elevator.left")
    assert line.endswith("; achieved 7.0 to 8.0 mm, 1.0 deg")


@pytest.mark.parametrize(
    ("changes", "at"),
    [
        ((), "valve"),
        (("faults.0.limit_deg=4",), "command"),
        (("faults.0.at=command",), "command"),
        (("faults.0.target=elevator.right_inner",), "command"),
        (("faults.0.target=elevator.all",), "valve or command"),
    ],
)
def test_a_runaway_enters_where_it_is_said_to(changes, at):
    (line,) = said(None, *changes, name="runaway")
    assert f" at {at}, from" in line


TRAVELS = load_aircraft().travels_deg


@pytest.mark.parametrize("part", TRAVELS)
def test_the_limit_of_a_runaway_lies_within_the_travel(part):
    low, high = TRAVELS[part]
    target = {"elevator": "elevator.left_inner", "aileron": "aileron.left"}.get(part, part)
    keys = [f"faults.0.target={target}", "faults.0.rate_deg_s=0.3", *(["faults.0.at=command"] * (part == "elevator"))]
    for limit in (low, high):
        cosim.load_scenario("rudder-runaway", [*keys, f"faults.0.limit_deg={limit}"])
        with pytest.raises(ScenarioError, match=f"limit_deg = .*allowed: {low:g} to {high:g}"):
            cosim.load_scenario("rudder-runaway", [*keys, f"faults.0.limit_deg={limit * 1.01}"])
