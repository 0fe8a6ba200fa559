"""Adaptation in flight while nothing suggests a fault: errors within tolerances, noise, load swings."""

import math

from actuators.block import kernel
from fdi.isolation.evidence import at, factor, inverse
from fdi.isolation.filter import SENSORS, SETTLES_S, N
from fdi.isolation.sums import ENERGY, NUMBER, PAIRS, gather

NOISE_LEAST = 0.05  # of the sensors' variance: one that reports no noise at all is not that good
FOREIGN = 2.0  # a swing of the load beyond so many times the usual counts for no more


@kernel
def learn(x, p, o, dt):
    """Take the lesson of the window of octave `o`: the columns, and each sensor's noise."""
    gather(x, o)
    span = p.length[o] * p.block * dt
    keep = math.exp(-span / p.memory)
    for a in range(N):
        lesson = x.bb[a]
        for b in range(N):
            lesson += x.JJ[at(a, b)] * x.mu[b]
        x.lesson_b[a] = keep * x.lesson_b[a] + lesson
    for i in range(PAIRS):
        x.lesson_J[i] = keep * x.lesson_J[i] + x.JJ[i]
    share = span / min(p.memory, max(x.h_clock - SETTLES_S, span))
    for j in range(SENSORS):
        n = x.tt[NUMBER, j]
        if n > 0.0:
            ratio = min(x.tt[ENERGY, j] / n, 2.0)
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
    L = x.LL
    for i in range(N):
        x.prior[1, i] = p.prior_sd[i]
    for i in range(PAIRS):
        x.JJ[i] = x.lesson_J[i]
    factor(x, 0)
    for a in range(N):
        i = a * (a + 1) // 2
        v = x.lesson_b[a] + p.prior_mean[a] / (p.prior_sd[a] * p.prior_sd[a])
        for k in range(a):
            v -= L[i + k] * x.yy[k]
        x.yy[a] = v / L[i + a]
    for a in range(N - 1, -1, -1):
        v = x.yy[a]
        for k in range(a + 1, N):
            v -= L[k * (k + 1) // 2 + a] * x.mu[k]
        x.mu[a] = v / L[a * (a + 3) // 2]
    for i in range(N):
        x.sd[i] = math.sqrt(inverse(x, i) + p.floor * p.floor * p.prior_sd[i] * p.prior_sd[i])
