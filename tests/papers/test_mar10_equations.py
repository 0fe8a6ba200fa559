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
from fdi.control_redundancy.force_model import A0, EFFECTOR, FORCES, P0

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


def _body(of: dict, u: Any) -> np.ndarray:
    """Return the force [N] of axis totals in body axes, (3,)."""
    ca, sa, cb, sb = np.cos(u["alpha"]), np.sin(u["alpha"]), np.cos(u["beta"]), np.sin(u["beta"])
    wind = np.array([[ca * cb, -ca * sb, -sa], [sb, cb, 0.0], [sa * cb, -sa * sb, ca]])
    return wind @ np.array([-of["drag"], of["side"], -of["lift"]])


def _forces(m: Any, u: Any, cmd: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, list]:
    """Return (aerodynamics (3,), of one effector rad each (3, 3), thrust (3,), all contributions) [N]."""
    pressure, qbar = _air(u["cas"], u["mach"])
    V, ca, sa = max(u["tas"], 10.0), np.cos(u["alpha"]), np.sin(u["alpha"])
    lift = u["n_z"] * ca - u["n_x"] * sa  # over weight: alpha' = q + g / V (cos theta cos phi - L / m g)
    p, r = (u["p"] * ca + u["r"] * sa, u["r"] * ca - u["p"] * sa) if m.stability_rates else (u["p"], u["r"])
    v = {"one": 1.0, "beta": u["beta"], "beta2": u["beta"] ** 2, **dict(zip(COMMANDS, cmd))}
    v |= {"p": p * m.span / (2 * V), "q": u["q"] * m.chord / (2 * V), "r": r * m.span / (2 * V)}
    v["alphadot"] = m.chord / (2 * V) * (u["q"] + G0 / V * (np.cos(u["theta"]) * np.cos(u["phi"]) - lift))
    parts: list = []
    total, slope = dict.fromkeys(FORCES, 0.0), [dict.fromkeys(FORCES, 0.0) for _ in range(3)]
    for axis, variable, value in _coefficients(u["alpha"], u["mach"], qbar):
        total[axis] += value * v[variable] * qbar * m.area
        parts.append((axis, value * v[variable] * qbar * m.area))
        if variable in EFFECTOR:
            slope[EFFECTOR[variable]][axis] += value * qbar * m.area
    n = np.clip([(u[f"n1_{e + 1}"] - m.n1_idle) / (m.n1_max - m.n1_idle) for e in range(4)], 0.0, 1.0)
    idle, full = (t((u["mach"], pressure)).item() for t in _tables()[1:])
    thrust = (idle + (full - idle) * n**2).sum() * np.array(m.thrust_axis)
    return _body(total, u), np.array([_body(s, u) for s in slope]), thrust, parts


def _uncertain(m: Any, u: Any, parts: list, before: Any, G: Any, p: Any, spool: float, mean: float) -> np.ndarray:
    """Return per row what coefficients and thrust that are wrong by `rel` each move it at most, over `rel` [N]."""
    most = dict.fromkeys(FORCES, 0.0)
    for (axis, part), old in zip(parts, before):
        most[axis] += abs(part - old)
    ca, sa = abs(np.cos(u["alpha"])), abs(np.sin(u["alpha"]))
    rows = np.array([most["drag"] * ca + most["lift"] * sa, most["side"], most["lift"] * ca + most["drag"] * sa])
    idle, full = (t((u["mach"], _air(u["cas"], u["mach"])[0])).item() for t in _tables()[1:])
    lead = p["rel_spool"] * abs(spool - mean)  # thrust leads N1 by so much of N1's own change
    wrong = p["rel_thrust"] + 4.0 * (full - idle) * lead * (2.0 * spool + lead) / np.linalg.norm(G[3])
    return rows + wrong / p["rel"] * np.abs(G[3])


def _random(rng: Any) -> Any:
    u = np.zeros(1, control_redundancy.INPUTS)[0]
    spread = {"alpha": (0.06, 0.05), "beta": (0.0, 0.05), "theta": (0.05, 0.1), "phi": (0.0, 0.4), "p": (0.0, 0.1),
              "q": (0.0, 0.05), "r": (0.0, 0.05), "n_x": (0.05, 0.05), "n_y": (0.0, 0.05), "n_z": (1.0, 0.3),
              "cas": (140.0, 10.0), "tas": (180.0, 20.0), "mach": (0.5, 0.05), "mass": (2.5e5, 3e4)}  # fmt: skip
    for name, (mean, size) in spread.items():
        u[name] = mean + size * rng.uniform(-1.0, 1.0)
    for e in range(4):
        u[f"n1_{e + 1}"] = rng.uniform(20.0, 110.0)  # beyond idle and full speed too, as noise takes it there
    return u


def test_row_errors_sensitivities_and_uncertainty_are_those_of_slides_6_and_7():
    """Over their size. Half of the draws have the engines' axis and the axes of rates of another aircraft, so that no
    term of this one's is zero."""
    rng, m = np.random.default_rng(6), force_model()
    other = dataclasses.replace(m, thrust_axis=(0.8, 0.36, -0.48), stability_rates=not m.stability_rates)
    for draw in range(20):
        m = other if draw % 4 > 1 else force_model()
        p = flights.detector()[0]
        p["thrust_axis"], p["stability_rates"] = m.thrust_axis, m.stability_rates
        u, cmd = _random(rng), rng.uniform(-0.1, 0.1, 8)
        x = np.zeros(1, control_redundancy.STATE)
        x["cmd"], x["learned"] = cmd, draw % 2
        before = np.zeros(int(p["n_k"]))
        if draw % 2:
            before = rng.normal(size=len(before)) * 1e4
            x["part_0"][0, : len(before)], x["avg"][0, core.SPOOL] = before, 0.6
        core.row_errors(x[0], u, p)
        air, effectors, thrust, parts = _forces(m, u, cmd)
        G = np.concatenate([effectors, [thrust]])
        turns = np.array([u[f"n1_{e + 1}"] for e in range(4)])
        spool = np.clip((turns - p["n1_idle"]) / (p["n1_max"] - p["n1_idle"]), 0.0, 1.0).mean()
        act = _uncertain(m, u, parts, before, G, p, spool, 0.6 if draw % 2 else spool)
        weight = u["mass"] * G0
        e = np.array([u["n_x"], u["n_y"], -u["n_z"]]) - (air + thrust) / weight
        pairs = ((x["e"][0], e), (x["G"][0], G.T / weight), (x["act"][0], act / weight))
        assert all(apart(ours, theirs) <= 1e-10 for ours, theirs in pairs)


def test_residuals_thresholds_and_identified_faults_are_those_of_slides_8_to_11():
    """At random rows: r = c (row errors), S = c G, its threshold the sum of |c| (threshold + rel activity).

    The fault of an effector is that of least squares weighted by the thresholds over the families in use.
    """
    rng, p = np.random.default_rng(7), flights.detector()[0]
    shape, n = force_model().structure(), core.NR
    found = structure.families(shape)
    for _ in range(10):
        x = np.zeros(1, control_redundancy.STATE)
        G = rng.normal(size=(3, 4)) * shape
        x["G"], x["avg"] = G, rng.normal(size=core.NX)
        x["avg"][0, n : 2 * n] = rng.uniform(0.5, 1.5, n)
        core.evaluate_families(x[0], p)
        avg, limit = x["avg"][0], p["threshold"] + p["rel"] * x["avg"][0, n : 2 * n]
        rows: list[tuple] = []
        for family in found:
            c, s = structure.combination(G, family)
            rows.append((c @ avg[:n], s, np.abs(c) @ limit))
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
        held.append([*(e - offset), *act, cmd[:4].mean(), cmd[4:6].mean(), cmd[6], abs(rows[k, -1])])
        span = block * (10 if mean_s else 1)
        full = core.average(x[0], p, DT)
        assert full == ((k + 1) % block == 0 and k + 1 >= span)
        if full:
            own = np.mean(held[k + 1 - span : k + 1], axis=0)
            assert np.abs(x["avg"][0, : len(own)] - own).max() <= 1e-10
