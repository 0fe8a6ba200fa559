"""The talk's vehicle: its JSBSim model obeys slide 7, residuals react as slide 10 says, isolation is not luck."""

import dataclasses

import numpy as np
import pytest

from cosim.flight.plant.plant import bare_model
from cosim.papers.mar10 import isolation, vehicle
from fdi.control_redundancy import structure


@pytest.fixture(scope="module")
def quiet():
    """A flight without a fault, and one whose motor and pitch fins fail; nominal coefficients."""
    return vehicle.fly(0), vehicle.fly(2)


def test_the_model_flies_by_the_equations_of_slide_7(quiet):
    """What the accelerometer reads less known part and G u is its noise and nothing else, in turns and climbs too."""
    flown, _ = quiet
    known, G = vehicle.equations(flown, vehicle.numbers())
    off = flown.a - known - np.einsum("trj,tj->tr", G, flown.u)
    late = off[500:]
    assert np.abs(late.mean(0)).max() < 0.01
    k = (flown.qbar * vehicle.numbers()["area"] / vehicle.numbers()["mass"]).mean()
    expected = [np.hypot(vehicle.NOISE, vehicle.VANE * k * abs(vehicle.numbers()[c])) for c in ("cxa", "cyb", "cza")]
    assert late.std(0) == pytest.approx(expected, rel=0.1)
    assert np.ptp(flown.a[500:, 1]) > 4.0 and np.ptp(flown.a[500:, 2]) > 4.0  # it does manoeuvre


@pytest.mark.parametrize("pitch, yaw", [("ic/q-rad_sec", "ic/r-rad_sec"), ("fin/m-rad", "fin/n-rad"),
                                        ("ic/alpha-deg", "ic/beta-deg")])  # fmt: skip
def test_moments_about_pitch_and_yaw_are_alike(pitch, yaw):
    """A body of revolution with the same tail in both planes: by symmetry it is damped, steered and turned into the
    wind about either axis alike."""
    found = []
    for given, moment in ((pitch, "moments/m-aero-lbsft"), (yaw, "moments/n-aero-lbsft")):
        start = {"ic/h-sl-ft": 10_000.0, "ic/vt-fps": 1000.0}
        _, port = bare_model(vehicle.MODEL, vehicle.DT, start | {given: 0.1})
        found.append(abs(port.get(moment)))
    assert found[0] == pytest.approx(found[1], rel=1e-6) and found[0] > 1.0


def test_families_are_those_of_the_printed_combination(quiet):
    flown, _ = quiet
    families, value, _, seen = isolation.residuals(flown, flown.u_c, isolation.Choices(mean_s=vehicle.DT))
    known, G = vehicle.equations(flown, vehicle.numbers())
    k = 1234
    for i, family in enumerate(families):
        c, s = structure.combination(G[k], family)
        assert value[k, i] == pytest.approx(c @ (flown.a[k] - known[k] - G[k] @ flown.u_c[k]), abs=1e-9)
        assert seen[k, i] == pytest.approx(s, abs=1e-9)
        assert [bool(abs(x) > 1e-9) for x in s] == [bool(x) for x in family.signature]


def test_a_residual_is_the_mean_of_the_time_that_is_chosen(quiet):
    flown, _ = quiet
    _, one, *_ = isolation.residuals(flown, flown.u_c, isolation.Choices(mean_s=vehicle.DT))
    _, mean, *_ = isolation.residuals(flown, flown.u_c, isolation.Choices(mean_s=0.3))
    n = round(0.3 / vehicle.DT)
    assert n > 10 and mean[1234] == pytest.approx(one[1235 - n : 1235].mean(0), abs=1e-9)


def test_both_faults_are_named_in_order_and_the_loss_is_measured(quiet):
    none, both = quiet
    assert isolation.isolate(none).names == ()
    said = isolation.isolate(both)
    assert [name for _, name in said.names] == ["delta_m", "eta"]
    assert all(0 <= t - at < 2.0 for (t, _), (_, at) in zip(said.names, vehicle.FAULTS[2]))
    assert said.loss == pytest.approx(0.25, abs=0.02)


def test_axes_or_commands_that_are_swapped_spoil_it(quiet):
    _, both = quiet
    turned = dataclasses.replace(both, a=both.a[:, [0, 2, 1]])
    assert [name for _, name in isolation.isolate(turned).names] != ["delta_m", "eta"]
    swapped = dataclasses.replace(both, u_c=both.u_c[:, [0, 2, 1, 3]])
    assert [name for _, name in isolation.isolate(swapped).names] != ["delta_m", "eta"]
