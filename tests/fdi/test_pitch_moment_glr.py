"""The likelihood ratio of an elevator oscillation: seen or not by its size, silent without one, same bits."""

import functools
import math

import numpy as np
import pytest

from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import fly, inputs
from cosim.scenario.aircraft import load_aircraft
from cosim.scenario.catalog import SEGMENTS
from cosim.training.flights import scenario
from fdi.common import verdict
from fdi.common.why import BOX_ALPHA, BOX_SPEED, LOST_SENSOR, NOT_READY, VALID
from fdi.pitch_moment_glr import core, moment
from fdi.pitch_moment_glr import pitch_moment_glr as glr

DT, ONSET = 0.005, 15.0
NAME = glr.DETECTOR.id
FAULT = {"target": "elevator.all", "kind": "ofc_liquid", "at": "command", "start_s": ONSET, "amplitude_deg": 0.4,
         "frequency_hz": 1.5}  # fmt: skip


@functools.cache
def flown(fault=False, dt=DT):
    """Return the INPUTS (1, tick) of a cruise of 22 s in still air, with FAULT or without."""
    more = {"faults": [FAULT]} if fault else {}
    frame = fly(scenario(duration=22.0, seed=77_000_001, **more), dict.fromkeys(sources(NAME).values()))
    return inputs(frame, glr, sources(NAME))


@functools.cache
def designed():
    """Return PARAMS of four hydraulic segments at 200 Hz."""
    return glr.DETECTOR.fit(site(DT, "", dict.fromkeys(SEGMENTS, "hydraulic")))


def watched(u):
    """Return the OUTPUTS at every tick."""
    x, log = glr.init(designed()), np.zeros(u.shape, glr.STATE)
    glr.rollout(x, u, designed(), DT, log)
    return log[0]


def swinging(size, hz=1.5):
    """Return the inputs of the flight without a fault, the pitching swinging by `size` [rad/s2] from ONSET on."""
    u = flown().copy()
    t = np.arange(u.shape[1]) * DT - ONSET
    w = 2.0 * np.pi * hz
    u["qdot"][0] += np.where(t > 0.0, size * np.sin(w * t), 0.0)
    u["q"][0] += np.where(t > 0.0, size / w * (1.0 - np.cos(w * t)), 0.0)
    return u


def test_an_oscillation_of_the_elevators_is_seen_within_ten_periods_and_is_the_elevators():
    log = watched(flown(fault=True))
    at = np.flatnonzero(log["alarm"] > 0.5)
    assert len(at) and ONSET < at[0] * DT < ONSET + 10.0 / FAULT["frequency_hz"]
    assert log["frequency"][-1] == pytest.approx(FAULT["frequency_hz"], rel=0.06)
    assert glr.CULPRITS[int(log["culprit"][-1])] == "elevator"  # both sides: no side
    assert log["verdict"][-1] in (verdict.OFC_LIQUID, verdict.AMBIGUOUS)


def test_cruise_in_still_air_is_silent():
    log = watched(flown())
    assert (log["why"][: int(11.9 / DT)] == NOT_READY).all()
    assert (log["valid"][int(12.1 / DT) :] == 1.0).all()
    assert not log["alarm"].any()


@pytest.mark.parametrize("size, seen", [(8e-3, True), (2e-4, False)])
def test_what_swings_the_pitching_is_seen_by_its_size(size, seen):
    assert watched(swinging(size))["alarm"].any() == seen


def test_the_same_bits_tick_by_tick_in_pieces_and_at_once():
    u = swinging(8e-3)[:, : int(19.0 / DT)]
    x, whole = glr.init(designed()), np.zeros(u.shape, glr.STATE)
    glr.rollout(x, u, designed(), DT, whole)
    for piece in (1, 7):
        live = glr.init(designed())
        for k in range(0, u.shape[1], piece):
            glr.rollout(live, np.ascontiguousarray(u[:, k : k + piece]), designed(), DT)
        assert live.tobytes() == x.tobytes()
    assert whole["alarm"].any()


@pytest.mark.parametrize("name", ["q", "qdot", "alpha", "alpha_ground", "tas", "mass"])
def test_a_lost_reading_is_not_valid_until_it_is_back_and_raises_no_alarm(name):
    u = flown().copy()
    gone = slice(int(14.0 / DT), int(14.5 / DT))
    u[name][0, gone], u[f"{name}_valid"][0, gone] = np.nan, 0.0
    log = watched(u)
    inside = log[int(14.2 / DT) : int(14.5 / DT)]
    assert (inside["valid"] == 0.0).all() and (inside["why"] == LOST_SENSOR).all()
    assert log["why"][-1] == VALID and not log["alarm"].any()
    assert np.isfinite(log["r"]).all()


@pytest.mark.parametrize("value", [0.0, -1e300, 30.0, 500.0])
def test_out_of_its_range_of_speed_it_is_not_valid(value):
    u = flown().copy()
    u["tas"][0, int(14.0 / DT) :] = value
    log = watched(u)
    assert (log["valid"][int(14.1 / DT) :] == 0.0).all() and (log["why"][int(14.1 / DT) :] == BOX_SPEED).all()


@pytest.mark.parametrize("name", ["command", "alpha", "q", "n_z", "mass", "cg", "mach"])
def test_hostile_numbers_never_alarm_as_valid_with_a_state_that_is_not_finite(name):
    u = flown().copy()
    u[name][0, int(14.0 / DT) :: 7] = 1e308
    log = watched(u)
    for field in ("r", "lost"):
        bad = ~np.isfinite(log[field])
        assert (log["valid"][bad] == 0.0).all() and (log["alarm"][bad] == 0.0).all()


def test_levinsons_recursion_finds_an_autoregression():
    a = np.array([0.9, -0.5])
    rng, n = np.random.default_rng(1), 200_000
    e, y = rng.standard_normal(n), np.zeros(n)
    for k in range(2, n):
        y[k] = a[0] * y[k - 1] + a[1] * y[k - 2] + e[k]
    x = glr.init(designed())[0]
    for i in range(core.NA + 1):
        x.auto[i] = float(np.mean(y[i:] * y[: n - i]))
    power = core.levinson(x)
    assert x.ar[:2] == pytest.approx(a, abs=0.01) and np.abs(x.ar[2:]).max() < 0.02
    assert power == pytest.approx(1.0, abs=0.02)


def test_the_gyro_and_the_accelerometer_are_fused_without_a_change_of_the_signal_and_with_less_noise_than_either():
    ts, hz = 0.02, np.geomspace(0.3, 6.0, 12)
    h, w = designed()["blend"][0], 2.0 * np.pi * hz
    response = (h * np.exp(-1j * np.outer(w * ts, np.arange(len(h)) - len(h) // 2))).sum(axis=1).real
    noise = (w * moment.TAU_FUSE) ** 2
    made = response**2 * noise + (1.0 - response) ** 2  # over the accelerometer's alone
    assert np.mean(made) < 0.9 and np.mean(2.0 * noise / (1.0 + noise)) > 1.2  # a first-order complementary filter's
    x, p, out = glr.init(designed())[0], designed()[0], []
    t = np.arange(200) * ts
    for k in t:
        out.append(moment.fuse(x, p, -math.cos(8.0 * k) / 8.0, math.sin(8.0 * k), ts))
        x.filled = 1.0
    assert np.abs(np.array(out) - np.sin(8.0 * (t - moment.LATE * ts)))[20:].max() < 0.01


def level(made, hz):
    """Return what is left of the pitch acceleration at `hz` when a flight ends [rad/s2 per root Hz]."""
    x, u = glr.init(designed()), inputs(fly(made, dict.fromkeys(sources(NAME).values())), glr, sources(NAME))
    glr.rollout(x, u, designed(), DT)
    turn = np.exp(-2j * np.pi * hz * glr.SAMPLE * np.arange(1, core.NA + 1))
    return math.sqrt(2.0 * glr.SAMPLE * x["power"][0]) / abs(1.0 - x["ar"][0] @ turn)


def in_light_air(held):
    return scenario(duration=30.0, seed=77_000_004, flight={"turbulence": "light"},
                    manoeuvre={"kind": "cruise", "hold_speed": held})  # fmt: skip


def test_thrust_that_holds_the_speed_in_gusts_is_no_noise():
    assert level(in_light_air(True), 0.4) < 1.5 * level(in_light_air(False), 0.4)  # it was three times as loud


def test_gusts_along_the_way_and_friction_leave_little_in_light_air():
    # deg/s2 per root Hz: 0.019 where the tail was given the vane's gust and friction was a lag
    assert np.degrees(level(in_light_air(False), 0.8)) < 0.015


def test_the_tail_meets_the_vertical_gust_alone():
    alpha, tas, along, up = 0.12, 180.0, -6.0, 1.5
    u, w = tas * math.cos(alpha), tas * math.sin(alpha)
    v_ground = math.hypot(u - along, w - up)
    assert moment.upward(alpha, math.atan2(w - up, u - along), tas, v_ground) == pytest.approx(up / tas, abs=1e-12)


def test_friction_turns_after_the_same_way_of_the_rod_on_every_aircraft():
    for own in (None, load_aircraft("narrowbody")):
        p = glr.DETECTOR.fit(site(DT, "", {"left": "hydraulic", "right": "ema"}, own=own))[0]
        x, command = glr.init(np.array([p]))[0], 0.0
        for k in range(400):
            command = 2e-3 / p["arm"] * math.sin(math.pi * k * DT)  # the rod goes 2 mm to and fro
            moment.follow(x, p, 0, command, DT)
            if k == 200:
                assert x["stick"] < -0.9
            elif k == 70:
                assert x["stick"] > 0.9


def test_after_an_angle_of_attack_beyond_its_limit_it_begins_anew():
    u = flown().copy()
    steep = slice(int(14.0 / DT), int(15.0 / DT))
    for name in ("alpha", "alpha_ground"):
        u[name][0, steep] += 0.25
    log = watched(u)
    assert (log["why"][int(14.1 / DT) : int(15.0 / DT)] == BOX_ALPHA).all()
    assert log["why"][-1] == VALID and not log["alarm"].any() and log["since"][int(18.0 / DT)] == 0.0
