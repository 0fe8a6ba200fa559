"""Every number of a log has a unit: it stands beside the field in its dtype, "-" where there is none."""

import numpy as np
import pytest

import cosim
from actuators.block import dtype, unit
from cosim.flight.build import build
from cosim.flight.loop.recorder import topics
from cosim.scenario import vocabulary
from fdi import registry


def test_the_unit_of_a_field_is_read_from_its_dtype():
    kind = dtype([("q", "f8", "m"), ("x", "f8", (3,), "m/s"), ("w", "f8", (2,)), ("n", "f8")])
    assert [unit(kind, f) for f in ("q", "x", "x[2]", "w", "n")] == ["m", "m/s", "m/s", "", ""]
    assert kind == dtype([("q", "f8"), ("x", "f8", (3,)), ("w", "f8", (2,)), ("n", "f8")])
    assert np.zeros(2, kind).view(np.float64).shape == (14,)


@pytest.mark.parametrize("name", registry.SHIPPED)
def test_every_output_and_input_of_a_detector_has_a_unit(name):
    module = registry.module(name)
    assert [n for n in module.OUTPUTS if not unit(module.STATE, n)] == []
    assert [n for n in module.INPUTS.names if not unit(module.INPUTS, n)] == []


def test_no_topic_of_a_log_but_a_hidden_state_has_a_field_without_unit():
    every = ["elevator={left_outer='hydraulic',left_inner='simple',right_inner='ema',right_outer='ema'}"]
    found = topics(build(cosim.load_scenario("liquid-ofc", [*every, "faults.0.target=elevator.left_outer"])))
    shown = [(t.name, f, u) for t in found if t.group != "snapshot" for f, u in zip(t.fields, t.units)]
    assert [(name, f) for name, f, u in shown if not u] == []
    assert sum(len(t.fields) for t in found if t.name.startswith("/detectors/")) > 129


def test_every_word_of_the_vocabulary_is_on_the_bus_and_in_the_log_with_its_unit():
    every = ["elevator={left_outer='hydraulic',left_inner='simple',right_inner='ema',right_outer='ema'}"]
    setup = build(cosim.load_scenario("cruise", every))
    logged = {t.name: t for t in topics(setup)}
    for word in vocabulary.words().values():
        for lane, technology in setup.scenario.elevator.technology.items():
            if word.technologies and technology not in word.technologies:
                continue
            there = word.at(lane)
            topic = logged[there.topic]
            at = topic.fields.index(there.field)
            assert topic.units[at] == word.unit, word
            value, own = setup.loop.bus.index(there.source), int(topic.index[at])
            assert value == own or there.kind == "sensor"  # of a sensor the law's copy is logged
            if there.flag:
                assert f"{there.field}_valid" in topic.fields and setup.loop.bus.index(there.flag)
            if there.kind != "sensor":
                assert vocabulary.place(there.source) == (there.topic, there.field)


def test_a_word_that_is_none_says_what_it_might_be():
    with pytest.raises(KeyError, match="Did you mean 'surface'"):
        vocabulary.find("surfase", "left_inner")
    with pytest.raises(KeyError, match="no signal"):
        vocabulary.find("left_inner.alpha")
    assert vocabulary.find("right_outer.rod").word == vocabulary.find("rod", "right_outer").word == "right_outer.rod"
