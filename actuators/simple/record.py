"""What the testbed knows about the plain actuator: its record (see actuators/technology.py)."""

import dataclasses
import math

from actuators.common import linkage
from actuators.technology import SURFACE, Design, Effect, Technology


def _modules():
    from actuators.simple import actuator

    return None, actuator


def _design(own):
    return Design(arm=linkage.ARM, drive=math.nan, probe=math.nan, stall_moment=math.inf)


TECHNOLOGY = Technology(
    name="simple",
    article="a simple",
    modules=_modules,
    design=_design,
    # built with the other surfaces that have plain actuators, in one block (cosim/flight/blocks/actuation.py)
    sensors={"surface": dataclasses.replace(SURFACE, may_fail=False)},
    effects={"jam_solid": Effect("jam"), "loss_of_effectiveness": Effect("loss")},
)
