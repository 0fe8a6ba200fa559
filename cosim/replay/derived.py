"""Signals that no channel holds, made from those that the map has: a rate from its angle, an angle from the path.

    hdot = { derivative_of = "h_baro" }
    qdot = { derivative_of = "q" }
    alpha_ground = { path_of = "theta" }     # theta less the angle of the path, by hdot, tas and phi

A rate is the central difference of the channel's own samples: late by nothing, and noisier than a measurement. The
angle solves hdot / V = sin(theta) cos(alpha) - cos(theta) cos(phi) sin(alpha), without sideslip; V is the airspeed, so
that the wind is in it. Both are proxies, and the report says so.
"""

from typing import Any

import numpy as np

from cosim.replay.params import ReplayError
from cosim.scenario.vocabulary import find

STEPS = 2  # of a channel's own samples on either side of a derivative
PATH = ("theta", "hdot", "tas")  # and phi, where the map has it


def derived(m: Any, channels: dict, place: Any) -> dict:
    """Return `channels` {signal: (times, samples, flags)} with the derived signals of the map, in SI.

    Raises ReplayError where a signal that one is made from has no channel.
    """
    out = dict(channels)
    rates = [name for name, s in m.signals.items() if s.derivative_of]
    paths = [name for name, s in m.signals.items() if s.path_of]
    for name in rates:
        t, y = _si(m, out, name, m.signals[name].derivative_of, place)
        out[name] = t, _rate(t, y), None
    for name in paths:
        if m.signals[name].path_of != "theta":
            raise ReplayError(
                "is an angle of the path by theta alone", place=f"{place}: signals.{name}.path_of", allowed="theta"
            )
        out[name] = *_path(m, out, name, place), None
    return out


def _si(m, channels, name, base, place):
    """Return (times, samples in SI) of the signal `base`, from which `name` is made."""
    if base not in channels:
        raise ReplayError(
            f"{name} is made from {base}, which has no channel",
            place=f"{place}: signals.{name}",
            allowed=", ".join(sorted(channels)),
        )
    t, y, flags = channels[base]
    if m.signals[base].derivative_of is None:  # a derived one is in SI already
        y = m.signals[base].factor(find(base).unit) * y + m.signals[base].offset
    if flags is not None:
        y = np.where(np.interp(t, flags[0], flags[1]) > 0.5, y, np.nan)
    return t, y


def _rate(t, y):
    """Return the central difference of y over 2 STEPS samples; NaN at the ends."""
    out = np.full(len(y), np.nan)
    width = t[2 * STEPS :] - t[: -2 * STEPS]
    with np.errstate(divide="ignore", invalid="ignore"):
        out[STEPS:-STEPS] = np.where(width > 0.0, (y[2 * STEPS :] - y[: -2 * STEPS]) / width, np.nan)
    return out


def _path(m, channels, name, place):
    """Return (times, theta less the angle of the path) at the times of theta."""
    t, theta = _si(m, channels, name, "theta", place)
    climb, speed = (np.interp(t, *_si(m, channels, name, n, place)) for n in ("hdot", "tas"))
    phi = np.interp(t, *_si(m, channels, name, "phi", place)) if "phi" in channels else np.zeros(len(t))
    up, across = np.sin(theta), np.cos(theta) * np.cos(phi)
    size = np.hypot(up, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = climb / (speed * size)
        alpha = np.arccos(share) - np.arctan2(across, up)
    return t, np.where((speed > 1.0) & (np.abs(share) < 1.0), alpha, np.nan)
