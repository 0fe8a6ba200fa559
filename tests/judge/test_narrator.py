"""What a run says: who noticed what, and of each fault where it entered and how far the elevator moved."""

import pytest
from typer.testing import CliRunner

import cosim
from cosim.cli import commands as cli
from cosim.judge.narrator import faults, sentences, silent

MOVED = {"amplitude_mm": 12.3, "amplitude_deg": 3.4, "rod_mm": 123.4, "surface_deg": 23.4}


def lane(name, level, delay=None, right=None, fault=0):
    told = {"fault": fault, "detection_delay_s": delay, "time_to_right_s": right, "able": True, "why_not_valid": None}
    return {"id": name, "level": level, "concerned": True, "alarm": delay is not None, "by_fault": [told],
            "r_max_before": 0.5, "r_max_after": 0.8, **told}  # fmt: skip


def found(*lanes, achieved=None):
    return {"detectors": list(lanes), "sim_time_s": 30.0, "achieved": achieved}


LIQUID = cosim.load_scenario("liquid-ofc")


def test_it_tells_what_broke_the_first_alarm_its_level_the_right_name_and_the_other_level():
    filters = [lane("iotsekf", "local", 0.12, 1.2)]
    lanes = [*filters, lane("rfafe", "aircraft", 2.1), lane("rfafe_airframe", "aircraft", 2.2, 2.2)]
    swing = {"left_inner": MOVED}
    assert sentences(found(*lanes, achieved=swing), LIQUID) == [
        "ofc_liquid on elevator.left_inner from 12 s, 12.3 mm, 3.4 deg: first alarm after 0.12 s by iotsekf "
        "(actuator level), right name after 1.20 s; aircraft level after 2.10 s by rfafe."
    ]
    aside = sentences(found(lane("rfafe", "aircraft", 0.1), *filters), LIQUID)[0]
    assert "by rfafe (aircraft level), right name after 1.20 s by iotsekf; actuator level after 0.12 s" in aside
    joined = sentences(found(lane("joint", "both", 0.12, 1.2), *filters), LIQUID)[0]  # it alarms by the filter's alarm
    assert "first alarm after 0.12 s by iotsekf (actuator level), right name after 1.20 s." in joined


def test_what_did_not_happen_is_said_and_a_level_that_did_not_fly_is_not():
    assert sentences(found(lane("iotsekf", "local")), LIQUID)[0].endswith("amplitude_mm 8, frequency_hz 1: no alarm.")
    alone = sentences(found(lane("iotsekf", "local", 0.12)), LIQUID)[0]
    assert alone.endswith("by iotsekf (actuator level), no right name.")
    both = found(lane("iotsekf", "local", 0.12), lane("lpv_smo", "aircraft"))
    assert sentences(both, LIQUID)[0].endswith("; aircraft level no alarm.")
    assert silent(both, LIQUID) == [
        "designed for this fault, no alarm: lpv_smo (statistic came to 80% of its threshold)"
    ]
    both["detectors"][1]["by_fault"][0]["masked"] = True
    assert silent(both, LIQUID) == [
        "designed for this fault, no alarm: lpv_smo (masked by the standing alarm of an earlier fault)"
    ]


def test_a_level_whose_able_detectors_have_no_design_is_not_run():
    lost = {"not_run": {"rfafe": "no design for mine", "lpv_smo": "no design for mine"}}
    heard = lane("iotsekf", "local", 0.12)
    alone, beside = (found(heard, *more) | lost for more in ((), (lane("kinematic", "aircraft"),)))
    assert sentences(alone, LIQUID)[0].endswith("; aircraft level not run: no design for mine.")
    assert sentences(beside, LIQUID)[0].endswith("; rfafe and lpv_smo not run: no design for mine.")
    assert sentences(found(lane("iotsekf", "local")) | lost, LIQUID)[0].endswith("no alarm; aircraft level not run: "
                                                                                "no design for mine.")  # fmt: skip
    one_flew = found(lane("iotsekf", "local", 0.12), lane("lpv_smo", "aircraft")) | {"not_run": {"rfafe": "no design"}}
    assert sentences(one_flew, LIQUID)[0].endswith("; aircraft level no alarm.")


# -- a line per fault ------------------------------------------------------------------------------------------------

NOTHING = {"rod_mm": None, "surface_deg": None, "travel_pct": None, "amplitude_mm": None, "amplitude_deg": None}


def lines(achieved, *changes, name="liquid-ofc"):
    return [text for line in faults(cosim.load_scenario(name, changes), achieved) for text in line if text]


def moved(**values):
    return NOTHING | values


def test_a_saturated_valve_is_told_by_the_command(tmp_path):
    keys = ("duration_s=3", "faults.0.start_s=1", "faults.0.amplitude_mm=50", "faults.0.frequency_hz=10")
    words = ["--details", *(w for k in keys for w in ("-s", k))]
    told = CliRunner().invoke(cli.app, ["run", "liquid-ofc", *words, "-o", str(tmp_path / "a.mcap")]).stdout
    text = " ".join(told.split())
    assert "(amplitude_mm 50, frequency_hz 10); achieved 6." in text and "note faults.0: asked for 50 mm" in text


def test_amplitudes_for_an_oscillation_and_peaks_for_the_rest():
    one = moved(rod_mm=9.0, surface_deg=1.7, amplitude_mm=7.96, amplitude_deg=1.5)
    (line,) = lines({"left_inner": one})
    assert line.endswith("; achieved 8.0 mm, 1.5 deg")
    (line,) = lines({"left_inner": moved(rod_mm=9.0, surface_deg=1.7)}, name="solid-jam")
    assert line.endswith("; achieved at most 9.0 mm, 1.7 deg")
    assert "achieved" not in lines(None)[0] and "achieved" not in lines({"left_inner": NOTHING})[0]


@pytest.mark.parametrize(("share", "told"), [(0.79, True), (0.81, False), (1.24, False), (1.26, True)])
def test_a_note_beyond_80_and_125_per_cent(share, told):
    for key, asked, found in (
        ("amplitude_mm=10", 10.0, {"amplitude_mm": share * 10.0, "amplitude_deg": 9.0}),
        ("amplitude_deg=2", 2.0, {"amplitude_mm": 50.0, "amplitude_deg": share * 2.0}),
        ("amplitude_travel=0.05", 2.0, {"amplitude_mm": 50.0, "amplitude_deg": share * 2.0}),
    ):
        out = lines({"left_inner": moved(**found)}, "faults.0.at=command", f"faults.0.{key}")
        assert (len(out) == 2) == told
        assert not told or (f"asked for {asked:g} " in out[1] and f"achieved {100 * share:.0f} % of it" in out[1])


def test_faults_of_one_segment_have_no_share_each_in_what_they_moved_together(tmp_path):
    point = "[flight]\nmass_t = 200.0\ncg_pct = 30.0\naltitude_ft = 20000.0\ncas_kt = 290.0\n"
    swing = "[[faults]]\ntarget = 'elevator.left_inner'\nkind = 'ofc_liquid'\namplitude_mm = 8\nfrequency_hz = 1\n"
    path = tmp_path / "two.toml"
    path.write_text(f"title = 'two'\nduration_s = 30.0\n{point}{swing}start_s = 8\n{swing}start_s = 12\n")
    both = lines({"left_inner": moved(amplitude_mm=16.0, amplitude_deg=3.0)}, name=path)
    assert len(both) == 2  # without a note
    assert all(text.endswith("; achieved 16.0 mm, 3.0 deg, with the other faults") for text in both)


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
    (line,) = lines(None, *changes, name="runaway")
    assert f" at {at}, from" in line
