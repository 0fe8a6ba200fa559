"""Files in which real flights come: MATLAB 5, text with and without a header, a folder of channels, dates as time."""

import os
import subprocess
import sys
import tomllib

import numpy as np
import pandas as pd
import pytest
from flight_point import POINT
from scipy.io import savemat
from typer.testing import CliRunner

from cosim.cli import commands as cli
from cosim.errors import LogError
from cosim.replay.foreign import read_channels, read_table
from cosim.replay.map import diagnose
from cosim.replay.map_draft import draft
from cosim.replay.units import factors, known

T = np.arange(200) / 25.0
NAMES = ("T", "ALCG", "VTASCG")
ROWS = np.column_stack([T, 3.0 + np.sin(T), 120.0 + 1e-5 * T])
HEAD = """Data file: /a/b/c.cdf
2 Variables plus time, with 200 values each

              T           ALCG         VTASCG
              s            DEG           M/S

"""
COLUMNS = 'time = "T"\ncolumns = ["T", "ALCG", "VTASCG"]\n'
MAP = (
    COLUMNS
    + POINT
    + """[signals]
de_cmd = { channel = "ALCG", unit = "°" }
"left_inner.surface" = { channel = "ALCG", unit = "[DEG]" }
"""
)


def asc(path, head=""):
    path.write_text(head + "\n".join("".join(f"{v:16.7e}" for v in row) for row in ROWS) + "\n", encoding="latin-1")
    return path


def mat(path, **values):
    savemat(path, values)
    return path


@pytest.mark.parametrize("kind", ["asc", "headed", "mat", "vectors", "labels", "struct", "csv"])
def test_the_same_numbers_are_read_from_every_kind_of_file(tmp_path, kind):
    if kind in ("asc", "headed"):
        path = asc(tmp_path / "a.asc", HEAD if kind == "headed" else "")
    elif kind == "csv":  # no header
        path = tmp_path / "a.csv"
        np.savetxt(path, ROWS, delimiter=",")
    else:
        vectors = {n: ROWS[:, i : i + 1] for i, n in enumerate(NAMES)}
        made = {"mat": {"fA": ROWS}, "vectors": vectors, "struct": {"run": vectors},
                "labels": {"fdata": ROWS, "varlab": np.array([f"{n}   " for n in NAMES])}}[kind]  # fmt: skip
        path = mat(tmp_path / "a.mat", **made, dt=0.04, mass=np.array([[5.0]]))
    frame = read_table(path, NAMES if kind in ("asc", "csv", "mat") else ())
    first = [str(c).rpartition(".")[2].partition(" [")[0] for c in frame.columns[:3]]
    assert first == list(NAMES)
    np.testing.assert_allclose(frame.iloc[:, :3].to_numpy(), ROWS, rtol=1e-7)


def test_units_of_a_second_header_line_stand_behind_the_names(tmp_path):
    frame = read_table(asc(tmp_path / "a.asc", HEAD))
    assert list(frame.columns) == ["T", "ALCG [DEG]", "VTASCG [M/S]"]


def test_a_folder_of_one_file_per_channel_is_one_table(tmp_path):
    for name, column in zip(("time", "vane_AOA", "Dadc1_tas"), ROWS.T):
        np.savetxt(tmp_path / f"{name}.csv", column)
    np.savetxt(tmp_path / "odd.csv", T[:50])
    read = read_channels(tmp_path)
    (frame,) = read.values()
    np.testing.assert_allclose(frame["vane_AOA"], ROWS[:, 1])
    np.testing.assert_allclose(frame.index, T)
    assert frame.attrs["oddities"] == ["left out, other than 200 rows: odd (50 rows)"]


def test_tables_of_a_folder_are_joined_on_time(tmp_path):
    folder = tmp_path / "flight"
    folder.mkdir()
    pd.DataFrame({"t": T, "aoa": ROWS[:, 1]}).to_csv(folder / "air.csv", index=False)
    slow = T[::5]
    pd.DataFrame({"Zeit [ms]": 1e3 * slow, "de": np.sin(slow)}).to_csv(folder / "surfaces.csv", index=False, sep=";")
    (tmp_path / "map.toml").write_text(
        MAP.removeprefix(COLUMNS)
        .replace('"ALCG", unit = "°"', '"de", unit = "°"')
        .replace('"ALCG", unit = "[DEG]"', '"air.aoa", unit = "[DEG]"')
    )
    told = diagnose(folder, tmp_path / "map.toml", detectors=["position_monitor"])
    assert told.duration_s == pytest.approx(slow[-1], abs=0.01) and told.detectors


@pytest.mark.parametrize(
    ("name", "cells"),
    [
        ("Zeit [ms]", [f"{1e3 * t:g}" for t in T]),
        ("Datum", [f"24.11.2026 10:00:{t:06.3f}" for t in T]),
        ("UTC date", [f"2026-11-24T10:00:{t:06.3f}Z" for t in T]),
        ("t (min)", [f"{t / 60:.12g}" for t in T]),
        ("TimeUS", [f"{1e6 * t:.0f}" for t in T]),  # ArduPilot
        ("UTC", [f"{'23:59' if t < 4 else '00:00'}:{(56 + t) % 60:06.3f}" for t in T]),  # past midnight
        (
            "Date",
            [
                f"2026-03-29 0{1 if t < 4 else 3}:{'59' if t < 4 else '00'}:{(56 + t) % 60:06.3f}"
                f"+0{1 if t < 4 else 2}:00"
                for t in T
            ],
        ),  # the night in which summer time begins
    ],
)
def test_a_time_is_known_in_the_writings_of_people(tmp_path, name, cells):
    pd.DataFrame({name: cells, "x": T}).to_csv(tmp_path / "a.csv", index=False)
    np.testing.assert_allclose(read_channels(tmp_path / "a.csv")["a"].index, T, atol=1e-6)


@pytest.mark.parametrize(("unit", "scale"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_a_clock_of_whole_numbers_without_a_unit_is_drafted_with_one(tmp_path, unit, scale):
    stamps = 1_774_745_970 * int(scale) + np.round(scale * T).astype(np.int64)
    pd.DataFrame({"timestamp": stamps, "elevator_cmd_deg": np.sin(T)}).to_csv(tmp_path / "a.csv", index=False)
    made = tomllib.loads(draft(tmp_path / "a.csv"))
    assert made["time"] == f"timestamp [{unit}]"
    index = read_channels(tmp_path / "a.csv", time=made["time"])["a"].index
    np.testing.assert_allclose(index - index[0], T, atol=1e-6)
    if unit != "ns":
        with pytest.raises(LogError, match=r"1\.77475e\+\d\d s .*NAME \[us\]"):
            read_channels(tmp_path / "a.csv")


def test_a_map_reads_a_matrix_without_names(tmp_path):
    (tmp_path / "map.toml").write_text(MAP)
    told = diagnose(mat(tmp_path / "fA.mat", fA=ROWS), tmp_path / "map.toml")
    assert [d["id"] for d in told.detectors] == ["position_monitor"]
    assert told.signals[0]["valid_pct"] == 100.0


@pytest.mark.parametrize(
    ("text", "unit"),
    [("(inch)", "in"), ("[deg]", "deg"), ("°", "deg"), ("mrad", "mrad"), ("M/S**2", "m/s2"), ("DEG/S", "deg/s"),
     ("deg/s/s", "deg/s2"), ("m/s²", "m/s2"), ("kN", "kN"), ("kn", "kt"), ("Fuß", "ft"), ("PROZENT", "%"),
     ("N·m", "N m"), ("ft/sec", "ft/s"), ("MPa", "MPa"), ("furlong", "")],
)  # fmt: skip
def test_units_are_understood_as_people_write_them(text, unit):
    assert known(text) == unit
    assert factors("rad")["mrad"] == 1e-3


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda p: asc(p / "a.asc"), ("a.asc", "no time column", "--time")),
        (lambda p: mat(p / "a.mat", x=1.0), ("a.mat", "no variable of it is a table")),
        (lambda p: p, ("holds no table",)),
        (lambda p: (p / "a.mat").write_bytes(b"MATLAB 5.0 MAT-file, nothing") and p / "a.mat", ("cannot be read",)),
        (lambda p: (p / "a.mat").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(600)) and p / "a.mat", ("a.mat",)),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_line(tmp_path, made, words):
    with pytest.raises(LogError) as error:
        read_channels(made(tmp_path))
    assert all(w in str(error.value) for w in words) and "\n" not in str(error.value)


LIMITED = """import resource, runpy, sys
resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
sys.argv = ["cosim", *sys.argv[1:]]
runpy.run_module("cosim", run_name="__main__", alter_sys=True)
"""


@pytest.mark.parametrize(
    ("command", "name"), [("map", "a.csv"), ("replay", "a.csv"), ("map", "a.mat"), ("map", "a.mcap")]
)
def test_a_file_of_five_gigabytes_is_refused_in_one_line_before_it_is_read(tmp_path, command, name):
    path = tmp_path / name
    path.write_text("T,ALCG,VTASCG\n0,1,2\n")
    os.truncate(path, 5 << 30)  # sparse
    (tmp_path / "map.toml").write_text(MAP.replace("columns", "# columns"))
    how = ["--map", str(tmp_path / "map.toml")] if command == "replay" else []
    told = subprocess.run([sys.executable, "-c", LIMITED, command, str(path), *how], capture_output=True, text=True)
    assert told.returncode == 2 and not told.stdout
    assert len(told.stderr.splitlines()) == 1 and f"{name}: has 5.37 GB" in told.stderr and "Cut it" in told.stderr


def described(path, **columns):
    """Write 8 s of flight to a table, its columns changed as given; None leaves one out."""
    n = len(T)
    table = {"T": T, "ALCG": ROWS[:, 1], "VTASCG": ROWS[:, 2]} | columns
    frame = pd.DataFrame({name: np.broadcast_to(y, n) for name, y in table.items() if y is not None})
    frame.to_csv(path, index=False)
    return path


@pytest.mark.parametrize(
    ("columns", "unit", "words"),
    [
        ({"T": None}, "deg", "no time column T; allowed: one of its columns: ALCG, VTASCG"),
        ({"T": np.full(len(T), np.nan)}, "deg", "column 'T' holds no time (200 such rows)"),
        ({"T": np.where(T > 4.0, T - 4.0, T)}, "deg", "the clock goes back"),
        ({"ALCG": None}, "deg", "the recording has no channel 'ALCG'"),
        ({"ALCG": "x"}, "deg", "channel 'ALCG' holds something that is no number: 'x' in row 1"),
        ({"ALCG": ["1", "", "oops", *["2"] * (len(T) - 3)]}, "deg", "'oops' in row 3"),
        ({"T": np.zeros(len(T))}, "deg", "holds a single time"),
        ({}, "bar", "signals.left_inner.surface.unit: 'bar' is no unit of it"),
        ({"T": 1e6 * T}, "deg", "Is time in seconds?"),
    ],
)
def test_bad_input_is_one_line_with_place_and_remedy(tmp_path, columns, unit, words):
    path, given = described(tmp_path / "a.csv", **columns), MAP.replace("columns", "# columns")
    (tmp_path / "map.toml").write_text(given.replace("[DEG]", unit))
    run = CliRunner().invoke(cli.app, ["replay", str(path), "--map", str(tmp_path / "map.toml")])
    assert run.exit_code == 2 and words in " ".join(run.stderr.split()) and "Traceback" not in run.stderr


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le"])
def test_text_in_the_encodings_of_a_spreadsheet_is_read(tmp_path, encoding):
    path = described(tmp_path / "a.csv")
    want, text = read_channels(path)["a"], path.read_text().replace(",", "\t")
    path.write_text("\ufeff" * (encoding == "utf-16-le") + text, encoding=encoding)
    pd.testing.assert_frame_equal(read_channels(path)["a"], want)


@pytest.mark.parametrize("separator", [",", " "])
def test_ten_columns_of_one_name_keep_their_numbers_and_are_told(tmp_path, separator):
    path = tmp_path / "a.csv"
    lines = [separator.join(["T", *["x"] * 10]), *(separator.join(f"{t + k:g}" for k in range(11)) for t in T)]
    path.write_text("\n".join(lines))
    frame = read_channels(path)["a"]
    assert frame.attrs["oddities"] == ["10 columns are called 'x': the others x.1 to x.9"]
    assert frame.shape == (len(T), 10) and len(set(frame.columns)) == 10
    np.testing.assert_allclose(frame.to_numpy(), T[:, None] + np.arange(1, 11), rtol=1e-5)


def test_constant_channels_and_gaps_are_judged_around_and_told(tmp_path):
    path = described(tmp_path / "a.csv", ALCG=np.zeros(len(T)), T=T + 5.0 * (T > 4.0))
    (tmp_path / "map.toml").write_text(MAP.replace("columns", "# columns"))
    told = diagnose(path, tmp_path / "map.toml")
    assert any("no sample from 4 to 9" in text for text in told.caveats)
    assert told.signals[0]["valid_pct"] < 65.0 and told.detectors[0]["r_max"] == 0.0


def test_one_structure_of_a_file_is_read_and_the_others_are_named(tmp_path):
    runs = {f"run_{k}": {n: ROWS[: 200 - 50 * k, i] + k for i, n in enumerate(NAMES)} for k in range(2)}
    path = mat(tmp_path / "a.mat", **runs)
    (first,) = read_channels(path, time="run_0.T").values()
    assert first.shape == (200, 2) and list(first.columns) == ["run_0.ALCG", "run_0.VTASCG"]
    assert first.attrs["oddities"][-1].startswith("read: run_0, 200 rows; left out: run_1 of 150 rows; --time")
    (second,) = read_channels(path, time="run_1.T").values()
    np.testing.assert_allclose(second["run_1.ALCG"], ROWS[:150, 1] + 1)
    frame = read_table(mat(tmp_path / "b.mat", T=ROWS[:, :1], air={"ALCG": ROWS[:, 1]}, other={"x": np.arange(9.0)}))
    assert set(frame.columns) == {"T", "air.ALCG"}
