"""The first sentence of a run: what broke, the first alarm at each level, the right name, in three lines at most."""

from importlib.resources import files

import pytest
from rich.console import Console
from rich.text import Text

import cosim
from cosim.judge.narrator import sentences, silent

MOVED = {"amplitude_mm": 12.3, "amplitude_deg": 3.4, "rod_mm": 123.4, "surface_deg": 23.4}
ALL = {f"{side}_{where}": MOVED for side in ("left", "right") for where in ("inner", "outer")}


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
    quiet = found(lane("iotsekf", "local", 0.12), lane("kinematic", "aircraft")) | lost
    assert sentences(quiet, LIQUID)[0].endswith("; aircraft level not run: no design for mine.")
    assert sentences(found(lane("iotsekf", "local")) | lost, LIQUID)[0].endswith("no alarm; aircraft level not run: "
                                                                                "no design for mine.")  # fmt: skip
    one_flew = found(lane("iotsekf", "local", 0.12), lane("lpv_smo", "aircraft")) | {"not_run": {"rfafe": "no design"}}
    assert sentences(one_flew, LIQUID)[0].endswith("; aircraft level no alarm.")


@pytest.mark.parametrize(
    "name", sorted(p.name[:-5] for p in files("cosim").joinpath("scenarios").iterdir() if p.name.endswith(".toml"))
)
def test_it_takes_at_most_three_lines_at_80_columns_with_the_longest_names(name):
    scenario = cosim.load_scenario(name)
    longest = (
        ("ema_kalman_flight", "local", None),
        ("ofc_monitor", "local", 12.35),
        ("control_redundancy", "aircraft", 13),
    )
    lanes = [lane(who, at, 12.34, right, fault=i) for i in range(len(scenario.faults)) for who, at, right in longest]
    for text in sentences(found(*lanes, achieved=ALL), scenario):
        assert len(Text(text).wrap(Console(width=80), 80)) <= 3, text
