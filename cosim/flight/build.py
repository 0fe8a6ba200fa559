"""Build a flight from its scenario: trim the aircraft, lay out the bus, put every block into equilibrium, wire them."""

import math
from dataclasses import dataclass, replace

import numpy as np

from actuators.block import dtype
from cosim.errors import ScenarioError
from cosim.flight import user_law
from cosim.flight.blocks import actuation, faults, hinge_model, manoeuvre, sensors
from cosim.flight.blocks.corrections import corrections
from cosim.flight.blocks.noise import Draw, generator
from cosim.flight.blocks.pilot import steps
from cosim.flight.blocks.servo_gain import SENSOR_DELAY
from cosim.flight.detection import detectors
from cosim.flight.detection.detectors import Installed, cost
from cosim.flight.faults import inject
from cosim.flight.loop import wiring
from cosim.flight.loop.bus import Bus
from cosim.flight.loop.compiling import prepare
from cosim.flight.loop.trace import Trace
from cosim.flight.plant.operating_point import designed
from cosim.flight.plant.plant import Plant
from cosim.flight.plant.point import FlightPoint
from cosim.flight.plant.trim import Trim
from cosim.flight.tick import Block, Loop
from cosim.flight.user_inputs import user_inputs
from cosim.judge.detection import JudgedLane
from cosim.parts import rollout_of
from cosim.scenario import Scenario
from cosim.scenario.catalog import TECHNOLOGIES
from cosim.scenario.elevator import register
from cosim.scenario.user_parts import identified

CLOCK = dtype([("t", "f8", "s")])


@dataclass
class Setup:
    """A flight ready to fly, and what its log and its result need."""

    scenario: Scenario
    loop: Loop
    trim: Trim
    lanes: list  # fault lanes
    detectors: list[Installed]
    trace: Trace  # what a run keeps of every tick

    @property
    def notes(self) -> list[str]:
        """Return a sentence per user's detector or law that was dropped, or whose answer was not used."""
        return [line for block in (self.loop.law, *self.loop.detectors) for line in getattr(block.rollout, "notes", ())]

    def judged_lanes(self, timed: bool = False) -> list[JudgedLane]:
        """Return the JudgedLane of every detector lane; `timed`, with the microseconds of its step."""
        step_us = {d.name: cost(d) for d in self.loop.detectors} if timed else {}
        return [replace(lane, step_us=step_us.get(lane.id, math.nan)) for lane in self.trace.lanes]


def _sensor_lanes(scenario, dt):
    """Return (lane names, PARAMS) of all sensors; constant errors of actuator sensors are drawn once."""
    scale, root = scenario.sensors.noise_scale, math.sqrt(0.005 / dt)  # sigma is per 5 ms sample
    names, rows = [], []

    def add(lane, base, sigma, delay, bias=0.0, gain=1.0, tech=None):
        s = scenario.sensors.setting(base, lambda unit: inject.own_unit(unit, base, tech, scenario.aircraft))
        sigma = s.get("sigma", scale * root * sigma)
        p = np.zeros(1, sensors.PARAMS)
        p["sigma"], p["bias"], p["scale"] = sigma, s.get("bias", bias), s.get("scale", 0.0)
        late = s.get("delay", delay)
        p["delay"] = round(late / dt)
        if p["delay"][0] >= sensors.DELAY_MAX:
            raise ScenarioError(
                f"a delay of {late:g} s is {p['delay'][0]:.0f} ticks", place=f"sensors.{base}.delay_s",
                allowed=f"below {sensors.DELAY_MAX * dt:g} s at {1 / dt:g} Hz", remedy="Lower delay_s or rate_hz",
            )  # fmt: skip
        p["quantum"], p["gain"] = s.get("quantum", 0.0), gain
        names.append(lane)
        rows.append(p)

    for name, (_, sigma, delay, _) in sensors.installed(scenario.aircraft).items():
        add(name, name, sigma, delay)
    for seg, tech in scenario.elevator.technology.items():
        gains = TECHNOLOGIES[tech].design(scenario.aircraft.own(tech)).gains
        for name, sensor in TECHNOLOGIES[tech].sensors.items():
            lane = f"{seg}_{name}"
            bias = scale * sensor.spread * generator(scenario.seed, f"bias.{lane}").uniform(-1.0, 1.0)
            add(lane, name, sensor.sigma, SENSOR_DELAY, bias=bias, gain=gains.get(name, 1.0), tech=tech)
    return tuple(names), np.concatenate(rows)


def _parts(scenario, trim, truth, designed, fault_lanes, chosen):
    """Return [(name, module, lanes, PARAMS, STATE before the first tick, ticks from step to step where not 1)] of the
    blocks of a flight; `designed` is what the operating point gives."""
    dt, aircraft, technology = scenario.dt, scenario.aircraft, scenario.elevator.technology
    law_p, slopes = designed
    factors = [1.0 + TECHNOLOGIES[tech].hinge_error * generator(scenario.seed, f"hinge.{seg}").uniform(-1.0, 1.0)
               for seg, tech in technology.items()]  # fmt: skip
    own = [
        ("sensors", sensors, *_sensor_lanes(scenario, dt)),
        ("pilot", manoeuvre, ("pilot",), manoeuvre.params(**steps(scenario.manoeuvre, trim))),
        ("law", user_law.block(scenario), ("law",), user_law.tuned(scenario, law_p)),
        ("hinge_model", hinge_model, tuple(aircraft.segments),
         hinge_model.design(slopes, trim, truth, aircraft.short.values(), factors)),
        ("faults", faults, tuple(lane.name for lane in fault_lanes),
         np.concatenate([np.zeros(0, faults.PARAMS), *(lane.p for lane in fault_lanes)])),
        *((d.id, d.module, d.lanes, d.params(scenario, dt), d.record.every) for d in chosen),
    ]  # fmt: skip
    loads = {seg: (truth[f"de_{s}"], truth[f"hm0_{s}"], truth[f"hmd_{s}"]) for seg, s in aircraft.short.items()}
    others = {name: truth[wiring.SURFACE_OF[name]] for name in wiring.OTHERS}
    made = [(name, module, lanes, p, module.init(p), *every) for name, module, lanes, p, *every in own]
    return [*made, *actuation.blocks(scenario, loads, others, dt)]


def _wires(scenario, bus, chosen, fault_lanes):
    """Return {stage of the tick: (to, source)}, positions in the bus."""
    stages = wiring.wires(scenario)
    stages["servos"] += detectors.feedback_wires(scenario, chosen)
    stages |= {d.id: d.wires() for d in chosen}
    stages["faults"] = [
        *((f"faults_in.{lane.name}.t", "clock.clock.t") for lane in fault_lanes),
        *((f"faults_in.{lane.name}.ref", lane.reference) for lane in fault_lanes if lane.reference),
    ]
    return {stage: bus.wires(pairs) for stage, pairs in stages.items()}


def build(scenario: Scenario) -> Setup:
    """Return the Setup of `scenario`. Raises TrimError when the flight point cannot be flown."""
    scenario = identified(scenario)
    register(scenario.actuators)  # another scenario may have brought others of the same names
    prepare(scenario)
    dt, point = scenario.dt, FlightPoint.of(scenario)
    plant = Plant(point, dt=dt)
    trim = plant.trim()
    truth, border = plant.truth(), plant.border
    chosen, fault_lanes = detectors.chosen(scenario), inject.lanes(scenario)
    parts = _parts(scenario, trim, truth[0], designed(point, trim, dt), fault_lanes, chosen)

    surface = dtype([(name, "f8", "-" if name.startswith("thr") else "rad") for name in border.inputs])
    whole = [("clock", CLOCK, ("clock",)), ("truth", border.truth, ("aircraft",)), ("surfaces", surface, ("aircraft",))]
    for name, module, lanes, *_ in parts:
        whole += [(f"{name}_in", module.INPUTS, lanes), (name, module.STATE, lanes)]
    bus = Bus(whole)
    bus["truth"][:] = truth
    bus["surfaces"].view("f8")[:] = trim.surfaces  # until the first tick sends its own
    blocks = {name: Block(bus, name, module, p, x0, dt, rollout_of(module, lanes, limited=True), *every)
              for name, module, lanes, p, x0, *every in parts}  # fmt: skip
    wires = _wires(scenario, bus, chosen, fault_lanes)
    places = [(to, f"faults.{lane.name}.{source}") for lane in fault_lanes for to, source in lane.places]
    to, source = bus.wires(places)
    servos = [technology.servo for technology in TECHNOLOGIES.values()]
    loop = Loop(
        bus=bus, plant=plant, dt=dt, draw=Draw(scenario.seed, [f"noise.{lane}" for lane in bus.lanes["sensors"]]),
        wires=wires, places=(np.unique(to), to, source), faults=blocks["faults"], sensors=blocks["sensors"],
        pilot=blocks["pilot"], law=blocks["law"], hinge=blocks["hinge_model"],
        detectors=[blocks[d.id] for d in chosen], servos=[b for name, b in blocks.items() if name in servos],
        actuators=[b for name, b in blocks.items() if name in TECHNOLOGIES],
        corrections=corrections(scenario, bus), inputs=user_inputs(scenario, bus, trim),
    )  # fmt: skip
    # what the actuators were last told: in equilibrium, the servo's holding command
    told, command = wires["actuators"]
    bus.v[told] = bus.v[command]
    return Setup(scenario, loop, trim, fault_lanes, chosen, Trace(scenario, bus, chosen))
