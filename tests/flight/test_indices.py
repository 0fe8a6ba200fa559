"""Numbers that compiled code uses as indices are checked wherever they come from: scenario, command line, log."""

import io

import numpy as np
import pytest
from forged import forge

from cosim.cli import commands as cli
from cosim.errors import LogError, ScenarioError
from cosim.flight.detection import detectors
from cosim.flight.detection import parameters as indices
from cosim.log import open_log
from cosim.replay import replay
from cosim.scenario import load_scenario
from cosim.scenario.load import DEFAULT
from fdi import registry

DT = 0.005
GOLDEN = cli.__file__.rsplit("cosim", 1)[0] + "logs/golden/hydraulic-ofc.mcap"


def with_all():
    """Return the default scenario with every shipped detector, those on request, too."""
    return load_scenario(DEFAULT, [f"detectors.enabled={list(registry.SHIPPED)}"])


@pytest.mark.parametrize("name", registry.SHIPPED)
def test_every_design_and_fresh_state_fits(name):
    made = {d.id: d for d in detectors.chosen(with_all())}[name]
    p = made.params(with_all(), DT)
    assert indices.beyond(p, indices.parameter_spans(made.record, made.module, DT)) is None
    assert indices.beyond(made.module.init(p), indices.state_spans(made.record, made.module)) is None


@pytest.mark.parametrize("name", registry.SHIPPED)
def test_no_index_takes_a_value_beyond_its_range(name):
    own, record = registry.module(name), registry.record(name)
    spans = indices.parameter_spans(record, own, DT)
    p = {d.id: d for d in detectors.chosen(with_all())}[name].params(with_all(), DT)
    for field, (low, high) in spans.items():
        for value in (low - 1.0, high + 1.0, 0.5 * (low + high) + 0.25, np.nan, 1e300, -np.inf):
            bad = p.copy()
            bad[field] = value
            assert indices.beyond(bad, spans)[0] == field, (field, value)


@pytest.mark.parametrize(
    "key", ["iotsekf.delay=11", "iotsekf.lag_ticks=-1", "ofc_monitor.half_periods=0", "rfafe.ns=1e9"]
)
def test_scenario_with_an_index_beyond_its_array_is_refused(key):
    scenario = load_scenario(DEFAULT, [f"detectors.{key}"])
    name = key.split(".")[0]
    with pytest.raises(ScenarioError, match="is out of range; allowed: a whole number from"):
        {d.id: d for d in detectors.chosen(scenario)}[name].params(scenario, DT)


def test_forged_parameters_and_states_are_refused(tmp_path, monkeypatch):
    log = open_log(GOLDEN)
    assert replay(forge(log, tmp_path / "same", {})).exact
    wrong = (("params", "delay", 1e7, "beyond the detector's arrays"),
             ("initial", "likely_fault", 4e6, r"likely_fault = 4e\+06 would reach beyond"))  # fmt: skip
    for name, field, value, said in wrong:
        array, out = np.load(io.BytesIO(log.attachments[f"iotsekf.{name}.npy"])), io.BytesIO()
        array[field] = value
        np.save(out, array)
        with pytest.raises(LogError, match=said):
            replay(forge(log, tmp_path / name, {f"iotsekf.{name}.npy": out.getvalue()}))
    state, real = "/state/iotsekf/left_inner", log.array
    wild = real(state).copy()
    wild[:, log.topics[state].fields.index("likely_fault")] = -1e6
    monkeypatch.setattr(log, "array", lambda name: wild if name == state else real(name))
    with pytest.raises(LogError, match=r"tick \d+: iotsekf\.likely_fault"):
        replay(forge(log, tmp_path / "late", {}), start_s=3.0)
