"""A draft of a map, by the names of columns alone: what a name does not say stands as a comment and does not fly."""

import json
import tomllib

import numpy as np
import pandas as pd
import pytest
from recordings import ZERO, write_json
from typer.testing import CliRunner

from cosim.cli import commands as cli
from cosim.errors import LogError
from cosim.replay.map import diagnose
from cosim.replay.map_draft import draft, guessed
from cosim.scenario.aircraft import load_aircraft

T = np.arange(1000) / 200.0
ROD = 5.0 * np.sin(6.0 * T)
FLIES = {
    "AOA_DEG": ("alpha", "deg"), "Alpha (deg)": ("alpha", "deg"), "pitch rate dps": ("q", "dps"), "NzG": ("n_z", ""),
    "Q_DEG_S": ("q", "deg/s"), "R (deg/s)": ("r", "deg/s"), "P dot (deg/s^2)": ("pdot", "deg/s^2"),
    "Mach": ("mach", ""), "AoA [deg]": ("alpha", "deg"), "PitchRate (deg/s)": ("q", "deg/s"),
    "/fdm/jsbsim/velocities/vc-kts": ("cas", "kts"), "/fdm/jsbsim/accelerations/Nz": ("n_z", ""), "cg_pct": ("cg", "%"),
    "V_{Total} (ft/s)": ("tas", "ft/s"), "/air.heading_deg": ("psi", "deg"), "theta [rad]": ("theta", ""),
}  # fmt: skip
ASKS = {
    "Angle of Attack": ("alpha", "", "unit? rad if none is said"), "p": ("p", "", "unit? rad/s"),
    "RI motor current mA": ("right_inner.current", "mA", "sign"),
    "LOB dP [bar]": ("left_outer.pressure", "bar", "sign"),
    "right-outer Rod (mm)": ("right_outer.rod", "mm", "sign?"), "ELEV_CMD_DEG": ("de_cmd", "deg", "sign?"),
    "ElevDemand [deg]": ("de_cmd", "deg", "sign?"),
    "RAM_IN": ("left_outer.rod", "in", "which segment?"), "hinge load kN": ("left_outer.hinge_moment", "kN", "segment"),
}  # fmt: skip
UNKNOWN = ("cpuload.load", "BARO pressure alt", "left engine alpha", "q kt", "Elevator Command (norm)", "x" * 300, "")


@pytest.mark.parametrize("name", [*FLIES, *ASKS, *UNKNOWN])
def test_a_column_is_what_its_name_says(name):
    guess = guessed(name, load_aircraft())
    if name in UNKNOWN:
        assert guess is None
        return
    signal, unit, *words = FLIES.get(name) or ASKS[name]
    assert (guess.signal, guess.unit) == (signal, unit)
    assert words[0] in guess.open if words else not guess.open


def test_a_draft_is_a_map_of_which_only_what_is_sure_flies(tmp_path):
    path = tmp_path / "bench.csv"
    columns = {"ELEV_CMD_DEG": ROD, "LI SURF DEG": ROD, "AOA_DEG": ROD, "HUM": T, 'q"\n[signals]': T, "note": "x"}
    pd.DataFrame({"Time (ms)": 1e3 * T, **columns}).to_csv(path, index=False)
    made = CliRunner().invoke(cli.app, ["map", str(path), "-o", str(tmp_path / "map.toml"), "--json"])
    text = (tmp_path / "map.toml").read_text()
    assert made.exit_code == 0 and json.loads(made.stdout)["toml"] == text
    assert CliRunner().invoke(cli.app, ["map", str(path)], env={"COLUMNS": "40"}).stdout == text
    found = tomllib.loads(text)
    assert found["signals"] == {"alpha": {"channel": "AOA_DEG", "unit": "deg"}} and found["time"] == "Time (ms)"
    assert '# not used: "HUM"' in text and '# not used: "note"' in text
    (tmp_path / "map.toml").write_text(text.replace("# de_cmd", "de_cmd").replace('# "left_inner', '"left_inner'))
    told = diagnose(path, tmp_path / "map.toml")
    assert [d["id"] for d in told.detectors] == ["position_monitor", "joint"] and told.duration_s == pytest.approx(5.0)
    again = CliRunner().invoke(cli.app, ["map", str(path), "-o", str(tmp_path / "map.toml")])
    assert again.exit_code == 2 and "is there already" in again.stderr


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("t", '# time = "t [s]"  # in which unit?'),
        ("clock_ms", 'time = "clock_ms"'),
        ("epoch_s", '# time = "NAME"  # which column?'),
        ("timestamp [us]", 'time = "timestamp [us]"'),
    ],
)
def test_the_clock_is_drafted_where_its_name_says_its_unit(name, line, tmp_path):
    pd.DataFrame({name: T, "AOA_DEG": ROD, "narrow": "x"}).to_parquet(tmp_path / "a.parquet")
    text = draft(tmp_path / "a.parquet", aircraft="narrowbody")
    assert (f'# not used: "{name}"' in text) == ('"NAME"' in line)
    assert line in text.splitlines()[2] and 'aircraft = "narrowbody"' in text and "mass_t = " in text


def test_topics_of_texts_are_named_and_no_harm(tmp_path):
    messages = [("/air", ZERO, {"alpha_deg": 1.0}), ("/rosout", ZERO, {"msg": "step"})]
    text = draft(write_json(tmp_path / "a.mcap", messages))
    assert tomllib.loads(text)["time"] == "log_time" and '# not used: "/rosout"' in text
    assert tomllib.loads(text)["signals"]["alpha"] == {"channel": "/air.alpha_deg", "unit": "deg"}
    with pytest.raises(LogError, match="is a folder"):
        draft(tmp_path)
