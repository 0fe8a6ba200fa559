"""[Jay]: the symbols that are recovered from the printed matrices, and those of the elevator."""

import numpy as np
import pytest

from actuators.ema import jay


def test_the_unloaded_motor_turns_free_of_the_spring():
    A = jay.continuous("nozzle").A
    assert A[1, 0] * A[3, 2] == pytest.approx(A[1, 2] * A[3, 0], rel=1e-15)
    assert np.abs(np.linalg.eigvals(A)).min() < 1e-9


def test_table_of_recovered_parameters():
    """The recovered entries to 5e-6: their six digits miss a21 a43 = a23 a41 by that much."""
    A = jay.continuous("nozzle").A
    got = [-A[1, 0], -A[1, 1], A[1, 2], A[3, 0], -A[3, 2], A[3, 4], -A[4, 3], -A[4, 4]]
    table = [10025.9, 4.61611, 80.2301, 339214, 2714.47, 603.297, 95.2571, 8210.38]
    np.testing.assert_allclose(got, table, rtol=5e-6)


def test_elevator_set_stalls_and_runs_as_stated():
    v = jay.values("elevator")
    amperes, volts = jay.LIMITS["elevator"]
    assert v["K_T"] * amperes * v["arm"] / v["lead"] == pytest.approx(15.75e3)
    assert np.degrees(volts / v["K_B"] * v["lead"] / v["arm"]) == pytest.approx(45, abs=0.5)


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match="unknown set"):
        jay.continuous("rudder")
    with pytest.raises(ValueError, match="unknown symbol"):
        jay.continuous("nozzle", K_x=1.0)
