"""One tick of the lockstep: read this first.

Everything of a tick is in one vector (cosim/flight/bus.py). Each block below reads its own inputs there and leaves its
state there; between blocks, `route` copies what is wired (cosim/flight/wiring.py). JSBSim is at t_k when the tick
begins and at t_k+1 when it ends.
"""

from dataclasses import dataclass, field

import numpy as np

from actuators.block import bound
from cosim.flight.bus import Bus
from cosim.flight.plant.plant import Plant


class Block:
    """A block in the loop: its module's `rollout` bound to its lanes in the bus; `advance()` steps every lane by one
    tick, in place.
    """

    def __init__(self, bus, name, module, p, x0, dt, every=1):
        self.name, self.module, self.p, self.every = name, module, p, every
        self.x, self.u = bus[name], bus[name + "_in"].reshape(-1, 1)
        self.x[:] = x0
        self.advance = bound(module.rollout, self.x, self.u, p, dt * every, np.zeros((len(self.x), 1), module.STATE))


@dataclass
class Loop:
    """What one tick needs: the bus, the plant, the blocks in their order, the wires between them."""

    bus: Bus
    plant: Plant
    dt: float
    draw: object  # draws the next tick's noise into a vector
    route: dict  # stage -> call that copies its wires
    faults: Block
    sensors: Block
    pilot: Block
    law: Block
    hinge: Block
    detectors: list = field(default_factory=list)
    servos: list = field(default_factory=list)
    actuators: list = field(default_factory=list)

    def __post_init__(self):
        self.v = self.bus.v
        self.clock, self.truth, self.surfaces = self.bus["clock"], self.bus["truth"][0], self.bus["surfaces"]
        self.noise = self.bus["sensors_in"]["noise"]
        self.surface_vector = self.surfaces.view("f8")


def tick(s, k, log):
    """Advance the loop `s` from t_k to t_k+1 and append the row of t_k to `log`."""
    s.clock["t"] = k * s.dt
    s.plant.read(s.truth)  # 1. the aircraft's truth at t_k

    s.route["faults"]()
    s.faults.advance()
    s.route["injection"]()  # what is injected at t_k, and where

    s.draw(s.noise)
    s.route["sensors"]()
    s.sensors.advance()  # 2. measurements

    s.route["law"]()
    s.pilot.advance()
    s.route["demand"]()
    s.law.advance()  # 3. control law on measurements

    s.route["hinge"]()
    s.hinge.advance()
    s.route["detectors"]()
    for d in s.detectors:  # 4. detectors on measurements and commands at t_k, and on what the servos sent until now
        if k % d.every == 0:
            d.advance()

    s.route["servos"]()
    for servo in s.servos:
        servo.advance()  # 5. servo loops on t_k data, perhaps on a detector's estimate; held over the tick

    log(s.v)

    s.route["actuators"]()
    for actuator in s.actuators:
        actuator.advance()  # to t_k+1, sub-stepped against the hinge moment
    s.route["surfaces"]()
    s.plant.write(s.surface_vector)
    s.plant.run()  # 6. the aircraft to t_k+1
