"""A drafted map: columns are found by their names, units by names and ranges, signs by what moves together."""

import json
import tomllib

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from cosim.cli import commands as cli
from cosim.replay.map import diagnose
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
