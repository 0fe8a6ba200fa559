"""Rates beyond what was seen: the interval holds the exact answer as often as it says, on processes that have one."""

import math
import sys

import numpy as np
import pytest
from processes import DT, Process, memory, peaks
from scipy import stats

from cosim.campaign.fault_free import Moments
from cosim.compare import extreme_value
from cosim.compare.extreme_value import crossing, gaussian

RATES = (1e-2, 1e-5, 1e-9)  # per hour
HOURS, REPLICATES = 100.0, 1000
PROCESSES = {
    "Gauss-Markov, 2 s": Process(0.54),
    "Gauss-Markov, 8 s": Process(0.88),
    "Gauss-Markov, 28 s": Process(0.965),
    "heavy tails, 5 degrees of freedom": Process(0.7, df=5),
    "heavy tails, 3 degrees of freedom": Process(0.4, df=3),
    "turbulence in a tenth of the flights": Process(
        0.85, levels=(0.5, 1.0, 1.9), shares=(0.5, 0.4, 0.1), flight_s=600.0
    ),
    "flights of a minute at four levels": Process(
        0.8, levels=(0.3, 0.6, 1.0, 1.2), shares=(0.3, 0.3, 0.2, 0.2), flight_s=60.0
    ),
}


def coverage(process, replicates, *, seed=10_000, hours=HOURS):
    """Return (share of intervals with the exact rate, decades from it to the median upper end, curves that end)."""
    levels = [process.level(r) for r in RATES]
    held, above, ended = [], [], 0
    for i in range(replicates):
        windows, flights = process.windows(hours, seed + i)
        peak, of = peaks(windows, flights, memory(windows, flights))
        tail = extreme_value.fit(peak, hours, flights=of)
        if tail.note:
            ended += 1
            continue
        found = tail.rate(levels)
        held.append((found.low <= RATES) & (found.high >= RATES))
        above.append(np.log10(found.high / RATES))
    return np.mean(held, axis=0), np.median(above, axis=0), ended


@pytest.mark.slow
@pytest.mark.parametrize("name", PROCESSES)
def test_the_interval_covers_the_exact_rate_in_93_of_100_replicates(name):
    held, above, ended = coverage(PROCESSES[name], REPLICATES)
    print(
        f"\n{name}: covers {held}, upper end {above} decades above the truth, {ended} of {REPLICATES} end",
        file=sys.stderr,
    )
    assert (held >= 0.93).all() and ended <= 0.05 * REPLICATES
    assert above[0] < 1.0 and (above < 7.0).all()  # it says something


@pytest.mark.parametrize("process", [Process(0.7), Process(0.5, df=4)], ids=["Gauss-Markov", "heavy tails"])
def test_the_interval_covers_the_exact_rate_in_a_few_replicates(process):
    held, above, ended = coverage(process, 16, hours=20.0)
    assert (held >= 0.8).all() and ended <= 2 and (above < 7.0).all()


def test_more_peaks_than_the_tail_has_would_not_cover():
    """Why the number of peaks is small: with five times as many the shape is that of the mixture, not of its tail."""
    process = Process(0.9, levels=(0.5, 1.0, 2.0), shares=(0.6, 0.39, 0.01), flight_s=600.0)
    level, missed = process.level(1e-5), 0
    for i in range(6):
        windows, flights = process.windows(HOURS, i)
        found = extreme_value.fit(peaks(windows, flights, 4)[0], HOURS, 5 * extreme_value.PEAKS).rate(level)
        missed += not found.low[0] <= 1e-5 <= found.high[0]
    assert missed >= 4


def test_the_exact_rates_agree_with_what_can_be_counted_and_with_what_is_known():
    for process in (Process(0.9), Process(0.6, df=4)):
        level = process.level(5.0)
        windows, flights = process.windows(200.0, 3)
        seen = extreme_value.counted(peaks(windows, flights, memory(windows, flights))[0], 200.0, level)
        assert seen.low[0] < 5.0 < seen.high[0]
    fine = Process(0.6).rate(8.0)  # steps forget each other at high levels
    assert fine == pytest.approx(2.0 * stats.norm.sf(8.0) * 3600.0 / DT, rel=1e-3)
    assert Process(0.5, df=3).rate(5000.0) == pytest.approx(2.0 * stats.t.sf(5000.0, 3) * 3600.0 / DT, rel=5e-3)


def test_a_fit_gives_back_what_it_was_drawn_from_and_its_interval_shrinks():
    rng = np.random.default_rng(1)
    peak = 2.0 + stats.genpareto.rvs(0.1, scale=0.5, size=4000, random_state=rng)
    few, many = extreme_value.fit(peak[:500], 10.0), extreme_value.fit(peak, 80.0, 800)
    for tail in (few, many):
        exact = 50.0 * stats.genpareto.sf(6.0 - 2.0, 0.1, scale=0.5)
        found = tail.rate(6.0)
        assert found.low[0] < exact < found.high[0] and tail.shape.low < 0.1 < tail.shape.high
        assert tail.rate(tail.u).value[0] == pytest.approx(tail.k / tail.hours)
        level = tail.level(1e-3)
        assert level.low <= level.value <= level.high
        assert tail.rate(level.value).value[0] == pytest.approx(1e-3, rel=1e-6)
    ratio = [math.log(t.rate(6.0).high[0] / t.rate(6.0).low[0]) for t in (few, many)]
    assert ratio[1] < 0.7 * ratio[0]
    at_u = few.rate(few.u)  # there the interval is that of a count
    assert (at_u.low[0], at_u.high[0]) == pytest.approx([x / 10.0 for x in (79.6, 123.7)], rel=0.01)


def test_where_there_is_no_tail_the_curve_ends_and_says_why():
    rng = np.random.default_rng(2)
    assert "peaks" in extreme_value.fit(rng.normal(size=100), 1.0).note
    assert "saturates" in extreme_value.fit(np.minimum(rng.exponential(size=5000), 2.0), 1.0).note
    two = np.concatenate([rng.normal(0.0, 0.01, 900), rng.normal(10.0, 0.01, 60)])
    ended = extreme_value.fit(two, 1.0)
    assert "Pareto" in ended.note
    with pytest.raises(ValueError, match="Pareto"):
        ended.rate(11.0)
    good = extreme_value.fit(rng.exponential(size=5000), 1.0)
    with pytest.raises(ValueError, match="holds from"):
        good.rate(good.u - 0.1)


def test_peaks_that_a_rare_condition_makes_are_told():
    """Two in a thousand flights are three times as rough: how many there are of them is not known, nor is the curve."""
    told = []
    for levels in ((1.0, 3.0), (1.0, 1.0)):
        process = Process(0.9, levels=levels, shares=(0.998, 0.002), flight_s=600.0)
        for seed in range(4):
            windows, flights = process.windows(HOURS, seed)
            peak, of = peaks(windows, flights, 4)
            told.append("flights" in extreme_value.fit(peak, HOURS, flights=of).note)
    assert told == [True] * 4 + [False] * 4


def test_peaks_stand_apart_and_never_across_flights():
    m = np.array([1.0, 5.0, 2.0, 4.0, 1.0, 1.0, 6.0, 7.0, 1.0])
    flights = np.array([0, 0, 0, 0, 0, 0, 0, 1, 1])
    heights, of = peaks(m, flights, 2)
    assert list(heights) == [5.0, 6.0, 7.0] and list(of) == [0, 0, 1]
    assert list(peaks(m, flights, 1)[0]) == [5.0, 4.0, 6.0, 7.0]


def test_the_memory_of_a_process_is_found():
    runs = [memory(*Process(rho).windows(20.0, 1)) for rho in (0.3, 0.9, 0.97)]
    assert runs[0] <= 2 < runs[1] < runs[2] < 40


def gauss(rho, n, seed, sigma=1.0):
    from scipy.signal import lfilter

    rng = np.random.default_rng(seed)
    e = rng.normal(size=n) * math.sqrt(1.0 - rho * rho)
    return sigma * lfilter([1.0], [1.0, -rho], e, zi=[rho * rng.normal()])[0]


def test_the_crossing_rate_of_a_gaussian_residual_is_covered_and_bounds_the_passages():
    process = Process(0.8)
    levels = [process.level(r) for r in RATES]
    exact = crossing(np.array(levels), 0.8) * 3600.0 / DT
    assert (exact >= RATES).all() and (exact < 1.6 * np.array(RATES)).all()
    held, bound, said = [], [], 0
    for i in range(30):
        found = gaussian([Moments.of(gauss(0.8, 4000, 50 * i + j)) for j in range(20)], DT)
        said += bool(found.note)
        if not found.note:
            rate = found.rate(levels)
            held.append((rate.low <= exact) & (exact <= rate.high))
            bound.append(rate.high >= RATES)
    assert said <= 4 and (np.mean(held, axis=0) > 0.85).all() and (np.mean(bound, axis=0) >= 0.9).all()


def test_crossings_tend_to_the_formula_of_rice_where_the_residual_is_smooth():
    c, dt = np.array([2.0, 4.0, 6.0]), 0.01
    rho = 1.0 - 0.5 * dt * dt  # m2 / m0 = 1
    assert crossing(c, rho) / dt == pytest.approx(np.exp(-0.5 * c * c) / math.pi, rel=1e-2)


def test_what_is_not_gaussian_or_not_stationary_is_told():
    rng = np.random.default_rng(3)
    flights = [rng.normal(size=3000) for _ in range(20)]
    says = lambda change: gaussian([Moments.of(change(i, r)) for i, r in enumerate(flights)], DT).note  # noqa: E731
    assert says(lambda i, r: r) == ""
    assert "mean" in says(lambda i, r: r + 0.1) and "variance" in says(lambda i, r: r * (1.0 + 0.3 * (i % 2)))
    assert "skewed" in says(lambda i, r: r + 0.2 * r * r) and "tails" in says(lambda i, r: r**3)
    assert "samples" in gaussian([Moments.of(flights[0][:50])], DT).note
    assert "move" in gaussian([Moments.of(np.zeros(500))] * 20, DT).note
