"""What is broken in turn in the scheme of [Jay], and the rows that must see it."""

from cosim.papers.broken import Break, swap

BENCH, FLOWN, ROWS = (f"cosim.papers.jay.{name}" for name in ("bench", "flown", "rows"))
FILTER = "fdi.ema.ema_kalman"


def _unseen():
    """Return the swap of faults that reach no sensor."""
    return swap(ROWS, wrap_bench=lambda bench: lambda figure=None, **more: bench(**more))


def _blind(flight):
    own = [f"detectors.ema_kalman_flight.{name}=0.02" for name in ("pair_threshold", "th_speed", "th_both", "th_jump")]
    return lambda name, *changes: flight(name, *changes, *own)


def _loose(flight):
    return lambda name, *changes: flight(name, "tolerances.ema.K_B=0.8", "tolerances.ema.K_T=0.8", *changes)


def _exact(bench):
    return lambda *, loop_bias=0.0, matrices=None, **more: bench(**more)


def _slow():
    return swap(ROWS, wrap_step=lambda step: lambda: (100.0 * step()[0], ""))


def _quieter(params):
    return lambda kind="nozzle", **more: params(kind, **{"R": 0.00125, **more})


def _heavy(nozzle):
    """Return the nozzle's symbols with a motor that is 1 % heavier."""

    def other():
        held = nozzle()
        return held | {"J_M": 1.01 * held["J_M"]}

    return other


BREAKS = (
    Break(
        "J_M of the filter's model is 1 % too large",
        lambda: swap("actuators.ema.jay", wrap__nozzle=_heavy),
        ("Phi, G and H", "(5) to (9)"),
        "method",
    ),
    Break(
        "the gain K of (5) is zero", lambda: swap(BENCH, FILTER={"P0": lambda P: 0.0 * P}), ("(5) to (9)",), "method"
    ),
    Break("R of (5) is halved", lambda: swap(FILTER, wrap_params=_quieter), ("P_0 and R", "(5) to (9)"), "method"),
    Break(
        "the filter's G (5) is 15 % too large",
        lambda: swap(BENCH, FILTER={"G": lambda G: 1.15 * G}),
        (
            "figure 3,",
            "figure 4,",
            "section 3.3, fault-free",
            "figures 8 and 9",
            "figures 10 and 11",
            "resistance + 5 %: farthest",
            "resistance +- 5 %",
        ),
        "method",
    ),
    Break(
        "the innovation is divided by ten standard deviations (6)",
        lambda: swap(BENCH, FILTER={"R": lambda R: 100.0 * R}),
        ("figure 5, largest", "figure 6,", "figure 7,", "figures 6 to 11", "ten times the variance"),
        "method",
    ),
    Break(
        "the faults reach no sensor",
        _unseen,
        ("figure 8,", "figure 9,", "figure 10,", "figure 11, current + 1 A", "without reconfiguration: settles"),
    ),
    Break(
        "the filter's screw has the wrong sign (9)",
        lambda: swap(BENCH, FILTER={"lead": lambda N: -N}),
        ("with reconfiguration: settles", "figure 13, reconfigured: farthest"),
        "method",
    ),
    Break(
        "the quoted noise is halved",
        lambda: swap(ROWS, wrap__quiet=lambda quiet: lambda noise: quiet(noise / 2)),
        ("figure 5, the same with the quoted noise",),
    ),
    Break("K_T and K_B of the motor are 20 % off", lambda: swap(FLOWN, wrap_flight=_loose), ("in flight, fault-free",)),
    Break(
        "the loop stays closed on the faulty sensor",
        lambda: swap(FLOWN, wrap_kept=lambda kept: lambda reconfigure: kept("false")),
        ("5 deg, reconfigured",),
        "option",
    ),
    Break(
        "position and surface are compared only from 20 mm apart",
        lambda: swap(FLOWN, wrap_flight=_blind),
        ("drifts of 0.02 to 0.5 deg/s of the position sensor",),
        "option",
    ),
    Break(
        "no sensor inside the loop is faulty, no matrix is rounded",
        lambda: swap(ROWS, wrap_bench=_exact),
        ("figure 11, but", "Phi and G as printed"),
    ),
    Break(
        "the hinge moment is half as large",
        lambda: swap(ROWS, wrap_under_load=lambda load: lambda **more: load(500.0, **more)),
        ("hinge moment + 1 kN m",),
    ),
    Break(
        "in flight no sensor is faulty",
        lambda: swap(FLOWN, wrap_flight=lambda flight: lambda name, *changes: flight(name, "faults=[]")),
        (
            "faults of the position sensor: sizes",
            "faults of the velocity sensor: sizes",
            "faults of the current sensor",
        ),
    ),
    Break(
        "the flight form reconfigures in every flight",
        lambda: swap(FLOWN, wrap_kept=lambda kept: lambda reconfigure: kept("true")),
        ("the same without reconfiguration", "the same reconfigured as published"),
        "option",
    ),
)
