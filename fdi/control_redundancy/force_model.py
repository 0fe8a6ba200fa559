"""Forces on an airframe from coefficient arrays: aerodynamics, thrust over N1, input sensitivities.

    C_axis = sum over quantities (t_a(alpha, Mach, qbar) + t_m(Mach, qbar)) variable,   axes L D Y
    X = -D ca cb - Y ca sb + L sa,  Y = -D sb + Y cb,  Z = -D sa cb - Y sa sb - L ca     body axes
    T_i = idle(Mach, p) + (mil(Mach, p) - idle(Mach, p)) n^2,  n = (N1 - N1_idle) / (N1_max - N1_idle)

Every number comes from whoever fills `ForceModel` (`cosim.flight.plant.force_model` reads them from the aircraft's
XML). Only entries that exist are held, so the sparsity of the rows, from which [Mar10] takes its residuals, is the
aircraft's own.
"""

import dataclasses
import math

import numpy as np

from actuators.block import kernel

FORCES = ("lift", "drag", "side")
VARIABLES = (
    "one", "alphadot", "p", "q", "r", "beta", "beta2",  # rates as alpha' c/2V, p b/2V, q c/2V, r b/2V; angles [rad]
    "de_lo", "de_li", "de_ri", "de_ro", "da_l", "da_r", "dr", "stab",
)  # fmt: skip
EFFECTOR = {"de_lo": 0, "de_li": 0, "de_ri": 0, "de_ro": 0, "da_l": 1, "da_r": 1, "dr": 2}
NA, NM, NQ, NK_A, NK = 64, 64, 16, 12, 40  # most breakpoints of alpha, Mach, qbar; quantities with alpha, quantities
NT_M, NT_P = 16, 20  # most breakpoints of the thrust tables
P0, A0 = 101325.0, 340.294  # [Pa], [m/s]


@dataclasses.dataclass(frozen=True)
class ForceModel:
    """Hold an airframe's coefficients, SI and rad; `quantities` are (axis, variable), those with alpha first."""

    area: float  # [m2]
    span: float  # [m]
    chord: float  # [m]
    stability_rates: bool  # rates p, r of the quantities are about stability axes
    gyration2: tuple  # Ixx, Iyy, Izz, Ixz over mass [m2]
    alpha: np.ndarray  # breakpoints [rad]
    mach: np.ndarray
    qbar: np.ndarray  # [Pa]
    quantities: tuple
    t_a: np.ndarray  # (k_a, alpha, Mach, 2), linear between the first and the last qbar
    t_m: np.ndarray  # (k, Mach, qbar)
    thrust_mach: np.ndarray
    thrust_p: np.ndarray  # static pressure [Pa]
    idle: np.ndarray  # (Mach, p) [N]
    mil: np.ndarray
    n1_idle: float  # [%]
    n1_max: float
    engine: np.ndarray  # (4, 3) about the reference point: x forward, y right, z down [m]
    thrust_axis: tuple  # unit vector, body axes

    def structure(self, alpha: float = 0.1) -> np.ndarray:
        """Return which effector enters which row at small sideslip: bool (X Y Z; elevator aileron rudder thrust).

        Wind-axis entries turned by `alpha`; what goes with sideslip is dropped, the small-angle assumption of [Mar10]
        slide 7. Left and right entries that cancel for all surfaces of an effector together count as none.
        """
        total = np.zeros((3, 3))
        mid = (len(self.mach) // 2, len(self.qbar) // 2)
        for k, (axis, variable) in enumerate(self.quantities):
            if variable in EFFECTOR:
                base = self.t_a[k, len(self.alpha) // 2, mid[0], 0] if k < len(self.t_a) else 0.0
                total[FORCES.index(axis), EFFECTOR[variable]] += base + self.t_m[k][mid]
        lift, drag, side = total[:3]
        ca, sa = math.cos(alpha), math.sin(alpha)
        rows = np.vstack([lift * sa - drag * ca, side, -lift * ca - drag * sa])
        return np.column_stack([np.abs(rows) > 1e-9, np.abs(self.thrust_axis) > 1e-9])


PARAMS: list[tuple] = [
    ("area", "f8"), ("span", "f8"), ("chord", "f8"), ("stability_rates", "f8"),
    ("n_a", "f8"), ("n_m", "f8"), ("n_q", "f8"), ("n_ka", "f8"), ("n_k", "f8"),  # used sizes
    ("alpha_grid", "f8", (NA,)), ("mach_grid", "f8", (NM,)), ("qbar_grid", "f8", (NQ,)),
    ("axis", "f8", (NK,)), ("variable", "f8", (NK,)), ("effector", "f8", (NK,)),  # effector 3: none
    ("t_a", "f8", (NA, NM, 2, NK_A)), ("t_m", "f8", (NM, NQ, NK)),
    ("n_tm", "f8"), ("n_tp", "f8"), ("thrust_mach", "f8", (NT_M,)), ("thrust_p", "f8", (NT_P,)),
    ("idle", "f8", (NT_M, NT_P)), ("mil", "f8", (NT_M, NT_P)), ("n1_idle", "f8"), ("n1_max", "f8"),
    ("thrust_axis", "f8", (3,)),
]  # fmt: skip

SHAPES = {f[0]: f[2] for f in PARAMS if len(f) > 2}


def fields(model: ForceModel) -> dict:
    """Return {PARAMS field: value} of a `ForceModel`; ValueError when its tables do not fit."""
    axes, variables = zip(*model.quantities)
    out = {n: getattr(model, n) for n in ("area", "span", "chord", "stability_rates", "n1_idle", "n1_max")}
    out |= {"n_a": len(model.alpha), "n_m": len(model.mach), "n_q": len(model.qbar), "n_ka": len(model.t_a),
            "n_k": len(axes), "n_tm": len(model.thrust_mach), "n_tp": len(model.thrust_p)}  # fmt: skip
    tables = {
        "alpha_grid": model.alpha, "mach_grid": model.mach, "qbar_grid": model.qbar,
        "axis": [FORCES.index(axis) for axis in axes], "variable": [VARIABLES.index(v) for v in variables],
        "effector": [EFFECTOR.get(v, 3) for v in variables], "t_a": np.moveaxis(model.t_a, 0, 3),
        "t_m": np.moveaxis(model.t_m, 0, 2), "thrust_mach": model.thrust_mach, "thrust_p": model.thrust_p,
        "idle": model.idle, "mil": model.mil, "thrust_axis": model.thrust_axis,
    }  # fmt: skip
    for name, most in SHAPES.items():
        values = np.asarray(tables[name], float)
        if any(n > m for n, m in zip(values.shape, most)):
            raise ValueError(f"{name} has shape {values.shape}, at most {most} fits")
        out[name] = np.pad(values, [(0, m - n) for n, m in zip(values.shape, most)])
    return out


@kernel
def place(grid, n, x):
    """Return (i, f) with x = (1 - f) grid[i] + f grid[i + 1], held at the ends; `n` >= 2 breakpoints are used."""
    i = min(max(np.searchsorted(grid[: int(n)], x, side="right") - 1, 0), int(n) - 2)
    return i, min(max((x - grid[i]) / (grid[i + 1] - grid[i]), 0.0), 1.0)


@kernel
def air_data(cas, mach):
    """Return (static pressure, dynamic pressure) [Pa] from calibrated airspeed [m/s] and Mach number, both subsonic."""
    a = 1.0 + 0.2 * (cas / A0) * (cas / A0)
    b = 1.0 + 0.2 * mach * mach
    p = P0 * (a * a * a * math.sqrt(a) - 1.0) / max(b * b * b * math.sqrt(b) - 1.0, 1e-9)
    return p, 0.7 * p * mach * mach


@kernel
def between(table, i, f, j, g):
    """Return the bilinear value of a table at the places (i, f), (j, g) of its axes."""
    return (
        (1.0 - f) * (1.0 - g) * table[i, j] + (1.0 - f) * g * table[i, j + 1]
        + f * (1.0 - g) * table[i + 1, j] + f * g * table[i + 1, j + 1]
    )  # fmt: skip


@kernel
def thrust_pair(p, mach, pressure):
    """Return (idle, maximum) thrust of one engine [N]."""
    i, f = place(p.thrust_mach, p.n_tm, mach)
    j, g = place(p.thrust_p, p.n_tp, pressure)
    return between(p.idle, i, f, j, g), between(p.mil, i, f, j, g)


@kernel
def contributions(p, alpha, mach, qbar, variable, part, slope):
    """Fill part[k] = coefficient times variable and slope[axis, effector] = sum of the coefficients of its surfaces."""
    i, f = place(p.alpha_grid, p.n_a, alpha)
    j, g = place(p.mach_grid, p.n_m, mach)
    q, h = place(p.qbar_grid, p.n_q, qbar)
    first, last = p.qbar_grid[0], p.qbar_grid[int(p.n_q) - 1]
    d = min(max((qbar - first) / max(last - first, 1.0), 0.0), 1.0)
    slope[:] = 0.0
    for k in range(int(p.n_k)):
        value = (1.0 - g) * ((1.0 - h) * p.t_m[j, q, k] + h * p.t_m[j, q + 1, k]) + g * (
            (1.0 - h) * p.t_m[j + 1, q, k] + h * p.t_m[j + 1, q + 1, k]
        )
        if k < p.n_ka:
            for a in range(2):
                for b in range(2):
                    weight = (f if a == 1 else 1.0 - f) * (g if b == 1 else 1.0 - g)
                    cell = (1.0 - d) * p.t_a[i + a, j + b, 0, k] + d * p.t_a[i + a, j + b, 1, k]
                    value += weight * cell
        part[k] = value * variable[int(p.variable[k])]
        e = int(p.effector[k])
        if e < 3:
            slope[int(p.axis[k]), e] += value
