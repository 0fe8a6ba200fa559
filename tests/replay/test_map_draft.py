"""A drafted map: columns are found by their names, units by names and ranges, signs by what moves together."""

import json
import tomllib

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from cosim.cli import commands as cli
from cosim.replay.map import diagnose, prepare
from cosim.replay.map_draft import draft
from cosim.replay.map_file import load_map

T = np.arange(1000) / 200.0
ROD = 5.0 * np.sin(6.0 * T)


def bench(tmp_path, **columns):
    path = tmp_path / "bench.csv"
    pd.DataFrame({"Clock (ms)": 1e3 * T, **columns}).to_csv(path, index=False)
    return path


@pytest.mark.parametrize(
    ("column", "scale", "name", "unit"),
    [
        ("AOA_DEG", 1.0, "alpha", "deg"),
        ("Angle of Attack", 1.0, "alpha", "deg"),  # 5 rad is no angle of attack
        ("aoa", 0.02, "alpha", None),
        ("RI motor current mA", 1.0, "right_inner.current", "mA"),
        ("LOB dP [bar]", 1.0, "left_outer.pressure", "bar"),
        ("right-outer Rod (mm)", 1.0, "right_outer.rod", "mm"),
        ("NzG", 1.0, "n_z", None),
        ("pitch rate dps", 1.0, "q", "deg/s"),
        ("RAM_IN", 0.1, "left_inner.rod", "in"),
    ],
)
def test_a_column_is_known_by_its_name_and_its_numbers(tmp_path, column, scale, name, unit):
    found = tomllib.loads(draft(bench(tmp_path, **{column: scale * ROD})))
    assert found["time"] == "Clock (ms)"
    assert found["signals"][name]["channel"] == column and found["signals"][name].get("unit") == unit


def test_what_moves_against_the_rod_gets_its_sign(tmp_path):
    path = bench(tmp_path, ROD_MM=ROD, SURF_DEG=-1.2 * ROD, ELEV_CMD_DEG=-1.1 * ROD + 0.1 * np.cos(T))
    found = tomllib.loads(draft(path))["signals"]
    assert found["left_inner.surface"]["sign"] == found["de_cmd"]["sign"] == -1
    assert "sign" not in found["left_inner.rod"]
    path = bench(tmp_path, ROD_MM=ROD, SURF_DEG=1.2 * ROD)
    assert "sign" not in tomllib.loads(draft(path))["signals"]["left_inner.surface"]


def test_a_draft_flies_as_it_stands_and_names_what_it_left(tmp_path):
    moved = {"VALVE_PCT": 10 * np.cos(6 * T), "DP_BAR": 20 * np.sin(6 * T)}
    path = bench(tmp_path, ROD_MM=ROD, SURF_DEG=1.2 * ROD, HUM=T, **moved)
    made = CliRunner().invoke(cli.app, ["map", str(path), "-o", str(tmp_path / "map.toml"), "--json"])
    assert made.exit_code == 0 and "# not used: HUM" in json.loads(made.stdout)["toml"]
    assert load_map(tmp_path / "map.toml")[0].signals["left_inner.hinge_moment"].constant == 0.0
    told = diagnose(path, tmp_path / "map.toml")
    assert {"iotsekf", "rtsekf_flight"} <= {d["id"] for d in told.detectors}
    assert told.duration_s == pytest.approx(5.0)  # of a clock in milliseconds
    again = CliRunner().invoke(cli.app, ["map", str(path), "-o", str(tmp_path / "map.toml")])
    assert again.exit_code == 2 and "is there already" in again.stderr
    nothing = CliRunner().invoke(cli.app, ["map", str(bench(tmp_path, a=["x"] * 1000))])
    assert nothing.exit_code == 0 and "[signals]" in nothing.stdout


def test_a_column_of_no_number_or_a_strange_name_does_no_harm(tmp_path):
    path = bench(tmp_path, **{'q"\n[signals]': ROD, "rod": np.full(1000, np.nan), "": T})
    found = tomllib.loads(draft(path))
    assert found["signals"]["left_inner.rod"] == {"channel": "rod"}


def flown(tmp_path, lies=False, angle=1.0):
    """Write 60 s of made-up flight: Mach, speeds and altitude of one another, gravity, rates of their angles."""
    t = np.arange(0.0, 60.0, 0.04)
    theta, phi = 0.05 + 0.06 * np.sin(0.5 * t), 0.2 * np.sin(0.3 * t)
    h, tas = 5000.0 + 20.0 * np.sin(0.2 * t) * t, 150.0 + 8.0 * np.cos(0.25 * t)
    kelvin = 288.15 - 0.0065 * h
    mach = tas / (20.0468 * np.sqrt(kelvin))
    impact = (kelvin / 288.15) ** 5.25588 * ((1.0 + 0.2 * mach**2) ** 3.5 - 1.0)
    cas = 340.294 * np.sqrt(5.0 * ((1.0 + impact) ** (2 / 7) - 1.0))
    made = {
        "THE": angle * theta, "PHI": angle * phi, "QRGY": angle * np.gradient(theta, t),
        "PRGX": angle * np.gradient(phi, t), "AXCG": 9.80665 * np.sin(theta) + np.gradient(tas, t),
        "AZCG": -9.80665 * np.cos(theta),
        "MACH": mach, "VTAS": tas, "VCAS": cas / (1852 / 3600), "HQNH": h / 0.3048,
        "altRate": np.gradient(h, t) / 0.3048 * 60.0, "ALCG": angle * (theta + 0.01),
        "DELV": angle * 0.02 * np.sin(2.0 * t), "DLC_R": 3.0 * np.sin(t), "FUELUS": 500.0 + t,
    }  # fmt: skip
    path = tmp_path / "flight.csv"
    per = {**dict.fromkeys(("THE", "PHI", "ALCG", "DELV"), "[DEG]"), **dict.fromkeys(("QRGY", "PRGX"), "[DEG/S]")}
    named = {f"{n} {per[n]}" if lies and n in per else n: y for n, y in made.items()}
    pd.DataFrame({"T": t, **named}).to_csv(path, index=False)
    return path


def test_units_and_signs_are_proved_by_what_the_columns_say_of_one_another(tmp_path):
    text = draft(flown(tmp_path, angle=180.0 / np.pi), aircraft="narrowbody")
    found = tomllib.loads(text)["signals"]
    units = {name: s.get("unit") for name, s in found.items()}
    assert units["tas"] is None and units["cas"] == "kt" and units["h_baro"] == "ft" and units["hdot"] == "ft/min"
    assert units["n_z"] == units["n_x"] == "m/s2" and found["n_z"]["sign"] == -1
    assert units["theta"] == units["phi"] == units["alpha"] == units["de_cmd"] == "deg"
    assert units["q"] == units["p"] == "deg/s"
    assert "r" not in found and "# not used: DLC_R" in text  # a flap
    assert "proxy" in found["de_cmd"]
    proved = {line.split()[0] for line in text.splitlines() if "# proved" in line}
    assert {"tas", "cas", "h_baro", "hdot", "n_z", "q", "p", "theta"} <= proved


def test_a_name_that_lies_of_its_unit_is_corrected(tmp_path):
    text = draft(flown(tmp_path, lies=True), aircraft="narrowbody")
    found = tomllib.loads(text)["signals"]
    assert "unit" not in found["theta"] and "unit" not in found["q"] and "though its name says deg" in text
    assert "unit" not in found["phi"] and "unit" not in found["p"] and "unit" not in found["de_cmd"]


def test_a_draft_for_another_aircraft_runs_unchanged(tmp_path):
    path = flown(tmp_path, angle=180.0 / np.pi)
    made = CliRunner().invoke(cli.app, ["map", str(path), "--aircraft", "narrowbody", "-o", str(tmp_path / "map.toml")])
    assert made.exit_code == 0, made.stderr
    told = diagnose(path, tmp_path / "map.toml")
    assert [d["id"] for d in told.detectors] == ["rfafe_airframe"] and told.detectors[0]["valid_pct"] > 50.0


def test_an_unknown_time_column_can_be_named(tmp_path):
    path = tmp_path / "bench.csv"
    pd.DataFrame({"k": T, "AOA_DEG": ROD}).to_csv(path, index=False)
    made = CliRunner().invoke(cli.app, ["map", str(path), "--time", "k"])
    assert made.exit_code == 0 and tomllib.loads(made.stdout)["time"] == "k"
    refused = CliRunner().invoke(cli.app, ["map", str(path)])
    assert refused.exit_code != 0


def air_data(seconds=30.0, noise=0.0):
    """Return a climb at 250 knots as a flight test calls its columns, with noise of a sensor's size."""
    t, rng = np.arange(0.0, seconds, 0.01), np.random.default_rng(3)
    h = 5500.0 + 3.0 * t
    kelvin, cas = 288.15 - 0.0065 * h, 130.0 + 3.0 * np.sin(0.2 * t)
    impact = (1.0 + 0.2 * (cas / 340.294) ** 2) ** 3.5 - 1.0
    mach = np.sqrt(5.0 * ((1.0 + impact / (kelvin / 288.15) ** 5.25588) ** (2.0 / 7.0) - 1.0))
    pitch, roll = 3.0 + np.sin(0.9 * t), 2.0 * np.sin(0.6 * t)
    flown = {
        "UTC_SEC": t, "PITCH_ATT_DEG": pitch, "ROLL_REF_UNIT_DEG": roll, "Q_DPS": 0.9 * np.cos(0.9 * t),
        "P_DPS": 1.2 * np.cos(0.6 * t), "R_DPS": 12.0 + 4.0 * np.cos(0.8 * t),
        "HDG_DEG": (350.0 + 12.0 * t + 5.0 * np.sin(0.8 * t)) % 360.0,
        "KCAS": cas * 3600 / 1852, "KTAS": mach * 20.0468 * np.sqrt(kelvin) * 3600 / 1852, "MACH": mach,
        "HP_FT": h / 0.3048, "ROD_LI_MM": 5.0 * np.sin(t), "ELEV_LI_TEU_DEG": -np.sin(t),
        "ELEV_RI_TED_DEG": np.sin(t), "ELEV_CMD_TEU_DEG": -np.sin(t + 0.1),
    }  # fmt: skip
    spread = {"PITCH_ATT_DEG": 0.01, "ROLL_REF_UNIT_DEG": 0.01, "Q_DPS": 0.05, "P_DPS": 0.05, "R_DPS": 0.05}
    return {n: y + noise * rng.normal(0.0, spread.get(n, 0.0), len(t)) for n, y in flown.items()}


def drafted(tmp_path, columns, **how):
    pd.DataFrame(columns).to_csv(tmp_path / "flight.csv", index=False)
    text = draft(tmp_path / "flight.csv", **how)
    (tmp_path / "map.toml").write_text(text)
    return text, tomllib.loads(text)["signals"]


def test_the_names_of_a_flight_test_are_known(tmp_path):
    text, found = drafted(tmp_path, air_data(noise=1.0))
    units = {name: (s["channel"], s.get("unit"), s.get("sign", 1)) for name, s in found.items() if "channel" in s}
    assert units["cas"][:2] == ("KCAS", "kt") and units["tas"][:2] == ("KTAS", "kt")
    assert units["h_baro"][:2] == ("HP_FT", "ft")
    assert units["left_inner.surface"] == ("ELEV_LI_TEU_DEG", "deg", -1)
    assert units["right_inner.surface"] == ("ELEV_RI_TED_DEG", "deg", 1)
    assert units["de_cmd"] == ("ELEV_CMD_TEU_DEG", "deg", -1)
    assert "# not used" not in text


def test_an_angle_is_proved_by_its_rate_beside_the_noise_of_sensors(tmp_path):
    text, found = drafted(tmp_path, air_data(noise=1.0))
    assert found["theta"]["channel"] == "PITCH_ATT_DEG" and found["phi"]["channel"] == "ROLL_REF_UNIT_DEG"
    proved = {line.split()[0] for line in text.splitlines() if "# proved" in line}
    assert {"p", "q", "r", "phi"} <= proved  # the heading passes north


@pytest.mark.parametrize("without", [(), ("HP_FT",), ("HP_FT", "KTAS"), ("KCAS",)])
def test_a_unit_that_mach_refutes_is_not_flown(tmp_path, without):
    columns = {n: y for n, y in air_data().items() if n not in without}
    found = drafted(tmp_path, {n.replace("KCAS", "CAS").replace("KTAS", "TAS"): y for n, y in columns.items()})[1]
    assert {found[n].get("unit") for n in ("cas", "tas") if n in found} <= {"kt"}
    assert ("tas" in found) == ("KTAS" not in without)
    assert ("cas" in found) == ("KCAS" not in without and without != ("HP_FT", "KTAS"))  # no altitude: a guess


def test_a_speed_is_in_knots_by_its_name_where_nothing_proves_it(tmp_path):
    columns = {n: y for n, y in air_data().items() if n not in ("MACH", "HP_FT")}
    found = drafted(tmp_path, columns)[1]
    assert found["cas"]["unit"] == found["tas"]["unit"] == "kt"


def test_lost_samples_wild_ones_and_slow_channels_do_not_hide_a_column(tmp_path):
    columns = air_data()
    t, altitude = columns["UTC_SEC"], columns["HP_FT"]
    angle = 3.0 + np.sin(t)
    columns |= {"AOA_DEG": np.where((t > 5.0) & (t < 7.0), -9999.0, angle), "BETA_DEG": np.sin(t)}
    columns["BETA_DEG"][500] = 1e9
    columns["HP_FT"] = np.where(np.arange(len(t)) % 100, np.nan, altitude)
    found = drafted(tmp_path, columns)[1]
    assert found["alpha"] == {"channel": "AOA_DEG", "unit": "deg", "missing": -9999}
    assert found["beta"] == {"channel": "BETA_DEG", "unit": "deg"}
    assert found["h_baro"] == {"channel": "HP_FT", "unit": "ft", "sparse": True}
    values = prepare(tmp_path / "flight.csv", tmp_path / "map.toml").values
    alpha, valid = values["alpha"]
    assert np.nanmin(alpha) > 0.03 and 0.92 < valid.mean() < 0.94
    assert values["h_baro"][1].mean() > 0.99


def test_the_names_of_an_autopilots_log_are_known(tmp_path):
    t = np.arange(0.0, 30.0, 0.02)
    pitch, roll = np.radians(3.0 + np.sin(0.9 * t)), np.radians(2.0 * np.sin(0.6 * t))
    columns = {
        "ATT_Roll": np.degrees(roll), "ATT_Pitch": np.degrees(pitch), "IMU_GyrX": np.gradient(roll, t),
        "IMU_GyrY": np.gradient(pitch, t), "IMU_AccZ": -9.80665 * np.cos(pitch) * np.cos(roll),
    }  # fmt: skip
    text, found = drafted(tmp_path, {"TimeUS": np.round(1e6 * t).astype(np.int64), **columns})
    assert "the recording's 50 Hz" in text
    assert found["n_z"] == {"channel": "IMU_AccZ", "unit": "m/s2", "sign": -1}
    assert (found["p"]["channel"], found["q"]["channel"]) == ("IMU_GyrX", "IMU_GyrY")
