"""[Mar10] slides 6 to 11 as they are printed, for the transport, against the kernels of the detector at random states.

Forces and moments come from the coefficient tables that JSBSim flies, interpolated by SciPy, as a rotation and a cross
product have them; residuals from the rows by `structure.combination`, which slide 10's table checks.
"""

import dataclasses
import functools
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from actuators.constants import G0
from cosim.flight.plant.force_model import force_model
from cosim.papers.mar10 import flights
from cosim.papers.measured import apart
from fdi.control_redundancy import control_redundancy, core, structure
from fdi.control_redundancy.force_model import A0, EFFECTOR, P0

COMMANDS = ("de_lo", "de_li", "de_ri", "de_ro", "da_l", "da_r", "dr", "stab")
DT = 0.005


@functools.cache
def _tables():
    """Return ([(axis, variable, coefficient of (alpha, Mach, qbar))], idle and full thrust of (Mach, pressure))."""
    m, ends = force_model(), []
    grid = lambda axes, values: RegularGridInterpolator(axes, values, bounds_error=False, fill_value=None)  # noqa: E731
    edge = (m.qbar[0], m.qbar[-1])
    for k, (axis, variable) in enumerate(m.quantities):
        flat = grid((m.mach, m.qbar), m.t_m[k])
        bent = grid((m.alpha, m.mach, edge), m.t_a[k]) if k < len(m.t_a) else None
        ends.append((axis, variable, flat, bent))
    return ends, grid((m.thrust_mach, m.thrust_p), m.idle), grid((m.thrust_mach, m.thrust_p), m.mil)


def _coefficients(alpha, mach, qbar):
    m = force_model()
    a, M, q = (np.clip(v, g[0], g[-1]) for v, g in ((alpha, m.alpha), (mach, m.mach), (qbar, m.qbar)))
    return [
        (axis, variable, flat((M, q)).item() + (bent((a, M, q)).item() if bent else 0.0))
        for axis, variable, flat, bent in _tables()[0]
    ]


def _air(cas: float, mach: float) -> tuple[float, float]:
    """Return (static, dynamic pressure) [Pa] of calibrated airspeed and Mach number, both subsonic."""
    static = P0 * ((1.0 + 0.2 * (cas / A0) ** 2) ** 3.5 - 1.0) / ((1.0 + 0.2 * mach**2) ** 3.5 - 1.0)
    return static, 0.7 * static * mach**2


def _body(m: Any, of: dict, u: Any) -> np.ndarray:
    """Return force [N] and moment about the CG [N m], (6,), of axis totals over qS, times qS, in body axes."""
    ca, sa, cb, sb = np.cos(u["alpha"]), np.sin(u["alpha"]), np.cos(u["beta"]), np.sin(u["beta"])
    wind = np.array([[ca * cb, -ca * sb, -sa], [sb, cb, 0.0], [sa * cb, -sa * sb, ca]])
    force = wind @ np.array([-of["drag"], of["side"], -of["lift"]])
    moment = np.array([of["roll"] * m.span, of["pitch"] * m.chord, of["yaw"] * m.span])
    if m.stability_moments:
        moment = np.array([[ca, 0.0, -sa], [0.0, 1.0, 0.0], [sa, 0.0, ca]]) @ moment
    arm = np.array([(u["cg"] - m.cg_ref) * m.chord, 0.0, 0.0])  # from the CG to where moments are given
    return np.concatenate([force, moment + np.cross(arm, force)])


def _forces(m: Any, u: Any, cmd: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, list]:
    """Return (aerodynamics (6,), of one effector rad each (3, 6), thrust of each engine (4, 6), all contributions)."""
    pressure, qbar = _air(u["cas"], u["mach"])
    V, ca, sa = max(u["tas"], 10.0), np.cos(u["alpha"]), np.sin(u["alpha"])
    lift = u["n_z"] * ca - u["n_x"] * sa  # over weight: alpha' = q + g / V (cos theta cos phi - L / m g)
    p, r = (u["p"] * ca + u["r"] * sa, u["r"] * ca - u["p"] * sa) if m.stability_rates else (u["p"], u["r"])
    v = {"one": 1.0, "beta": u["beta"], "beta2": u["beta"] ** 2, **dict(zip(COMMANDS, cmd))}
    v |= {"p": p * m.span / (2 * V), "q": u["q"] * m.chord / (2 * V), "r": r * m.span / (2 * V)}
    v["alphadot"] = m.chord / (2 * V) * (u["q"] + G0 / V * (np.cos(u["theta"]) * np.cos(u["phi"]) - lift))
    axes, parts = ("lift", "drag", "side", "roll", "pitch", "yaw"), []
    total, slope = dict.fromkeys(axes, 0.0), [dict.fromkeys(axes, 0.0) for _ in range(3)]
    for axis, variable, value in _coefficients(u["alpha"], u["mach"], qbar):
        total[axis] += value * v[variable] * qbar * m.area
        parts.append((axis, value * v[variable] * qbar * m.area))
        if variable in EFFECTOR:
            slope[EFFECTOR[variable]][axis] += value * qbar * m.area
    thrust = np.zeros((4, 6))
    for e in range(4):
        n = np.clip((u[f"n1_{e + 1}"] - m.n1_idle) / (m.n1_max - m.n1_idle), 0.0, 1.0)
        idle, full = (t((u["mach"], pressure)).item() for t in _tables()[1:])
        F = (idle + (full - idle) * n**2) * np.array(m.thrust_axis)
        arm = m.engine[e] + [(u["cg"] - m.cg_ref) * m.chord, 0.0, 0.0]
        thrust[e] = np.concatenate([F, np.cross(arm, F)])
    return _body(m, total, u), np.array([_body(m, s, u) for s in slope]), thrust, parts


def _uncertain(m: Any, u: Any, parts: list, before: Any, G: Any, p: Any, spool: float, mean: float) -> np.ndarray:
    """Return per row what coefficients and thrust that are wrong by `rel` each move it at most, over `rel` [N, N m]."""
    most = dict.fromkeys(("lift", "drag", "side", "roll", "pitch", "yaw"), 0.0)
    for (axis, part), old in zip(parts, before):
        most[axis] += abs(part - old)
    ca, sa, arm = abs(np.cos(u["alpha"])), abs(np.sin(u["alpha"])), abs((u["cg"] - m.cg_ref) * m.chord)
    X, Y, Z = most["drag"] * ca + most["lift"] * sa, most["side"], most["lift"] * ca + most["drag"] * sa
    L, N = (most["roll"] + sa * most["yaw"]) * m.span, (most["yaw"] + sa * most["roll"]) * m.span
    rows = np.array([X, Y, Z, L, most["pitch"] * m.chord + arm * Z, N + arm * Y])
    idle, full = (t((u["mach"], _air(u["cas"], u["mach"])[0])).item() for t in _tables()[1:])
    lead = p["rel_spool"] * abs(spool - mean)  # thrust leads N1 by so much of N1's own change
    wrong = p["rel_thrust"] + 4.0 * (full - idle) * lead * (2.0 * spool + lead) / np.linalg.norm(G[3, :3])
    return rows + wrong / p["rel"] * np.abs(G[3])


def _random(rng: Any) -> Any:
    u = np.zeros(1, control_redundancy.INPUTS)[0]
    spread = {"alpha": (0.06, 0.05), "beta": (0.0, 0.05), "theta": (0.05, 0.1), "phi": (0.0, 0.4), "p": (0.0, 0.1),
              "q": (0.0, 0.05), "r": (0.0, 0.05), "n_x": (0.05, 0.05), "n_y": (0.0, 0.05), "n_z": (1.0, 0.3),
              "cas": (140.0, 10.0), "tas": (180.0, 20.0), "mach": (0.5, 0.05), "mass": (2.5e5, 3e4), "cg": (0.29, 0.03),
              "pdot": (0.0, 0.1), "qdot": (0.0, 0.1), "rdot": (0.0, 0.1)}  # fmt: skip
    for name, (mean, size) in spread.items():
        u[name] = mean + size * rng.uniform(-1.0, 1.0)
    for e in range(4):
        u[f"n1_{e + 1}"] = rng.uniform(20.0, 110.0)  # beyond idle and full speed too, as noise takes it there
    return u


@pytest.mark.parametrize("which", ["force", "force+moment"])
def test_row_errors_sensitivities_and_uncertainty_are_those_of_slides_6_and_7(which):
    """Over their size; with moments angular accelerations [rad/s2] beside specific forces [g]. Half of the draws have
    engines, inertia and axes of moments of another aircraft, so that no term of this one's is zero."""
    rng, n, m = np.random.default_rng(6), (3 if which == "force" else 6), force_model()
    other = dataclasses.replace(m, thrust_axis=(0.8, 0.36, -0.48), engine=m.engine + rng.normal(size=(4, 3)),
                                gyration2=(60.0, 80.0, 130.0, 9.0), stability_rates=not m.stability_rates,
                                stability_moments=not m.stability_moments)  # fmt: skip
    for draw in range(20):
        m = other if draw % 4 > 1 else force_model()
        p = flights.detector(rows=which)[0]
        for name in ("thrust_axis", "engine", "gyration2", "stability_rates", "stability_moments"):
            p[name] = getattr(m, name)
        u, cmd = _random(rng), rng.uniform(-0.1, 0.1, 8)
        x = np.zeros(1, control_redundancy.STATE)
        x["cmd"], x["learned"] = cmd, draw % 2
        before = np.zeros(len(force_model().quantities))
        if draw % 2:
            before = rng.normal(size=len(before)) * 1e4
            x["part_0"][0, : len(before)], x["avg"][0, 2 * core.NR + 3] = before, 0.6
        core.row_errors(x[0], u, p)
        air, effectors, engines, parts = _forces(m, u, cmd)
        total = air + engines.sum(0)
        G = np.concatenate([effectors, [engines.sum(0)], engines])  # (8, 6)
        turns = np.array([u[f"n1_{e + 1}"] for e in range(4)])
        spool = np.clip((turns - p["n1_idle"]) / (p["n1_max"] - p["n1_idle"]), 0.0, 1.0).mean()
        act = _uncertain(m, u, parts, before, G, p, spool, 0.6 if draw % 2 else spool)
        weight = u["mass"] * G0
        e, S, a = np.array([u["n_x"], u["n_y"], -u["n_z"]]) - total[:3] / weight, G[:, :3] / weight, act[:3] / weight
        if n == 6:
            ixx, iyy, izz, ixz = u["mass"] * np.array(m.gyration2)
            inertia = np.array([[ixx, 0.0, -ixz], [0.0, iyy, 0.0], [-ixz, 0.0, izz]])
            w, turn = np.array([u["p"], u["q"], u["r"]]), np.linalg.inv(inertia)
            turned = turn @ (total[3:] - np.cross(w, inertia @ w))
            e = np.concatenate([e, np.array([u["pdot"], u["qdot"], u["rdot"]]) - turned])
            S, a = np.hstack([S, G[:, 3:] @ turn.T]), np.concatenate([a, np.abs(turn) @ act[3:]])
        pairs = ((x["e"][0, :n], e), (x["G"][0, :n], S.T), (x["act"][0, :n], a))
        assert all(apart(ours, theirs) <= 1e-10 for ours, theirs in pairs)


@pytest.mark.parametrize("which", ["force", "force+moment"])
def test_residuals_thresholds_and_identified_faults_are_those_of_slides_8_to_11(which):
    """At random rows: r = c (row errors), S = c G, its threshold the sum of |c| (threshold + rel activity).

    The fault of an effector is that of least squares weighted by the thresholds over the families in use.
    """
    rng, p = np.random.default_rng(7), flights.detector(rows=which)[0]
    n = 3 if which == "force" else 6
    shape = force_model().structure()[:n]
    found = structure.families(shape, most=2 if n == 3 else 1)
    for _ in range(10):
        x = np.zeros(1, control_redundancy.STATE)
        G = rng.normal(size=(6, 8))
        G[:n, :4] *= shape
        x["G"], x["avg"] = G, rng.normal(size=3 * core.NR)
        x["avg"][0, core.NR : 2 * core.NR] = rng.uniform(0.5, 1.5, core.NR)
        core.evaluate_families(x[0], p)
        avg, limit = x["avg"][0], p["threshold"][:n] + p["rel"] * x["avg"][0, core.NR : core.NR + n]
        rows: list[tuple] = []
        for family in found:
            c, s = structure.combination(G[:n, :4], family)
            sensitivity = c @ G[:n]
            sensitivity[:4] = s
            rows.append((c @ avg[:n], sensitivity, np.abs(c) @ limit))
        r, S, tau = (np.array(column) for column in zip(*rows, strict=True))
        assert np.array_equal(x["fired"][0, : len(found)], np.abs(r) >= tau)
        x["used"] = 0.0
        x["used"][0, : len(found)] = use = rng.uniform(size=len(found)) > 0.3
        for h in range(4):
            w = use / tau
            value, off = core.fit_hypothesis(x[0], p, h)
            fit = np.linalg.lstsq((w * S[:, h])[:, None], w * r, rcond=None)[0][0]
            if (w * S[:, h]).any():
                wrong = np.abs(w * (r - S[:, h] * fit)).max()
                assert abs(value - fit) <= 1e-10 * (1.0 + abs(fit)) and abs(off - wrong) <= 1e-10 * (1.0 + wrong)
        for ours, theirs in ((x["res"], r), (x["S"], S), (x["tau"], tau)):
            assert apart(ours[0, : len(found)], theirs) <= 1e-10


@pytest.mark.parametrize("mean_s", [0.5, 0.0], ids=["mean of 0.5 s", "raw samples"])
def test_rows_are_averaged_over_the_window_and_commands_act_late(mean_s):
    """Slides 11 and 17. The window moves by tenths of itself; a command acts after the two steps of slide 11 and the
    actuator's delay, no faster than the actuator."""
    ticks, rng, p = 400, np.random.default_rng(9), flights.detector(t_mean=mean_s)[0]
    x, u = np.zeros(1, control_redundancy.STATE), np.zeros(1, control_redundancy.INPUTS)
    t = np.arange(ticks) * DT
    commands = 0.1 * np.sign(np.sin(np.outer(t, 4.0 + np.arange(8.0)))) + 0.05 * rng.normal(size=(ticks, 8))
    rows = rng.normal(size=(ticks, 4 * core.NR))
    cmd, held = commands[0].copy(), []
    block = max(1, round(mean_s / 10 / DT))
    for k in range(ticks):
        for j, name in enumerate(COMMANDS):
            u[name] = commands[k, j]
        core.delayed_commands(x[0], u[0], p, DT)
        x["started"] = 1.0
        move = np.array([commands[max(k - int(late), 0), j] for j, late in enumerate(p["late"])]) - cmd
        most = np.where(p["rate"] > 0.0, p["rate"] * DT, np.inf)
        cmd = cmd + np.clip(move, -most, most)
        assert np.abs(x["cmd"][0] - cmd).max() <= 1e-10
        e, act, offset = rows[k, : core.NR], np.abs(rows[k, core.NR : 2 * core.NR]), rows[0, 2 * core.NR : 3 * core.NR]
        x["e"], x["act"], x["offset"], x["spool"] = e, act, offset, abs(rows[k, -1])
        x["pitch"], x["pitch_e"], x["grown"], x["pitch_0"] = rows[k, -2], rows[k, -3], rows[k, -4] * DT, 0.3
        held.append([*(e - offset), *act, cmd[:4].mean(), cmd[4:6].mean(), cmd[6], abs(rows[k, -1]),
                     rows[k, -2] + rows[k, -4] - 0.3, rows[k, -3]])  # fmt: skip
        full = core.accumulate(x[0], p, DT)
        ready = core.sliding_mean(x[0], p)
        assert full == ((k + 1) % block == 0)
        if full and k + 1 >= 10 * block:
            assert ready
        if full and ready:
            span = block * (10 if mean_s else 1)
            own = np.mean(held[k + 1 - span : k + 1], axis=0)
            assert np.abs(x["avg"][0, : len(own)] - own).max() <= 1e-10
