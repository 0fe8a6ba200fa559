"""What the aircraft-level detectors of [Alwi14] and [Mar10] read: input field -> name on the bus, and their delays."""

import math

from cosim.flight.blocks.sensors import TRANSPORT
from cosim.flight.plant.force_model import force_model
from cosim.scenario.aircraft import load_aircraft

SERVO = 0.07  # mean delay of the healthy elevator servos, hydraulic 75 and electromechanical 68 ms, measured [s]
RATE = math.radians(40.0)  # of the elevator servos' reference
LEARN = 8.0  # the papers' faults come at 10 s [s]
ROWS = ("force", "force+moment")  # of [Mar10]'s residuals, chosen by detectors.control_redundancy.rows
ZETA = 0.9  # of actuators.simple.actuator

_COMMANDS = {f"de_{s}": "law.law.de_cmd" for s in ("lo", "li", "ri", "ro")} | {"stab": "law.law.stab_cmd"}
_LPV = {"h": "h_inertial", "theta": "theta", "V": "tas", "q": "q", "n_z": "n_z", "alpha": "alpha", "mass": "mass",
        "cg": "cg", "cas": "cas", "mach": "mach", "phi": "phi", "p": "p", "r": "r"}  # fmt: skip
_REDUNDANCY = (
    "n_x", "n_y", "n_z", "alpha", "beta", "theta", "phi", "p", "q", "r", "cas", "tas", "mach", "mass", "cg",
    "n1_1", "n1_2", "n1_3", "n1_4", "pdot", "qdot", "rdot",
)  # fmt: skip


def _sensors(names):
    out: dict = {}
    for field, sensor in names.items():
        out |= {field: f"sensors.{sensor}.y_obs", f"{field}_valid": f"sensors.{sensor}.valid_obs"}
    return out


def lpv_smo():
    """Return {input of fdi.lpv_smo.lpv_smo: bus name}; the elevators by command, as a measured surface would hide its
    fault.
    """
    return _COMMANDS | _sensors(_LPV)


def control_redundancy():
    """Return {input of fdi.control_redundancy.control_redundancy: bus name}."""
    lateral = {"da_l": "law.law.da_cmd", "da_r": "law.law.da_cmd", "dr": "law.law.dr_cmd"}
    return _COMMANDS | lateral | _sensors({name: name for name in _REDUNDANCY})


def ticks(delay, dt):
    """Return how many ticks a sensor of `delay` seconds lags."""
    return float(math.ceil(delay / dt - 1e-9))


def lpv_smo_params(module, scenario, lane, dt):
    """Return PARAMS of fdi.lpv_smo.lpv_smo for the loop: commands as late as q is, through a lag as slow as the
    servos.
    """
    xx, yy, zz, xz = force_model().gyration2
    inertia = ((zz - xx) / yy, xz / yy)
    return module.params(delay=ticks(TRANSPORT["q"][2], dt), omega_a=1.0 / SERVO, inertia=inertia, t_learn=LEARN)


def actuator_delays(aircraft=None):
    """Return the mean delays [s] of healthy actuators: elevator, aileron, rudder, stabiliser (which creeps)."""
    own = (aircraft or load_aircraft()).surfaces
    return (SERVO, *(2.0 * ZETA / s.omega_rad_s for s in (own.aileron, own.rudder)), 0.0)


def actuator_rates(aircraft=None):
    """Return how fast [rad/s] healthy actuators follow their commands: elevator, aileron, rudder, stabiliser."""
    own = (aircraft or load_aircraft()).surfaces
    return (RATE, *(s.rate for s in (own.aileron, own.rudder, own.stabiliser)))


def control_redundancy_params(module, scenario, lane, dt, **options):
    """Return PARAMS of fdi.control_redundancy.control_redundancy for the loop, on the force model of the aircraft
    that flies.
    """
    delay = 1.0 + ticks(TRANSPORT["n_z"][2], dt)
    late, rate = actuator_delays(), actuator_rates()
    return module.params(model=force_model(), dt=dt, delay=delay, lag=late, rate=rate, **options)
