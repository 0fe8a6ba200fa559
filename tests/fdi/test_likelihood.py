"""Likelihood ratios of a hydraulic actuator's faults: evidence as linear algebra has it, names, ends."""

import functools
import math

import numpy as np
import pytest
from numpy.lib.recfunctions import repack_fields

from cosim.flight.loop.signals import fly, inputs
from cosim.scenario.catalog import SEGMENTS
from cosim.training.flights import scenario
from fdi.common import verdict
from fdi.hydraulic import iotsekf
from fdi.isolation import decide, evidence, filter, likelihood, sums

DT, ONSET, HEALED = 0.005, 10.0, 16.0
FIELDS = {name: f"iotsekf_in.{{}}.{name}" for name in iotsekf.INPUTS.names}
VALVE = {"kind": "ofc_liquid", "at": "valve", "amplitude_mm": 0.6, "frequency_hz": 2.0}
FAULTS = {  # segment -> (part, fault, verdict, isolated_part)
    "left_outer": ("", VALVE, verdict.OFC_LIQUID, ""),
    "left_inner": ("", VALVE | {"kind": "ofc_solid"}, verdict.OFC_SOLID, ""),
    "right_inner": ("", {"kind": "loss_of_effectiveness", "at": "valve", "loss_pct": 50.0}, verdict.EFFECTIVENESS, ""),
    "right_outer": (
        ".pressure", {"kind": "oscillation", "amplitude_pct": 8.0, "frequency_hz": 1.9}, verdict.SENSOR, "pressure",
    ),
}  # fmt: skip


@functools.cache
def flown(faulty=False):
    """Return the INPUTS (4, tick) of 22 s in light gusts, valve flow 4 % up, with or without FAULTS."""
    times = {"start_s": ONSET, "end_s": HEALED}
    faults = [{"target": f"elevator.{s}{part}", **fault, **times} for s, (part, fault, *_) in FAULTS.items()]
    made = scenario(duration=22.0, seed=77_100_001, flight={"turbulence": "light"}, faults=faults if faulty else [],
                    tolerances={"hydraulic": {"phi_n": 1.04}}, detectors={"enabled": ["iotsekf"]})  # fmt: skip
    lanes = [{field: path.format(s) for field, path in FIELDS.items()} for s in SEGMENTS]
    return inputs(fly(made, [path for lane in lanes for path in lane.values()]), iotsekf, lanes)


@functools.cache
def designed():
    """Return PARAMS of one lane at 200 Hz."""
    return iotsekf.params()


def watched(u):
    """Return the STATE of every lane at every tick, some fields."""
    fields = [*iotsekf.OUTPUTS, "mu", "ev_octave"]
    p = np.repeat(designed(), len(u))
    x, log, kept = iotsekf.init(p), np.zeros((len(u), 200), iotsekf.STATE), []
    for part in np.split(u, range(200, u.shape[1], 200), axis=1):
        iotsekf.rollout(x, np.ascontiguousarray(part), p, DT, log[:, : part.shape[1]])
        kept.append(repack_fields(log[fields][:, : part.shape[1]]))
    return np.concatenate(kept, axis=1)


def test_each_fault_has_its_name_at_its_end_and_no_alarm_before_it_or_after_it_has_healed():
    log = watched(flown(True))
    assert not log["alarm"][:, : int(ONSET / DT)].any()
    for lane, segment in enumerate(SEGMENTS):
        _, fault, right, isolated_part = FAULTS[segment]
        late = 3.0 / fault.get("frequency_hz", 1.0)
        assert log["alarm"][lane, int((ONSET + late) / DT)] == 1.0, segment
        end = log[lane, int(HEALED / DT) - 1]
        assert (end["verdict"], iotsekf.ISOLABLE_PARTS[int(end["isolated_part"])]) == (right, isolated_part), segment
    assert not log["alarm"][:, int((HEALED + 3.0) / DT) :].any()
    assert log["likely_hz"][SEGMENTS.index("left_outer"), int(HEALED / DT) - 1] == pytest.approx(2.0, rel=0.2)


def test_without_a_fault_it_is_silent_valid_and_learns_the_valves_gain():
    log = watched(flown())
    assert not log["alarm"].any()
    assert (log["valid"][:, int(4.1 / DT) :] == 1.0).all()
    learned = log["mu"][:, -1, filter.GAIN]
    assert np.abs(learned - 0.04).max() < 0.03


@pytest.mark.parametrize("ticks", [-1, 1])
@pytest.mark.parametrize("sensor", ["y_rod", "y_surface", "y_dp"])
def test_samples_of_another_age_are_no_fault(sensor, ticks):
    u = flown()[:, 1:-1].copy()
    u[sensor] = np.roll(flown()[sensor], ticks, axis=1)[:, 1:-1]
    assert not watched(u)["alarm"].any()


def test_a_longer_lever_is_learned_and_no_evidence_of_rod_and_surface_apart():
    """Of .3 % of 40 mm 120 um come, which is ten times what noise leaves of the mean of a window."""
    made = scenario(duration=26.0, seed=77_100_002, flight={"turbulence": "light"},
                    manoeuvre={"kind": "aoa_protection", "start_s": 12.0}, tolerances={"hydraulic": {"arm": 1.003}},
                    detectors={"enabled": ["iotsekf"]})  # fmt: skip
    watched = [f"iotsekf.left_inner.{name}" for name in ("alarm", "lever", "evidence")]
    log = fly(made, watched)
    assert log[watched[0]].max() == 0.0 and log[watched[2]].max() < 0.9
    assert log[watched[1]].iloc[-1] == pytest.approx(0.003, abs=0.0003)


def test_a_lost_pressure_ends_the_judgement():
    u, k = flown()[:1].copy(), int(ONSET / DT)
    u["y_dp"][0, k:], u["y_dp_valid"][0, k:] = np.nan, 0.0
    octave = watched(u)["ev_octave"][0]
    assert octave[k - 200 : k].max() >= 0.0 and octave[k + int(0.3 / DT) :].max() < 0.0


def evidence_of(S, e, mean, sd):
    """Return a state, Q and ln det of the sums of signatures S (n, N) and innovations e (n,) with this prior."""
    x, J = iotsekf.init(designed())[0], S.T @ S
    J = np.array([J[a, c] for a in range(filter.N) for c in range(a + 1)])
    logdet = evidence.factor(J, x.L, sd, 0, filter.N, 0.0)
    Q = evidence.left(J, x.L, S.T @ e, np.broadcast_to(mean, filter.N), x.y, e @ e, filter.N)
    return x, Q, logdet


def drawn(seed):
    """Return signatures (60, N), innovations (60,), mean and deviation of the prior (N,)."""
    rng = np.random.default_rng(seed)
    S, e = rng.standard_normal((60, filter.N)) * 3.0, rng.standard_normal(60)
    return S, e, rng.standard_normal(filter.N) * 0.1, rng.uniform(0.05, 0.5, filter.N)


def test_the_evidence_is_that_of_the_linear_model_with_its_prior():
    S, e, mean, sd = drawn(5)
    x, Q, logdet = evidence_of(S, e, mean, sd)
    covariance = np.eye(60) + S @ np.diag(sd**2) @ S.T  # of e, theta taken out
    off = e - S @ mean
    assert logdet == pytest.approx(np.linalg.slogdet(covariance)[1], rel=1e-9)
    assert Q == pytest.approx(off @ np.linalg.solve(covariance, off), rel=1e-9)
    posterior = np.linalg.inv(S.T @ S + np.diag(sd**-2))
    evidence.back(x.L, x.y, x.theta, filter.N)
    assert x.theta == pytest.approx(posterior @ S.T @ off, rel=1e-9)
    assert evidence.inverse(x.L, 3, x.y, filter.N) == pytest.approx(posterior[3, 3], rel=1e-9)


def test_a_windows_sums_are_those_of_its_ticks_and_its_waves_those_of_its_blocks():
    rng, p, octave = np.random.default_rng(7), designed()[0], 2
    x, block = iotsekf.init(designed())[0], int(p["block"])
    blocks = int(p["length"][octave]) + 29  # into the second window, and the third of those above it
    S, e = rng.standard_normal((blocks * block, 3, filter.N)), rng.standard_normal((blocks * block, 3))
    for k in range(blocks):
        for tick in range(k * block, (k + 1) * block):
            x.h_S[:], x.h_e[:], x.h_s[:] = S[tick], e[tick], 1.0
            sums.add_tick(x)
        sums.close_block(x, p)
        if k < blocks - 1:
            sums.fold(x, p)
    own = slice(int(p["length"][octave]) * block, None)
    sums.gather(x, octave)
    J = np.einsum("tja,tjb->ab", S[own], S[own])
    expected = [*(J[a, b] for a in range(filter.N) for b in range(a + 1)), *np.einsum("tja,tj->a", S[own], e[own])]
    expected += [*(e[own] ** 2).sum(axis=0)]
    assert x.total[: sums.NUMBER] == pytest.approx(expected, rel=1e-9, abs=1e-9)
    n = np.arange(1, 30)
    angle = 2.0 * np.pi * p["hz"][octave] * block * DT
    wave = np.concatenate([[np.cos(n * a), np.sin(n * a)] for a in angle])
    in_blocks = e[own].reshape(29, block, 3).sum(axis=1)
    assert x.window_D[octave, 0] == pytest.approx((wave @ in_blocks).T, rel=1e-9, abs=1e-9)
    assert x.window_G[octave] == pytest.approx(wave @ wave.T, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("ears", range(len(evidence.HEARD)))
@pytest.mark.parametrize("place, sensor", [("rod", "y_rod"), ("surface", "y_surface"), ("pressure", "y_dp")])
def test_the_response_to_a_sensors_sine_is_what_the_filter_makes_of_it(place, sensor, ears):
    p, hz, size = designed().copy(), 3.0, 1e-4
    p["prior_sd"] *= 1e-6  # nothing is learned of the sine
    u = np.zeros((2, 2000), iotsekf.INPUTS)
    for name in ("y_rod_valid", "y_surface_valid", "y_dp_valid"):
        u[name] = 1.0
    heard = list(evidence.HEARD[ears])
    for j, name in enumerate(("y_rod_valid", "y_surface_valid", "y_dp_valid")):
        u[name][:, 400:] = 1.0 if j in heard else 0.0
    t = np.arange(2000) * DT
    u[sensor][1] += size * np.sin(2.0 * np.pi * hz * t) / (p["arm"][0] if place == "surface" else 1.0)
    x, log = iotsekf.init(np.repeat(p, 2)), np.zeros(u.shape, iotsekf.STATE)
    iotsekf.rollout(x, u, np.repeat(p, 2), DT, log)
    e = (log["h_e"][1] - log["h_e"][0])[1000:, heard] / np.sqrt(log["h_s"][0, 1000:][:, heard])
    found = 2.0 * np.abs(np.exp(-2j * np.pi * hz * t[1000:]) @ e) / 1000.0 / size
    expected = np.abs(likelihood.responses(p[0], DT, np.array([hz]), heard)[evidence.PLACES.index(place), 0])
    most = expected[heard].max()
    assert np.abs(found - expected[heard]).max() < (0.05 if ears else 0.03) * max(most, 1.0)
    assert log["heard"][0, -1] == ears and np.all(np.delete(expected, heard) == 0.0)
    there = ("rod", "surface", "pressure").index(place) in heard
    assert math.isfinite(most) and (most > 1.0) == there


def test_an_oscillation_too_fast_for_a_window_is_judged_by_its_parts_where_each_shows_it():
    x, h = iotsekf.init(designed())[0], evidence.ADDED
    x.ev_n, x.ev_base = 200.0, evidence.logarithm(200.0, 900.0, 0.0)
    x.parts[2, h], x.told[1, h] = (80.0, 3.0, 100.0), (90.0, 3.0, 100.0, 4.0)
    evidence.swing(x, 2, h, 400.0, 2.0, 1.0)
    assert x.ev[h] == evidence.logarithm(200.0, 170.0, 6.0) - x.ev_base
    assert x.ev_hz[h] == 4.0 and x.told[2, h].tolist() == [170.0, 6.0, 200.0, 4.0]
    x.told[1, h, 2] = evidence.REFUSED
    evidence.swing(x, 2, h, 400.0, 2.0, 1.0)
    assert x.ev[h] == evidence.logarithm(200.0, 400.0, 2.0) - x.ev_base and x.ev_hz[h] == 1.0


@pytest.mark.parametrize(
    ("fields", "likely"),
    [
        ({}, decide.OF_VALVE),
        ({"own_lead": (20.0, 20.0, 3.0, 0.0, 0.0)}, decide.OF_ROD),  # a shorter one of another class has no say
        ({"own_lead": (20.0, 20.0, 3.0, 0.0, 0.0), "own_class": decide.WEAK}, decide.WEAK),  # ... of the same class has
        ({"own_fits": (1.0, 1.0, 0.0, 0.0, 0.0)}, decide.WEAK),  # the longest explains nothing
        ({"own_ratio": 0.0}, decide.OF_SURFACE),
    ],
)
def test_only_the_best_hypothesis_of_the_longest_window_that_shows_a_fault_has_a_name(fields, likely):
    """A lead that the longest window takes back leaves what was named, with its frequency."""
    x = iotsekf.init(designed())[0]
    x["own_class"][:3] = decide.WEAK, decide.WEAK, decide.OF_VALVE
    x["own"][:3], x["own_lead"][:3], x["own_fits"][:3], x["own_ratio"][:3] = 70.0, 20.0, 1.0, 2.0
    x["likely"], x["likely_hz"], x["named"], x["named_hz"] = decide.OF_SURFACE, 5.0, decide.OF_ROD, 3.0
    for field, value in fields.items():
        x[field] = value
    decide.nominate(x)
    hz = {decide.OF_SURFACE: 5.0, decide.OF_ROD: 3.0}.get(likely, 0.0)
    assert (x["likely"], x["likely_hz"]) == (likely, hz)


@pytest.mark.parametrize(("lost", "clean"), [(0.0, True), (1.0, True), (1.0, False)])
def test_what_passes_the_valve_is_told_beside_an_oscillation_of_any_size(lost, clean):
    rng, x = np.random.default_rng(3), iotsekf.init(designed())[0]
    fast, white = rng.standard_normal((2, 200))
    wave = 20.0 * np.sin(2.0 * np.pi * 5.0 * DT * np.arange(200))
    x["alarm"], x["h_s"], x["h_before"] = 1.0, 1.0, 0.0 if clean else filter.GATE
    for k in range(200):
        x["h_S"][filter.PRESSURE, filter.FAST], x["h_e"][filter.PRESSURE] = fast[k], wave[k] + white[k] - lost * fast[k]
        sums.add_tick(x)
    assert (x["lost"], x["lost_sd"] < 0.1) == (pytest.approx(lost if clean else 0.0, abs=0.2), clean)


@pytest.mark.parametrize(
    ("fields", "name"),
    [
        ({"jam": 1.0, "jam_most": 0.3, "jam_s": 3.0, "rod_high": 2e-4}, (verdict.JAM_SOLID, 0.0)),
        ({"jam": 1.0, "jam_most": 0.3, "jam_s": 3.0, "rod_high": 2e-3}, (verdict.AMBIGUOUS, 0.0)),  # friction
        ({"jam": 1.0, "jam_most": 0.8, "jam_s": 0.5, "likely": decide.OF_PRESSURE}, (verdict.SENSOR, 3.0)),
        ({"jam": 1.0, "jam_most": 0.8, "jam_s": 1.5, "likely": decide.OF_PRESSURE}, (verdict.JAM_SOLID, 0.0)),
        ({"sensor": 1.0, "blame": 1.0, "frozen": 2.0}, (verdict.SENSOR, 2.0)),
        ({"sensor": 1.0, "blame": 1.0, "stands_open": 0.1}, (verdict.RUNAWAY, 0.0)),
        ({"shown": (1.0, 0.0), "likely": decide.OF_VALVE}, (verdict.EFFECTIVENESS, 0.0)),
        ({"shown": (1.0, 0.0), "likely": decide.OF_PRESSURE}, (verdict.SENSOR, 3.0)),
        ({"likely": decide.OF_SURFACE, "backlash_suspected": 1.0}, (verdict.AMBIGUOUS, 0.0)),
        ({"likely": decide.OF_VALVE, "lost": 0.1, "lost_sd": 0.05}, (verdict.OFC_LIQUID, 0.0)),
        ({"likely": decide.OF_VALVE, "lost": 0.9, "lost_sd": 0.05}, (verdict.OFC_SOLID, 0.0)),
        ({"likely": decide.OF_VALVE, "lost": 0.6, "lost_sd": 0.05, "likely_added": 20.0}, (verdict.AMBIGUOUS, 0.0)),
        ({"likely": decide.OF_VALVE, "lost": 0.9, "lost_sd": 0.9, "likely_added": 20.0}, (verdict.OFC_LIQUID, 0.0)),
    ],
)
def test_what_can_be_nothing_else_is_named_first(fields, name):
    x = iotsekf.init(designed())[0]
    for field, value in fields.items():
        x[field] = value
    assert iotsekf.name(x) == name


def test_an_alarm_is_ambiguous_until_its_name_has_stood():
    x = iotsekf.init(designed())[0]
    x["run"], said = 1.0, []
    for k in range(100):
        x["likely"] = decide.WEAK if 20 <= k < 30 else decide.OF_VALVE  # another class for less than the hold
        iotsekf.conclude(x, DT)
        said.append(float(x["verdict"]))
    assert set(said[:90]) == {verdict.AMBIGUOUS} and said[-1] == verdict.OFC_LIQUID
    x["run"] = 0.0
    iotsekf.conclude(x, DT)
    assert (x["alarm"], x["verdict"]) == (0.0, verdict.NONE)
