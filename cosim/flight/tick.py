"""One tick of the lockstep: read this first.

Everything of a tick is in one vector (cosim/flight/loop/bus.py). Each block below reads its own inputs there and leaves
its state there; between blocks, wires copy (cosim/flight/loop/wiring.py). JSBSim is at t_k when the tick begins and at
t_k+1 when it ends. `order` says once what every tick does; its tape does it without Python between the blocks
(cosim/flight/loop/tape.py).
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cosim.flight.blocks.noise import Draw
from cosim.flight.loop.bus import Bus
from cosim.flight.loop.tape import Block, Tape
from cosim.flight.plant.plant import Plant


def order(s: "Loop", *logs: Any, keep: Any = None) -> Tape:
    """Return the tape of what a tick of the loop `s` does from t_k to t_k+1.

    Each of `logs` takes the bus as it stands at t_k: a call `log(v)`, or a log that tells the tape itself. `keep` is
    (positions, rows): row k % len(rows) takes what stands there when the actuators have moved.
    """
    tape = Tape(s.v, s.dt)
    s.plant.schedule_outputs(tape, s.bus.index("truth.aircraft.alpha"))  # 1. truth at t_k: alpha is its first number
    tape.clock(s.bus.index("clock.clock.t"))

    tape.copy(*s.wires["faults"])
    tape.step(s.faults)
    tape.add(*s.places)  # what is injected at t_k, and where

    s.draw.schedule(tape, s.noise)
    tape.copy(*s.wires["sensors"])
    tape.step(s.sensors)  # 2. measurements

    tape.copy(*s.wires["law"])
    tape.call(*s.corrections.get("law", ()))
    tape.step(s.pilot)
    tape.table(*s.inputs.get("pilot", ()))
    tape.copy(*s.wires["demand"])
    tape.step(s.law)  # 3. control law on measurements
    tape.table(*s.inputs.get("law", ()))
    tape.call(*s.corrections.get("commands", ()))

    tape.copy(*s.wires["hinge"])
    tape.step(s.hinge)
    for detector in s.detectors:  # 4. detectors on measurements and commands at t_k, on what the servos sent until now,
        tape.copy(*s.wires[detector.name])  # and on outputs at t_k of detectors before it
        tape.step(detector)

    tape.copy(*s.wires["servos"])
    for servo in s.servos:
        tape.step(servo)  # 5. servo loops on t_k data, perhaps on a detector's estimate; held over the tick

    for log in filter(None, logs):
        log.schedule(tape) if hasattr(log, "schedule") else tape.call(lambda k, log=log: log(s.v))

    tape.copy(*s.wires["actuators"])
    tape.call(*s.corrections.get("actuators", ()))
    for actuator in s.actuators:
        tape.step(actuator)  # to t_k+1, sub-stepped against the hinge moment
    tape.copy(*s.wires["surfaces"])
    if keep is not None:
        tape.keep(*keep)
    s.plant.schedule_inputs(tape, s.bus.index(f"surfaces.aircraft.{s.plant.border.inputs[0]}"))
    s.plant.schedule_integration(tape)  # 6. the aircraft to t_k+1, through its gusts
    return tape


@dataclass
class Loop:
    """What one tick needs: the bus, the plant, the blocks in their order, the wires between them."""

    bus: Bus
    plant: Plant
    dt: float
    draw: Draw  # the noise
    wires: dict  # stage, or detector -> (to, source), positions in the bus
    places: tuple  # (clear, to, source): where faults act
    faults: Block
    sensors: Block
    pilot: Block
    law: Block
    hinge: Block
    detectors: list = field(default_factory=list)
    servos: list = field(default_factory=list)
    actuators: list = field(default_factory=list)
    corrections: dict = field(default_factory=dict)  # stage -> calls after it (cosim/flight/blocks/corrections.py)
    inputs: dict = field(default_factory=dict)  # stage -> a pilot's own table (cosim/flight/user_inputs.py)

    def __post_init__(self):
        self.v = self.bus.v
        self.truth = self.bus["truth"][0]
        self.noise = np.array([self.bus.index(f"sensors_in.{lane}.noise") for lane in self.bus.lanes["sensors"]])
