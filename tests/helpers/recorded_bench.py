"""A bench without an aircraft: servo, actuator and sensors of one segment on given commands and hinge moments.

Many lanes at once, a command each; what acts at which tick, and in which order, is as in cosim/flight/tick.py. The
detectors then read what the bench recorded.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from actuators.hydraulic import actuator, servo
from actuators.hydraulic.record import TECHNOLOGY
from cosim.flight.blocks import faults as f
from cosim.flight.blocks.servo_gain import sensor_age
from cosim.flight.faults import inject
from cosim.scenario import Scenario

TOLERANCE = 0.05  # of each parameter of the actuator that flies, as in the training of the thresholds
DRAWN = ("A_p", "B", "M", "P_s", "phi_n", "V_m", "E", "L")
READ = {"rod": "q_rod", "surface": "delta", "pressure": "x3"}  # sensor -> state


@dataclass(frozen=True)
class Ride:
    """What one lane meets: command [rad] and angle of attack [rad], calibrated airspeed [m/s], pitch rate [rad/s], each
    (ticks,), of a window of a flight."""

    command: np.ndarray
    alpha: np.ndarray
    cas: np.ndarray
    q: np.ndarray
    of: str = ""  # where it is from


def move(rides: list[Ride], scenarios: list[Scenario], load: Any, segment: str, seed: int) -> dict[str, np.ndarray]:
    """Return {word of the segment's signals, or its flag: (lanes, ticks)} of lane i on `rides[i]` with the faults of
    `scenarios[i]`; `load` (2, lanes, ticks) is the hinge moment at zero angle and its slope that the actuators meet.
    """
    n, ticks = len(rides), len(rides[0].command)
    aircraft, dt = scenarios[0].aircraft, scenarios[0].dt
    rng, own = np.random.default_rng(seed), aircraft.own("hydraulic")
    truth = [{s: TECHNOLOGY.parameters(own)[s] * rng.uniform(1.0 - TOLERANCE, 1.0 + TOLERANCE) for s in DRAWN}
             for _ in range(n)]  # fmt: skip
    first = np.array([r.command[0] for r in rides])
    trim = np.array([first, load[0, :, 0], load[1, :, 0]])
    age = int(sensor_age(dt))
    assert TECHNOLOGY.build
    (_, _, ps, xs), (_, _, p, x) = TECHNOLOGY.build(own, truth, [{}] * n, trim, aircraft.travels["elevator"], dt, age)
    us, u = np.zeros((n, 1), servo.INPUTS), np.zeros((n, 1), actuator.INPUTS)
    us["q_valid"] = us["x3_valid"] = 1.0
    broken = _Broken(scenarios, dt)
    command = np.ascontiguousarray(np.array([r.command for r in rides]).T)
    noise = {s: TECHNOLOGY.sensors[s].sigma * np.sqrt(0.005 / dt) for s in READ}
    bias = {s: TECHNOLOGY.sensors[s].spread * rng.uniform(-1.0, 1.0, n) for s in READ}
    out = {f"{segment}.{s}": np.empty((n, ticks)) for s in (*READ, "valve_command")}
    control, step = servo.rollout.bound(xs, us, ps, dt), actuator.rollout.bound(x, u, p, dt)
    past = [{s: x[state].copy() for s, state in READ.items()}] * (age + 1)
    acted = xs["u"].copy()
    for k in range(ticks):
        past = [*past[1:], {s: x[state].copy() for s, state in READ.items()}]
        read = {s: v + bias[s] + noise[s] * rng.standard_normal(n) for s, v in past[0].items()}
        broken.at(k, x, us[:, 0], u[:, 0])
        for s, v in read.items():
            out[f"{segment}.{s}"][:, k] = v
        out[f"{segment}.valve_command"][:, k] = acted  # what has acted until now
        us["command"][:, 0] = command[k]
        us["q_meas"][:, 0], us["x3_meas"][:, 0] = read["rod"], read["pressure"]
        control()
        u["u"][:, 0] = acted = xs["u"].copy()
        u["hm0"][:, 0], u["hmd"][:, 0] = load[0, :, k], load[1, :, k]
        step()
    return out


class _Broken:
    """The faults of all lanes, as the loop injects them."""

    def __init__(self, scenarios, dt):
        self.lanes = [(i, lane) for i, s in enumerate(scenarios) for lane in inject.lanes(s)]
        self.p = np.concatenate([np.zeros(0, f.PARAMS), *(lane.p for _, lane in self.lanes)])
        self.x, self.u, self.dt = f.init(self.p), np.zeros((len(self.p), 1), f.INPUTS), dt

    def at(self, k, x, us, u):
        """Set what is injected at tick k in the inputs of servo and actuator."""
        if not self.lanes:
            return
        self.u["t"] = k * self.dt
        for j, (i, lane) in enumerate(self.lanes):
            if lane.reference:
                self.u["ref"][j, 0] = x[lane.reference.rpartition(".")[2]][i]
        f.rollout(self.x, self.u, self.p, self.dt)
        for j, (i, lane) in enumerate(self.lanes):
            for place, source in lane.places:
                section, _, name = place.split(".")
                (us if section == "servo_in" else u)[name][i] = self.x[source][j]
