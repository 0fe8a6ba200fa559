"""Shared decision stage: small kernels that turn residuals into alarms, on plain numbers and small arrays."""

import math

from actuators.block import kernel


@kernel
def held(value, valid, last):
    """Return the measurement, or the last one when it is flagged invalid or not finite."""
    if valid > 0.5 and math.isfinite(value):
        return value
    return last


@kernel
def usable(value, valid):
    """Return 1.0 where a measurement is flagged valid and finite, else 0.0."""
    if valid > 0.5 and math.isfinite(value):
        return 1.0
    return 0.0


@kernel
def confirm(timer, alarm, beyond, dt, t_confirm, t_release):
    """Return (timer, alarm) after one tick of a threshold test with confirmation and release.

    `timer` [s] grows while the residual is beyond its threshold, else shrinks, within 0 .. t_confirm + t_release.
    The alarm sets when it reaches t_confirm, and heals when it is back at zero: crossing now and then does not chatter.
    """
    if beyond:
        timer = min(timer + dt, t_confirm + t_release)
    else:
        timer = max(timer - dt, 0.0)
    # half a tick of slack: sums of dt are not exact
    if timer >= t_confirm - 0.5 * dt and beyond:
        if alarm < 0.5:
            timer = t_confirm + t_release
        alarm = 1.0
    elif timer < 0.5 * dt:
        alarm = 0.0
    return timer, alarm
