"""Faults that begin when something happens: parsed, found, logged, repeated."""

import numpy as np
import pytest

import cosim
from cosim.errors import ScenarioError
from cosim.flight.faults.conditions import resolved
from cosim.scenario.condition import condition, true

DOUBLET = ["manoeuvre.kind=nz_doublet", "manoeuvre.start_s=1", "manoeuvre.width_s=2", "duration_s=6"]
JAM = ["faults.0.target=elevator.left_inner", "faults.0.kind=jam_solid"]


@pytest.mark.parametrize(("text", "holds"), [
    ("t > 2", [0, 0, 0, 1]),
    ("t >= 1 and n_z < 1", [0, 0, 1, 0]),
    ("n_z > 1 or t < 1", [1, 1, 0, 0]),
    ("t < 1 or t > 2 and n_z > 0.9", [1, 0, 0, 1]),
    ("(t < 1 or t > 2) and n_z > 1.05", [1, 0, 0, 0]),
])  # fmt: skip
def test_a_condition_is_what_it_says(text, holds):
    values = {"t": np.array([0.0, 1.0, 2.0, 3.0]), "n_z": np.array([1.1, 1.2, 0.8, 1.0])}
    assert true(condition(text), values).astype(int).tolist() == holds


def test_what_is_not_valid_fulfils_nothing():
    assert not true(condition("n_z < 2"), {"n_z": np.array([np.nan])}).any()


@pytest.mark.parametrize(("text", "says"), [
    ("", "is no condition"), ("n_z", "a part is no comparison"), ("n_z > high", "n_z is not compared with a number"),
    ("nz > 1", "Did you mean 'n_z'"), ("rod > 0.01", "needs a segment"), ("(t > 1", "is no condition"),
    ("t > 1 t", "is no condition"), ("__import__('os') > 1", "a part is no comparison"), ("t > 1 # or", "no condition"),
    ("0 < t < 2", "a part is no comparison"), ("t > True", "not compared"), ("(" * 500, "is no condition"),
])  # fmt: skip
def test_what_is_no_condition_is_refused_in_words(text, says):
    with pytest.raises(ScenarioError, match=says):
        cosim.load_scenario("cruise", [*JAM, f'faults.0.when="{text}"'])


def test_a_name_of_too_many_parts_is_refused_in_words():
    with pytest.raises(ScenarioError, match="is no condition"):
        condition("a." * 900 + "b > 1")


def test_the_fault_begins_at_the_tick_after_and_the_log_says_when(tmp_path):
    scenario = cosim.load_scenario("cruise", [*DOUBLET, *JAM, 'faults.0.when="n_z < 0.95 and t > 2"'])
    result = cosim.simulate(scenario, log=tmp_path / "a.mcap", timed=False)
    log = cosim.open_log(tmp_path / "a.mcap")
    n_z, t = log.frame("/sensors/aircraft")["n_z"], log.frame("/sensors/aircraft").index
    first = int(np.flatnonzero((n_z < 0.95) & (t > 2))[0])
    active = log.frame("/faults/f0_left_inner")["active"].to_numpy()
    assert active[first] == 0.0 and active[first + 1] == 1.0
    assert result.faults[0]["start_s"] == pytest.approx((first + 1) * scenario.dt)
    told = log.attachments["scenario.toml"].decode()
    assert 'when = "n_z < 0.95 and t > 2"' in told
    (tmp_path / "again.toml").write_text(told)
    cosim.simulate(tmp_path / "again.toml", log=tmp_path / "b.mcap", timed=False)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_a_condition_that_never_holds_breaks_nothing():
    found = resolved(cosim.load_scenario("cruise", [*JAM, 'faults.0.when="n_z > 3"', "duration_s=0.5"]))
    assert found.faults[0].start_s == found.duration_s and not found.faults[0].waits


def test_one_fault_can_bring_about_the_next():
    second = ["faults.1.target=rudder", "faults.1.kind=jam", 'faults.1.when="left_inner.surface > 0.1"']
    first = ["faults.0.target=elevator.left_inner", "faults.0.kind=runaway", "faults.0.rate_deg_s=20"]
    scenario = cosim.load_scenario("cruise", [*first, 'faults.0.when="t > 1"', *second, "duration_s=3"])
    a, b = (f.start_s for f in resolved(scenario).faults)
    assert a == pytest.approx(1.01) and 1.1 < b < 2.0


RUDDER = ["faults.1.target=rudder", "faults.1.kind=jam"]
AT_1 = [*JAM, 'faults.0.when="t > 1"', "duration_s=4", "detectors.enabled=['iotsekf']"]


@pytest.mark.parametrize(("when", "starts"), [
    ("fault.0.active > 0", 1.015),
    ("fault.0.since >= 0.5", 1.515),
    ("fault.0.since > 0.5 AND t < 1.2 or t > 3", 3.01),
    ("fault.0.active > 0 and t > 1.5", 4.0),  # mended by then: never
    ("iotsekf.left_inner.r > -1 and fault.0.since > 1", 2.015),
    ("fault.0.active < 1 and fault.0.since > 0", 1.315),
])  # fmt: skip
def test_a_fault_begins_after_another_one(when, starts):
    scenario = cosim.load_scenario("cruise", [*AT_1, "faults.0.lasts_s=0.3", *RUDDER, f'faults.1.when="{when}"'])
    first, second = resolved(scenario).faults
    assert (first.start_s, first.end_s) == (1.01, 1.31)
    assert second.start_s == pytest.approx(starts, abs=1e-9)


def test_what_a_fault_waits_for_is_checked_and_what_never_comes_is_told():
    for when, says in (("fault.1.active > 0", "cannot wait for itself"), ("fault.2.active > 0", "there is no fault 2"),
                       ("fault.0 > 0", "Say fault.0.active or fault.0.since")):  # fmt: skip
        with pytest.raises(ScenarioError, match=says):
            cosim.load_scenario("cruise", [*AT_1, *RUDDER, f'faults.1.when="{when}"'])
    for name, says in (("truth.aircraft.nzz", "Did you mean 'nz'"), ("faults.0_rudder.active", "no signal 'faults.0"),
                       ("nowhere.at.all", "no signal 'nowhere.at.all'")):  # fmt: skip
        with pytest.raises(ScenarioError, match=says):
            resolved(cosim.load_scenario("cruise", [*AT_1, *RUDDER, f'faults.1.when="{name} > 1"']))
    with pytest.raises(ScenarioError, match=r"lasts_s.*Say end_s"):
        cosim.load_scenario("cruise", [*JAM, "faults.0.start_s=1", "faults.0.lasts_s=1"])
    never = cosim.load_scenario("cruise", [*JAM, 'faults.0.when="n_z > 3"', "duration_s=0.5"])
    assert never.warnings() == []
    assert resolved(never).warnings() == ["faults.0 (jam_solid) never began: n_z > 3 did not come true"]


def test_by_hand_a_condition_waits_and_what_is_injected_can_fulfil_it():
    scenario = cosim.load_scenario("cruise", [*JAM, 'faults.0.when="fault.1.since > 0.2"', *RUDDER, "duration_s=4",
                                              'faults.1.when="t > 3.5"', "detectors.enabled=[]"])  # fmt: skip
    flight = cosim.Flight(scenario)
    flight.step(100)
    number = flight.inject(target="aileron.left", kind="jam", when="t > 0.2")  # true before: waits from now on
    with pytest.raises(ScenarioError, match="has not begun"):
        flight.heal(number)
    flight.step(300)
    flight.heal(number)
    flight.step(10_000)
    jam, rudder, aileron = flight.flown().faults
    assert 0.5 <= aileron.start_s <= 0.51 and aileron.end_s == 2.0 and rudder.start_s == 3.51
    assert jam.start_s == pytest.approx(3.72, abs=0.0051) and flight.status == "completed"
