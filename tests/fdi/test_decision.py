"""The shared decision kernels: confirmation, the frequency bank against least squares, the pair test, the gyro."""

import numpy as np
import pytest

from actuators.block import dtype
from actuators.constants import RAD_PER_DEG
from fdi.common import bank, decision, sinusoid, tuning
from fdi.lpv_smo import gyro

DT = 0.005
BANK_PARAMS, BANK_STATE = dtype(bank.PARAMS), dtype(bank.state(2))
PAIR_PARAMS, PAIR_STATE = dtype(decision.PAIR_PARAMS), dtype([*decision.PAIR_STATE, *decision.LEVER_STATE])


def bank_params():
    p = np.zeros(1, BANK_PARAMS)
    for name, value in bank.design(DT).items():
        p[name][0] = value
    return p


def feed(residual, drive=None):
    """Return the bank's STATE after all samples."""
    p, x = bank_params(), np.zeros(1, BANK_STATE)
    drive = np.zeros_like(residual) if drive is None else drive
    for a, b in zip(residual, drive):
        bank.push(x[0], p[0], (a, b))
    return x[0], p[0]


def test_an_alarm_needs_the_confirmation_time_and_heals():
    timer, alarm, seen = 0.0, 0.0, []
    for k in range(400):
        timer, alarm = decision.confirm(timer, alarm, 100 <= k < 120 or k == 40, DT, 0.05, 0.5)
        seen.append(alarm)
    assert seen.index(1.0) == 109  # ten ticks
    assert not any(seen[:109])
    healed = 109 + seen[109:].index(0.0)
    assert (healed - 119) * DT == pytest.approx(0.55, abs=2 * DT)


def test_the_bank_is_least_squares_over_two_periods():
    rng = np.random.default_rng(0)
    y = np.cumsum(rng.standard_normal(1600)) * 1e-3
    x, p = feed(y)
    for k in range(bank.K):
        D, n = int(p.bank_block[int(p.bank_level[k])]), int(p.bank_n[k])
        weights = np.concatenate([np.arange(1, D + 1), np.arange(D - 1, -1, -1)]) / D**2
        last = (len(y) // D) * D
        samples = np.array([weights @ y[e - 2 * D : e] for e in range(last - (n - 1) * D, last + 1, D)])
        t = (np.arange(n) - (n - 1) / 2) * D * DT
        w = 2 * np.pi * p.bank_hz[k]
        fit = np.linalg.lstsq(np.stack([np.cos(w * t), np.sin(w * t), t**0, t, t * t], axis=1), samples, rcond=None)[0]
        if int(x.bank_seen[int(p.bank_level[k])]) % int(p.bank_stride[k]) == 0:  # renewed at the last sample
            assert (x.bank_cos[0, k], x.bank_sin[0, k]) == pytest.approx(fit[:2] / p.bank_loss[k], rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("hz", [0.5, 0.6, 2.0, 3.3, 10.0])
def test_amplitude_and_agreement_of_a_sinusoid(hz):
    t = np.arange(1400) * DT
    x, p = feed(0.3 * np.sin(2 * np.pi * hz * t) + 0.2 + 0.1 * t)
    k = int(np.argmin(np.abs(np.log(p.bank_hz / hz))))
    assert bank.amplitude(x, k, 0) == pytest.approx(0.3, rel=0.12)  # between two frequencies
    x, p = feed(0.3 * np.sin(2 * np.pi * hz * t))
    agreement, purity = bank.character(x, p, k, 0, 0.0)
    assert agreement > 0.6 and purity > 0.75


def test_a_step_is_no_oscillation():
    hits = 0
    p, x = bank_params(), np.zeros(1, BANK_STATE)
    for k in range(1600):
        bank.push(x[0], p[0], (1.0 if k > 700 else 0.0, 0.0))
        for f in range(bank.K):
            if x["bank_new"][0, f] and bank.amplitude(x[0], f, 0) > 0.05:
                agreement, purity = bank.character(x[0], p[0], f, 0, 0.0)
                hits += agreement > 0.5 and purity > 0.3
    assert hits == 0


def pair(y_rod, y_surface, model_v, load=0.0, q=None):
    p, x = np.zeros(1, PAIR_PARAMS), np.zeros(1, PAIR_STATE)
    for name, value in tuning.thresholds("rtsekf_flight").items():
        if name in p.dtype.names:
            p[name] = value
    out = np.zeros(len(y_rod), PAIR_STATE)
    for k in range(len(y_rod)):
        rod, slack, step = float(np.isfinite(y_rod[k])), 0.0, model_v[k] * DT
        if q is not None:
            x["rigging"][0], slack = decision.lever_at(x[0], q[k], step), decision.lever_slack(x[0], q[k], step)
        decision.pair_test(x[0], y_rod[k], rod, y_surface[k], 1.0, model_v[k], load, slack, q is not None, p[0], DT)
        if q is not None and rod > 0.5 and x[0].sensor < 0.5:
            decision.learn_lever(x[0], y_rod[k] - y_surface[k], q[k], step, 2e-8, DT)
        out[k] = x[0]
    return out


@pytest.mark.parametrize(("which", "name"), [(0, 1.0), (1, 2.0)])
def test_the_pair_test_blames_the_sensor_that_leaves_the_model(which, name):
    rng, n = np.random.default_rng(4), 2000
    t = np.arange(n) * DT
    q, v = 0.02 * np.sin(2 * t), 0.04 * np.cos(2 * t)
    y = q + 1e-4 * rng.standard_normal((2, n)) + [[0.0], [4e-4]]  # rigging
    y[which, 1200:] += 6e-4
    out = pair(*y, 1.05 * v)
    assert not out["sensor"][:1200].any()
    assert out["sensor"][1260] == 1.0
    assert out["blame"][1260] == name
    assert out["rigging"][1199] == pytest.approx(-4e-4, abs=1e-4)


@pytest.mark.parametrize("off", [-0.01, 0.01])
def test_a_lever_of_another_length_is_learned_and_a_scale_that_comes_later_is_not(off):
    """1 % of 40 mm is almost twice the threshold: without the lever it alarms in every stroke."""
    rng, n = np.random.default_rng(4), 4000
    t = np.arange(n) * DT
    q, v = 0.01 + 0.04 * np.sin(0.5 * t), 0.02 * np.cos(0.5 * t)
    y = 1e-4 * rng.standard_normal((2, n)) + np.stack([q, (1.0 + off) * q])
    out = pair(*y, v, q=q)
    assert not out["sensor"].any()
    assert out["lever"][-1] == pytest.approx(-off, abs=0.001)
    y[1, 2000:] += 0.03 * q[2000:]
    assert pair(*y, v, q=q)["sensor"][2000:].any()


@pytest.mark.parametrize("ticks", [-1, 1])
def test_samples_of_another_age_are_learned(ticks):
    """A tick of 0.2 m/s is 1 mm, three times the threshold."""
    rng, n = np.random.default_rng(4), 2000
    t = np.arange(n) * DT
    y = 1e-4 * rng.standard_normal((2, n)) + 0.04 * np.sin(5.0 * np.stack([t, t - ticks * DT]))
    out = pair(*y, 0.2 * np.cos(5.0 * t), q=0.04 * np.sin(5.0 * t))
    assert not out["sensor"].any()
    assert out["lever_lag"][-1] == pytest.approx(ticks, abs=0.1)


@pytest.mark.parametrize(("offset", "load", "play"), [(1e-3, 0.1, 1.0), (1e-3, -0.1, 0.0), (4e-3, 0.1, 0.0)])
def test_a_surface_that_gives_way_to_its_load_may_be_loose(offset, load, play):
    """A load that extends the rod drives the surface ahead of it; against the load, or further, only a sensor goes."""
    rng, n = np.random.default_rng(4), 2000
    y = 1e-4 * rng.standard_normal((2, n))
    y[1, 1200:] += offset
    out = pair(*y, np.zeros(n), load)
    assert (out["blame"][1300:] == 2.0).all()
    assert (out["backlash_suspected"][1300:] == play).all()


def test_an_oscillating_sensor_is_wrong_until_it_rests():
    """At 5 Hz, 1.4 times the threshold: beyond it for about half of its period."""
    rng, n = np.random.default_rng(4), 4000
    t = np.arange(n) * DT
    y = 1e-4 * rng.standard_normal((2, n))
    threshold = tuning.thresholds("rtsekf_flight")["pair_threshold"]
    sine = 1.4 * threshold * np.sin(2 * np.pi * 5.0 * t)
    y[0, 1200:3200] += sine[1200:3200]
    out = pair(*y, np.zeros(n))
    beyond = np.abs(out["pair_d"][1300:3200]) > threshold
    assert 0.1 < beyond.mean() < 0.55
    assert (out["sensor"][1260:3200] == 1.0).all()
    assert not out["sensor"][3420:].any()


def test_an_unknown_threshold_set_is_refused():
    with pytest.raises(ValueError, match="nowhere"):
        tuning.thresholds("iotsekf", "nowhere")


N, RING, FIRST, ANGLE = 17, 24, 15, 0.7  # the samples run over the end of the ring


def test_what_is_beside_a_sine_is_the_rest_of_least_squares():
    F, D = np.random.default_rng(5).standard_normal((2, RING)) + np.array([[3.0], [-1.0]])
    at, turn = (FIRST + np.arange(N)) % RING, ANGLE * np.arange(N)  # the samples that count, oldest first
    X = np.stack([np.cos(turn), np.sin(turn)], 1)
    f, d = (y[at] - X @ np.linalg.lstsq(X, y[at])[0] for y in (F, D))
    assert sinusoid.beside(F, D, FIRST, N, ANGLE, 0.0) == pytest.approx((f @ f, f @ d, d @ d), abs=1e-9)


NAMES = ("theta", "phi", "q", "r")
INPUTS = dtype([(n + tail, "f8", "-") for n in NAMES for tail in ("", "_valid")])
STATE = dtype([*gyro.STATE])


def test_an_error_of_the_pitch_rate_shows_in_its_size_within_a_third_of_a_second_and_nothing_without_one():
    t = np.arange(0.0, 10.0, DT)
    phi, theta, r = 0.5 * np.sin(0.4 * t), 0.1 * np.sin(2.0 * t), 0.05 * np.sin(t)
    q = (0.2 * np.cos(2.0 * t) + r * np.sin(phi)) / np.cos(phi) + RAD_PER_DEG * (t >= 5.0)
    x, u, out = np.zeros(1, STATE)[0], np.zeros(1, INPUTS)[0], []
    for k in range(len(t)):
        for name, values in zip(NAMES, (theta, phi, q, r)):
            u[name], u[name + "_valid"] = values[k], float(name != "phi" or not 2.0 <= t[k] < 3.0)
        gyro.compare(x.view(np.recarray), u.view(np.recarray), DT)
        out.append((x["gyro_error"], x["gyro_off"]))
    error, off = np.array(out).T
    assert np.abs(error[t < 5.0]).max() < 0.3 * gyro.OFF and not off[t < 5.0].any()
    assert off[(t > 5.3) & (t < 5.35)].all() and error[-1] == pytest.approx(RAD_PER_DEG, rel=0.1)  # times cos phi
