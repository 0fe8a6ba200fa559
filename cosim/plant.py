"""The aircraft in JSBSim: the only module that imports jsbsim, and the only place where feet, pounds and slugs exist.

    plant = Plant(flight, dt=0.005)
    trim = plant.trim()               steady level flight, surfaces external, time 0; raises TrimError
    plant.read(truth)                 truth at t_k, SI
    plant.write(surfaces)             surface angles, throttles and thrust losses for t_k+1
    plant.run()                       from t_k to t_k+1

Why it looks as it does (all measured): `set_dt` before `load_model`, or filters keep the step of load time; a fresh FGFDMExec per
run, as a second load crashes; every property bound once through `Port`, as JSBSim creates what is misspelt; AB2 integrators, five
times more accurate than the default; pitch rate -V/R at the start, or the curved earth drifts; load factors from this frame's
forces, as JSBSim's own are one frame old.
"""

import math
import struct
from dataclasses import dataclass, field
from pathlib import Path

import jsbsim
import numpy as np

from actuators.block import dtype, kernel
from cosim.errors import TrimError

AIRCRAFT = Path(__file__).resolve().parent.parent / "aircraft"
FT, LB, SLUG, KT = 0.3048, 4.4482216152605, 14.593902937206364, 1852.0 / 3600.0
LBSFT, PSF, G0 = LB * FT, LB / FT**2, 9.80665
SEGMENTS = ("lo", "li", "ri", "ro")

TRUTH = dtype([
    ("alpha", "f8"), ("beta", "f8"),                              # against the air [rad]
    ("p", "f8"), ("q", "f8"), ("r", "f8"),                        # body rates [rad/s]
    ("phi", "f8"), ("theta", "f8"), ("psi", "f8"),                # attitude [rad]
    ("tas", "f8"), ("cas", "f8"),                                 # [m/s]
    ("mach", "f8"),
    ("h", "f8"), ("hdot", "f8"),                                  # above mean sea level [m], [m/s]
    ("gamma", "f8"),                                              # flight-path angle [rad]
    ("nx", "f8"), ("ny", "f8"), ("nz", "f8"),                     # forces over weight, forward, right, up +; nz = 1 in level flight [-]
    ("pdot", "f8"), ("qdot", "f8"), ("rdot", "f8"),               # [rad/s2]
    ("udot", "f8"), ("vdot", "f8"), ("wdot", "f8"),               # body axes [m/s2]
    ("qbar", "f8"), ("rho", "f8"),                                # [Pa], [kg/m3]
    ("mass", "f8"), ("cg", "f8"),                                 # [kg], fraction of the mean chord
    ("lat", "f8"), ("lon", "f8"),                                 # [rad]
    ("hm0_lo", "f8"), ("hm0_li", "f8"), ("hm0_ri", "f8"), ("hm0_ro", "f8"),  # hinge moment at zero angle, + drives down [N m]
    ("hmd_lo", "f8"), ("hmd_li", "f8"), ("hmd_ri", "f8"), ("hmd_ro", "f8"),  # its slope over the segment's angle [N m/rad]
    ("n1_1", "f8"), ("n1_2", "f8"), ("n1_3", "f8"), ("n1_4", "f8"),          # fan speed [%]
    ("thrust_1", "f8"), ("thrust_2", "f8"), ("thrust_3", "f8"), ("thrust_4", "f8"),  # [N]
    ("de_lo", "f8"), ("de_li", "f8"), ("de_ri", "f8"), ("de_ro", "f8"),      # elevator segments, trailing edge down + [rad]
    ("da_l", "f8"), ("da_r", "f8"),                               # ailerons, each + rolls right [rad]
    ("dr", "f8"),                                                 # rudder, + yaws left [rad]
    ("stab", "f8"),                                               # stabiliser, trailing edge down + [rad]
    ("u", "f8"), ("v", "f8"), ("w", "f8"),                        # body velocity over the ground [m/s]
    ("wind_n", "f8"), ("wind_e", "f8"), ("wind_d", "f8"),         # wind with turbulence [m/s]
])  # fmt: skip

SURFACES = (
    "de_lo", "de_li", "de_ri", "de_ro", "da_l", "da_r", "dr", "stab",
    "throttle_1", "throttle_2", "throttle_3", "throttle_4", "thrust_loss_1", "thrust_loss_2", "thrust_loss_3", "thrust_loss_4",
)  # fmt: skip
LIMITS = {
    "elevator": (math.radians(-23.0), math.radians(17.0)),
    "stabilizer": (math.radians(-13.0), math.radians(4.0)),
    "aileron": (math.radians(-20.0), math.radians(20.0)),
    "rudder": (math.radians(-25.0), math.radians(25.0)),
}  # [rad]

# (property, factor to SI) in the order of TRUTH; nx, ny, nz still as forces, cg as a station
_READ = (
    ("aero/alpha-rad", 1), ("aero/beta-rad", 1), ("velocities/p-rad_sec", 1), ("velocities/q-rad_sec", 1), ("velocities/r-rad_sec", 1),
    ("attitude/phi-rad", 1), ("attitude/theta-rad", 1), ("attitude/psi-rad", 1), ("velocities/vt-fps", FT), ("velocities/vc-fps", FT),
    ("velocities/mach", 1), ("position/h-sl-ft", FT), ("velocities/h-dot-fps", FT), ("flight-path/gamma-rad", 1),
    ("forces/fbx-total-lbs", 1), ("forces/fby-total-lbs", 1), ("forces/fbz-total-lbs", -1),
    ("accelerations/pdot-rad_sec2", 1), ("accelerations/qdot-rad_sec2", 1), ("accelerations/rdot-rad_sec2", 1),
    ("accelerations/udot-ft_sec2", FT), ("accelerations/vdot-ft_sec2", FT), ("accelerations/wdot-ft_sec2", FT),
    ("aero/qbar-psf", PSF), ("atmosphere/rho-slugs_ft3", SLUG / FT**3), ("inertia/mass-slugs", SLUG), ("inertia/cg-x-in", 1),
    ("position/lat-geod-rad", 1), ("position/long-gc-rad", 1),
    *((f"aero/hinge-0-{s}-lbsft", LBSFT) for s in SEGMENTS), *(("aero/hinge-delta-lbsft_rad", LBSFT) for _ in SEGMENTS),
    *((f"propulsion/engine[{i}]/n1", 1) for i in range(4)), *((f"propulsion/engine[{i}]/thrust-lbs", LB) for i in range(4)),
    *((f"fcs/elevator-{s}-pos-rad", 1) for s in SEGMENTS), ("fcs/aileron-left-pos-rad", 1), ("fcs/aileron-right-pos-rad", 1),
    ("fcs/rudder-applied-rad", 1), ("fcs/stabilizer-pos-rad", 1),
    ("velocities/u-fps", FT), ("velocities/v-fps", FT), ("velocities/w-fps", FT),
    ("atmosphere/total-wind-north-fps", FT), ("atmosphere/total-wind-east-fps", FT), ("atmosphere/total-wind-down-fps", FT),
)  # fmt: skip
_WRITE = (
    *(f"ext/elevator-{s}-rad" for s in SEGMENTS), "ext/aileron-left-rad", "ext/aileron-right-rad", "ext/rudder-rad", "ext/stabilizer-rad",
    *(f"fcs/throttle-cmd-norm[{i}]" for i in range(4)), *(f"propulsion/engine[{i}]/bleed-factor" for i in range(4)),
)  # fmt: skip

CHORD_IN, QUARTER_IN = 27.31 * 12.0, 1000.0  # metrics of transport.xml
EMPTY_KG, FUEL_KG = 160000.0, 10000.0
GYRATION2 = {"xx": 85.4507, "yy": 155.4077, "zz": 233.3463, "xz": 4.55451}  # inertia over mass [m2], CR-2144 at 636,636 lb
MASS_RANGE, CG_RANGE = (180e3, 405e3), (0.20, 0.40)  # [kg], fraction: below 180 t the point masses would move too far out

# JSBSim's own scale: index of the probability of exceedance and wind at 20 ft [ft/s] (FGWinds: 3 light, 4 moderate, 6 severe)
TURBULENCE = {"none": (0, 0.0), "light": (3, 25.0), "moderate": (4, 50.0), "severe": (6, 75.0)}

jsbsim.FGJSBBase().debug_lvl = 0  # before the first executive: its banner is not ours to print


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


@dataclass(frozen=True)
class Flight:
    """One flight point and what is uncertain about it; SI, `speed` in m/s for "cas" and "tas", a number for "mach"."""

    mass: float = 200e3
    cg: float = 0.30
    altitude: float = 6096.0
    speed_kind: str = "cas"
    speed: float = 290.0 * KT
    multipliers: dict = field(default_factory=dict)  # coefficient -> factor, e.g. {"Cm_alpha": 0.9}
    turbulence: str = "none"
    seed: int = 0
    fuel_freeze: bool = True

    @classmethod
    def at(cls, mass_t, cg_pct, altitude_ft, *, cas_kt=None, mach=None, tas_kt=None, **rest):
        """Build a flight point from the units of the scenario file; exactly one speed must be given (ValueError)."""
        given = [(k, v) for k, v in (("cas", cas_kt), ("mach", mach), ("tas", tas_kt)) if v is not None]
        if len(given) != 1:
            raise ValueError("give exactly one of cas_kt, mach, tas_kt")
        kind, value = given[0]
        return cls(mass_t * 1e3, cg_pct / 100.0, altitude_ft * FT, kind, value if kind == "mach" else value * KT, **rest)


# The six points of the papers: [Sun13] section 5, [Alwi14] table 4 (CAS and altitude; its Mach agrees within 415 ft)
POINTS = {
    "sun13": Flight.at(200, 30, 20000, cas_kt=290),
    "A": Flight.at(260, 28, 12500, cas_kt=210),
    "B": Flight.at(260, 36, 12500, cas_kt=270),
    "C": Flight.at(375, 28, 27500, cas_kt=210),
    "D": Flight.at(405, 36, 27500, cas_kt=270),
    "E": Flight.at(320, 28, 20000, cas_kt=240),
}


class Port:
    """Bind JSBSim properties by name, once; an unknown name raises KeyError instead of creating a property."""

    def __init__(self, fdm):
        self._manager = fdm.get_property_manager()

    def node(self, name):
        if not self._manager.hasNode(name):
            raise KeyError(f"JSBSim has no property {name!r}")
        return self._manager.get_node(name)

    def getter(self, name):
        return self.node(name).get_double_value

    def setter(self, name):
        return self.node(name).set_double_value


def loading(mass, cg):
    """Return {property: value} of point masses and tank that give `mass` [kg], `cg` [fraction] and constant radii of gyration.

    Six equal masses stand in pairs around the centroid of the load: (+-X, 0, +-Zx), (0, +-Y, 0), (0, 0, +-Z). With w each and inertia J of the
    load about its centroid, 2 w X^2 = (Jyy + Jzz - Jxx) / 2 and so on, 2 w X Zx = Jxz; J is m k^2 less that of the empty aircraft less the
    distance between the two centroids. Raises ValueError outside MASS_RANGE and CG_RANGE.
    """
    if not MASS_RANGE[0] <= mass <= MASS_RANGE[1]:
        raise ValueError(f"mass {mass / 1e3:.1f} t; allowed {MASS_RANGE[0] / 1e3:.0f} to {MASS_RANGE[1] / 1e3:.0f} t")
    if not CG_RANGE[0] <= cg <= CG_RANGE[1]:
        raise ValueError(f"CG {cg * 100:.1f} %; allowed {CG_RANGE[0] * 100:.0f} to {CG_RANGE[1] * 100:.0f} %")
    load = mass - EMPTY_KG
    offset = (cg - 0.25) * CHORD_IN * 0.0254 * mass / load  # centroid of the load aft of 25 % [m]
    apart = EMPTY_KG * load / mass * offset**2
    J = {k: load * v for k, v in GYRATION2.items()}
    w = (load - FUEL_KG) / 6.0
    X = math.sqrt(((J["yy"] + J["zz"] - J["xx"]) / 2 - apart) / (2 * w))
    Y = math.sqrt((J["xx"] + J["zz"] - J["yy"]) / 2 / (2 * w))
    Zx = J["xz"] / (2 * w * X)
    Z = math.sqrt((J["xx"] + J["yy"] - J["zz"]) / 2 / (2 * w) - Zx**2)
    x0 = QUARTER_IN + offset / 0.0254
    out = {"propulsion/tank/contents-lbs": FUEL_KG * G0 / LB, "propulsion/tank/x-position": x0}
    # forward of the centroid is low, aft is high: a positive product of inertia in body axes
    for i, (x, y, z) in enumerate([(-X, 0, -Zx), (X, 0, Zx), (0, -Y, 0), (0, Y, 0), (0, 0, -Z), (0, 0, Z)]):
        out[f"inertia/pointmass-weight-lbs[{i}]"] = w * G0 / LB
        for axis, value in zip("XYZ", (x0 + x / 0.0254, y / 0.0254, z / 0.0254)):
            out[f"inertia/pointmass-location-{axis}-inches[{i}]"] = value
    return out


@kernel
def _to_si(raw, scale, out):
    for i in range(raw.size):
        out[i] = raw[i] * scale[i]
    weight = out[25] * 9.80665
    for i in range(14, 17):
        out[i] = out[i] * 4.4482216152605 / weight
    out[26] = 0.25 + (out[26] - 1000.0) / (27.31 * 12.0)


class Plant:
    """One flight of the transport, stepped by `run`."""

    def __init__(self, flight, dt=0.005):
        """Load the aircraft at `flight`'s mass, CG and multipliers; nothing flies before `trim` or `place`."""
        self.flight, self.dt = flight, dt
        self._logger = _Quiet()
        jsbsim.set_logger(self._logger)
        fdm = self._fdm = jsbsim.FGFDMExec(None)
        fdm.set_aircraft_path(str(AIRCRAFT))
        fdm.set_dt(dt)
        if not fdm.load_model("transport"):
            raise RuntimeError("JSBSim cannot load the aircraft: " + "; ".join(self._logger.errors))
        self.port = Port(fdm)
        self._get = [self.port.getter(name) for name, _ in _READ]
        self._set = [self.port.setter(name) for name in _WRITE]
        self._scale = np.array([factor for _, factor in _READ], float)
        self._record = self._flat = None
        self._buffer = bytearray(8 * len(_READ))
        self._raw = np.frombuffer(self._buffer)
        self._pack = struct.Struct(f"{len(_READ)}d").pack_into  # three times faster than an array from a list
        self._advance = fdm.run
        for name, value in loading(flight.mass, flight.cg).items():
            self.port.setter(name)(value)
        for name, value in flight.multipliers.items():
            self.port.setter(f"aero/mult/{name}")(value)
        self._ic = [
            self.port.setter(f"ic/{name}")
            for name in ("h-sl-ft", "psi-true-rad", "theta-rad", "phi-rad", "u-fps", "v-fps", "w-fps", "p-rad_sec", "q-rad_sec", "r-rad_sec")
        ]
        self._initialise()

    def _initialise(self):
        fdm, flight = self._fdm, self.flight
        setter = self.port.setter
        setter("ic/lat-geod-deg")(0.0)
        setter("ic/h-sl-ft")(flight.altitude / FT)
        kinds = {"cas": ("ic/vc-kts", 1 / KT), "tas": ("ic/vt-kts", 1 / KT), "mach": ("ic/mach", 1.0)}
        name, factor = kinds[flight.speed_kind]
        setter(name)(flight.speed * factor)
        setter("ic/gamma-deg")(0.0)
        setter("propulsion/set-running")(-1)
        setter("propulsion/fuel_freeze")(1.0 if flight.fuel_freeze else 0.0)
        setter("atmosphere/turb-type")(0)
        fdm.run_ic()
        for axis in ("rate/rotational", "position/rotational", "rate/translational", "position/translational"):
            setter(f"simulation/integrator/{axis}")(3)  # AB2
        self.tas = self.port.getter("velocities/vt-fps")() * FT

    def guess(self):
        """Return (alpha, stabiliser, throttle) of JSBSim's own trim, surfaces not external, or None where it finds none."""
        self.port.setter("ext/engaged")(0)
        try:
            self._fdm.do_trim(0)
        except jsbsim.TrimFailureError:
            return None
        finally:
            self._fdm.set_dt(self.dt)
        get = self.port.getter
        return get("aero/alpha-rad")(), get("fcs/stabilizer-pos-rad")(), get("fcs/throttle-cmd-norm")()

    def place(self, *, tas, alpha, theta, altitude, beta=0.0, phi=0.0, psi=0.0, p=0.0, q=0.0, r=0.0, surfaces):
        """Put the aircraft into one state with external surfaces at rest there, time 0; engines at the thrust of their throttle. SI, rad."""
        self.port.setter("ext/engaged")(1)
        self.write(surfaces)
        u = tas * math.cos(alpha) * math.cos(beta)
        v = tas * math.sin(beta)
        w = tas * math.sin(alpha) * math.cos(beta)
        for put, value in zip(self._ic, (altitude / FT, psi, theta, phi, u / FT, v / FT, w / FT, p, q, r)):
            put(value)
        self._fdm.run_ic()
        for i in range(4):  # spool speeds follow one frame late otherwise
            for name, idle in (("n1", 25.0), ("n2", 60.0)):
                self.port.setter(f"propulsion/engine[{i}]/{name}")(idle + (100.0 - idle) * surfaces[8 + i])

    def trim(self, elevator=0.0):
        """Trim level flight with the four elevators at `elevator` [rad] and stand ready at time 0. Return a Trim; raise TrimError."""
        from cosim.trim import level

        trim = level(self, elevator)
        self._engage()
        return trim

    def _engage(self):
        fdm = self._fdm
        fdm.suspend_integration()
        fdm.run()
        fdm.resume_integration()
        severity, wind = TURBULENCE[self.flight.turbulence]
        if severity:
            put = self.port.setter
            put("atmosphere/turb-type")(3)  # Milspec
            put("atmosphere/turbulence/milspec/severity")(severity)
            put("atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps")(wind)
            put("atmosphere/randomseed")(self.flight.seed)
        if abs(fdm.get_delta_t() - self.dt) > 1e-12:
            raise RuntimeError("JSBSim lost its step")

    def read(self, record):
        """Write the truth at t_k into `record`, a record or a (1,) array of TRUTH; nx, ny, nz are this frame's forces over weight."""
        if record is not self._record:
            self._record, self._flat = record, np.asarray(record).reshape(1).view("f8")
        self._pack(self._buffer, 0, *[get() for get in self._get])
        _to_si(self._raw, self._scale, self._flat)

    def write(self, surfaces):
        """Set the inputs that act at t_k+1: a vector in the order of SURFACES, rad and fractions."""
        for put, value in zip(self._set, surfaces.tolist()):
            put(value)

    def run(self):
        """Advance by one step."""
        self._advance()

    def truth(self):
        """Return a new (1,) TRUTH array of the present state."""
        out = np.zeros(1, TRUTH)
        self.read(out)
        return out

    @property
    def errors(self):
        """Return what JSBSim reported as an error."""
        return list(self._logger.errors)


_REFERENCE_LOGGER = _Quiet()  # kept here: JSBSim does not own it


def reference_run(dt=0.005):
    """Return the step function of the B747 that the jsbsim wheel ships, flying at 20,000 ft: yardstick of `cosim bench`."""
    jsbsim.set_logger(_REFERENCE_LOGGER)
    fdm = jsbsim.FGFDMExec(None)
    fdm.set_dt(dt)
    if not fdm.load_model("B747"):
        raise RuntimeError("the jsbsim wheel has no B747")
    fdm.disable_output()
    port = Port(fdm)
    start = {"ic/h-sl-ft": 20000.0, "ic/vc-kts": 290.0, "ic/gamma-deg": 0.0, "propulsion/set-running": -1}
    for name, value in start.items():
        port.setter(name)(value)
    fdm.run_ic()
    return fdm.run


__all__ = ["LIMITS", "POINTS", "SURFACES", "TRUTH", "Flight", "Plant", "Port", "TrimError", "loading", "reference_run"]
