"""Factors between units are named by direction: one and its reverse give 1, and equal what the unit is defined as."""

import math

import pytest

from actuators import constants as c


def test_a_factor_times_its_reverse_is_one():
    names = {n for n in vars(c) if "_PER_" in n and isinstance(getattr(c, n), float)}
    pairs = [(n, "_PER_".join(reversed(n.split("_PER_")))) for n in sorted(names)]
    both = [(a, b) for a, b in pairs if b in names]
    assert len(both) == 6
    for a, b in both:
        assert getattr(c, a) * getattr(c, b) == pytest.approx(1.0, rel=1e-15), (a, b)


def test_factors_are_those_of_the_definitions():
    assert math.degrees(1.0) == c.DEG_PER_RAD and pytest.approx(12.0 * c.M_PER_IN) == c.M_PER_FT
    assert 3600.0 * c.M_S_PER_KT == pytest.approx(1852.0)  # a nautical mile
    assert c.N_PER_LBF == pytest.approx(0.45359237 * c.G0)  # a pound
    assert c.KG_PER_SLUG * c.M_PER_FT == pytest.approx(c.N_PER_LBF)  # a slug: what a pound-force moves by 1 ft/s2
    assert c.PA_PER_PSF * c.M_PER_FT**3 == pytest.approx(c.N_M_PER_LBF_FT)
