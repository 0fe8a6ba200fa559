"""What is broken in turn in the scheme of [Jay], and the rows that must see it."""

from cosim.papers.broken import Break, swap

BENCH, FLOWN, ROWS = (f"cosim.papers.jay.{name}" for name in ("bench", "flown", "rows"))
FILTER = "fdi.ema.ema_kalman"


def _unseen():
    """Return the swap of faults that reach no sensor."""
    return swap(ROWS, wrap_bench=lambda bench: lambda figure=None, **more: bench(**more))


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
        ("Phi, G and H", "(5) to (9), figures"),
        "method",
    ),
    Break(
        "the gain K of (5) is zero",
        lambda: swap(BENCH, FILTER={"P0": lambda P: 0.0 * P}),
        ("(5) to (9), figures",),
        "method",
    ),
    Break(
        "R of (5) is halved", lambda: swap(FILTER, wrap_params=_quieter), ("P_0 and R", "(5) to (9), figures"), "method"
    ),
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
        ("figure 5, largest", "figure 6,", "figure 7,", "figures 6 to 11: runs", "ten times the variance"),
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
)
