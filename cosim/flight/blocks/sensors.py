"""Sensors, one lane per consolidated signal: delay, scale, bias, noise, quantisation, and their faults.

    y(t_k) = quantise( (1 + scale + f_scale) s(t_k - delay) + bias + f_add + (sigma + f_noise) n_k )

Two copies leave each sensor. `y` is what the control law and the servo loops use; `y_obs` is what the detectors see. A
fault on the path "all" (or "loop") enters both, one on "observers" (or "monitor") only the second [Alwi14, section V:
sensor faults "only corrupt the measurements which drive the observer"]. A dropped sample is NaN with its flag at 0; a
frozen one repeats the value of its first tick.
"""

import math

from actuators.block import dtype, entry, kernel, zero_state
from actuators.constants import M_S_PER_KT, RAD_PER_DEG
from cosim.scenario.aircraft import Aircraft

DELAY_MAX = 32  # longest delay in ticks: 0.15 s at 5 ms

PARAMS = dtype([
    ("gain", "f8"),  # what the sensor reads per unit of the truth it is wired to (screw lead), 1 otherwise
    ("sigma", "f8"),  # standard deviation of white noise per sample [unit]
    ("bias", "f8"),  # [unit]
    ("scale", "f8"),  # scale-factor error [-]
    ("delay", "f8"),  # [ticks]
    ("quantum", "f8"),  # quantisation step [unit], 0 for none
])

INPUTS = dtype([
    ("truth", "f8"),  # the physical signal at t_k [unit]
    ("noise", "f8"),  # standard normal draw, made outside and logged [-]
    ("f_add", "f8"),  # both copies: additive fault [unit]
    ("f_scale", "f8"),  # scale fault [-]
    ("f_freeze", "f8"),  # > 0: frozen
    ("f_noise", "f8"),  # additional standard deviation [unit]
    ("f_drop", "f8"),  # > 0: no valid sample
    ("g_add", "f8"),  # the observers' copy only, the same five
    ("g_scale", "f8"),
    ("g_freeze", "f8"),
    ("g_noise", "f8"),
    ("g_drop", "f8"),
])

STATE = dtype([
    ("y", "f8"),  # copy for law and servo [unit]
    ("valid", "f8"),  # 1 or 0
    ("y_obs", "f8"),  # the observers' copy [unit]
    ("valid_obs", "f8"),  # 1 or 0
    ("last", "f8"),  # value repeated while frozen [unit]
    ("last_obs", "f8"),
    ("frozen", "f8"),  # 1 while `last` is latched
    ("frozen_obs", "f8"),
    ("fresh", "f8"),  # 0 until the delay line is filled
    ("head", "f8"),  # write position in the delay line
    ("line", "f8", (DELAY_MAX,)),
])

OUTPUTS = ("y", "valid", "y_obs", "valid_obs")


init = zero_state(STATE)  # empty delay lines: the first tick fills them with its own truth, as if it had been so before


@kernel
def _sample(s, n, p, add, scale, noise):
    y = (1.0 + p.scale + scale) * s + p.bias + add + (p.sigma + noise) * n
    if p.quantum > 0.0:
        y = p.quantum * math.floor(y / p.quantum + 0.5)
    return y


@kernel
def step(x, u, p, dt):
    """Advance one sensor by one tick."""
    if x.fresh == 0.0:
        for i in range(DELAY_MAX):
            x.line[i] = p.gain * u.truth
        x.fresh = 1.0
    head = int(x.head)
    x.line[head] = p.gain * u.truth
    s = x.line[(head + DELAY_MAX - int(p.delay)) % DELAY_MAX]
    x.head = (head + 1) % DELAY_MAX

    y = _sample(s, u.noise, p, u.f_add, u.f_scale, u.f_noise)
    if u.f_freeze > 0.0:
        if x.frozen == 0.0:
            x.last = y
        y = x.last
    x.frozen = 1.0 if u.f_freeze > 0.0 else 0.0

    y_obs = _sample(s, u.noise, p, u.f_add + u.g_add, u.f_scale + u.g_scale, u.f_noise + u.g_noise)
    if u.f_freeze > 0.0 or u.g_freeze > 0.0:
        if x.frozen_obs == 0.0:
            x.last_obs = y_obs
        y_obs = x.last_obs
        x.frozen_obs = 1.0
    else:
        x.frozen_obs = 0.0

    x.valid = 0.0 if u.f_drop > 0.0 else 1.0
    x.valid_obs = 0.0 if u.f_drop > 0.0 or u.g_drop > 0.0 else 1.0
    x.y = y if x.valid > 0.0 else math.nan
    x.y_obs = y_obs if x.valid_obs > 0.0 else math.nan


rollout = entry(step, STATE, INPUTS, PARAMS)


_AIR, _INERTIAL = 0.010, 0.005  # delays of air data, and of all other sensors [s]

def installed(aircraft: Aircraft) -> dict[str, tuple[str, float, float, str]]:
    """Return the sensors of TRANSPORT that an aircraft has: a tachometer per engine."""
    fans = [name for name in TRANSPORT if name.startswith("n1_")]
    return {name: spec for name, spec in TRANSPORT.items() if name not in fans[aircraft.engines :]}


# Sensor set `transport`: name -> (truth field, sigma in SI per 5 ms sample, delay [s], unit)
TRANSPORT = {
    "alpha": ("alpha", 0.03 * RAD_PER_DEG, _AIR, "rad"),
    "beta": ("beta", 0.03 * RAD_PER_DEG, _AIR, "rad"),  # a vane like that of alpha
    "cas": ("cas", 0.1 * M_S_PER_KT, _AIR, "m/s"),
    "tas": ("tas", 0.1 * M_S_PER_KT, _AIR, "m/s"),  # computed by the air-data unit, noise as CAS
    "mach": ("mach", 0.0002, _AIR, "-"),  # 0.1 kt of CAS at M 0.6
    "h_baro": ("h", 0.7, _AIR, "m"),
    "h_inertial": ("h", 0.02, _INERTIAL, "m"),
    "hdot": ("hdot", 0.05, _INERTIAL, "m/s"),  # inertial vertical speed
    # inertial too [Alwi14] tables 2, 3: 0.05 m/s on the velocity, with 0.02 deg of attitude 0.025 deg at 180 m/s
    "alpha_ground": ("alpha_ground", 0.025 * RAD_PER_DEG, _INERTIAL, "rad"),
    "v_ground": ("v_ground", 0.05, _INERTIAL, "m/s"),
    "p": ("p", 0.02 * RAD_PER_DEG, _INERTIAL, "rad/s"),  # the three gyros are alike
    "q": ("q", 0.02 * RAD_PER_DEG, _INERTIAL, "rad/s"),
    "r": ("r", 0.02 * RAD_PER_DEG, _INERTIAL, "rad/s"),
    "phi": ("phi", 0.02 * RAD_PER_DEG, _INERTIAL, "rad"),  # the three attitudes are alike
    "theta": ("theta", 0.02 * RAD_PER_DEG, _INERTIAL, "rad"),
    "psi": ("psi", 0.02 * RAD_PER_DEG, _INERTIAL, "rad"),
    "n_x": ("nx", 0.007, _INERTIAL, "g"),
    "n_y": ("ny", 0.007, _INERTIAL, "g"),
    "n_z": ("nz", 0.007, _INERTIAL, "g"),
    "pdot": ("pdot", 0.1 * RAD_PER_DEG, _INERTIAL, "rad/s2"),
    "qdot": ("qdot", 0.1 * RAD_PER_DEG, _INERTIAL, "rad/s2"),
    "rdot": ("rdot", 0.1 * RAD_PER_DEG, _INERTIAL, "rad/s2"),
    "n1_1": ("n1_1", 0.1, _INERTIAL, "%"),  # fan speed, 0.1 % of a tachometer
    "n1_2": ("n1_2", 0.1, _INERTIAL, "%"),
    "n1_3": ("n1_3", 0.1, _INERTIAL, "%"),
    "n1_4": ("n1_4", 0.1, _INERTIAL, "%"),
    "mass": ("mass", 0.0, _INERTIAL, "kg"),  # from the fuel system: constant error only
    "cg": ("cg", 0.0, _INERTIAL, "-"),
}
