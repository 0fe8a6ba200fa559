"""What a fault does to the aircraft, in numbers."""

import numpy as np
import pytest

from actuators.constants import M_S_PER_KT
from cosim.judge.consequences import NAMES, consequences

DT, CAS = 0.1, (50.0, 200.0)


def steady(n=100):
    """Return the motion of `n` ticks of level flight at 100 m/s."""
    one = np.ones(n)
    return {"nz": one.copy(), "h": 6000 * one, "phi": 0 * one, "cas": 100 * one, "alpha": 0.03 * one}


def told(motion, hinge, onset, size=1000):
    """Return the flight from its onset on, in blocks of `size` ticks."""
    for a in range(onset, hinge.shape[1], size):
        b = slice(a, a + size)
        yield {name: values[b] for name, values in motion.items()}, [moment[b] for moment in hinge]


def test_level_flight_has_no_excursions():
    found = consequences(told(steady(), np.zeros((4, 100)), 40), DT, CAS)
    assert list(found) == list(NAMES)
    assert found["nz_min_g"] == found["nz_max_g"] == 1.0
    assert all(found[name] == 0.0 for name in NAMES[2:])


def test_excursions_count_from_the_onset_on():
    m, hinge = steady(), np.zeros((4, 100))
    m["nz"][10], m["nz"][50], m["nz"][60] = 5.0, 2.6, -1.5
    m["h"][70:], m["phi"][80] = 5900.0, np.radians(-70.0)
    m["cas"][90], m["cas"][91] = 100 - 5 * M_S_PER_KT, 100 + 3 * M_S_PER_KT
    hinge[0, 20], hinge[2, 95] = 1e5, -2000.0
    found = consequences(told(m, hinge, 40), DT, CAS)
    assert consequences(told(m, hinge, 40, size=7), DT, CAS) == found
    assert (found["nz_min_g"], found["nz_max_g"], found["altitude_lost_m"]) == (-1.5, 2.6, 100.0)
    assert found["bank_deg"] == pytest.approx(70.0) and found["hinge_max_nm"] == 2000.0
    assert found["speed_lost_kt"] == pytest.approx(5.0) and found["speed_gained_kt"] == pytest.approx(3.0)
    assert found["outside_s"] == pytest.approx(3 * DT)  # two load factors and a bank
    assert consequences(told(m, hinge, 100), DT, CAS) is None
