"""What sensor noise makes of the fault estimates of `fdi.lpv_smo.lpv_smo`: elevator, load factor, angle of attack.

A sample of white noise is an impulse. Its response through the observer's linear part, both lags of the estimate and
the correction for gusts is summed in squares, for each of the four readings whose noise matters (SIGMA). The injection
is taken as ideal sliding motion: e_y = 0, so that nu = s' - phi; the loop's slope of 1.5e4 1/s is off that by 1 %.
"""

import functools

import numpy as np

from actuators.constants import RAD_PER_DEG
from fdi.lpv_smo.core import P
from fdi.lpv_smo.fields import PARAMS

# sensor set `transport`, per sample of DT: theta [deg], V [m/s], q [deg/s], alpha over the ground [deg]
SIGMA = {"theta": 0.02, "V": 0.05, "q": 0.02, "alpha_ground": 0.025}
DT = 0.005  # [s]
LASTS = 8.0  # the response is summed for so many of both lags


@functools.cache
def deviations(given: bytes, dt: float) -> np.ndarray:
    """Return (boxes, 4): standard deviation of f_hat_elevator times |E| [rad], of f_hat_n_z times |A_11 / k| [g], k the
    load factor per angle of a gust, of f_hat_alpha times |A_11| [rad], and of f_hat_elevator times |E A_11 / A_55|
    [rad], what the angle over the ground gives it; the first is of the other readings. They are those of the middle
    of every box: with E, k, A_11 and A_55 of where it flies they hold over a box.

    `given` is one record of PARAMS as bytes, with `gust`. Noise of another rate has the same power per time as at DT.
    """
    p = np.frombuffer(given, PARAMS)
    n = int(p["n_box"][0])
    one = {name: p[name][0] for name in p.dtype.names}
    middle = np.hstack([np.ones((n, 1)), 0.5 * (one["low"] + one["high"])[:n]])
    A, B = (np.einsum("br,br...->b...", middle, one[name][:n]) for name in "AB")
    E = np.einsum("br,br->b", middle, one["E"][:n])[:, None]
    L, W, mix = (one[name][:n] for name in ("L", "W", "mix"))
    A00, A10, A01, A11 = A[:, :1, 0], A[:, 1:, 0], A[:, 0, 1:], A[:, 1:, 1:]
    pole = A00 + (L * A10).sum(1, keepdims=True)
    row = A01 - pole * L + np.einsum("bj,bji->bi", L, A11)
    keep = np.exp(pole * dt)
    held = (keep - 1.0) / pole  # of a forcing that stands for a tick
    lag = {name: 1.0 - np.exp(-dt / one[name]) if one[name] > 0.0 else 1.0 for name in ("tau_f", "tau_g", "tau_v")}
    c, d, tau = lag["tau_f"], lag["tau_g"], one["tau_f"]
    k_e, turn = A[:, 4, :1] / E, B[:, :1, 0] / A00
    k, k_v = A[:, 5, :1] / one["a_f"][:n, :1], A[:, 5, 3:4] / one["a_f"][:n, :1]
    D51 = np.einsum("br,br->b", middle, one["D51"][:n])[:, None]
    along = one["gradient"] * A[:, 4, 4:5] / E / one["tau_g"]
    size = np.diag(list(SIGMA.values()))  # (source, reading)
    s = phi = np.zeros((n, len(SIGMA), P))
    f = free = np.zeros((n, len(SIGMA), 3))
    v = w = ground = rate = slip = wind = push = gust = np.zeros((n, len(SIGMA)))
    square = np.zeros((n, 4))
    for tick in range(round(LASTS * (tau + one["tau_g"]) / dt)):  # as `core` does, all boxes and sources at once
        theta, speed, q, measured = size.T if tick == 0 else 0.0 * size
        v = v + lag["tau_v"] * (speed - v)
        readings = ((1, np.broadcast_to(theta, v.shape)), (2, v), (3, np.broadcast_to(q, v.shape)))
        now = sum(mix[:, None, :, i] * y[..., None] for i, y in readings)
        w = keep * w + 0.5 * held * ((s + now) @ row[..., None])[..., 0]
        x_1 = w - (now @ L[..., None])[..., 0]
        turned = x_1[..., None] * A10[:, None] + now @ A11.transpose(0, 2, 1)
        nu = (now - s) / dt - 0.5 * (turned + phi)
        s, phi = now, turned
        raw = nu @ W.transpose(0, 2, 1)
        raw[..., 0] /= E
        f = f + c * (raw - f)
        rising = A00 * measured + (now @ A01[..., None])[..., 0]
        ground = (ground + 0.5 * dt * (rate + rising) + dt / tau * measured) / (1.0 + dt / tau)
        rate = rising
        wind = wind - c * (v + wind)
        slip = slip + c * (x_1 - measured - slip)
        push = push + c * (nu[..., 2] - push)
        blown = ((measured - ground) / tau - A[:, 0, 3:4] * wind) / A00
        thrust = push - A[:, 3, :1] * (blown - slip) - A[:, 3, 3:4] * wind
        f_e = f[..., 0] - (A[:, 4, 3:4] * wind + one["thrust"] * thrust) / E - k_e * (blown - slip)
        f_e = f_e / (1.0 - k_e * turn)
        a = blown - turn * f_e
        f_e = f_e + along * (a - gust)
        f_n = f[..., 1] - D51 * f_e - k * (a - slip) - k_v * wind
        free = free + d * (np.stack([f_e, f_n, f[..., 2] - (a - slip)], -1) - free)
        gust = gust + d * (a - gust)
        power = free**2
        others = [power[:, :-1, 0].sum(1), power[..., 1].sum(1), power[..., 2].sum(1)]
        square = square + np.stack([*others, power[:, -1, 0]], axis=1)
    scale = np.abs(np.hstack([E * RAD_PER_DEG, A00 / k, A00 * RAD_PER_DEG, E * A00 / A[:, 4, 4:5] * RAD_PER_DEG]))
    return np.sqrt(square * (DT / dt)) * scale
