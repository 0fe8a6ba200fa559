"""What a scenario can name: parts, sensors with their units, and every kind of fault with its parameters.

These tables are the only place where that is written: validation, `cosim list`, messages and conversion read them.
"""

import math
from dataclasses import dataclass
from typing import Any

from cosim.scenario.aircraft import Aircraft, load_aircraft

DEG, KT, FT = math.pi / 180.0, 1852.0 / 3600.0, 0.3048

_TRANSPORT = load_aircraft()
SEGMENTS = _TRANSPORT.segments  # of the default aircraft
SHORT, GROUPS = _TRANSPORT.short, _TRANSPORT.groups
TECHNOLOGIES = ("hydraulic", "ema", "simple")
DEFAULT_TECHNOLOGY: dict[str, Any] = _TRANSPORT.technology
FEEDBACKS = ("measured", "iotsekf", "rtsekf", "rtsekf_flight")
SURFACES = ("aileron.left", "aileron.right", "rudder", "stabiliser")


@dataclass(frozen=True)
class Unit:
    """A unit that ends a key: SI = value * factor; `si` may be a share of a nominal value ("of supply", ...)."""

    suffix: str
    factor: float
    si: str
    limit: float  # largest magnitude that is accepted, in this unit


_deg = Unit("deg", DEG, "rad", 45.0)
_deg_s = Unit("deg_s", DEG, "rad/s", 90.0)
_deg_s2 = Unit("deg_s2", DEG, "rad/s2", 90.0)
_kt = Unit("kt", KT, "m/s", 200.0)
_g = Unit("g", 1.0, "g", 5.0)
_height = (Unit("m", 1.0, "m", 5000.0), Unit("ft", FT, "m", 15000.0))
_climb = (Unit("m_s", 1.0, "m/s", 100.0), Unit("ft_s", FT, "m/s", 300.0))
_mm = Unit("mm", 1e-3, "m", 150.0)

SENSORS = {  # aircraft sensor -> units of its faults and settings; the first one is its own
    **dict.fromkeys(("alpha", "beta", "phi", "theta", "psi"), (_deg,)),
    **dict.fromkeys(("p", "q", "r"), (_deg_s,)),
    **dict.fromkeys(("pdot", "qdot", "rdot"), (_deg_s2,)),
    **dict.fromkeys(("cas", "tas"), (_kt,)),
    "mach": (Unit("mach", 1.0, "-", 0.5),),
    **dict.fromkeys(("h_baro", "h_inertial"), _height),
    "hdot": _climb,
    **dict.fromkeys(("n_x", "n_y", "n_z"), (_g,)),
    **dict.fromkeys(("n1_1", "n1_2", "n1_3", "n1_4"), (Unit("pct", 1.0, "%", 100.0),)),
    "mass": (Unit("t", 1000.0, "kg", 100.0),),
    "cg": (Unit("pct", 0.01, "-", 20.0),),
}
ACTUATOR_SENSORS = {  # sensors of an actuator
    "rod": (_mm, Unit("deg", DEG, "rad", 40.0)),
    "surface": (_deg,),
    "pressure": (Unit("pct", 0.01, "of supply", 100.0), Unit("mpa", 1e6, "Pa", 30.0)),
    "velocity": (Unit("rad_s", 1.0, "rad/s", 1000.0), Unit("pct", 0.01, "of no-load speed", 100.0)),
    "position": (_mm, Unit("deg", DEG, "rad", 40.0)),
    "current": (Unit("a", 1.0, "A", 500.0), Unit("pct", 0.01, "of stall current", 100.0)),
}
SENSORS_OF = {
    "hydraulic": ("rod", "surface", "pressure"),
    "ema": ("velocity", "position", "current", "surface"),
    "simple": (),
}
LOOP_SENSOR = {"hydraulic": "rod", "ema": "position"}  # the one that closes the position loop


@dataclass(frozen=True)
class Key:
    """A number from `low` to `high`, SI = value * factor; `open_low` excludes `low`, `healthy` is refused: no fault."""

    name: str
    low: float
    high: float
    factor: float = 1.0
    si: str = "-"
    open_low: bool = False
    healthy: float | None = None
    default: float | None = None

    def accepts(self, x):
        """Tell whether the number x is allowed."""
        above = x > self.low if self.open_low else x >= self.low
        return above and x <= self.high and x != self.healthy

    @property
    def range(self):
        """Return the allowed range as words."""
        text = f"{'above ' if self.open_low else ''}{self.low:g} to {self.high:g}"
        return text + ("" if self.healthy is None else f", not {self.healthy:g}")


@dataclass(frozen=True)
class Kind:
    """A kind of fault: exactly one key of `one_of`, all of `keys`, switched at once (no ramp) when `switched`.

    `exclusive` names what it takes over on its part: two overlapping faults that take over the same thing are refused.
    """

    summary: str
    one_of: tuple[Key, ...] = ()
    keys: tuple[Key, ...] = ()
    at: tuple[str, ...] = ()
    technologies: tuple[str, ...] = TECHNOLOGIES
    switched: bool = False
    exclusive: str = ""


_loss = (Key("loss_pct", 0.0, 100.0, 0.01, "fraction", open_low=True),)
_sine = (
    Key("frequency_hz", 0.01, 25.0, 2 * math.pi, "rad/s"),
    Key("phase_deg", -360.0, 360.0, DEG, "rad", default=0.0),
)


def _amplitudes(open_low):
    return (
        Key("amplitude", 0.0, 1.0, 1.0, "u", open_low),
        Key("amplitude_mm", 0.0, 120.0, 1e-3, "m", open_low),
        Key("amplitude_deg", 0.0, 20.0, DEG, "rad", open_low),
        Key("amplitude_travel", 0.0, 0.5, 1.0, "of travel", open_low)  # of the elevator's [Sun13],
    )


AMPLITUDES_AT = {  # the keys that have a meaning where the oscillation enters
    "valve": ("amplitude", "amplitude_mm"),
    "command": ("amplitude_mm", "amplitude_deg", "amplitude_travel"),
    "sensor": ("amplitude_mm", "amplitude_deg", "amplitude_travel"),
}

_hyd, _ema, _real = ("hydraulic",), ("ema",), ("hydraulic", "ema")
_runaway = (Key("rate_deg_s", -45.0, 45.0, DEG, "rad/s", healthy=0.0),)  # the fastest actuators, without load
ELEVATOR_KINDS = {
    "ofc_liquid": Kind("oscillation added to the signal", _amplitudes(True), _sine, ("valve", "command", "sensor")),
    "ofc_solid": Kind(
        "oscillation in place of the signal", _amplitudes(False), _sine, ("valve", "command"), exclusive="at"
    ),
    "bias": Kind(
        "constant added to the position command",
        (
            Key("bias_mm", -120.0, 120.0, 1e-3, "m", healthy=0.0),
            Key("bias_deg", -20.0, 20.0, DEG, "rad", healthy=0.0),
        ),
        at=("command",),
    ),
    "jam_liquid": Kind(
        "bias on the position sensor that closes the loop (the same as bias on it)",
        (
            Key("bias_mm", -150.0, 150.0, 1e-3, "m", healthy=0.0),
            Key("bias_deg", -40.0, 40.0, DEG, "rad", healthy=0.0),
        ),
        technologies=_real,
    ),
    "jam_solid": Kind("the surface stops where it is", switched=True, exclusive="motion"),
    "runaway": Kind(
        "the surface drives off, to its stop or to limit_deg; to a limit, and without a valve, the command runs",
        _runaway,
        at=("valve", "command"),
        exclusive="at",
    ),
    "loss_of_effectiveness": Kind(
        "the surface gives only a part of what is commanded; at the valve or drive the servo makes up for it as it can",
        _loss,
        at=("command", "valve"),
        exclusive="at",
    ),
    "free_float": Kind(
        "the actuator lets go, the surface trails", technologies=_real, switched=True, exclusive="motion"
    ),
    "supply_pressure_drop": Kind("supply pressure falls by a share", _loss, technologies=_hyd, exclusive="supply"),
    "internal_leakage": Kind(
        "flow past the piston at supply pressure, share of rated flow",
        (Key("leakage_pct", 0.0, 100.0, 0.01, "fraction", open_low=True),),
        technologies=_hyd,
        exclusive="leakage",
    ),
    "air_in_oil": Kind("bulk modulus falls by a share", _loss, technologies=_hyd, exclusive="bulk"),
    "friction": Kind(
        "added Coulomb friction, share of the stall force",
        (Key("friction_pct", 0.0, 100.0, 0.01, "fraction", open_low=True),),
        technologies=_real,
        exclusive="friction",
    ),
    "backlash": Kind(
        "play between actuator and surface, full width",
        (
            Key("backlash_mm", 0.0, 20.0, 1e-3, "m", open_low=True),
            Key("backlash_deg", 0.0, 4.0, DEG, "rad", open_low=True),
        ),
        technologies=_real,
        exclusive="backlash",
    ),
    "winding_resistance": Kind(
        "winding resistance rises by a share",
        (Key("increase_pct", 0.0, 1000.0, 0.01, "fraction", open_low=True),),
        technologies=_ema,
        exclusive="winding",
    ),
    "magnet_loss": Kind("torque and back-EMF constant fall by a share", _loss, technologies=_ema, exclusive="magnet"),
    "jam": Kind("the screw seizes, the motor stalls", technologies=_ema, switched=True, exclusive="motion"),
}
SURFACE_KINDS = {
    "jam": Kind("the surface stops where it is", switched=True, exclusive="motion"),
    "runaway": Kind("the surface drives off, to its stop or to limit_deg", _runaway, exclusive="motion"),
}
ENGINE_KINDS = {"thrust_loss": Kind("thrust falls by a share", _loss, exclusive="thrust")}


def optional_keys(kind: str, target: str, aircraft: Aircraft) -> tuple[Key, ...]:
    """Return the keys that `kind` may have on `target`; a runaway's limit is by default the stop it drives to."""
    if kind != "runaway":
        return ()
    return (Key("limit_deg", *aircraft.travels_deg[target.split(".")[0]], DEG, "rad"),)


SENSOR_SUMMARIES = {
    "bias": "constant error",
    "drift": "error that grows with time",
    "scale": "reading times a factor",
    "freeze": "the last value repeats",
    "noise": "additional white noise per sample",
    "oscillation": "sine added to the reading",
    "dropout": "no valid sample",
}
SENSOR_PATHS = ("all", "observers")  # of an aircraft sensor; the first is the default
ACTUATOR_PATHS = ("loop", "monitor")  # of an actuator's sensor


def sensor_kinds(units):
    """Return {kind: Kind} for a sensor whose values may be given in `units`."""

    def keys(stem, tail="", signed=True):
        return tuple(
            Key(
                f"{stem}_{u.suffix}{tail}",
                -u.limit if signed else 0.0,
                u.limit,
                u.factor,
                u.si + ("/s" if tail else ""),
                open_low=not signed,
                healthy=0.0 if signed else None,
            )
            for u in units
        )

    text = SENSOR_SUMMARIES
    return {
        "bias": Kind(text["bias"], keys("bias")),
        "drift": Kind(text["drift"], keys("drift", "_s")),
        "scale": Kind(text["scale"], (Key("scale", -10.0, 10.0, healthy=1.0),)),
        "freeze": Kind(text["freeze"], switched=True, exclusive="sample"),
        "noise": Kind(text["noise"], keys("sigma", signed=False)),
        "oscillation": Kind(text["oscillation"], keys("amplitude", signed=False), _sine),
        "dropout": Kind(text["dropout"], switched=True, exclusive="sample"),
    }


KEYS = {  # table of a scenario -> {key: what it means}; a kind's own numbers stand in its Kind
    "[[faults]], every kind": {
        "start_s": "onset",
        "end_s": "healed; left out: until the end",
        "ramp_s": "grows from nothing over so long; not for what is switched at once",
        "at": "where it enters; default: the first that the kind names",
        "path": f"of an aircraft sensor {' | '.join(SENSOR_PATHS)}: observers leaves the law's copy healthy; "
        f"of an actuator's sensor {' | '.join(ACTUATOR_PATHS)}: monitor leaves the servo's copy healthy",
        "limit_deg": "of a runaway, within the surface's travel; default: the stop",
    },
    "amplitude of ofc_liquid, ofc_solid": {
        f"at = {at}": " | ".join(keys) + (" (amplitude: share of full valve or drive)" if "amplitude" in keys else "")
        for at, keys in AMPLITUDES_AT.items()
    },
    "[elevator]": {
        "<segment>": " | ".join(TECHNOLOGIES),
        "feedback": f"{' | '.join(FEEDBACKS)}: what hydraulic servos close on, or a table by segment",
        "reconfigure": "true: on a sensor verdict a servo that closes on its measurement takes the healthy estimate",
    },
    "[sensors], a table per sensor": {
        "sigma_<unit>": "noise per sample, one sigma",
        "bias_<unit>": "constant error",
        "quantum_<unit>": "resolution",
        "scale": "reading times a factor",
        "delay_s": "age of a reading",
        "noise_scale": "of the whole set: a factor on every sigma and spread that no table gives",
    },
}
ALL_KINDS = tuple(dict.fromkeys([*ELEVATOR_KINDS, *SENSOR_SUMMARIES, *ENGINE_KINDS]))
