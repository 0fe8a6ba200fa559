"""Drafts of a newcomer's table: usual names without units; what the numbers refute does not fly, nor what they leave
open."""

import itertools
import tomllib

import numpy as np
import pandas as pd
import pytest
from flight_point import POINT
from typer.testing import CliRunner

from cosim.cli import commands as cli
from cosim.replay.log_schema import ReplayError
from cosim.replay.map import diagnose
from cosim.replay.map_draft import draft, guesses
from cosim.replay.map_physics import lift_unit

DEG = 180.0 / np.pi
T = np.arange(0.0, 60.0, 0.02)
ANGLES, RATES, MOVED = ("alpha", "theta"), ("q",), ("elevator command", "elevator position")


def flight(angle=1.0, rate=1.0, moved=1.0, up=1):
    """Return 60 s at 290 knots and 20 000 ft: attitude less angle of attack is the path, q the rate of the
    attitude, the pitch acceleration that of the elevator; `up` = -1: trailing edge up is +."""
    path = 0.012 * np.sin(0.3 * T)
    alpha = 0.0175 + 0.004 * np.sin(1.1 * T)
    theta = path + alpha
    q = np.gradient(theta, T)
    speed = 203.0
    elevator = -np.gradient(q, T) / 1.5
    return pd.DataFrame({
        "time": T, "alpha": angle * alpha, "theta": angle * theta, "q": rate * q, "KCAS": 290.0 + 0.5 * np.sin(0.2 * T),
        "altitude": (6096.0 + np.cumsum(speed * np.sin(path)) * 0.02) / 0.3048,
        "elevator command": up * moved * elevator, "elevator position": up * moved * np.roll(elevator, 2),
    })  # fmt: skip


def drafted(tmp_path, frame):
    frame.to_csv(tmp_path / "flight.csv", index=False)
    text = draft(tmp_path / "flight.csv")
    (tmp_path / "map.toml").write_text(text)
    return text, tomllib.loads(text)["signals"]


def line(text, name):
    return next(t for t in text.splitlines() if name in t.split("=")[0])


def test_degrees_that_could_be_radians_are_refuted(tmp_path):
    text, found = drafted(tmp_path, flight(DEG, DEG, DEG))
    assert flight(DEG, DEG)[[*ANGLES, *RATES]].abs().max().max() < 2.0
    assert found["alpha"]["unit"] == found["theta"]["unit"] == "deg" and found["q"]["unit"] == "deg/s"
    assert "attitude less angle of attack is the path's angle" in line(text, "theta")
    told = diagnose(tmp_path / "flight.csv", tmp_path / "map.toml")
    assert {"rfafe_airframe", "position_monitor"} <= {d["id"] for d in told.detectors}


WITHOUT = [(), ("KCAS",), ("altitude",), ("theta",), ("alpha",), ("alpha", "theta"), ("KCAS", "q")]


@pytest.mark.parametrize("without", WITHOUT)
def test_whatever_is_missing_nothing_flies_in_a_wrong_unit(tmp_path, without):
    for angle, rate, moved in itertools.product((1.0, DEG), repeat=3):
        text, found = drafted(tmp_path, flight(angle, rate, moved).drop(columns=list(without)))
        asked = {**dict.fromkeys(ANGLES, angle), **dict.fromkeys(RATES, rate), **dict.fromkeys(MOVED, moved)}
        for signal in found.values():
            if signal.get("channel") in asked:
                assert ("unit" in signal) == (asked[signal["channel"]] != 1.0), text


def test_what_two_units_remain_possible_for_is_a_comment_with_the_reason(tmp_path):
    frame = pd.DataFrame({"time": T, "theta": 0.2 + 0.3 * np.sin(0.5 * T), "AOA_DEG": 3 + T / 60})
    text, found = drafted(tmp_path, frame)
    assert "theta" not in found and found["alpha"]["unit"] == "deg"
    assert line(text, "theta").startswith("# theta") and "rad or deg: these numbers allow both" in line(text, "theta")


def test_the_lift_and_the_load_prove_a_unit(tmp_path):
    slow = 0.15 * np.sin(0.4 * T) + 0.05 * np.sin(1.7 * T)  # [deg] of angle of attack about 0.2
    frame = pd.DataFrame({"time": T, "alpha": 0.2 + slow, "n_z": 1.0 + 0.3 * slow})
    assert "by the lift in n_z" in line(drafted(tmp_path, frame)[0], "alpha")
    q = 0.04 * np.sin(0.4 * T)  # rad/s
    frame = pd.DataFrame({"time": T, "q": q, "n_z": 1.0 + 200.0 * q / 9.80665, "TAS_M_S": 200.0 + np.sin(T)})
    text, found = drafted(tmp_path, frame)
    assert "unit" not in found["q"] and "by the load that it makes" in line(text, "q")


@pytest.mark.parametrize("name", ["elevator position", "Elevator position (deg)", "ELEV_POS_DEG", "elevator_deg",
                                  "elevator", "delta_e", "de"])  # fmt: skip
@pytest.mark.parametrize("up", [1, -1])
def test_an_elevator_position_beside_its_command_is_a_surface_with_a_sign(tmp_path, name, up):
    frame = flight(DEG, DEG, 10 * DEG, up).rename(columns={"elevator position": name})
    text, found = drafted(tmp_path, frame)
    for own in (found["left_inner.surface"], found["de_cmd"]):
        assert own["unit"] == "deg" and own.get("sign", 1) == up
    assert found["left_inner.surface"]["channel"] == name and found["left_inner.surface"]["proxy"]
    assert f"the nose follows it {'down' if up > 0 else 'up'}" in line(text, '"left_inner.surface"')
    still = frame.drop(columns=["q", "theta"])
    assert "nothing proves that trailing edge down is +" in line(drafted(tmp_path, still)[0], '"left_inner.surface"')


@pytest.mark.parametrize("name", ["Q_DEG_S", "q_degps", "pitch_rate_dps", "pitch_rate_deg_s"])
def test_a_pitch_rate_is_known_by_its_name(name):
    best = max(guesses(name, 3.0 * np.sin(T)), key=lambda g: g.fit)
    assert (best.word, best.unit) == ("q", "deg/s") and best.flies


def test_the_true_airspeed_is_derived_and_the_numbers_of_the_point_are_plain(tmp_path):
    text, found = drafted(tmp_path, flight(DEG, DEG, DEG).assign(altitude=20000.0 + 3.0 * np.sin(T)))
    assert found["tas"] == {"speed_of": "cas"} and "a proxy" in line(text, "tas")
    assert "altitude_ft = 20000 " in text and "rate_hz = 200  # tick" in text and "the recording's 50 Hz" in text
    told = diagnose(tmp_path / "flight.csv", tmp_path / "map.toml", output=tmp_path / "out.mcap")
    assert any("tas stands on a proxy, cas and h_baro in the standard atmosphere" in c for c in told.caveats)
    from cosim.report.diagnosis_page import Watched

    tas = Watched(tmp_path / "out.mcap").inputs()["tas"][1]
    assert np.median(tas) == pytest.approx(200.0, abs=2.0)  # M 0.633 at 20 000 ft


MAP = (
    POINT
    + """[signals]
cas = {{ channel = "KCAS", unit = "kt" }}
h_baro = {{ channel = "altitude", unit = "ft" }}
de_cmd = {{ channel = "elevator command", unit = "deg" }}
q = {{ channel = "q", unit = "deg/s" }}
{more}
"""
)
ALL = 'alpha = {{ channel = "alpha"{0} }}\ntheta = {{ channel = "theta", unit = "deg" }}\ntas = {{ speed_of = "cas" }}'


def test_the_nearest_detectors_come_first_in_what_is_missing(tmp_path):
    flight(DEG, DEG, DEG).to_csv(tmp_path / "flight.csv", index=False)
    (tmp_path / "map.toml").write_text(MAP.format(more='alpha = { channel = "alpha", unit = "deg" }'))
    with pytest.raises(ReplayError) as error:
        diagnose(tmp_path / "flight.csv", tmp_path / "map.toml")
    said = str(error.value)
    first, second = said.index("position_monitor of elevator."), said.index("rfafe_airframe of aircraft: tas, theta")
    assert first < second and "surface, and with it this one runs" in said
    assert 'tas = { speed_of = "cas" } makes tas of cas and h_baro' in said


def test_a_signal_that_is_off_by_a_units_factor_is_asked_for(tmp_path):
    flight(DEG, DEG, DEG).to_csv(tmp_path / "flight.csv", index=False)
    (tmp_path / "map.toml").write_text(MAP.format(more=ALL.format("")))
    told = diagnose(tmp_path / "flight.csv", tmp_path / "map.toml", output=tmp_path / "out.mcap")
    (said,) = [c for c in told.caveats if "out of range" in c]
    assert said.startswith("rfafe_airframe: alpha 0.77") and " rad is 44." in said and "is it in degrees?" in said
    made = CliRunner().invoke(cli.app, ["report", str(tmp_path / "out.mcap"), "-o", str(tmp_path / "page.html")])
    assert made.exit_code == 0, made.stderr
    page = (tmp_path / "page.html").read_text()
    assert "is it in degrees?" in page and "fast adaptive fault estimator on airframe outputs only" in page
    assert "left_outer.hinge_moment" in page and "left_outer.hm0" not in page
    (tmp_path / "map.toml").write_text(MAP.format(more=ALL.format(', unit = "deg"')))
    assert not [c for c in diagnose(tmp_path / "flight.csv", tmp_path / "map.toml").caveats if "out of range" in c]


def test_a_slope_that_noise_alone_gives_proves_no_unit():
    rng = np.random.default_rng(3)
    alpha, noise = rng.normal(0.0, 0.02, 3000), rng.normal(0.0, 1.0, 3000)
    assert lift_unit(alpha, 20.0 * alpha + 0.01 * noise) == "rad"
    assert lift_unit(alpha, 20.0 * alpha + 3.0 * noise) == ""
