"""LPV sliding-mode observer: design at the vertices, reconstruction on the LPV plant, behaviour of the block."""

import functools

import lpv_transport as transport
import numpy as np
import pytest

from actuators.constants import RAD_PER_DEG
from fdi.common.verdict import AMBIGUOUS, OFC_LIQUID, SENSOR
from fdi.lpv_smo import kernels as lpv_kernels
from fdi.lpv_smo import lpv_smo
from fdi.lpv_smo import model as lpv_model
from fdi.lpv_smo import synthesis as lpv_smo_design

M = np.array([[1.0, 0, 0, 0, 0], [0, 0, 0, 1.0, 0]]).T  # (36)


@functools.cache
def made():
    m = transport.model()
    return lpv_smo.design(m.A, m.B, m.C, m.D, box=m.box, M=M)


def run(rho, *, flight=None, **kw):
    options = {"tau_rho": 0.5} | kw
    p = lpv_smo.params(model=transport.model(), made=made(), **options)
    u = transport.fly(transport.model(), rho, lpv_smo, **(flight or {}))
    log = np.zeros(u.shape, lpv_smo.STATE)
    lpv_smo.rollout(lpv_smo.init(p), u, p, (flight or {}).get("h", 0.005), log)
    return log[0], u


@pytest.mark.parametrize("point", transport.POINTS)
def test_simultaneous_faults_come_out_within_one_per_cent_on_the_lpv_plant(point):
    log, _ = run(np.array(transport.POINTS[point], float))
    end = log[-1000:]  # the last five seconds
    assert end["f_hat_elevator"].mean() / RAD_PER_DEG == pytest.approx(3.0, rel=0.01)
    assert end["f_hat_n_z"].mean() == pytest.approx(0.5, rel=0.01)
    assert end["f_hat_alpha"].mean() / RAD_PER_DEG == pytest.approx(5.0, rel=0.01)
    assert 0.03 < end["f_hat_n_z_raw"].mean() / 0.5 - 1 < 0.08  # as printed: 3 to 7 % wrong, 8 % at the lightest point
    assert log["e_norm"].max() <= 1e-3
    before = log[500:2000]
    for name in ("f_hat_elevator", "f_hat_alpha"):
        assert np.abs(before[name]).max() < 0.01 * RAD_PER_DEG


def test_sensor_noise_does_not_saturate_the_injection():
    log, _ = run(np.array(transport.POINTS["E"], float), flight={"noise": 1.0})
    assert (log["nu_norm"] < 0.95).mean() >= 0.95
    measured = log["f_hat_elevator"][1000:2000].std()
    assert measured == pytest.approx(log["f_sigma"][1500], rel=0.35)  # correlated over 0.2 s: 25 independent values


def test_unsmoothed_speed_would_saturate_it_more():
    """Why V is smoothed: 0.05 m/s per sample is 14 m/s2 of injection, half of K."""
    smooth, _ = run(np.array(transport.POINTS["E"], float), flight={"noise": 1.0})
    raw, _ = run(np.array(transport.POINTS["E"], float), flight={"noise": 1.0}, tau_v=0.0)
    assert raw["nu_norm"].mean() > 1.3 * smooth["nu_norm"].mean()


def test_halving_the_step_changes_no_fault_by_more_than_two_per_mille():
    rho = np.array(transport.POINTS["E"], float)
    coarse, _ = run(rho)
    fine, _ = run(rho, flight={"h": 0.0025})
    t = np.arange(len(coarse)) * 0.005
    away = (t > 1) & ((t < 10) | (t > 10.5))
    for name in ("f_hat_elevator", "f_hat_n_z", "f_hat_alpha"):
        change = np.abs(coarse[name] - fine[name][::2])[away].max()
        assert change <= 0.002 * np.abs(coarse[name]).max(), name


def test_a_step_of_the_fault_is_smoothed_as_documented():
    log, _ = run(np.array(transport.POINTS["E"], float), flight={"faults": (3.0, 0.0, 0.0)})
    after = log["f_hat_elevator"][2000 + 92]  # 0.46 s
    assert after / (3 * RAD_PER_DEG) == pytest.approx(0.9, abs=0.02)


def test_the_design_holds_when_it_is_substituted_back():
    report = lpv_smo.verify(made())
    assert report["lmi"] <= 1e-6 and report["p_min"] >= 1 - 1e-9
    assert -200 <= report["pole_fastest"] <= report["pole_slowest"] <= -5
    assert report["w_f"] < 1e-12 and report["l_f"] < 1e-12


def test_a_spoilt_design_does_not_verify():
    import dataclasses

    spoilt = dataclasses.replace(made(), gamma=0.5 * made().gamma)
    assert not lpv_smo.verify(spoilt)["ok"]
    assert not lpv_smo.verify(dataclasses.replace(made(), L=-made().L))["ok"]


def test_the_certified_gain_is_not_exceeded_at_any_vertex():
    """Frequency response of the sliding motion, computed without the LMI: at most gamma."""
    d = made()
    n1 = d.L.shape[0]
    for r in lpv_model.vertices(d.box):
        a = lpv_model.at(d.A, r)
        A11, A12, A21, A22 = a[:n1, :n1], a[:n1, n1:], a[n1:, :n1], a[n1:, n1:]
        S = d.y_from @ np.diag(d.delta_2)
        X = d.M @ np.diag(d.delta_1)
        Ac = np.block([[A11 + d.L @ A21, A12 + d.L @ A22 + d.a_f * d.L], [np.zeros((6, n1)), -d.a_f * np.eye(6)]])
        Bc = np.block([[-(X[:n1] + d.L @ X[n1:]), -d.a_f * d.L @ S], [np.zeros((6, X.shape[1])), d.a_f * S]])
        Cc = np.hstack([-d.W @ A21, -d.W @ (A22 + d.a_f * np.eye(6))])
        Dc = np.hstack([d.W @ X[n1:], d.a_f * d.W @ S])
        for w in np.r_[0, np.logspace(-4, 3, 60)]:
            gain = np.linalg.norm(Cc @ np.linalg.solve(1j * w * np.eye(len(Ac)) - Ac, Bc) + Dc, 2)
            assert gain <= d.gamma * (1 + 1e-6)


def test_the_observer_equals_its_textbook_form():
    """(12)-(15) with G_l, G_n written out and integrated at 10 us agree with the block's decoupled implicit step."""
    m, d = transport.model(), made()
    rho = np.array(transport.POINTS["E"], float)
    flight = {"seconds": 1.0, "faults": (2.0, 0.2, 1.0), "at": 0.2}
    log, u = run(rho, flight=flight, tau_v=0.0)
    a, b = lpv_model.at(d.A, rho), lpv_model.at(d.B, rho)
    x_eq, u_eq, y_eq = lpv_model.trim_at(m, rho)
    A22s = np.diag(d.A22s)
    G_l = np.zeros((7, 6))
    G_l[1:] = a[1:, 1:] - a[1:, :1] @ d.L - A22s
    G_l[:1] = a[:1, 1:] + d.L @ a[1:, 1:] - (a[:1, :1] + d.L @ a[1:, :1]) @ d.L - d.L @ G_l[1:]
    G_n = np.vstack([-d.L, np.eye(6)])
    P_o = np.diag(-0.5 / d.A22s)
    s = log["s"] - np.r_[x_eq[1:], y_eq[4:]]
    n = 500
    e0 = log["w"][0] - d.L[0] @ log["s"][0] - x_eq[0]
    x = np.r_[e0, s[0]]
    h = 0.005 / n
    for k in range(1, 200):
        du = np.array([u["de_lo"][0, k - 1] / RAD_PER_DEG - u_eq[0], 0.0])
        for i in range(n):
            y = s[k - 1] + (s[k] - s[k - 1]) * i / n
            e = x[1:] - y
            w = P_o @ e
            nu = -30.0 * w / (np.linalg.norm(w) + 1e-4)
            x = x + h * (a @ x + b @ du - G_l @ e + G_n @ nu)
    assert d.W[0] @ nu == pytest.approx(d.W[0] @ log["nu"][199], rel=0.02)
    assert x[0] == pytest.approx(log["alpha_hat"][199] / RAD_PER_DEG - x_eq[0], abs=0.02)


def test_the_implicit_step_solves_its_own_equation():
    rng = np.random.default_rng(3)
    a22 = -(10 + 0.1 * np.arange(1, 7))
    for scale in (1e-8, 1e-4, 1.0, 1e3):
        b, e = scale * rng.normal(size=6), np.zeros(6)
        lpv_kernels.unit_vector_step(e, b, a22, 30.0, 1e-4, 0.005)
        p = -0.5 / a22
        nu = -30.0 * p * e / (np.linalg.norm(p * e) + 1e-4)
        np.testing.assert_allclose(e, b + 0.005 * (a22 * e + nu), rtol=1e-9, atol=1e-12 * scale)


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda m: m | {"C": _put(m["C"], (1, 0, 1), 1.0)}, "varies with rho"),
        (lambda m: m | {"D": _put(m["D"], (0, 3, 0), 1.0)}, "feedthrough"),
        (lambda m: m | {"B": _put(m["B"], (slice(None), 4, 0), [-0.54, 0, 0, 0, 1.0])}, "singular inside the box"),
        (lambda m: m | {"F": np.array([1.0, 0, 0, 0, 0])}, "not seen"),
        (lambda m: m | {"C": m["C"][:, 1:], "D": m["D"][:, 1:]}, "no L and W.*unmeasured mode"),  # altitude: too slow
        (lambda m: m | {"C": m["C"][:, [1, 3, 4]], "D": m["D"][:, [1, 3, 4]], "faulty": 1}, "no gain moves"),
        (lambda m: m | {"A": m["A"][:3]}, "affine terms"),
        (lambda m: m | {"B": m["B"] * np.nan}, "B holds a value that is not finite"),
        (lambda m: m | {"C": m["C"][:, :, :4]}, r"C is \(6, 4\), not \(6, 5\)"),
        (lambda m: m | {"actuator": (7,)}, "columns of B, of which there are 2"),
        (lambda m: m | {"poles": (50.0, 20.0)}, "a slow and a faster bound"),
        (lambda m: m | {"A_f": [1.0]}, "A_f takes 2 finite numbers"),
        (lambda m: m | {"A22s": np.full(6, 3.0)}, "A22s are all negative"),
        (lambda m: m | {"delta_1": [1.0]}, "delta_1 takes 4 finite numbers"),
        (lambda m: m | {"F": np.ones(4)}, "F holds 4 numbers"),
    ],
)
def test_what_cannot_be_designed_says_why(change, message):
    m = transport.model()
    given = change({"A": m.A, "B": m.B, "C": m.C, "D": m.D})
    with pytest.raises(ValueError, match=message):
        lpv_smo.design(box=m.box, M=M, **given)


def _put(stack, where, value):
    out = stack.copy()
    out[where] = value
    return out


def test_a_box_that_is_upside_down_is_refused():
    m = transport.model()
    with pytest.raises(ValueError, match="lowest, highest"):
        lpv_smo.design(m.A, m.B, m.C, m.D, box=m.box[:, ::-1], M=M)


def test_what_is_constant_may_be_one_matrix_and_no_feedthrough_none():
    m = transport.model()
    B, C = lpv_model.at(m.B, m.box.mean(1)), m.C[0]
    one = lpv_smo.design(m.A, B, C, None, box=m.box, M=M)
    zero = [np.zeros((5, *x.shape)) for x in (B, C)]
    for stack, x in zip(zero, (B, C)):
        stack[0] = x
    same = lpv_smo.design(m.A, *zero, np.zeros((5, 6, 2)), box=m.box, M=M)
    np.testing.assert_allclose(one.L, same.L)


@pytest.mark.slow
def test_a_fifth_parameter_and_other_units_are_designed():
    m = transport.model()
    A = np.concatenate([m.A, 0.02 * m.A[:1]])
    rest = [np.concatenate([S, 0 * S[:1]]) for S in (m.B, m.C, m.D)]
    made_5 = lpv_smo.design(A, *rest, box=np.vstack([m.box, [-1.0, 1.0]]), M=M)
    assert lpv_smo.verify(made_5)["ok"] and len(lpv_model.vertices(made_5.box)) == 32
    rad, ft = RAD_PER_DEG, 3.28
    x, y = np.array([rad, ft, rad, ft, rad]), np.array([ft, rad, ft, rad, 1.0, rad])
    A, B, C, D = x[:, None] * m.A / x, x[:, None] * m.B / rad, y[:, None] * m.C / x, y[:, None] * m.D / rad
    assert lpv_smo.verify(lpv_smo.design(A, B, C, D, box=m.box))["ok"]


def test_another_transport_with_two_parameters_and_mixed_coordinates():
    """States transformed by a constant matrix give the same poles and gain: the design is coordinate-free."""
    m = transport.model()
    rng = np.random.default_rng(5)
    T = np.eye(5) + 0.2 * rng.normal(size=(5, 5))
    box = m.box[[0, 2]]
    mid = m.box.mean(1)

    def pick(S):
        return np.array([S[0] + mid[1] * S[2] + mid[3] * S[4], S[1], S[3]])

    A, B, C, D = (pick(S) for S in (m.A, m.B, m.C, m.D))
    Ti = np.linalg.inv(T)
    F = np.array([0, 0, 0, 0, 1.0])
    first = lpv_smo.design(A, B, C, D, box=box, M=M, F=F)
    second = lpv_smo.design(T @ A @ Ti, T @ B, C @ Ti, D, box=box, M=T @ M, F=T @ F)
    assert second.gamma == pytest.approx(first.gamma, rel=0.01)
    a, b = lpv_smo.verify(first), lpv_smo.verify(second)
    assert b["ok"] and b["pole_slowest"] == pytest.approx(a["pole_slowest"], rel=0.02)


def test_a_stored_design_comes_back_and_a_tampered_one_is_refused(tmp_path):
    path = tmp_path / "design.json"
    lpv_smo_design.save(transport.model(), made(), path)
    model, back = lpv_smo_design.load(path)
    np.testing.assert_array_equal(back.L, made().L)
    assert lpv_smo.verify(back)["ok"] and model.states == transport.model().states
    path.write_text(path.read_text().replace(repr(float(model.A[0, 4, 0])), repr(float(model.A[0, 4, 0]) * 1.001)))
    with pytest.raises(ValueError, match="is of another model"):
        lpv_smo_design.load(path)


def test_a_dropout_leaves_no_nan_and_the_estimates_come_back():
    p = lpv_smo.params(model=transport.model(), made=made())
    u = transport.fly(transport.model(), np.array(transport.POINTS["E"], float), lpv_smo)
    for name, first, last in (("q", 3000, 3040), ("alpha", 3200, 3300), ("cas", 3300, 3400), ("h", 0, 5)):
        u[name][0, first:last], u[name + "_valid"][0, first:last] = np.nan, 0.0
    u["de_lo"][0, 3500] = np.nan
    log = np.zeros(u.shape, lpv_smo.STATE)
    lpv_smo.rollout(lpv_smo.init(p), u, p, 0.005, log)
    for name in lpv_smo.STATE.names:
        assert np.isfinite(log[name][0, 10:]).all(), name
    assert log["valid"][0, 3010] == 0 and log["valid"][0, 3250] == 0
    assert log["f_hat_elevator"][0, -1] / RAD_PER_DEG == pytest.approx(3.0, rel=0.01)
    assert log["f_hat_alpha"][0, -1] / RAD_PER_DEG == pytest.approx(5.0, rel=0.01)


@pytest.mark.parametrize(
    "faults, verdict, culprit",
    [
        ((3.0, 0.0, 0.0), AMBIGUOUS, "elevator"),
        ((0.0, 0.5, 0.0), SENSOR, "n_z"),
        ((0.0, 0.0, 5.0), SENSOR, "alpha"),
        ((0.0, 0.0, 0.0), 0.0, ""),
    ],
)
def test_single_faults_are_named(faults, verdict, culprit):
    log, _ = run(np.array(transport.POINTS["E"], float), flight={"faults": faults, "noise": 1.0})
    assert log["alarm"][:2000].max() == 0
    end = log[2300:2600]
    assert set(end["verdict"]) == {verdict}
    assert {lpv_smo.CULPRITS[int(c)] for c in end["culprit"]} == {culprit}


def test_an_oscillating_elevator_is_called_an_oscillation():
    m, rho = transport.model(), np.array(transport.POINTS["E"], float)
    u = transport.fly(m, rho, lpv_smo, faults=(0.0, 0.0, 0.0))
    t = np.arange(u.shape[1]) * 0.005
    # an elevator that oscillates against a still command is a command that oscillates against a still elevator
    for name in ("de_lo", "de_li", "de_ri", "de_ro"):
        u[name][0] += 4.0 * RAD_PER_DEG * np.sin(2 * np.pi * 0.8 * t) * (t > 10)
    p = lpv_smo.params(model=m, made=made())
    log = np.zeros(u.shape, lpv_smo.STATE)
    lpv_smo.rollout(lpv_smo.init(p), u, p, 0.005, log)
    assert log["alarm"][0, :2000].max() == 0
    assert OFC_LIQUID in set(log["verdict"][0, 2000:3000])


def test_outside_its_box_the_observer_says_so():
    m, rho = transport.model(), np.array(transport.POINTS["E"], float)
    u = transport.fly(m, rho, lpv_smo)
    u["mass"] *= 0.6
    p = lpv_smo.params(model=m, made=made())
    log = np.zeros(u.shape, lpv_smo.STATE)
    lpv_smo.rollout(lpv_smo.init(p), u, p, 0.005, log)
    assert log["valid"].max() == 0 and log["alarm"].max() == 0


def test_a_moving_flight_point_does_not_move_the_estimate_of_alpha():
    """w is L Z large: forcing computed with two ticks' matrices would move alpha by a degree (found in flight)."""
    m, rho = transport.model(), np.array(transport.POINTS["E"], float)
    u = transport.fly(m, rho, lpv_smo, faults=(0.0, 0.0, 0.0), seconds=8.0)
    t = np.arange(u.shape[1]) * 0.005
    for name in ("de_lo", "de_li", "de_ri", "de_ro", "stab", "h", "theta", "V", "q", "n_z", "alpha"):
        u[name][0] = u[name][0, 0]  # steady, while the air data drift
    u["cas"] -= 2.0 * transport.KT * t
    u["mach"] -= 0.004 * t
    p = lpv_smo.params(model=m, made=made(), tau_rho=0.0)
    log = np.zeros(u.shape, lpv_smo.STATE)
    lpv_smo.rollout(lpv_smo.init(p), u, p, 0.005, log)
    assert np.abs(log["alpha_hat"][0] - u["alpha"][0]).max() < 0.1 * RAD_PER_DEG


def test_the_stored_design_belongs_to_the_aircraft_and_holds_the_fit_to_its_bounds():
    """On 3^4 points between those of the fit: entries, modes. A41, A44 and dM/dV no affine function reaches."""
    import json

    from cosim.training import designs
    from cosim.training import lpv as design_lpv

    assert designs.check("lpv_smo") == ""
    held = json.loads(design_lpv.STORED.read_text())
    fit, fixed = held["fit"], held["fixed"]
    # speed over alpha and speed, and dM/dV: no affine function reaches them
    reported = {("A", 3, 0), ("A", 3, 3), ("A", 4, 3)}
    for name in "ABCD":
        for place, error in np.ndenumerate(np.array(fit[name])):
            if not np.array(fixed[name])[place] and (name, *place) not in reported and np.isfinite(error):
                size = np.abs(np.array(held["model"][name])[:, place[0], place[1]]).max()
                assert error <= 0.15 or size < 1e-9, (name, place, error)
    assert max(fit["B"][4][0], fit["C"][4][0], fit["D"][4][0]) <= 0.10
    assert np.quantile(fit["wn_error"], 0.95) <= 0.08 and max(fit["zeta_error"]) <= 0.04
    assert max(fit["b51_vertices"]) < 0


@pytest.mark.parametrize("point", "ABCDE")
def test_the_stored_design_finds_simultaneous_faults_on_its_own_plant(point):
    from cosim.papers.alwi14 import plant as lpv_plant
    from cosim.papers.alwi14.rows import POINTS

    model, own = lpv_smo_design.load()
    u = lpv_plant.fly(model, np.array(POINTS[point][:4], float), lpv_smo, faults=(3.0, 0.5, 5.0))
    log = np.zeros(u.shape, lpv_smo.STATE)
    p = lpv_smo.params(model=model, made=own, bank=False)
    lpv_smo.rollout(lpv_smo.init(p), u, p, 0.005, log)
    late = log[0][-1000:]
    for name, true in (("f_hat_elevator", 3 * RAD_PER_DEG), ("f_hat_n_z", 0.5), ("f_hat_alpha", 5 * RAD_PER_DEG)):
        assert late[name].mean() == pytest.approx(true, rel=0.01)
    assert abs(late["f_hat_n_z_raw"].mean() / 0.5 - 1) > 0.01  # what (2) leaves out
    assert log["e_norm"].max() <= 1e-3


def test_a_design_for_another_aircraft_is_called_stale(tmp_path):
    import json

    from cosim.training import designs
    from cosim.training import lpv as design_lpv

    held = json.loads(design_lpv.STORED.read_text())
    (tmp_path / "lpv_smo.json").write_text(json.dumps(held | {"aircraft_sha256": "0" * 64}))
    assert "python -m cosim.training designs" in designs.check("lpv_smo", folder=tmp_path)
    held["design"]["gamma"] *= 0.5
    (tmp_path / "lpv_smo.json").write_text(json.dumps(held))
    assert "do not verify" in designs.check("lpv_smo", folder=tmp_path)
    held["model"]["A"][0][0][0] += 1.0
    (tmp_path / "lpv_smo.json").write_text(json.dumps(held))
    assert "is of another model" in designs.check("lpv_smo", folder=tmp_path)


def test_a_model_without_scheduling_is_designed_too():
    A, B, C, D = transport.linearise(np.array(transport.POINTS["E"], float))[:4]
    C[[0, 1, 2, 3, 5]] = np.eye(5)[[1, 2, 3, 4, 0]]
    D[[0, 1, 2, 3, 5]] = 0
    assert lpv_smo.verify(lpv_smo.design(A, B, C, D))["ok"]
    with pytest.raises(ValueError, match="box of 1"):
        lpv_smo.design(A, B, C, D, box=[[0, 1]])


def test_a_declared_fault_stands_until_its_estimate_is_well_below_the_threshold():
    """An estimate that hovers about its threshold is one fault, not many; one that is gone ends its alarm."""
    p = lpv_smo.params(model=transport.model(), made=made())[0]
    x = lpv_smo.init(np.array([p]))[0]

    def declared(f, seconds):
        return [lpv_smo._declare(x, p, 1, f, 1.0, 0.01)[1] for _ in range(round(seconds / 0.01))]

    assert not any(declared(0.95, 5.0)) and declared(1.05, 5.0)[-1] == 1.0
    assert all(declared(0.8, 10.0))
    assert declared(0.6, p["t_confirm"] + p["t_release"] + 0.1)[-1] == 0.0 and not any(declared(0.95, 5.0))
