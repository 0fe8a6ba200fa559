"""LPV sliding-mode observer: what is designed and refused, reconstruction on the LPV plant, behaviour of the block."""

import dataclasses

import numpy as np
import pytest

from actuators.constants import RAD_PER_DEG
from cosim.papers.alwi14 import plant
from cosim.papers.alwi14.flights import POINTS
from cosim.training import lpv as training
from fdi.common.verdict import AMBIGUOUS, SENSOR
from fdi.lpv_smo import lpv_smo, synthesis
from fdi.lpv_smo import model as lpv_model

M = np.array([[1.0, 0, 0, 0, 0], [0, 0, 0, 1.0, 0]]).T  # (36)
F = np.eye(5)[4]  # the elevator turns the aircraft
MODEL, STORED = synthesis.load()
E = np.array(POINTS["E"], float)


def run(u, **options):
    """Return the log (tick,) of the stored design over INPUTS (1, tick)."""
    p = lpv_smo.params(model=MODEL, made=STORED, **options)
    log = np.zeros(u.shape, lpv_smo.STATE)
    lpv_smo.rollout(lpv_smo.init(p), u, p, 0.005, log)
    return log[0]


@pytest.mark.parametrize("point", ["A", "E"])
def test_simultaneous_faults_come_out_within_one_per_cent_on_the_lpv_plant(point):
    log = run(plant.fly(MODEL, np.array(POINTS[point], float), lpv_smo))
    late = log[-1000:]  # the last five seconds
    for name, true in (("f_hat_elevator", 3 * RAD_PER_DEG), ("f_hat_n_z", 0.5), ("f_hat_alpha", 5 * RAD_PER_DEG)):
        assert late[name].mean() == pytest.approx(true, rel=0.01)
    assert abs(late["f_hat_n_z_raw"].mean() / 0.5 - 1) > 0.01  # what (2) leaves out
    assert log["e_norm"].max() <= 1e-3


def test_sensor_noise_does_not_saturate_the_injection():
    log = run(plant.fly(MODEL, E, lpv_smo, noise=1.0))
    assert (log["nu_norm"] < 0.95).mean() >= 0.95
    measured = log["f_hat_elevator"][1000:2000].std()
    assert measured == pytest.approx(log["f_sigma"][1500], rel=0.35)  # correlated over 0.2 s: 25 independent values


def test_the_stored_design_verifies_and_a_spoilt_one_does_not():
    assert synthesis.verify(STORED)["ok"]
    assert not synthesis.verify(dataclasses.replace(STORED, gamma=0.5 * STORED.gamma))["ok"]
    assert not synthesis.verify(dataclasses.replace(STORED, L=-STORED.L))["ok"]


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda m: m | {"C": _put(m["C"], (1, 0, 1), 1.0)}, "varies with rho"),
        (lambda m: m | {"D": _put(m["D"], (0, 3, 0), 1.0)}, "feedthrough"),
        (lambda m: m | {"B": _put(m["B"], (slice(None), 4, 0), [-0.54, 0, 0, 0, 1.0])}, "singular inside the box"),
        (lambda m: m | {"F": np.array([1.0, 0, 0, 0, 0])}, "not seen"),
        (lambda m: m | {"C": m["C"][:, 1:], "D": m["D"][:, 1:]}, "no L and W"),  # altitude: too slow
        (lambda m: m | {"A": m["A"][:3]}, "B takes finite numbers of shape"),
        (lambda m: m | {"B": m["B"] * np.nan}, "B takes finite numbers"),
        (lambda m: m | {"actuator": (7,)}, "columns of B, of which there are 2"),
        (lambda m: m | {"poles": (50.0, 20.0)}, "a slow and a faster bound"),
        (lambda m: m | {"A22s": np.full(6, 3.0)}, "A22s are all negative"),
        (lambda m: m | {"box": m["box"][:, ::-1]}, "lowest, highest"),
    ],
)
def test_what_cannot_be_designed_says_why(change, message):
    given = change({"A": MODEL.A, "B": MODEL.B, "C": MODEL.C, "D": MODEL.D, "box": MODEL.box, "F": F})
    with pytest.raises(ValueError, match=message):
        synthesis.design(M=M, **given)


def _put(stack, where, value):
    out = stack.copy()
    out[where] = value
    return out


def test_a_dropout_leaves_no_nan_and_the_estimates_come_back():
    u = plant.fly(MODEL, E, lpv_smo)
    for name, first, last in (("q", 3000, 3040), ("alpha", 3200, 3300), ("cas", 3300, 3400), ("h", 0, 5)):
        u[name][0, first:last], u[name + "_valid"][0, first:last] = np.nan, 0.0
    u["de_lo"][0, 3500] = np.nan
    log = run(u)
    for name in lpv_smo.STATE.names:
        assert np.isfinite(log[name][10:]).all(), name
    assert log["valid"][3010] == 0 and log["valid"][3250] == 0
    assert log["f_hat_elevator"][-1] / RAD_PER_DEG == pytest.approx(3.0, rel=0.01)
    assert log["f_hat_alpha"][-1] / RAD_PER_DEG == pytest.approx(5.0, rel=0.01)


@pytest.mark.parametrize(
    "faults, verdict, isolated_part",
    [
        ((3.0, 0.0, 0.0), AMBIGUOUS, "elevator"),
        ((0.0, 0.5, 0.0), SENSOR, "n_z"),
        ((0.0, 0.0, 5.0), SENSOR, "alpha"),
        ((0.0, 0.0, 0.0), 0.0, ""),
    ],
)
def test_single_faults_are_named(faults, verdict, isolated_part):
    log = run(plant.fly(MODEL, E, lpv_smo, faults=faults, noise=1.0))
    assert log["alarm"][:2000].max() == 0
    end = log[2300:2600]
    assert set(end["verdict"]) == {verdict}
    assert {lpv_smo.ISOLABLE_PARTS[int(c)] for c in end["isolated_part"]} == {isolated_part}


def test_a_model_without_scheduling_is_designed_too():
    A, B, C, D = (lpv_model.at(S, E) for S in (MODEL.A, MODEL.B, MODEL.C, MODEL.D))
    assert synthesis.verify(synthesis.design(A, B, C, D, F=F, M=M))["ok"]
    with pytest.raises(ValueError, match="box takes"):
        synthesis.design(A, B, C, D, F=F, M=M, box=[[0, 1]])


def test_a_declared_fault_stands_until_its_estimate_is_well_below_the_threshold():
    """An estimate that hovers about its threshold is one fault, not many; one that is gone ends its alarm."""
    p = lpv_smo.params(model=MODEL, made=STORED)[0]
    x = lpv_smo.init(np.array([p]))[0]

    def declared(share, seconds):
        x.f_hat_n_z, out = share * p.limit[1], []
        for _ in range(round(seconds / 0.02)):
            lpv_smo._decide(x, p, 0.02)
            out.append(x.alarm_n_z)
        return out

    assert not any(declared(0.95, 5.0)) and declared(1.05, 5.0)[-1] == 1.0
    assert all(declared(0.8, 10.0))
    assert declared(0.6, p["t_confirm"] + p["t_release"] + 0.1)[-1] == 0.0 and not any(declared(0.95, 5.0))


def test_a_grid_that_cannot_determine_the_coefficients_is_refused():
    with pytest.raises(ValueError, match="undetermined"):
        lpv_model.fit(np.ones((6, 2)), np.zeros((6, 1, 1)), box=[[0, 2], [0, 2]])


def test_the_weights_of_a_grid_are_those_of_the_trapezoidal_rule():
    w = training.volume(training.grid(3))
    assert len(w) == 81 and w.sum() == pytest.approx(2.0**4)  # two cells per parameter
    assert w.min() == 1 / 16 and w.max() == 1.0
