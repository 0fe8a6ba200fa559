"""The aircraft in JSBSim: the only module that imports jsbsim, and the only place where feet, pounds and slugs exist.

    plant = Plant(flight, dt=0.005)
    trim = plant.trim()               steady flight, surfaces external, time 0; raises TrimError
    plant.truth()                     truth at t_k, SI
    plant.write(surfaces)             surface angles, throttles and thrust losses for t_k+1
    plant.run()                       from t_k to t_k+1

Why it looks as it does (all measured): `set_dt` before `load_model`, or filters keep the step of load time; a fresh
FGFDMExec per run, as a second load crashes; every property bound once through `Port`, as JSBSim creates what is
misspelt; AB2 integrators, five times more accurate than the default; pitch rate -V/R at the start, or the curved earth
drifts; load factors from this frame's forces, as JSBSim's own are one frame old.
"""

import ctypes
import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import jsbsim
import numpy as np

from actuators.constants import G0, M_PER_FT, M_S_PER_KT, N_PER_LBF
from cosim.errors import ScenarioError
from cosim.flight.loop.tape import Tape
from cosim.flight.plant import gusts
from cosim.flight.plant.jsbsim_signals import border, last_step
from cosim.flight.plant.model_load_check import fatal
from cosim.flight.plant.point import POINTS, FlightPoint, loading
from cosim.flight.plant.properties import NODE, Properties, exported
from cosim.flight.plant.trim import EARTH_MERIDIAN, Trim, trim
from cosim.scenario.aircraft import FOLDER

WIND_SHARE = 0.8  # of the airspeed that a steady wind may have: the aircraft moves over the ground

jsbsim.FGJSBBase().debug_lvl = 0  # before the first executive: its banner is not ours to print


class Port:
    """Bind JSBSim properties by name, once; an unknown name raises KeyError instead of creating a property."""

    def __init__(self, fdm: Any):
        self._manager = fdm.get_property_manager()

    def node(self, name: str) -> Any:
        """Return JSBSim's node of property `name`; raises KeyError for one that there is not."""
        if not self._manager.hasNode(name):
            raise KeyError(f"JSBSim has no property {name!r}")
        return self._manager.get_node(name)

    def row(self, units: Iterable[tuple[str, float]]) -> Properties:
        """Return the Properties of (name, unit in SI)."""
        names, factors = zip(*units)
        return Properties([self.node(name) for name in names], factors)

    def get(self, name: str) -> float:
        """Return the value of property `name`, in JSBSim's unit."""
        return self.node(name).get_double_value()

    def set(self, name: str, value: float) -> None:
        """Set property `name`, in JSBSim's unit."""
        self.node(name).set_double_value(value)


class _Quiet(jsbsim.FGLogger):
    """Keep JSBSim's messages off the console and remember the serious ones."""

    def __init__(self):
        super().__init__()
        self.errors, self._level, self._text = [], None, ""

    def set_level(self, level):
        self._level, self._text = level, ""

    def message(self, text):
        self._text += text

    def flush(self):
        if self._level in (jsbsim.LogLevel.ERROR, jsbsim.LogLevel.FATAL):
            self.errors.append(" ".join(self._text.split()))

    def file_location(self, filename, line):
        self._text += f"{filename}:{line} "


class Plant:
    """One flight of an aircraft, stepped by `run`."""

    def __init__(self, flight: FlightPoint, dt: float = 0.005):
        """Load the aircraft at `flight`'s mass, CG and multipliers; nothing flies before `trim` or `place`."""
        self.flight, self.dt, self.aircraft = flight, dt, flight.record
        self._logger = _Quiet()
        try:
            self._load(flight, dt)
        except (RuntimeError, KeyError, ValueError) as error:
            said = " ".join([*self._logger.errors, str(error.args[0] if error.args else error)])
            place = str(self.aircraft.folder / f"{self.aircraft.name}.xml")
            raise ScenarioError(f"JSBSim cannot fly the model: {said}", place=place) from None

    def _load(self, flight, dt):
        if self.aircraft.folder.parent != FOLDER and (said := fatal(self.aircraft.folder, self.aircraft.name)):
            raise RuntimeError(said)
        self.border = border(self.aircraft)
        geometry = self.aircraft.geometry
        self._fdm = _executive(self.aircraft.folder, self.aircraft.name, dt, self._logger)
        self.port = Port(self._fdm)
        self.outputs = self.port.row(self.border.read)
        self.inputs = self.port.row((name, 1.0) for name in self.border.controls.values())
        self._frame = np.array([geometry.reference_pct / 100.0, geometry.station_in, 12.0 * geometry.chord_ft])
        self._air: gusts.Gusts | None = None
        multipliers = {f"aero/mult/{name}": value for name, value in flight.multipliers.items()}
        for name, value in (loading(self.aircraft, flight.mass, flight.cg) | multipliers).items():
            self.port.set(name, value)
        self._start = self.port.row(_START)
        self._initialise()
        mass = self.port.get("inertia/weight-lbs") * N_PER_LBF / G0
        if abs(mass - flight.mass) > 1e-3 * flight.mass:
            said = f"it weighs {mass / 1e3:.1f} t where the record asks for {flight.mass / 1e3:.1f} t"
            raise ValueError(f"{said}: its empty mass is not mass.empty_t")

    def _initialise(self):
        kinds = {"cas": ("ic/vc-kts", 1 / M_S_PER_KT), "tas": ("ic/vt-kts", 1 / M_S_PER_KT), "mach": ("ic/mach", 1.0)}
        speed, factor = kinds[self.flight.speed_kind]
        start = {
            "ic/lat-geod-deg": 0.0, "ic/h-sl-ft": self.flight.altitude / M_PER_FT, speed: self.flight.speed * factor,
            "ic/gamma-deg": 0.0, "propulsion/set-running": -1, "atmosphere/turb-type": 0,
            "propulsion/fuel_freeze": 1.0,  # the mass does not change in flight
        }  # fmt: skip
        for name, value in start.items():
            self.port.set(name, value)
        self._fdm.run_ic()
        for axis in ("rate/rotational", "position/rotational", "rate/translational", "position/translational"):
            self.port.set(f"simulation/integrator/{axis}", 3)  # AB2
        self.tas = self.port.get("velocities/vt-fps") * M_PER_FT

    def guess(self) -> tuple[float, float, float] | None:
        """Return (alpha, stabiliser, throttle) of JSBSim's own trim, surfaces not external; None where it has none."""
        self.port.set("ext/engaged", 0)
        try:
            self._fdm.do_trim(0)
        except jsbsim.TrimFailureError:
            return None
        finally:
            self._fdm.set_dt(self.dt)
        get = self.port.get
        return get("aero/alpha-rad"), get("fcs/stabilizer-pos-rad"), get("fcs/throttle-cmd-norm")

    def place(
        self, *, tas: float, alpha: float, theta: float, altitude: float, surfaces: np.ndarray, beta: float = 0.0,
        phi: float = 0.0, psi: float = 0.0, p: float = 0.0, q: float = 0.0, r: float = 0.0,
        wind: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:  # fmt: skip
        """Put the aircraft into one state at time 0, surfaces external, engines at their throttle's thrust; SI, rad.

        Speed and angles are against the air, which moves with `wind` over the ground, forward, right and down in body
        axes.
        """
        self.port.set("ext/engaged", 1)
        self.write(surfaces)
        u = tas * math.cos(alpha) * math.cos(beta) + wind[0]
        v = tas * math.sin(beta) + wind[1]
        w = tas * math.sin(alpha) * math.cos(beta) + wind[2]
        self._start.write(np.array([altitude, psi, theta, phi, u, v, w, p, q, r]))
        self._fdm.run_ic()
        throttles = self.border.column(self.border.throttles)
        for i, at in enumerate(throttles):  # spool speeds follow one frame late otherwise
            for name, idle in (("n1", 25.0), ("n2", 60.0)):
                self.port.set(f"propulsion/engine[{i}]/{name}", idle + (100.0 - idle) * surfaces[at])

    def trim(self) -> Trim:
        """Trim the flight point and stand ready at time 0: a Trim, or TrimError."""
        found = trim(self)
        if dataclasses.replace(self.flight, seed=0) != self.flight.calm:  # there is turbulence, wind or a gust
            self._into_the_air(found)
        self._fdm.suspend_integration()  # a frame without motion, after which every model has the state
        self._fdm.run()
        self._fdm.resume_integration()
        return found

    def _into_the_air(self, trim):
        """Let the air move, and put the trimmed aircraft into it: trim is against the air."""
        f, geometry = self.flight, self.aircraft.geometry
        p = gusts.params(
            f.turbulence, self.dt, span=geometry.span_ft * M_PER_FT, tail_arm=geometry.tail_arm_ft * M_PER_FT,
            downwash=geometry.downwash, changes=f.changes, wind=f.wind, shear=f.shear, altitude=f.altitude,
            gusts=f.gusts,
        )  # fmt: skip
        self._air = gusts.Gusts(p, self.dt, f.seed)
        self._met, self._moved = self.port.row(_MET), self.port.row(MOVED)
        if not any(f.wind):
            return
        if math.hypot(*f.wind) > WIND_SHARE * trim.tas:
            blows, flies = math.hypot(*f.wind) / M_S_PER_KT, trim.tas / M_S_PER_KT
            raise ScenarioError(
                f"the wind is {blows:.0f} kt, the aircraft flies at {flies:.0f} kt", place="flight.wind_kt",
                allowed=f"at most {WIND_SHARE * flies:.0f} kt at this flight point",
                remedy="Lower the wind or fly faster",
            )  # fmt: skip
        self._moved.write(self._air.moved)
        (north, east), far = f.wind, EARTH_MERIDIAN + trim.altitude
        cf, sf, ct, st = math.cos(trim.phi), math.sin(trim.phi), math.cos(trim.theta), math.sin(trim.theta)
        wind = ct * north, sf * st * north + cf * east, cf * st * north - sf * east
        over, along = east / far, -north / far  # the horizon turns as the air moves over the curved earth
        self.place(
            tas=trim.tas, alpha=trim.alpha, theta=trim.theta, phi=trim.phi, altitude=trim.altitude,
            p=trim.p + ct * over, q=trim.q + sf * st * over + cf * along, r=trim.r + cf * st * over - sf * along,
            surfaces=trim.surfaces, wind=wind,
        )  # fmt: skip

    def truth(self) -> np.ndarray:
        """Return a new (1,) array of the truth, SI, of the present state."""
        out = np.zeros(1, self.border.truth)
        numbers = out.view("f8")
        self.outputs.read(numbers)
        last_step(numbers, len(numbers), *self._frame)
        return out

    def schedule_outputs(self, tape: Any, start: int) -> None:
        """Schedule on a tape to put the truth at t_k into the bus from position `start` on."""
        out = tape.v[start : start + len(self.border.read)]
        self.outputs.schedule_read(tape, out)
        tape.truth(out, self._frame)

    def schedule_inputs(self, tape: Any, start: int) -> None:
        """Schedule on a tape to set the inputs that act at t_k+1 from the bus from position `start` on."""
        self.inputs.schedule_write(tape, tape.v[start : start + len(self.border.inputs)])

    def schedule_integration(self, tape: Any) -> None:
        """Schedule on a tape that begins at tick 0 to advance by one step, through this flight's gusts."""
        if self._air:
            self._met.schedule_read(tape, self._air.met)
            self._air.schedule(tape)
            self._moved.schedule_write(tape, self._air.moved)
        advance = self._fdm.run
        tape.call(lambda k: advance())

    def write(self, surfaces: np.ndarray) -> None:
        """Set the inputs that act at t_k+1: a vector in the order of the border's inputs, rad and fractions."""
        self.inputs.write(surfaces)

    @functools.cached_property
    def run(self) -> Callable[[], None]:
        """Return the call that advances by one step, through this flight's gusts."""
        tape, ticks = Tape(np.zeros(1), self.dt), itertools.count()
        self.schedule_integration(tape)
        return lambda: tape.run(next(ticks))


_START = (("ic/h-sl-ft", M_PER_FT), ("ic/psi-true-rad", 1.0), ("ic/theta-rad", 1.0), ("ic/phi-rad", 1.0),
          *((f"ic/{axis}-fps", M_PER_FT) for axis in "uvw"),
          *((f"ic/{rate}-rad_sec", 1.0) for rate in "pqr"))  # fmt: skip
_MET = (("velocities/vt-fps", M_PER_FT), ("attitude/phi-rad", 1.0), ("attitude/theta-rad", 1.0),
        ("attitude/psi-rad", 1.0), ("position/h-sl-ft", M_PER_FT))  # fmt: skip
MOVED = (*((f"atmosphere/gust-{axis}-fps", M_PER_FT) for axis in ("north", "east", "down")),
         *((f"ext/gust-{rate}-rad_sec", 1.0) for rate in "pqr"))  # fmt: skip


def verify(ticks: int = 300) -> bool:
    """Tell whether the properties of a flight have the same bits by address as by Python's calls.

    A wrong address may end this process: call it in one of its own.
    """
    plant, found = Plant(FlightPoint()), exported()
    kind = type(plant.inputs.nodes[0])
    if found is None or kind.__dictoffset__ or kind.__basicsize__ not in NODE:
        return False
    get = ctypes.PYFUNCTYPE(ctypes.c_double, ctypes.c_void_p)(found.get)
    put = ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, ctypes.c_double)(found.put)
    trim, moved = plant.trim(), plant.port.row(MOVED)
    nodes, into = plant.inputs.nodes + moved.nodes, [*plant.inputs.addresses().tolist(), *moved.addresses().tolist()]
    start = np.concatenate([trim.surfaces, np.ones(len(MOVED))])
    for k in range(ticks):
        given = (start * (1.0 + 0.02 * np.sin(0.05 * k + np.arange(len(start))))).tolist()
        for address, value in zip(into, given):
            put(address, value)
        if [node.get_double_value() for node in nodes] != given:
            return False
        plant.run()
        by_address = np.array([get(address) for address in plant.outputs.addresses().tolist()])
        if by_address.tobytes() != np.array([node.get_double_value() for node in plant.outputs.nodes]).tobytes():
            return False
    return True


def bare_model(path: Path, dt: float, start: dict[str, float]) -> tuple[Callable[[], bool], Port]:
    """Return (step, Port) of a bare JSBSim model at `path`, from `start`: {property: value in the unit of JSBSim}.

    A path without folders is a model that the jsbsim wheel ships. Raises RuntimeError when JSBSim cannot load it.
    """
    fdm = _executive(path.parent if path.parent.name else None, path.stem, dt, _REFERENCE_LOGGER)
    port = Port(fdm)
    for name, value in start.items():
        port.set(name, value)
    fdm.run_ic()
    return fdm.run, port


def _executive(folder, name, dt, logger):
    """Return JSBSim's executive of the model `name` in a folder, None: that of the wheel; raises RuntimeError."""
    jsbsim.set_logger(logger)
    fdm = jsbsim.FGFDMExec(None)
    if folder:
        fdm.set_aircraft_path(str(folder.parent))
    fdm.set_dt(dt)
    fdm.disable_output()
    if not fdm.load_model(name):
        raise RuntimeError(f"JSBSim cannot load {name}: {'; '.join(logger.errors)}")
    return fdm


_REFERENCE_LOGGER = _Quiet()  # kept here: JSBSim does not own it

__all__ = ["POINTS", "FlightPoint", "Plant", "Port", "bare_model"]
