"""Reference aircraft of Sun13's fault estimator, and what E needs; the models are in tests/papers."""

import numpy as np
import pytest
from rfafe_aircraft import heffley_jewell

from fdi.rfafe import rfafe


def test_reference_table_is_the_one_in_the_report():
    """The 747's printed short period of flight condition 9: 0.964 rad/s, damping 0.387 [CR-2144]."""
    eigenvalues = np.linalg.eigvals(heffley_jewell("9")[0])
    short = eigenvalues[np.argmax(abs(eigenvalues))]
    assert abs(short) == pytest.approx(0.964, abs=0.005)
    assert -short.real / abs(short) == pytest.approx(0.387, abs=0.005)


def test_rank_of_outputs_is_needed_for_E():
    A, B = heffley_jewell("6")
    with pytest.raises(ValueError, match=r"rank\(C\) = 3 < n = 4"):
        rfafe.estimate_E(A, B, np.eye(4)[:3], [], dt=0.005)
