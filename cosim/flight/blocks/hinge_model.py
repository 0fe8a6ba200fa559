"""What the actuator-local detectors know of the hinge load: a model of the moment on measured air data, wrong by a
factor.

    hm0 = k (V/V_0)^2 (m_0 + m_alpha (alpha - alpha_0) + m_q q),    hmd = k (V/V_0)^2 m_d

about the trim point, with measured angle of attack, pitch rate and airspeed; `k` is the model's error. The truth is
JSBSim's.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel

PARAMS = dtype([
    ("k", "f8", "-"),  # model over truth
    ("m_0", "f8", "N m"),  # hinge moment at zero angle, at trim
    ("m_alpha", "f8", "N m/rad"),  # its slope over angle of attack
    ("m_q", "f8", "N m s/rad"),  # over pitch rate
    ("m_d", "f8", "N m/rad"),  # over the segment's own angle
    ("alpha_0", "f8", "rad"),
    ("cas_0", "f8", "m/s"),
])
INPUTS = dtype([
    ("alpha", "f8", "rad"), ("alpha_valid", "f8", "-"), ("q", "f8", "rad/s"), ("q_valid", "f8", "-"),
    ("cas", "f8", "m/s"), ("cas_valid", "f8", "-"),
])  # fmt: skip
STATE = dtype([
    ("hm0", "f8", "N m"),
    ("hmd", "f8", "N m/rad"),
    ("alpha", "f8", "rad"),
    ("q", "f8", "rad/s"),
    ("cas", "f8", "m/s"),  # last valid measurements
])
OUTPUTS = ("hm0", "hmd")


def init(p: np.ndarray) -> np.ndarray:
    """Return the model at trim."""
    x = np.zeros(p.shape, STATE)
    x["alpha"], x["cas"] = p["alpha_0"], p["cas_0"]
    x["hm0"], x["hmd"] = p["k"] * p["m_0"], p["k"] * p["m_d"]
    return x


@kernel
def step(x, u, p, dt):
    """Evaluate the model at this tick's measurements; an invalid one keeps its last value."""
    if u.alpha_valid > 0.0 and math.isfinite(u.alpha):
        x.alpha = u.alpha
    if u.q_valid > 0.0 and math.isfinite(u.q):
        x.q = u.q
    if u.cas_valid > 0.0 and math.isfinite(u.cas):
        x.cas = u.cas
    s = p.k * (x.cas / p.cas_0) * (x.cas / p.cas_0)
    x.hm0 = s * (p.m_0 + p.m_alpha * (x.alpha - p.alpha_0) + p.m_q * x.q)
    x.hmd = s * p.m_d


rollout = entry(step, STATE, INPUTS, PARAMS)


def slopes(plant: Any, trim: Any, names: Any) -> np.ndarray:
    """Return (m_alpha, m_q) of the lanes `names` (suffixes of TRUTH's hinge fields), shape (lanes, 2), by central
    differences about `trim`; `plant` is moved about."""
    h = 1e-3

    def at(d_alpha=0.0, d_q=0.0):
        plant.place(
            tas=trim.tas, alpha=trim.alpha + d_alpha, theta=trim.theta, altitude=trim.altitude, q=trim.q + d_q,
            surfaces=trim.surfaces,
        )  # fmt: skip
        return plant.truth()[0]

    up, down, fast, slow = at(h), at(-h), at(0.0, h), at(0.0, -h)
    fields = [f"hm0_{name}" for name in names]
    return np.array([((up[f] - down[f]) / (2 * h), (fast[f] - slow[f]) / (2 * h)) for f in fields])


def design(slopes: np.ndarray, trim: Any, truth: Any, names: Any, factors: Any) -> np.ndarray:
    """Return PARAMS of the lanes `names` from their `slopes` and the truth at `trim`, wrong by `factors`."""
    q_0 = 0.0 if trim.level else trim.q  # of a turn, which is not in the moment at rest
    p = np.zeros(len(names), PARAMS)
    for i, (name, k, (m_alpha, m_q)) in enumerate(zip(names, factors, slopes)):
        m_0 = truth[f"hm0_{name}"] - m_q * q_0
        p[i] = (k, m_0, m_alpha, m_q, truth[f"hmd_{name}"], truth.alpha, truth.cas)
    return p
