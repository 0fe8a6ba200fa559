"""The hydraulic actuator that flies: equation (4) of [Lu17] and what the filters do not know.

    M q'' = A_p P_s x3 - B q' + F_d + F_f,    F_d = (hm0 + hmd delta) / r,    pressure as in `lu17`

- Friction is Coulomb with a Stribeck rise, F_f = -sign(q') (F_c + (F_s - F_c) / (1 + (q'/v_s)^2)); at rest it
  balances any net force up to F_s, so that a stuck rod does not creep. A crossing of zero velocity is located inside
  its sub-step.
- Where the load exceeds the supply the flow stops (1 - sign(u) x3 is clamped at zero, a check valve); oil never runs
  back into the supply. No other relief valve is modelled: x3 beyond 1 leaks across the piston.
- Stops are inelastic. The valve spool stops at u_max, 45 deg/s of unloaded surface.
- The hinge moment is taken at the sub-step's own angle.
- Backlash: inside the gap the surface has no inertia and drifts at hm / c_gap; the rod feels the load only in
  contact.

A fault is an input whose zero means healthy:

| input | what it does |
|---|---|
| f_u, s_u | spool = (1 - s_u) u + f_u: liquid OFC adds; solid OFC and runaway replace (s_u = 1, f_u the signal) |
| loss | fraction of valve flow lost at the same spool position: slower, and a weaker loop; the stall force stays |
| free_float | bypass valve: valve cut off, chambers joined by L_bypass (damped surface on its hinge moment) |
| jam | brake on the rod, jam F_brake: 1 stops the surface where it is, in between is rising friction |
| supply_drop | fraction of P_s lost (flow by its root, stall in proportion) |
| leak_add | added normalised leakage [m/s] |
| air | fraction of bulk modulus lost |

x3 is always over the *nominal* P_s, as the sensor reads it: under a supply drop the actuator stalls at x3 = 1 -
supply_drop.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.common import linkage
from actuators.common.limits import clip, finite, share, sign, stopped
from actuators.hydraulic import lu17

PARAMS = dtype([
    *lu17.FIELDS,
    ("arm", "f8"),  # linkage arm [m]
    ("q_lo", "f8"),  # stop, rod in [m]
    ("q_hi", "f8"),  # stop, rod out [m]
    ("u_max", "f8"),  # spool stop [1]
    ("F_c", "f8"),  # Coulomb friction [N]
    ("F_s", "f8"),  # friction at rest [N]
    ("v_s", "f8"),  # Stribeck velocity [m/s]
    ("F_brake", "f8"),  # force of a full jam [N]
    ("L_bypass", "f8"),  # leakage of the bypass in free float [m/s]
    ("backlash", "f8"),  # gap between rod and surface, whole width [rad]
    ("c_gap", "f8"),  # damping of the surface inside the gap [N m s/rad]
    ("substeps", "f8"),  # Runge-Kutta steps in a tick [1]
])
INPUTS = dtype([
    ("u", "f8", "-"),  # valve command of the servo
    ("hm0", "f8"),  # hinge moment at delta = 0, + drives trailing edge down [N m]
    ("hmd", "f8"),  # its slope [N m/rad]
    ("f_u", "f8"),  # fault: added at the valve [1]
    ("s_u", "f8"),  # fault: share of the valve command replaced [0..1]
    ("jam", "f8"),  # fault: brake on the rod [0..1]
    ("free_float", "f8"),  # fault: bypass [0..1]
    ("loss", "f8"),  # fault: valve flow lost [0..1]
    ("supply_drop", "f8"),  # fault: supply pressure lost [0..1]
    ("leak_add", "f8"),  # fault: added normalised leakage [m/s]
    ("air", "f8"),  # fault: bulk modulus lost [0..1]
    ("backlash_add", "f8"),  # fault: added gap between rod and surface, whole width [rad]
])
STATE = dtype([
    ("q_rod", "f8", "m"),  # rod position, + extends = trailing edge down
    ("qd_rod", "f8", "m/s"),  # rod velocity
    ("x3", "f8", "-"),  # pressure difference over nominal supply, + extends
    ("delta", "f8", "rad"),  # surface angle, trailing edge down +
    ("F_d", "f8", "N"),  # hinge load on the rod, + extends
    ("u_eff", "f8", "-"),  # valve opening that passes oil, faults and limits included
    ("status", "f8", "-"),  # 0 good, 1 an input was not finite (taken as zero), 2 the state diverged
    ("contact", "f8"),  # 1 while the surface leans on the rod, 0 inside the backlash
    *lu17.FIELDS,  # the parameters as the faults leave them
])
OUTPUTS = ("q_rod", "qd_rod", "x3", "delta", "F_d", "u_eff", "status")

NOMINAL = {
    **lu17.NOMINAL,
    "arm": linkage.ARM,
    "q_lo": linkage.rod(linkage.TRAVEL[0]),
    "q_hi": linkage.rod(linkage.TRAVEL[1]),
    "u_max": linkage.rod(linkage.RATE),  # 1 of u is 1 m/s of rod
    "F_c": 350.0,  # assumed: seals, 1 % of the stall force
    "F_s": 450.0,  # assumed: 1.3 times Coulomb friction
    "v_s": 0.01,  # assumed: 2 deg/s of surface
    "F_brake": 350e3,  # ten times the stall force: full rate stops within 1.2 ms
    "L_bypass": 1.0,  # 35 kN s/m: 0.7 of critical at 26 kN m/rad (the 10.5 kN m of full travel) on 2000 kg
    "backlash": 0.0,
    "c_gap": 1600.0,  # 0.7 of critical for 50 kg m^2 of surface on 26 kN m/rad
    "substeps": 5.0,  # 1 ms each; the oil mode is at 56 rad/s
}
FLOOR = 0.02  # least share of supply and bulk modulus left by a fault: (4) divides by both


def params(**values: Any) -> np.ndarray:
    """Return PARAMS of shape (1,): nominal values replaced by `values`; unknown names raise ValueError."""
    return record(PARAMS, **{**NOMINAL, **values})


def init_at(p: np.ndarray, delta: Any = 0.0, hm0: Any = 0.0, hmd: Any = 0.0) -> np.ndarray:
    """Return the state in load equilibrium: x3 = -F_d / (A_p P_s); `delta` [rad] and the load pair broadcast over p.

    The valve opening that holds it is `holding(p, x3)`.
    """
    x = np.zeros(p.shape, STATE)
    x["delta"] = delta
    hm = hm0 + hmd * x["delta"]
    x["q_rod"] = linkage.rod(x["delta"] - 0.5 * np.sign(hm) * p["backlash"], p["arm"])
    x["F_d"] = hm / p["arm"]
    x["x3"] = -x["F_d"] / (p["A_p"] * p["P_s"])
    x["u_eff"] = holding(p, x["x3"])
    x["contact"] = 1.0
    for name, _ in lu17.FIELDS:
        x[name] = p[name]
    return x


def holding(p: Any, x3: Any) -> Any:
    """Return the valve opening that feeds the leakage at rest: u = L A_p x3 / (phi_n sqrt(1 - |x3|)) [1]."""
    x3 = np.asarray(x3)
    return p["L"] * p["A_p"] / p["phi_n"] * x3 / np.sqrt(np.maximum(1.0 - np.abs(x3), lu17.ROOT_FLOOR**2))


@kernel
def _faulty(x, u, p):
    """Write the parameters that the faults leave, and return (supply, brake): share of supply [1], brake force [N].

    With supply sigma P_s, (4) holds for z = x3 / sigma, P_s' = sigma P_s, phi_n' = sqrt(sigma) phi_n, L' = sigma L.
    """
    sigma = max(1.0 - share(finite(u.supply_drop, x)), FLOOR)
    bypass = share(finite(u.free_float, x))
    x.A_p, x.B, x.M, x.V_m = p.A_p, p.B, p.M, p.V_m
    x.P_s = sigma * p.P_s
    x.phi_n = math.sqrt(sigma) * p.phi_n
    x.E = p.E * max(1.0 - share(finite(u.air, x)), FLOOR)
    x.L = sigma * (p.L + max(finite(u.leak_add, x), 0.0) + bypass * p.L_bypass)
    spool = finite((1.0 - u.s_u) * u.u + u.f_u, x)
    x.u_eff = clip(spool, -p.u_max, p.u_max) * (1.0 - share(finite(u.loss, x))) * (1.0 - bypass)
    return sigma, share(finite(u.jam, x)) * p.F_brake


@kernel
def _external(q, v, d, gap, hm0, hmd, brake, x, p):
    """Return the force on a rod that slides in direction d (0: no friction): hinge load and friction [N]."""
    F_d = x.contact * (hm0 + hmd * (q / p.arm + gap)) / p.arm
    ratio = v / p.v_s
    return F_d - d * (p.F_c + brake + (p.F_s - p.F_c) / (1.0 + ratio * ratio))


@kernel
def _move(q, v, z, d, free, gap, hm0, hmd, brake, h, x, p):
    """Return (q, v, z) after one Runge-Kutta step of a rod that slides in direction d, or rests: v and `free` 0."""
    u = x.u_eff
    a1, a2, a3 = lu17.rhs(q, v, z, u, u, 0.0, _external(q, v, d, gap, hm0, hmd, brake, x, p), x)
    g = 0.5 * h
    r, s, t = q + g * a1, v + g * free * a2, z + g * a3
    b1, b2, b3 = lu17.rhs(r, s, t, u, u, 0.0, _external(r, s, d, gap, hm0, hmd, brake, x, p), x)
    r, s, t = q + g * b1, v + g * free * b2, z + g * b3
    c1, c2, c3 = lu17.rhs(r, s, t, u, u, 0.0, _external(r, s, d, gap, hm0, hmd, brake, x, p), x)
    r, s, t = q + h * c1, v + h * free * c2, z + h * c3
    d1, d2, d3 = lu17.rhs(r, s, t, u, u, 0.0, _external(r, s, d, gap, hm0, hmd, brake, x, p), x)
    w = h / 6.0
    return (
        q + w * (a1 + 2.0 * (b1 + c1) + d1),
        v + w * free * (a2 + 2.0 * (b2 + c2) + d2),
        z + w * (a3 + 2.0 * (b3 + c3) + d3),
    )


@kernel
def _direction(q, v, z, gap, hm0, hmd, brake, x, p):
    """Return (held, d): whether friction or a stop holds the rod, else the direction in which it slides."""
    if v != 0.0:
        return False, sign(v)
    net = x.A_p * x.P_s * z + _external(q, 0.0, 0.0, gap, hm0, hmd, brake, x, p)
    rest = p.F_s + brake
    held = (rest > 0.0 and abs(net) <= rest) or (net > 0.0 and q >= p.q_hi) or (net < 0.0 and q <= p.q_lo)
    return held, sign(net)


@kernel
def _substep(q, v, z, gap, hm0, hmd, brake, h, x, p):
    """Return (q, v, z) after `h` seconds; a reversal of the rod is located and friction decided anew there."""
    left = h
    for _ in range(2):
        held, d = _direction(q, v, z, gap, hm0, hmd, brake, x, p)
        if held:
            return _move(q, 0.0, z, d, 0.0, gap, hm0, hmd, brake, left, x, p)
        q1, v1, z1 = _move(q, v, z, d, 1.0, gap, hm0, hmd, brake, left, x, p)
        if v1 * d >= 0.0:
            left = 0.0
        elif v != 0.0:
            part = left * v / (v - v1)
            q1, v1, z1 = _move(q, v, z, d, 1.0, gap, hm0, hmd, brake, part, x, p)
            v1 = 0.0
            left -= part
        else:
            v1, left = 0.0, 0.0
        q, v = stopped(q1, v1, p.q_lo, p.q_hi)
        z = z1
        if left <= 0.0:
            break
    return q, v, z


@kernel
def step(x, u, p, dt):
    """Advance the actuator by one tick of `dt` seconds with command, load pair and faults held."""
    x.status = 0.0
    hm0, hmd = finite(u.hm0, x), finite(u.hmd, x)
    sigma, brake = _faulty(x, u, p)
    gap = p.backlash + max(finite(u.backlash_add, x), 0.0)
    q, v, z = x.q_rod, x.qd_rod, x.x3 / sigma
    n = int(p.substeps)
    h = dt / n
    for _ in range(n):
        q, v, z = _substep(q, v, z, x.delta - q / p.arm, hm0, hmd, brake, h, x, p)
        hm = hm0 + hmd * x.delta
        drift = x.delta + h * hm / p.c_gap
        lo, hi = q / p.arm - 0.5 * gap, q / p.arm + 0.5 * gap
        x.delta = clip(drift, lo, hi)
        x.contact = 1.0 if (hm >= 0.0 and drift >= hi) or (hm <= 0.0 and drift <= lo) or hi == lo else 0.0
    if not (abs(q) < 1e3 and abs(v) < 1e6 and abs(z) < 1e6):
        x.status = 2.0
        q, v, z = p.q_lo, 0.0, 0.0
        x.delta = q / p.arm
    x.q_rod, x.qd_rod, x.x3 = q, v, z * sigma
    x.F_d = x.contact * (hm0 + hmd * x.delta) / p.arm


rollout = entry(step, STATE, INPUTS, PARAMS)
