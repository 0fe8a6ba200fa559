"""What the filters of [Lu17] cost, beside an augmented EKF of the same states, and the gain (48)."""

import time
from typing import Any

import numpy as np

from actuators.block import dtype, kernel
from actuators.hydraulic.lu17 import rk4
from cosim.papers.lu17 import bench
from fdi.common.linalg import congruence, joseph
from fdi.hydraulic import iotsekf, rtsekf
from fdi.hydraulic import separate_bias as two_stage
from fdi.hydraulic.separate_bias import transition

STATE = dtype(
    [
        ("x", "f8", (4,)),
        ("P", "f8", (4, 4)),
        ("Phi", "f8", (4, 4)),
        ("W", "f8", (4, 4)),
        ("G", "f8", (4,)),
        ("K", "f8", (4,)),
    ]
)
TICKS, REPEATS = 2000, 15


@kernel
def _augmented(x, u, y, p, dt):
    """Advance an EKF whose state is (q, q', x3, f), f a random walk, by one tick."""
    transition(x.Phi, x.G, x.x, u, u, x.x[3], 0.0, False, p, dt)
    x.x[0], x.x[1], x.x[2] = rk4(x.x[0], x.x[1], x.x[2], u, u, x.x[3], 0.0, p, dt)
    for i in range(3):
        x.Phi[i, 3] = x.G[i]
        x.Phi[3, i] = 0.0
    x.Phi[3, 3] = 1.0
    congruence(x.P, x.Phi, x.W)
    for i in range(3):
        x.P[i, i] += p.q[i] * dt
    x.P[3, 3] += p.q_f * dt
    s = x.P[0, 0] + p.r_rod
    e = y - x.x[0]
    for i in range(4):
        x.K[i] = x.P[i, 0] / s
        x.x[i] += x.K[i] * e
    joseph(x.P, x.K, 0, p.r_rod)


@kernel
def _run_augmented(x, u, y, p, dt):
    for k in range(u.size):
        _augmented(x, u[k], y[k], p, dt)


@kernel
def _run_two_stage(x, inputs, u, y, p, dt):
    for k in range(u.size):
        inputs.u, inputs.y_rod = u[k], y[k]
        two_stage.estimate(x, inputs, p, dt)


@kernel
def _follow_augmented(x, u, y, p, dt, f):
    for k in range(u.size):
        _augmented(x, u[k], y[k], p, dt)
        f[k] = x.x[3]


def optimal() -> tuple[float, str]:
    """Return (rms error of f_hat over that of an augmented EKF with the same noises on figure 3's runs, both)."""
    out = bench.fly("liquid OFC", seeds=20)
    p = iotsekf.params(load=0, dt=bench.DT, delay_s=0.0, centre=0.0, total_sign=0.0, gate_rod=two_stage.GATE_NONE)
    u = np.concatenate([np.zeros((len(out), 1)), out["u"][:, :-1]], 1)  # a filter reads the command of the last tick
    f, late = np.zeros(u.shape), slice(round(bench.AFTER[0] / bench.DT), None)
    for k in range(len(out)):
        a = np.zeros(1, STATE)
        a["P"][0] = np.diag([*p["P0"][0, :3], p["P0_f"][0]])
        _follow_augmented(a[0], u[k], np.ascontiguousarray(out["y"][k]), p[0], bench.DT, f[k])
    own, other = (float(np.sqrt(np.mean((e - out["f"])[:, late] ** 2))) for e in (out["f_hat"], f))
    return own / other, f"{own:.2g} and {other:.2g} of u"


def cost() -> tuple[float, str]:
    """Return (time of a step of the two-stage filter over that of the augmented one, both in microseconds)."""
    out = bench.fly("liquid OFC", seeds=1)[0][:TICKS]
    u, y = np.ascontiguousarray(out["u"]), np.ascontiguousarray(out["y"])
    p = iotsekf.params(load=0, dt=bench.DT, delay_s=0.0, centre=0.0, total_sign=0.0, gate_rod=two_stage.GATE_NONE)
    inputs = np.zeros(1, iotsekf.INPUTS)
    inputs["y_rod_valid"] = 1.0
    took: list[list[float]] = [[], []]
    for _ in range(REPEATS):
        x, a = iotsekf.init(p), np.zeros(1, STATE)
        a["P"][0] = np.diag([*p["P0"][0, :3], p["P0_f"][0]])
        for i, run in enumerate(
            (
                lambda x=x: _run_two_stage(x[0], inputs[0], u, y, p[0], bench.DT),
                lambda a=a: _run_augmented(a[0], u, y, p[0], bench.DT),
            )
        ):
            begin = time.perf_counter()
            run()
            took[i].append(1e6 * (time.perf_counter() - begin) / TICKS)
    two, one = min(took[0]), min(took[1])
    return two / one, f"{two:.2f} and {one:.2f} microseconds"


def gain() -> Any:
    """Return N of (48) after 100 ticks."""
    p = rtsekf.params("published", load=0, delay_s=0.0)
    u = np.zeros((1, 100), rtsekf.INPUTS)
    u["y_rod_valid"] = 1.0
    log = np.zeros(u.shape, rtsekf.STATE)
    rtsekf.rollout(rtsekf.init(p), u, p, bench.DT, log)
    return log["N"][0, -1]
