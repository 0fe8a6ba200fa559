"""The unit of each logged field, for viewers: "-" where there is none, "" where the table says nothing."""

from cosim.flight.blocks.sensors import TRANSPORT

_NONE = "-"
_TRUTH = {
    **dict.fromkeys("alpha beta phi theta psi gamma lat lon da_l da_r dr stab".split(), "rad"),
    **dict.fromkeys("p q r".split(), "rad/s"),
    **dict.fromkeys("pdot qdot rdot".split(), "rad/s2"),
    **dict.fromkeys("udot vdot wdot".split(), "m/s2"),
    **dict.fromkeys("tas cas hdot u v w wind_n wind_e wind_d".split(), "m/s"),
    **dict.fromkeys("mach cg".split(), _NONE),
    **dict.fromkeys("nx ny nz".split(), "g"),
    **{
        f"{name}_{seg}": unit
        for name, unit in (("hm0", "N m"), ("hmd", "N m/rad"), ("de", "rad"))
        for seg in ("lo", "li", "ri", "ro")
    },
    **{
        f"{name}_{i}": unit
        for name, unit in (("n1", "%"), ("thrust", "N"), ("throttle", _NONE), ("thrust_loss", _NONE))
        for i in range(1, 5)
    },
    "h": "m",
    "qbar": "Pa",
    "rho": "kg/m3",
    "mass": "kg",
}
_SENSORS = {name: spec[3] for name, spec in TRANSPORT.items()}
_SENSORS |= {"rod": "m", "surface": "rad", "pressure": _NONE, "velocity": "rad/s", "position": "m", "current": "A"}
_LAW = {
    **dict.fromkeys("de_cmd da_cmd dr_cmd stab_cmd alpha_lim phi_ref phi_dem psi_dem de_add".split(), "rad"),
    **dict.fromkeys("nz_dem n_c e".split(), "g"),
    **dict.fromkeys("throttle_cmd protection hold_psi hold_h hold_v".split(), _NONE),
    "hdot_ref": "m/s",
    "h_ref": "m",
}
_ACTUATORS = {
    "q_rod": "m",
    "qd_rod": "m/s",
    "x3": _NONE,
    "delta": "rad",
    "delta_d": "rad/s",
    "F_d": "N",
    "u_eff": _NONE,
    "motor": "rad",
    "motor_d": "rad/s",
    "i": "A",
    "volts": "V",
    "mode": _NONE,
    "status": _NONE,
    "u": _NONE,
    "u_held": _NONE,
}
_DETECTORS = {**dict.fromkeys("r alarm verdict culprit valid".split(), _NONE), "hm0": "N m", "hmd": "N m/rad"}
_GROUPS = {
    "truth": _TRUTH,
    "sensors": _SENSORS,
    "law": _LAW,
    "actuators": _ACTUATORS,
    "detectors": _DETECTORS,
    "faults": {"active": _NONE},
}


def unit(group, field):
    """Return the unit of `field` in a topic of `group`, "-" for a number without one, "" when it is not known here."""
    if field.endswith("_valid"):
        return _NONE
    return _GROUPS.get(group, {}).get(field, "")
