"""Adaptation in flight while nothing suggests a fault: errors within tolerances, noise, load swings."""

import math

from actuators.block import kernel
from fdi.isolation.evidence import at, back, factor, inverse, left
from fdi.isolation.filter import SENSORS, SETTLES_S, N
from fdi.isolation.sums import ENERGY, NUMBER, PAIRS, B, gather

NOISE_LEAST = 0.05  # of the sensors' variance: one that reports no noise at all is not that good
FOREIGN = 2.0  # a swing of the load beyond so many times the usual counts for no more

STATE = [("lesson", "f8", (ENERGY,))]  # sums of S'S and S'e over the flight, forgotten over `memory`


@kernel
def learn(x, p, o, dt):
    """Take the lesson of the window of octave `o`: the columns, and each sensor's noise."""
    gather(x, o)
    span = p.length[o] * p.block * dt
    keep = math.exp(-span / p.memory)
    for a in range(N):
        for b in range(N):
            x.total[B + a] += x.total[at(a, b)] * x.mu[b]  # what the learned errors have explained
    for i in range(ENERGY):
        x.lesson[i] = keep * x.lesson[i] + x.total[i]
    share = span / min(p.memory, max(x.h_clock - SETTLES_S, span))
    for j in range(SENSORS):
        n = x.total[NUMBER + j]
        if n > 0.0:
            ratio = min(x.total[ENERGY + j] / n, 2.0)
            x.noise[j] = max(x.noise[j] * (1.0 + share * (ratio - 1.0)), NOISE_LEAST)


@kernel
def learn_load_swing(x, p, o, apart):
    """Take the last evaluation, of octave `o`, `apart` [s] from the one before, as a lesson of how the load swings."""
    usual = x.air_load2[o]
    if usual == 0.0:
        x.air_load2[o] = x.ev_load2
    else:
        x.air_load2[o] += apart / p.memory * (min(x.ev_load2, FOREIGN * FOREIGN * usual) - usual)


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
