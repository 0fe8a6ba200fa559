"""Signals exchanged with JSBSim: truth and inputs, their properties and factors to SI.

Segments and engines are the aircraft's (cosim/scenario/aircraft.py); everything else is the same for all.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np

from actuators.block import dtype, kernel
from actuators.constants import G0, KG_PER_SLUG, M_PER_FT, N_M_PER_LBF_FT, N_PER_LBF, PA_PER_PSF
from cosim.scenario.aircraft import Aircraft

_ENGINE = "propulsion/engine[{}]/"
_MOTION = (  # (field, property, factor, unit); nx, ny, nz and cg get their last step in `last_step`
    ("alpha", "aero/alpha-rad", 1, "rad"),  # against the air
    ("beta", "aero/beta-rad", 1, "rad"),
    ("p", "velocities/p-rad_sec", 1, "rad/s"),  # body rates
    ("q", "velocities/q-rad_sec", 1, "rad/s"),
    ("r", "velocities/r-rad_sec", 1, "rad/s"),
    ("phi", "attitude/phi-rad", 1, "rad"),
    ("theta", "attitude/theta-rad", 1, "rad"),
    ("psi", "attitude/psi-rad", 1, "rad"),
    ("tas", "velocities/vt-fps", M_PER_FT, "m/s"),
    ("cas", "velocities/vc-fps", M_PER_FT, "m/s"),
    ("mach", "velocities/mach", 1, "-"),
    ("h", "position/h-sl-ft", M_PER_FT, "m"),  # above mean sea level
    ("hdot", "velocities/h-dot-fps", M_PER_FT, "m/s"),
    ("gamma", "flight-path/gamma-rad", 1, "rad"),
    ("nx", "forces/fbx-total-lbs", 1, "g"),  # forces over weight, forward +
    ("ny", "forces/fby-total-lbs", 1, "g"),  # right +
    ("nz", "forces/fbz-total-lbs", -1, "g"),  # up +, close to 1 in level flight
    ("pdot", "accelerations/pdot-rad_sec2", 1, "rad/s2"),
    ("qdot", "accelerations/qdot-rad_sec2", 1, "rad/s2"),
    ("rdot", "accelerations/rdot-rad_sec2", 1, "rad/s2"),
    ("udot", "accelerations/udot-ft_sec2", M_PER_FT, "m/s2"),  # body axes
    ("vdot", "accelerations/vdot-ft_sec2", M_PER_FT, "m/s2"),
    ("wdot", "accelerations/wdot-ft_sec2", M_PER_FT, "m/s2"),
    ("qbar", "aero/qbar-psf", PA_PER_PSF, "Pa"),
    ("rho", "atmosphere/rho-slugs_ft3", KG_PER_SLUG / M_PER_FT**3, "kg/m3"),
    ("mass", "inertia/mass-slugs", KG_PER_SLUG, "kg"),
    ("cg", "inertia/cg-x-in", 1, "-"),  # fraction of the mean chord
    ("lat", "position/lat-geod-rad", 1, "rad"),
    ("lon", "position/long-gc-rad", 1, "rad"),
)
_REST = (
    ("da_l", "fcs/aileron-left-pos-rad", 1, "rad"),  # each aileron + rolls right
    ("da_r", "fcs/aileron-right-pos-rad", 1, "rad"),
    ("dr", "fcs/rudder-applied-rad", 1, "rad"),  # + yaws left
    ("stab", "fcs/stabilizer-pos-rad", 1, "rad"),  # trailing edge down +
    ("u", "velocities/u-fps", M_PER_FT, "m/s"),  # body velocity over the ground
    ("v", "velocities/v-fps", M_PER_FT, "m/s"),
    ("w", "velocities/w-fps", M_PER_FT, "m/s"),
    ("wind_n", "atmosphere/total-wind-north-fps", M_PER_FT, "m/s"),  # wind with turbulence
    ("wind_e", "atmosphere/total-wind-east-fps", M_PER_FT, "m/s"),
    ("wind_d", "atmosphere/total-wind-down-fps", M_PER_FT, "m/s"),
    ("alpha_ground", "velocities/w-fps", M_PER_FT, "rad"),  # atan2(w, u) over the ground, by `last_step`
    ("v_ground", "velocities/u-fps", M_PER_FT, "m/s"),  # its size
)
_NX, _MASS, _CG = (next(i for i, s in enumerate(_MOTION) if s[0] == name) for name in ("nx", "mass", "cg"))
# places from the end, which is the same for every aircraft
_U, _AG, _VG = (
    next(i for i, s in enumerate(_REST) if s[0] == name) - len(_REST) for name in ("u", "alpha_ground", "v_ground")
)


@dataclass(frozen=True)
class Border:
    """Truth and inputs of one aircraft: TRUTH's dtype, what is read and written, in which order and unit."""

    truth: np.dtype  # a record of everything that is read, SI
    read: tuple[tuple[str, float], ...]  # (property, factor to SI), in the order of `truth`
    controls: dict[str, str]  # input of the plant -> property; angles [rad], throttle and thrust loss as fractions

    @functools.cached_property
    def inputs(self) -> tuple[str, ...]:
        """Return the names of the inputs in the order of the vector that `Plant.write` takes."""
        return tuple(self.controls)

    @functools.cached_property
    def elevators(self) -> tuple[str, ...]:
        """Return the inputs of the elevator segments, from left to right."""
        return tuple(name for name in self.controls if name.startswith("de_"))

    @functools.cached_property
    def throttles(self) -> tuple[str, ...]:
        """Return the throttles' inputs, from left to right."""
        return tuple(name for name in self.controls if name.startswith("throttle_"))

    def column(self, names: tuple[str, ...]) -> list[int]:
        """Return the places of inputs in the vector."""
        return [self.inputs.index(name) for name in names]


def border(aircraft: Aircraft) -> Border:
    """Return the Border of an aircraft."""
    return _border(tuple(aircraft.short.values()), aircraft.engines)


@functools.cache
def _border(segments: tuple[str, ...], engines: int) -> Border:
    signals = (
        *_MOTION,
        # hinge moment at zero angle, + drives down, and its slope over the segment's angle
        *((f"hm0_{s}", f"aero/hinge-0-{s}-lbsft", N_M_PER_LBF_FT, "N m") for s in segments),
        *((f"hmd_{s}", "aero/hinge-delta-lbsft_rad", N_M_PER_LBF_FT, "N m/rad") for s in segments),
        *((f"n1_{i + 1}", _ENGINE.format(i) + "n1", 1, "%") for i in range(engines)),  # fan speed
        *((f"thrust_{i + 1}", _ENGINE.format(i) + "thrust-lbs", N_PER_LBF, "N") for i in range(engines)),
        *((f"de_{s}", f"fcs/elevator-{s}-pos-rad", 1, "rad") for s in segments),  # elevator, trailing edge down +
        *_REST,
    )
    controls = {
        **{f"de_{s}": f"ext/elevator-{s}-rad" for s in segments},
        "da_l": "ext/aileron-left-rad",
        "da_r": "ext/aileron-right-rad",
        "dr": "ext/rudder-rad",
        "stab": "ext/stabilizer-rad",
        **{f"throttle_{i + 1}": f"fcs/throttle-cmd-norm[{i}]" for i in range(engines)},
        **{f"thrust_loss_{i + 1}": _ENGINE.format(i) + "bleed-factor" for i in range(engines)},
    }
    truth = dtype([(name, "f8", unit) for name, _, _, unit in signals])
    return Border(truth, tuple((name, factor) for _, name, factor, _ in signals), controls)


@kernel
def last_step(out, size, reference, station, chord):
    """Finish the truth that is scaled to SI: n = F / (m g0) of this frame's forces, cg from a station, and the angle
    and the speed over the ground.

    `out` has `size` numbers; `reference` is the fraction of the mean chord at `station` [in], `chord` the mean chord
    [in].
    """
    weight = out[_MASS] * G0
    for i in range(_NX, _NX + 3):
        out[i] = out[i] * 4.4482216152605 / weight
    out[_CG] = reference + (out[_CG] - station) / chord
    u, v, w = out[size + _U], out[size + _U + 1], out[size + _U + 2]
    out[size + _AG] = math.atan2(w, u)
    out[size + _VG] = math.sqrt(u * u + v * v + w * w)
