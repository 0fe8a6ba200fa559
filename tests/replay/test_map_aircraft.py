"""Maps of aircraft other than the default one: actuators by the names of the aircraft's own segments."""

import shutil

import numpy as np
import pandas as pd
import pytest

from cosim.replay.log_schema import ReplayError
from cosim.replay.map import diagnose
from cosim.scenario.aircraft import load_aircraft

POINT = "mass_t = 60.0\ncg_pct = 25.0\naltitude_ft = 20000.0\ncas_kt = 270.0"
SIGNALS = """
de_cmd = { channel = "cmd", unit = "deg" }
"%s.surface" = { channel = "surf", unit = "deg" }
"%s.hinge_moment" = { constant = 0.0 }
"""


@pytest.fixture
def recording(tmp_path):
    t = np.arange(400) / 200.0
    path = tmp_path / "bench.csv"
    pd.DataFrame({"t": t, "cmd": np.sin(t), "surf": np.sin(t - 0.08)}).to_csv(path, index=False)
    return path


def mapped(folder, aircraft, lane):
    path = folder / "map.toml"
    path.write_text(f'[flight]\naircraft = "{aircraft}"\n{POINT}\n[signals]{SIGNALS % (lane, lane)}')
    return path


@pytest.mark.parametrize("lane", ["left", "right"])
def test_segments_of_a_two_segment_aircraft_are_mapped_by_their_own_names(recording, tmp_path, lane):
    told = diagnose(recording, mapped(tmp_path, "narrowbody", lane))
    assert [(d["id"], d["target"]) for d in told.detectors] == [("position_monitor", f"elevator.{lane}")]
    assert f"{lane}.surface" in {s["name"] for s in told.signals}


def test_a_segment_that_the_aircraft_lacks_is_refused_with_those_that_it_has(recording, tmp_path):
    with pytest.raises(ReplayError, match=r"no elevator segment 'left_inner'; its own are left, right") as error:
        diagnose(recording, mapped(tmp_path, "narrowbody", "left_inner"))
    assert "signals.left_inner.surface" in str(error.value) and "left.surface" in str(error.value)


def test_an_aircraft_of_the_users_own_stands_beside_its_map(recording, tmp_path):
    shutil.copytree(load_aircraft("narrowbody").folder, tmp_path / "mine" / "narrowbody")
    told = diagnose(recording, mapped(tmp_path, "mine/narrowbody", "right"), detectors=["position_monitor"])
    assert [d["target"] for d in told.detectors] == ["elevator.right"]
