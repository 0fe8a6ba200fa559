"""What comes through a valve of its command's fast part; and noise that no filter survives is bounded and flagged."""

import numpy as np
import pytest

from fdi.hydraulic import command_response, iotsekf

DT = 0.005


def asked(deaf, *, hz=0.0, size=0.0, seed=3, seconds=2.0):
    """Return the state after `seconds` of a noisy command of which a share `deaf` does not come through.

    An oscillation of `size` at `hz` is in the command and in what the pressure misses.
    """
    rng, p = np.random.default_rng(seed), iotsekf.params()[0]
    x = iotsekf.init(iotsekf.params())[0]
    x.G[2] = 0.9
    for k in range(round(seconds / DT)):
        sine = size * np.sin(2.0 * np.pi * hz * k * DT)
        x.u_old[int(p.delay)] = 0.012 * rng.standard_normal() + sine
        x.dp_e = -deaf * 0.9 * x.u_old[int(p.delay)] + 0.01 * rng.standard_normal() + sine
        command_response.update(x, p, 1.0, DT)
    return x


@pytest.mark.parametrize("deaf", [0.0, 0.3, 0.6, 1.0])
def test_the_share_that_does_not_come_through_is_read(deaf):
    assert np.mean([asked(deaf, seed=s).deaf for s in range(8)]) == pytest.approx(deaf, abs=0.12)


@pytest.mark.parametrize(("hz", "size"), [(1.0, 0.1), (10.0, 0.2)])
def test_an_oscillation_below_the_corner_does_not_disturb_it(hz, size):
    assert command_response.present(asked(0.0, hz=hz, size=size))
    assert command_response.absent(asked(1.0, hz=hz, size=size))
    assert not command_response.present(asked(1.0)) and not command_response.absent(asked(0.0))


def test_a_tick_without_a_reading_begins_anew():
    x, p = asked(1.0), iotsekf.params()[0]
    command_response.update(x, p, 0.0, DT)
    assert x.deaf == 0.0 and x.proof == 0.0


@pytest.mark.parametrize("dt", [0.005, 0.02])
@pytest.mark.parametrize("load", [0, 1, 2])
def test_noise_a_hundred_times_the_sensors_is_bounded_and_not_valid(dt, load):
    rng, n = np.random.default_rng(1), round(20.0 / dt)
    p = iotsekf.params(dt=dt, load=load)
    u = np.zeros((1, n), iotsekf.INPUTS)
    for name in ("y_rod_valid", "y_surface_valid", "y_dp_valid"):
        u[name] = 1.0
    u["u"] = 0.05 * rng.standard_normal((1, n))
    u["y_rod"] = 1e-2 * rng.standard_normal((1, n))
    u["y_dp"] = 0.5 * rng.standard_normal((1, n))
    x, log = iotsekf.init(p), np.zeros((1, n), iotsekf.STATE)
    iotsekf.rollout(x, u, p, dt, log)
    for name in log.dtype.names:
        assert np.isfinite(log[name]).all(), name
    assert np.abs(log["P_bar"]).max() < 10.0 and np.abs(log["V"]).max() < 1e3
    assert np.abs(log["f_hat"]).max() < 5.0 and np.abs(log["x_hat"][..., 2:]).max() < 5.0
    late = log[:, round(2.0 / dt) :]
    assert late["valid"].max() == 0.0 and late["alarm"].min() == 1.0
