"""Are the chambers joined? An actuator that was let go moves by its bypass alone, whatever its valve is told.

    q' = -L_b z                              [Lu17] (4) with the valve cut off and the leakage L_b of the bypass

Over blocks of BLOCK_S the rod has moved by minus the integral of the pressure, within the noise of the two sensors. A
valve that is stuck or oscillates holds a pressure against the load while the rod does something else. The signatures of
`filter` are linear in the size of a fault, and this leak is too large for that; the relation holds for any size.
"""

import math

from actuators.block import kernel

BLOCK_S = 0.12  # noise of a reading against that of the pressure's integral [s]
KEEP, BLOCKS = 0.8, 1.7  # from block to block; two whole ones
SHOWN = 16.0  # variances of a block that the flow of the bypass has
NOISE, OFF = 3.0, 0.04  # variances that are left; share of the flow's squares, for tolerances

STATE = [
    ("joint_s", "f8", "s"),  # into the block
    ("joint_q", "f8", "m"),  # rod at its begin
    ("joint_flow", "f8", "m"),  # by which the bypass moves the rod since then
    ("joint_n", "f8", "-"),  # blocks, forgotten
    ("joint_flow2", "f8", "m^2"),  # sums of squares over blocks: of the flow,
    ("joint_left2", "f8", "m^2"),  # and of what the rod moved otherwise
    ("joined", "f8", "-"),  # 1 where an alarm has shown that the chambers are joined
]


@kernel
def ask(x, u, p, dt):
    """Take a tick's rod and pressure; while an alarm stands, hold what they have shown."""
    if x.alarm < 0.5:
        x.joined = x.joint_s = x.joint_n = 0.0
        return
    if u.y_rod_valid < 0.5 or u.y_dp_valid < 0.5 or not (math.isfinite(u.y_rod) and math.isfinite(u.y_dp)):
        x.joint_s = x.joint_n = 0.0
        return
    if x.joint_s == 0.0:
        x.joint_q, x.joint_flow = u.y_rod, 0.0
    x.joint_s += dt
    x.joint_flow -= p.bypass * u.y_dp * dt
    if x.joint_s < BLOCK_S:
        return
    left = u.y_rod - x.joint_q - x.joint_flow
    if x.joint_n == 0.0:
        x.joint_flow2 = x.joint_left2 = 0.0
    x.joint_n = KEEP * x.joint_n + 1.0
    x.joint_flow2 = KEEP * x.joint_flow2 + x.joint_flow * x.joint_flow
    x.joint_left2 = KEEP * x.joint_left2 + left * left
    variance = 2.0 * p.h_r[0] + p.bypass * p.bypass * p.h_r[2] * dt * x.joint_s
    noise = NOISE * variance * x.joint_n
    shows = x.joint_n > BLOCKS and x.joint_flow2 > SHOWN * variance * x.joint_n
    if shows and x.joint_left2 < noise + OFF * x.joint_flow2:
        x.joined = 1.0
    x.joint_s = 0.0
