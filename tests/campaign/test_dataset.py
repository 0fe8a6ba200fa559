"""Data sets: labels are what was injected and achieved, splits do not leak, the same call gives the same bytes."""

import hashlib
import json

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import cosim
from cosim.campaign.dataset import make
from cosim.campaign.dataset.metadata import empty, splits
from cosim.errors import CampaignError, OutputError

CAMPAIGN = """
base = "liquid-ofc"
runs = 1
[set]
duration_s = 6.0
[grid]
point = [{ name = "heavy", "flight.mass_t" = 320.0, "flight.cas_kt" = 260.0 }, { name = "light" }]
fault = [
  { name = "none", faults = [] },
  { name = "ofc", "faults.0.start_s" = 3.0, "faults.0.end_s" = 5.0 },
  { name = "two", faults = [
    { target = "elevator.left_inner.rod", kind = "bias", bias_mm = 8, start_s = 2.0, path = "monitor" },
    { target = "elevator.right_inner", kind = "jam_solid", start_s = 4.0 },
  ] },
]
"""
SIGNALS = ("rod", "right_inner.position", "q", "de_cmd")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A data set of six flights of 6 s: (folder, what make returned)."""
    folder = tmp_path_factory.mktemp("dataset")
    (folder / "few.toml").write_text(CAMPAIGN)
    return folder / "few", make(folder / "few.toml", folder / "few", signals=SIGNALS, workers=0)


@pytest.fixture(scope="module")
def flights(made):
    """{(point, family): (row of flights.parquet, samples)}."""
    rows = pd.read_parquet(made[0] / "flights.parquet").to_dict("records")
    return {(r["point"], r["family"]): (r, pd.read_parquet(made[0] / r["file"])) for r in rows}


def test_every_flight_has_a_file_of_the_asked_rate_with_units(made, flights):
    folder, told = made
    assert told["flights"] == 6 and told["failed"] == 0 and told["samples"] == 6 * 300
    for row, frame in flights.values():
        assert np.allclose(np.diff(frame["t_s"]), 0.02) and len(frame) == row["rows"] == 300
        assert hashlib.sha256((folder / row["file"]).read_bytes()).hexdigest() == row["sha256"]
    held = pq.read_schema(folder / row["file"])
    assert held.field("left_inner.rod").metadata[b"unit"] == b"m" and "left_outer.rod" in held.names
    assert "alpha" not in held.names and "right_inner.rod" not in held.names


def test_labels_say_when_where_and_how_much(flights):
    _, frame = flights["light", "ofc_liquid"]
    on = frame["faults_active"] == 1
    assert frame["t_s"][on].min() == pytest.approx(3.0, abs=0.021) and frame["t_s"][on].max() < 5.0
    assert set(frame["fault_kind"][on]) == {"ofc_liquid"} and set(frame["fault_kind"][~on]) == {""}
    assert set(frame["fault_place"][on]) == {"elevator.left_inner@valve"}
    assert (frame["fault_injected"][~on] == 0).all() and np.ptp(frame["fault_injected"][on]) > 0
    two = flights["light", "bias+jam_solid"][1]
    assert list(dict.fromkeys(two["fault_kind"])) == ["", "bias", "bias+jam_solid"]
    assert two["fault_injected"][two["faults_active"] > 0].tolist() == pytest.approx([0.008] * 200)


def test_achieved_is_the_difference_from_the_healthy_flight(flights):
    row, frame = flights["heavy", "ofc_liquid"]
    before = frame["t_s"] < 3.0
    assert (frame["achieved_left_inner"][before] == 0).all()
    assert np.degrees(np.abs(frame["achieved_left_inner"]).max()) == pytest.approx(1.8, abs=0.5)  # 8 mm of 300 mm
    scenario = cosim.load_scenario("liquid-ofc", ["duration_s=6", f"seed={row['seed']}", "flight.mass_t=320",
        "flight.cas_kt=260", "faults.0.start_s=3", "faults.0.end_s=5"])  # fmt: skip
    both = [cosim.fly(s, ["hydraulic.left_inner.delta"]).to_numpy()[::4, 0]
            for s in (scenario, scenario.model_copy(update={"faults": ()}))]  # fmt: skip
    assert frame["achieved_left_inner"].to_numpy() == pytest.approx(both[0] - both[1], abs=1e-8)
    healthy = flights["heavy", "none"][1]
    assert (healthy.filter(like="achieved") == 0).all(axis=None) and (healthy["fault_kind"] == "").all()


def test_a_signal_that_the_actuator_has_not_is_refused_and_an_invalid_one_is_nan(made, tmp_path):
    folder, _ = made
    with pytest.raises(CampaignError, match="no flight of this campaign has it"):
        make(folder.with_suffix(".toml"), tmp_path, signals=["left_inner.current"], workers=0)
    with pytest.raises(CampaignError, match="whole part"):
        make(folder.with_suffix(".toml"), tmp_path, rate_hz=60, workers=0)
    dropout = '[{ target = "elevator.left_inner.rod", kind = "dropout", start_s = 1.0 }]'
    (tmp_path / "one.toml").write_text(f'base = "cruise"\nruns = 1\n[set]\nduration_s = 2.0\nfaults = {dropout}\n')
    make(tmp_path / "one.toml", tmp_path / "one", signals=["rod"], workers=0)
    frame = pd.read_parquet(next((tmp_path / "one" / "flights").iterdir()))
    lost = frame["left_inner.rod"].isna()
    assert lost[frame["t_s"] > 1.1].all() and not lost[frame["t_s"] < 1.0].any()
    assert not frame["left_outer.rod"].isna().any()


def test_the_same_call_gives_the_same_bytes_and_mends_what_is_lost(made, tmp_path):
    folder, _ = made
    campaign = folder.with_suffix(".toml")
    first = {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    one, other = sorted((folder / "flights").iterdir())[:2]
    one.unlink()
    other.write_bytes(b"cut")
    make(campaign, folder, signals=SIGNALS, workers=0)
    assert {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()} == first


def test_a_folder_of_something_else_is_left_alone(made, tmp_path):
    folder, _ = made
    with pytest.raises(OutputError, match="holds something else"):
        make(folder.with_suffix(".toml"), folder, signals=["q"], workers=0)
    with pytest.raises(CampaignError, match="--rate 0"):
        make(folder.with_suffix(".toml"), tmp_path / "new", rate_hz=0.0, workers=0)
    assert not (tmp_path / "new").exists()
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(OutputError, match="holds something else"):
        make(folder.with_suffix(".toml"), tmp_path, signals=["q"], workers=0)
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


def test_a_split_without_a_flight_says_why_and_what_to_do(made):
    folder, told = made
    shares, folds = told["notes"]
    assert shares.startswith("split_point: no flight in validation, as") and "has 2 of 4 points. Vary flight." in shares
    assert folds.startswith("fold_family: no flight in fold 2, 3, 4") and "has 2 of 5 families" in folds
    assert all(f"\n{line}.\n" in (folder / "README.md").read_text() for line in told["notes"])
    rows = [{"point": f"p{i}", "family": f"f{i % 5}", "run": str(i)} for i in range(20)]
    assert empty([{**row, **split} for row, split in zip(rows, splits(rows))]) == []


def test_splits_do_not_leak():
    rows = [{"run": f"r{i}", "point": f"p{i % 23}", "family": ("none", "jam", "bias", "ofc", "drift", "noise")[i % 6]}
            for i in range(200)]  # fmt: skip
    dealt = splits(rows)
    of_point = {}
    of_family = {}
    for row, split in zip(rows, dealt):
        of_point.setdefault(row["point"], set()).add(split["split_point"])
        of_family.setdefault(row["family"], set()).add(split["fold_family"])
    assert all(len(s) == 1 for s in of_point.values())
    assert set.union(*of_point.values()) == {"train", "validation", "test"}
    assert all(len(s) == 1 for name, s in of_family.items() if name != "none") and len(of_family["none"]) == 5
    assert splits(rows[::-1]) == dealt[::-1]  # it hangs on names, not on the order


def test_croissant_reads_it_and_the_datasheet_says_how_to_make_it(made):
    mlcroissant = pytest.importorskip("mlcroissant")
    folder, _ = made
    read = mlcroissant.Dataset(jsonld=str(folder / "croissant.json"))
    assert not read.metadata.ctx.issues.errors
    samples = [r for _, r in zip(range(3), read.records(record_set="samples"))]
    assert [r["samples/t_s"] for r in samples] == pytest.approx([0.0, 0.02, 0.04])
    rows = list(read.records(record_set="flights"))
    assert {r["flights/family"].decode() for r in rows} == {"none", "ofc_liquid", "bias+jam_solid"}
    about = json.loads((folder / "dataset.json").read_text())
    sheet = (folder / "README.md").read_text()
    assert about["command"] in sheet and about["digest"] in sheet and "| `left_inner.rod` | m |" in sheet
