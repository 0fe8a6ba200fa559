"""What is broken in turn in the filters of [Lu17], and the rows that must see it."""

import numpy as np

from cosim.papers.broken import Break, swap
from fdi.hydraulic import iotsekf

BENCH, FLOWN = "cosim.papers.lu17.bench", "cosim.papers.lu17.flown"
EQUATION = "actuators.hydraulic.lu17"


def _biased(column, by):
    """Return the swap of a bench whose draws have a mean: rod sensor (0), process noise of q, q', x3 (1 to 3)."""

    def wrap(noise):
        def draws(seeds):
            return noise(seeds) + by * (np.arange(5) == column)

        return draws

    return lambda: swap(BENCH, wrap__noise=wrap)


def _slow_walk(watching):
    def other(*asked):
        detector, words = watching(*asked)
        return detector, [*words, f"detectors.iotsekf.q_f={1e-4 * iotsekf.params()['q_f'][0]}"]

    return other


def _schedule(**fields):
    """Return the swap of an experiment in which fields of every tick are set."""

    def wrap(schedule):
        def changed(scenario, *rate):
            tick = schedule(scenario, *rate)
            for name, value in fields.items():
                tick[name] = value
            return tick

        return changed

    return lambda: swap(BENCH, wrap_schedule=wrap)


def _filter(**changes):
    return lambda: swap(BENCH, FILTER=changes)


def _known(**share):
    return lambda: swap(BENCH, wrap_MODEL=lambda held: held | share)


def _one_speed(schedule):
    return lambda scenario, rate=None: schedule(scenario)


def _constant(equation):
    """Return the product's parameters of (4) with a larger piston."""
    return lambda **values: equation(**{"A_p": 0.00251, **values})


BREAKS = (
    Break(
        "K_f of (29) is zero: the filter never estimates a fault",
        _filter(q_f=lambda q: 1e-24, P0_f=lambda P: 1e-24),
        (
            "figure 3(b)-(d)",
            "figure 3(e), ",
            "figure 4(b)-(d)",
            "figure 4(e)-(f)",
            "squared innovation",
            "squared error of f_hat",
        ),
        "method",
    ),
    Break("a block holds another piston area", lambda: swap(EQUATION, wrap_params=_constant), ("(6), con",), "method"),
    Break(
        "the truth has half of the load that it should",
        lambda: swap(BENCH, HM0=-400.0, HMD=-10e3),
        ("(4), truth",),
    ),
    Break(
        "the surface jams at a runaway's rate",
        lambda: swap(FLOWN, wrap_flight=lambda fly: lambda name, *c: fly(name.replace("solid-jam", "runaway"), *c)),
        ("figure 6(a)",),
    ),
    Break(
        "the runaway is a jam",
        lambda: swap(FLOWN, wrap_flight=lambda fly: lambda name, *c: fly(name.replace("runaway", "solid-jam"), *c)),
        ("figure 7(a)",),
    ),
    Break(
        "the fault of (28) walks a hundredth as far in flight",
        lambda: swap(FLOWN, wrap_watching=_slow_walk),
        ("figure 3(e) in flight, published",),
        "method",
    ),
    Break("every runaway has one speed", lambda: swap(BENCH, wrap_schedule=_one_speed), ("figure 7(e), a",)),
    Break(
        "the rod sensor reads 2 mm too much",
        _biased(0, 20.0),
        ("figure 2(a), no load", "figure 2(b)-(d), no load", "figure 3(b)-(d), no load", "figure 4(b)-(d), no load"),
    ),
    Break(
        "the pressure walks off by one sigma per tick, which (17) does not know",
        _biased(3, 1.0),
        ("figure 2(e)-(f), no load",),
    ),
    Break(
        "F_d of (9) and (17) has the wrong sign",
        _known(**{"F_d known": -1.0}),
        (
            "figure 2(b)-(d), F_d known",
            "figure 2(e)-(f), F_d known",
            "figure 3(b)-(d), F_d known",
            "figure 4(b)-(d), F_d known",
            "figures 5 to 7(e)-(f), F_d known",
        ),
        "method",
    ),
    Break(
        "the filter's valve flow phi_n is 20 % too large",
        _filter(phi_n=lambda phi: 1.2 * phi),
        ("figure 3(e), no load", "figure 3(e), F_d known"),
        "method",
    ),
    Break(
        "the filter's valve flow phi_n is half of it",
        _filter(phi_n=lambda phi: 0.5 * phi),
        ("figure 6(e)-(f)", "figure 7(e)-(f)"),
        "method",
    ),
    Break("the fault reaches no valve", _schedule(f_u=0.0, s_u=0.0), ("figure 3(a)",)),
    Break("the walk (14) is ten thousand times smaller", _filter(q_f=lambda q: 1e-4 * q), ("figure 3(f)",), "method"),
    Break("the solid OFC is added to u instead of replacing it", _schedule(s_u=0.0), ("figure 4(a)",)),
    Break(
        "the rod sensor has no fault",
        _schedule(bias=0.0),
        ("the measurement fed back", "figures 5 to 7(e)-(f), no load"),
    ),
    Break(
        "the filter's piston area is 5 % too large",
        _filter(A_p=lambda A: 1.05 * A),
        ("figures 5 to 7(b)-(d), F_d known",),
        "method",
    ),
    Break(
        "the rod is pushed by one sigma of process noise per tick", _biased(2, 1.0), ("figures 5 to 7(b)-(d), no load",)
    ),
    Break(
        "the linear servo is the nonlinear one",
        lambda: swap(BENCH, wrap_fly=lambda fly: lambda *args, linear=False, **more: fly(*args, **more)),
        ("section III.B, F_d known",),
        "option",
    ),
    Break(
        "the walk (14) of the two-stage filter is hundred times smaller",
        _filter(q_f=lambda q: 0.01 * q),
        ("section IV.B, a fault",),
        "method",
    ),
)
