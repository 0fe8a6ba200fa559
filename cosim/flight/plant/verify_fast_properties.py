"""Comparison of every property read by address with Python's getter, over a flight of 300 ticks flown twice."""

import ctypes

import numpy as np

from cosim.flight.plant.fast_properties import DIFFERS, OFFSETS, access, jsbsim_library
from cosim.flight.plant.plant import GUST_WRITE, Plant
from cosim.flight.plant.point import FlightPoint

TICKS = 300


def verify() -> str:
    """Return the offset of a node's address in its Python object, DIFFERS where a value is another one. A wrong address
    may end this process: call it in one of its own."""
    by_calls, by_address = Plant(FlightPoint()), Plant(FlightPoint())
    trim = by_calls.trim()
    by_address.trim()
    kind = type(by_calls.port.node("simulation/sim-time-sec"))
    offset, file = kind.__basicsize__ - 8, jsbsim_library()
    how = access(file, offset) if file and kind.__dictoffset__ == 0 and offset in OFFSETS else None
    if how is None:
        return DIFFERS
    get = ctypes.PYFUNCTYPE(ctypes.c_double, ctypes.c_void_p)(how.get)
    put = ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, ctypes.c_double)(how.put)
    gusts = [[plant.port.node(name) for name in GUST_WRITE] for plant in (by_calls, by_address)]
    read, write = (how.nodes(nodes).tolist() for nodes in (by_address.reads, by_address.writes + gusts[1]))
    if len(set(write)) < len(write):
        return DIFFERS
    for k in range(TICKS):
        surfaces = trim.surfaces * (1.0 + 0.02 * np.sin(0.05 * k + np.arange(len(trim.surfaces))))
        by_calls.write(surfaces)
        gust = (0.3 * np.sin(0.1 * k + np.arange(len(GUST_WRITE)))).tolist()
        for node, value in zip(gusts[0], gust):
            node.set_double_value(value)
        for node, value in zip(write, [*surfaces.tolist(), *gust], strict=True):
            put(node, value)
        by_calls.run()
        by_address.run()
        seen = [np.array([node.get_double_value() for node in plant.reads]) for plant in (by_calls, by_address)]
        seen.append(np.array([get(node) for node in read]))
        if not seen[0].tobytes() == seen[1].tobytes() == seen[2].tobytes():
            return DIFFERS
    return str(offset)
