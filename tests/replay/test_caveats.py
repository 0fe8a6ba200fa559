"""What a diagnosis says beside its verdicts: other aircraft, proxies, derived signals, no finite number."""

import re
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from flight_point import POINT

from cosim.replay.caveats import caveats
from cosim.replay.log_schema import ReplayError
from cosim.replay.map import diagnose
from cosim.scenario.aircraft import load_aircraft

RATE = 25.0
T = np.arange(0.0, 60.0, 1.0 / RATE)
FLIES = T > 20.0
MAP = (
    "{top}\n"
    + POINT
    + """[signals]
alpha = {{ channel = "aoa", unit = "deg" }}
theta = {{ channel = "theta", unit = "deg" }}
q = {{ derivative_of = "theta" }}
tas = {{ channel = "tas", unit = "kt" }}
de_cmd = {{ channel = "de", unit = "deg", proxy = "the measured deflection" }}
{more}
"""
)


def recording(path, **other):
    """Write 20 s on the apron and 40 s of flight, at 25 Hz."""
    sway, rng = np.where(FLIES, np.sin(1.1 * T), 0.0), np.random.default_rng(2)
    table = {
        "aoa": 3.0 + 0.5 * sway + rng.normal(0, 0.02, len(T)), "theta": 4.0 + 0.8 * sway,
        "tas": np.where(FLIES, 320.0, 0.0), "de": 0.3 * sway, "alt": 20000.0 + 10.0 * T,
    }  # fmt: skip
    pd.DataFrame({"t": T, **table, **other}).to_csv(path, index=False)
    return path


def told(tmp_path, top="", more="", **other):
    (tmp_path / "map.toml").write_text(MAP.format(top=top, more=more))
    return diagnose(recording(tmp_path / "a.csv", **other), tmp_path / "map.toml")


def test_the_apron_is_out_of_range_and_the_flight_is_judged(tmp_path):
    found = told(tmp_path)
    (row,) = found.detectors
    assert row["id"] == "rfafe_airframe" and 30.0 < row["valid_pct"] < 60.0 and row["r_max"] > 0.0
    assert any(re.search(r"outside its box \(speed\) for 20.* s, not valid there", c) for c in found.caveats)


@pytest.mark.parametrize(
    ("top", "words"),
    [
        ("", "designed for the transport, and the map does not say which aircraft flew"),
        ('aircraft = "Citation II"', "designed for another aircraft, transport, than the recording's, Citation II"),
        (f'aircraft = "{load_aircraft().name}"', None),
    ],
)
def test_a_model_of_another_aircraft_is_told(tmp_path, top, words):
    said = [c for c in told(tmp_path, top).caveats if "designed for" in c]
    assert (len(said) == 1 and words in said[0]) if words else not said


def test_proxies_and_derived_signals_are_named_with_who_reads_them(tmp_path):
    found = told(tmp_path)
    said = [c for c in found.caveats if "proxy" in c]
    assert any(c.startswith("rfafe_airframe: de_cmd stands on a proxy, the measured deflection") for c in said)
    assert any("q stands on a proxy, the rate of change of theta" in c for c in said)
    signal = {s["name"]: s for s in found.signals}
    assert signal["q"]["channel"] == "the rate of change of theta" and signal["q"]["valid_pct"] > 98.0


def test_a_derived_rate_is_the_derivative_and_a_derived_angle_that_of_the_path(tmp_path):
    from cosim.replay.map_file import Map
    from cosim.replay.map_signals import derived

    signals = {
        "theta": {"channel": "a", "unit": "deg"}, "hdot": {"derivative_of": "h_baro"}, "phi": {"channel": "b"},
        "h_baro": {"channel": "c", "unit": "ft"}, "tas": {"channel": "d"}, "alpha_ground": {"path_of": "theta"},
    }  # fmt: skip
    gamma, alpha, bank = 0.05, 0.08, 0.6
    # sin(gamma) = sin(theta) cos(alpha) - cos(theta) cos(phi) sin(alpha), solved for theta
    grid = np.linspace(0.0, 0.4, 400_001)
    path = np.sin(grid) * np.cos(alpha) - np.cos(grid) * np.cos(bank) * np.sin(alpha)
    theta = grid[np.argmin(np.abs(path - np.sin(gamma)))]
    h = 3000.0 + 150.0 * np.sin(gamma) * T
    channels = {
        "theta": (T, np.full(len(T), np.degrees(theta)), None), "phi": (T, np.full(len(T), bank), None),
        "h_baro": (T, h / 0.3048, None), "tas": (T, np.full(len(T), 150.0), None),
    }  # fmt: skip
    made = derived(Map.model_validate({"signals": signals}), channels, "map")
    np.testing.assert_allclose(made["hdot"][1][5:-5], 150.0 * np.sin(gamma), rtol=1e-9)
    np.testing.assert_allclose(made["alpha_ground"][1][5:-5], alpha, atol=2e-6)


def test_what_a_signal_is_derived_from_must_be_there(tmp_path):
    with pytest.raises(ReplayError, match=r"hdot is made from h_inertial, which has no channel"):
        told(tmp_path, more='hdot = { derivative_of = "h_inertial" }\nh_baro = { channel = "alt", unit = "ft" }')


def test_an_absent_sensor_is_one_that_is_lost(tmp_path):
    found = told(tmp_path, more="beta = { absent = true }")
    assert any(d["id"] == "rfafe_airframe" for d in found.detectors)
    missing = {d["id"]: d["missing"] for d in found.not_run}
    assert "beta" not in missing["kinematic"]


class Stub:
    """A detector that ran: outputs r, alarm, valid, why."""

    id, level, every = "rfafe_airframe", "aircraft", 1

    class module:
        from actuators.block import dtype

        STATE = dtype([(n, "f8") for n in ("r", "alarm", "valid", "why")])
        OUTPUTS = ("r", "alarm", "valid", "why")

    class record:
        any_aircraft, range = True, MappingProxyType({})

    def target(self, lane):
        return "aircraft"

    def inputs(self, lane):
        return []


def prepared(m, t_0):
    scenario = SimpleNamespace(aircraft=load_aircraft())
    return SimpleNamespace(map=m, scenario=scenario, values={}, channels={}, sources={}, dt=0.005, t_0=t_0, delays={})


def test_a_channel_that_never_changes_and_a_mass_out_of_the_design_are_told(tmp_path):
    more = 'mass = { channel = "m", unit = "t" }\nbeta = { channel = "b", unit = "deg" }'
    found = told(tmp_path, more=more, m=np.full(len(T), 6.0), b=np.zeros(len(T)))
    assert any(c.startswith("the recording's mass, 6 t, lies outside the transport's") for c in found.caveats)
    assert any(c.startswith("beta: channel b is 0 all along") for c in found.caveats)
    assert not any(c.startswith("mass: channel") for c in found.caveats)


@pytest.mark.parametrize(
    ("alarm", "words"),
    [
        ((0.001, 1.0), "alarms for 100 % of its valid time"),
        ((0.1, 1.0), None),  # a fault after a quiet start
        ((0.6, 1.0), None),
        ((0.0, 0.2), None),
    ],
)
def test_an_alarm_from_the_start_is_told_as_a_model_that_does_not_fit(alarm, words):
    assert_told(alarm, words, n=200_000)


@pytest.mark.parametrize(("start", "told"), [(5.0, True), (7.0, False)])
def test_the_start_is_as_long_as_the_detector_is_not_ready(start, told):
    """A window of 6 s; what follows a quiet start of 7 s in 30 s of recording is a fault."""
    assert_told(((6.0 + start) / 30.0, 1.0), "from " if told else None, n=6_000, ready=6.0)


def test_a_false_alarm_at_the_start_does_not_make_a_later_fault_a_wrong_model():
    assert_told((0.4, 1.0), None, n=6_000, blip=slice(0, 100))


def assert_told(alarm, words, *, n, ready=0.0, blip=slice(0)):
    """Check what is told of n ticks of 5 ms with an `alarm` over the shares named, and in the ticks of `blip`."""
    from cosim.replay.map_file import Map

    rows, k = np.zeros((n, 4)), int(ready / 0.005)
    rows[k:, 2], rows[:k, 3] = 1.0, 1.0
    rows[int(alarm[0] * n) : int(alarm[1] * n), 1] = rows[blip, 1] = 1.0
    m = Map.model_validate({"aircraft": "x", "signals": {}})
    said = caveats(prepared(m, 0.0), [(Stub(), "aircraft", None, rows)])
    assert (len(said) == 1 and words in said[0]) if words else not said


def test_numbers_that_are_not_finite_are_told_with_their_time():
    from cosim.replay.map_file import Map

    rows = np.zeros((1000, 4))
    rows[:, 2] = np.arange(1000) < 400
    rows[400:, 3] = 11.0
    rows[400, 0] = np.inf
    m = Map.model_validate({"aircraft": "x", "signals": {}})
    said = caveats(prepared(m, 10.0), [(Stub(), "aircraft", None, rows)])
    assert said == ["rfafe_airframe of aircraft: its numbers are not finite from 12 s on: not valid"]
    rows[400:, 2:] = 1.0, 0.0  # one tick, and it stays valid
    said = caveats(prepared(m, 10.0), [(Stub(), "aircraft", None, rows)])
    assert said == ["rfafe_airframe of aircraft: its numbers are not finite for 0.005 s, first at 12 s"]
