"""The LPV plant of [Alwi14] section 6 flown by itself: the model that the observer knows, with faults of known size."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.linalg import expm

from actuators.constants import M_S_PER_KT, RAD_PER_DEG
from cosim.flight.blocks import law
from cosim.flight.plant.operating_point import designed
from cosim.flight.plant.plant import Plant
from cosim.flight.plant.point import SIX, FlightPoint
from cosim.papers.measured import all_valid
from fdi.lpv_smo import model as lpv_model

DOUBLET = ((2, 4, -1.0), (4, 6, 1.0), (14, 16, -1.0), (16, 18, 1.0))  # (from s, to s, deg of elevator)
DEMAND = ((12.0, 15.0, 0.15), (15.0, 18.0, -0.15))  # (from s, to s, g), as in the scenario of section 6
SERVO = 0.07  # actuator and its delay as one lag, what the law is designed for [s]


def trim_at(model: lpv_model.LpvModel, rho: np.ndarray) -> list[np.ndarray]:
    """Return x_eq (n,), u_eq (m,), y_eq (p,) of the trim maps at `rho` (nr,)."""
    z = lpv_model.normalise(rho, model.box)
    values = model.trim @ np.prod(z ** lpv_model.powers(len(z)), axis=1)
    return np.split(values, np.cumsum(model.B.shape[1:]))


class StandIn:
    """What flies an LPV plant that has no law: a doublet of the elevator, and damping in pitch."""

    def command(self, t: float, y: Any) -> tuple[float, float]:
        """Return (elevator, stabiliser) beyond their trim [deg] for y, the deviations of h, theta, V, q, n_z, alpha."""
        return sum(v for a, b, v in DOUBLET if a <= t + 1e-9 < b) + 0.8 * y[3] + 0.3 * y[1], 0.0


class Law:
    """The control law of a point of table 4 on the LPV plant there: load-factor demand, path hold, automatic trim."""

    def __init__(self, point: str, h: float = 0.005):
        where = FlightPoint.at(**SIX[point])
        self.p, _ = designed(where, Plant(where, dt=h).trim(), h)
        self.x, self.u, self.h = law.init(self.p), np.zeros(1, law.INPUTS), h
        self.u["valid"] = 1.0
        self.tick = law.rollout.bound(self.x, self.u.reshape(1, 1), self.p, h)
        self.moved = 0.0

    def command(self, t: float, y: Any) -> tuple[float, float]:
        """Return (elevator behind its actuator, stabiliser) beyond their trim [deg] for y as of `StandIn`."""
        own, r = self.p[0], RAD_PER_DEG
        theta, alpha, speed = own.theta_0 + r * y[1], own.alpha_0 + r * y[5], own.tas_0 + y[2]
        seen = {
            "alpha": alpha,
            "q": r * y[3],
            "theta": theta,
            "n_z": own.nz_0 + y[4],
            "cas": own.cas_0 * speed / own.tas_0,
            "tas": speed,
            "h_inertial": own.h_0 + y[0],
            "hdot": speed * np.sin(theta - alpha),
        }
        self.u["y"][0] = [seen.get(name, 0.0) for name in law.SENSORS]
        self.u["nz_dem"] = sum(g for a, b, g in DEMAND if a <= t + 1e-9 < b)
        self.tick()
        self.moved += (1.0 - np.exp(-self.h / SERVO)) * ((self.x["de_cmd"][0] - own.de_0) / r - self.moved)
        return self.moved, (self.x["stab_cmd"][0] - own.stab_0) / r


def fly(
    made: Any,
    rho: Any,
    block: Any,
    *,
    h: float = 0.005,
    seconds: float = 25.0,
    faults: Sequence[Any] = (3.0, 0.5, 5.0),
    at: float = 10.0,
    noise: float = 0.0,
    seed: int = 1,
    pilot: Any = None,
) -> Any:
    """Fly the LPV plant of `made` (an LpvModel) at constant `rho` and return the block's INPUTS, (1, ticks).

    A `StandIn` flies it, or `pilot`, on what is not corrupted; from `at` on the elevator is off by faults[0] deg, and
    the observer reads n_z off by faults[1] g, alpha by faults[2] deg. The plant is advanced exactly, its input held
    over each tick. `noise` scales sensor set transport.
    """
    _, u_eq, y_eq = trim_at(made, rho)
    A, B, C, D = (lpv_model.at(S, rho) for S in (made.A, made.B, made.C, made.D))
    n = round(seconds / h)
    step = expm(np.block([[A, B], [np.zeros((2, 7))]]) * h)[:5]
    pilot, x, y, moved, seen = pilot or StandIn(), np.zeros(5), np.zeros((n, 6)), np.zeros((n, 2)), np.zeros(6)
    for k in range(n):
        broken = k * h >= at - 1e-9
        moved[k] = pilot.command(k * h, seen)
        surface = moved[k] + (faults[0] * broken, 0.0)
        seen = C @ x + D @ surface
        y[k] = seen + y_eq
        y[k, 4:] += np.array(faults[1:]) * broken
        x = step @ np.r_[x, surface]
    y += noise * np.array([0.02, 0.02, 0.05, 0.02, 0.007, 0.03]) * np.random.default_rng(seed).standard_normal(y.shape)
    u = all_valid(block, 1, n)
    si = np.array([1, RAD_PER_DEG, 1, RAD_PER_DEG, 1, RAD_PER_DEG])
    for name, column in zip(("h", "theta", "V", "q", "n_z", "alpha"), (y * si).T, strict=True):
        u[name][0] = column
    for name in ("de_lo", "de_li", "de_ri", "de_ro"):
        u[name][0] = (moved[:, 0] + u_eq[0]) * RAD_PER_DEG
    u["stab"][0] = (moved[:, 1] + u_eq[1]) * RAD_PER_DEG
    u["mass"], u["cg"], u["cas"], u["mach"] = rho[0] * 1e3, rho[1] / 100, rho[2] * M_S_PER_KT, rho[3]
    return u
