"""What a scenario can name: parts, sensors with their units, and every kind of fault with its parameters.

These tables are the only place where that is written: validation, `cosim list`, messages and conversion read them.
"""

import functools
import inspect
import math
import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from actuators.constants import M_PER_FT, M_S_PER_KT, RAD_PER_DEG
from actuators.registry import SHIPPED
from actuators.technology import ARM_DEG, LOSS, MM, SURFACE_DEG, Key, Kind, Technology, Unit
from cosim.scenario.aircraft import load_aircraft, multipliers

_TRANSPORT = load_aircraft()
SEGMENTS = _TRANSPORT.segments  # of the default aircraft
FEEDBACKS = ("measured", "iotsekf", "rtsekf", "rtsekf_flight")
DEFAULT_TECHNOLOGY: dict[str, Any] = _TRANSPORT.technology
SURFACES = ("aileron.left", "aileron.right", "rudder", "stabiliser")


SENSORS = {  # aircraft sensor -> units of its faults and settings; the first one is its own
    **dict.fromkeys(("alpha", "beta", "phi", "theta", "psi", "alpha_ground"), (SURFACE_DEG,)),
    **dict.fromkeys(("p", "q", "r"), (Unit("deg_s", RAD_PER_DEG, "rad/s", 90.0),)),
    **dict.fromkeys(("pdot", "qdot", "rdot"), (Unit("deg_s2", RAD_PER_DEG, "rad/s2", 90.0),)),
    **dict.fromkeys(("cas", "tas"), (Unit("kt", M_S_PER_KT, "m/s", 200.0),)),
    "mach": (Unit("mach", 1.0, "-", 0.5),),
    **dict.fromkeys(("h_baro", "h_inertial"), (Unit("m", 1.0, "m", 5000.0), Unit("ft", M_PER_FT, "m", 15000.0))),
    **dict.fromkeys(("hdot", "v_ground"), (Unit("m_s", 1.0, "m/s", 100.0), Unit("ft_s", M_PER_FT, "m/s", 300.0))),
    **dict.fromkeys(("n_x", "n_y", "n_z"), (Unit("g", 1.0, "g", 5.0),)),
    **dict.fromkeys(("n1_1", "n1_2", "n1_3", "n1_4"), (Unit("pct", 1.0, "%", 100.0),)),
    "mass": (Unit("t", 1000.0, "kg", 100.0),),
    "cg": (Unit("pct", 0.01, "-", 20.0),),
}
FREQUENCY = Key("frequency_hz", 0.01, 25.0, 2 * math.pi, "rad/s")
SHAPES = ("sine", "square", "triangle", "chirp")  # of an oscillation; the first is the default
SWEEP = Key("chirp_hz_s", -10.0, 10.0, 2 * math.pi, "rad/s2", healthy=0.0)  # of a chirp
_sine = (FREQUENCY, Key("phase_deg", -360.0, 360.0, RAD_PER_DEG, "rad", default=0.0))


def _keys(stem: str, units: Iterable[Unit], tail: str = "", *, signed: bool = True, open_low: bool = True):
    """Return the Key of a number in each of `units`: of either sign but 0, or (`open_low`: above) 0 and up."""
    more: dict[str, Any] = {"healthy": 0.0} if signed else {"open_low": open_low}
    per = "/s" if tail else ""
    return tuple(Key(f"{stem}_{u.suffix}{tail}", -u.limit if signed else 0.0, u.limit, u.factor, u.si + per, **more)
                 for u in units)  # fmt: skip


def _rod(mm: float, deg: float) -> tuple[Unit, Unit]:
    """Return the units of a position up to `mm` of rod, or the surface angle `deg` that it stands for."""
    return replace(MM, limit=mm), replace(ARM_DEG, limit=deg)


def _amplitudes(open_low):
    return (
        Key("amplitude", 0.0, 1.0, 1.0, "u", open_low),
        *_keys("amplitude", _rod(120.0, 20.0), signed=False, open_low=open_low),
        Key("amplitude_travel", 0.0, 0.5, 1.0, "of travel", open_low),  # of the elevator's [Sun13]
    )


AMPLITUDES_AT = {  # the keys that have a meaning where the oscillation enters
    "valve": ("amplitude", "amplitude_mm"),
    "command": ("amplitude_mm", "amplitude_deg", "amplitude_travel"),
    "sensor": ("amplitude_mm", "amplitude_deg", "amplitude_travel"),
}

# an actuator moves as fast as its valve or drive lets it: 45 deg/s without load, more with the load behind it
_runaway = (Key("rate_deg_s", -60.0, 60.0, RAD_PER_DEG, "rad/s", healthy=0.0),)
# What every elevator actuator can suffer, as far as it has what the kind needs; a technology's record adds its own
_COMMON = {
    "ofc_liquid": Kind("oscillation added to the signal", _amplitudes(True), _sine, ("valve", "command", "sensor")),
    "ofc_solid": Kind("oscillation in place of the signal", _amplitudes(False), _sine, ("valve", "command"),
                      exclusive="at"),
    "bias": Kind("constant added to the position command", _keys("bias", _rod(120.0, 20.0)), at=("command",)),
    "jam_liquid": Kind("bias on the position sensor that closes the loop (the same as bias on it)",
                       _keys("bias", _rod(150.0, 40.0))),
    "jam_solid": Kind("the surface stops where it is", switched=True, exclusive="motion"),
    "runaway": Kind(
        "the surface drives off, to its stop or to limit_deg; to a limit, and without a valve, the command runs",
        _runaway, at=("valve", "command"), exclusive="at"),
    "loss_of_effectiveness": Kind(
        "the surface gives only a part of what is commanded; at the valve or drive the servo makes up for it as it can",
        LOSS, at=("command", "valve"), exclusive="at"),
    "free_float": Kind("the actuator lets go, the surface trails", switched=True, exclusive="motion"),
    "friction": Kind("added Coulomb friction, share of the stall force",
                     (Key("friction_pct", 0.0, 100.0, 0.01, "fraction", open_low=True),), exclusive="friction"),
    "backlash": Kind("play between actuator and surface, full width", _keys("backlash", _rod(20.0, 4.0), signed=False),
                     exclusive="backlash"),
}  # fmt: skip
SURFACE_KINDS = {
    "jam": Kind("the surface stops where it is", switched=True, exclusive="motion"),
    "runaway": Kind("the surface drives off, to its stop or to limit_deg", _runaway, exclusive="motion"),
}
ENGINE_KINDS = {"thrust_loss": Kind("thrust falls by a share", LOSS, exclusive="thrust")}


# -- the technologies that are registered, and what follows from them
_ALWAYS = ("ofc_liquid", "ofc_solid", "bias", "runaway")  # they enter with a command

TECHNOLOGIES: dict[str, Technology] = {}
ACTUATOR_SENSORS: dict[str, tuple[Unit, ...]] = {}  # sensor of an actuator -> units of its faults and settings
LOOP_SENSOR: dict[str, str] = {}  # technology -> the sensor that closes its position loop
ELEVATOR_KINDS: dict[str, Kind] = {}


def register(technology: Technology) -> None:
    """Know `technology`, its sensors and its kinds of fault. One that does not ship is for the scenario that brings it
    along."""
    TECHNOLOGIES[technology.name] = technology
    for table in (ACTUATOR_SENSORS, LOOP_SENSOR, ELEVATOR_KINDS):
        table.clear()
    kinds = {**_COMMON}
    for t in TECHNOLOGIES.values():
        ACTUATOR_SENSORS.update({name: sensor.units for name, sensor in t.sensors.items()})
        kinds |= {name: kind for name, kind in t.kinds.items() if name not in kinds}
    LOOP_SENSOR.update({t.name: t.loop_sensor for t in TECHNOLOGIES.values() if t.loop_sensor})
    suffers = {t.name: {*_ALWAYS, *t.effects, t.loop_sensor and "jam_liquid"} for t in TECHNOLOGIES.values()}
    for name, kind in kinds.items():
        ELEVATOR_KINDS[name] = replace(kind, technologies=tuple(t for t, own in suffers.items() if name in own))


for _technology in SHIPPED:
    register(_technology)


# -- numbers that a scenario may multiply, read from the aircraft and the actuators, with what they mean
MULTIPLIED = ("aero", *(name for name, t in TECHNOLOGIES.items() if t.servo))
COEFFICIENTS = {
    "CL": "lift", "CD": "drag", "CY": "side force", "Cl": "rolling moment", "Cm": "pitching moment",
    "Cn": "yawing moment", "Ch": "hinge moment of the elevator segments",
}  # fmt: skip
PER = {
    "0": "at zero angle of attack", "alpha": "over angle of attack", "beta": "over sideslip",
    "p": "over roll rate", "q": "over pitch rate", "r": "over yaw rate", "alphadot": "over rate of angle of attack",
    "de": "over elevator", "ds": "over stabiliser", "da": "over aileron", "dr": "over rudder",
    "delta": "over its angle",
}  # fmt: skip
_FIELD = re.compile(
    r'\(\s*"(\w+)",\s*"f8"(?:,\s*"([^"]*)")?,?\s*\),\s*#\s*(.*?)\s*(?:\[([^\]]*)\])?\s*$', re.M
)  # of a dtype: name, unit, what it is, unit where it stands behind


@functools.cache
def toleranced(group: str) -> tuple[str, ...]:
    """Return the names of group "aero" or of a technology; its blocks are imported only when they are asked for."""
    return multipliers() if group == "aero" else TECHNOLOGIES[group].tolerances


def meanings(group: str) -> dict[str, tuple[str, str]]:
    """Return {name: (what it is, unit)} of what `toleranced(group)` names."""
    if group == "aero":
        parts = {name: name.partition("_") for name in toleranced(group)}
        return {name: (f"{COEFFICIENTS[what]} {PER[over]}", "-") for name, (what, _, over) in parts.items()}
    actuator = TECHNOLOGIES[group].modules()[1]
    package = actuator.__name__.rpartition(".")[0]
    around = [m for m in vars(actuator).values() if inspect.ismodule(m) and m.__name__.startswith(package)]
    sources = [inspect.getsource(m) for m in (*around, actuator)]
    found = (field for source in sources for field in _FIELD.findall(source))
    fields = {name: (text, unit or behind) for name, unit, text, behind in found}
    return {name: fields.get(name, ("", "")) for name in toleranced(group)}


OSCILLATIONS = ("ofc_liquid", "ofc_solid", "oscillation")
PATHS = {"sensor": ("all", "observers"), "actuator_sensor": ("loop", "monitor")}  # the first is the default


def sensor_kinds(units: Iterable[Unit]) -> dict[str, Kind]:
    """Return {kind: Kind} for a sensor whose values may be given in `units`."""
    return {
        "bias": Kind("constant error", _keys("bias", units)),
        "drift": Kind("error that grows with time", _keys("drift", units, "_s")),
        "scale": Kind("reading times a factor", (Key("scale", -10.0, 10.0, healthy=1.0),)),
        "freeze": Kind("the last value repeats", switched=True, exclusive="sample"),
        "noise": Kind("additional white noise per sample", _keys("sigma", units, signed=False)),
        "oscillation": Kind("oscillation added to the reading", _keys("amplitude", units, signed=False), _sine),
        "dropout": Kind("no valid sample", switched=True, exclusive="sample"),
    }


SENSOR_KINDS = tuple(sensor_kinds(()))


KEYS = {  # table of a scenario -> {key: what it means}; a kind's own numbers stand in its Kind
    "[flight], at the start": {
        "aircraft": "one that ships, or a folder with aircraft.toml",
        "mass_t": "mass [t], within the aircraft's envelope",
        "cg_pct": "centre of gravity, % of the mean chord, aft +",
        "altitude_ft": "pressure altitude [ft]",
        "cas_kt": "calibrated airspeed [kt]; or mach, or tas_kt, the true one [kt]",
        "climb_fpm": "vertical speed, descent -; or gamma_deg, the angle of the path; left out: level",
        "bank_deg": "of a steady turn, right +; or turn_deg_s, the rate of the heading; left out: straight",
    },
    "[flight], the air": {
        "turbulence": "none | light | moderate | severe: Dryden gusts",
        "air": "[{ start_s, turbulence, ramp_s }]: changes of the turbulence within the flight, reached after ramp_s",
        "wind_kt": "steady wind at altitude_ft; the trim is against the air",
        "wind_from_deg": "true; the aircraft starts heading north: 0 ahead, 90 from the right",
        "shear_kt_1000ft": "growth of that wind with altitude, from the same direction",
        "gusts": "[{ start_s, axis, speed_fps, gradient_ft, shape }]: discrete gusts; axis vertical | lateral | "
        "longitudinal, a positive speed raises angle of attack, sideslip or airspeed; gradient_ft is the way from the "
        "beginning to the full speed; shape 1-cosine (CS-25 25.341) | ramp (MIL-F-8785C 3.7.1.3), which stays",
    },
    "[manoeuvre], every kind": {
        "hold_speed": "true: the throttles hold the speed; by default in coordinated_turn and yaw_angle",
    },
    '[manoeuvre] kind = "inputs"': {
        "file": "a CSV with these columns, in place of lists here; the log holds its numbers",
        "time_s": "rising; before the first and after the last row those hold",
        "stick": "share of its travel, 2 g at the stop, + pulls; or nz_g; 0 is free",
        "bank_deg": "demanded bank; or heading_deg, the change of heading",
        "elevator_deg": "added to the elevator command",
        "throttle": "0 to 1, of all engines; or throttle_change, from the trim",
        "stabiliser_deg": "trailing edge down +; or stabiliser_change_deg, from the trim; the automatic trim is off",
        "between": "linear | hold: between two rows",
        "hold_altitude": "true: while the stick is free the altitude is held, not the path",
    },
    "[[faults]], every kind": {
        "start_s": "onset",
        "when": "in place of start_s: the tick after this first holds, 'n_z > 1.2 and t > 5'; and, or, ( ); SI units; "
        "fault.0.active, fault.0.since: of another fault",
        "lasts_s": "of one with a condition: healed after so long",
        "end_s": "healed; left out: until the end",
        "ramp_s": "grows from nothing over so long; not for a jam, freeze, free float or dropout",
        "at": "where it enters; default: the first that the kind names",
        "path": f"of an aircraft sensor {' | '.join(PATHS['sensor'])}: observers leaves the law's copy healthy; "
        f"of an actuator's sensor {' | '.join(PATHS['actuator_sensor'])}: monitor leaves the servo's copy healthy",
        "shape": f"of an oscillation: {' | '.join(SHAPES)}; the amplitude is the peak, converted between valve and "
        "rod as that of a sine of frequency_hz",
        "chirp_hz_s": "of a chirp: change of its frequency per second, from frequency_hz at the onset to 0.01 or "
        "25 Hz, where it stays",
        "limit_deg": "of a runaway, within the surface's travel; default: the stop",
    },
    "amplitude of ofc_liquid, ofc_solid": {
        f"at = {at}": " | ".join(keys) + (" (amplitude: share of full valve or drive)" if "amplitude" in keys else "")
        for at, keys in AMPLITUDES_AT.items()
    },
    "[elevator]": {
        "<segment>": " | ".join(TECHNOLOGIES),
        "feedback": f"{' | '.join(FEEDBACKS)}: what hydraulic servos close on, or a table by segment",
        "parameters": "segment -> .truth and .model: parameters of its actuator [SI]; also written "
        "[elevator.<segment>.<technology>]",
        "reconfigure": "true: on a sensor verdict a servo that closes on its measurement takes the healthy estimate; "
        "'published': an EMA's takes that of ema_kalman, which knows no load",
        "compensate": "true: while iotsekf alarms, its estimate of the input fault is taken off the valve command",
    },
    "[law]": {
        "<gain>": "of the shipped law",
        "file": "a law of one's own",
        "reallocate": "true: while control_redundancy declares the elevators the stabiliser flies the pitch axis and "
        "holds the altitude; while it declares an engine the throttles make up for it",
    },
    "[sensors], a table per sensor": {
        "sigma_<unit>": "noise per sample, one sigma",
        "bias_<unit>": "constant error",
        "quantum_<unit>": "resolution",
        "scale": "reading times a factor",
        "delay_s": "age of a reading",
        "noise_scale": "of the whole set: a factor on every sigma and spread that no table gives",
        "reconstructed": "true: the law flies on n_z and alpha less the faults that lpv_smo estimates",
    },
}
ALL_KINDS = tuple(dict.fromkeys([*ELEVATOR_KINDS, *SENSOR_KINDS, *ENGINE_KINDS]))
