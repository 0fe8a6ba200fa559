"""Design of Sun13's fault estimator: defining equations, known and random aircraft, what is refused and why."""

import re
from pathlib import Path

import numpy as np
import pytest
from rfafe_aircraft import CONDITIONS, E_SPEED, FIGHTER, NAVION, global_of, heffley_jewell

from actuators.constants import RAD_PER_DEG
from fdi import rfafe
from fdi.common import lmi
from fdi.common.conditions import detectable

pytest.importorskip("cvxpy")
REGION = rfafe.Region(20.0, 15.0, 8.0)


def check(d):
    """Check (5), (16), the poles in their region, a stable loop of (e_x, e_f) and f_hat of 0.5 to 2 Hz of a Design."""
    assert np.linalg.norm((np.eye(len(d.A)) - d.H @ d.C) @ d.E) <= 1e-9 * max(np.linalg.norm(d.E), 1e-12)
    TF, gain = d.T @ d.F, d.Gamma @ d.M @ d.C
    assert np.linalg.norm(TF.T @ d.P - d.M @ d.C) <= 1e-6 * np.linalg.norm(TF.T @ d.P)
    assert d.region.holds(np.linalg.eigvals(d.N)).all()
    loop = np.block([[d.N - TF @ gain, -d.alpha * TF], [gain, np.zeros((TF.shape[1],) * 2)]])
    assert np.linalg.eigvals(loop).real.max() < 0.0


@pytest.mark.parametrize("name", CONDITIONS)
@pytest.mark.parametrize("E", [None, E_SPEED])
def test_published_form_designs_for_every_flight_condition(name, E):
    A, B, C, D = global_of(*heffley_jewell(name))
    d = rfafe.design(A, B, C, D, E, B, dt=0.005, region=REGION, bandwidth=40.0)
    check(d)
    assert np.linalg.eigvals(d.Gamma @ (d.T @ d.F).T @ d.P @ d.T @ d.F).real == pytest.approx((40.0, 40.0))
    assert all(0.95 < abs(d.tracking(hz)) < 1.05 for hz in (0.5, 1.0, 2.0))


@pytest.mark.parametrize("units", [(1.0,) * 4, (1.0, *(RAD_PER_DEG,) * 3), (0.001, 1e3, 1e2, 57.0)])
@pytest.mark.parametrize("plant", ["navion", "6", "9"])
def test_airframe_form_in_any_units(plant, units):
    A, B = NAVION if plant == "navion" else heffley_jewell(plant)
    S = np.diag(units)
    A, B = S @ A @ np.linalg.inv(S), S @ B
    d = rfafe.design(A, B, np.eye(4), None, None, B, dt=0.005)
    check(d)
    assert all(0.95 < abs(d.tracking(hz)) < 1.05 for hz in (0.5, 1.0, 2.0))


def random_plant(seed):
    """Return A, B, C, D, E, F of a random plant in random units, which a design may or may not exist for."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(3, 9)), int(rng.integers(2, 7))
    m, l = min(m, n), int(rng.integers(1, 3))
    q = int(rng.integers(0, m - l + 1)) if m > l else 0
    A, units = rng.normal(size=(n, n)) - 0.5 * np.eye(n), np.diag(10.0 ** rng.uniform(-2, 2, n))
    B, E, F, C = rng.normal(size=(n, 2)), rng.normal(size=(n, q)), rng.normal(size=(n, l)), rng.normal(size=(m, n))
    inverse = np.linalg.inv(units)
    return units @ A @ inverse, units @ B, C @ inverse, None, units @ E, units @ F


@pytest.mark.parametrize("seed", [*range(12), *(pytest.param(s, marks=pytest.mark.slow) for s in range(12, 40))])
def test_any_plant_is_designed_or_refused_with_the_reason(seed):
    try:
        check(rfafe.design(*random_plant(seed), dt=0.005, min_ratio=0.0))
    except ValueError as error:
        assert any(word in str(error) for word in ("condition (", "fixed modes", "no P, Y satisfy"))


def test_each_condition_says_that_it_fails_and_by_how_much():
    A, B, C, _ = global_of(*heffley_jewell("4"))
    F, theta = B[:, :1], np.eye(6)[:, 3:4]
    cases = [
        (C[4:], np.eye(6)[:, :1], F, r"condition \(i\).*rank\(CE\) = 0 < rank\(E\) = 1"),
        (C[:1], np.eye(6)[:, 1:3], F, r"condition \(i\).*2 unknown inputs, 1 outputs"),
        (C[:4], None, F, r"condition \(ii\).*rank\(CF\) = 0"),
        (C, None, np.hstack([F, 2 * F]), r"condition \(ii\).*parallel"),
        (C, np.hstack([F, theta]), F, r"condition \(iii\)"),
        (np.delete(C, 3, 0), np.eye(6)[:, :2], F, r"condition \(iv\).*mostly state 3"),
    ]
    for c, E, f, message in cases:
        with pytest.raises(rfafe.DesignError, match=message):
            rfafe.design(A, B, c, None, E, f, dt=0.005)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"A": np.zeros((5, 6))}, r"A is \(5, 6\)"),
        ({"B": np.zeros((4, 2))}, r"B is \(4, 2\)"),
        ({"E": np.zeros((3, 1))}, r"E is \(3, 1\)"),
        ({"F": None}, "^F has no column$"),
        ({"A": np.full((6, 6), np.nan)}, "^A holds a value"),
        ({"D": np.full((6, 2), np.inf)}, "^D holds a value"),
        ({"C": np.eye(6) * 1j}, "^C holds a value that is complex"),
        ({"region": rfafe.Region(-20.0, 10.0, 1.0)}, "is empty: centre > 0"),
        ({"sigma": [1.0, 2.0]}, "sigma is one positive number per output"),
        ({"sigma": [0.0, 1, 1, 1, 1, 1]}, "sigma is one positive"),
        ({"dt": -1.0}, "dt is a positive number, not -1"),
        ({"alpha": 0.0}, "alpha is a positive number"),  # with a fixed mode these went round for ever
        ({"bandwidth": np.nan}, "bandwidth is a positive number"),
    ],
)
def test_what_is_no_model_is_refused_by_name(change, message):
    A, B, C, D = global_of(*heffley_jewell("6"))
    given = {"A": A, "B": B, "C": C, "D": D, "E": None, "F": B, "dt": 0.005} | change
    with pytest.raises(rfafe.DesignError, match=message):
        rfafe.design(**given)


def test_a_decoupled_state_in_odd_units_and_outputs_that_are_there_twice():
    """Rounding in the row of the decoupled state once passed for a coupling; twice the outputs are no new ones."""
    S = np.diag([1e3, 1e-3, 1e2, 1.0])
    A, B = heffley_jewell("3")
    A, B, C, _ = global_of(S @ A @ np.linalg.inv(S), S @ B, a=5.0)
    twice = np.vstack([C, 2 * C[:4]])
    for E in (np.eye(6)[:, :1], np.eye(6)[:, :2]):
        check(rfafe.design(A, B, twice, None, E, B, dt=0.005))


@pytest.mark.parametrize("rank", [0, 1, 2])
@pytest.mark.parametrize("plant", [NAVION, FIGHTER])
def test_light_and_unstable_aircraft_with_unknown_inputs(plant, rank):
    A, B, C, D = global_of(*plant)
    check(rfafe.design(A, B, C, D + 0.1, np.eye(6)[:, :rank] if rank else None, B, dt=0.005))


def test_undetectable_unstable_mode_is_named():
    with pytest.raises(rfafe.DesignError, match=r"condition \(iv\).*0\.3"):
        detectable(np.diag([0.3, -1.0, -2.0]), np.eye(3)[1:])


def test_unknown_input_beside_the_fault_is_refused_or_separated():
    A, B = heffley_jewell("6")
    E = np.hstack([B + np.array([[0.0], [0.15], [0.0], [0.0]]), np.eye(4)[:, :1]])
    with pytest.raises(rfafe.DesignError, match=r"\|TF\|/\|F\| is 0\.1"):
        rfafe.design(A, B, np.eye(4), None, E, B, dt=0.005)
    d = rfafe.design(A, B, np.eye(4), None, rfafe.separate(E, B, np.eye(4)), B, dt=0.005)
    check(d)
    assert d.E.shape[1] == 2


def test_a_disk_too_fast_for_alpha_is_refused_with_an_alpha_to_try():
    A, B, C, D = global_of(*heffley_jewell("6"))
    with pytest.raises(lmi.Infeasible, match=r"no P, Y satisfy .* alpha = 2 .* try alpha of 13\.3 and above"):
        rfafe.design(A, B, C, D, None, B[:, :1], dt=0.005, region=rfafe.Region(40.0, 5.0, 30.0), alpha=2.0)


def test_the_example_of_the_readme_finds_its_fault(capsys):
    text = (Path(__file__).parents[2] / "fdi" / "README.md").read_text(encoding="utf-8")
    (code,) = (c for c in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "rfafe" in c)
    exec(code, {})
    assert float(capsys.readouterr().out) == pytest.approx(0.01, rel=0.02)


def test_rank_of_outputs_is_needed_for_E():
    A, B = heffley_jewell("6")
    with pytest.raises(ValueError, match=r"rank\(C\) = 3 < n = 4"):
        rfafe.estimate_E(A, B, np.eye(4)[:3], [], dt=0.005)
