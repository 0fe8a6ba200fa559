"""[Jay] as it is printed against the filters: Phi, G, H, P_0, R, (1), (5) to (9) and the hierarchy of section 3.3.

The printed matrices are for 5 ms and rounded; the plant behind them is that of the bench.
"""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import cont2discrete

from actuators.ema import jay
from cosim.papers.jay.bench import DT, FIGURES, LEAD, bench, plant
from cosim.papers.measured import all_valid, apart
from fdi.ema import ema_kalman
from fdi.ema import model as flight_design

PHI = """
    0.8789   0.00474   0.0009691  1.621E-6   1.109E-7    -0.001675
    -46.97   0.857     0.3759     0.000957   6.709E-5    -1.285
    4.078    0.006852  0.9674     0.004851   0.0003481   -9.098
    1577     4.046     -12.62     0.9295     0.06848     -3043
    -17.9    -0.04479  0.1433     -0.01081   -0.0007965  -501.1
    0        0         0          0          0           0.2753
"""
G = "8.223E-6  0.006389  0.04617  16.21  3.437  0.002809"
H = "0  0  0  0.05  0  0"
P_0 = (0.0003, 0.0003, 0.0003, 0.0003, 0.01, 0.01)
R = 0.0025


def test_phi_g_and_h_of_the_filter_are_as_printed():
    """Within half of the last digit of each entry, and zero where print is."""
    p, words = ema_kalman.params("nozzle")[0], f"{PHI} {G} {H}".split()
    held = np.concatenate([p["Phi"].ravel(), p["G"], [0.0, 0.0, 0.0, p["K_v"], 0.0, 0.0]])
    for ours, word in zip(held, words, strict=True):
        digits, _, power = word.lstrip("-").upper().partition("E")
        half = 0.5 * 10.0 ** (int(power or 0) - len(digits.partition(".")[2])) if float(word) else 1e-9
        assert abs(ours - float(word)) <= half, word


def test_p_0_and_r_are_as_printed():
    p = ema_kalman.params("nozzle")[0]
    assert tuple(p["P0"]) == P_0 and p["R"] == R


@pytest.mark.parametrize("figure", FIGURES)
def test_means_residuals_and_blame_of_figures_6_to_11_are_those_of_5_to_9_and_of_section_3_3(figure):
    out = bench(figure=figure)
    _same(
        (out["eta_bar"], out["R1"], out["R2"]),
        kalman(*(out[n] for n in ("u", "y_velocity", "y_position", "y_current"))),
    )
    velocity, position, current = (np.abs(out[n]) >= x for n, x in zip(("eta_bar", "R1", "R2"), (3.0, 5e-4, 0.5)))
    blamed = np.where(velocity, 1, np.where(position, 2, np.where(current, 3, 0)))
    assert blamed.any() and np.array_equal(blamed, out["isolated_part"])


def _same(ours, theirs):
    for a, b, scale in zip(ours, theirs, (1.0, 1e3, 1.0)):  # eta_bar, R1 [mm], R2 [A]
        assert np.abs(a - b).max() * scale <= 1e-6


def test_the_published_filter_of_an_elevator_is_1_and_5_to_9():
    """Sensors a tick late, begun at the measured position."""
    ticks, rng = 120, np.random.default_rng(3)
    t = np.arange(ticks) * DT
    u, velocity = 8.0 * np.sin(9.0 * t) + rng.normal(size=ticks), 40.0 * np.sin(5.0 * t) + rng.normal(size=ticks)
    position, current = 0.02 + 1e-3 * np.sin(5.0 * t), u + 0.1 * rng.normal(size=ticks)
    p, inputs = ema_kalman.params("elevator"), all_valid(ema_kalman)
    x, found = ema_kalman.init(p), []
    for k in range(ticks):
        inputs["u"], inputs["y_velocity"] = u[k], velocity[k]
        inputs["y_position"], inputs["y_current"] = position[k], current[k]
        ema_kalman.step(x[0], inputs[0], p[0], DT)
        found.append([x[name][0] for name in ("eta_bar", "R1", "R2")])
    _same(np.array(found).T, kalman(u, velocity, position, current, jay.values("elevator")))


def test_blame_and_reconfiguration_follow_sections_3_3_and_4_5_about_the_thresholds():
    """The velocity sensor first, then R1, then R2; a position fault reconfigures."""
    rng, p = np.random.default_rng(12), ema_kalman.params("nozzle")[0]
    for _ in range(500):
        x = np.zeros(1, ema_kalman.STATE)
        over = rng.uniform(-2.0, 2.0, 3)
        x["eta_bar"], x["R1"], x["R2"] = over * (3.0, 5e-4, 0.5)
        ema_kalman._decide(x[0], p)
        beyond = np.abs(over) >= 1.0
        part = 0 if not beyond.any() else 1 + int(np.argmax(beyond))
        assert (x["isolated_part"][0], x["alarm"][0], x["reconf"][0]) == (part, part > 0, part == 2)


def test_the_form_that_flies_is_1_and_5_with_a_load_and_noise_at_rest():
    """The load and its noise are ours."""
    v, sigma = jay.values("elevator"), 0.5
    d = flight_design.designed(v, DT, sigma)
    for name, theirs in zip(("Phi", "G", "K", "S_root"), steady(v, DT, 630.0, 20.0, 1.0, sigma)):
        assert apart(d[name], theirs) <= 1e-6, name


def motion(v: dict, hinge: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return (A, B) of (1) from its symbols, l where Phi has it; `hinge` [N m/rad] on the surface; B: u, moment."""
    l, N, K_s, gain = v["arm"], v["lead"], v["K_s"], v["K_gi"] / v["L"]
    J_N, J_M = v["J_N"], v["J_M"]
    A = np.array([
        [0, 1, 0, 0, 0, 0],
        [(hinge - l**2 * K_s) / J_N, -v["B_N"] / J_N, l * N * K_s / J_N, 0, 0, 0],
        [0, 0, 0, 1, 0, 0],
        [l * N * K_s / J_M, 0, -N**2 * K_s / J_M, -v["B_M"] / J_M, v["K_T"] / J_M, 0],
        [0, 0, 0, -v["K_B"] / v["L"], -(v["K_ic"] + v["R"]) / v["L"], -gain * (v["b"] - v["a"])],
        [0, 0, 0, 0, 0, -v["b"]],
    ])  # fmt: skip
    return A, np.array([[0, 0, 0, 0, gain, 1.0], [0, 1 / J_N, 0, 0, 0, 0]]).T


def kalman(
    u: np.ndarray, velocity: np.ndarray, position: np.ndarray, current: np.ndarray, elevator: dict | None = None
) -> tuple[np.ndarray, ...]:
    """Return (eta_bar, R1 [m], R2 [A]) of (5) to (9), each (ticks,), from the demand and the sensors.

    (5) is printed without Phi in the prediction of the state; it is Phi (x + K gamma) + G u. `u[k]` is the demand over
    the tick that ends at sample k. `elevator`: the symbols of another set, sensors a tick late, begun at its position.
    """
    late, lead = int(elevator is not None), elevator["lead"] if elevator else LEAD
    x, P, H = np.zeros(6), np.diag(P_0), np.array([0.0, 0.0, 0.0, 0.05, 0.0, 0.0])
    if elevator:
        Phi, G, *_ = cont2discrete((*motion(elevator), np.eye(6), np.zeros((6, 2))), DT)
        G = G[:, 0]
        x[:3] = position[0] / elevator["arm"], 0.0, position[0] / lead  # the spring is at rest
    else:
        Phi, G, _ = plant()
    eta, R1, R2 = np.zeros(len(u)), np.zeros(len(u)), np.zeros(len(u))
    for k in range(len(u)):
        if k:
            x, P = Phi @ x + G * u[k - late], Phi @ P @ Phi.T
        S = H @ P @ H + R
        gamma = 0.05 * velocity[k] - H @ x
        K = P @ H / S
        x, P = x + K * gamma, P - np.outer(K, H @ P)
        eta[k] = gamma / S**0.5  # (6)
        R1[k], R2[k] = position[k] - lead * x[2], current[k] - x[4]  # (9)
    mean = np.convolve(eta, np.full(10, 0.1))[: len(eta)]  # (7); what is not there yet counts as zero
    return mean, R1, R2


def steady(v: dict, dt: float, sigma_load: float, tau: float, q: float, sigma: float) -> tuple[np.ndarray, ...]:
    """Return (Phi, G, K, S^1/2) of (5) with process noise, iterated until it rests: five states of (1) and a load.

    The load [N m] decays with `tau` and has the deviation `sigma_load`; `q` [rad/s] a tick on the motor's rate, `sigma`
    [rad/s] of its sensor. K is for a surface that its hinge holds back by 20 kN m/rad, Phi to first order in that.
    """
    found = []
    for hinge in (0.0, 1e3, -1e3):
        A, B = motion(v, hinge)
        whole = np.zeros((7, 7))
        whole[:5, :5], whole[:5, 5], whole[:5, 6], whole[5, 5] = A[:5, :5], B[:5, 1], B[:5, 0], -1.0 / tau
        found.append(expm(whole * dt))
    Phi, H = (found[0] - 20.0 * (found[1] - found[2]) / 2.0)[:6, :6], np.eye(6)[3]
    Q = np.diag([0, 0, 0, q**2, 0, sigma_load**2 * (1.0 - np.exp(-2.0 * dt / tau))])
    A, G, P = Phi.T, np.outer(H, H) / sigma**2, Q  # of one step of (5), then of 2, 4, 8 ... of them
    for _ in range(32):
        W = np.linalg.inv(np.eye(6) + G @ P)
        A, G, P = A @ W @ A, G + A @ W @ G @ A.T, P + A.T @ P @ W @ A
    S = H @ P @ H + sigma**2
    return found[0][:6, :6], found[0][:6, 6], P @ H / S, S**0.5
