"""FlightGear is told of a flight by JSBSim's own output: packets on the loopback, and nothing of the flight changes."""

import socket
import struct

import pytest

import cosim

PACKET, VERSION = 408, 24  # FGNetFDM of FlightGear's native protocol


@pytest.fixture
def window():
    """Give a UDP socket in FlightGear's place; what it got is read with `packets`."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        s.settimeout(0.3)
        yield s


def packets(s):
    out = []
    with pytest.raises(TimeoutError):
        while True:
            out.append(s.recv(4096))
    return out


def place(packet):
    """Return (version, altitude [m], roll, pitch [rad]) of a packet: longitude, latitude, altitude as doubles, then
    agl, phi, theta, psi as floats."""
    version, _, _, _, altitude, _, phi, theta = struct.unpack_from(">II3d3f", packet)
    return version, altitude, phi, theta


def test_a_viewer_gets_fifty_frames_a_second_of_what_flies(window):
    keys = ["detectors.enabled=[]", "flight.bank_deg=20", "flight.turbulence=none", "duration_s=4"]
    flight = cosim.Flight(cosim.load_scenario("cruise", keys), flightgear=window.getsockname()[1])
    assert packets(window) == []  # nothing of trims and models
    flight.step(200)
    got = packets(window)
    assert len(got) == 50 and {len(p) for p in got} == {PACKET}
    version, altitude, phi, theta = place(got[-1])
    signals = flight.signals
    assert version == VERSION and altitude == pytest.approx(signals["/truth/aircraft.h"], abs=0.1)
    assert phi == pytest.approx(signals["/truth/aircraft.phi"], abs=1e-3)
    assert theta == pytest.approx(signals["/truth/aircraft.theta"], abs=1e-3)
    flight.inject(target="elevator.left_inner", kind="jam_solid")  # flies to here again, unseen
    assert packets(window) == []
    flight.step(40)
    assert len(packets(window)) == 10


def test_a_watched_flight_is_the_same_to_the_last_bit(window):
    scenario = cosim.load_scenario("liquid-ofc", ["duration_s=1", "flight.turbulence=light"])
    alone, shown = cosim.Flight(scenario), cosim.Flight(scenario, flightgear=window.getsockname()[1])
    for flight in (alone, shown):
        flight.step(200)
    assert alone.values.tobytes() == shown.values.tobytes() and len(packets(window)) == 50
