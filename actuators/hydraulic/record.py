"""What the testbed knows about the hydraulic servo-actuator: its record (see actuators/technology.py)."""

import functools

from actuators.technology import ARM_DEG, LOSS, MM, SURFACE, Design, Effect, Key, Kind, Sensor, Technology, Unit


def _modules():
    from actuators.hydraulic import actuator, servo

    return servo, actuator


def _parameters(own):
    from actuators.common import linkage
    from actuators.hydraulic.actuator import NOMINAL

    given = dict(own)
    arm = given.get("arm", NOMINAL["arm"])
    return {**NOMINAL, "u_max": linkage.rod(linkage.RATE, arm), **given}


@functools.cache
def _design(own):
    p = _parameters(own)
    stall = p["A_p"] * p["P_s"]
    return Design(
        arm=p["arm"], drive=1.0, probe=0.2, stall_moment=stall * p["arm"],
        shares={"Pa": 1.0 / p["P_s"]},  # its own unit is the share of supply
        factors={"friction": 1.0 / (p["F_brake"] / stall)},  # a share of the stall force, on the rod
        valve_speed=p["phi_n"] / p["A_p"],
    )  # fmt: skip


def _build(own, truth, believed, trim, travel, dt, age):
    """The servo's model stays nominal but for what it is told, as a real servo's does. It predicts over one tick at
    most: above 200 Hz its measurements are older than it thinks, at 2 kHz by 4.5 ms."""
    import numpy as np

    from actuators.hydraulic import lu17

    servo, actuator = _modules()
    nominal = _parameters(own)
    nominal |= dict(zip(("q_lo", "q_hi"), nominal["arm"] * np.array(travel)))
    p = np.concatenate([actuator.params(**{**nominal, **lane}) for lane in truth])
    known = (*lu17.NOMINAL, "arm", "u_max")
    models = [{name: lane.get(name, nominal[name]) for name in known} for lane in believed]
    ps = np.concatenate([servo.params(dt=dt, delay=min(age, 1.0), travel=travel, **model) for model in models])
    x = actuator.init_at(p, *trim)
    return [("servo", servo, ps, servo.init_at(ps, trim[0], x["F_d"])), ("hydraulic", actuator, p, x)]


def _solid_gain(omega, own):
    import numpy as np

    from actuators.hydraulic import lu17

    actuator, arm = _modules()[1], _design(own).arm
    A, B = lu17.linear(actuator.params(**_parameters(own))[0])
    surface = np.linalg.solve(1j * omega * np.eye(3) - A, B)[0, 0] * (1.0 / arm)
    return abs(complex(surface)) * arm


TECHNOLOGY = Technology(
    name="hydraulic",
    article="a hydraulic",
    servo="servo",
    modules=_modules,
    design=_design,
    build=_build,
    parameters=_parameters,
    fixed=("q_lo", "q_hi", "substeps"),
    sensors={
        "rod": Sensor(
            "q_rod", "rod position, + extends = trailing edge down", (MM, ARM_DEG), 1e-4, servo=("q_meas", "q_valid")
        ),
        "surface": SURFACE,
        "pressure": Sensor(
            "x3", "pressure difference over the supply pressure, + extends",
            (Unit("pct", 0.01, "of supply", 100.0), Unit("mpa", 1e6, "Pa", 30.0)), 0.005, 0.01,
            servo=("x3_meas", "x3_valid"),
        ),
    },
    loop_sensor="rod",
    sent=("valve_command", "valve command held over the last tick, full valve = 1, + extends", "-"),
    runaway="valve",
    effects={
        "jam_solid": Effect("jam"), "free_float": Effect("free_float"), "loss_of_effectiveness": Effect("loss"),
        "friction": Effect("jam"), "backlash": Effect("backlash_add", "rad"),
        "supply_pressure_drop": Effect("supply_drop"), "internal_leakage": Effect("leak_add"),
        "air_in_oil": Effect("air"),
    },
    kinds={
        "supply_pressure_drop": Kind("supply pressure falls by a share", LOSS, exclusive="supply"),
        "internal_leakage": Kind(
            "flow past the piston at supply pressure, share of rated flow",
            (Key("leakage_pct", 0.0, 100.0, 0.01, "fraction", open_low=True),),
            exclusive="leakage",
        ),
        "air_in_oil": Kind("bulk modulus falls by a share", LOSS, exclusive="bulk"),
    },
    hinge_error=0.2,
    smooth=({}, {"F_c": 0.0, "F_s": 0.0}),
    solid_gain=_solid_gain,
)  # fmt: skip
