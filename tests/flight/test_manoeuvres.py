"""Manoeuvres: what each is for happens, at every point, and nothing departs without a fault."""

import math

import numpy as np
import pytest
from flown import deg, fly, scenario, wrapped

from actuators.constants import M_PER_FT, M_S_PER_KT
from cosim.flight.plant.point import SIX

SLOW_KT = {"sun13": 150, "A": 170, "B": 175, "C": 210, "D": 235, "E": 190}  # where the pull ends at alpha_max


def pulled(point, **more):
    """Fly full back-stick from 5 to 25 s; return the flight and alpha above `alpha_lim` and alpha_max [rad]."""
    f = fly(scenario(point, "aoa_protection", duration_s=26.0, **more))
    most = f.setup.loop.law.p["alpha_max"][0]
    return f, f.alpha - f.alpha_lim, f.alpha - most


@pytest.mark.parametrize("point", SIX)
def test_full_back_stick_holds_the_limit_that_binds(point):
    """Alpha within 1 deg of `alpha_lim` from 5 s after the pull on, never 2 deg above it or above alpha_max."""
    f, off, above = pulled(point)
    late = (f.t > 10.0) & (f.t < 25.0)
    assert f.status == "completed"
    assert deg(np.abs(off[late]).max()) < 1.0
    assert deg(off[f.t > 5.0].max()) < 2.0 and deg(above.max()) < 2.0
    assert f.nz.max() < 2.7  # 2.5 g is demanded, 8 % beyond it in the first second
    assert deg(f.theta.max()) < 31.5


def test_alpha_limit_itself_binds_where_its_load_factor_is_small():
    """At point C (1.33 g at the limit) alpha stands at alpha_max from 5 s on to the end of the pull."""
    f, _, above = pulled("C")
    late = (f.t > 10.0) & (f.t < 25.0)
    assert deg(np.abs(above[late]).max()) < 1.0
    assert set(f.protection[late]) == {1.0}


@pytest.mark.parametrize("seed", [3, pytest.param(4, marks=pytest.mark.slow)])
@pytest.mark.parametrize("air", [pytest.param("light", marks=pytest.mark.slow), "moderate"])
@pytest.mark.parametrize("point", SLOW_KT)
def test_alpha_protection_in_turbulence_does_not_drive_the_elevator_from_stop_to_stop(point, air, seed):
    """The command stays within half the travel, the surface works at most 2.5 times as fast as in cruise there."""
    keys = {"duration_s": 26.0, "flight__turbulence": air, "seed": seed, "flight__cas_kt": SLOW_KT[point]}
    f, still = (fly(scenario(point, kind, **keys)) for kind in ("aoa_protection", "cruise"))
    late = slice(round(8.0 / 0.005), round(25.0 / 0.005))
    command, (rate, cruise) = deg(f.de_cmd[late]), (np.linalg.norm(np.diff(deg(x.de_li[late]))) for x in (f, still))
    assert f.status == "completed" and np.mean(f.protection[late] == 1.0) > 0.4
    assert -11.5 < command.min() and command.max() < 8.5
    assert rate < 2.5 * cruise


def banked(point, seed, turbulence="light"):
    return fly(scenario(point, "coordinated_turn", duration_s=75.0, flight__turbulence=turbulence, seed=seed))


def stays(f, feet):
    turning = (f.t > 15.0) & (f.t < 65.0)
    assert f.status == "completed"
    assert np.abs(f.h - f.h[0]).max() < feet * M_PER_FT
    assert np.abs(f.cas - f.cas[0])[turning].mean() < 5.0 * M_S_PER_KT
    assert abs(deg(f.phi[turning].mean()) - 30.0) < 1.0


@pytest.mark.parametrize(("point", "seed"), [("sun13", 1), ("A", 2), ("C", 3)])
def test_turn_at_30_degrees_in_light_turbulence_keeps_its_altitude(point, seed):
    stays(banked(point, seed), 50.0)


@pytest.mark.parametrize("point", ["sun13", "A", "C"])
def test_bank_is_reached_without_overshoot_and_without_sideslip(point):
    f = fly(scenario(point, "coordinated_turn", sensors__noise_scale=0.0))
    assert 29.0 < deg(f.phi.max()) < 30.6
    assert deg(np.abs(f.beta).max()) < 0.3
    assert np.abs(f.h - f.h[0]).max() < 25 * M_PER_FT


@pytest.mark.parametrize(("point", "heading"), [("B", 10.0), ("C", -10.0), ("sun13", -170.0)])
def test_heading_is_captured_across_north_without_overshoot(point, heading):
    f = fly(scenario(point, "yaw_angle", manoeuvre__heading_deg=heading, duration_s=50.0 + 0.9 * abs(heading)))
    psi = deg(np.unwrap(f.psi))
    psi = (psi - psi[0]) * np.sign(heading)
    assert abs(psi[-1] - abs(heading)) < 0.3
    assert psi.max() < abs(heading) + 0.3 and psi.min() > -0.3
    assert deg(np.abs(f.phi).max()) < 26.5
    assert np.abs(f.h - f.h[0]).max() < 25 * M_PER_FT and np.abs(f.cas - f.cas[0]).max() < 4 * M_S_PER_KT


def test_bank_that_ailerons_or_wing_cannot_hold_is_not_flown():
    slow = fly(scenario("low slow", "coordinated_turn", duration_s=60.0))  # 160 kt clean: 20 deg of aileron hold 18 deg
    steep = fly(scenario("C", "coordinated_turn", duration_s=60.0, manoeuvre__bank_deg=60.0))  # 1.33 g at the limit
    for f, most in ((slow, 16.0), (steep, 39.0)):
        assert f.status == "completed"
        assert deg(f.phi.max()) < most
        assert np.abs(f.h - f.h[0]).max() < 50 * M_PER_FT


def test_pitch_protection_stops_the_nose_at_30_degrees():
    f = fly(scenario("sun13", "pitch_protection", duration_s=35.0, manoeuvre__duration_s=25.0))
    assert 2.0 in f.protection
    assert 28.0 < deg(f.theta.max()) < 31.0


def test_engine_out_is_trimmed_by_the_rudder():
    for point, swing in (("sun13", 3.0), ("C", 10.0)):  # at C the ailerons reach their stop
        f = fly(scenario(point, duration_s=60.0, faults__0__target="engine.4", faults__0__kind="thrust_loss",
                         faults__0__loss_pct=100.0, faults__0__start_s=5.0))  # fmt: skip
        late = f.t > 55.0
        assert f.status == "completed"
        assert deg(np.abs(f.phi).max()) < swing and deg(np.abs(f.phi[late]).max()) < 1.0
        assert deg(np.abs(f.beta).max()) < 1.5 and deg(np.abs(f.beta[late]).max()) < 0.2
        assert f.dr[late].min() > math.radians(0.5)  # left rudder against the dead right engine
        assert abs(deg(wrapped(f.psi[-1]))) < 10.0
