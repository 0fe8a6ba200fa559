"""A detector whose inputs are outputs of other detectors: order, refusals, log, replay, recordings."""

import json
import struct
import textwrap

import pytest

import cosim
from cosim.errors import CosimError, ScenarioError
from cosim.flight.build import build
from cosim.log import open_log
from cosim.parts import with_detectors
from cosim.replay import replay
from fdi import registry

OFC = "faults.0={target='elevator.left_inner', kind='ofc_liquid', amplitude_mm=5, frequency_hz=2, start_s=1.5}"
KEYS = ["duration_s=4", "elevator.feedback=measured", OFC]
SHORT = [*KEYS, "detectors.enabled=['ofc_monitor']"]


@pytest.fixture(autouse=True)
def _forget():
    yield
    registry.USER_DETECTORS.clear()


def own(folder, name, inputs, says="{'r': sum(y), 'alarm': sum(y) > 1.5}", **more):
    """Write a detector `name` that reads `inputs`, and return its file."""
    facts = {"level": "aircraft", "technologies": (), "every": 1, **more}
    file = folder / f"{name}.py"
    file.write_text(textwrap.dedent(f"""\
        class Own:
            id, inputs = {name!r}, {inputs!r}
            level, technologies, every = {facts["level"]!r}, {facts["technologies"]!r}, {facts["every"]!r}

            def __init__(self, dt):
                pass

            def update(self, t, y):
                return {says}
        """))
    return file


def flown(files, log, keys=SHORT):
    return cosim.simulate(with_detectors(cosim.load_scenario("cruise", keys), files), log=log)


def bits(values):
    return [struct.pack("<d", v) for v in values]


def column(log, topic, field):
    return log.array(topic)[:, log.topics[topic].fields.index(field)]


@pytest.fixture
def chain(tmp_path):
    """Return (files, log) of `second`, which reads `first`, which reads the shipped monitor; given last one first."""
    monitor = "ofc_monitor.left_inner"
    first = own(tmp_path, "first", ("q", f"{monitor}.r", f"{monitor}.alarm"), "{'r': y[1] + y[2]}")
    second = own(tmp_path, "second", ("first.aircraft.r", "ofc_monitor.left_inner.alarm"))
    log = tmp_path / "chain.mcap"
    flown([second, first], log)
    return [second, first], log


def test_it_reads_its_sources_of_the_same_tick_in_any_order(chain):
    log = open_log(chain[1])
    assert [d["id"] for d in json.loads(log.attachments["detectors.json"])] == ["ofc_monitor", "first", "second"]
    monitor = "/detectors/ofc_monitor/left_inner"
    first, second = "/detectors/first/aircraft", "/detectors/second/aircraft"
    r, alarm = column(log, monitor, "r"), column(log, monitor, "alarm")
    assert alarm.any()
    assert bits(column(log, first, "r")) == bits(r + alarm)  # of this tick, not of the one before
    assert bits(column(log, second, "r")) == bits(column(log, first, "r") + alarm)


def test_replay_of_one_and_of_all_is_exact_and_what_if_goes_on_to_the_reader(chain):
    files, log = chain
    alone = replay(log, detectors=["second"], user_detectors=files)
    assert alone.exact and {d["id"] for d in alone.detectors} == {"second"}
    whole = replay(log, user_detectors=files)
    assert whole.exact and len(whole.detectors) == 4
    assert replay(log, user_detectors=files, start_s=2.0).exact
    deaf = replay(log, user_detectors=files, overrides={"ofc_monitor": {"threshold": 1.0}})
    changed = {d.field for d in deaf.differences}
    assert any("second/aircraft.alarm" in name for name in changed)  # recomputed from what the monitor says now


def test_a_local_one_reads_its_own_lane_and_a_new_one_reads_a_log_and_a_recording(tmp_path):
    local = {"level": "local", "technologies": ("hydraulic",)}
    mine = own(tmp_path, "mine", ("ofc_monitor.alarm", "rod"), "{'r': y[0]}", **local)
    log = tmp_path / "local.mcap"
    flown([mine], log)
    there = open_log(log)
    for lane in ("left_inner", "left_outer"):
        topics = f"/detectors/ofc_monitor/{lane}", f"/detectors/mine/{lane}"
        assert bits(column(there, topics[0], "alarm")) == bits(column(there, topics[1], "r"))
    late = own(tmp_path, "late", ("ofc_monitor.left_inner.alarm",), "{'alarm': y[0]}")
    seen = next(d for d in replay(log, user_detectors=[late]).detectors if d["id"] == "late")
    flying = next(d for d in replay(log).detectors if d["target"] == "elevator.left_inner")
    delay = flying["logged"]["detection_delay_s"]
    assert delay is not None and seen["logged"] is None and seen["replayed"]["detection_delay_s"] == delay


def test_a_slower_reader_steps_with_its_sources_and_a_faster_one_is_refused(tmp_path):
    slow = own(tmp_path, "slow", ("ofc_monitor.left_inner.r",), "{'r': y[0]}", every=4)
    log = tmp_path / "slow.mcap"
    flown([slow], log)
    there = open_log(log)
    assert bits(column(there, "/detectors/slow/aircraft", "r")) == bits(
        column(there, "/detectors/ofc_monitor/left_inner", "r")[::4]
    )
    assert replay(log, user_detectors=[slow]).exact
    fast = own(tmp_path, "fast", ("slow.aircraft.r",))
    with pytest.raises(ScenarioError, match=r"slow steps every 4 ticks, fast every 1.*every = 4"):
        flown([slow, fast], None)


@pytest.mark.parametrize(
    "reads, said",
    [
        ({"a": ("b.aircraft.r",), "b": ("a.aircraft.r",)}, "detectors wait for each other: a reads b reads a"),
        ({"a": ("a.aircraft.r",)}, "detectors wait for each other: a reads a"),
        ({"a": ("ofc_monitr.left_inner.alarm",)}, r"'ofc_monitr' is no detector.*ofc_monitor"),
        ({"a": ("ofc_monitor.right_inner.r",)}, r"no lane 'right_inner'; allowed: left_outer, left_inner"),
        ({"a": ("ofc_monitor.left_inner.alrm",)}, r"no output 'alrm'; allowed: .*Did you mean 'alarm'"),
        ({"a": ("ofc_monitor.left_inner.started",)}, "no output 'started'"),  # a part of its state
        ({"a": ("b.aircraft.x",), "b": ("q",)}, "b has no output 'x'; allowed: r, alarm"),
        ({"a": ("iotsekf.left_inner.alarm",)}, r"iotsekf does not fly.*Add 'iotsekf' to detectors.enabled"),
        ({"a": ("ofc_monitor.alarm",)}, r"Name the segment: \"ofc_monitor.left_inner.alarm\""),
    ],
)
def test_cycles_and_unknown_names_are_refused_in_one_line(tmp_path, reads, said):
    files = [own(tmp_path, name, inputs) for name, inputs in reads.items()]
    with pytest.raises(CosimError, match=said) as error:
        build(with_detectors(cosim.load_scenario("cruise", SHORT), files))
    assert "\n" not in str(error.value)
