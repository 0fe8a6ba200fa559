"""Likelihood ratios of the faults of one hydraulic actuator, on the innovations of a filter without a fault state.

What may be wrong with actuator and sensors is a hypothesis with a signature in the innovations (`filter`, `response`);
its evidence against health is taken over windows of growing length (`sums`, `evidence`). Errors within tolerances are
part of every hypothesis, learned in flight while nothing is wrong. `decide` says what leads. `iotsekf` runs it beside
its own filter, from whose record it reads the valve commands and what rod and surface say of each other; while nothing
is suspicious only one block of SPARSE is asked.
Sources: [Willsky76] A. Willsky, H. Jones, A generalized likelihood ratio approach to the detection and estimation of
jumps in linear systems, IEEE Trans. Automatic Control 21 (1976); [Basseville93] M. Basseville, I. Nikiforov, Detection
of Abrupt Changes, Prentice Hall (1993).
"""

from typing import Any

import numpy as np

from actuators.block import kernel
from actuators.hydraulic import lu17
from actuators.kernels import cached_array
from fdi.hydraulic.two_stage_ekf import STEP_MOST
from fdi.isolation import adaptation, decide, evidence, filter, parts, sums
from fdi.isolation.filter import SENSORS
from fdi.isolation.response import HEARD, PLACES, responses

PERIOD = 0.005  # of the samples whose variance stands in `filter.NOISE` [s]
LEARN_S = filter.SETTLES_S + sums.FIRST * sums.BLOCK_S  # after which the flight has taught [s]
STOP = 1e-3  # so near a stop the rod may lean on it [m]
LESSON = 2  # octave whose window is learned from: a fault that begins in it is seen before it ends
LOST_S = 0.2  # without positions, or without pressure, for longer nothing is asked [s]
QUIET_S = 1.0  # after the last sign of a fault the flight teaches again [s]
SPARSE = 4  # blocks of which one is asked while nothing is suspicious
ALL = 2.0  # of `asks`: every block is asked, as in training
STILL_HZ = 0.02  # slow enough for a constant
# Least threshold. Evidence of k to one against health comes by chance with a probability of 1 / k at most; in 60 s a
# hypothesis is asked over 480 windows: 1e-3 per flight asks for k = 4.8e5
BY_CHANCE = 13.1
SLOW = 2.2  # at 50 and 60 Hz 24 fault-free flights reach 2.0 thresholds: over such a tick the load is not held

PARAMS = [
    *filter.PARAMS,
    *sums.PARAMS,
    # of two waves per line to cos and sin, by the position sensors that are heard
    ("response", "f8", (len(HEARD), len(PLACES), sums.OCTAVES, sums.WAVES, SENSORS, 2)),
    ("still", "f8", (len(HEARD), len(PLACES), SENSORS)),  # responses to a constant
    *evidence.PARAMS,
    ("limit", "f8", (evidence.HYPOTHESES,), "-"),  # evidence that is an alarm
    ("asks", "f8"),  # 1 where the pressure is measured, ALL: every block is asked
    ("q_lo", "f8", "m"),  # stops of the rod
    ("q_hi", "f8", "m"),
]
STATE = [
    *filter.STATE,
    ("heard", "f8"),  # positions that the filter hears: of HEARD
    *sums.STATE,
    *evidence.STATE,
    *adaptation.STATE,
    *decide.STATE,
    ("since", "f8", "s"),  # something last spoke for a fault
    ("at_stop", "f8", "-"),  # 1 while the rod is at a stop
]


def design(dt: float, arm: float, travel: tuple[float, float], asks: bool) -> dict[str, Any]:
    """Return the PARAMS fields, but for the responses, for ticks of `dt` seconds and stops `travel` [rad]."""
    noise = {**filter.NOISE, "h_r": np.asarray(filter.NOISE["h_r"]) * PERIOD / dt}
    return {**noise, **sums.design(dt), **filter.high_pass(dt), **evidence.PRIORS,
            "asks": 1.0 if asks else 0.0, "q_lo": arm * travel[0], "q_hi": arm * travel[1]}  # fmt: skip


def respond(p: np.ndarray, dt: float) -> None:
    """Write the responses of PARAMS record `p` to sines and to a constant; let no threshold be below BY_CHANCE, and
    those of ticks beyond STEP_MOST be SLOW times theirs."""
    p["limit"] = np.maximum(p["limit"], BY_CHANCE) * (SLOW if dt > STEP_MOST else 1.0)
    if p["asks"][0] < 0.5:
        return
    hz = p["hz"][0].ravel()
    given = [p[0][name].tolist() for name in ("arm", "h_q", "h_r", "h_P0", *lu17.NOMINAL)]
    H = cached_array((given, dt, hz.tolist()), float, lambda: _responses(p[0], dt, hz), __file__)
    H = H.view(complex).reshape(len(HEARD), len(PLACES), 1 + len(hz), SENSORS)
    p["still"][0] = H[:, :, 0].real
    waves = np.stack([np.stack([H.real, -H.imag], -1), np.stack([H.imag, H.real], -1)], 3)  # ..., line, wave, sensor, 2
    p["response"][0] = waves[:, :, 1:].reshape(p["response"].shape[1:])


def _responses(p, dt, hz):
    H = np.stack([responses(p, dt, np.concatenate([[STILL_HZ], hz]), heard) for heard in HEARD])
    H[:, :, 1:] *= np.sinc(hz * p["block"] * dt)[:, None]  # of the sum over a block
    return H.ravel().view(float)


def begin(x: np.ndarray, p: np.ndarray) -> None:
    """Write into STATE records `x` that nothing is learned."""
    x["mu"], x["sd"], x["noise"], x["phase_c"] = p["prior_mean"], p["prior_sd"], 1.0, 1.0
    x["ev_octave"], x["since"] = -1.0, QUIET_S


@kernel
def restart(x):
    """Let every window begin anew."""
    sums.begin_all(x)
    decide.forget(x)


@kernel
def close(x, p, suspicious, dt):
    """Take a finished block: evidence of one octave, decision, lesson."""
    sums.close_block(x, p)
    quiet = x.since > QUIET_S and x.alarm < 0.5
    blocks, anew = int(x.blocks), False
    if suspicious or not quiet or p.asks >= ALL:
        o = sums.octave(blocks)
    else:
        o = sums.octave(blocks // SPARSE) if blocks % SPARSE == 0 else -1
    if o >= 0 and x.window_age[o] >= sums.YOUNG * p.length[o]:
        evidence.evaluate(x, p, o)
        parts.in_parts(x, o)
        anew = decide.judge(x, p, o, dt)
        if x.alarm < 0.5 and x.evidence_timer == 0.0:
            adaptation.learn_load_swing(x, p, o, sums.apart(o) * p.block * dt)
    first = blocks <= int(sums.FIRST) and x.alarm < 0.5
    if (quiet or first) and x.window_age[LESSON] >= p.length[LESSON]:
        adaptation.learn(x, p, LESSON, dt)
    sums.fold(x, p)
    if blocks % int(sums.SOLVE_BLOCKS) == 0 and (quiet or (first and blocks == int(sums.FIRST))):
        adaptation.solve(x, p)
        anew = anew or first
    if anew:
        restart(x)


@kernel
def listen(x, u, p, suspicious, dt):
    """Run the filter, add up, ask; everything while `suspicious`."""
    x.ev_octave = -1.0
    if p.asks < 0.5 or not filter.advance(x, u, x.mu, p, dt):
        return
    if x.h_clock < filter.SETTLES_S:
        return
    x.since += dt
    x.evidence_timer = max(x.evidence_timer - dt, 0.0)
    stop = x.h_hat[0] < p.q_lo + STOP or x.h_hat[0] > p.q_hi - STOP
    rod, surface = x.h_lost[filter.ROD] <= LOST_S, x.h_lost[filter.SURFACE] <= LOST_S
    heard = 0.0 if rod and surface else (1.0 if rod else 2.0)
    lost = x.h_lost[filter.PRESSURE] > LOST_S or not (rod or surface)
    if stop or x.at_stop > 0.5 or lost or heard != x.heard:  # the model ends there, or is another
        x.heard = heard
        x.at_stop = 1.0 if stop else 0.0
        restart(x)
    else:
        sums.add_tick(x)
        if x.block_tick >= p.block:
            close(x, p, suspicious, dt)
