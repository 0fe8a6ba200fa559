"""Every block: live (n, 1) equals batch (n, T) equals plain Python, bit for bit."""

import inspect
import zlib

import numpy as np
import pytest

from actuators.block import NOT_FINITE, SAYS
from cosim.flight.loop.compiling import shipped

BLOCKS = shipped()
LANES, TICKS, DT = 3, 60, 0.005
# what a healthy input is about; everything else is about zero, within SMALL
ABOUT = {
    "hm0": -1000.0, "hmd": -15e3, "tas": 180.0, "cas": 150.0, "V": 150.0, "mach": 0.6, "h": 6000.0, "alt": 6000.0,
    "mass": 3e5, "rho": 0.65, "qbar": 1e4, "nz": 1.0, "cg": 0.3, "truth": 1.0,
}  # fmt: skip
SIZE = {
    ("actuators.ema.actuator", "u"): 10.0, ("fdi.joint.joint", "alarm"): 1.0, ("fdi.joint.joint", "verdict"): 9.0,
    "vel_meas": 50.0, "load_fb": 3e3, "omega": 50.0, "current": 10.0,
    "friction_add": 1.0,
}  # fmt: skip
SMALL = 0.05


def _generator(name):
    return np.random.default_rng(zlib.crc32(f"{name.partition('.')[0]}.{name.rpartition('.')[2]}".encode()))


def parameters(module):
    """Return PARAMS of LANES lanes: the module's defaults, or arbitrary positive numbers where it has none."""
    make = getattr(module, "params", None)
    needs = (
        [a for a in inspect.signature(make).parameters.values() if a.default is a.empty and a.kind is not a.VAR_KEYWORD]
        if make
        else [None]
    )
    if not needs:
        return np.repeat(make(), LANES)
    rng = _generator(module.__name__)
    p = np.zeros(LANES, module.PARAMS)
    for field in p.dtype.names:
        p[field] = rng.uniform(0.1, 1.0, p[field].shape)
    return p


def begin(module, p):
    """Return STATE before the first tick; of an actuator at rest at zero, without a load."""
    return (module.init_at if hasattr(module, "init_at") else module.init)(p)


def inputs(module):
    """Return INPUTS (LANES, TICKS): smooth random signals; lane 1 loses samples, lane 2 has every fault in turn."""
    rng = _generator(module.__name__)
    u = np.zeros((LANES, TICKS), module.INPUTS)
    names = u.dtype.names
    faults = [n for n in names if n.startswith(("f_", "s_", "g_")) or n in FAULTS]
    for n in names:
        walk = np.cumsum(rng.normal(size=u[n].shape), axis=1) / 8 + rng.normal(size=(LANES, 1, *u[n].shape[2:]))
        if n.endswith(("valid", "_use")):
            u[n] = 1.0
            u[n][1] = rng.random(u[n][1].shape) < 0.8
        elif n not in faults:
            size = SIZE.get((module.__name__, n), SIZE.get(n, SMALL))
            about = ABOUT.get(n, 0.0)
            u[n] = about * (1 + 0.02 * walk) if about else size * walk
    if "t" in names:
        u["t"] = np.arange(TICKS) * DT
    for i, n in enumerate(faults):
        size = SIZE.get(n, 0.3)
        u[n][2, (7 * i) % TICKS : (7 * i) % TICKS + 15] = size
    for n in names:
        flag = next((f for f in (f"{n}_valid", n.replace("_meas", "_valid")) if f in names and f != n), None)
        if flag and u[n].shape == u[flag].shape:
            u[n][u[flag] == 0.0] = np.nan
    return u


FAULTS = {
    "jam", "jam_screw", "free_float", "loss", "supply_drop", "leak_add", "air", "r_add", "magnet_loss",
    "friction_add", "backlash_add",
}  # fmt: skip


def flown(module, ticks):
    """Return the log of all ticks, so many per call, and the final state."""
    p, u = parameters(module), inputs(module)
    x, log = begin(module, p), np.zeros((LANES, TICKS), module.STATE)
    for k in range(0, TICKS, ticks):
        module.rollout(x, u[:, k : k + ticks], p, DT, log[:, k : k + ticks])
    return log, x


def _same(a, b):
    """Return the names of the fields in which two structured arrays differ in any bit that matters."""
    return [n for n in a.dtype.names if not np.array_equal(a[n], b[n], equal_nan=True)]


def plain(module):
    """Return the log of all ticks by the step as plain Python."""
    p, u, rollout = parameters(module), inputs(module), module.rollout
    x, log = begin(module, p), np.zeros((LANES, TICKS), module.STATE)
    says = set(SAYS) <= set(x.dtype.names)
    with np.errstate(all="ignore"):
        for i, k in np.ndindex(log.shape):
            rollout.step(x[i], u[i, k], p[i], DT)
            if says and not np.isfinite(x[i : i + 1].view(np.float64)).all():
                for name in {"alarm", "verdict", "isolated_part", "valid", "why"}.intersection(x.dtype.names):
                    x[name][i] = NOT_FINITE if name == "why" else 0.0
            log[i, k] = x[i]
    return log


@pytest.mark.parametrize("name", BLOCKS)
def test_live_is_batch_is_plain_python(name):
    module = BLOCKS[name]
    log, x = flown(module, TICKS)
    log_live, x_live = flown(module, 1)
    assert _same(log, log_live) == []
    assert _same(x, x_live) == []
    assert _same(log, plain(module)) == []


@pytest.mark.parametrize("name", BLOCKS)
def test_the_signals_move_the_block(name):
    """Guard the test above: a log that never changes would prove nothing."""
    log, _ = flown(BLOCKS[name], TICKS)
    moving = [n for n in log.dtype.names if np.unique(log[n][np.isfinite(log[n])]).size > LANES]
    assert moving


@pytest.mark.parametrize("name", [n for n in BLOCKS if not n.startswith("cosim.")])
def test_no_lost_sample_leaves_a_nan(name):
    log, x = flown(BLOCKS[name], TICKS)
    bad = [n for n in module_numbers(x) if not np.isfinite(x[n]).all()]
    assert bad == []
    assert np.isfinite(log["alarm"]).all() if "alarm" in log.dtype.names else True


def module_numbers(x):
    """Return the state's field names; a latched time may be infinite by design and is not a number to check."""
    return [n for n in x.dtype.names if not n.startswith("t_")]
