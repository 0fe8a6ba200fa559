"""Likelihood ratios of the faults of one hydraulic actuator, on the innovations of a filter without a fault state.

What may be wrong with actuator and sensors is a hypothesis with a signature in the innovations (`filter`, `responses`);
its evidence against health is taken over windows of growing length (`sums`, `evidence`). Errors within tolerances are
part of every hypothesis, learned in flight while nothing is wrong. `decide` says what leads. `iotsekf` runs it beside
its own filter, from whose record it reads the valve commands and what rod and surface say of each other; while nothing
is suspicious only one block of SPARSE is asked.
Sources: [Willsky76] A. Willsky, H. Jones, A generalized likelihood ratio approach to the detection and estimation of
jumps in linear systems, IEEE Trans. Automatic Control 21 (1976); [Basseville93] M. Basseville, I. Nikiforov, Detection
of Abrupt Changes, Prentice Hall (1993).
"""

import math
from typing import Any

import numpy as np
from scipy.linalg import solve_discrete_are

from actuators.block import kernel
from actuators.hydraulic import lu17
from fdi.hydraulic.two_stage_ekf import STEP_MOST, transition
from fdi.isolation import decide, evidence, filter, sums
from fdi.isolation.evidence import FLOWS2, HEARD, PLACES, at, back, factor, inverse, left
from fdi.isolation.filter import SENSORS, N
from fdi.isolation.sums import ENERGY, NUMBER, PAIRS, B

PERIOD = 0.005  # of the samples whose variances stand in NOISE of `filter` and of `iotsekf` [s]
LEARN_S = filter.SETTLES_S + sums.FIRST * sums.BLOCK_S  # after which the flight has taught [s]
STOP = 1e-3  # so near a stop the rod may lean on it [m]
LESSON = 2  # octave whose window is learned from: a fault that begins in it is seen before it ends
LOST_S = 0.2  # without positions, or without pressure, for longer nothing is asked [s]
QUIET_S = 1.0  # after the last sign of a fault the flight teaches again [s]
NOISE_LEAST = 0.05  # of the sensors' variance: one that reports no noise at all is not that good
SPARSE = 4  # blocks of which one is asked while nothing is suspicious
ALL = 2.0  # of `asks`: every block is asked, as in training
# Least threshold. Evidence of k to one against health comes by chance with a probability of 1 / k at most; in 60 s a
# hypothesis is asked over 480 windows: 1e-3 per flight asks for k = 4.8e5
BY_CHANCE = 13.1
SLOW = 2.2  # at 50 and 60 Hz 24 fault-free flights reach 2.0 thresholds: over such a tick the load is not held

PARAMS = [
    *filter.PARAMS,
    *sums.PARAMS,
    # of two waves per line to cos and sin, by the position sensors that are heard and by the flow
    ("response", "f8", (len(HEARD), len(FLOWS2), len(PLACES), sums.OCTAVES, sums.WAVES, SENSORS, 2)),
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
    ("lesson", "f8", (ENERGY,)),  # sums of S'S and S'e over the flight, forgotten over `memory`
    *decide.STATE,
    ("since", "f8", "s"),  # something last spoke for a fault
    ("at_stop", "f8", "-"),  # 1 while the rod is at a stop
]


def design(dt: float, arm: float, travel: tuple[float, float], asks: bool) -> dict[str, Any]:
    """Return the PARAMS fields, but for the responses, for ticks of `dt` seconds and stops `travel` [rad]."""
    noise = {**filter.NOISE, "h_r": np.asarray(filter.NOISE["h_r"]) * PERIOD / dt}
    return {**noise, **sums.design(dt), **filter.high_pass(dt), **evidence.design(),
            "asks": 1.0 if asks else 0.0, "q_lo": arm * travel[0], "q_hi": arm * travel[1]}  # fmt: skip


def respond(p: np.ndarray, dt: float) -> None:
    """Write the responses of PARAMS record `p` to sines; let no threshold be below BY_CHANCE, and those of ticks beyond
    STEP_MOST be SLOW times theirs."""
    p["limit"] = np.maximum(p["limit"], BY_CHANCE) * (SLOW if dt > STEP_MOST else 1.0)
    if p["asks"][0] < 0.5:
        return
    hz = p["hz"][0].ravel()
    H = np.stack([responses(p[0], dt, hz, heard, flow2) for heard in HEARD for flow2 in FLOWS2])
    H *= np.sinc(hz * p["block"] * dt)[:, None]  # of the sum over a block
    waves = np.stack([np.stack([H.real, -H.imag], -1), np.stack([H.imag, H.real], -1)], 3)  # ..., line, wave, sensor, 2
    p["response"][0] = waves.reshape(p["response"].shape[1:])


def responses(p: Any, dt: float, hz: np.ndarray, heard: tuple[int, ...] = HEARD[0], flow2: float = 0.0) -> np.ndarray:
    """Return the complex amplitudes (place, frequency, sensor) of whitened innovations per unit of a sine: flow [m/s],
    rod [m], surface as a rod [m], pressure [1], load [1]; 0 of a sensor that is not `heard`.

    `p` is a PARAMS record, `flow2` the mean squared flow of the time before [m^2/s^2]. The sensors are taken one after
    the other: their innovations are those of all at once through the inverse of the Cholesky factor of these.
    """
    Phi, G, H = np.zeros((4, 4)), np.zeros(4), np.eye(4)[[filter.ROWS[j] for j in heard]]
    transition(Phi, G, np.zeros(4), 0.0, 0.0, 0.0, 0.0, True, p, dt)
    R = np.diag(p["h_r"][list(heard)])
    # pressure and load are in doubt alike: the hinge moment of an oscillation changes with its flow
    walk = (lu17.stiffness(0.0, p) * p["flow_share"]) ** 2 * flow2 * filter.RATE_TAU * np.array((0.0, 0.0, 1.0, 3.0))
    P = solve_discrete_are(Phi.T, H.T, np.diag(p["h_q"] + walk) * dt, R)
    S = H @ P @ H.T + R
    K, root = P @ H.T @ np.linalg.inv(S), np.linalg.cholesky(S)
    into, inject = np.zeros((4, len(PLACES))), np.zeros((SENSORS, len(PLACES)))
    into[:, 0], into[:3, 4] = G * p["A_p"] / p["phi_n"], Phi[:3, 3]
    inject[:, 1:4] = np.eye(SENSORS)
    inject = inject[list(heard)]
    turned = np.exp(2j * np.pi * hz * dt)[:, None, None] * np.eye(4)
    V = np.linalg.solve(turned - Phi @ (np.eye(4) - K @ H), (into - Phi @ K @ inject)[None])
    out = np.zeros((len(PLACES), len(hz), SENSORS), complex)
    out[:, :, list(heard)] = np.linalg.solve(root, H @ V + inject).transpose(2, 0, 1)
    return out


def begin(x: np.ndarray, p: np.ndarray) -> None:
    """Write into STATE records `x` that nothing is learned."""
    x["mu"], x["sd"], x["noise"], x["wave"] = p["prior_mean"], p["prior_sd"], 1.0, (1.0, 0.0) * sums.LINES
    x["ev_octave"], x["since"] = -1.0, QUIET_S


@kernel
def restart(x):
    """Let every window begin anew."""
    sums.begin_all(x)
    decide.forget(x)


@kernel
def learn(x, p, o, dt):
    """Take the lesson of the window of octave `o`: the columns, and each sensor's noise."""
    sums.gather(x, o)
    span = p.length[o] * p.block * dt
    keep = math.exp(-span / p.memory)
    for a in range(N):
        for b in range(N):
            x.total[B + a] += x.total[at(a, b)] * x.mu[b]  # what the learned errors have explained
    for i in range(ENERGY):
        x.lesson[i] = keep * x.lesson[i] + x.total[i]
    share = span / min(p.memory, max(x.h_clock - filter.SETTLES_S, span))
    for j in range(SENSORS):
        n = x.total[NUMBER + j]
        if n > 0.0:
            ratio = min(x.total[ENERGY + j] / n, 2.0)
            x.noise[j] = max(x.noise[j] * (1.0 + share * (ratio - 1.0)), NOISE_LEAST)


@kernel
def solve(x, p):
    """Solve for the learned errors and their standard deviations."""
    J, b = x.lesson[:PAIRS], x.lesson[B:ENERGY]
    factor(J, x.L, p.prior_sd, 0, N, 0.0)
    left(J, x.L, b, p.prior_mean, x.y, 0.0, N)
    back(x.L, x.y, x.theta, N)
    for i in range(N):
        x.mu[i] = p.prior_mean[i] + x.theta[i]
        x.sd[i] = math.sqrt(inverse(x.L, i, x.y, N) + p.floor[i] * p.floor[i] * p.prior_sd[i] * p.prior_sd[i])


@kernel
def close(x, p, suspicious, dt):
    """Take a finished block: evidence of one octave, decision, lesson."""
    sums.close_block(x, p)
    quiet = x.since > QUIET_S and x.alarm < 0.5
    blocks, anew = int(x.blocks), False
    every = 1 if suspicious or not quiet or p.asks >= ALL else SPARSE
    o = sums.octave(blocks // every) if blocks % every == 0 else -1
    if o >= 0 and x.window_age[o] >= sums.YOUNG * p.length[o]:
        evidence.evaluate(x, p, o)
        anew = decide.judge(x, p, o, dt)
    first = blocks <= int(sums.FIRST) and x.alarm < 0.5
    if (quiet or first) and x.window_age[LESSON] >= p.length[LESSON]:
        learn(x, p, LESSON, dt)
    sums.fold(x, p)
    if blocks % int(sums.SOLVE_BLOCKS) == 0 and (quiet or (first and blocks == int(sums.FIRST))):
        solve(x, p)
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
        x.heard, x.at_stop = heard, 1.0 if stop else 0.0
        restart(x)
    else:
        sums.add_tick(x)
        if x.block_tick >= p.block:
            close(x, p, suspicious, dt)
