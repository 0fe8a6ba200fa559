"""Hostile folders that commands keep, tables, inputs, conditions and parts of a user's; files are in test_hostile.py.

COSIM_CASES of each, where a case takes long a tenth (`pytest -m slow -s`).
"""

import copy
import json
import os
import random
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import commands
from flight_point import POINT
from hostile_doors import CASES, LARGEST, LONGEST_S, SEED, tried, written
from hostile_texts import encoded, mangled
from technologies import forget

import cosim
from cosim.campaign import jobs
from cosim.campaign.dataset import make
from cosim.campaign.run import run_campaign
from cosim.cli.bench import compared, read_bench
from cosim.compare import compare
from cosim.compare.false_alarms import false_alarms
from cosim.compare.score import BOARD, rows, stored
from cosim.compare.score import flights as benchmark
from cosim.compare.score.rows import differences
from cosim.flight.plugins import load
from cosim.report import comparison_report
from cosim.scenario import aircraft
from cosim.scenario.condition import condition

FEW = max(20, CASES // 10)
CELLS = ("0", "-1", "1e308", "nan", "inf", "true", "", "-", "é", "1e400", ";", '"', "\x00", "9" * 400, "1,5", "NaT",
         "x" * 20_000, '"a\nb"', "1_0", " 1 ", "\ufeff", "١")  # fmt: skip
STRANGE = (None, -1, 0, 1e308, "x", "", [], {}, [[]], 2**62, True, "é" * 99, "../../x", [None], {"x": {}}, float("nan"))
CAMPAIGN = """
base = "cruise"
runs = 2
seed = 3
[set]
duration_s = 2.0
"detectors.enabled" = ["position_monitor"]
"elevator.feedback" = "measured"
[draw]
"flight.mass_t" = { low = 200.0, high = 300.0 }
"""


def changed(rng, value):
    """Return plain data with something in it of another kind, or gone."""
    strange = copy.deepcopy(rng.choice(STRANGE))
    if not isinstance(value, dict | list):
        return strange
    node = value
    for _ in range(rng.randrange(6)):
        deeper = [v for v in (node.values() if isinstance(node, dict) else node) if isinstance(v, dict | list) and v]
        node = rng.choice(deeper) if deeper else node
    if not node:
        return strange
    key = rng.choice(list(node)) if isinstance(node, dict) else rng.randrange(len(node))
    if rng.random() < 0.2:
        del node[key]
    else:
        node[key] = strange
    return value if rng.random() < 0.8 else strange


def damaged(rng, path):
    """Damage one file of a folder: bytes, length, kind, or, of results, what they say, their digests right."""
    what = rng.random()
    if path.name == jobs.FILE and what < 0.6:
        code, values = jobs.stored(path.parent)
        for key in list(values):
            values[key] = changed(rng, values[key]) if rng.random() < 0.7 else values[key]
        jobs.keep(path.parent, rng.choice((code, code, code, "older")), values)
    elif path.suffix == ".json" and what < 0.6:
        path.write_text(json.dumps(changed(rng, json.loads(path.read_bytes()))))
    elif path.suffix == ".parquet" and what < 0.5:
        forged(rng, path)
    elif what < 0.8:
        raw = bytearray(path.read_bytes() or b"x")
        raw[rng.randrange(len(raw))] = rng.randrange(256)
        path.write_bytes(raw[: rng.randrange(len(raw))] if rng.random() < 0.3 else raw)
    else:
        path.unlink()
        if what > 0.9:
            path.mkdir() if rng.random() < 0.5 else os.mkfifo(path)


def forged(rng, path):
    """Change a table and, where results say so, its digest with it."""
    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError):  # damaged before
        return
    k, about = rng.randrange(table.num_columns), dict(table.schema.metadata or {})
    told = json.loads(about.get(b"cosim", b"{}"))
    what = rng.random()
    if what < 0.4 and told:
        about[b"cosim"] = json.dumps(changed(rng, told)).encode()
        table = table.replace_schema_metadata(about)
    elif what < 0.7:
        other = rng.choice((pa.nulls(table.num_rows, table.schema.types[k]), pa.array(["x"] * table.num_rows),
                            pa.array([float("nan")] * table.num_rows), pa.array(range(table.num_rows))))  # fmt: skip
        table = table.set_column(k, table.column_names[k], other)
    else:
        table = rng.choice((table.drop_columns([table.column_names[k]]), table.slice(0, 0), table.slice(0, 1),
                            table.append_column(table.column_names[k], table.column(k))))  # fmt: skip
    pq.write_table(table, path)
    file = path.parent / jobs.FILE
    if file.is_file():
        code, values = jobs.stored(path.parent)
        for key, value in values.items():
            if path.stem in key:
                values[key] = {**value, "sha256": benchmark.hashlib.sha256(path.read_bytes()).hexdigest()}
        jobs.keep(path.parent, code, values)


def folders(whole, out):
    """Return what makes a damaged copy of the folder `whole` at `out`."""

    def made(rng):
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(whole, out)
        for _ in range(rng.choice((1, 1, 2))):
            there = [p for p in sorted(out.rglob("*")) if p.is_file()]
            if there:
                damaged(rng, rng.choice(there))
        return out

    return made


@pytest.fixture
def few(tmp_path):
    """Return a campaign file of two flights of 2 s."""
    (tmp_path / "few.toml").write_text(CAMPAIGN)
    return tmp_path / "few.toml"


@pytest.mark.slow
def test_folders_of_false_alarms_and_data_sets(few, tmp_path):
    def alarms(out):
        false_alarms(hours=4.0 / 3600, campaign=str(few), detectors=["position_monitor"], folder=out, workers=0)

    def data_set(out):
        make(few, out, signals=["q", "rod"], workers=0)

    for kind, door in (("false-alarms", alarms), ("data set", data_set)):
        door(tmp_path / kind)
        tried(f"folders, {kind}", FEW, folders(tmp_path / kind, tmp_path / "case"), [door, door])


@pytest.mark.slow
def test_recordings_of_the_score(tmp_path, monkeypatch):
    s = cosim.load_scenario("liquid-ofc", ["duration_s=1", "faults.0.start_s=0.5", "elevator.feedback=measured"])
    two = [(f"{i}" * 16, "ofc", s.model_copy(update={"seed": i}).expanded_toml()) for i in (1, 2)]
    monkeypatch.setattr(benchmark, "scenarios", lambda seeds: two)

    def door(out):
        flown = benchmark.flown(benchmark.seeds_of(), folder=out, workers=0)
        monkeypatch.setattr(rows, "finished", lambda calls, **how: ((key, f(*given)) for key, f, given in calls))
        rows.scored(flown, ["iotsekf", "position_monitor"], workers=0)

    door(tmp_path / "whole")
    tried("folders, recordings of the score", FEW, folders(tmp_path / "whole", tmp_path / "case"), [door, door])


@pytest.mark.slow
def test_tables_and_seeds_of_the_score(tmp_path):
    whole, path = json.loads(BOARD.read_text()), tmp_path / "case.json"

    def table(rng):
        found = json.loads(BOARD.read_text())
        for _ in range(rng.choice((1, 3))):
            found = changed(rng, found) if found and isinstance(found, dict | list) else found
        path.write_bytes(encoded(rng, json.dumps(found)))
        return path

    def repeated(given):
        held = stored(given)
        differences(held.table, whole, [d["id"] for d in whole["detectors"] if d["id"] in held.detectors])

    tried("tables of the score", CASES, table, [repeated])
    seeds = written(tmp_path / "seeds.toml", ["seed = 3\nfirst_seed = 2000000\n"])
    tried("seeds of the score", CASES, seeds, [benchmark.seeds_of])


@pytest.mark.slow
def test_tables_of_inputs(tmp_path):
    header = ["time_s,stick,bank_deg,throttle_change", *(f"{k / 2},0.1,{k % 3},0.01" for k in range(20))]
    (tmp_path / "own.toml").write_text(POINT + '[manoeuvre]\nkind = "inputs"\nfile = "case.csv"\nbetween = "hold"\n')

    def made(rng):
        lines = list(header)
        for _ in range(rng.choice((1, 1, 3))):
            k = rng.randrange(len(lines))
            cells = lines[k].split(",")
            cells[rng.randrange(len(cells))] = rng.choice((*CELLS, "stick", "time_s", "nz_g"))
            lines[k] = rng.choice((",".join(cells), ",".join(cells), lines[0], "", '"' + lines[k], lines[k] + ",1"))
        (tmp_path / "case.csv").write_bytes(encoded(rng, rng.choice(("\n", "\n", "\r", "\r\n")).join(lines)))
        return tmp_path / "own.toml"

    tried("tables of inputs", CASES, made, [cosim.load_scenario])


@pytest.mark.slow
def test_campaign_folders(few, tmp_path):
    assert run_campaign(few, out=tmp_path / "whole", workers=0).done == 2
    (tmp_path / "whole" / "guests.json").write_text("[]")

    def page(out):
        comparison_report(compare([out]), tmp_path / "page.html")

    def resumed(out):
        run_campaign(few, out=out, workers=0, resume=True)

    tried("campaign folders", FEW, folders(tmp_path / "whole", tmp_path / "case"), [page, resumed, page])


@pytest.mark.slow
def test_outcomes_of_bench(tmp_path):
    whole = {"cases": [{"name": "x", "against": "y", "ratio": 1.0}], "startup": {"import_s": 1.0}, "peak_mb": 3.0,
             "detectors": [{"id": "x", "batch_us": 1.0}]}  # fmt: skip

    def made(rng):
        (tmp_path / "case.json").write_bytes(encoded(rng, json.dumps(changed(rng, copy.deepcopy(whole)))))
        return tmp_path / "case.json"

    tried("outcomes of bench", FEW, made, [lambda p: compared(read_bench(p), whole)])


PIECES = ("n_z", "t", "left_inner.rod", "rod", "truth.aircraft.nz", "fault.0.active", "fault.1.since",
          "fault.99999.x",
          "<", ">", "<=", ">=", "and", "or", "(", ")", "1", "-1e999", "1.2", "1_0", ".", "=", "==", "not", "nan", "é",
          "AND", "x" * 500, "a.b.c.d", "[0]", "n_z[0]", "-", "+1", "٣", "\u2028",
          "fault.٣.active", "#", "'")  # fmt: skip


@pytest.mark.slow
def test_conditions():
    def made(rng):
        deep = rng.choice((0, 0, 0, 3, 500, 100_000))
        words = ["n_z", ">", "1.2", *rng.choice(([], ["and", "t", ">", "1"]))]
        words[0] = rng.choice(("n_z", "t", *PIECES))
        for _ in range(rng.choice((0, 0, 1, 2, 5))):
            words.insert(rng.randrange(len(words) + 1), rng.choice(PIECES))
        text = "(" * deep + " ".join(words) + ")" * rng.choice((deep, deep, max(0, deep - 1)))
        return text if rng.random() < 0.9 else " or ".join([text] * max(1, 200_000 // len(text)))

    def flown(text):
        said = json.dumps(text)
        cosim.load_scenario("liquid-ofc", ["duration_s=0.2", f"faults.0.when={said}"])

    tried("conditions", CASES, made, [condition, flown])


@pytest.mark.slow
def test_detectors_and_actuators_of_ones_own(tmp_path):
    here = Path(__file__).parent / "data"
    sources = [p.read_text() for p in (*(here / "guests").glob("counting.py"), here / "template_detector.py")]

    def detector(rng):
        path = tmp_path / "guest.py"
        text = mangled(rng, rng.choice(sources))
        path.write_bytes(rng.choice((encoded(rng, text),) * 9 + (b"\0" * 9, b"(" * 9000, b"-" * 90_000 + b"1", b"")))
        return path

    def rigged(path):
        forget()
        told = ["elevator.left_inner=rig", f"actuators.rig.file={str(path)!r}", "elevator.feedback=measured"]
        setup = cosim.load_scenario("cruise", ["duration_s=0.1", *told])
        cosim.simulate(setup, timed=False)

    try:
        tried("detectors of one's own", FEW, detector, [load, rigged])
    finally:
        forget()


@pytest.mark.slow
def test_fmus(tmp_path):
    pytest.importorskip("fmpy", reason="fmpy is an extra (fmu)")
    import fmu_of_hydraulic as rig

    if rig.COMPILER is None:
        pytest.skip("no C compiler on this machine")
    whole = rig.build(tmp_path, 2)
    with zipfile.ZipFile(whole) as packed:
        held = {n: packed.read(n) for n in packed.namelist()}

    def made(rng):
        path, parts = tmp_path / "case.fmu", dict(held)
        if rng.random() < 0.7:
            xml = mangled(rng, parts["modelDescription.xml"].decode())
            parts["modelDescription.xml"] = encoded(rng, xml)
        else:
            del parts[rng.choice(list(parts))]
            parts[rng.choice(("../../x", "/x", "binaries", "é", "modelDescription.xml"))] = b"<x/>"
        with zipfile.ZipFile(path, "w", rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as packed:
            for name, data in parts.items():
                packed.writestr(name, data)
        if rng.random() < 0.2:
            path.write_bytes(path.read_bytes()[: rng.randrange(path.stat().st_size)])
        return path

    def flown(path):
        forget()
        table = {"fmu": str(path), **rig.MAP}
        told = [f"actuators.rig.{k}={_inline(v)}" for k, v in table.items()]
        s = cosim.load_scenario(
            "cruise", ["duration_s=0.1", "elevator.feedback=measured", *told, "elevator.left_inner=rig"]
        )
        cosim.simulate(s, timed=False)

    try:
        tried("FMUs", FEW, made, [flown])
    finally:
        forget()


def _inline(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k} = '{v}'" for k, v in value.items()) + "}"
    return f"'{value}'" if isinstance(value, str) else str(value)


FLY = "import cosim; print(cosim.simulate(cosim.load_scenario('cruise', ['duration_s=0.1']), timed=False).status)"


@pytest.mark.slow
def test_what_is_kept_of_kernels_and_designs(tmp_path):
    """A cache that a power cut has left half written costs time, no flight; every case is a process of its own."""
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "case")}
    whole = tmp_path / "whole"
    subprocess.run([sys.executable, "-c", FLY], check=True, env=env | {"NUMBA_CACHE_DIR": str(whole)})
    for number in range(SEED, SEED + max(6, CASES // 50)):
        rng = random.Random(f"cache {number}")
        shutil.rmtree(tmp_path / "case", ignore_errors=True)
        shutil.copytree(whole, tmp_path / "case")
        held = [p for p in sorted((tmp_path / "case").rglob("*")) if p.is_file()]
        kinds = sorted({p.suffix for p in held})
        kind = rng.choice(kinds)
        for path in [p for p in held if p.suffix == kind][:: rng.choice((1, 2, 5))]:
            raw = bytearray(path.read_bytes() or b"x")
            raw[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
            path.write_bytes(rng.choice((b"", bytes(raw), raw[: rng.randrange(len(raw))], bytes(len(raw)), b"null")))
        done = subprocess.run([sys.executable, "-c", FLY], capture_output=True, text=True, env=env, timeout=600)
        assert done.returncode == 0 and done.stdout == "completed\n", (number, kind, done.stderr[-800:])


@pytest.mark.slow
def test_aircraft_folders(tmp_path):
    home = tmp_path / "mine"
    whole = aircraft.load_aircraft().folder

    def copied(rng, ending):
        shutil.rmtree(home, ignore_errors=True)
        shutil.copytree(whole, home)
        (home / f"{whole.name}.xml").rename(home / "mine.xml")
        path = rng.choice(sorted(home.rglob(f"*.{ending}")))
        path.write_bytes(encoded(rng, mangled(rng, path.read_text())))
        return home

    def record(path):
        aircraft.load_aircraft(str(path))

    tried("aircraft records", FEW, lambda rng: copied(rng, "toml"), [record])
    with commands(tmp_path) as command:  # what JSBSim's own code makes of a model
        for number in range(SEED, SEED + FEW):
            copied(random.Random(f"model {number}"), "xml")
            done = command("linearize", "-s", f"flight.aircraft={home}")
            assert done.status in (0, 1, 2) and "Traceback" not in done.said, (number, done)
            assert done.cpu_s < LONGEST_S and done.largest < LARGEST, (number, done)
