"""FlightGear as a window on a flight: JSBSim's own output in FlightGear's native protocol, by UDP to this machine.

    fgfs --fdm=null --native-fdm=socket,in,50,,5500,udp         beside        cosim run cruise --live --flightgear 5500
"""

import contextlib
import os
import tempfile
from collections.abc import Iterator

HOST, RATE = "127.0.0.1", 50  # frames a second of the flight
DIRECTIVE = """<?xml version="1.0"?>
<output name="{host}" type="FLIGHTGEAR" port="{port}" protocol="UDP" rate="{rate}"/>
"""


@contextlib.contextmanager
def directive(port: int) -> Iterator[str]:
    """Write JSBSim's output directive for FlightGear at UDP `port`, and give its path; it is read at once."""
    with tempfile.TemporaryDirectory(prefix="cosim-") as folder:
        path = os.path.join(folder, "flightgear.xml")
        with open(path, "w", encoding="ascii") as file:
            file.write(DIRECTIVE.format(host=HOST, port=port, rate=RATE))
        yield path
