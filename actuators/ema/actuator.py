"""The electromechanical actuator that flies: the model of [Jay] with limits, friction, stops and faults.

Symbols as in `jay`. The equations, and how one sub-step is taken, stand in `motion`.

The amplifier is in one of four modes, chosen at each sub-step by the quasi-steady current g:

| mode | V | R_g |
|---|---|---|
| current loop | K_g K_i (u - (b - a) x6) - K_i K_c f_i | K_i K_c (1 - s_i) + R |
| current limited, abs(g) > I_max | such that g = I_max sign(g) | as in the loop |
| voltage limited, abs(R g + K_B x4) > V_max | V_max, signed | R |
| off (free float) | 0 | R + R_float |

A voltage peak that lasts less than a sub-step (the loop settles in 0.3 ms) is not limited. Friction sticks as in
`hydraulic`. The screw's end stops are inelastic and act on the motor.

A fault is an input whose zero means healthy:

| input | what it does |
|---|---|
| f_u, s_u | u_eff = ((1 - s_u) u + f_u) (1 - loss) [A]: OFC at the current demand |
| loss | fraction of current demand and of current limit lost |
| free_float | above 0.5: amplifier off, winding on a damping resistor, the load drives the screw back |
| jam | brake on the surface, 1 stops it where it is; jam_screw: the same on the motor |
| r_add | winding resistance rise, fraction of R; magnet_loss: fraction of K_T and K_B lost |
| friction_add | added Coulomb torque at the motor [N m]; backlash_add: added gap [m of screw travel] |
| f_i, s_i | current sensor inside the current loop: it reads (1 - s_i) x5 + f_i (the monitor's copy is not here) |
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.common import linkage
from actuators.common.limits import clip, finite, share, sign, stopped
from actuators.ema import jay
from actuators.ema.motion import move, spring, steady

PARAMS = dtype([
    ("arm", "f8"),  # l, lever arm [m]
    ("lead", "f8"),  # N, screw [m/rad]
    ("K_s", "f8"),  # stiffness [N/m]
    ("J_N", "f8"),  # inertia of the surface [kg m^2]
    ("B_N", "f8"),  # damping of the surface [N m s/rad]
    ("J_M", "f8"),  # inertia of the motor [kg m^2]
    ("B_M", "f8"),  # damping of the motor [N m s/rad]
    ("K_T", "f8"),  # torque constant [N m/A]
    ("K_B", "f8"),  # back electromotive force [V s/rad]
    ("R", "f8"),  # winding resistance [Ohm]
    ("L", "f8"),  # winding inductance [H]
    ("K_ic", "f8"),  # current feedback [V/A]
    ("K_gi", "f8"),  # drive [V per unit of u]
    ("a", "f8"),  # compensator zero [1/s]
    ("b", "f8"),  # compensator pole [1/s]
    ("I_max", "f8"),  # current limit [A]
    ("V_max", "f8"),  # voltage limit [V]
    ("R_float", "f8"),  # damping resistor in free float [Ohm]
    ("T_c", "f8"),  # Coulomb friction at the motor [N m]
    ("T_s", "f8"),  # friction at rest [N m]
    ("T_brake", "f8"),  # brake of a full screw jam, at the motor [N m]
    ("M_brake", "f8"),  # brake of a full surface jam, at the surface [N m]
    ("backlash", "f8"),  # gap of the screw, whole width [m]
    ("x3_lo", "f8"),  # end stop, motor angle [rad]
    ("x3_hi", "f8"),  # end stop [rad]
    ("substeps", "f8"),  # steps in a tick [1]
])
INPUTS = dtype([
    ("u", "f8", "A"),  # current demand of the servo [A] (elevator set), amplifier input (nozzle)
    ("hm0", "f8"),  # hinge moment at delta = 0, + drives trailing edge down [N m]
    ("hmd", "f8"),  # its slope [N m/rad]
    ("f_u", "f8"),  # fault: added to the demand [unit of u]
    ("s_u", "f8"),  # fault: share of the demand replaced [0..1]
    ("jam", "f8"),  # fault: brake on the surface [0..1]
    ("jam_screw", "f8"),  # fault: brake on the motor [0..1]
    ("free_float", "f8"),  # fault: amplifier off [0 or 1]
    ("loss", "f8"),  # fault: current authority lost [0..1]
    ("r_add", "f8"),  # fault: winding resistance rise, fraction of R
    ("magnet_loss", "f8"),  # fault: fraction of K_T and K_B lost [0..1]
    ("friction_add", "f8"),  # fault: Coulomb torque at the motor [N m]
    ("backlash_add", "f8"),  # fault: gap [m]
    ("f_i", "f8"),  # fault: bias of the loop's current sensor [A]
    ("s_i", "f8"),  # fault: share of current that it does not see [1]; -0.25 is a scale of 1.25, 1 a freeze
])
STATE = dtype([
    ("delta", "f8", "rad"),  # x1, surface angle, trailing edge down +
    ("delta_d", "f8", "rad/s"),  # x2
    ("motor", "f8", "rad"),  # x3, motor angle; N x3 is what the position sensor sees
    ("motor_d", "f8", "rad/s"),  # x4, what the velocity sensor sees
    ("i", "f8", "A"),  # x5, current
    ("comp", "f8", "-"),  # x6, compensator
    ("u_eff", "f8", "A"),  # demand after faults
    ("volts", "f8", "V"),  # winding voltage, quasi-steady, of the last sub-step
    ("mode", "f8", "-"),  # amplifier: 0 current loop, 1 current limited, 2 voltage limited, 3 off
    ("status", "f8", "-"),  # 0 good, 1 an input was not finite (taken as zero), 2 the state diverged
    ("R_now", "f8", "Ohm"),  # R with its fault
    ("K_now", "f8", "-"),  # share of K_T and K_B left
    ("K_i", "f8", "V/A"),  # current feedback as the sensor fault leaves it
    ("V_i", "f8", "V"),  # voltage that the sensor's bias feeds in
    ("I_now", "f8", "A"),  # current limit left
    ("T_add", "f8", "N m"),  # torque that the friction and screw-jam faults add
    ("M_add", "f8", "N m"),  # brake on the surface
    ("gap", "f8", "m"),  # half the backlash
    ("g", "f8", "V"),  # mode: drive voltage
    ("R_g", "f8", "Ohm"),  # mode: resistance
    ("b_g", "f8"),  # mode: share of K_B that acts (0 while current limited)
])
OUTPUTS = ("delta", "delta_d", "motor", "motor_d", "i", "comp", "u_eff", "volts", "mode", "status")


def params(
    kind: str = "elevator",
    symbols: Mapping[str, Any] | None = None,
    travel: tuple[float, float] = linkage.TRAVEL,
    **values: Any,
) -> np.ndarray:
    """Return PARAMS of shape (1,) of the set "elevator" or "nozzle"; `symbols` replace those of the set, `travel` [rad]
    the surface's stops, `values` fields; unknown ones raise.

    The nozzle set is the paper's linear model: no friction, limits or stops; 40 sub-steps, so that even the least entry
    of Phi is right to its printed digits.
    """
    v = jay.values(kind, **(symbols or {}))
    amperes, volts = jay.LIMITS[kind]
    ratio = v["arm"] / v["lead"]
    fields = {**v, "I_max": amperes, "V_max": volts, "x3_lo": -jay.UNLIMITED, "x3_hi": jay.UNLIMITED, "substeps": 40.0}
    if kind == "elevator":
        stall = v["K_T"] * amperes
        # damping of 0.7 of critical at the 26 kN m/rad that hold 10.5 kN m at full travel
        c = 2 * 0.7 * math.sqrt(26e3 * (v["J_N"] + v["J_M"] * ratio**2)) / ratio**2
        fields |= {
            "T_c": 0.02 * stall,  # assumed: bearings and screw, 2 % of the stall torque
            "T_s": 0.024 * stall,  # assumed: 1.2 times
            "T_brake": 20 * stall,
            "M_brake": 10 * stall * ratio,
            "R_float": v["K_T"] * v["K_B"] / c - v["R"],
            "x3_lo": travel[0] * ratio,
            "x3_hi": travel[1] * ratio,
            "substeps": 5.0,
        }
    return record(PARAMS, **{**fields, **values})


def init_at(p: np.ndarray, delta: Any = 0.0, hm0: Any = 0.0, hmd: Any = 0.0) -> np.ndarray:
    """Return the state in load equilibrium: the spring and K_T x5 hold the hinge moment; arguments broadcast over p.

    The demand that holds it is `holding(p, x5)`.
    """
    x = np.zeros(p.shape, STATE)
    x["delta"] = delta
    F = -(hm0 + hmd * x["delta"]) / p["arm"]
    x["motor"] = (p["arm"] * x["delta"] + F / p["K_s"] + 0.5 * np.sign(F) * p["backlash"]) / p["lead"]
    x["i"] = p["lead"] * F / p["K_T"]
    x["u_eff"] = holding(p, x["i"])
    x["comp"] = x["u_eff"] / p["b"]
    return x


def holding(p: np.ndarray, i: Any) -> Any:
    """Return the demand that holds the current `i` [A] at rest: u = (K_ic + R) i / K_gi b / a."""
    return (p["K_ic"] + p["R"]) * np.asarray(i) / p["K_gi"] * p["b"] / p["a"]


@kernel
def _faulty(x, u, p):
    """Write the demand and the parameters that the faults leave."""
    left = 1.0 - share(finite(u.loss, x))
    x.u_eff = finite((1.0 - u.s_u) * u.u + u.f_u, x) * left
    x.I_now = p.I_max * left
    x.R_now = p.R * (1.0 + max(finite(u.r_add, x), -0.9))
    x.K_now = 1.0 - share(finite(u.magnet_loss, x))
    x.K_i = p.K_ic * max(1.0 - finite(u.s_i, x), 0.0)
    x.V_i = -p.K_ic * finite(u.f_i, x)
    x.T_add = max(finite(u.friction_add, x), 0.0) + share(finite(u.jam_screw, x)) * p.T_brake
    x.M_add = share(finite(u.jam, x)) * p.M_brake
    x.gap = 0.5 * (p.backlash + max(finite(u.backlash_add, x), 0.0))


@kernel
def _choose(x, off, p):
    """Choose the amplifier's mode for the sub-step that starts, and write its g, R_g, b_g."""
    drive = p.K_gi * (x.u_eff - (p.b - p.a) * x.comp) + x.V_i
    back = x.K_now * p.K_B * x.motor_d
    x.mode, x.g, x.R_g, x.b_g = 0.0, drive, x.K_i + x.R_now, 1.0
    if off > 0.5:
        x.mode, x.g, x.R_g = 3.0, 0.0, x.R_now + p.R_float
        x.volts = p.R_float / x.R_g * back
        return
    g = (drive - back) / x.R_g
    if abs(g) > x.I_now:
        g = clip(g, -x.I_now, x.I_now)
        x.mode, x.g, x.b_g = 1.0, g * x.R_g, 0.0
    x.volts = x.R_now * g + back
    if abs(x.volts) > p.V_max:
        x.volts = clip(x.volts, -p.V_max, p.V_max)
        x.mode, x.g, x.R_g, x.b_g = 2.0, x.volts, x.R_now, 1.0


@kernel
def _slides_motor(x, p):
    """Return the direction in which the motor turns, or 0 where friction or an end stop holds it."""
    if x.motor_d != 0.0:
        return sign(x.motor_d)
    net = x.K_now * p.K_T * steady(0.0, x.comp, x.R_g, x, p) - p.lead * spring(x.delta, x.motor, x, p)
    held = abs(net) <= p.T_s + x.T_add or (net > 0.0 and x.motor >= p.x3_hi) or (net < 0.0 and x.motor <= p.x3_lo)
    return 0.0 if held else sign(net)


@kernel
def _slides_surface(x, hm0, hmd, p):
    """Return the direction of a braked surface, 0 where the brake holds it; without a brake friction has no part."""
    if x.delta_d != 0.0:
        return sign(x.delta_d)
    net = p.arm * spring(x.delta, x.motor, x, p) + hm0 + hmd * x.delta
    return 0.0 if abs(net) <= x.M_add else sign(net)


@kernel
def _until(v, v_end, d, braked):
    """Return the share of a step after which a velocity that moves in direction d reaches zero; 1 if it does not."""
    stops = braked and d != 0.0 and v_end * d < 0.0 and v != v_end
    return v / (v - v_end) if stops else 1.0


@kernel
def _substep(x, off, hm0, hmd, h, p):
    """Advance by `h`; where motor or braked surface come to rest inside, friction is decided anew from there."""
    left = h
    braked = x.M_add > 0.0
    rubs = p.T_c + x.T_add > 0.0
    for _ in range(3):
        _choose(x, off, p)
        d3 = _slides_motor(x, p)
        d1 = _slides_surface(x, hm0, hmd, p)
        m3 = 0.0 if d3 == 0.0 and (rubs or x.motor >= p.x3_hi or x.motor <= p.x3_lo) else 1.0
        m1 = 0.0 if d1 == 0.0 and braked else 1.0
        x1, x2, x3, x4, i, x6 = move(x.delta, x.delta_d, x.motor, x.motor_d, x.i, m1, m3, d1, d3, hm0, hmd, left, x, p)
        p1, p3 = _until(x.delta_d, x2, d1, braked), _until(x.motor_d, x4, d3, rubs)
        part = min(p1, p3)
        if 0.0 < part < 1.0:
            x1, x2, x3, x4, i, x6 = move(
                x.delta, x.delta_d, x.motor, x.motor_d, x.i, m1, m3, d1, d3, hm0, hmd, part * left, x, p
            )
        if p1 <= part and p1 < 1.0:
            x2 = 0.0
        if p3 <= part and p3 < 1.0:
            x4 = 0.0
        x.motor, x.motor_d = stopped(x3, x4, p.x3_lo, p.x3_hi)
        x.delta, x.delta_d, x.i, x.comp = x1, x2, i, x6
        if part <= 0.0 or part >= 1.0:
            break
        left -= part * left


@kernel
def step(x, u, p, dt):
    """Advance the actuator by one tick of `dt` seconds with demand, load pair and faults held."""
    x.status = 0.0
    hm0, hmd, off = finite(u.hm0, x), finite(u.hmd, x), finite(u.free_float, x)
    _faulty(x, u, p)
    n = int(p.substeps)
    for _ in range(n):
        _substep(x, off, hm0, hmd, dt / n, p)
    if not (abs(x.delta) < 1e3 and abs(x.motor) < 1e6 and abs(x.motor_d) < 1e9 and abs(x.i) < 1e9):
        x.status = 2.0
        x.delta, x.delta_d, x.motor, x.motor_d, x.i, x.comp = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


rollout = entry(step, STATE, INPUTS, PARAMS)
