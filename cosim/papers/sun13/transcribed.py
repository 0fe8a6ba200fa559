"""[Sun13] transcribed: theorems 1 and 2, (28) in the block that flies, (32), (37), (39), each against the code's own.

Nothing here is the code's but what is asked: the equations stand as printed, on NumPy and SciPy.
"""

import dataclasses
import math
from typing import Any

import numpy as np
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


def theorems(form: str) -> tuple[float, str]:
    """Return the largest violation of (4) to (8), (12), (15), (16), (30), (31) by a design that is made anew.

    Of the stored model of a form; equations by their difference over their size, inequalities by the largest
    eigenvalue; Gamma is the one whose loop has BANDWIDTH. Where every state is measured no mode is fixed, and a second
    design has (31) left of the disk's centre, where it binds.
    """
    held = choose(form, "hydraulic", DT)[0]
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
    worst = max(off, key=off.__getitem__)
    return off[worst], f"{worst}; inequalities " + ", ".join(f"{k} {v:.1g}" for k, v in left_sides(d).items())


def gains(form: str) -> tuple[float, str]:
    """Return how far f_hat / f at 0.5, 1, 2 Hz and its noise, as the design reports them, are from (9), (28).

    The ratio solves (9) and (28) at s; the noise is the root of the summed squares of what unit samples do.
    """
    d = choose(form, "hydraulic", DT)[0]
    TF, n, l = d.T @ d.F, len(d.A), d.F.shape[1]
    worst, sigma = 0.0, np.arange(1.0, len(d.C) + 1.0)
    made = design(d.A, d.B, d.C, None, d.E, d.F, dt=DT, bandwidth=BANDWIDTH, min_ratio=0.0)
    for hz, told in made.report.tracking:
        s, g = 2j * math.pi * hz, made.Gamma @ made.M @ made.C
        whole = np.block([[s * np.eye(n) - made.N, TF], [-g * (1.0 + made.alpha / s), np.eye(l)]])
        f_hat = np.linalg.solve(whole, np.concatenate([TF[:, 0], np.zeros(l)]))[n]
        worst = max(worst, abs(f_hat - told))
    squares, ticks = np.zeros(l), 600
    for j in range(len(d.C)):
        y = np.zeros((ticks, len(d.C)))
        y[1, j] = sigma[j]
        squares += (d.estimate(y) ** 2).sum(0)
    noise = _size(discrete.noise(d.discrete, sigma) / np.sqrt(squares) - 1.0)
    return max(worst, noise), f"f_hat/f {worst:.1g}, noise {noise:.1g}"


def flown_block(form: str, known: bool = False, ticks: int = 260) -> tuple[float, str]:
    """Return how far f_hat of the block that flies is from (2), (28) on its samples, over its range.

    The trim is given (`known`) or the mean of the first 40 samples; commands late by actuator and sensors, and no
    faster than the actuator; three samples are lost, after which the estimator begins anew with the f_hat it had.
    """
    module = FORMS[form]
    d, chosen = choose(form, "hydraulic", DT)
    trim = {"tas": 200.0, "alpha": 0.05, "theta": 0.06, "elevator": 0.01}
    stored = {key: held for key, held in read(form).items() if key != "servos"}  # the paper knows no servo beside (37)
    p = module.params("design_point", stored=stored, trim=trim if known else None)
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
    told = np.array([200.0, 0.05, 0.0, 0.06, 0.01, 0.01])[: y.shape[1]] / ((1.0,) + (RAD_PER_DEG,) * (y.shape[1] - 1))
    c, first = command / RAD_PER_DEG, 0 if known else 40
    y_0 = told if known else y[:40].mean(0) * (np.arange(y.shape[1]) != 2)
    u_0 = np.full(c.shape[1], 0.01 / RAD_PER_DEG) if known else c[:40].mean(0)
    theirs = _estimate(d, chosen, y - y_0, c - u_0, lost, first)
    ours = np.array(found) / RAD_PER_DEG
    return _size(ours[first + 1 :] - theirs[first + 1 :]) / _size(theirs), f"largest f_hat {_size(theirs):.2g} deg"


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


def joined(draws: int = 20) -> float:
    """Return how far (39) of an aircraft and its actuators, joined by the code, is from (37) and (38) at random states.

    The actuators are first-order lags (37) of `first_order`: their rate is a (gain u - x).
    """
    rng, worst = np.random.default_rng(2), 0.0
    for _ in range(draws):
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
        worst = max(worst, _size(A @ x + B @ u - slope), _size(C @ x + D @ u - out))
    return worst


def lag() -> tuple[float, str]:
    """Return how far a, gain and delay of a lag (37), fitted to its own response, are from those it has, relative."""
    true, hz = np.array([13.7, 0.94, 0.021]), np.linspace(0.02, 4.0, 81)
    s = 2j * math.pi * hz
    late = model.fit_first_order((hz, true[1] * true[0] / (s + true[0]) * np.exp(-s * true[2])))
    plain = model.fit_first_order(([[-true[0]]], [[true[0]]], [[true[1]]], [[0.0]]), delay=False)
    w, hz = 15.0, np.linspace(0.05, 2.0, 60)
    s = 2j * math.pi * hz
    G = w**2 / (s**2 + 2.0 * w * s + w**2)  # of second order: no step from the fit has a smaller sum of squares
    cost = lambda z: np.sum(np.abs(z[1] * z[0] / (s + z[0]) * np.exp(-s * z[2]) - G) ** 2)  # noqa: E731
    best = model.fit_first_order((hz, G))
    down = max(0.0, cost(best) / min(cost(np.array(best) * (1.0 + 1e-3 * d)) for d in _steps()) - 1.0)
    return max(_size(np.array(late) / true - 1.0), _size(np.array(plain[:2]) / true[:2] - 1.0), down), (
        f"of two lags of 15 rad/s: {best[0]:.1f} rad/s, gain {best[1]:.2f}, {1e3 * best[2]:.1f} ms"
    )


def _steps():
    return [s * e for e in np.eye(3) for s in (-1.0, 1.0)]


def unknown(omega: float = 5.0) -> tuple[float, str]:
    """Return how far E of (32), (33) to (36) of flights under known d is from those, over its size.

    A step of d shows in the estimate as 1 - (1 + omega t) exp(-omega t): the observer's poles are all at -omega. The
    outputs are states that C mixes; what the rank leaves is compared with the singular vectors of E itself.
    """
    rng, n, ticks, settle = np.random.default_rng(8), 4, 1200, 2.0
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
    kept, top = model.reduce_E(E_, 2, keep=(0, 1, 3)), np.linalg.svd(E_ * [[1], [1], [0], [1]])[0][:, :2]
    turned = _size(kept @ kept.T - top @ top.T)
    off = _size(signed - E_) / _size(E_)
    return max(off, turned), f"(32) {off:.1g}, (36) {turned:.1g}"
