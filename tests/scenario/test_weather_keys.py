"""Keys of the air in [flight]: read, refused with the place, set one by one and by campaigns, expanded, in words."""

import tomllib

import pytest

from cosim.campaign.spec import load_campaign
from cosim.scenario import load_scenario, parse

GUST = ("flight.gusts.0.start_s=3", "flight.gusts.0.speed_fps=-40")


def test_weather_of_every_kind_is_read_set_and_a_fixed_point(tmp_path):
    keys = [*GUST, "flight.gusts.1={start_s=9, axis='lateral', speed_fps=20.5, gradient_ft=100, shape='ramp'}",
            "flight.wind_kt=35", "flight.wind_from_deg=250", "flight.shear_kt_1000ft=-3",
            "flight.gusts.0.axis=longitudinal", "flight.air.0.start_s=10", "flight.air.0.turbulence=severe",
            "flight.air.1.start_s=20", "flight.air.1.turbulence=none", "flight.air.1.ramp_s=0",
            "manoeuvre.hold_speed=true"]  # fmt: skip
    s = load_scenario("cruise", keys)
    assert [g.model_dump() for g in s.flight.gusts] == [
        {"start_s": 3.0, "axis": "longitudinal", "speed_fps": -40.0, "gradient_ft": 350.0, "shape": "1-cosine"},
        {"start_s": 9.0, "axis": "lateral", "speed_fps": 20.5, "gradient_ft": 100.0, "shape": "ramp"},
    ]
    assert s.flight.changes == ((10.0, "severe", 5.0), (20.0, "none", 0.0))
    assert s.manoeuvre.kind == "cruise" and s.manoeuvre.hold_speed
    text = s.expanded_toml()
    again = parse(tomllib.loads(text))
    assert again == s and again.expanded_toml() == text
    path = tmp_path / "again.toml"
    path.write_text(text)
    changed = load_scenario(path, ["flight.gusts.1.speed_fps=7", "flight.air.1.turbulence=light"])
    assert changed.flight.gusts[1].speed_fps == 7.0 and changed.flight.gusts[0] == s.flight.gusts[0]
    assert changed.flight.changes[1] == (20.0, "light", 0.0)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ([], "still air"),
        (["turbulence=light"], "light turbulence"),
        (["wind_kt=30", "wind_from_deg=270"], "no turbulence, wind of 30 kt from 270 deg"),
        (["shear_kt_1000ft=4"], "no turbulence, wind of 0 kt from 0 deg, shear of +4 kt per 1,000 ft"),
        (["air.0.start_s=9", "air.0.turbulence=severe"], "still air, severe from 9 s"),
        (["turbulence=light", "gusts.0.start_s=3", "gusts.0.speed_fps=40"],
         "light turbulence, vertical gust of +40 ft/s at 3 s"),
    ],
)  # fmt: skip
def test_the_weather_in_words(keys, words):
    assert load_scenario("cruise", ["flight.turbulence=none", *(f"flight.{k}" for k in keys)]).flight.weather == words


def test_a_speed_hold_stays_through_another_kind_only_where_it_was_switched_on(tmp_path):
    kept = load_scenario("cruise", ["manoeuvre.hold_speed=true", "manoeuvre.kind=nose_up"]).manoeuvre
    assert kept.kind == "nose_up" and kept.hold_speed
    (tmp_path / "off.toml").write_text(load_scenario("cruise").expanded_toml())
    assert load_scenario(tmp_path / "off.toml", ["manoeuvre.kind=coordinated_turn"]).manoeuvre.hold_speed


def test_a_campaign_draws_the_weather(tmp_path):
    path = tmp_path / "gusty.toml"
    path.write_text(
        'title = "Gusty"\nbase = "cruise"\nruns = 4\nseed = 1\n'
        '[set]\n"flight.gusts.0.start_s" = 2.0\n"manoeuvre.hold_speed" = true\n'
        '[grid]\n"manoeuvre.kind" = ["nose_up", "yaw_angle"]\n'
        '[draw]\n"flight.wind_kt" = { low = 0.0, high = 60.0 }\n'
        '"flight.gusts.0.speed_fps" = { low = -50.0, high = 50.0 }\n'
    )
    scenarios, _ = load_campaign(path).scenarios()
    assert all(s.manoeuvre.hold_speed for s in scenarios)
    speeds = [s.flight.gusts[0].speed_fps for s in scenarios]
    assert len(set(speeds)) == len(speeds) > 1 and len({s.flight.wind_kt for s in scenarios}) == len(speeds)
