"""Noise by name: what is drawn for a lane depends on the flight's seed and the lane's name alone."""

import numpy as np
import pytest

from cosim.flight.blocks import noise
from cosim.flight.blocks.noise import Draw, generator
from cosim.flight.build import build
from cosim.flight.fly import fly
from cosim.flight.loop.tape import Tape
from cosim.scenario import load_scenario

FROZEN = 0.19599028265514082  # the same on every machine
SECONDS = 6.0  # more than a block at 200 Hz
QUIET = ("flight.turbulence=none", f"duration_s={SECONDS}", "detectors.enabled=[]")


def drawn(seed, lanes, ticks=2500):
    """Return (ticks, lanes) of what a tape puts into its vector."""
    v = np.zeros(len(lanes))
    tape, rows = Tape(v, 0.005), []
    Draw(seed, lanes).schedule(tape, np.arange(len(lanes)))
    tape.call(lambda k: rows.append(v.copy()))
    for k in range(ticks):
        tape.run(k)
    return np.array(rows)


def noises(*changes):
    """Return {lane: noise of every tick} of a flight of `cruise`."""
    setup = build(load_scenario("cruise", [*QUIET, *changes]))
    rows, *_ = fly(setup, keep=(setup.loop.noise, np.float64))
    return dict(zip(setup.loop.bus.lanes["sensors"], rows.T)), setup


def test_a_lanes_numbers_know_neither_its_neighbours_nor_its_place():
    lanes = ["noise.alpha", "noise.q", "noise.theta"]
    alone = {lane: drawn(3, [lane])[:, 0] for lane in lanes}
    for order in (lanes, lanes[::-1], [lanes[1], "noise.new", lanes[0]]):
        for lane, column in zip(order, drawn(3, order).T):
            assert lane not in alone or np.array_equal(column, alone[lane])
    assert generator(7, "noise.alpha").standard_normal() == pytest.approx(FROZEN, abs=1e-15)


def test_moments_are_those_of_standard_normal_noise_and_lanes_and_seeds_are_independent():
    rows = np.concatenate([drawn(seed, [f"noise.{i}" for i in range(8)]) for seed in (1, 2)], axis=1)
    n = len(rows)
    assert np.abs(rows.mean(axis=0)).max() < 4.5 / np.sqrt(n)
    assert np.abs(rows.var(axis=0) - 1.0).max() < 4.5 * np.sqrt(2.0 / n)
    assert (rows**4).mean() == pytest.approx(3.0, abs=4.5 * np.sqrt(96.0 / rows.size))
    between = np.corrcoef(rows.T)[np.triu_indices(16, 1)]
    assert np.abs(between).max() < 5.0 / np.sqrt(n)
    later = [np.corrcoef(rows[:-lag, i], rows[lag:, i])[0, 1] for lag in (1, 7, noise.TICKS) for i in range(16)]
    assert np.abs(later).max() < 5.0 / np.sqrt(n - noise.TICKS)


def test_another_technology_or_detector_changes_no_other_lanes_noise_and_errors():
    base, setup = noises()
    other, changed = noises("elevator.left_outer=ema", 'detectors.enabled=["kinematic", "lpv_smo"]')
    common = [lane for lane in base if lane in other]
    assert len(common) > 30 and set(base) != set(other)
    for lane in common:
        assert np.array_equal(base[lane], other[lane]), lane

    def errors(s):
        bias = dict(zip(s.loop.bus.lanes["sensors"], s.loop.sensors.p["bias"]))
        return {k: v for k, v in bias.items() if not k.startswith("left_outer")}

    assert errors(setup) == errors(changed) and any(errors(setup).values())
