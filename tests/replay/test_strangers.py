"""Recordings of strangers: vectors by their elements, columns without a number, texts of Windows, stamps of ROS."""

import json
import tomllib
import warnings

import numpy as np
import pandas as pd
import pytest
from mcap.writer import Writer
from typer.testing import CliRunner

from cosim.cli import commands as cli
from cosim.errors import LogError
from cosim.replay.foreign import read_channels
from cosim.replay.map import prepare
from cosim.replay.map_draft import draft

T = np.arange(0.0, 5.0, 0.005)
Q = 0.5 * np.sin(2.0 * T)
FLIGHT = "[flight]\nmass_t = 200.0\ncg_pct = 30.0\naltitude_ft = 20000.0\ncas_kt = 290.0\n"
LONG = "a" * 300


def written(path, **columns):
    pd.DataFrame({"t_s": T, **columns}).to_csv(path, index=False)
    return path


def px4(path):
    return written(path, **{"gyro_rad[0]": 0.4 * Q, "gyro_rad[1]": Q, "accelerometer_m_s2[2]": -9.81 + Q, "q[0]": Q})


def test_the_elements_of_a_vector_are_the_axes_of_the_body(tmp_path):
    found = tomllib.loads(draft(px4(tmp_path / "px4.csv")))["signals"]
    assert {name: s["channel"] for name, s in found.items()} == {
        "p": "gyro_rad[0]", "q": "gyro_rad[1]", "n_z": "accelerometer_m_s2[2]"
    }  # fmt: skip
    assert "unit" not in found["q"] and found["n_z"]["unit"] == "m/s2" and found["n_z"]["sign"] == -1


def test_a_map_names_the_element_of_a_vector(tmp_path):
    (tmp_path / "m.toml").write_text(FLIGHT + '[signals]\nq = { channel = "gyro_rad[1]" }\n')
    made = prepare(px4(tmp_path / "px4.csv"), tmp_path / "m.toml")
    assert np.array_equal(made.values["q"][0], Q)


@pytest.mark.parametrize(
    "y",
    [np.full(len(T), np.nan), np.full(len(T), np.inf), 1e300 * Q, np.zeros(len(T)),
     np.where(np.arange(len(T)) % 50, np.nan, 3.0 * Q)],
    ids=["nothing", "endless", "huge", "zero", "sparse"],
)  # fmt: skip
def test_columns_of_odd_numbers_are_drafted_without_a_warning(tmp_path, y):
    names = "alpha beta theta q p r n_x n_z tas cas mach hdot h_baro rod".split()
    path = written(tmp_path / "odd.csv", **dict.fromkeys(names, y))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        text = draft(path)
    assert "flight" in tomllib.loads(text) and 'h_baro", unit = "mm"' not in text


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_ten_thousand_columns_with_long_names_are_drafted(tmp_path, ending):
    many = {f"engine_bay_temperature_{i}": np.full(20, i % 7 * 0.1 if i % 3 else np.nan) for i in range(10_000)}
    frame = pd.DataFrame({"t_s": T[:20], **many, "alpha": 0.01 * T[:20]})
    path = tmp_path / f"wide.{ending}"
    frame.to_csv(path, index=False) if ending == "csv" else frame.to_parquet(path, index=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        text = draft(path)
    assert 'alpha = { channel = "alpha" }' in text and "# not used: engine_bay_temperature_9999" in text


def test_a_text_of_windows_keeps_its_degrees(tmp_path):
    rows = "\n".join(f"{t:.3f};{5 * np.sin(t):.3f}".replace(".", ",") for t in T)
    (tmp_path / "prüfstand.csv").write_text(f"Zeit;AoA größer\ns;°\n{rows}\n", encoding="cp1252")
    assert list(read_channels(tmp_path / "prüfstand.csv")["prüfstand"]) == ["AoA größer [°]"]


def ros(path):
    """Write messages of which every third is logged late."""
    with path.open("wb") as file:
        w = Writer(file)
        w.start()
        schema = w.register_schema(name="sensor_msgs/Imu", encoding="jsonschema", data=b"{}")
        channel = w.register_channel(topic="/imu", message_encoding="json", schema_id=schema)
        for k, q in enumerate(Q):
            ns = 1_700_000_000_000_000_000 + k * 5_000_000
            stamp = {"sec": ns // 10**9, "nanosec": ns % 10**9}
            said = {"header": {"stamp": stamp}, "angular_velocity": {"x": 0.1 * q, "y": q},
                    "linear_acceleration": {"z": 9.81 + q}}  # fmt: skip
            at = ns + 40_000_000 * (k % 3 == 0)
            w.add_message(channel, log_time=at, publish_time=at, data=json.dumps(said).encode())
        w.finish()
    return path


def test_messages_of_ros_stand_at_their_own_stamps_where_these_are_the_time(tmp_path):
    path = ros(tmp_path / "ros.mcap")
    frame = read_channels(path, time="header.stamp")["/imu"]
    np.testing.assert_allclose(frame.index, T, atol=1e-9)
    assert np.array_equal(frame["angular_velocity.y"], Q) and frame.attrs["oddities"] == []
    assert not np.array_equal(read_channels(path)["/imu"]["angular_velocity.y"], Q)
    with pytest.raises(LogError, match=r"no topic has the time 'clock'"):
        read_channels(path, time="clock")


def test_the_axes_of_a_message_of_ros_are_known(tmp_path):
    text = draft(ros(tmp_path / "ros.mcap"))
    assert 'n_z = { channel = "linear_acceleration.z", unit = "m/s2" }  # proved' in text
    assert 'q = { channel = "angular_velocity.y" }' in text


def test_a_column_may_have_a_name_of_300_letters(tmp_path):
    np.savetxt(tmp_path / "bare.csv", np.stack([T, Q], axis=1), delimiter=",")
    said = CliRunner().invoke(cli.app, ["map", str(tmp_path / "bare.csv"), "--columns", f"t_s,{LONG}"])
    assert said.exit_code == 0 and f"# not used: {LONG}" in said.stdout


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("check", LONG), "there is no such file, and its name is longer than a file's may be"),
        (("new", "detector", LONG), "longer than a file's may be. Choose a shorter one"),
    ],
)
def test_a_name_of_300_letters_is_told_as_any_other(tmp_path, monkeypatch, words, told):
    monkeypatch.chdir(tmp_path)
    px4(tmp_path / "px4.csv")
    said = CliRunner().invoke(cli.app, list(words), prog_name="cosim")
    assert said.exit_code == 2 and told in said.stderr and "File name too long" not in said.stderr
