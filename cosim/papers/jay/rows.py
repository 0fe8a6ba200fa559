"""[Jay] row by row, figures 3 to 13; the bench and its assumptions are in `jay.bench`."""

import functools

import numpy as np

from cosim.papers.jay.bench import DT, FAULT, FIGURES, SECONDS, SEEDS, bench
from fdi.ema import ema_kalman

LIMITS = np.array([3.0, 0.5, 0.5])  # of innovation mean, R1 [mm], R2 [A]; sections 4.1 and 3.3


def _peaks(out, since=0.0):
    """Return the largest innovation mean [-], R1 [mm] and R2 [A] from `since` [s] on."""
    late = out[round(since / DT) :]
    return np.array([np.abs(late["eta_bar"]).max(), 1e3 * np.abs(late["R1"]).max(), np.abs(late["R2"]).max()])


run = functools.cache(bench)


def _seeds(**how):
    """Return the runs of all seeds."""
    return [run(seed=s, **how) for s in SEEDS]


def _first(out):
    """Return the sensor that is named first from the fault on, 0 for none."""
    named = out["isolated_part"][round(FAULT / DT) :]
    return int(named[named > 0][0]) if named.any() else 0


def right() -> tuple[float, str]:
    """Return (runs in which the faulty sensor is named first, of how many)."""
    found = [_first(r) == ema_kalman.ISOLABLE_PARTS.index(FIGURES[f][0]) for f in FIGURES for r in _seeds(figure=f)]
    return sum(found), f"of {len(found)}"


def from_print() -> tuple[float, str]:
    """Return (largest distance of the three numbers of section 4.4 from print over 0.05, what they are)."""
    found = _peaks(run(noise=0.0, resistance=0.05))
    told = "{:.2f}, {:.2f} mm, {:.2f} A".format(*found)
    chosen = "two numbers that are not printed, lever arm and R's share of the loop, were chosen for these three"
    return np.abs(found - (1.0, 0.2, 0.1)).max() / 0.05, f"{told}; {chosen}"


def pulse() -> float:
    """Return the estimated position at the end of a pulse [mm]."""
    return 1e3 * run()["position_hat"][round(1.0 / DT) - 1]


def innovation(peak: bool) -> float:
    """Return the largest innovation mean of ten fault-free seeds; `peak`: the quoted noise is three deviations."""
    return max(_peaks(r)[0] for r in _seeds(noise=1 / 3 if peak else 1.0))


def variance() -> tuple[float, str]:
    """Return ten times the variance of the mean of ten eta, 1 for white ones of unit variance."""
    found, peak = (10.0 * np.mean([np.var(r["eta_bar"][20:]) for r in _seeds(noise=noise)]) for noise in (1.0, 1 / 3))
    return found, f"{peak:.2f} with the noise as a peak value, which (6) does not know"


def quiet() -> float:
    """Return the largest test over its threshold of ten fault-free seeds."""
    return max((_peaks(r) / LIMITS).max() for r in _seeds(noise=1 / 3))


def crosses(figure: int, test: int) -> float:
    """Return the least peak of ten seeds of a test of a figure's fault."""
    return min(_peaks(r, FAULT)[test] for r in _seeds(figure=figure))


def stays(figures: tuple, test: int) -> float:
    """Return the largest peak of ten seeds of a test that the faults of these figures do not move."""
    return max(_peaks(r, FAULT)[test] for k in figures for r in _seeds(figure=k))


def resistance() -> float:
    """Return the largest test over its threshold with the resistance 5 % up or down."""
    return max((_peaks(r) / LIMITS).max() for rise in (0.05, -0.05) for r in _seeds(resistance=rise))


def settles(reconfigure: bool) -> float:
    """Return where the position settles with the fault of figure 8 [mm], at the end of the last whole pulse."""
    position = bench(figure=8, noise=0.0, reconfigure=reconfigure)["position"]
    return 1e3 * position[round((SECONDS - 1.0) / DT) - 1]


def smooth() -> float:
    """Return how far the reconfigured loop is from the healthy one from 4 s on [mm]."""
    mended, healthy = (bench(figure=f, noise=0.0, reconfigure=f is not None)["position"] for f in (8, None))
    return 1e3 * np.abs(mended - healthy)[round(4.0 / DT) :].max()
