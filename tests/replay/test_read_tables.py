"""Files in which real flights come: MATLAB 5, text with and without a header, a folder of channels, dates as time."""

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from cosim.errors import LogError
from cosim.replay.foreign import read_channels
from cosim.replay.map import diagnose
from cosim.replay.tables import read_table
from cosim.replay.units import factors, known

T = np.arange(200) / 25.0
NAMES = ("T", "ALCG", "VTASCG")
ROWS = np.column_stack([T, 3.0 + np.sin(T), 120.0 + 1e-5 * T])
HEAD = """Data file: /a/b/c.cdf
2 Variables plus time, with 200 values each

              T           ALCG         VTASCG
              s            DEG           M/S

"""
MAP = """time = "T"
columns = ["T", "ALCG", "VTASCG"]
[flight]
mass_t = 200.0
cg_pct = 30.0
altitude_ft = 20000.0
cas_kt = 290.0
[signals]
de_cmd = { channel = "ALCG", unit = "°" }
"left_inner.surface" = { channel = "ALCG", unit = "[DEG]" }
"""


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
        MAP.replace('time = "T"\ncolumns = ["T", "ALCG", "VTASCG"]\n', "")
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
    ],
)
def test_a_time_is_known_in_the_writings_of_people(tmp_path, name, cells):
    pd.DataFrame({name: cells, "x": T}).to_csv(tmp_path / "a.csv", index=False)
    np.testing.assert_allclose(read_channels(tmp_path / "a.csv")["a"].index, T, atol=1e-6)


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


def test_a_text_of_gigabytes_is_refused_before_it_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr("cosim.replay.tables.MOST_BYTES", 1000)
    with pytest.raises(LogError, match="Cut it"):
        read_table(asc(tmp_path / "a.asc"))
