"""The scheduled observer in flight: boxes, three verdicts at once, noise in still air, gusts, wind, long flights."""

import functools
import math

import numpy as np
import pytest
from watched import watched as of_flight

from actuators.constants import RAD_PER_DEG
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import fly
from cosim.scenario import load_scenario
from cosim.scenario.aircraft import load_aircraft
from cosim.training.flights import POINT, TURBULENCE, draw, scenario, trimming
from fdi.common import why
from fdi.common.verdict import AMBIGUOUS, OFC_LIQUID
from fdi.lpv_smo import lpv_smo, synthesis

WIRES, ONSET = sources("lpv_smo"), 14.0
ESTIMATES = ("f_hat_elevator", "f_hat_n_z", "f_hat_alpha")
FIELDS = (
    *ESTIMATES, "alarm", "alarm_elevator", "alarm_n_z", "alarm_alpha", "verdict", "isolated_part", "valid", "why",
    "gust", "box", "path", "learned", "offset", "apart", "alpha_0", "over", "alpha_hat", "gust_hat",
    "ahead", "rms",
)  # fmt: skip
LIGHT = ("flight.mass_t=215", "flight.cg_pct=30", "flight.altitude_ft=15000", "flight.cas_kt=300", "duration_s=16",
         "flight.turbulence=moderate")  # fmt: skip
THREE = """faults=[{target='elevator.all',kind='bias',bias_deg=3,start_s=10},
    {target='sensor.n_z',kind='bias',bias_g=0.5,start_s=10,path='observers'},
    {target='sensor.alpha',kind='bias',bias_deg=5,start_s=10,path='observers'}]"""
AT_AN_EDGE = ("flight.mass_t=404.7", "flight.cg_pct=34.3", "flight.altitude_ft=30120", "flight.cas_kt=300.2")
SLOW_HEAVY = ("flight.mass_t=399.6", "flight.cg_pct=29.08", "flight.altitude_ft=10860", "flight.cas_kt=240.3")


def flown(*changes):
    return fly(load_scenario("cruise", ["detectors.enabled=[]", "flight.turbulence=none", *changes]), WIRES.values())


watched = functools.partial(of_flight, lpv_smo, fields=FIELDS)


@pytest.fixture(scope="module")
def faulty():
    return flown(*LIGHT, THREE)


@pytest.fixture(scope="module")
def oscillating():
    return flown("duration_s=19", "flight.turbulence=moderate", "faults=[{target='elevator.all',kind='ofc_liquid',"
                 f"at='command',amplitude_deg=1.0,frequency_hz=1.0,start_s={ONSET}}}]")  # fmt: skip


def test_every_box_holds_its_inequalities_and_knows_its_model():
    pairs = synthesis.load_boxes()
    assert len(pairs) <= lpv_smo.NB
    for model, made in pairs[::9]:
        assert synthesis.verify(made)["ok"]
        assert np.array_equal(model.box, made.box)


def test_three_faults_at_once_have_three_names_within_two_seconds_and_do_not_raise_their_own_allowance(faulty):
    log, t, quiet = watched(faulty), faulty.index.to_numpy(), watched(flown(*LIGHT))
    for name in ("elevator", "n_z", "alpha"):
        assert not log[f"alarm_{name}"][t < 10.0].any()
        assert log[f"alarm_{name}"][t > 12.0].all(), name
    assert np.array_equal(log["alarm"] > 0, (log["alarm_elevator"] + log["alarm_n_z"] + log["alarm_alpha"]) > 0)
    last = log[-1]
    assert last["f_hat_elevator"] == pytest.approx(3 * RAD_PER_DEG, rel=0.25)
    assert last["f_hat_n_z"] == pytest.approx(0.5, rel=0.1)
    assert last["f_hat_alpha"] == pytest.approx(5 * RAD_PER_DEG, rel=0.1)
    assert last["gust"] == pytest.approx(quiet["gust"][-1], rel=0.3)
    assert not quiet["alarm"].any()


def test_the_state_goes_over_from_box_to_box():
    frame = flown(*LIGHT, "flight.mass_t=301", "flight.turbulence=light", "sensors.noise_scale=0")  # noise jumps as far
    frame.loc[:12.0, "sensors.mass.y_obs"] = 289e3  # of the lighter boxes
    frame.loc[12.0:, "sensors.mass.y_obs"] = 302e3
    log = watched(frame)
    changed = np.flatnonzero(np.diff(log["box"])) + 1
    assert (log["box"][-1] != log["box"][1500]) and log["valid"][changed[-1]] > 0
    assert not log["alarm"].any()
    for name, small in (("path", 0.01 * RAD_PER_DEG), ("f_hat_elevator", 0.01 * RAD_PER_DEG), ("f_hat_n_z", 0.0006)):
        assert np.abs(np.diff(log[name]))[changed - 1].max() < small, name
    assert np.abs(log["f_hat_elevator"][-1] - log["f_hat_elevator"][changed[-1] - 1]) < 1.0 * RAD_PER_DEG


def test_it_says_why_it_is_silent(faulty):
    log, t = watched(faulty), faulty.index.to_numpy()
    assert np.array_equal(log["valid"] > 0, log["why"] == why.VALID)
    assert (log["why"][t < 7.9] == why.NOT_READY).all()
    lost, heavy = faulty.copy(), faulty.copy()
    lost.loc[13.0:, "sensors.alpha_ground.valid_obs"] = 0.0
    assert (watched(lost)["why"][t > 13.01] == why.LOST_SENSOR).all()
    heavy["sensors.mass.y_obs"] = 500e3
    assert (watched(heavy)["why"] == why.BOX_MASS).all()


def test_no_box_is_believed_beyond_the_fastest_mach_number_that_one_was_fitted_to():
    frame = flown(*LIGHT, "flight.altitude_ft=35000", "flight.cas_kt=315", "flight.turbulence=none")
    assert (frame[WIRES["mach"]] > 0.9).all()
    log = watched(frame)
    assert not log["valid"].any() and set(log["why"][frame.index > 8.1]) == {why.BOX_MACH}
    assert not log["learned"].any() and not log["offset"].any()  # nor is anything learned there


def test_an_error_of_the_pitch_rate_is_called_neither_n_z_nor_the_vane():
    frame = flown(*LIGHT, "flight.turbulence=light")
    frame["sensors.q.y_obs"] += 3.0 * RAD_PER_DEG * (frame.index >= 12.0)
    log = watched(frame)
    said = log[log["alarm"] > 0.5]
    assert len(said) > 300 and not (log["alarm_n_z"] + log["alarm_alpha"]).any()
    assert (said["verdict"] == AMBIGUOUS).all() and not said["isolated_part"].any()


def test_an_oscillation_far_below_the_threshold_of_a_step_is_found_within_four_periods(oscillating):
    t, log = oscillating.index.to_numpy(), watched(oscillating)
    on = log["alarm_elevator"] > 0.5
    assert ONSET <= t[on][0] < ONSET + 4.0 and (log["verdict"][on] == OFC_LIQUID).any()


def test_a_stall_is_no_gust_that_hides_faults_afterwards():
    """Beyond the linear lift the estimate of gusts is wrong by 20 deg: soon after it a large fault is found again."""
    at, slow = 71.0, ("flight.mass_t=280", "flight.cas_kt=260", "manoeuvre.kind=aoa_protection")
    fault = f"faults=[{{target='elevator.all',kind='bias',at='command',bias_deg=10.0,start_s={at}}}]"
    frame = fly(load_scenario("cruise", ["detectors.enabled=[]", "duration_s=75", *slow, fault]), WIRES.values())
    t, log = frame.index.to_numpy(), watched(frame)
    on = t[log["alarm_elevator"] > 0.5]
    assert at < on[0] < at + 1.2 and (log["valid"][t > at] > 0.5).all()


def test_noise_at_an_edge_of_the_envelope_and_where_the_elevator_is_weak_raises_no_alarm():
    for place in ((*SLOW_HEAVY, "seed=88020006"), AT_AN_EDGE):
        assert not watched(flown("duration_s=60", *place))["alarm"].any()


@pytest.mark.parametrize("speed", [40, -40])
def test_a_lateral_gust_in_still_air_is_no_fault(speed):
    place = ("flight.mass_t=204.2", "flight.cg_pct=26.8", "flight.altitude_ft=15000", "flight.cas_kt=205")
    gust = f"flight.gusts=[{{axis='lateral',shape='ramp',start_s=14,speed_fps={speed},gradient_ft=318}}]"
    frame = flown("duration_s=20", *place, gust)
    log, blown = watched(frame), frame.index.to_numpy() > ONSET
    assert log["valid"][blown].all() and not log["alarm"].any()
    assert np.abs(log["f_hat_n_z"][blown]).max() < 0.04  # .06 where the wind is taken for a sideslip over the ground


@pytest.mark.parametrize("from_deg", [0.0, 180.0])
def test_a_wind_along_the_flight_is_no_gust(from_deg):
    log = watched(flown("duration_s=45", "flight.wind_kt=50", f"flight.wind_from_deg={from_deg}", "seed=63000200"))
    assert log["ahead"][-1] == pytest.approx(math.cos(math.radians(from_deg)) * 50 * 0.5144, rel=0.03)
    assert np.abs(log["gust_hat"][2000:]).max() < math.radians(0.4) and (log["valid"][2000:] > 0.5).all()


def test_a_wind_across_is_learned_in_a_bank_and_no_fault_of_the_vane():
    log = watched(flown("duration_s=45", "flight.wind_kt=50", "flight.wind_from_deg=90", "seed=63000200",
                        "manoeuvre.kind=coordinated_turn", "manoeuvre.start_s=15"))  # fmt: skip
    assert np.abs(log["f_hat_alpha"][2000:]).max() < math.radians(0.25)
    assert not log["alarm"].any() and (log["valid"][2000:] > 0.5).all()
    assert log["rms"][2000:].max() > 2.0 * math.sqrt(log["gust"][3600])  # until the bank has told, limits are wider


KINDS = ("aoa_protection", "pitch_protection", "nose_up", "cruise", "nz_doublet", "coordinated_turn", "aoa_protection",
         "pitch_protection")  # fmt: skip


def drawn(index, duration):
    """Return what lpv_smo held in drawn flight `index`, which once raised an alarm, and the time [s]."""
    seed, air = 68_000_000 + index, TURBULENCE[index // 8 % 3]
    rng, manoeuvre = np.random.default_rng([seed, 7]), {"kind": KINDS[index % 8]}
    manoeuvre["start_s"] = float(rng.uniform(10.0, 36.0))
    if manoeuvre["kind"] == "pitch_protection":
        manoeuvre["amplitude_g"] = float(rng.choice([0.15, 0.3]))
    technology = tuple(load_aircraft().technology.values())
    flight = draw(seed, point=POINT, manoeuvre=manoeuvre, turbulence=air, duration=duration, technology=technology,
                  sensors={"noise_scale": float(rng.choice([1.0, 1.2]))})  # fmt: skip
    flight = trimming(np.random.default_rng([seed, 2]), flight, {"turbulence": air})
    frame = fly(scenario(**flight), WIRES.values())
    return watched(frame), frame.index.to_numpy()


@pytest.mark.parametrize(("index", "duration"), ((1225, 80), (1289, 77), (1684, 24), (649, 130)))
def test_a_long_flight_without_a_fault_raises_no_alarm(index, duration):
    log, t = drawn(index, duration)
    assert not log["alarm"].any()
    assert (log["valid"] > 0.5)[t > duration - 10.0].any()


def test_a_stall_in_a_steep_bank_is_not_valid_though_the_observer_has_lost_the_angle_of_attack():
    log, t = drawn(281, 180)
    stalled = (t > 160.0) & (log["over"] > math.radians(15.0))
    assert stalled.sum() > 1000 and (log["alpha_hat"][stalled] < math.radians(8.0)).any()
    assert (log["why"][stalled] == why.BOX_ALPHA).all() and not log["alarm"].any()
