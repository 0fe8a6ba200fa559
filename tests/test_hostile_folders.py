"""Hostile tables, inputs, conditions and parts of a user's; files are in test_hostile.py.

COSIM_CASES of each, where a case takes long a tenth (`pytest -m slow -s`).
"""

import json
import os
import random
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from commands import commands
from flight_point import POINT
from hostile_doors import CASES, LARGEST, LONGEST_S, SEED, tried
from hostile_texts import encoded, mangled
from technologies import forget

import cosim
from cosim.parts import load
from cosim.scenario import aircraft
from cosim.scenario.condition import condition

FEW = max(20, CASES // 10)
CELLS = ("0", "-1", "1e308", "nan", "inf", "true", "", "-", "é", "1e400", ";", '"', "\x00", "9" * 400, "1,5", "NaT",
         "x" * 20_000, '"a\nb"', "1_0", " 1 ", "\ufeff", "١")  # fmt: skip


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
    sources = [p.read_text() for p in (*(here / "user_parts").glob("counting.py"), here / "template_detector.py")]

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
