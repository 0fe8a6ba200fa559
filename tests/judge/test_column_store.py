"""Columns on disk: they give what an array would give, and a flight's outcome does not depend on where they stand."""

import numpy as np
import pytest

import cosim
from cosim.judge import column_store
from cosim.judge.column_store import ColumnStore
from cosim.replay import recording, replay
from cosim.report import flight_report

SHORT = ["duration_s=6", "faults.0.start_s=2", "detectors.enabled=['iotsekf','ofc_monitor']",
         "elevator.feedback=measured"]  # fmt: skip


@pytest.mark.parametrize("memory", [0, 500, 1 << 20])
def test_a_store_reads_as_an_array(memory, monkeypatch):
    monkeypatch.setattr(column_store, "MEMORY", memory)
    monkeypatch.setattr(column_store, "_held", 0)  # whatever other tests still hold
    rng, store = np.random.default_rng(1), ColumnStore()
    blocks = [rng.normal(size=(n, 3)).astype(np.float32) for n in (7, 0, 40, 1, 13)]
    for block in blocks:
        store.append(block)
    whole = np.concatenate(blocks)
    other = store.branch()
    other.append(blocks[0])
    np.testing.assert_array_equal(other[:, range(3)], np.concatenate([whole, blocks[0]]))
    assert len(store) == len(whole) == len(store[5:]) + 5
    np.testing.assert_array_equal(store[:, [2, 0]], whole[:, [2, 0]])
    for a, b in ((0, 61), (3, 9), (47, 48), (10, 10), (50, 4), (-5, None)):
        np.testing.assert_array_equal(store[a:b][:, 1], whole[a:b, 1])
        np.testing.assert_array_equal(store[4:][a:b, 1], whole[4:][a:b, 1])
    mask = whole[:, 0] > 0
    np.testing.assert_array_equal(store[mask, 2], whole[mask, 2])
    held = column_store._held
    del store, other, block
    assert column_store._held < held or not memory


def test_blocks_of_a_branch_count_after_the_original_is_gone(monkeypatch):
    monkeypatch.setattr(column_store, "MEMORY", column_store._held + 1000)
    before, store = column_store._held, ColumnStore()
    store.append(np.zeros((200, 1), np.float32))
    other = store.branch()
    del store
    assert column_store._held == before + 800
    other.append(np.ones((200, 1), np.float32))  # no longer fits
    assert column_store._held == before + 800 and other[:, 0].sum() == 200.0
    del other
    assert column_store._held == before


def test_a_flight_on_disk_is_the_same_flight(tmp_path, monkeypatch):
    def flown(name):
        scenario = cosim.load_scenario("liquid-ofc", SHORT)
        result = cosim.simulate(scenario, log=tmp_path / f"{name}.mcap", achieved=True, timed=False).to_dict()
        asked = replay(tmp_path / "0.mcap", overrides={"ofc_monitor": {"threshold": 1e-4}}).to_dict()
        page = flight_report(tmp_path / "0.mcap", tmp_path / "page.html").read_text()
        lanes = [lane.entry for lane in recording.LoggedFlight(tmp_path / "0.mcap").lanes]
        kept = {k: v for k, v in result.items() if "wall" not in k and k not in ("log", "realtime_factor", "startup_s")}
        return kept, (tmp_path / f"{name}.mcap").read_bytes(), asked, lanes, len(page)

    whole = flown("0")
    monkeypatch.setattr(column_store, "MEMORY", 0)
    monkeypatch.setattr(recording, "SMALL", 0)
    parts = flown("1")
    assert whole[:3] == parts[:3]
    assert whole[4] == pytest.approx(parts[4], rel=0.01)
    for one, other in zip(whole[3], parts[3]):  # in single precision
        for name, value in one.items():
            near = pytest.approx(value, rel=1e-5, abs=1e-7, nan_ok=True) if isinstance(value, float) else value
            assert other[name] == near, name
