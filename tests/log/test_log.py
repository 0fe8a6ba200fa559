"""The log holds what was logged, bit for bit, and says clearly when it cannot."""

import subprocess
import sys
import textwrap

import numpy as np
import pytest
from log_samples import N_VALUES, TOPICS, expected, same_bits, vectors, write

from cosim.errors import CosimError
from cosim.files import left_by
from cosim.log import LogError, LogWriter, Topic, log_info, open_log


@pytest.fixture
def path(tmp_path):
    return tmp_path / "flight.mcap"


OPTIONS = [{}, {"compression": ""}, {"compression": "zstd"}, {"rows_per_chunk": 7}, {"rows_per_chunk": 500}]


@pytest.mark.parametrize("ticks", [1, 49, 50, 51, 100, 230])
@pytest.mark.parametrize("options", OPTIONS)
def test_every_bit_comes_back(path, ticks, options):
    v = write(path, ticks, pose=True, **options)
    log = open_log(path)
    assert log.complete and log.n_ticks == ticks
    for topic in TOPICS:
        want = expected(v, topic)
        assert same_bits(log.array(topic.name), want)
        assert log.topics[topic.name].rows == len(want)
    assert log.result["status"] == "completed" and len(log.result["content"]) == 64


def test_what_describes_the_run_comes_back(path):
    write(path)
    log = open_log(path)
    assert log.metadata["run"] == {"seed": "0", "unit": "µ"}
    assert log.attachments == {"scenario.toml": b"seed = 0\n", "empty.bin": b""}
    assert log.media_types["scenario.toml"] == "application/toml"
    topic = log.topics["/actuators/left_inner"]
    assert (topic.fields, topic.units, topic.every) == (("q_rod", "u"), ("m", "-"), 1)
    assert (topic.group, topic.channel) == ("actuators", "/actuators")
    [(tick, window)] = log.messages("/events")
    assert tick == 70
    assert window.start_time.ToNanoseconds() == 200_000_000 and not window.HasField("end_time")
    assert {m.key: m.value for m in window.metadata} == {"kind": "jam", "target": "elevator.left_inner"}


def test_frames_have_a_time_index_that_is_the_tick_times_dt(path):
    v = write(path, 230)
    log = open_log(path)
    frame = log.frame("/detectors/slow")
    assert list(frame.columns) == ["r", "alarm", "f_hat"] and frame.index.name == "t_s"
    assert (frame.index == np.arange(0, 230, 3) * 5_000_000 / 1e9).all()
    assert (log.ticks("/state") == [0, 64, 128, 192]).all()
    wide = log.frame("/actuators")
    assert list(wide.columns) == ["left_inner.servo.u", "left_inner.q_rod", "left_inner.u", "left_outer.q_rod"]
    assert same_bits(wide["left_inner.u"].to_numpy(), v[:, 3]) and wide.attrs["units"]["left_inner.servo.u"] == "A"
    assert log.frame("/actuators", fields=["left_outer.q_rod"]).equals(wide[["left_outer.q_rod"]])
    with pytest.raises(KeyError, match="no field 'zz'"):
        log.frame("/truth", fields=["zz"])
    with pytest.raises(KeyError, match="no topic '/nothing'"):
        log.array("/nothing")


@pytest.mark.parametrize(
    ("start", "stop"), [(0, 230), (60, 61), (49, 151), (64, 128), (229, 500), (100, 100), (500, 600)]
)
def test_a_span_of_ticks_is_read_alone(path, start, stop):
    v = write(path, 230)
    log = open_log(path)
    ticks = np.arange(start, min(stop, 230))
    for topic in TOPICS:
        part = log.array(topic.name, start_s=start * log.dt_ns / 1e9, end_s=stop * log.dt_ns / 1e9)
        assert same_bits(part, expected(v, topic, ticks))
        assert (log.ticks(topic.name, start, stop) == ticks[ticks % topic.every == 0]).all()
    assert len(log.array("/truth", start_s=start * 0.005)) == max(0, 230 - start)


def test_the_same_run_gives_the_same_bytes(tmp_path):
    write(tmp_path / "a", pose=True)
    write(tmp_path / "b", pose=True)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_info_tells_a_whole_log_from_an_incomplete_one(tmp_path):
    write(tmp_path / "whole")
    write(tmp_path / "stopped", result=False)
    whole, stopped = log_info(tmp_path / "whole"), log_info(tmp_path / "stopped")
    assert whole["complete"] and whole["problem"] is None and whole["duration_s"] == 1.15 and whole["gaps"] == 0
    assert stopped["problem"] is None and not stopped["complete"] and stopped["result"] == {}
    cut = tmp_path / "cut"
    cut.write_bytes((tmp_path / "whole").read_bytes()[:-5000])
    told = log_info(cut)
    assert not told["complete"] and "no end" in told["problem"] and told["ticks"] >= 150


@pytest.mark.parametrize("status", [None, "interrupted"])
def test_a_flight_that_is_cut_short_leaves_an_older_log_as_it_was(path, status):
    old = path.write_bytes(b"") or write(path) is None or path.read_bytes()
    with LogWriter(path, TOPICS, n_values=N_VALUES) as log:
        log.append(vectors(1)[0])
        if status:
            log.close({"status": status})
    assert path.read_bytes() == old and log.path == str(left_by(path))
    assert open_log(log.path).n_ticks == 1


def test_a_flight_that_an_error_ends_says_where_it_is_beside_an_older_log(path):
    write(path)
    with pytest.raises(
        CosimError, match=r"pump\. The flight so far is .*part: remove it before"
    ):
        with LogWriter(path, TOPICS, n_values=N_VALUES) as log:
            log.append(vectors(1)[0])
            raise CosimError("pump")


def test_a_log_whose_part_is_there_is_not_begun(path):
    """Another run writes it, or one that did not end by itself has left it."""
    with LogWriter(path, TOPICS, n_values=N_VALUES) as log:
        log.append(vectors(1)[0])
        with pytest.raises(CosimError, match=r"cosim recover .*flight\.mcap\.part"):
            LogWriter(path, TOPICS, n_values=N_VALUES)
    assert open_log(path).n_ticks == 1


def _strike(n):
    """Return a trace function that raises KeyboardInterrupt at the n-th line that the log package runs in a flush."""
    left = n

    def trace(frame, event, arg):
        nonlocal left
        if "cosim/log" not in frame.f_code.co_filename.replace("\\", "/") or frame.f_code.co_name == "append":
            return None
        if event == "line":
            left -= 1
            if left == 0:
                sys.settrace(None)
                raise KeyboardInterrupt
        return trace

    return trace


@pytest.mark.parametrize("n", range(1, 900, 15))
def test_ctrl_c_at_any_line_leaves_every_tick_readable(path, n):
    v, before, logged, texts = vectors(230), sys.gettrace(), 0, 0
    with pytest.raises(KeyboardInterrupt), LogWriter(path, TOPICS, n_values=N_VALUES, rows_per_chunk=50) as log:
        try:
            sys.settrace(_strike(n))
            for k, row in enumerate(v):
                log.append(row)
                logged = k + 1
                if k % 20 == 0:
                    log.window(k, k, k)
                    texts += 1
        finally:
            sys.settrace(before)
    log = open_log(path)
    assert not log.complete and log.n_ticks in (logged, logged + 1)  # the strike may come after the row was taken
    for topic in TOPICS:
        assert same_bits(log.array(topic.name), expected(v[: log.n_ticks], topic))
    assert [k for k, _ in log.messages("/events")][:texts] == [20 * i for i in range(texts)]


def test_an_error_in_the_run_leaves_a_readable_incomplete_log(path):
    with pytest.raises(ZeroDivisionError), LogWriter(path, TOPICS, n_values=N_VALUES) as log:
        log.append(vectors(1)[0])
        _ = 1 / 0
    assert open_log(path).n_ticks == 1 and not open_log(path).complete


def test_a_log_without_a_tick_is_readable_and_keeps_its_texts(path):
    with LogWriter(path, TOPICS, n_values=N_VALUES) as log:
        log.close({"status": "diverged"})
    log = open_log(path)
    assert log.n_ticks == 0 and log.complete and log.array("/truth").shape == (0, 20)
    assert log_info(path)["problem"] is None


FULL = """
import resource, sys
sys.dont_write_bytecode = True
sys.path.insert(0, {tests!r})
from log_samples import *
from cosim.log import LogError
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
try:
    write({path!r}, 2000)
except LogError as error:
    print(error)
"""


@pytest.mark.parametrize("limit", [100, 5000, 100_001, 400_003])
def test_a_full_disk_is_one_clear_error_and_the_log_can_be_recovered(path, tmp_path, limit, request):
    from cosim.log import recover

    code = FULL.format(limit=limit, path=str(path), tests=str(request.path.parents[1] / "helpers"))
    told = subprocess.run([sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=True)
    assert "cannot write the log" in told.stdout and str(path) in told.stdout, told
    assert not told.stderr
    if limit < 50_000:  # not one tick: there is nothing to recover, and nothing stays
        assert "recover" not in told.stdout and not path.exists()
        return
    assert "recover" in told.stdout
    v, report = vectors(2000), recover(left_by(path), tmp_path / "out.mcap")
    log = open_log(tmp_path / "out.mcap")
    assert report["ticks"] == log.n_ticks > 0 and log.n_ticks % 50 == 0 and not log.complete
    for topic in TOPICS:
        assert same_bits(log.array(topic.name), expected(v[: log.n_ticks], topic))


def test_places_that_cannot_be_written_or_read_are_one_clear_error(tmp_path):
    places = (tmp_path / "no" / "such" / "folder.mcap", "cannot create the log"), (tmp_path, "is a folder")
    for bad, why in places:
        with pytest.raises(CosimError, match=why) as error:
            LogWriter(bad, TOPICS, n_values=N_VALUES)
        assert str(bad) in str(error.value)
    with pytest.raises(LogError, match="cannot read the log"):
        open_log(tmp_path / "none.mcap")
    with pytest.raises(LogError, match="is a folder"):
        open_log(tmp_path)


def test_topics_that_cannot_be_logged_are_refused_before_a_file_is_made(path):
    good = TOPICS[0]
    for name, fields, units, every in (
        ("/a b", ("x",), ("m",), 1), ("/a", ("x y",), ("m",), 1), ("/a", ("x", "x"), ("m", "m"), 1),
        ("/a", ("x",), (), 1), ("/a", (), (), 1), ("/a", ("x",), ("m",), 0),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=f"topic {name!r}:|topic {name}:"):
            Topic(name, fields, units, np.arange(len(fields)), every)
    for topics in ([good, good], [Topic("/events", ("x",), ("m",), [0])], [Topic("/s", ("x",), ("m",), [0], every=2)]):
        with pytest.raises(ValueError, match=r"distinct names|at every tick"):
            LogWriter(path, topics, n_values=N_VALUES)
    with pytest.raises(ValueError, match="outside the tick vector of 10 values"):
        LogWriter(path, [good], n_values=10)
    with pytest.raises(ValueError, match="are taken"):
        LogWriter(path, [good], n_values=N_VALUES, metadata={"result": {}})
    assert not path.exists()
