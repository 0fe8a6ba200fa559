"""The bench of [Jay] section 4: nozzle actuator without load, published filter, position loop; and an elevator's load.

The nozzle is the plant behind the paper's Phi and G, exactly advanced: continuous numbers of the printed structure that
give back all 37 entries. a21 a43 = a23 a41 holds by the one ratio N / l: the motor turns free of the spring. The filter
holds its own.

What the paper leaves open, and what stands here:

- The position loop. Figure 1 is not in the text; B carries K_g K_i / L and the compensator (s + a) / (s + b), so that
  only the error in volts is missing: u = K_p (command - position sensor) with the LVDT's 400 V/m, command in metres.
  Without any further gain its slow poles are -6.4 +- 16.1i (17 rad/s, damping 0.37): 34 % of overshoot, settled within
  the 1 s of a pulse, as the 2.0 and 2.5 mm of section 4.5 need; these two numbers do not depend on the gain.
- Noise: "0.1 mm, 1 rad/s and 0.1 A" is read as the peak of what figure 5 shows, three standard deviations, cut there.
  The reading as one standard deviation has a row of its own.
- Lever arm and R's share of the current loop are not printed; 0.125 m and 0.9 were chosen (actuators/ema/jay.py) so
  that the three numbers of section 4.4 come out: the rows of figure 12 check that one choice gives all three, no more.
- The fault-free part of a run (0 to 2 s) belongs to the fault-free rows; faults are judged from 2 s to the end at 8 s.
- The current faults are on the copy that the monitor reads. What they do inside the current loop has a row.
"""

from typing import Any

import numpy as np
from scipy.signal import cont2discrete

from actuators.block import dtype, kernel
from actuators.ema import jay
from cosim.papers.measured import all_valid
from fdi.ema import ema_kalman

DT = 0.005  # [s]; section 4
PLANT = {  # [1/s2], [1/s], ...: a_ij of the printed A, the loop's rate, its drive, pole and zero of the compensator
    "a21": 10025.9, "a22": 4.61611, "a23": 80.2301, "a41": 339214.0, "a43": 2714.47, "a44": 0.967879, "a45": 603.297,
    "a54": 95.2571, "loop": 8210.38, "drive": 72699.4, "a": 45.0, "b": 257.987,
}  # fmt: skip
ARM, SHARE = 0.125, 0.9  # lever arm [m] and R's share of the loop: chosen
RATIO = ((PLANT["a23"] / PLANT["a21"]) * (PLANT["a43"] / PLANT["a41"])) ** 0.5  # N / l
LEAD = ARM * RATIO  # N [m/rad]
SECONDS, FAULT = 8.0, 2.0  # length of a run and start of every fault [s]; the latter: [Jay] section 4
COMMAND = 2.5e-3  # [m]; pulse train, 2 s period, 50 % duty: [Jay] section 4
NOISE = np.array([1e-4, 1.0, 0.1])  # position [m], velocity [rad/s], current [A]; [Jay] section 4
SEEDS = range(10)

TICK = dtype(
    [
        ("noise", "f8", (3,)),  # position [m], velocity [rad/s], current [A]
        ("bias", "f8", (3,)),  # sensor faults: added
        ("scale", "f8", (3,)),  # and factor on the signal, zero for healthy
        ("command", "f8"),  # [m]
        ("f_i", "f8"),  # bias of the sensor inside the current loop [A]
    ]
)
OUT = dtype(
    [
        ("position", "f8"),  # true, [m]
        ("current", "f8"),  # true, [A]
        ("position_hat", "f8"),  # [m]
        ("current_hat", "f8"),  # [A]
        ("eta_bar", "f8"),
        ("R1", "f8"),  # [m]
        ("R2", "f8"),  # [A]
        ("isolated_part", "f8"),
        ("u", "f8"),  # demand over the tick that ends here
        ("y_position", "f8"),  # read by the filter, [m], [rad/s], [A]
        ("y_velocity", "f8"),
        ("y_current", "f8"),
    ]
)

FIGURES = {  # figure -> (sensor, scale, bias): section 4.1 to 4.3
    6: ("velocity", 0.25, 0.0),
    7: ("velocity", 0.0, 5.0),
    8: ("position", 0.25, 0.0),
    9: ("position", 0.0, 1e-3),
    10: ("current", 0.25, 0.0),
    11: ("current", 0.0, 1.0),
}
_SENSOR = {"position": 0, "velocity": 1, "current": 2}


def plant(resistance: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (Phi, G, Gamma) of the truth over a tick: state (6), demand, bias of the loop's current sensor [A].

    `resistance`: rise of R as a fraction.
    """
    p, A, B = PLANT, np.zeros((6, 6)), np.zeros((6, 2))
    A[0, 1] = A[2, 3] = 1.0
    A[1, :3] = -p["a21"], -p["a22"], p["a21"] * RATIO
    A[3, [0, 2, 3, 4]] = p["a43"] / RATIO, -p["a43"], -p["a44"], p["a45"]
    A[4, 3:] = -p["a54"], -p["loop"] * (1.0 + SHARE * resistance), -p["drive"] * (p["b"] - p["a"])
    A[5, 5] = -p["b"]
    B[4, 0], B[5, 0], B[4, 1] = p["drive"], 1.0, -(1.0 - SHARE) * p["loop"]
    Phi, G, *_ = cont2discrete((A, B, np.eye(6), np.zeros((6, 2))), DT)
    return Phi, G[:, 0], G[:, 1]


@kernel
def _fly(tick, Phi, G, Gamma, lead, pf, x, f, uf, reconfigure, out):
    """Close the loop u = K_p (command - position) over every tick."""
    u, ahead = 0.0, np.zeros(6)
    for k in range(tick.shape[0]):
        t = tick[k]
        position = (1.0 + t.scale[0]) * lead * x[2] + t.bias[0] + t.noise[0]
        uf.u = u
        uf.y_position = position
        uf.y_velocity = (1.0 + t.scale[1]) * x[3] + t.bias[1] + t.noise[1]
        uf.y_current = (1.0 + t.scale[2]) * x[4] + t.bias[2] + t.noise[2]
        ema_kalman.step(f, uf, pf, DT)
        out[k].position, out[k].current = lead * x[2], x[4]
        out[k].u, out[k].y_position = u, position
        out[k].y_velocity, out[k].y_current = uf.y_velocity, uf.y_current
        out[k].position_hat, out[k].current_hat = f.pos_hat, f.x_hat[4]
        out[k].eta_bar, out[k].R1, out[k].R2, out[k].isolated_part = f.eta_bar, f.R1, f.R2, f.isolated_part
        u = jay.K_P * (t.command - (f.pos_hat if reconfigure and f.reconf > 0.5 else position))
        for i in range(6):
            ahead[i] = G[i] * u + Gamma[i] * t.f_i
            for j in range(6):
                ahead[i] += Phi[i, j] * x[j]
        for i in range(6):
            x[i] = ahead[i]


def bench(
    *,
    seed: int = 0,
    noise: Any = 1 / 3,
    figure: Any = None,
    loop_bias: float = 0.0,
    resistance: float = 0.0,
    reconfigure: bool = False,
    matrices: Any = None,
    seconds: float = SECONDS,
) -> Any:
    """Return OUT records of one run.

    `noise`: standard deviation over the quoted figure (cut at the figure when below one); `figure`: the fault of that
    figure from 2 s; `loop_bias`: of the sensor inside the current loop [A]; `resistance`: rise as a fraction, from the
    start; `matrices`: (Phi, G) for the filter instead of the exact ones.
    """
    n = round(seconds / DT)
    t = np.arange(n) * DT
    tick = np.zeros(n, TICK)
    draw = noise * np.random.default_rng(seed).standard_normal((n, 3))
    tick["noise"] = NOISE * (np.clip(draw, -1.0, 1.0) if noise < 1.0 else draw)
    tick["command"] = np.where(np.arange(n) % round(2.0 / DT) < round(1.0 / DT), COMMAND, 0.0)
    late = t > FAULT - 0.5 * DT
    if figure is not None:
        sensor, scale, bias = FIGURES[figure]
        tick["scale"][late, _SENSOR[sensor]], tick["bias"][late, _SENSOR[sensor]] = scale, bias
    tick["f_i"][late] = loop_bias
    pf = ema_kalman.params("nozzle")
    if matrices is not None:
        pf["Phi"], pf["G"] = matrices
    f, uf = ema_kalman.init(pf), all_valid(ema_kalman)
    out = np.zeros(n, OUT)
    _fly.compiled(tick, *plant(resistance), LEAD, pf[0], np.zeros(6), f[0], uf[0], reconfigure, out)
    return out
