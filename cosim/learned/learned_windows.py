"""What the learned detectors are asked about a window of signals: numbers that training and flight compute alike."""

import functools

import numpy as np

DT = 0.01  # between samples of a local window [s]
LOCAL = ("rod", "surface", "pressure", "valve_command", "hm0", "hmd")  # of one hydraulic actuator
SLOW = 0.04  # between samples of an aircraft's window [s]
AIRCRAFT = (
    *("alpha", "alpha_ground", "cas", "tas", "v_ground", "mach", "h_inertial", "hdot", "q", "qdot", "theta", "phi"),
    *("n_x", "n_z", "de_cmd", "stab_cmd", "throttle_cmd", "n1_1", "n1_2", "n1_3", "n1_4", "r", "beta", "h_baro"),
)
ARM, STALL_NM, G = 0.30, 10_500.0, 9.81  # of the rod [m], stall moment [N m]
HZ = (0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)


def channels(window: np.ndarray) -> np.ndarray:
    """Return (5, samples) of a local window: rod against surface, rod against what the valve let through [mm], load
    against pressure, valve command, rod about its mean; each of the order of one when something is wrong."""
    rod, surface, pressure, valve, hm0, hmd = window
    flow = valve * np.sqrt(np.clip(1.0 - np.sign(valve) * pressure, 0.05, 2.0))  # 1 of the valve is 1 m/s without load
    moved = rod - rod[:1] - np.concatenate([[0.0], np.cumsum(0.5 * (flow[1:] + flow[:-1]))]) * DT
    return np.stack([
        1e3 * (rod - ARM * surface), 1e3 * _detrended(moved), 10.0 * (pressure - (hm0 + hmd * surface) / STALL_NM),
        10.0 * valve, 200.0 * (rod - rod.mean()),
    ])  # fmt: skip


def local(window: np.ndarray) -> np.ndarray:
    """Return the features of a local window: level, swing and roughness of each channel, early and late, and swings at
    frequencies."""
    c = channels(window)
    late = c[:, -30:]
    parts = [c.mean(axis=1), c.std(axis=1), np.ptp(c, axis=1), np.abs(np.diff(c, axis=1)).mean(axis=1),
             late.mean(axis=1) - c[:, :100].mean(axis=1), late.std(axis=1)]  # fmt: skip
    return np.concatenate([*parts, *(_swings(c[i], DT) for i in (0, 1, 2, 3, 4)), _slope(c[1], c[3])])


def raw(window: np.ndarray) -> np.ndarray:
    """Return the channels of a local window in a row, within +-20."""
    return np.clip(channels(window), -20.0, 20.0).ravel()


def aircraft(window: np.ndarray) -> np.ndarray:
    """Return the features of an aircraft's window: what sensors of the same say of one another, motion, thrust."""
    y = dict(zip(AIRCRAFT, window))
    pairs = [
        y["alpha"] - y["alpha_ground"], 0.01 * (y["tas"] - y["v_ground"]),
        0.01 * (y["cas"] - 0.5 * y["tas"]), 100.0 * (y["tas"] / y["mach"] - 310.0) / 310.0,
        y["theta"] - y["alpha_ground"] - np.arcsin(np.clip(y["hdot"] / y["v_ground"], -0.5, 0.5)),
        0.01 * (y["h_baro"] - y["h_inertial"]), 0.1 * (y["n1_1"] - y["n1_4"]), 0.1 * (y["n1_2"] - y["n1_3"]),
        0.1 * y["n1_1"] - 10.0 * y["throttle_cmd"], 0.1 * y["n1_2"] - 10.0 * y["throttle_cmd"],
    ]  # fmt: skip
    t = SLOW * np.arange(window.shape[1])
    out = [f(x) for x in pairs for f in (np.mean, np.std)]
    out += [_rate(t, y["theta"]) - y["q"].mean() * np.cos(y["phi"].mean()), _rate(t, y["q"]) - y["qdot"].mean(),
            1.0 + _rate(t, y["hdot"]) / G - y["n_z"].mean(), _rate(t, y["v_ground"]) / G - y["n_x"].mean()]  # fmt: skip
    for name in ("alpha", "n_z", "n_x", "q", "theta", "phi", "r", "beta", "de_cmd", "stab_cmd", "throttle_cmd", "cas"):
        out += [y[name].mean(), y[name].std()]
    for name in ("q", "n_z", "de_cmd", "alpha"):
        out += list(_swings(y[name], SLOW))
    return np.array(out)


@functools.cache
def _line(n):
    t = np.linspace(-1.0, 1.0, n)
    return t, t / (t @ t)


def _detrended(x):
    t, per = _line(len(x))
    return x - x.mean() - t * (x @ per)


@functools.cache
def _waves(n, dt):
    """Return (2, frequencies, n): cosine and sine of HZ under a taper."""
    taper = np.hanning(n)
    waves = np.exp(-2j * np.pi * np.outer(HZ, dt * np.arange(n))) * (taper / taper.sum())
    return np.stack([waves.real, waves.imag])


def _swings(x, dt):
    """Return the amplitudes at HZ of a window that tapers."""
    real, imaginary = _waves(len(x), dt) @ _detrended(x)
    return np.hypot(real, imaginary)


def _slope(x, y):
    x, y = x - x.mean(), y - y.mean()
    return np.array([(x @ y) / (y @ y + 1e-3)])


def _rate(t, x):
    t = t - t.mean()
    return float(x @ t / (t @ t))
