"""What a window of samples leaves of each hypothesis, names that take their time, and noise that is heard."""

import numpy as np
import pytest

from cosim.flight.loop.signals import fly
from cosim.scenario import load_scenario
from cosim.training.flights import watch, wires
from fdi.common import bank, verdict
from fdi.hydraulic import hypotheses, iotsekf, losses, runaway_test, sample_rings, sensor_noise

P = iotsekf.params()[0]
N = sample_rings.N
LOSSY = int(np.argmin(P["bank_loss"]))  # the frequency whose samples are averaged over most of its period


def state(**fields):
    x = iotsekf.init(iotsekf.params())[0]
    for name, value in fields.items():
        x[name] = value
    return x


def filled(f, d, level=2):
    """Return a state whose ring of `level` holds N samples of f and d, oldest first."""
    x = state()
    x["bank_ring"][0, level], x["bank_ring"][1, level] = f, d
    x["bank_seen"][level] = N
    return x


@pytest.mark.parametrize("cycles", [1.25, 2.0, 3.3])
def test_a_swing_about_a_mean_leaves_nothing_at_its_frequency_and_much_beside_it(cycles):
    angle = 2.0 * np.pi * cycles / N
    w = 0.02 * np.sin(angle * np.arange(N) + 0.4) + 0.003
    x = filled(w, np.zeros(N))
    about, left, mean = sample_rings.swing(x, 2, N, angle)
    assert left < 1e-9 * about and mean == pytest.approx(w.mean())
    _, beside, _ = sample_rings.swing(x, 2, N, 1.4 * angle)
    assert beside > 0.02 * about


def test_a_sine_in_the_command_is_not_one_in_the_fault():
    angle = 2.0 * np.pi * 2.0 / N
    d = 0.05 * np.sin(angle * np.arange(N))
    ff, fd, dd, f0, _, d0, a, _ = sample_rings.tone(filled(0.0 * d, d), P, 2, N, angle)
    assert ff == fd == f0 == a == 0.0 and d0 < 1e-9 * dd


@pytest.mark.parametrize(("of", "share"), [("d", -0.5), ("z", -0.3)])
def test_a_loss_explains_its_own_motion(of, share):
    rng = np.random.default_rng(2)
    d, z = 0.05 * rng.standard_normal((2, N))
    x = state(even_seen=N)
    x["even_ring"][:] = share * {"d": d, "z": z}[of], d, z
    H, E, _ = losses.loss(x, N)
    assert E < 1e-9 * H
    x["even_ring"][0] *= -1.0  # what adds to the command is no loss
    H, E, _ = losses.loss(x, N)
    assert E > 0.9 * H


def stands(shape):
    """Return whether the fastest ring with w of `shape`, against a servo that fights it, shows an open valve."""
    d = np.where(np.abs(shape) > 1e-3, -0.5 * np.sign(shape[-1]) * np.abs(shape).max(), 0.0)
    return runaway_test.is_runaway(filled(shape - d, d, 0), P, 0, 12, 0.01, 0.0)


def test_a_valve_that_jumps_and_stays_stands_open_and_the_crest_of_a_sine_does_not():
    t = np.arange(N) * 0.01
    assert stands(np.where(t > 0.2, 0.08, 0.0))
    for hz in (0.7, 1.0, 1.4, 2.0):
        crest = 0.04 * np.sin(2.0 * np.pi * hz * (t - t[-1]) + np.pi / 2.0)
        assert not stands(np.where(t > t[-1] - 0.25 / hz, crest, 0.0))


def test_votes_of_one_frequency_make_a_name_and_others_begin_anew():
    x = state(declared=1.0)
    for clock, hz in ((1.0, 1.0), (2.0, 1.02), (4.5, 1.0)):
        x.clock = clock
        hypotheses.vote(x, 0, hz, 0.0, 0.0)
    assert x.sure[0] == 0.0  # more than a period and a half without one
    x.clock = 5.5
    hypotheses.vote(x, 0, 1.0, 1.0, 3.0)
    assert x.sure[0] == pytest.approx(1.0)
    hypotheses.vote(x, 0, 1.0, 1.0, 3.0)
    assert x.sure[0] == pytest.approx(4.0)
    hypotheses.vote(x, 1, 1.0, 0.0, 0.0)
    assert x.sure[0] == 0.0


def test_what_a_nameless_alarm_leaves_behind_is_the_slow_ring():
    for slow in (False, True):
        x = state(slow_seen=40.0, even_seen=50.0)
        x.bank_seen[:], x.slow_hit[:], x.hit[:] = 30.0, 2.0, 2.0
        hypotheses.forget(x, slow)
        assert not x.bank_seen.any() and not x.hit.any() and x.even_seen == 0.0
        assert x.slow_seen == (0.0 if slow else 40.0) and (x.slow_hit == (0.0 if slow else 2.0)).all()


def concluded(**fields):
    x = state(ofc_timer=1.0, **fields)
    hypotheses.conclude(x, False, False)
    return x


def test_an_alarm_is_ambiguous_until_a_name_is_sure_and_keeps_it():
    assert concluded().verdict == verdict.AMBIGUOUS
    x = concluded(sure=(3.0, 0.0))
    assert x.verdict == verdict.OFC_LIQUID
    x.sure[:] = 0.0, 4.0
    hypotheses.conclude(x, False, False)
    assert x.verdict == verdict.OFC_LIQUID
    x.sure[:] = 0.0, 9.0
    hypotheses.conclude(x, False, False)
    assert x.verdict == verdict.OFC_SOLID
    x.ofc_timer = 0.0
    hypotheses.conclude(x, False, False)
    assert x.declared == 0.0 and x.verdict == verdict.NONE


@pytest.mark.parametrize(("name", "proof", "deaf"), [(verdict.OFC_LIQUID, -50.0, 1.0), (verdict.OFC_SOLID, 50.0, 0.0)])
def test_a_name_that_the_valve_contradicts_is_taken_back(name, proof, deaf):
    x = state(ofc_timer=1.0, named=name)
    hypotheses.conclude(x, False, False)
    assert x["verdict"] == name
    x["proof"], x["deaf"] = proof, deaf
    hypotheses.conclude(x, False, False)
    assert x["verdict"] == verdict.AMBIGUOUS and x["declared"] == 1.0


@pytest.mark.parametrize("times", [1.0, 2.0, 6.0])
def test_a_rods_noise_is_heard_and_its_motion_is_not(times):
    rng, dt = np.random.default_rng(5), 0.005
    x, loud = state(), []
    for k in range(400):
        q = 0.03 * np.sin(2.0 * np.pi * 3.0 * k * dt) + times * 1e-4 * rng.standard_normal()
        sensor_noise.update(x, 1.0, q, q, 0.0, 0.0, 0.0, 0.0, P, dt)
        loud.append(float(x.rod_noisy))
    assert np.mean(loud[200:]) == (1.0 if times > 4.0 else 0.0)


@pytest.mark.parametrize("hz", [3.0, 9.0])
def test_a_fast_oscillation_of_the_pressure_is_no_noise(hz):
    rng, dt, x = np.random.default_rng(6), 0.005, state()
    for k in range(400):
        z = 0.8 * np.sin(2.0 * np.pi * hz * k * dt) + 0.005 * rng.standard_normal()
        sensor_noise.update(x, 0.0, 0.0, 0.0, 1.0, z, z, 0.0, P, dt)
    assert x.dp_noisy == 0.0


def test_one_spike_is_no_noise():
    x = state()
    for k in range(400):
        sensor_noise.update(x, 1.0, 0.02 if k == 300 else 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, P, 0.005)
        assert x.rod_noisy == 0.0 and x.rod_wild < sensor_noise.WILD * P.r_rod


def found(k, hz, amplitude, fit):
    """Return a state that has found `amplitude` at `hz`, after two periods and more of a sine of amplitude `fit`."""
    x = state(ofc_hz=hz, ofc_amplitude=amplitude)
    for i in range(round(3.0 / P["bank_hz"][k] / 0.005)):
        bank.push(x, P, fit * np.sin(2.0 * np.pi * P["bank_hz"][k] * i * 0.005), 0.0)
    x["ratio"][k] = fit / P["bank_threshold"][k]
    return x


def test_an_oscillation_stays_while_its_fit_is_as_large_as_it_was():
    k = LOSSY  # so that a loss made good twice would show
    hz, a = P["bank_hz"][k], 3.0 * P["bank_threshold"][k]
    assert all(hypotheses.stays(found(k, hz, a, part * a), P, k) for part in (0.63, 0.9, 1.6))
    for gone in (found(k, hz, a, 0.57 * a), found(k, hz, a, 1.75 * a), found(k, 1.3 * hz, a, a)):
        assert not hypotheses.stays(gone, P, k)
    small = 0.5 * P["bank_threshold"][k]
    assert not hypotheses.stays(found(k, hz, small, small), P, k)  # below what quiet air shows
    moved = found(k, hz, a, a)
    moved["named"] = verdict.RUNAWAY
    assert not hypotheses.stays(moved, P, k)


def test_a_manoeuvre_does_not_end_the_alarm_of_a_small_oscillation():
    """While the doublet lasts no window of the residual is a sine alone; the fault goes on."""
    keys = {"duration_s": 26, "faults.0.start_s": 12, "faults.0.frequency_hz": 0.7, "faults.0.amplitude_mm": 0.8,
            "manoeuvre.kind": "nz_doublet", "manoeuvre.start_s": 16.7, "manoeuvre.amplitude_g": 0.3,
            "manoeuvre.width_s": 1.85, "detectors.enabled": '["iotsekf"]'}  # fmt: skip
    inputs = wires(iotsekf, "left_inner")
    frame = fly(load_scenario("liquid-ofc", [f"{k}={v}" for k, v in keys.items()]), inputs.values())
    log = watch(frame, iotsekf, iotsekf.params(), ("alarm", "verdict"), ("left_inner",))[0]
    on = log["alarm"] > 0.5
    rose = int(np.argmax(on))
    assert 12.0 < rose * 0.005 < 15.0 and on[rose:].all()
    assert set(log["verdict"][rose:]) <= {verdict.AMBIGUOUS, verdict.OFC_LIQUID}
