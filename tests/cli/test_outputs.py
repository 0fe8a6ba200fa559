"""No command and no call of Python writes over a file that the project did not write, nor over an input of its own."""

import contextlib

import pandas as pd
import pytest
from typer.testing import CliRunner

import cosim
from cosim.cli.commands import app
from cosim.errors import CosimError
from cosim.files import columns, left_by, marked, replace_text
from cosim.log.log_file import LogFile

OWN = """
class Mine:
    id, level, technologies, inputs = "mine", "local", ("hydraulic",), ("rod",)
    designed_for = ("rod",)

    def __init__(self, dt):
        pass

    def update(self, t, y):
        return {"r": 0.0, "alarm": False, "verdict": "none"}
"""
SHORT = ["-s", "duration_s=0.5", "-s", "detectors.enabled=['iotsekf']"]
CAMPAIGN = 'base = "cruise"\nruns = 1\n[set]\nduration_s = 1.0\n'
MINE = "run,mine\n1,2\n"


def command(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    log = tmp_path_factory.mktemp("flown") / "a.mcap"
    assert command("run", "cruise", *SHORT, "-o", log).exit_code == 0
    return log


# every command with an output: its words, and the files that it would write; OUT is a folder, LOG a log
WRITES = {
    "run": [(["run", "cruise", *SHORT, "-o", "OUT/a.mcap"], ["a.mcap"]),
            (["run", "cruise", *SHORT, "-o", "OUT/b.mcap", "--report"], ["b.html"])],
    "info": [(["info", "LOG", "--scenario", "-o", "OUT"], ["scenario.toml"])],
    "linearize": [(["linearize", "cruise", "-o", f"OUT/m{end}"], [f"m{end}"]) for end in (".npz", ".mat")],
    "replay": [(["replay", "LOG", "-o", "OUT/r.mcap"], ["r.mcap"])],
    "recover": [(["recover", "LOG", "-o", "OUT/r.mcap"], ["r.mcap"])],
    "reproduce": [(["reproduce", "jay", "-o", "OUT"], ["reproduce-jay.html", "reproduce-jay.csv"])],
    "campaign": [(["campaign", "OUT/few.toml", "-o", "OUT"], ["runs.parquet"])],
    "report": [(["report", "LOG", "-o", "OUT/p.html"], ["p.html"]), (["report", "OUT"], ["compare.html"])],
    "compare": [(["compare", "LOG", "-o", "OUT"], ["compare.html", "compare.csv", "compare.parquet"])],
    "new": [(["new", "detector", "mine", "-o", "OUT"], ["mine.py", "test_mine.py"])],
    "map": [(["map", "OUT/few.csv", "-o", "OUT/m.toml"], ["m.toml"])],
}  # fmt: skip
CASES = [(words, name) for each in WRITES.values() for words, names in each for name in names]


@pytest.mark.parametrize(("words", "name"), CASES, ids=[f"{w[0]} {n}" for w, n in CASES])
def test_a_foreign_file_is_refused_before_anything_is_flown_and_stays(words, name, flown, tmp_path):
    (tmp_path / "few.toml").write_text(CAMPAIGN)
    (tmp_path / "few.csv").write_text("t,rod\n0,0\n1,1\n")
    mine = tmp_path / name
    mine.write_text(MINE)
    words = [str(flown) if w == "LOG" else w.replace("OUT", str(tmp_path)) for w in words]
    if words[:2] == ["report", str(tmp_path)]:
        (tmp_path / "a.mcap").write_bytes(flown.read_bytes())
    there = sorted(p.name for p in tmp_path.iterdir())
    done = command(*words)
    assert done.exit_code == 2 and str(tmp_path) in done.stderr, done.output
    assert mine.read_text() == MINE and sorted(p.name for p in tmp_path.iterdir()) == there


@pytest.mark.parametrize("words", [["run", "cruise", *SHORT], ["replay", "LOG"], ["recover", "LOG"],
                                   ["report", "LOG"], ["linearize", "cruise"]])  # fmt: skip
def test_what_was_written_is_written_again(words, flown, tmp_path):
    path = tmp_path / {"report": "p.html", "linearize": "m.mat"}.get(words[0], "a.mcap")
    for _ in range(2):
        done = command(*(flown if word == "LOG" else word for word in words), "-o", path)
        assert done.exit_code == 0, done.output
    assert words[0] not in ("run", "replay") or "what the file held is overwritten" in done.stdout


def test_no_input_of_a_command_is_written_over(flown, tmp_path):
    own, mapped, link = tmp_path / "own.py", tmp_path / "map.toml", tmp_path / "link.mcap"
    own.write_text(OWN)
    mapped.write_text("mine = 1")
    link.symlink_to(flown)
    before = flown.read_bytes()
    taken, itself = "is there already", "is the log itself, it would be overwritten"
    for words, out, said in (
        (["replay", flown, "--detector", own], own, taken), (["replay", flown, "--map", mapped], mapped, taken),
        (["replay", flown], link, itself), (["recover", flown], flown, itself),
        *(([word, flown], tmp_path / "a.pdf", "allowed: .mcap") for word in ("replay", "recover")),
        (["run"], tmp_path / "a.csv", "allowed: .mcap"), (["report", flown], tmp_path / "a.pdf", "allowed: .html"),
    ):  # fmt: skip
        done = command(*words, "-o", out)
        assert done.exit_code == 2 and said in done.stderr, done.output
    assert (own.read_text(), mapped.read_text(), flown.read_bytes()) == (OWN, "mine = 1", before)


@pytest.mark.parametrize("words", [["compare", "LOG"], ["new", "law", "mine"], ["reproduce", "jay"]])
def test_a_file_where_a_folder_is_written_is_refused_in_one_line(words, flown, tmp_path):
    taken = tmp_path / "page.html"
    taken.write_text(MINE)
    done = command(*(flown if word == "LOG" else word for word in words), "-o", taken)
    assert done.exit_code == 2 and done.stderr.count("\n") == 1 and taken.read_text() == MINE, done.output


def _simulate(path, log):
    cosim.simulate(cosim.load_scenario("cruise", SHORT[1::2]), log=path, timed=False)


def _report(path, log):
    from cosim.report import flight_report

    flight_report(log, path)


CALLS = _simulate, _report


@pytest.mark.parametrize("call", CALLS, ids=lambda call: call.__name__)
def test_python_calls_write_over_no_foreign_file(call, flown, tmp_path):
    own = tmp_path / "own.py"
    own.write_text(OWN)
    with pytest.raises(CosimError, match="is there already"):
        call(own, flown)
    assert own.read_text() == OWN and [p.name for p in tmp_path.iterdir()] == ["own.py"]


def test_places_that_are_no_file_are_refused_and_links_are_followed(tmp_path):
    target, link, sign = tmp_path / "target", tmp_path / "link", marked(b"ours")
    link.symlink_to(target)
    replace_text(link, "ours 1", sign)
    assert link.is_symlink() and target.read_text() == "ours 1"
    target.write_text("foreign")
    with pytest.raises(CosimError, match="link: is there already"):
        replace_text(link, "ours 2", sign)
    with pytest.raises(CosimError, match="is a folder, not a file"):
        replace_text(tmp_path, "ours", sign)
    with pytest.raises(CosimError, match="its folder is a file"):
        replace_text(target / "below" / "file", "ours", sign)
    (tmp_path / "a.mcap.part").symlink_to(target)  # planted where a flight would write
    with pytest.raises((CosimError, OSError)):
        LogFile(tmp_path / "a.mcap")
    assert target.read_text() == "foreign" and left_by(tmp_path / "a.mcap").is_symlink()


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_a_table_is_known_by_its_first_columns(ending, tmp_path):
    path = tmp_path / f"table{ending}"
    frame = pd.DataFrame({"run": [1], "fault": [2], "more": [3]})
    frame.to_csv(path, index=False) if ending == ".csv" else frame.to_parquet(path)
    assert columns("run", "fault")(path) and not columns("fault")(path)
    path.write_text("text")
    with contextlib.suppress(OSError):
        assert not columns("run")(path)
