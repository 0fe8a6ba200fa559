"""What the testbed knows about the electromechanical actuator: its record (see actuators/technology.py)."""

import functools
import math

from actuators.technology import ARM_DEG, LOSS, MM, SURFACE, Design, Effect, Key, Kind, Sensor, Technology, Unit


def _modules():
    from actuators.ema import actuator, servo

    return servo, actuator


def _parameters(own):
    from actuators.ema import jay

    return jay.values("elevator", **dict(own))


@functools.cache
def _design(own):
    from actuators.ema import jay

    v, amperes = _parameters(own), jay.LIMITS["elevator"][0]
    torque = v["K_T"] * amperes
    return Design(
        arm=v["arm"], drive=amperes, probe=amperes, limited=True, stall_moment=torque * v["arm"] / v["lead"],
        gains={"position": v["lead"]},  # screw travel per radian of motor [m/rad]
        # no-load rate of the surface: 45 deg/s
        shares={"of no-load speed": math.radians(45.0) * v["arm"] / v["lead"], "of stall current": amperes},
        # friction is a share of the stall torque, at the motor; a hardover one of the largest current
        factors={"friction": torque, "hardover": amperes},
    )  # fmt: skip


def _build(own, truth, believed, trim, travel, dt, age):
    import numpy as np

    servo, actuator = _modules()
    symbols = dict(own)
    p = np.concatenate([actuator.params(symbols=symbols, travel=travel, **lane) for lane in truth])
    made = [servo.params(dt=dt, delay=age, travel=travel, symbols={**symbols, **lane}) for lane in believed]
    ps = np.concatenate(made)
    x = actuator.init_at(p, *trim)
    lead = _design(own).gains["position"]
    return [("ema_servo", servo, ps, servo.init_at(ps, lead * x["motor"], x["i"])), ("ema", actuator, p, x)]


def _solid_gain(omega, own):
    import numpy as np

    from actuators.ema import jay

    m = jay.continuous("elevator", **dict(own))
    return abs(complex(np.linalg.solve(1j * omega * np.eye(6) - m.A, m.B)[2])) * _design(own).gains["position"]


TECHNOLOGY = Technology(
    name="ema",
    article="an EMA",
    servo="ema_servo",
    modules=_modules,
    design=_design,
    build=_build,
    parameters=_parameters,
    sensors={
        "velocity": Sensor(  # [Jay] section 4: 1 rad/s
            "motor_d", "motor velocity, + extends",
            (Unit("rad_s", 1.0, "rad/s", 1000.0), Unit("pct", 0.01, "of no-load speed", 100.0)), 1.0,
            servo=("vel_meas", "vel_valid"),
        ),
        "position": Sensor(  # [Jay] section 4: 0.1 mm
            "motor", "screw position, + extends = trailing edge down", (MM, ARM_DEG), 1e-4,
            servo=("pos_meas", "pos_valid"),
        ),
        "current": Sensor(  # [Jay] section 4: 0.1 A
            "i", "motor current, + extends",
            (Unit("a", 1.0, "A", 500.0), Unit("pct", 0.01, "of stall current", 100.0)), 0.1, drive=("s_i", "f_i"),
        ),
        "surface": SURFACE,
    },
    loop_sensor="position",
    sent=("current_command", "current demand held over the last tick, + extends", "A"),
    effects={
        "jam_solid": Effect("jam"), "free_float": Effect("free_float"), "loss_of_effectiveness": Effect("loss"),
        "friction": Effect("friction_add"), "backlash": Effect("backlash_add", "m"),
        "winding_resistance": Effect("r_add"), "magnet_loss": Effect("magnet_loss"), "jam": Effect("jam_screw"),
        "hardover": Effect("f_u", share="s_u"),
    },
    kinds={
        "winding_resistance": Kind(
            "winding resistance rises by a share",
            (Key("increase_pct", 0.0, 1000.0, 0.01, "fraction", open_low=True),),
            exclusive="winding",
        ),
        "magnet_loss": Kind("torque and back-EMF constant fall by a share", LOSS, exclusive="magnet"),
        "hardover": Kind(
            "the drive is stuck at a share of its largest current",
            (Key("drive_pct", -100.0, 100.0, 0.01, "fraction", healthy=0.0),),
            exclusive="valve",
        ),
        "jam": Kind("the screw seizes, the motor stalls", switched=True, exclusive="motion"),
    },
    hinge_error=0.3,
    # the integrator's dead band is wider than the small motion that gains are measured with
    smooth=({"dead": 0.0}, {"T_c": 0.0, "T_s": 0.0}),
    solid_gain=_solid_gain,
)  # fmt: skip
