"""A pilot's own inputs fly as their table says, are in the log, and the log needs no file."""

import numpy as np
import pytest

import cosim
from cosim.cli import commands as cli
from cosim.errors import ScenarioError
from cosim.replay import replay

TABLE = {
    "time_s": [0.0, 1.0, 1.5, 3.0, 3.2, 5.0], "stick": [0.0, 0.0, 0.1, 0.1, 0.0, 0.0],
    "bank_deg": [0.0, 0.0, 10.0, 10.0, 10.0, 10.0], "throttle_change": [0.0, 0.0, 0.0, 0.1, 0.1, 0.1],
    "stabiliser_change_deg": [0.0, 0.0, 0.0, 0.2, 0.2, 0.2], "elevator_deg": [0.0, 0.0, 0.0, 0.0, 0.5, 0.0],
}  # fmt: skip
SIGNALS = {"stick": "pilot.pilot.nz_dem", "bank_deg": "pilot.pilot.phi_dem", "elevator_deg": "pilot.pilot.de_add",
           "throttle_change": "law.law.throttle_cmd", "stabiliser_change_deg": "law.law.stab_cmd"}  # fmt: skip
FACTORS = {"stick": 2.0, "throttle_change": 1.0}
SHORT = ["duration_s=6", "detectors.enabled=['iotsekf']", "manoeuvre.kind=inputs"]


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Fly TABLE from a file beside a scenario of its own; return the log's path."""
    folder = tmp_path_factory.mktemp("hands")
    rows = zip(*TABLE.values())
    (folder / "hand.csv").write_text("\n".join([",".join(TABLE), *(",".join(map(str, row)) for row in rows)]))
    s = cosim.load_scenario("cruise", [*SHORT, f"manoeuvre.file={folder / 'hand.csv'}"])
    cosim.simulate(s, log=folder / "flight.mcap", timed=False)
    return folder / "flight.mcap"


def test_what_the_table_says_is_what_law_and_aircraft_get(flown):
    log = cosim.open_log(flown)
    frames = {name: log.frame(name) for name in log.topics if name.startswith(("/law", "/truth"))}
    t = np.arange(1200) * 0.005
    for column, signal in SIGNALS.items():
        field = signal.rpartition(".")[2]
        got = next(f[field].to_numpy() for name, f in frames.items() if field in f and "truth" not in name)
        start = got[0] if column.endswith("change") or "_change_" in column else 0.0
        said = np.interp(t, TABLE["time_s"], TABLE[column]) * FACTORS.get(column, np.pi / 180.0)
        assert np.abs(got - start - said).max() < 1e-12, column
    truth = frames["/truth/aircraft"]
    nz, stab = truth["nz"].to_numpy(), truth["stab"].to_numpy()
    assert 0.15 < nz[t > 2.5].max() - nz[0] < 0.3  # 0.2 g asked for
    assert np.degrees(stab[-1] - stab[0]) == pytest.approx(0.2, abs=1e-3)
    assert truth["thrust_1"].iloc[-1] > 1.05 * truth["thrust_1"].iloc[0]
    assert np.degrees(truth["phi"].iloc[-1]) == pytest.approx(10.0, abs=2.0)


def test_the_log_gives_the_flight_back_without_the_file_and_replays(flown, tmp_path, capsys):
    from typer.testing import CliRunner

    (flown.parent / "hand.csv").unlink(missing_ok=True)
    assert replay(flown).exact
    text = CliRunner().invoke(cli.app, ["info", str(flown), "--scenario"]).stdout
    (tmp_path / "again.toml").write_text(text)
    cosim.simulate(tmp_path / "again.toml", log=tmp_path / "again.mcap", timed=False)
    assert (tmp_path / "again.mcap").read_bytes() == flown.read_bytes()


def test_a_row_holds_until_the_next_where_that_is_asked_for():
    keys = ["manoeuvre.between=hold", "manoeuvre.time_s=[0.1, 0.2]", "manoeuvre.nz_g=[0.05, -0.1]", "duration_s=0.4"]
    frame = cosim.fly(cosim.load_scenario("cruise", [*SHORT, *keys]), ["pilot.pilot.nz_dem"])
    got = frame["pilot.pilot.nz_dem"].to_numpy()
    assert set(got[:40]) == {0.05} and set(got[40:]) == {-0.1}


@pytest.mark.parametrize("column", ["throttle_change", "stabiliser_change_deg"])
def test_a_change_beyond_the_stop_is_refused_with_the_time_and_the_trim(column):
    size = 0.9 if column == "throttle_change" else 30.0
    keys = ["manoeuvre.time_s=[0, 2]", f"manoeuvre.{column}=[0, {size}]"]
    with pytest.raises(ScenarioError, match=rf"manoeuvre\.{column}: at \d.* s it leads to .*the trim is"):
        cosim.fly(cosim.load_scenario("cruise", [*SHORT, *keys]))
