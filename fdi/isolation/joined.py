"""Are the chambers joined? An actuator that was let go moves by its bypass alone, whatever its valve is told.

    q' = -L_b z                              [Lu17] (4) with the valve cut off and the leakage L_b of the bypass

Behind a washout the rod has moved by minus the integral of the pressure, within the noise of the two sensors. A
valve that is stuck or oscillates holds a pressure against the load while the rod does something else. The signatures of
`filter` are linear in the size of a fault, and this leak is too large for that; the relation holds for any size.
"""

import math

from actuators.block import kernel

TAU = 0.12  # of the washout: noise of a reading against that of the pressure's integral [s]
MEMORY, LEAST = 0.54, 0.2  # of the sums; what they hold at least [s]
SHOWN = 16.0  # variances that the flow of the bypass has
NOISE, OFF = 3.0, 0.04  # variances that are left; share of the flow's squares, for tolerances

STATE = [
    ("joint_s", "f8", "s"),  # time in the sums, forgotten
    ("joint_q", "f8", "m"),  # rod, lagged
    ("joint_flow", "f8", "m"),  # what the bypass moves the rod by, behind the washout
    ("joint_flow2", "f8", "m^2 s"),  # sums of squares: of the flow,
    ("joint_left2", "f8", "m^2 s"),  # and of what the rod moved otherwise
    ("joined", "f8", "-"),  # 1 where an alarm has shown that the chambers are joined
]


@kernel
def ask(x, u, p, dt):
    """Take a tick's rod and pressure; while an alarm stands, hold what they have shown."""
    if x.alarm < 0.5:
        x.joined = x.joint_s = 0.0
        return
    if u.y_rod_valid < 0.5 or u.y_dp_valid < 0.5 or not (math.isfinite(u.y_rod) and math.isfinite(u.y_dp)):
        x.joint_s = 0.0
        return
    if x.joint_s == 0.0:
        x.joint_q, x.joint_flow, x.joint_flow2, x.joint_left2 = u.y_rod, 0.0, 0.0, 0.0
    a, forgets = min(dt / TAU, 1.0), dt / MEMORY
    x.joint_q += a * (u.y_rod - x.joint_q)
    x.joint_flow += -p.bypass * u.y_dp * dt - a * x.joint_flow
    left = u.y_rod - x.joint_q - x.joint_flow
    x.joint_s += dt - forgets * x.joint_s
    x.joint_flow2 += dt * x.joint_flow * x.joint_flow - forgets * x.joint_flow2
    x.joint_left2 += dt * left * left - forgets * x.joint_left2
    variance = (p.h_r[0] + 0.5 * TAU * p.bypass * p.bypass * p.h_r[2] * dt) * x.joint_s
    shows = x.joint_s > LEAST and x.joint_flow2 > SHOWN * variance
    if shows and x.joint_left2 < NOISE * variance + OFF * x.joint_flow2:
        x.joined = 1.0
