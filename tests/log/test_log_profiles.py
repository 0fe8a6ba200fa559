"""Profiles of a log what is left out, what replays."""

import pytest

import cosim
from cosim.errors import CosimError
from cosim.log import open_log
from cosim.replay import replay
from cosim.report import flight_report

SHORT = ["duration_s=3", "faults.0.start_s=1"]


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    home = tmp_path_factory.mktemp("profiles")
    for name in ("full", "replay", "signals"):
        cosim.simulate(cosim.load_scenario("liquid-ofc", [*SHORT, f"log_profile={name}"]), log=home / f"{name}.mcap")
    return home


def test_a_profile_is_smaller_and_keeps_what_it_says(flown, tmp_path):
    full, part, drawn = (open_log(flown / f"{name}.mcap") for name in ("full", "replay", "signals"))
    assert replay(part.path).exact and replay(part.path).values > 0
    assert [d["logged"] for d in replay(part.path).detectors] == [d["logged"] for d in replay(full.path).detectors]
    assert flight_report(drawn.path, tmp_path / "page.html").is_file()
    for log in (part, drawn):
        for name, topic in log.topics.items():
            frame = log.frame(name)
            rows = full.frame(name, fields=list(topic.fields)).loc[frame.index]
            assert frame.equals(rows), name
    per_s = {log: sum(c.data_size for c in log.chunks) / 3e6 for log in (full, part, drawn)}
    assert per_s[part] < 0.5 and per_s[drawn] < 0.75 < per_s[full]
    with pytest.raises(CosimError, match="log_profile"):
        replay(drawn.path)
    with pytest.raises(CosimError, match="no truth"):
        flight_report(part.path, tmp_path / "none.html")


def test_the_profile_is_no_part_of_which_flight_it_is():
    plain, full = cosim.load_scenario("cruise"), cosim.load_scenario("cruise", ["log_profile=full"])
    assert plain == full and "log_profile" not in full.expanded_toml()
    thin = cosim.load_scenario("cruise", ["log_profile=replay"])
    assert 'log_profile = "replay"' in thin.expanded_toml()
    with pytest.raises(CosimError, match="full, replay, signals"):
        cosim.load_scenario("cruise", ["log_profile=small"])
