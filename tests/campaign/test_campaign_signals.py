"""Signals of a campaign's flights: labels are what was injected and achieved, splits do not leak."""

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import cosim
from cosim.campaign.engine import run_campaign
from cosim.campaign.signals import splits
from cosim.errors import CampaignError

CAMPAIGN = """
base = "liquid-ofc"
[set]
duration_s = 6.0
"detectors.enabled" = ["position_monitor"]
[grid]
point = [{ name = "heavy", "flight.mass_t" = 320.0, "flight.cas_kt" = 260.0 }, { name = "light" }]
fault = [
  { name = "none", faults = [] },
  { name = "ofc", "faults.0.start_s" = 3.0, "faults.0.end_s" = 5.0 },
  { name = "two", faults = [
    { target = "elevator.left_inner.rod", kind = "dropout", start_s = 2.0, path = "monitor" },
    { target = "elevator.right_inner", kind = "jam_solid", start_s = 4.0 },
  ] },
]
"""
SIGNALS = ("rod", "right_inner.position", "q", "de_cmd")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return the folder of six flights of 6 s, with signals."""
    home = tmp_path_factory.mktemp("signals")
    (home / "few.toml").write_text(CAMPAIGN)
    assert run_campaign(home / "few.toml", out=home / "few", signals=SIGNALS, workers=0).failed == 0
    return home / "few"


@pytest.fixture(scope="module")
def flights(folder):
    """Return {(point, fault): (row of the campaign, samples)}."""
    rows = pd.read_parquet(folder / "runs.parquet").drop_duplicates("run").to_dict("records")
    read = lambda run: pd.read_parquet(folder / "signals" / f"{run}.parquet")  # noqa: E731
    return {(r["label.point"], r["label.fault"]): (r, read(r["run"])) for r in rows}


def test_every_flight_has_a_file_of_the_asked_rate_with_units(flights, folder):
    assert len(flights) == 6
    for _, frame in flights.values():
        assert np.allclose(np.diff(frame["t_s"]), 0.02) and len(frame) == 300
    held = pq.read_schema(next((folder / "signals").iterdir()))
    assert held.field("left_inner.rod").metadata[b"unit"] == b"m" and "left_outer.rod" in held.names
    assert "alpha" not in held.names and "right_inner.rod" not in held.names


def test_labels_say_when_where_and_how_much(flights):
    _, frame = flights["light", "ofc"]
    on = frame["faults_active"] == 1
    assert frame["t_s"][on].min() == pytest.approx(3.0, abs=0.021) and frame["t_s"][on].max() < 5.0
    assert set(frame["fault_kind"][on]) == {"ofc_liquid"} and set(frame["fault_kind"][~on]) == {""}
    assert set(frame["fault_place"][on]) == {"elevator.left_inner@valve"}
    assert (frame["fault_injected"][~on] == 0).all() and np.ptp(frame["fault_injected"][on]) > 0
    two = flights["light", "two"][1]
    assert list(dict.fromkeys(two["fault_kind"])) == ["", "dropout", "dropout+jam_solid"]
    lost = two["left_inner.rod"].isna()
    assert lost[two["t_s"] > 2.1].all() and not lost[two["t_s"] < 2.0].any()
    assert not two["left_outer.rod"].isna().any()


def test_achieved_is_the_difference_from_the_healthy_flight(flights):
    row, frame = flights["heavy", "ofc"]
    assert (frame["achieved_left_inner"][frame["t_s"] < 3.0] == 0).all()
    assert np.degrees(np.abs(frame["achieved_left_inner"]).max()) == pytest.approx(1.8, abs=0.5)  # 8 mm of 300 mm
    scenario = cosim.load_scenario("liquid-ofc", ["duration_s=6", f"seed={row['seed']}", "flight.mass_t=320",
        "flight.cas_kt=260", "faults.0.start_s=3", "faults.0.end_s=5"])  # fmt: skip
    both = [cosim.fly(s, ["hydraulic.left_inner.delta"]).to_numpy()[::4, 0]
            for s in (scenario, scenario.model_copy(update={"faults": ()}))]  # fmt: skip
    assert frame["achieved_left_inner"].to_numpy() == pytest.approx(both[0] - both[1], abs=1e-8)
    healthy = flights["heavy", "none"][1]
    assert (healthy.filter(like="achieved") == 0).all(axis=None) and (healthy["fault_kind"] == "").all()


def test_what_no_flight_has_is_refused(folder, tmp_path):
    campaign = folder.with_suffix(".toml")
    for how, said in (({"signals": ["left_inner.current"]}, "no flight of this campaign has it"),
                      ({"signals": [], "rate_hz": 60.0}, "whole part")):  # fmt: skip
        with pytest.raises(CampaignError, match=said):
            run_campaign(campaign, out=tmp_path / "out", workers=0, **how)
    assert not (tmp_path / "out").exists()
    with pytest.raises(CampaignError, match="other --signals or --rate"):
        run_campaign(campaign, out=folder, workers=0, resume=True, signals=["q"])


def test_a_lost_file_is_flown_again_with_the_same_bytes(folder):
    first = {p.name: p.read_bytes() for p in (folder / "signals").iterdir()}
    next((folder / "signals").iterdir()).unlink()
    again = run_campaign(folder.with_suffix(".toml"), out=folder, workers=0, resume=True, signals=SIGNALS)
    assert again.resumed == 5 and first == {p.name: p.read_bytes() for p in (folder / "signals").iterdir()}


def test_splits_do_not_leak(flights):
    scenarios = [cosim.load_scenario("cruise", [f"seed={i}"]) for i in range(8)]
    labels = [{"point": f"p{i % 23}"} for i in range(200)]
    of_point = {}
    for label, split in zip(labels, splits(scenarios * 25, labels)):
        of_point.setdefault(label["point"], set()).add(split)
    assert all(len(s) == 1 for s in of_point.values())
    assert set.union(*of_point.values()) == {"train", "validation", "test"}
    assert len({row["split"] for (point, _), (row, _) in flights.items() if point == "heavy"}) == 1
