"""Hostile files at every door that reads them: a result or one line of an error, in bounded time and memory.

A few of each in every run; COSIM_CASES of each kind with new seeds:
`COSIM_CASES=2000 pytest -n 0 tests/test_hostile.py`.
"""

import os
import resource
import shutil
import signal
import zipfile
from contextlib import contextmanager, suppress
from importlib.resources import files
from pathlib import Path

import hypothesis
import pytest
import strategies
import technologies
from flight_point import POINT
from hypothesis import strategies as st

import cosim
from cosim.campaign.spec import load_campaign
from cosim.errors import CosimError
from cosim.parts import load
from cosim.replay.map import diagnose
from cosim.replay.map_draft import draft
from cosim.replay.map_file import load_map
from cosim.scenario import aircraft
from cosim.scenario.condition import condition

DATA = Path(__file__).parent / "data"
MANY = int(os.environ.get("COSIM_CASES", "0"))
LONGEST_S, MOST = 20.0, 300 << 20  # of the processor, and memory above what the process holds [byte]


class TooLongError(BaseException):
    """What no reader catches."""


def _too_long(*_):
    raise TooLongError(f"takes longer than {LONGEST_S} s")


def _peak():
    """Return the largest memory of this process [byte]."""
    with suppress(OSError):
        return 1024 * int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


@contextmanager
def bounded():
    """Let what is done take no more time of the processor, and no more memory above what the process holds."""
    for number in (signal.SIGALRM, signal.SIGPROF):
        signal.signal(number, _too_long)
    with suppress(OSError):  # what making the case took is not the readers'; where the system can (Linux)
        Path("/proc/self/clear_refs").write_text("5")
    before = _peak()
    signal.setitimer(signal.ITIMER_PROF, LONGEST_S)  # of this process: others may keep the machine busy
    signal.alarm(int(60 * LONGEST_S))  # for what waits
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.alarm(0)
    assert _peak() - before < MOST


def through(given, few, share=1.0):
    """Return what sends `few` cases, or COSIM_CASES x `share`, through doors(data)."""

    def case(data, doors):
        made = data.draw(given)
        for door in doors(data):
            with bounded():
                try:
                    door(made)
                except CosimError as error:
                    assert all(len(line) < 4100 for line in str(error).split("\n"))

    def run(doors):
        settings = hypothesis.settings(
            max_examples=round(MANY * share) or few, deadline=None, database=None, derandomize=not MANY,
            suppress_health_check=list(hypothesis.HealthCheck), phases=[hypothesis.Phase.generate],
            report_multiple_bugs=bool(MANY))  # fmt: skip
        settings(hypothesis.given(data=st.data())(lambda data: case(data, doors)))()

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
    maps = [(DATA / "foreign_map.toml").read_text(), strategies.MAP.format("")]
    strategies.write_whole(tmp_path / "whole.csv")

    def read(path):
        load_map(path)
        diagnose(tmp_path / "whole.csv", path)

    door = beside(tmp_path / "case.toml", read)
    through(strategies.texts(maps), 15, 0.25)(lambda data: [door])


PIECES = ("n_z", "t", "left_inner.rod", "rod", "truth.aircraft.nz", "fault.0.active", "fault.1.since", "fault.99999.x",
          "<", ">", "<=", ">=", "and", "or", "(", ")", "1", "-1e999", "1.2", "1_0", ".", "=", "==", "not", "nan", "é",
          "AND", "x" * 500, "a.b.c.d", "[0]", "n_z[0]", "-", "+1", "٣", "\u2028", "fault.٣.active", "#", "'",
          "(" * 100_000)  # fmt: skip


def test_conditions():
    likely = st.sampled_from(["n_z > 1.2", "left_inner.rod <= 0.01 and t > 1", "(t < 1 or t > 2)"])
    given = st.lists(likely | st.sampled_from(PIECES), min_size=1, max_size=8).map(" ".join)
    through(given, 60)(lambda data: [condition])


def test_tables_of_inputs(tmp_path):
    (tmp_path / "own.toml").write_text(POINT + '[manoeuvre]\nkind = "inputs"\nfile = "case.csv"\nbetween = "hold"\n')
    table = "\n".join(["time_s,stick,bank_deg", *(f"{k / 2},0.1,{k % 3}" for k in range(20))]).encode()
    cells = st.sampled_from([b"1e308", b"nan", b"", b"1e400", b"\x00", b"9" * 400, b"\xff", b'"', b"x" * 20_000, b";"])
    given = st.builds(lambda raw, old, new: raw.replace(old, new), strategies.spliced(table),
                      st.sampled_from([b"0.1", b"stick", b"1.5", b",2", b"\n"]), cells)  # fmt: skip
    door = beside(tmp_path / "case.csv", lambda path: cosim.load_scenario(tmp_path / "own.toml"))
    through(given, 30)(lambda data: [door])


def test_aircraft_records(tmp_path):
    whole, home = aircraft.load_aircraft().folder, tmp_path / "mine"
    shutil.copytree(whole, home)
    (home / f"{whole.name}.xml").rename(home / "mine.xml")
    door = beside(home / aircraft.RECORD, lambda path: aircraft.load_aircraft(str(home)))
    through(strategies.texts([(whole / aircraft.RECORD).read_text()]), 20, 0.25)(lambda data: [door])


def flown(tmp_path, table):
    """Fly an actuator of one's own in place of a segment's for a tenth of a second."""
    technologies.forget()
    told = [f"actuators.rig.{key}={strategies.toml(value)}" for key, value in table.items()]
    how = ["duration_s=0.1", "elevator.feedback=measured", *told, "elevator.left_inner=rig"]
    cosim.simulate(cosim.load_scenario("cruise", how), timed=False)


def test_detectors_and_actuators_of_ones_own(tmp_path):
    sources = [(DATA / name).read_bytes() for name in ("user_parts/counting.py", "template_detector.py")]
    given = st.sampled_from([*sources, b"\0" * 9, b"(" * 9000, b"-" * 90_000 + b"1", b""]).flatmap(strategies.spliced)
    doors = [load, lambda path: flown(tmp_path, {"file": str(path)})]
    through(given, 10, 0.1)(lambda data: [beside(tmp_path / "own.py", door) for door in doors])
    technologies.forget()


def test_fmus(tmp_path):
    pytest.importorskip("fmpy", reason="fmpy is an extra (fmu)")
    import fmu_of_hydraulic as rig

    if rig.COMPILER is None:
        pytest.skip("no C compiler on this machine")
    with zipfile.ZipFile(rig.build(tmp_path, 2)) as packed:
        held = {name: packed.read(name) for name in packed.namelist()}

    def door(case):
        parts, path = {**held, "modelDescription.xml": case[0]}, tmp_path / "case.fmu"
        parts[case[2]] = parts.pop(case[1])
        with zipfile.ZipFile(path, "w") as packed:
            for name, data in parts.items():
                packed.writestr(name, data)
        flown(tmp_path, {"fmu": str(path), **rig.MAP})

    names = st.sampled_from(sorted(held))
    xml = st.just(held["modelDescription.xml"]).flatmap(strategies.spliced)
    through(st.tuples(xml, names, names | st.sampled_from(["../../x", "/x", "é"])), 6, 0.1)(lambda data: [door])
    technologies.forget()


def test_recordings(tmp_path):
    strategies.write_maps(tmp_path)

    def read(case):
        path, map_ = case
        diagnose(path, tmp_path / map_, output=tmp_path / "out.mcap")

    through(strategies.recordings(tmp_path), 12, 0.25)(lambda data: [read, lambda case: draft(case[0])])
