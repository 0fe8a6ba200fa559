"""False alarms per hour: what a flight keeps, what a curve says, what stands against it; a measurement goes on."""

import io
import json

import numpy as np
import pytest
from rich.console import Console

from cosim.campaign.fault_free import FaultFreeFlight, Lane, Moments, fly
from cosim.campaign.spec import Space, load_campaign
from cosim.cli.false_alarms import shown
from cosim.compare import false_alarms as work
from cosim.errors import CosimError
from cosim.judge.result import plain

CAMPAIGN = """
base = "cruise"
[set]
duration_s = 3.0
[grid]
manoeuvre = [{ "manoeuvre.kind" = "cruise" }, { "manoeuvre.kind" = "nz_doublet", "manoeuvre.start_s" = 1.0 }]
[draw]
"flight.mass_t" = { low = 240.0, high = 300.0 }
"""


def flown(draw, flights=3000, name="position_monitor", alarms=0, silent=0, seed=1):
    """Return Flights of a minute whose seconds are `draw(rng, n)`."""
    rng = np.random.default_rng(seed)
    lane = lambda: Lane(float(draw(rng, 60).max()), 60.0, alarms, silent, ())  # noqa: E731
    return [FaultFreeFlight(60.0, 0.005, "completed", {name: lane()}) for _ in range(flights)]


def test_a_curve_of_three_ways_agrees_with_itself_and_with_the_count():
    found = work.curve("position_monitor", flown(lambda rng, n: 0.02 * rng.exponential(size=n)))
    c, counted, tail = found["curve"]["c"], found["curve"]["counted"], found["curve"]["extremes"]
    assert found["hours"] == pytest.approx(50.0) and found["fit"]["note"] == ""
    both = [i for i, v in enumerate(tail["value"]) if v is not None and counted["value"][i] > 0.0]
    assert len(both) > 5
    assert all(tail["low"][i] <= counted["high"][i] and counted["low"][i] <= tail["high"][i] for i in both)
    exact = 3600.0 * np.exp(-np.array(c) / 0.02)
    assert all(tail["low"][i] <= exact[i] <= tail["high"][i] for i, v in enumerate(tail["value"]) if v is not None)
    assert [h["rate"] for h in found["held_out"]] == [1.0, 0.3, 0.1] and all(h["agree"] for h in found["held_out"])
    assert found["at_threshold"]["by"] == "extremes" and found["at_threshold"]["high"] < 1e-3
    assert found["agree"] == {"counted and extremes": True}
    json.dumps(plain(found), allow_nan=False)


def test_a_gaussian_residual_has_a_crossing_bound_that_agrees_with_the_extremes():
    from scipy.signal import lfilter

    rng, flights = np.random.default_rng(4), []
    for _ in range(1500):
        r = lfilter([0.1 * np.sqrt(0.19)], [1.0, -0.9], rng.normal(size=700))[100:]
        lane = Lane(float(np.abs(r).max()), 60.0, 0, 0, (Moments.of(r),))
        flights.append(FaultFreeFlight(60.0, 0.1, "completed", {"position_monitor": lane}))
    found = work.curve("position_monitor", flights)
    assert found["gaussian"] is None
    assert found["agree"] == {"counted and extremes": True, "crossings and extremes": True}
    at = np.interp(1.0, found["curve"]["c"], np.log10(np.maximum(found["curve"]["crossings"]["high"], 1e-99)))
    assert at < -15.0  # ten sigma


def test_a_detector_far_below_its_threshold_is_certified_and_one_near_it_is_not():
    name = "rtsekf_flight"
    far = work.curve(name, flown(lambda rng, n: 0.002 * np.abs(rng.normal(size=n)), name=name))
    assert far["against"] == [] and far["certified"] and far["needed"]["high"] < 1.0
    near = work.curve(name, flown(lambda rng, n: 0.2 * rng.exponential(size=n), alarms=1, name=name))
    assert not near["certified"] and "1e-9 per hour" in near["against"][0] and near["needed"]["value"] > 1.0
    assert near["at_threshold"]["by"] == "counted" and near["at_threshold"]["low"] > 1.0


def test_what_is_against_a_curve_is_said():
    small = lambda rng, n: 1e-4 * rng.exponential(size=n)  # noqa: E731
    assert "grows with the command" in work.curve("rfafe", flown(small, name="rfafe"))["against"][0]
    silent = work.curve("rtsekf", flown(small, name="rtsekf", alarms=1, silent=1))
    assert "statistic below 1" in silent["against"][0]
    stuck = work.curve(
        "rtsekf", flown(lambda rng, n: np.minimum(rng.exponential(size=n), 0.99), name="rtsekf")
    )
    assert "saturates" in stuck["against"][0] and stuck["needed"] is None and "extremes" not in stuck["curve"]


def test_flights_go_on_where_they_were_left_and_keep_what_they_were(tmp_path):
    file = tmp_path / "c.toml"
    file.write_text(CAMPAIGN)
    how = {"campaign": str(file), "folder": tmp_path / "flown", "workers": 0}
    told = []
    work.false_alarms(hours=2.0 / 1200.0, **how)
    more = work.false_alarms(hours=3.0 / 1200.0, **how, progress=lambda done, total: told.append((done, total)))
    assert told[0] == (2, 3) and told[-1] == (3, 3)
    assert more["flights"] == 3 and more["hours"] == pytest.approx(3.0 / 1200.0)
    one = next(d for d in more["detectors"] if d["id"] == "position_monitor")
    assert 0.0 < one["largest"] < 1.0 and one["alarms"] == 0 and "3 peaks" in one["against"][0]
    lane = FaultFreeFlight.read(fly(str(file), 1)).lanes["position_monitor"]
    assert 0.0 < lane.peak < 1.0 and len(lane.moments) == 4  # four signed residuals
    faulty = tmp_path / "faulty.toml"
    faulty.write_text(CAMPAIGN.replace("cruise", "liquid-ofc", 1))
    with pytest.raises(CosimError, match="has faults"):
        work.false_alarms(hours=0.01, campaign=str(faulty))
    with pytest.raises(CosimError, match="Did you mean"):
        work.false_alarms(hours=0.01, detectors=["position_montor"])


def test_a_flight_of_an_endless_campaign_does_not_depend_on_how_many_there_are(tmp_path):
    file = tmp_path / "c.toml"
    file.write_text(CAMPAIGN)
    space = Space(load_campaign(file), first_seed=7)
    first, second, third = (space.number(n) for n in (0, 1, 2))
    assert (first.manoeuvre.kind, second.manoeuvre.kind, third.manoeuvre.kind) == ("cruise", "nz_doublet", "cruise")
    assert len({s.flight.mass_t for s in (first, second, third)}) == 3 and third.seed == 9
    assert space.number(2) == third


def test_the_page_shows_every_detector_with_what_is_against_it():
    from cosim.report.false_alarms_page import render

    flights = flown(lambda rng, n: 0.02 * rng.exponential(size=n), flights=1200)
    stuck = flown(lambda rng, n: np.minimum(rng.exponential(size=n), 0.99), flights=1200, name="rfafe")
    both = [FaultFreeFlight(60.0, 0.005, "completed", a.lanes | b.lanes) for a, b in zip(flights, stuck)]
    lost = FaultFreeFlight(0.0, 0.0, "infeasible", {})
    found = work.summary([*both, lost], "fault-free", ("position_monitor", "rfafe"))
    html = render(plain(found))
    assert "20.0 h in 1200 flights" in html and "1 draws do not trim" in html
    assert "saturates" in html and "grows with the command" in html and "of this model" in html
    assert html.count('class="plot"') == 2 and "Anderson-Darling" in html
    text = io.StringIO()
    Console(file=text, width=80).print(shown(plain(found), {}))
    (row,) = (line.split() for line in text.getvalue().splitlines() if line.split()[:1] == ["position_monitor"])
    assert row[1:3] == ["20.0", "0"]
    assert "rfafe: no curve: saturates" in " ".join(text.getvalue().split())


def test_the_command_writes_page_and_table_and_prints_what_is_against_each(tmp_path, one_process):
    from typer.testing import CliRunner

    from cosim.cli.commands import app

    file = tmp_path / "c.toml"
    file.write_text(CAMPAIGN)
    words = ["false-alarms", "position_monitor", "--hours", 0.001, "--campaign", file, "-o", tmp_path / "out"]
    words = [*map(str, words), "--workers", "1"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0 and "position_monitor" in done.output and "2 flights" in done.output
    told = json.loads((tmp_path / "out" / "false-alarms.json").read_text())
    assert [d["id"] for d in told["detectors"]] == ["position_monitor"]
    assert "of this model" in (tmp_path / "out" / "false-alarms.html").read_text()
    again = CliRunner().invoke(app, [*words, "--json"])  # from what was flown
    assert json.loads(again.output)["detectors"] == told["detectors"]


DETECTOR = """
class Near:
    id, level, technologies, inputs = "near", "local", ("hydraulic",), ("rod",)

    def __init__(self, dt):
        pass

    def update(self, t, y):
        return {"r": LEVEL, "alarm": False, "verdict": "none"}
"""


def test_a_detector_of_a_users_file_is_counted_and_a_changed_one_is_flown_anew(tmp_path):
    (tmp_path / "c.toml").write_text(CAMPAIGN)
    file, folder = tmp_path / "near.py", tmp_path / "out"
    largest = []
    for level in ("0.25", "0.75"):
        file.write_text(DETECTOR.replace("LEVEL", level))
        found = work.false_alarms(hours=3 / 3600, campaign=str(tmp_path / "c.toml"), detectors=[str(file)],
                                  folder=folder, workers=0)  # fmt: skip
        assert [d["id"] for d in found["detectors"]] == ["near"] and found["detectors"][0]["hours"] > 0.0
        largest.append(found["detectors"][0]["largest"])
    assert largest == [0.25, 0.75]
    assert "near.py" not in (folder / "results.jsonl").read_text()


def test_a_detector_that_flies_on_request_flies_where_it_is_named(tmp_path):
    (tmp_path / "c.toml").write_text(CAMPAIGN.replace("duration_s = 3.0", "duration_s = 14.0"))
    how = {"hours": 14.0 / 3600.0, "campaign": str(tmp_path / "c.toml"), "workers": 0}
    found = work.false_alarms(**how, detectors=["joint", "rfafe"])
    assert [d["id"] for d in found["detectors"]] == ["joint", "rfafe"]


@pytest.mark.parametrize("key, bad", [
    ("peak", "0.5"), ("peak", None), ("peak", -0.2), ("valid_s", "1.0"), ("valid_s", -1.0),
    ("alarms", 1.5), ("silent", 2), ("moments", [[1, 2.0]]), ("moments", 3), ("more", 1),
])  # fmt: skip
def test_what_no_flight_tells_is_refused(key, bad):
    lane = {"peak": 0.5, "valid_s": 1.0, "alarms": 0, "silent": 0, "moments": [[2, *[0.5] * 7]]}
    told = {"seconds": 2.0, "dt": 0.1, "status": "completed", "lanes": {"x": lane}}
    read = FaultFreeFlight.read(told).lanes["x"]
    assert read.peak == 0.5 and read.moments[0].n == 2
    with pytest.raises(ValueError):
        FaultFreeFlight.read(told | {"lanes": {"x": {**lane, key: bad}}})
