"""[Sun13] as it is printed against the code: theorems 1 and 2, (28) and the block that flies, (32) to (39).

The equations stand as printed, on NumPy and SciPy; nothing here is the code's but what is tested.
"""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from actuators.constants import RAD_PER_DEG
from cosim.papers.measured import all_valid
from cosim.papers.sun13.designs import left_sides
from cosim.training.flights import DT
from fdi.rfafe import discrete, model, rfafe, rfafe_airframe
from fdi.rfafe.store import choose, read
from fdi.rfafe.synthesis import Design, design

FORMS: dict[str, Any] = {"rfafe": rfafe, "rfafe_airframe": rfafe_airframe}
BANDWIDTH = 40.0  # of the loop [rad/s]


def _size(X: Any) -> float:
    return float(np.abs(X).max())


@pytest.mark.parametrize("form", FORMS)
def test_a_design_of_the_stored_model_meets_theorems_1_and_2(form):
    """(4) to (8), (12), (16) to rounding, the inequalities (15), (30), (31) by their largest eigenvalue.

    Gamma is the one whose loop has BANDWIDTH. Where every state is measured no mode is fixed, and a second design has
    (31) left of the disk's centre, where it binds.
    """
    held = choose(read(form), "hydraulic", DT)[0]
    given: Any = {"dt": DT, "bandwidth": BANDWIDTH, "min_ratio": 0.0}
    d = design(held.A, held.B, held.C, None, held.E, held.F, **given)
    one, TF = np.eye(len(d.A)), d.T @ d.F
    off = {
        "(4)": _size(d.K - d.K1 - d.K2) / _size(d.K),
        "(5)": _size((d.H @ d.C - one) @ d.E) / _size(d.E),
        "(6)": _size(d.T - (one - d.H @ d.C)),
        "(7)": _size(d.N - (d.A - d.H @ d.C @ d.A - d.K1 @ d.C)) / _size(d.N),
        "(8)": _size(d.K2 - d.N @ d.H) / _size(d.N),
        "(12)": _size(d.H - d.E @ np.linalg.pinv(d.C @ d.E)),
        "(16)": _size(TF.T @ d.P - d.M @ d.C) / _size(d.M),
        "Y": _size(d.P @ d.K1 - d.Y) / _size(d.Y),
        "Gamma": _size(d.Gamma @ TF.T @ d.P @ TF / BANDWIDTH - np.eye(d.F.shape[1])),
        "P": max(0.0, 1.0 - float(np.linalg.eigvalsh(d.P)[0])),
        **left_sides(d),
    }
    if len(d.C) == len(d.A):
        left = dataclasses.replace(d.region, decay=1.1 * d.region.centre)
        bound = design(held.A, held.B, held.C, None, held.E, held.F, region=left, **given)
        off["(31) left of the centre"] = left_sides(bound)["(31)"]
    assert {equation: violation for equation, violation in off.items() if not violation <= 1e-9} == {}


@pytest.mark.parametrize("form", FORMS)
def test_tracking_and_noise_that_a_design_reports_are_those_of_9_and_28(form):
    """f_hat / f at 0.5, 1, 2 Hz solves (9) and (28) at s; the noise is the root of the summed squares of what unit
    samples do."""
    d = choose(read(form), "hydraulic", DT)[0]
    TF, n, l = d.T @ d.F, len(d.A), d.F.shape[1]
    sigma = np.arange(1.0, len(d.C) + 1.0)
    made = design(d.A, d.B, d.C, None, d.E, d.F, dt=DT, bandwidth=BANDWIDTH, min_ratio=0.0)
    for hz in (0.5, 1.0, 2.0):
        s, g = 2j * math.pi * hz, made.Gamma @ made.M @ made.C
        whole = np.block([[s * np.eye(n) - made.N, TF], [-g * (1.0 + made.alpha / s), np.eye(l)]])
        f_hat = np.linalg.solve(whole, np.concatenate([TF[:, 0], np.zeros(l)]))[n]
        assert abs(f_hat - made.tracking(hz)) <= 1e-8
    squares, ticks = np.zeros(l), 600
    for j in range(len(d.C)):
        y = np.zeros((ticks, len(d.C)))
        y[1, j] = sigma[j]
        squares += (d.estimate(y) ** 2).sum(0)
    assert discrete.noise(d.discrete, sigma) == pytest.approx(np.sqrt(squares), rel=1e-8)


def test_the_discrete_estimator_is_2_and_28_integrated():
    """A second of outputs that are linear and inputs that are held between samples; it flies without D of (40)."""
    d = choose(read("rfafe"), "hydraulic", DT)[0]
    TF, gain, ticks = d.T @ d.F, d.Gamma @ d.M, 200
    D = 0.1 * np.cos(np.arange(d.D.size)).reshape(d.D.shape)
    d = dataclasses.replace(d, D=D)
    t = np.arange(ticks) * DT
    y, u = (np.sin(2 * np.pi * t[:, None] * np.arange(1, n + 1) / 3.0) for n in D.shape)
    ours = dataclasses.replace(d, discrete=discrete.discretise(d, DT)).estimate(y, u)
    n, I = len(d.A), np.eye(len(d.C))
    free = y[0] - D @ u[0]
    x, theirs = np.concatenate([(np.linalg.pinv(d.C) - d.H) @ free, np.zeros(d.F.shape[1])]), np.zeros_like(ours)
    r = (I - d.C @ d.H) @ free - d.C @ x[:n]
    x[n:] = theirs[0] = gain @ r  # what the law's proportional part makes of the first sample
    for k in range(1, ticks):
        rate = (y[k] - y[k - 1]) / DT

        def slope(s, x, rate=rate, k=k):
            now, z, f = y[k - 1] + rate * s - D @ u[k - 1], x[:n], x[n:]
            dz = d.N @ z + d.T @ d.B @ u[k - 1] + d.K @ now + TF @ f  # (2)
            r, dr = (I - d.C @ d.H) @ now - d.C @ z, (I - d.C @ d.H) @ rate - d.C @ dz  # (11)
            return np.concatenate([dz, gain @ (dr + d.alpha * r)])  # (28)

        if k > 1:  # what a step of the input does to r = y - D u - C x_hat at once
            x[n:] -= gain @ (I - d.C @ d.H) @ D @ (u[k - 1] - u[k - 2])
        x = solve_ivp(slope, (0.0, DT), x, method="DOP853", rtol=1e-9, atol=1e-12).y[:, -1]
        theirs[k] = x[n:]
    assert _size(ours[1:] - theirs[1:]) <= 1e-6 * _size(theirs)


@pytest.mark.parametrize("form", FORMS)
def test_the_block_that_flies_is_2_and_28_on_its_samples(form):
    """The trim is the mean of the first 40 samples; commands late by actuator and sensors, and no faster than the
    actuator; three samples are lost, after which the estimator begins anew with the f_hat it had.
    """
    module, ticks = FORMS[form], 260
    d, chosen = choose(read(form), "hydraulic", DT)
    stored = {key: held for key, held in read(form).items() if key != "servos"}  # the paper knows no servo beside (37)
    p = module.params(stored=stored)
    x, u = module.init(p), all_valid(module)
    t = np.arange(ticks) * DT
    lost = np.zeros(ticks, bool)
    lost[180:183] = True
    swing = np.sin(5.0 * t) * (t > 0.3)
    tas, alpha, q, theta = 200.0 + 2.0 * swing, 0.05 + 0.01 * np.sin(4.0 * t), 0.02 * swing, 0.06 + 0.02 * swing
    sides = 0.01 + 0.03 * np.stack([np.sin(6.0 * t), np.sin(9.0 * t)], 1) * (t > 0.25)[:, None]
    command = 0.01 + np.stack([0.03 * np.sin(6.0 * t + 0.3), 0.12 * np.sign(np.sin(8.0 * t))], 1) * (t > 0.3)[:, None]
    if form == "rfafe_airframe":
        command = command[:, 1:]
    found = []
    for k in range(ticks):
        u["tas"], u["alpha"], u["q"], u["theta"] = tas[k], alpha[k], q[k], theta[k]
        if form == "rfafe":
            u["surface"][0], u["command"][0] = sides[k, [0, 0, 1, 1]], command[k]
            u["surface_valid"] = 0.0 if lost[k] else 1.0
        else:
            u["command"], u["q_valid"] = command[k, 0], 0.0 if lost[k] else 1.0
        module.step(x[0], u[0], p[0], DT)
        found.append(x["f"][0, : d.F.shape[1]].copy())
    y = np.stack([tas, alpha / RAD_PER_DEG, q / RAD_PER_DEG, theta / RAD_PER_DEG], 1)
    if form == "rfafe":
        y = np.hstack([y, sides / RAD_PER_DEG])
    c, first = command / RAD_PER_DEG, 40
    y_0 = y[:40].mean(0) * (np.arange(y.shape[1]) != 2)
    u_0 = c[:40].mean(0)
    theirs = _estimate(d, chosen, y - y_0, c - u_0, lost, first)
    ours = np.array(found) / RAD_PER_DEG
    assert _size(ours[first + 1 :] - theirs[first + 1 :]) <= 1e-9 * _size(theirs)


def _estimate(d: Design, chosen: Any, y: Any, u: Any, lost: Any, first: int) -> np.ndarray:
    """Return f_hat (ticks, l) of (2), (28): one exponential per tick, u held and y linear from sample to sample."""
    TF, g, n, (m, l), r = d.T @ d.F, d.Gamma @ d.M, len(d.A), (len(d.C), d.F.shape[1]), u.shape[1]
    a, rate = chosen["actuator"]["a_rad_s"], chosen["actuator"]["rate_deg_s"]
    act, followed = np.zeros(r), np.zeros_like(u)
    for k in range(first, len(u)):  # what of the command a lag follows that is no faster than `rate`
        followed[k] = np.clip(u[k], act - rate / a, act + rate / a)
        act = act + (1.0 - math.exp(-a * DT)) * (followed[k] - act)
    late = 1 + round(chosen["u_delay_s"] / DT)
    held = np.array([followed[max(k - late, first)] for k in range(len(u))])
    # state [z, integral of r, y, y', u]: z' = N z + T B u + K y + TF f_hat, r = (I - C H) y - C z
    r_of = np.hstack([-d.C, np.zeros((m, m)), np.eye(m) - d.C @ d.H, np.zeros((m, m + r))])
    w_of = np.zeros((m, n + 3 * m + r))
    w_of[:, n : n + m] = np.eye(m)
    f_of = g @ (r_of + d.alpha * w_of)  # (28)
    A = np.zeros((n + 3 * m + r,) * 2)
    A[:n, :n], A[:n, n + m : n + 2 * m], A[:n, n + 3 * m :] = d.N, d.K, d.T @ d.B
    A[:n] += TF @ f_of  # (2)
    A[n : n + m], A[n + m : n + 2 * m, n + 2 * m : n + 3 * m] = r_of, np.eye(m)
    step, out = expm(A * DT), np.zeros((len(y), l))
    z, w, running, f = np.zeros(n), np.zeros(m), False, np.zeros(l)
    for k in range(first, len(y)):
        if lost[k]:
            running = False
        elif not running:
            z, running = (np.linalg.pinv(d.C) - d.H) @ y[k], True
            w = np.linalg.pinv(g) @ f / d.alpha
        else:
            x = step @ np.concatenate([z, w, y[k - 1], (y[k] - y[k - 1]) / DT, held[k]])
            z, w = x[:n], x[n : n + m]
        if not lost[k]:
            f = f_of @ np.concatenate([z, w, y[k], np.zeros(m), held[k]])
        out[k] = f
    return out


def test_aircraft_and_actuators_join_to_39_as_37_and_38_say():
    """At random states; the actuators are first-order lags (37): their rate is a (gain u - x)."""
    rng = np.random.default_rng(2)
    for _ in range(20):
        a, gain = rng.uniform(5.0, 30.0, 2), rng.uniform(0.5, 1.5, 2)
        Ab, Bu, Cb, Du = (rng.normal(size=s) for s in ((4, 4), (4, 2), (3, 4), (3, 2)))
        Aa, Ba, Ca, Da = model.first_order(a, gain, 2)
        Da = Da + rng.normal(size=(2, 2))
        A, B, C, D = model.global_model(Ab, Bu, Cb, Du, Aa, Ba, Ca, Da)
        xb, xa, u = rng.normal(size=4), rng.normal(size=2), rng.normal(size=2)
        ub = xa + Da @ u  # (37)
        slope = np.concatenate([Ab @ xb + Bu @ ub, a * (gain * u - xa)])
        out = np.concatenate([Cb @ xb + Du @ ub, ub])  # (38)
        x = np.concatenate([xb, xa])
        assert max(_size(A @ x + B @ u - slope), _size(C @ x + D @ u - out)) <= 1e-12


def test_a_fitted_lag_37_is_the_one_that_gave_the_response():
    """To a ten-thousandth; of an actuator of second order no step from the fit has a smaller sum of squares."""
    true, hz = (13.7, 0.94, 0.021), np.linspace(0.02, 4.0, 81)
    s = 2j * math.pi * hz
    late = model.fit_first_order(hz, true[1] * true[0] / (s + true[0]) * np.exp(-s * true[2]))
    assert late == pytest.approx(true, rel=1e-4)
    w, hz = 15.0, np.linspace(0.05, 2.0, 60)
    s = 2j * math.pi * hz
    G = w**2 / (s**2 + 2.0 * w * s + w**2)
    cost = lambda z: np.sum(np.abs(z[1] * z[0] / (s + z[0]) * np.exp(-s * z[2]) - G) ** 2)  # noqa: E731
    best = np.array(model.fit_first_order(hz, G))
    steps = 1e-3 * np.vstack([np.eye(3), -np.eye(3)])
    assert cost(best) <= (1.0 + 1e-4) * min(cost(best * (1.0 + step)) for step in steps)


def test_unknown_inputs_of_flights_under_known_d_are_those_of_32_to_36():
    """Over the size of E, to what samples of 5 ms give.

    A step of d shows in the estimate as 1 - (1 + omega t) exp(-omega t): the observer's poles are all at -omega. The
    outputs are states that C mixes; what the rank leaves is compared with the singular vectors of E itself.
    """
    rng, n, ticks, settle, omega = np.random.default_rng(8), 4, 1200, 2.0, 5.0
    A, B, C = rng.normal(size=(n, n)) - 2.0 * np.eye(n), rng.normal(size=(n, 2)), rng.normal(size=(n, n))
    t = np.arange(ticks) * DT
    E, flights, wanted = rng.normal(size=(n, 3)), [], []
    for e in E.T:
        u = rng.normal(size=(ticks, 2)) * (np.arange(ticks)[:, None] % 40 < 20)
        both = np.zeros((n + 3, n + 3))
        both[:n, :n], both[:n, n : n + 2], both[:n, -1] = A, B, e
        step, x, y = expm(both * DT), np.zeros(n), np.zeros((ticks, n))
        for k in range(1, ticks):
            x = (step @ np.concatenate([x, u[k - 1], [1.0]]))[:n]
            y[k] = C @ x
        flights.append((y, u))
        late = t >= settle
        wanted.append(e * np.sqrt(np.mean((1.0 - (1.0 + omega * t[late]) * np.exp(-omega * t[late])) ** 2)))
    found = model.estimate_E(A, B, C, flights, dt=DT, omega=omega, settle_s=settle)
    E_ = np.array(wanted).T
    signed = found * np.sign((found * E_).sum(0))
    kept, top = model.reduce_E(E_, 2), np.linalg.svd(E_)[0][:, :2]
    assert _size(kept @ kept.T - top @ top.T) <= 1e-5
    assert _size(signed - E_) <= 1e-5 * _size(E_)
