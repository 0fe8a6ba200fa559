"""The command line: exit status, one clear line for every mistake, JSON and nothing else on standard output."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.cli import commands as cli
from cosim.judge.result import Result
from cosim.scenario import builtin_names, load_scenario

ROW = {
    "id": "iotsekf",
    "level": "local",
    "target": "elevator.left_inner",
    "concerned": True,
    "alarm": True,
    "detected_at_s": 12.4,
    "detection_delay_s": 0.4,
    "detection_delay_periods": 0.4,
    "isolated": {"class": "ofc_liquid", "target": "elevator.left_inner"},
    "false_alarms": 0,
    "standing_s": 0.0,
    "estimate_rmse": None,
    "estimate_bias": None,
    "step_us": 1.5,
}
NOTHING = dict.fromkeys(("detected_at_s", "isolated", "detection_delay_s", "detection_delay_periods"))
QUIET = {**ROW, **NOTHING, "target": "elevator.right_inner", "concerned": False, "alarm": False}


def outcome(status="completed", reason=""):
    fault = {"kind": "ofc_liquid", "target": "elevator.left_inner", "start_s": 12.0}
    return Result("x.mcap", status, reason, 30.0, 0.1, [fault], [ROW, QUIET])


@pytest.fixture
def flown(monkeypatch, tmp_path):
    """Replace the flight by a function that records its call; the command line around it is real."""
    calls = []

    def fake(scenario, *, log=None, progress=None, **options):
        calls.append((scenario, log))
        progress(1.0, scenario.duration_s)
        made = fake.outcome
        if isinstance(made, BaseException):
            raise made
        return made

    fake.outcome, fake.calls = outcome(), calls
    monkeypatch.setattr("cosim.simulate", fake)
    monkeypatch.chdir(tmp_path)
    return fake


def cosim(*args):
    return CliRunner().invoke(cli.app, [str(a) for a in args])


def refused(result, *says):
    """Assert one line on standard error that says it all, nothing on standard output, and the exit status."""
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    lines = [line for line in result.stderr.splitlines() if not line.startswith("note:")]
    assert len(lines) == 1, result.stderr
    for part in says:
        assert str(part) in lines[0]


def test_run_says_who_noticed_where_the_log_is_and_what_comes_next(flown):
    result = cosim("run")
    lines = result.stdout.splitlines()
    assert result.exit_code == 0 and lines[0].startswith("ofc_liquid on elevator.left_inner from 12 s")
    assert "first alarm after 0.40 s by iotsekf (actuator level)" in " ".join(" ".join(lines[:3]).split())
    assert "1 other lanes: no alarm" in result.stdout and "overwritten" not in result.stdout
    assert lines[-1] == "next   cosim report x.mcap" and flown.calls[0][1] == Path("logs/liquid-ofc.mcap")


def test_a_variant_has_a_log_of_its_own_and_overwriting_is_told(flown, tmp_path):
    cosim("run", "cruise", "--set", "seed=7", "-s", "duration_s=2", "-o", tmp_path / "a" / "b.mcap")
    scenario, log = flown.calls[-1]
    assert (scenario.seed, scenario.duration_s, log) == (7, 2.0, tmp_path / "a" / "b.mcap")
    cosim("run", "-s", "faults.0.frequency_hz=3")
    assert flown.calls[-1][1] == Path("logs/liquid-ofc+faults.0.frequency_hz=3.mcap")
    cosim("run", "-s", "title=a/b c")
    assert flown.calls[-1][1].parent == Path("logs")
    cosim("run", *[x for i in range(40) for x in ("-s", f"seed={i}")])
    assert len(flown.calls[-1][1].name) < 120
    Path("logs/liquid-ofc.mcap").write_bytes(b"\x89MCAP0\r\n cosim-log 1 old")
    assert "overwritten" in cosim("run").stdout


def test_json_is_one_object_and_nothing_else(flown):
    result = cosim("run", "--json", "--set", "duration_s=5")
    found = json.loads(result.stdout)
    assert {"log", "status", "sim_time_s", "wall_time_s", "realtime_factor", "faults", "detectors"} <= found.keys()
    assert "after the flight's end" in result.stderr


STRICT = {"completed": 0, "departed": 1, "diverged": 1, "interrupted": 130}


@pytest.mark.parametrize(
    ("status", "strict", "code"), [("departed", False, 0), *((s, True, x) for s, x in STRICT.items())]
)
def test_exit_status(flown, status, strict, code):
    flown.outcome = outcome(status, reason="alpha is beyond the table")
    result = cosim("run", *["--strict"] * strict)
    assert result.exit_code == code
    assert status in result.stdout


def test_what_cannot_be_flown_read_or_written_is_one_line_and_status_2(flown, tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "x.mcap").write_bytes(b"")
    own = tmp_path / "own.toml"
    own.write_text("[flight]\nmass_t = 200\ncg_pct = 30\naltitude_ft = 20000\ncas_kt = 290\n")
    for words, *says in (
        (["run", "nope"], "nope", "cosim list"), (["run", tmp_path], tmp_path, "folder"),
        (["run", tmp_path / "file", "--json"], "file", "flight"),
        (["run", "--set", "flight.mas_t=3"], "flight.mas_t", "Did you mean 'mass_t'?"),
        (["run", "-o", tmp_path / "file" / "x.mcap"], "folder is a file"), (["run", "-o", "."], "is a folder"),
        (["run", "-o", "/proc/x.mcap"], "/proc/x.mcap", "cannot be written"),
        (["run", "-o", "/dev/null"], "/dev/null", "no regular file"),
        (["run", own, "-o", own], "is there already"),
        (["info", tmp_path / "no.mcap"], "no.mcap"), (["info", tmp_path], tmp_path),
        (["info", tmp_path / "x.mcap"], "x.mcap"), (["recover", "."], "is a folder"),
    ):  # fmt: skip
        refused(cosim(*words), *says)
    assert flown.calls == [] and "mass_t" in own.read_text()


def test_a_bug_is_not_disguised_as_bad_input(flown):
    flown.outcome = RuntimeError("a bug")
    result = cosim("run")
    assert result.exit_code == 1 and isinstance(result.exception, RuntimeError)


def test_list_begins_with_its_topics_and_all_names_everything():
    topics = cosim("list")
    assert topics.exit_code == 0 and len(topics.stdout.splitlines()) < 24
    for part in ("scenarios", "tolerances", "signals", "examples"):
        assert part in topics.stdout
    result = cosim("list", "all")
    assert result.exit_code == 0
    for part in ("liquid-ofc", "nz_doublet", "jam_solid", "winding_resistance", "sensor.<name>", "control_redundancy"):
        assert part in result.stdout
    found = json.loads(cosim("list", "--json").stdout)
    assert {"scenarios", "manoeuvres", "faults", "targets", "detectors", "tolerances", "examples"} <= found.keys()
    refused(cosim("list", "tolerance"), "cosim list tolerance", "Did you mean 'tolerances'?")


def test_linearize_shows_the_modes_and_writes_the_model(tmp_path):
    path = tmp_path / "model.npz"
    found = json.loads(cosim("linearize", "--json", "-o", path).stdout)
    assert {"trim", "states", "inputs", "outputs", "A", "B", "C", "D", "modes"} <= found.keys()
    assert [m["name"] for m in found["modes"]] == ["short_period", "phugoid", "dutch_roll", "roll", "spiral"]
    assert {"alpha_deg", "stabilizer_deg", "throttle", "residual"} <= found[
        "trim"
    ].keys() and path.stat().st_size > 1000
    assert "short period" in cosim("linearize").stdout
    real, imag = found["phugoid_height_free"]["eigenvalue"]
    assert np.abs(np.linalg.eigvals(found["A"]) - complex(real, imag)).min() < 1e-5  # A couples the lateral states, too
    refused(cosim("linearize", "-o", tmp_path / "model.csv"), "model.csv", ".npz, .mat")


@pytest.mark.parametrize(
    ("point", "why"),
    [
        ({"flight.cas_kt": 110}, "stall"),
        ({"flight.cas_kt": 210, "flight.altitude_ft": 42000, "flight.mass_t": 380}, "thrust"),
        ({"flight.cas_kt": 400, "flight.altitude_ft": 40000}, "Mach"),
    ],
)
def test_infeasible_point_is_one_line_that_says_why(point, why):
    sets = [x for k, v in point.items() for x in ("--set", f"{k}={v}")]
    refused(cosim("linearize", *sets), " t, CG 30 %", " ft", why)


@pytest.mark.slow
@pytest.mark.parametrize("name", builtin_names())
def test_builtin_flies_past_its_last_fault(name, tmp_path):
    late = max((f.start_s for f in load_scenario(name).faults), default=1.0)
    result = cosim("run", name, "--json", "-s", f"duration_s={late + 2}", "-o", tmp_path / "x.mcap")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["status"] == "completed"


def test_same_scenario_and_seed_give_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        result = cosim(
            "run", "--json", "-s", "duration_s=2", "-s", "faults.0.start_s=1", "-o", tmp_path / f"{name}.mcap"
        )
        assert result.exit_code == 0, result.output
        assert json.loads(result.stdout)["status"] == "completed"
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    found = json.loads(cosim("info", "--json", tmp_path / "a.mcap").stdout)
    assert (
        found["complete"]
        and found["status"] == "completed"
        and found["ticks"] == 400
        and found["title"] == "ofc_liquid on elevator.left_inner; still air, cruise"
    )
    (tmp_path / "again.toml").write_text(cosim("info", "--scenario", tmp_path / "a.mcap").stdout)
    assert cosim("run", tmp_path / "again.toml", "-o", tmp_path / "c.mcap").exit_code == 0
    assert (tmp_path / "c.mcap").read_bytes() == (tmp_path / "a.mcap").read_bytes()


def python(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True).stdout


def test_import_and_help_stay_light():
    heavy = "{'numba', 'pandas', 'jsbsim', 'scipy', 'plotly', 'mcap', 'pyarrow', 'cvxpy', 'numpy'}"
    assert python(f"import sys, cosim; print({heavy} & set(sys.modules))") == "set()\n"
    assert python(f"import sys, cosim.cli.commands; print({heavy} & set(sys.modules))") == "set()\n"
    assert python(f"import sys, cosim; cosim.load_scenario(); print({heavy} & set(sys.modules))") == "set()\n"


def test_the_page_of_a_flight_needs_no_tables_and_no_statistics(short_log, tmp_path):
    """They are half of the memory that a page of two hours would take."""
    words = ["report", str(short_log), "-o", str(tmp_path / "a.html")]
    heavy = "{'pandas', 'scipy.signal', 'scipy.stats'}"
    told = f"import sys, atexit; atexit.register(lambda: print({heavy} & {{*sys.modules}}))"
    assert python(f"{told}; from cosim.cli import main; sys.argv[1:] = {words}; main()").endswith("\nset()\n")
