"""Every door under fire: mutated and forged logs, scenarios, maps, campaign files and folders, recordings.

One line or a result, in bounded time and memory; never a traceback.

COSIM_CASES cases of each kind from COSIM_SEED on, printed (`pytest -m slow -s tests/test_doors.py`).
"""

import json
import os
import random
import shutil
from collections import Counter
from importlib.resources import files
from pathlib import Path

import hostile_recordings
import pyarrow.parquet as pq
import pytest
from campaign_texts import two_flights
from commands import commands
from hostile_doors import CASES, LARGEST, LONGEST_S, SEED, texts, tried, written
from hostile_logs import Logs
from hostile_texts import WORDS, encoded

import cosim
from cosim.campaign.run import run_campaign
from cosim.campaign.spec import load_campaign
from cosim.cli.bench import compared, read_bench
from cosim.compare import compare
from cosim.flight.plugins import with_detectors
from cosim.log import recover
from cosim.log.overview import log_info
from cosim.replay import replay
from cosim.replay.map import diagnose
from cosim.replay.map_file import load_map
from cosim.report import comparison_report, flight_report

KEYS = ("duration_s", "seed", "rate_hz", "flight.mass_t", "flight.mach", "manoeuvre.kind", "faults.0", "faults.0.kind",
        "elevator.feedback", "sensors.alpha.bias_deg", "detectors.enabled", "title", "tolerances.aero.Cm_q",
        "faults.99.kind", "x.y.z", "faults.0.target", "manoeuvre", "faults", "detectors.iotsekf", "aircraft",
        "elevator.left_inner", "faults.0.start_s", "faults.0.frequency_hz", "detectors.files", "flight")  # fmt: skip


@pytest.mark.slow
def test_scenarios_and_overrides(tmp_path):
    def override(rng):
        return [f"{rng.choice(KEYS)}={rng.choice(WORDS)}" for _ in range(rng.choice((1, 1, 2)))]

    tried("scenarios", CASES, written(tmp_path / "case.toml", texts("scenarios")), [cosim.load_scenario])
    tried("overrides", CASES, override, [lambda given: cosim.load_scenario("liquid-ofc", given)])


@pytest.mark.slow
def test_maps_and_campaign_files(tmp_path):
    for p in files("cosim").joinpath("campaigns").iterdir():
        if p.name.endswith(".csv"):
            (tmp_path / p.name).write_bytes(p.read_bytes())
    maps = [(Path(__file__).parent / "data" / "foreign_map.toml").read_text(), hostile_recordings.MAP.format("")]
    tried("campaign files", CASES, written(tmp_path / "case.toml", texts("campaigns")), [drawn])
    hostile_recordings.write_whole(tmp_path / "whole.csv")
    doors = [load_map, lambda path: diagnose(tmp_path / "whole.csv", path)]
    tried("maps", CASES, written(tmp_path / "map.toml", maps), doors)


def drawn(path):
    """Load a campaign, and make its scenarios where they are few."""
    made = load_campaign(path)
    if len(made) <= 200:
        made.scenarios()


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """Return logs of short flights: hydraulic, electric with detectors of the aircraft, and a detector of one's own."""
    home = tmp_path_factory.mktemp("doors")
    short = ["duration_s=0.5", "faults.0.start_s=0.2", "elevator.feedback=measured"]
    guest = Path(__file__).parent / "data" / "guests" / "counting.py"
    flown = [
        cosim.load_scenario("liquid-ofc", [*short, "detectors.enabled=['iotsekf']"]),
        cosim.load_scenario("cruise", [short[0], "detectors.enabled=['ema_kalman', 'kinematic', 'ofc_monitor']"]),
        with_detectors(cosim.load_scenario("liquid-ofc", [*short, "detectors.enabled=['position_monitor']"]), [guest]),
    ]
    for k, scenario in enumerate(flown):
        cosim.simulate(scenario, log=home / f"{k}.mcap", timed=False)
    return [home / f"{k}.mcap" for k in range(len(flown))]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["contents", "records", "mutated"])
def test_logs(kind, flights, tmp_path):
    logs = Logs(flights, tmp_path / "case.mcap")
    doors = [log_info, replay, lambda p: flight_report(p, tmp_path / "page.html")]
    doors += [lambda p: recover(p, tmp_path / "recovered.mcap"), lambda p: replay(p, output=tmp_path / "again.mcap")]

    def made(rng):
        return getattr(logs, kind)(rng), rng.sample(doors, 2)  # of five

    tried(f"logs, {kind}", CASES, made, [lambda case: case[1][0](case[0]), lambda case: case[1][1](case[0])])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["csv", "parquet", "mcap"])
def test_recordings(kind, tmp_path):
    hostile_recordings.write_maps(tmp_path)
    make = getattr(hostile_recordings, kind)

    def read(case):
        path, how = case
        map_ = "bus.toml" if kind == "mcap" else "map.toml"
        diagnose(path, tmp_path / map_, on_reset=how, output=tmp_path / "out.mcap")

    def made(rng):
        return make(rng, tmp_path), rng.choice([None, "split", "offset"])

    tried(f"recordings, {kind}", max(200, CASES // 10), made, [read])


@pytest.mark.slow
def test_campaign_folders(tmp_path):
    (tmp_path / "few.toml").write_text(two_flights(0.3))
    assert run_campaign(tmp_path / "few.toml", out=tmp_path / "whole", workers=0).done == 2
    (tmp_path / "whole" / "guests.json").write_text("[]")

    def made(rng):
        out = tmp_path / "out"
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(tmp_path / "whole", out)
        for _ in range(rng.choice((1, 1, 2))):
            _damaged(rng, rng.choice([p for p in sorted(out.rglob("*")) if p.is_file()]))
        return out

    def page(out):
        comparison_report(compare([out]), tmp_path / "page.html")

    def resumed(out):
        run_campaign(tmp_path / "few.toml", out=out, workers=0, resume=True)

    tried("campaign folders", max(200, CASES // 10), made, [page, resumed, page])


def _damaged(rng, path):
    what = rng.random()
    if path.suffix == ".parquet" and what < 0.5:
        try:
            table = pq.read_table(path)
        except Exception:  # damaged before
            return
        k = rng.randrange(table.num_columns)
        name, column = table.column_names[k], table.column(k)
        if rng.random() < 0.5:
            nulls = hostile_recordings.pa.nulls(table.num_rows, column.type)
            table = table.set_column(k, name, rng.choice((nulls, hostile_recordings.of(rng, table.num_rows))))
        else:
            table = rng.choice((table.drop_columns([name]), table.slice(0, 0), table.append_column(name, column)))
        pq.write_table(table, path)
    elif path.suffix == ".json" and what < 0.7:
        values = (None, [], {}, [{}], [1], "x", [{"id": 3}], [{"id": "x", "level": "local", "every": 1, "guest": {}}])
        path.write_text(json.dumps(rng.choice(values)))
    elif what < 0.8:
        raw = bytearray(path.read_bytes() or b"x")
        raw[rng.randrange(len(raw))] = rng.randrange(256)
        path.write_bytes(raw[: rng.randrange(len(raw))] if rng.random() < 0.3 else raw)
    elif what < 0.9:
        path.unlink()
    else:
        path.unlink()
        path.mkdir() if rng.random() < 0.5 else os.mkfifo(path)


@pytest.mark.slow
def test_outcomes_of_bench(tmp_path):
    whole = {"cases": [{"name": "x", "against": "y", "ratio": 1.0}], "startup": {"import_s": 1.0}, "peak_mb": 3.0,
             "detectors": [{"id": "x", "batch_us": 1.0}]}  # fmt: skip

    def made(rng):
        found = json.loads(json.dumps(whole))
        node = rng.choice([found, found["cases"][0], found["startup"], found["detectors"][0]])
        node[rng.choice(list(node))] = rng.choice([None, [], {}, "x", [1], 1e308, True, [{}], {"x": "y"}])
        (tmp_path / "case.json").write_bytes(encoded(rng, json.dumps(found)))
        return tmp_path / "case.json"

    tried("outcomes of bench", CASES // 10, made, [lambda p: compared(read_bench(p), whole)])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["logs", "scenarios", "maps", "campaign files", "recordings"])
def test_through_the_command(kind, flights, tmp_path):
    """The same, as a command in a process of its own: exit status 0, 1 or 2, no traceback, one line of an error."""
    logs = Logs(flights, tmp_path / "case.mcap")
    hostile_recordings.write_maps(tmp_path)
    hostile_recordings.write_whole(tmp_path / "whole.csv")
    scenario, campaign, map_ = (
        written(tmp_path / "case.toml", made)
        for made in (texts("scenarios"), texts("campaigns"), [hostile_recordings.MAP.format("")])
    )

    def log(rng):
        path = getattr(logs, rng.choice(("contents", "records", "mutated")))(rng)
        return rng.choice((["info", path], ["info", path, "--json"], ["report", path, "-o", "x.html"], ["replay", path],
                           ["replay", path, "-o", "x.mcap"], ["recover", path, "-o", "y.mcap"]))  # fmt: skip

    def recording(rng):
        name = rng.choice(("csv", "parquet", "mcap"))
        path = getattr(hostile_recordings, name)(rng, tmp_path)
        return ["replay", path, "--map", "bus.toml" if name == "mcap" else "map.toml", "-o", "x.mcap"]

    make = {
        "logs": log,
        "scenarios": lambda rng: ["run", scenario(rng), "-s", "duration_s=0.1", "-o", "x.mcap"],
        "maps": lambda rng: ["replay", "whole.csv", "--map", map_(rng)],
        "campaign files": lambda rng: ["campaign", campaign(rng), "--rerun", "none"],
        "recordings": recording,
    }[kind]
    ended, slowest, largest = Counter(), 0.0, 0
    with commands(tmp_path) as command:
        for number in range(SEED, SEED + max(20, CASES // 2)):
            args = make(random.Random(f"command {kind} {number}"))
            done = command(*args)
            ended[done.status] += 1
            slowest, largest = max(slowest, done.cpu_s), max(largest, done.largest)
            assert done.status in (0, 1, 2) and "Traceback" not in done.said, (kind, number, args, done)
            assert done.status != 2 or done.said.splitlines()[-1].startswith("error:"), (kind, number, args, done)
            assert done.cpu_s < LONGEST_S and done.largest < LARGEST, (kind, number, args, done)
    print(f"\ncommands, {kind}: {sum(ended.values())} cases, {dict(ended)}, slowest {slowest:.2f} s, largest "
          f"{largest / 1e6:.0f} MB")  # fmt: skip
