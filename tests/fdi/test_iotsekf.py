"""The two-stage filter against an augmented-state filter written here in NumPy, its statistics, and its verdicts."""

import numpy as np
import pytest
from lu17_bench import DT, doublets, fly, roll, run
from scipy.linalg import expm
from scipy.stats import chi2

from actuators.hydraulic import lu17
from fdi.common import verdict
from fdi.hydraulic import iotsekf
from fdi.hydraulic import two_stage_ekf as two_stage

WIDE = {"gate_rod": 1e9, "delay_s": 0.0}


def continuous(z, u, f, p):
    """Return the Jacobian of (q, q', x3, F, f) by the kernel of (4), shape (5, 5)."""
    a22, a23, a31, a32, a33, b3, e2 = lu17.jacobian(z[0], z[1], z[2], u, u, f, p)
    A = np.zeros((5, 5))
    A[0, 1] = 1.0
    A[1] = [0.0, a22, a23, e2 * p.A_p * p.P_s, 0.0]
    A[2] = [a31, a32, a33, 0.0, b3]
    return A


def augmented(p, u, y, dt, *, linear=False, q_xf=None):
    """Return (z, P, gamma, S), all ticks, of the textbook filter of the augmented state; `linear`: exact at u = 0."""
    z = np.array([y[0, 0], 0.0, y[0, 1], -y[0, 1], 0.0])
    P, Q, R = np.diag([*p.P0, p.P0_f]), np.diag([*p.q, p.q_f]) * dt, np.diag([p.r_rod, p.r_dp])
    if q_xf is not None:
        Q[:4, 4] = Q[4, :4] = np.array(q_xf) * dt
    H = np.zeros((2, 5))
    H[0, 0] = H[1, 2] = 1.0
    fixed = expm(continuous(np.zeros(5), 0.0, 0.0, p) * dt)
    out = []
    for k in range(len(u)):
        Phi = fixed if linear else expm(continuous(z, u[k], z[4], p) * dt)
        if linear:
            z = Phi @ z
        else:
            z[:3] = lu17.rk4(z[0], z[1], z[2], u[k], u[k], z[4], p.A_p * p.P_s * z[3], p, dt)
        P = Phi @ P @ Phi.T + Q
        S = H @ P @ H.T + R
        K = np.linalg.solve(S, H @ P).T
        gamma = y[k] - H @ z
        z = z + K @ gamma
        I_KH = np.eye(5) - K @ H
        P = I_KH @ P @ I_KH.T + K @ R @ K.T
        out.append((z.copy(), P, gamma, S))
    return [np.array(v) for v in zip(*out)]


def two_stage_log(p, u, y, dt):
    w = np.zeros((1, len(u)), iotsekf.INPUTS)
    w["u"], w["y_rod"], w["y_dp"] = u, y[:, 0], y[:, 1]
    w["y_rod_valid"] = w["y_dp_valid"] = 1.0
    return roll(iotsekf, p, w, dt)[0]


def blend(log):
    """Return (z, P) of the augmented state from the two stages. [Lu17] (15)-(16)"""
    V, P_f = log["V"], log["P_f"]
    z = np.concatenate([log["x_hat"], log["f_hat"][:, None]], axis=1)
    P = np.zeros((len(log), 5, 5))
    P[:, :4, :4] = log["P_bar"] + V[:, :, None] * P_f[:, None, None] * V[:, None, :]
    P[:, :4, 4] = P[:, 4, :4] = V * P_f[:, None]
    P[:, 4, 4] = P_f
    return z, P


def signal(seed, ticks, dt):
    rng = np.random.default_rng(seed)
    t = np.arange(ticks) * dt
    y = np.stack([0.01 * np.sin(3 * t), 0.2 * np.cos(2 * t)], axis=1)
    return 0.05 * np.sin(4 * t), y + [1e-4, 5e-3] * rng.standard_normal((ticks, 2))


# (4) is linear at u = 0 where the volume does not depend on q: V_m and E a thousand times larger leave the stiffness
LINEAR = {"V_m": 1.973, "E": 1e12}


@pytest.mark.parametrize("centre", [0.0, 1.0], ids=["as-published", "centred"])
@pytest.mark.parametrize("q_xf", [(0.0, 0.0, 0.0, 0.0), (0.0, 1e-6, 2e-5, 0.0)], ids=["uncorrelated", "correlated"])
def test_on_a_linear_model_it_is_the_augmented_kalman_filter(centre, q_xf):
    dt = 2e-4  # the filter's Runge-Kutta step is then exact to 1e-12
    p = iotsekf.params(dt=dt, centre=centre, total_sign=0.0, **WIDE, **LINEAR)
    p["q_xf"] = q_xf
    _, y = signal(1, 3000, dt)
    u = np.zeros(3000)
    z, P, _, _ = augmented(p[0], u, y, dt, linear=True, q_xf=q_xf)
    got, cov = blend(two_stage_log(p, u, y, dt))
    size = np.abs(z).max(axis=0)
    assert np.abs((got - z) / size).max() < 1e-9
    spread = np.sqrt(np.einsum("kii->ki", P))
    assert np.abs((cov - P) / (spread[:, :, None] * spread[:, None, :])).max() < 1e-9


def test_on_the_nonlinear_model_it_is_the_augmented_ekf_to_rounding():
    p = iotsekf.params(total_sign=0.0, **WIDE)
    u, y = signal(2, 2000, DT)
    z, _, _, _ = augmented(p[0], u, y, DT)
    got, _ = blend(two_stage_log(p, u, y, DT))
    assert np.abs(got - z).max() < 1e-11
    published = two_stage_log(iotsekf.params(total_sign=0.0, centre=0.0, **WIDE), u, y, DT)
    off = np.abs(published["f_hat"] - z[:, 4]).max()
    assert 1e-7 < off < 1e-3  # (17) integrates (4) at x_bar, not at x_hat: 4e-5 of u here


def test_the_published_iteration_changes_nothing_as_h_is_linear():
    u, y = signal(3, 500, DT)
    once = two_stage_log(iotsekf.params(epsilon=1e9, **WIDE), u, y, DT)
    often = two_stage_log(iotsekf.params(epsilon=0.0, **WIDE), u, y, DT)
    assert np.abs(once["f_hat"] - often["f_hat"]).max() < 1e-12


def test_phi_and_gamma_come_from_one_exponential():
    p = iotsekf.params()[0]
    z, u = np.array([0.02, 0.05, 0.3, -0.2, 0.01]), 0.06
    Phi, G = np.zeros((4, 4)), np.zeros(4)
    two_stage.transition(Phi, G, z[:4], u, u, z[4], 0.0, True, p, DT)
    exact = expm(continuous(z, u, z[4], p) * DT)
    assert np.abs(Phi - exact[:4, :4]).max() < 1e-9
    assert np.abs(G - exact[:4, 4]).max() < 1e-9
    # (20) read literally takes Phi for the whole tick out of the integral
    literal = (Phi @ np.array([0, 0, continuous(z, u, z[4], p)[2, 4], 0]) * DT)[:3] / G[:3]
    assert literal[0] == pytest.approx(3.0, abs=0.1) and literal[2] == pytest.approx(0.95, abs=0.03)


@pytest.fixture(scope="module")
def matched():
    """Return (log, truth) of 50 seeds of the filter's own model with its own noise, 4 s each, u = 0.03 sin.

    The load walks away from every hinge-moment model: the pressure is not to be judged by it.
    """
    seeds, ticks = 50, 800
    p = iotsekf.params(total_sign=0.0, centre=1.0, jam_threshold=1e9, **WIDE)
    r, rng = p[0], np.random.default_rng(7)
    w = np.zeros((seeds, ticks), iotsekf.INPUTS)
    truth = np.zeros((seeds, ticks, 5))
    w["u"] = 0.03 * np.sin(3 * DT * np.arange(ticks))
    w["y_rod_valid"] = w["y_dp_valid"] = 1.0
    area, sigma = r.A_p * r.P_s, np.sqrt(np.array([*r.q, r.q_f]) * DT)
    for i in range(seeds):
        z = np.sqrt([*r.P0, r.P0_f]) * rng.standard_normal(5)
        first = z.copy()
        for k, u in enumerate(w["u"][i].tolist()):
            z[:3] = lu17.rk4(z[0], z[1], z[2], u, u, z[4], area * z[3], r, DT)
            z += sigma * rng.standard_normal(5)
            truth[i, k] = z
        w["y_rod"][i] = truth[i, :, 0] + np.sqrt(r.r_rod) * rng.standard_normal(ticks)
        w["y_dp"][i] = truth[i, :, 2] + np.sqrt(r.r_dp) * rng.standard_normal(ticks)
        assert np.isfinite(first).all()
    return roll(iotsekf, np.repeat(p, seeds), w), truth


def test_normalised_errors_and_innovations_are_within_their_chi_square_bounds(matched):
    log, truth = matched
    late = slice(200, 800, 40)  # after the start; 0.2 s apart
    z, P = zip(*(blend(row) for row in log))
    e = (np.array(z) - truth)[:, late]
    nees = np.einsum("ski,skij,skj->sk", e, np.linalg.inv(np.array(P)[:, late]), e)
    low, high = chi2.ppf([0.025, 0.975], 50 * 5) / 50
    inside = (nees.mean(axis=0) > low) & (nees.mean(axis=0) < high)
    assert inside.mean() >= 0.8  # 15 instants at 95 %: fewer than 13 inside has a chance of 0.5 %
    n = 50 * 600
    for name in ("nis_rod", "nis_dp"):
        low, high = chi2.ppf([0.025, 0.975], n) / n
        assert low < log[name][:, 200:].mean() < high, name


T_FAULT = 12.0


def after(log, name="alarm"):
    """Return the delay of the first alarm of each lane [s], inf where there is none, and that no lane was early."""
    k = round(T_FAULT / DT)
    assert not log[name][:, :k].any()
    hit = log[name][:, k:] > 0.5
    return np.where(hit.any(axis=1), hit.argmax(axis=1) * DT, np.inf)


def oscillate(hz, u, solid):
    def write(k, x, w):
        if k * DT >= T_FAULT:
            x["f_u"], x["s_u"] = u * np.sin(2 * np.pi * hz * (k * DT - T_FAULT)), solid

    return write


VALVE = (verdict.OFC_LIQUID, verdict.OFC_SOLID)


# u of 0.6 mm of rod, measured on the nominal loop with the shipped servo: test_hydraulic says how the loop resists
@pytest.mark.parametrize(("hz", "u", "at_rest"), [(7.0, 0.0121, False), (0.5, 0.0019, True)])
def test_an_oscillation_in_place_of_the_command_is_found_and_named(hz, u, at_rest):
    """Where nothing moves the command the servo's missing drive grows, and hides it in the residual alone."""
    command = doublets(13 + 4.5 / hz) * (0.0 if at_rest else 1.0)
    log = run(iotsekf, [fly(command, seed=s, faults=oscillate(hz, u, 1.0)) for s in range(4)])
    assert (after(log) <= 3.0 / hz).all()
    end = log[:, -1]
    assert (end["verdict"] == verdict.OFC_SOLID).all()
    assert (np.abs(end["likely_hz"] / hz - 1) <= 0.25).all()


def test_a_large_oscillation_added_to_the_command_is_found_and_never_another_fault():
    """The servo answers it beyond the linear response: it stays ambiguous."""
    hz = 7.0
    log = run(iotsekf, [fly(doublets(12 + 4.5 / hz), seed=s, faults=oscillate(hz, 0.0291, 0.0)) for s in range(4)])
    assert (after(log) <= 3.0 / hz).all()
    said = log["verdict"][log["alarm"] > 0.5]
    assert np.isin(said, (*VALVE, verdict.AMBIGUOUS)).all()


def test_the_alarm_of_a_slow_oscillation_stands_through_its_half_periods():
    """With a command at rest it is not known whether it adds to it."""
    hz = 0.13
    flights = [fly(np.zeros(round((12 + 3.2 / hz) / DT)), seed=s, faults=oscillate(hz, 0.012, 0.0)) for s in range(3)]
    log = run(iotsekf, flights)
    assert (after(log) < 0.5 / hz).all()
    late = log[:, round((T_FAULT + 0.75 / hz) / DT) :]
    assert (late["alarm"] > 0.5).all() and np.isin(late["verdict"], (*VALVE, verdict.AMBIGUOUS)).all()
    assert np.isin(log["verdict"][:, round((T_FAULT + 3.0 / hz) / DT)], VALVE).all()


def test_a_jam_shows_when_the_command_moves():
    def write(k, x, w):
        x["jam"] = 1.0 if k * DT >= T_FAULT - 1 else 0.0

    command = np.where(np.arange(2700) * DT >= T_FAULT, np.radians(1.0), 0.0)
    log = run(iotsekf, [fly(command, seed=s, faults=write) for s in range(4)])
    assert (after(log) <= 0.5).all()
    assert (log["verdict"][:, -1] == verdict.JAM_SOLID).all()
