"""The actuator technologies that ship, a line each."""

from actuators.ema.record import TECHNOLOGY as EMA
from actuators.hydraulic.record import TECHNOLOGY as HYDRAULIC
from actuators.simple.record import TECHNOLOGY as SIMPLE

SHIPPED = HYDRAULIC, EMA, SIMPLE
