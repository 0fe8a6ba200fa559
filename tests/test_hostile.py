"""Hostile files at every door that reads them: a result or one line of an error, in bounded time and memory.

A few of each in every run; COSIM_CASES of each kind with new seeds:
`COSIM_CASES=2000 pytest -n 0 -s tests/test_hostile.py` prints what came of them.
"""

import os
import time
from importlib.resources import files
from pathlib import Path

import hypothesis
import pytest
import strategies
from hostile_doors import bounded
from hypothesis import strategies as st
from typer.testing import CliRunner

import cosim
from cosim.campaign.spec import load_campaign
from cosim.cli.commands import app
from cosim.errors import CosimError
from cosim.log import open_log, recover
from cosim.log.overview import log_info
from cosim.parts import with_detectors
from cosim.replay import replay
from cosim.replay.map import diagnose
from cosim.replay.map_draft import draft
from cosim.replay.map_file import load_map
from cosim.report import flight_report

MANY = int(os.environ.get("COSIM_CASES", "0"))
LONGEST_S, MOST = 20.0, 300 << 20  # of the processor, and memory above what the process holds [byte]


def through(given, few, share=1.0):
    """Return what sends `few` cases, or COSIM_CASES x `share`, through doors(data), and prints what came of them."""
    told = {"cases": 0, "taken": 0, "refused": 0, "slowest": 0.0, "largest": 0}

    def case(data, doors):
        made = data.draw(given)
        told["cases"] += 1
        if MANY and told["cases"] % 100 == 0:
            print(told, flush=True)
        for door in doors(data):
            begun = time.process_time()
            try:
                with bounded(LONGEST_S, MOST) as used:
                    door(made)
                told["taken"] += 1
            except CosimError as error:
                told["refused"] += 1
                assert all(len(line) < 4100 for line in str(error).split("\n"))
            told["slowest"] = max(told["slowest"], time.process_time() - begun)
            told["largest"] = max(told["largest"], used[0])

    def run(doors):
        settings = hypothesis.settings(
            max_examples=round(MANY * share) or few, deadline=None, database=None, derandomize=not MANY,
            suppress_health_check=list(hypothesis.HealthCheck), phases=[hypothesis.Phase.generate],
            report_multiple_bugs=bool(MANY))  # fmt: skip
        settings(hypothesis.given(data=st.data())(lambda data: case(data, doors)))()
        print(f"\n{told['cases']} cases: {told['taken']} taken, {told['refused']} refused, "
              f"slowest {told['slowest']:.1f} s, largest {told['largest'] / 1e6:.0f} MB above the process")  # fmt: skip

    return run


def originals(folder, ending=".toml"):
    """Return the texts of the built-in files of a folder."""
    return [p.read_text() for p in files("cosim").joinpath(folder).iterdir() if p.name.endswith(ending)]


def beside(path, door):
    """Return a door for bytes that are written to `path` first."""

    def opened(raw):
        path.write_bytes(raw)
        door(path)

    return opened


def test_scenarios(tmp_path):
    door = beside(tmp_path / "case.toml", cosim.load_scenario)
    through(strategies.texts(originals("scenarios")), 30, 0.25)(lambda data: [door])


def test_overrides():
    keys = st.sampled_from(["duration_s", "log_profile", "flight.mass_t", "manoeuvre.kind", "faults.0", "faults.0.kind",
                            "elevator.feedback", "detectors.enabled", "tolerances.aero.Cm_q", "faults.99.kind", "x.y",
                            "aircraft", "elevator.left_inner", "flight", "detectors.iotsekf", "law.file"])  # fmt: skip
    likely = st.sampled_from(["1", "1.0", "200.0", "0.8", "['iotsekf']", "measured", "ema", "jam", "replay", "cruise"])
    raw = st.one_of(likely, strategies.VALUES.map(strategies.toml), st.text(max_size=12))
    given = st.lists(st.builds("{}={}".format, keys, raw), min_size=1, max_size=2)
    through(given, 40, 0.25)(lambda data: [lambda words: cosim.load_scenario("liquid-ofc", words)])


def test_campaigns(tmp_path):
    for p in files("cosim").joinpath("campaigns").iterdir():
        if p.name.endswith(".csv"):
            (tmp_path / p.name).write_bytes(p.read_bytes())

    def drawn(path):
        made = load_campaign(path)
        if len(made) <= 100:
            made.scenarios()

    door = beside(tmp_path / "case.toml", drawn)
    through(strategies.texts(originals("campaigns")), 20, 0.25)(lambda data: [door])


def test_maps(tmp_path):
    maps = [(Path(__file__).parent / "data" / "foreign_map.toml").read_text(), strategies.MAP.format("")]
    strategies.write_whole(tmp_path / "whole.csv")

    def read(path):
        load_map(path)
        diagnose(tmp_path / "whole.csv", path)

    door = beside(tmp_path / "case.toml", read)
    through(strategies.texts(maps), 15, 0.25)(lambda data: [door])


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """Return open logs of short flights: hydraulic, electric with detectors of the aircraft, and a user's detector."""
    home = tmp_path_factory.mktemp("doors")
    short = ["duration_s=0.5", "faults.0.start_s=0.2", "elevator.feedback=measured"]
    own = Path(__file__).parent / "data" / "user_parts" / "counting.py"
    flown = [
        cosim.load_scenario("liquid-ofc", [*short, "detectors.enabled=['iotsekf']"]),
        cosim.load_scenario("cruise", [short[0], "detectors.enabled=['ema_kalman', 'kinematic', 'ofc_monitor']"]),
        with_detectors(cosim.load_scenario("liquid-ofc", [*short, "detectors.enabled=['position_monitor']"]), [own]),
    ]
    for k, scenario in enumerate(flown):
        cosim.simulate(scenario, log=home / f"{k}.mcap", timed=False)
    return [open_log(home / f"{k}.mcap") for k in range(len(flown))]


def test_logs(flights, tmp_path):
    doors = [log_info, replay, lambda p: flight_report(p, tmp_path / "page.html"),
             lambda p: recover(p, tmp_path / "recovered.mcap"),
             lambda p: replay(p, output=tmp_path / "again.mcap")]  # fmt: skip
    through(strategies.logs(flights, tmp_path / "case.mcap"), 20)(
        lambda data: data.draw(st.permutations(doors))[:2])  # fmt: skip


def test_recordings(tmp_path):
    strategies.write_maps(tmp_path)

    def read(case):
        path, map_ = case
        diagnose(path, tmp_path / map_, output=tmp_path / "out.mcap")

    through(strategies.recordings(tmp_path), 12, 0.25)(lambda data: [read, lambda case: draft(case[0])])


def test_through_the_command(flights, tmp_path):
    """The same as a command: exit status 0, 1 or 2, and no traceback."""

    def door(words):
        def called(path):
            done = CliRunner().invoke(app, [str(path) if word == "LOG" else str(word) for word in words])
            assert done.exit_code in (0, 1, 2) and "Traceback" not in done.output, (words, done.output)
            assert done.exception is None or isinstance(done.exception, SystemExit), (words, done.exception)
            if done.exit_code == 2:
                raise CosimError(done.stderr.strip() or "error")

        return called

    page, out = tmp_path / "page.html", tmp_path / "out.mcap"
    words = [["info", "LOG"], ["info", "LOG", "--json"], ["report", "LOG", "-o", page], ["replay", "LOG"],
             ["recover", "LOG", "-o", out], ["replay", "LOG", "-o", out]]  # fmt: skip
    through(strategies.logs(flights, tmp_path / "case.mcap"), 8, 0.1)(
        lambda data: [door(data.draw(st.sampled_from(words)))])  # fmt: skip
