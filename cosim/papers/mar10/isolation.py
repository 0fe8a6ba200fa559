"""Isolation on the talk's vehicle by its own table: the effector that the firing residuals have in common. [Mar10]

A family of residuals is row differences weighted by `structure.combination`, over a bound that follows from slide 11
(`vehicle.bound`): nothing is trained. What is chosen beside the talk: a sliding mean, which its summary announces, the
time for which one name must hold, four deviations of noise.

After a name the next one is looked for among the residuals that the first leaves alone (slide 15): a locked fin is left
out by its signature; a motor that lost a share of its thrust is commanded that much less from then on, by the loss that
was identified, and all residuals serve again. Of names that explain what fires, one alone is declared; of several the
one whose estimated position stands still while its command moves (slide 8's estimate of a locked fin).
"""

from dataclasses import dataclass

import numpy as np

from cosim.papers.mar10.vehicle import DT, EFFECTORS, NOISE, VANE, VehicleFlight, bound, equations, numbers
from fdi.control_redundancy import structure

DEVIATIONS = 4.0  # of the noise that a mean leaves
LOOK_S, STILL = 3.0, 0.5  # a lock is looked at that long, and its estimate moves so little of what its error does
MOTOR = EFFECTORS.index("eta")


@dataclass(frozen=True)
class Choices:
    """What the talk leaves open: mean [s], time of one name [s], share of the bound."""

    mean_s: float = 0.3
    confirm_s: float = 0.2
    share: float = 0.05  # slide 11


@dataclass(frozen=True)
class Said:
    """What was declared: [(time [s], effector)], and the loss of thrust that was identified (nan without one)."""

    names: tuple[tuple[float, str], ...]
    loss: float
    fired: np.ndarray  # (T, families), with the nominal commands


def residuals(
    flown: VehicleFlight, u_c: np.ndarray, choice: Choices
) -> tuple[list, np.ndarray, np.ndarray, np.ndarray]:
    """Return (families, value (T, families), threshold, sensitivity (T, families, 4)) with commands `u_c` (T, 4)."""
    of = numbers()
    known, G = equations(flown, of)
    e = flown.a - known - np.einsum("trj,tj->tr", G, u_c)
    window = max(1, round(choice.mean_s / DT))
    kept = structure.families(structure.TALK)
    value, limit, seen = [], [], []
    k = flown.qbar * of["area"] / of["mass"]
    sigma = np.hypot(NOISE, VANE * np.stack([k * of["cxa"], k * of["cyb"], k * of["cza"]], 1))
    most = bound(flown, of, choice.share)
    for family in kept:
        c = np.zeros_like(e)
        c[:, family.base] = 1.0
        for row, j in family.pivots:
            c[:, row] -= G[:, family.base, j] / G[:, row, j]
        value.append(_mean((c * e).sum(1), window))
        random = DEVIATIONS * np.sqrt(((c * sigma) ** 2).sum(1) / window)
        seen.append(np.einsum("tr,trj->tj", c, G))
        limit.append(_mean((np.abs(c) * most).sum(1), window) + random)
    return kept, np.stack(value, 1), np.stack(limit, 1), np.stack(seen, 1)


def _mean(y, window):
    """Return the mean of the last `window` samples, of fewer at the start."""
    total = np.concatenate([[0.0], np.cumsum(y)])
    k = np.arange(1, len(y) + 1)
    low = np.maximum(0, k - window)
    return (total[k] - total[low]) / (k - low)


def isolate(flown: VehicleFlight, choice: Choices | None = None, start_s: float = 5.0) -> Said:
    """Return what the residuals of a flight say, from `start_s` on."""
    choice = choice or Choices()
    u_c, first = flown.u_c.copy(), round(start_s / DT)
    found: list[tuple[float, str]] = []
    locked: list[int] = []
    loss, nominal = np.nan, None
    while True:
        families, r, tau, s = residuals(flown, u_c, choice)
        fired = np.abs(r) > tau
        nominal = fired if nominal is None else nominal
        usable = np.array([not any(f.signature[j] for j in locked) for f in families])
        explains = _explains(np.array([f.signature for f in families], bool)[usable], fired[:, usable])
        explains[:, locked] = False
        if np.isfinite(loss):
            explains[:, MOTOR] = False
        one = np.where(explains.sum(1) == 1, explains.argmax(1), -1)
        at = _held(one, first, max(1, round(choice.confirm_s / DT)))
        still = _locked(families, r, s, u_c, explains, locked, first)
        if at is None and still is None:
            return Said(tuple(found), loss, nominal)
        if at is None or (still is not None and still[0] < at):
            at, j = still
        else:
            j = int(one[at])
        found.append((float(flown.t[at]), EFFECTORS[j]))
        first = at + round(choice.mean_s / DT)
        if j == MOTOR:
            loss = _loss(families, r, s, u_c, at, locked)
            u_c[at:, MOTOR] *= 1.0 - loss
        else:
            locked.append(j)


def _explains(signatures, fired):
    """Return (T, 4): all families that fire react to the effector, and one does fire."""
    return (fired[:, :, None] <= signatures[None]).all(1) & fired.any(1)[:, None]


def _held(one, first, n):
    """Return the first tick from `first` on at which one name has held for `n` ticks, or None."""
    run, name = 0, -1
    for k in range(first, len(one)):
        run = run + 1 if one[k] == name and one[k] >= 0 else int(one[k] >= 0)
        name = one[k]
        if run >= n:
            return k
    return None


def _locked(families, r, s, u_c, explains, locked, first):
    """Return (tick, effector) where several explain what fires and one of them stands still while its command moves.

    The estimate of slide 8, commanded plus residual over sensitivity, is then a constant: of a fin that is locked.
    None where there is no such tick.
    """
    n = round(LOOK_S / DT)
    several = explains.sum(1) > 1
    for at in range(first + n, len(several), n // 4):
        span = slice(at - n, at)
        if several[span].mean() < 0.25:
            continue
        names = []
        for j in np.flatnonzero(explains[span][several[span]].all(0)):
            own = [i for i, f in enumerate(families) if f.signature[j] and not any(f.signature[k] for k in locked)]
            i = min(own, key=lambda i: sum(families[i].signature))
            off = r[span, i] / s[span, i, j]
            if j != MOTOR and np.std(u_c[span, j] + off) < STILL * np.std(off):
                names.append(int(j))
        if len(names) == 1:
            return at, names[0]
    return None


def _loss(families, r, s, u_c, at, locked):
    """Return the share of thrust lost: over half a second, from the family that reacts to the motor and least else."""
    ready = [i for i, f in enumerate(families) if f.signature[MOTOR] and not any(f.signature[j] for j in locked)]
    i = min(ready, key=lambda i: sum(families[i].signature))
    span = slice(at, at + round(0.5 / DT))
    return float(np.clip(-np.mean(r[span, i] / s[span, i, MOTOR] / u_c[span, MOTOR]), 0.0, 1.0))
