"""The score: a detector on a recording gives what it gave in the flight, row for row; recordings resume and repeat."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

import cosim
from cosim.campaign import jobs, store
from cosim.campaign.worker import fly
from cosim.cli import commands as cli
from cosim.compare.paired import bootstrap, pair
from cosim.compare.score import BOARD, board, named, score, stored
from cosim.compare.score import flights as benchmark
from cosim.compare.score import rows as score_rows
from cosim.compare.score.rows import UNSAID, differences, log_score
from cosim.errors import CampaignError, LogError, OutputError
from cosim.flight.plugins import with_detectors
from cosim.judge.row import rows
from cosim.replay import benchmark_recording
from cosim.report import score_report, write_score
from cosim.report.score_page import front, write_readme
from cosim.report.score_page import render as scored_page
from cosim.scenario import load_scenario
from fdi.registry import DEFAULT

PLAIN = """
class Rough:
    id, level, technologies, inputs = "rough", "local", ("hydraulic",), ("rod", "valve_command", "surface")
    designed_for, every = ("ofc_liquid", "rod"), 2

    def __init__(self, dt):
        self.last, self.level = None, 0.0

    def update(self, t, y):
        moved = 0.0 if self.last is None else abs(y.rod - self.last - 0.005 * y.valve_command)
        self.last, self.level = y.rod, max(0.99 * self.level, moved / 4e-4)
        p = min(1.0, self.level / 2.0)
        return {"r": self.level, "alarm": self.level > 1.0, "estimate": y.valve_command,
                "verdict": {"none": 1.0 - p, "ofc_liquid": p}}
"""
FLIGHTS = {  # one for each way in which something enters: valve, command, loop, observers' copy, drive, engine, none
    "liquid-ofc": ["faults.0.start_s=4"],
    "elevator-bias": ["faults.0.start_s=4"],
    "rod-dropout": ["faults.0.start_s=4", "faults.0.end_s=6"],
    "jay-incipient-current": ["faults.0.start_s=4"],
    "alwi14-simultaneous": [],
    "engine-thrust-loss": ["faults.0.start_s=4"],
    "cruise": [],
}


@pytest.mark.parametrize("name", ["manifest.json", "results.jsonl"])
def test_recordings_do_not_overwrite_a_foreign_file(name, tmp_path):
    (tmp_path / name).write_text('{"name": "mine"}')
    with pytest.raises(OutputError, match=f"{name}: holds something else"):
        benchmark.flown(benchmark.seeds_of(), limit=1, folder=tmp_path, workers=0)
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [(name, '{"name": "mine"}')]


@pytest.fixture
def guest(tmp_path):
    path = tmp_path / "rough.py"
    path.write_text(PLAIN)
    return str(path)


def equal(a, b):
    nothing = [x is None or x != x for x in (a, b)]
    return all(nothing) or (not any(nothing) and a == b)


@pytest.mark.parametrize("name", FLIGHTS)
def test_on_a_recording_a_detector_gives_the_rows_of_the_flight(name, tmp_path, guest):
    given = [*FLIGHTS[name], "duration_s=9", "elevator.feedback='measured'", "elevator.reconfigure=false"]
    scenario = load_scenario(name, given)
    every = scenario.model_copy(update={"detectors": scenario.detectors.model_copy(update={"enabled": DEFAULT})})
    in_flight, _ = fly("x", with_detectors(every, [guest]), True)
    told = benchmark_recording.record(scenario, tmp_path / "x.parquet")
    recording = benchmark_recording.Recording(tmp_path / "x.parquet", told["sha256"])
    lanes = list(
        benchmark_recording.judgement(
            recording, benchmark_recording.flown_with(recording, DEFAULT, [guest]), timed=False
        )
    )
    here = rows("x", {**recording.about, "detectors": [lane.entry for lane in lanes]})
    assert len(here) == len(in_flight) >= len(DEFAULT)
    pairs = [(r["id"], r["target"], k, r[k], f[k]) for r, f in zip(here, in_flight) for k in f]
    assert [p for p in pairs if not equal(*p[3:])] == []
    assert any(r["alarm"] for r in here)


def test_a_recording_repeats_and_a_damaged_one_is_flown_again(tmp_path):
    scenario = load_scenario("cruise", ["duration_s=3", "elevator.feedback='measured'"])
    path = tmp_path / "x.parquet"
    told = benchmark_recording.record(scenario, path)
    assert benchmark_recording.record(scenario, tmp_path / "y.parquet")["content"] == told["content"]
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(LogError, match="digest differs"):
        benchmark_recording.Recording(path, told["sha256"])
    assert benchmark_recording.again(path, scenario.expanded_toml(), told["sha256"]).ticks == 600
    with pytest.raises(LogError, match="closes on a detector"):
        benchmark_recording.record(load_scenario("cruise", ["elevator.feedback='iotsekf'"]), path)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    benchmark.flown(benchmark.seeds_of(), limit=4, folder=folder, workers=0)
    return folder


def test_the_benchmark_resumes_scores_and_repeats(recordings, tmp_path, monkeypatch, guest):
    flown = []
    monkeypatch.setattr(benchmark_recording, "record", lambda *a: flown.append(a))
    monkeypatch.setattr(score_rows, "finished", lambda calls, **_: ((key, f(*given)) for key, f, given in calls))
    made = score(["iotsekf", guest], limit=4, recordings=recordings, workers=0)
    found = made.table
    assert not flown, "what is there is not flown again"
    assert [d["id"] for d in found["detectors"]] == ["iotsekf", "rough"] and found["flights"] == 4
    assert found["bytes"] < 4 * 2e9 / 642
    rough = found["detectors"][1]
    assert rough["log_none"] < 0.0 and found["detectors"][0]["log_none"] is None
    assert sum(f["flights"] for f in rough["families"]) >= rough["designed"]
    table = tmp_path / "score.json"
    write_score(found | {}, made.found.rows, tmp_path)
    assert str(tmp_path) not in table.read_text(), "a table to share says nothing of where it was made"
    line = ["score", "--verify", str(table), "iotsekf", guest, "--recordings", str(recordings)]
    said = CliRunner().invoke(cli.app, [*line, "-o", str(tmp_path)])
    assert (said.exit_code, said.output) == (0, "every row repeats\n")
    page = score_report(found, tmp_path / "score.html").read_text(encoding="utf-8")
    assert all(f"<code>{name}</code>" in page for name in ("iotsekf", "rough")) and found["content"] in page
    readme = tmp_path / "README.md"
    readme.write_text("<!-- score: begin -->\n<!-- score: end -->\n")
    write_readme(found, readme)
    assert "| `rough` | rod, surface, valve_command | " in readme.read_text(encoding="utf-8")
    other = json.loads(table.read_text())
    other["detectors"][0]["families"][0]["flights"] = 99
    assert differences(other, found, ["iotsekf"]) == ["iotsekf: families[0].flights = 99 stored, 1 here"]


HOSTILE = """
import os

class Hostile:
    id, level, technologies, inputs = "hostile", "local", ("hydraulic",), ("rod",)

    def __init__(self, dt):
        pass

    def update(self, t, y):
        if t > 1.0:
            os._exit(7)
"""


def test_a_detector_that_ends_its_process_is_not_scored_and_the_others_are(recordings, tmp_path):
    hostile = tmp_path / "hostile.py"
    hostile.write_text(HOSTILE)
    made = score(["ofc_monitor", str(hostile)], limit=4, recordings=recordings, workers=0).table
    assert [d["id"] for d in made["detectors"]] == ["ofc_monitor"] and made["detectors"][0]["designed"]
    assert made["lost"] == [{"file": str(hostile), "why": "ended its process with exit status 7 at question 1 of 10"}]


def test_recordings_of_other_code_are_taken_over_where_they_repeat(recordings, tmp_path):
    home, todo = tmp_path / "other", benchmark.chosen(benchmark.scenarios(benchmark.seeds_of()), 4)
    shutil.copytree(recordings, home)
    held = (home / "results.jsonl").read_text().splitlines()
    assert benchmark.adopt(home, todo) is None
    (home / "results.jsonl").write_text("\n".join(['{"code": "older"}', *held[1:]]) + "\n")
    assert benchmark.adopt(home, todo) is True and (home / "results.jsonl").read_text().splitlines() == held
    others = {k: {**v, "content": v["content"][::-1]} if "content" in v else v for k, v in jobs.stored(home)[1].items()}
    jobs.keep(home, "older", others)
    assert benchmark.adopt(home, todo) is False
    damaged = [line.replace('"content": "', '"content": "0') for line in held[1:]]
    (home / "results.jsonl").write_text("\n".join(['{"code": "older"}', *damaged]) + "\n")
    assert benchmark.adopt(home, todo) is None


def test_sealed_seeds_make_other_flights_and_are_not_told(tmp_path):
    file = tmp_path / "seeds.toml"
    file.write_text("seed = 7\nfirst_seed = 1900000\n")
    seeds = benchmark.seeds_of(file)
    ours, theirs = (benchmark.scenarios(s) for s in (benchmark.seeds_of(), seeds))
    assert len(ours) == len(theirs) == 642 and not {r for r, *_ in ours} & {r for r, *_ in theirs}
    told = json.dumps(benchmark.manifest(seeds, []))
    assert "1900000" not in told and seeds.digest in told
    file.write_text("seed = -1\n")
    with pytest.raises(CampaignError, match="holds no seeds"):
        benchmark.seeds_of(file)


def test_names_that_are_none_are_refused():
    with pytest.raises(CampaignError, match="Did you mean 'iotsekf'"):
        named(["iotsef"])


def test_the_log_score_is_what_was_given_to_the_truth():
    told = [(10, {"none": 0.9, "sensor": 0.1}), (20, {"none": 0.2, "sensor": 0.8})]
    assert log_score(told, ("sensor",), 10, 30) == pytest.approx(0.5 * (math.log(0.1) + math.log(0.8)))
    assert log_score(told, ("none", "sensor"), 10, 30) == pytest.approx(0.0)
    assert log_score(told, ("sensor",), 0, 10) == pytest.approx(UNSAID)
    assert log_score(told, ("sensor",), 5, 5) is None
    assert log_score([(0, {"a": 0.8, "b": 0.7})], ("a", "b"), 0, 1) == 0.0  # more than certain earns nothing
    rng, p = np.random.default_rng(3), 0.3  # proper: on average nothing scores better than the truth
    hits = rng.random(20_000) < p
    each = {q: [log_score([(0, {"a": q, "b": 1 - q})], c, 0, 1) for c in ("b", "a")] for q in (0.2, 0.3, 0.4)}
    mean = {q: np.mean(np.array(both)[hits.astype(int)]) for q, both in each.items()}
    assert mean[0.3] > mean[0.2] and mean[0.3] > mean[0.4]


def sample(seen_a, seen_b):
    n = len(seen_a)
    both = []
    for name, seen in (("a", seen_a), ("b", seen_b)):
        both.append(pd.DataFrame({
            "run": [f"r{i}" for i in range(n)], "fault": 0, "case": "x", "concerned": True, "word": "designed",
            "id": name, "detected": seen, "delay_s": np.where(seen, 1.0 if name == "a" else 2.0, np.nan),
            "r_fault": 2.0, "r_fault_free": np.nan,
        }))  # fmt: skip
    return pd.concat(both, ignore_index=True)


def test_two_detectors_are_compared_on_the_same_flights():
    a, b = np.arange(40) < 30, np.arange(40) < 20
    end = pd.Series(10.0, index=[f"r{i}" for i in range(40)])
    (found,) = pair(sample(a, b), "a", "b", end)
    assert (found.n, found.only_a, found.only_b) == (40, 10, 0)
    assert found.p == pytest.approx(2 * 0.5**10)  # all of ten discordant flights on one side
    assert found.difference == 0.25 and found.low < 0.25 < found.high
    assert found.later_s == pytest.approx((20 * -1.0 + 10 * -9.0) / 40)


def test_the_bootstrap_interval_covers_the_mean():
    rng = np.random.default_rng(5)
    inside = [low <= 0.1 <= high for low, high in (bootstrap(rng.normal(0.1, 1.0, 60)) for _ in range(300))]
    assert 0.91 <= np.mean(inside) <= 0.98


def test_a_table_or_a_recording_that_is_none_is_one_line(tmp_path):
    whole, path = json.loads(BOARD.read_text()), tmp_path / "score.json"
    nonsense = ({"flights": "x"}, {"flights": 0}, {"detectors": [[]]}, {"detectors": [{"id": []}]}, {"seeds": None})
    for change in nonsense:
        path.write_text(json.dumps(whole | change))
        with pytest.raises(CampaignError, match="is no table"):
            stored(path)
    assert stored(BOARD).limit is None and not {"table", "report"} & set(whole)  # no paths of whoever scored it
    about = {
        "status": "completed", "reason": "", "sim_time_s": 1.0, "achieved": {}, "consequences": None, "scenario": "",
    }  # fmt: skip
    column = pa.array([0.0, 1.0])
    for told, held in (
        (about | {"achieved": []}, column),
        (about | {"status": 3}, column),
        ([], column),
        (about, pa.array(["a"])),
    ):
        table = pa.table({"q": held}).replace_schema_metadata({benchmark_recording.ABOUT: json.dumps(told)})
        pq.write_table(table, tmp_path / "x.parquet")
        with pytest.raises(LogError, match="no thin recording"):
            benchmark_recording.Recording(tmp_path / "x.parquet")
    pq.write_table(
        pa.table({"q": column}).replace_schema_metadata({benchmark_recording.ABOUT: json.dumps(about)}),
        tmp_path / "x.parquet",
    )
    assert benchmark_recording.Recording(tmp_path / "x.parquet").column("q").tolist() == [0.0, 1.0]


def test_recordings_are_told_from_those_of_other_code_that_flies(monkeypatch):
    asked, whole = [], store.closure
    monkeypatch.setattr(store, "closure", lambda path: asked.append(whole(path)) or asked[-1])
    benchmark.code.__wrapped__()
    root = Path(cosim.__file__).parent
    assert {root / "flight" / "tick.py", root / "flight" / "blocks" / "sensors.py"} <= set().union(*asked)


def test_a_look_says_of_how_many_flights_and_shows_no_empty_sizes():
    table = json.loads(BOARD.read_text())
    assert scored_page(table | {"of": table["flights"]}).count("How large a fault must be") == 1
    few = table | {"of": table["flights"], "flights": 40}
    none = dict.fromkeys(("a90", "low", "a90_95"))
    few["detectors"] = [{**d, "families": [{**f, **none} for f in d["families"]]} for d in table["detectors"]]
    page = scored_page(few)
    assert f"40 of the {table['flights']} flights recorded" in page
    assert "too few for a curve of any family" in page and "Size at which 90 % are seen" not in page


def test_rates_within_a_decade_have_more_than_one_tick_and_seeds_are_said_once():
    table = json.loads(BOARD.read_text())
    for high in (20.4, 25.0, 0.9):
        each = [{**d, "false_alarms_per_hour_high": high} for d in table["detectors"]]
        axis = front(each).layout["xaxis2"]
        low, top = axis["range"]
        assert sum(low <= math.log10(v) <= top for v in axis["tickvals"]) >= 3
    page = scored_page(table | {"of": table["flights"], "seeds": {"seed": 1001, "first_seed": 7}})
    assert ", seed 1001, first seed 7," in page


def test_the_stored_table_stands_beside_flights_of_the_same_code():
    table = json.loads(BOARD.read_text())
    made = {key: table[key] for key in ("content", "digest", "flights")}
    assert board(made) == board({**made, "content": "of another machine"}) == table["detectors"]
    assert board({**made, "flights": 20}) == board({**made, "content": "other", "digest": "other"}) == []
