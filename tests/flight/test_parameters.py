"""A detector's parameters have one set of names, in flight and on a replay; a mistake is named by key and value."""

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim import load_scenario
from cosim.cli import commands as cli
from cosim.errors import CosimError, ScenarioError
from cosim.flight.build import build
from cosim.replay.log_schema import override
from cosim.scenario import parse
from fdi.registry import module, record

ONLY = ("duration_s=0.1", "detectors.enabled=['ofc_monitor']", "elevator.feedback=measured")


def live(text):
    """Return the PARAMS of ofc_monitor in a flight for which `text` is set."""
    scenario = load_scenario("cruise", [*ONLY, f"detectors.ofc_monitor.{text}"])
    assert parse(load_table(scenario)) == scenario
    return build(scenario).loop.detectors[0].p


def load_table(scenario):
    import tomllib

    return tomllib.loads(scenario.expanded_toml())


@pytest.mark.parametrize("text", ["threshold=5", "threshold[1]=5", "t_release=3", "half_periods=2"])
def test_a_scenario_and_a_replay_take_the_same_names(text):
    name, _, value = text.partition("=")
    made = module("ofc_monitor")
    p = np.repeat(made.params(), 2)
    override(record("ofc_monitor"), made, p, {name: float(value)}, 0.005)
    assert p.tobytes() == live(text).tobytes() != np.repeat(made.params(), 2).tobytes()


@pytest.mark.parametrize("text", ["thrshold=5", "threshold[3]=5", "threshold[1=5", "half_periods=99", "delay=2.5"])
def test_they_refuse_the_same_with_the_same_words(text):
    name, _, value = text.partition("=")
    made = module("ofc_monitor")
    with pytest.raises(CosimError) as before:
        live(text)
    with pytest.raises(CosimError) as again:
        override(record("ofc_monitor"), made, made.params(), {name: float(value)}, 0.005)
    assert before.value.problem == again.value.problem and before.value.allowed == again.value.allowed
    assert str(before.value).startswith(f"detectors.ofc_monitor.{name} = ")


@pytest.mark.parametrize("value", ["nan", "inf", "[1, 2]"])
def test_what_is_no_finite_number_is_named_once(value):
    with pytest.raises(ScenarioError) as error:
        load_scenario("cruise", [f"detectors.ofc_monitor.threshold={value}"])
    said = f"cruise: --set detectors.ofc_monitor.threshold = {value}: is no finite number; allowed: a finite number"
    assert str(error.value) == said


DRIVE = "{target='elevator.right_inner', kind='ofc_liquid', at='valve', start_s=0, frequency_hz=10, amplitude_mm=100}"


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ("detectors.ofc_monitor.nothing=1", "detectors.ofc_monitor.nothing"),
        (f"faults.0={DRIVE}", "faults.0.amplitude_mm"),
    ],
)
def test_what_only_building_finds_names_the_scenario_as_well(change, key, tmp_path):
    words = ["run", "cruise", "-s", "duration_s=1", "-s", change, "-o", str(tmp_path / "a.mcap")]
    found = CliRunner().invoke(cli.app, words)
    assert found.exit_code == 2 and found.stderr.startswith(f"error: cruise: {key}"), found.output


@pytest.mark.parametrize("detector", ["iotsekf", "rtsekf"])
def test_a_load_form_comes_with_its_thresholds_or_is_refused(detector):
    flight = [f"detectors.enabled=['{detector}']", "duration_s=0.2"]
    with pytest.raises(ScenarioError, match=r"thresholds that belong to it.*'published'.*form"):
        build(load_scenario("cruise", [*flight, f"detectors.{detector}.load=0"]))
    p = build(load_scenario("cruise", [*flight, f"detectors.{detector}.form='published'"])).loop.detectors[0].p
    assert (p["load"] == 0.0).all()
