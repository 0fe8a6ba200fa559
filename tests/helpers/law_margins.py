"""Stability margins of the pitch loop, sampled as it flies: the law broken at the elevator command.

The return ratio is L = -(law) x (sensors: delay) x (aircraft, held surfaces, exact discretisation) x (mean of the four
actuators' sampled loops). Every part is the one that flies, linearised; the law's share is its normal mode with the
stick free, or its angle-of-attack protection, at the speed of the model, which may be another than that of the gains.
"""

import math

import numpy as np
from scipy.linalg import expm
from servo_loops import ema_loop, hydraulic_loop, response

from actuators.constants import G0

STATES = ("tas", "alpha", "q", "theta", "h")
LOOPS = {"hydraulic": hydraulic_loop, "ema": ema_loop}
DELAY_S, DELAY_AIR_S = 0.005, 0.010  # of inertial and of air data in sensor set `transport`


def return_ratio(model, p, technologies, hinge, frequency, dt=0.005, protected=False):
    """Return L, complex, at `frequency` [rad/s] (n,).

    `model` is a LinearModel, `p` the law's PARAMS (1,), `technologies` one of "hydraulic", "ema" per segment, `hinge`
    (hm0 [N m], hmd [N m/rad]). `protected`: the angle-of-attack protection leads.
    """
    A, B, C, D = model.block(STATES, model.named("de_"), ("nz", "q", "hdot", "alpha"))
    n = len(A)
    E = expm(np.block([[A, B.sum(1, keepdims=True)], [np.zeros((1, n + 1))]]) * dt)
    Phi, Gamma = E[:n, :n], E[:n, n:]
    z = np.exp(1j * frequency * dt)
    one = {t: response(LOOPS[t](hm0=hinge[0], hmd=hinge[1], dt=dt), frequency) for t in set(technologies)}
    act = sum(one[t] for t in technologies) / len(technologies)
    y = np.array([(C @ np.linalg.solve(zi * np.eye(n) - Phi, Gamma) + D.sum(1, keepdims=True))[:, 0] for zi in z])
    n_z, q, hdot = (y[:, :3] * (z ** -round(DELAY_S / dt))[:, None]).T
    alpha = y[:, 3] * z ** -round(DELAY_AIR_S / dt)
    g, turn = p[0], G0 / model.trim.tas
    cas = model.y0[list(model.outputs).index("cas")]
    s = (g.cas_0 / cas) ** 2
    e = -g.k_path * hdot / G0 - n_z  # the flight-path hold asks for a load factor
    if protected:
        e = -(g.k_alpha * alpha + g.k_rate * (q - turn * n_z)) / math.sqrt(s)
    lead = n_z + e
    law = g.k_nz * (n_z - g.b_n * lead) + g.k_q * (q - turn * lead) - g.k_i * e * dt / (z - 1.0)
    return -s * law * act


def margins(L, frequency):
    """Return (gain margin [dB], phase margin [deg], crossover [rad/s]) of return ratio L at rising `frequency`.

    The gain margin is the smallest over both directions at every crossing of -180 deg, the phase margin at every
    crossing of 0 dB.
    """
    phase, size = np.unwrap(np.angle(L)), np.log(np.abs(L))
    gain, best_phase, crossover = math.inf, math.inf, math.nan
    for i in range(len(L) - 1):
        turns = math.floor((phase[i] + math.pi) / (2 * math.pi)) != math.floor((phase[i + 1] + math.pi) / (2 * math.pi))
        if turns:
            gain = min(gain, abs(20 / math.log(10) * 0.5 * (size[i] + size[i + 1])))
        if size[i] * size[i + 1] < 0:
            left = math.degrees(abs(math.remainder(0.5 * (phase[i] + phase[i + 1]) - math.pi, 2 * math.pi)))
            if left < best_phase:
                best_phase, crossover = left, frequency[i]
    return gain, best_phase, crossover
