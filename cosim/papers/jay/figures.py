"""Our figures beside figures 3 to 13 of [Jay]: seed 0 of the bench, quoted noise as peak value."""

from actuators.constants import RAD_PER_DEG
from cosim.papers.drawing import Curve, Drawing, Panel
from cosim.papers.jay import flown
from cosim.papers.jay.bench import COMMAND, DT, FAULT, FIGURES, SECONDS, bench

SAY = {
    6: "Velocity sensor x1.25",
    7: "Velocity sensor + 5 rad/s",
    8: "Position sensor x1.25",
    9: "Position sensor + 1 mm",
    10: "Current sensor x1.25",
    11: "Current sensor + 1 A",
}
WHY = {
    9: "The loop has moved the rod. ",
    10: "With a confirmation it would not be found. ",
    11: "The fault is on the monitor's copy: inside the current loop it would move R1 instead. ",
}


LOOK = {
    3: "the end of each pulse: estimate and position lie on each other at 2.5 mm.",
    4: "the edges: the estimated current lies on the true one in every peak.",
    5: "the dashed 0.5: with the noise as a peak value the mean stays below it, as printed.",
    6: "the edges: the mean of the innovation crosses 3 while the motor turns.",
    7: "2 s: the mean of the innovation steps beyond 3 and stays.",
    8: "R1: it settles on its threshold of 0.5 mm and crosses it in the overshoot, while R2 stays small.",
    9: "R1: it steps to 1 mm at 2 s, while R2 stays small.",
    10: "R2: it crosses 0.5 A for a sample at each edge, while R1 stays small.",
    11: "R2: it steps to 1 A at 2 s, while R1 stays small.",
    12: "the dashed thresholds: none of the three tests comes near them.",
    13: "the end of each pulse: 2.5 mm with reconfiguration, 2 mm without.",
}


def _drawing(figure, title, caption, panels, onset=None):
    return Drawing(
        "jay",
        f"figure {figure}",
        title,
        caption,
        tuple(panels),
        len(panels),
        onset=onset,
        span=(0.0, SECONDS),
        row_px=200,
        look=LOOK[figure],
    )


def _eta(out, name="innovation mean", role="ours"):
    return Curve(name, out["eta_bar"], role, dt=DT)


def _R1(out):
    return Panel("R1", "mm", (Curve("R1", 1e3 * out["R1"], "ours", dt=DT),), (0.5, -0.5), 0.7)


def _R2(out):
    return Panel("R2", "A", (Curve("R2", out["R2"], "ours", dt=DT),), (0.5, -0.5), 0.7)


def drawings() -> list[Drawing]:
    """Return eleven Drawings of the bench, and one of the flights."""
    healthy, sigma = bench(seed=0), bench(seed=0, noise=1.0)
    out = [
        _drawing(
            3,
            "Fault-free: position",
            f"Pulses of {1e3 * COMMAND:g} mm. The estimate comes from the velocity sensor alone.",
            [
                Panel(
                    "position",
                    "mm",
                    (
                        Curve("estimate", 1e3 * healthy["position_hat"], "ours", dt=DT),
                        Curve("true", 1e3 * healthy["position"], "true", "dot", dt=DT),
                    ),
                )
            ],
        ),
        _drawing(
            4,
            "Fault-free: motor current",
            "True and estimated; the gate of 0.5 A is far from their difference.",
            [
                Panel(
                    "current",
                    "A",
                    (
                        Curve("estimate", healthy["current_hat"], "ours", dt=DT),
                        Curve("true", healthy["current"], "true", "dot", dt=DT),
                    ),
                )
            ],
        ),
        _drawing(
            5,
            "Fault-free: mean of the innovation",
            "With the quoted noise as a peak value the mean stays below 0.5, as the paper has it; as one standard "
            "deviation it reaches 1.1. Dashed: 0.5.",
            [
                Panel(
                    "innovation mean",
                    "",
                    (_eta(sigma, "noise as 1 sigma", "quiet"), _eta(healthy, "noise as peak")),
                    (0.5, -0.5),
                    1.2,
                )
            ],
        ),
    ]
    for figure, (sensor, _, _) in FIGURES.items():
        run = bench(seed=0, figure=figure)
        if sensor == "velocity":
            panels = [Panel("innovation mean", "", (_eta(run),), (3.0, -3.0), 4.0)]
        else:
            panels = [_R1(run), _R2(run)]
        out.append(_drawing(figure, SAY[figure], f"{WHY.get(figure, '')}Dashed: threshold.", panels, FAULT))
    warm = bench(noise=0.0, resistance=0.05)
    out.append(
        _drawing(
            12,
            "Winding resistance 5 % up, without noise",
            "1.03, 0.18 mm and 0.14 A at most, where the paper prints 1, 0.2 and 0.1: no alarm. Dashed: thresholds.",
            [Panel("innovation mean", "", (_eta(warm),), (3.0, -3.0), 4.0), _R1(warm), _R2(warm)],
        )
    )
    without, with_it = bench(figure=8, noise=0.0), bench(figure=8, noise=0.0, reconfigure=True)
    out.append(
        _drawing(
            13,
            "Position sensor x1.25, with and without reconfiguration",
            "Without it the rod settles at 2.00 mm; closed on the estimate at the commanded 2.50 mm.",
            [
                Panel(
                    "true position",
                    "mm",
                    (
                        Curve("without", 1e3 * without["position"], "third", "dash", dt=DT),
                        Curve("reconfigured", 1e3 * with_it["position"], "ours", dt=DT),
                    ),
                    (2.0, 2.5),
                )
            ],
            FAULT,
        )
    )
    return [*out, _in_flight()]


def _in_flight():
    """Return the load factor and the elevator with the position sensor off, by what the loop closes on."""
    words = (
        ("left on it", "false", "second"),
        ("published form", "published", "third"),
        ("flight form", "true", "ours"),
    )
    frames = [(word, role, flown.flight("ema-position-bias", f"elevator.reconfigure={on}")) for word, on, role in words]
    healthy = flown.flight("ema-position-bias", "elevator.reconfigure=false", "faults=[]")
    frames.append(("healthy", "true", healthy))
    return Drawing(
        "jay",
        "figure 13",
        "Position sensor off by 5 deg in flight, by what the loop closes on",
        "Right inner elevator, electromechanical; the filter as published and the form that knows a load.",
        tuple(
            Panel(
                title,
                unit,
                tuple(
                    Curve(w, scale * f[name].to_numpy(), role, "dot" if w == "healthy" else "solid")
                    for w, role, f in frames
                ),
            )
            for title, unit, name, scale in (
                ("load factor", "g", flown.TRUE[0], 1.0),
                ("right inner elevator", "deg", flown.TRUE[1], 1.0 / RAD_PER_DEG),
            )
        ),
        2,
        onset=flown.ONSET,
        span=(8.0, 30.0),
        look="the load factor: with the flight form it lies on that of the healthy flight.",
        picture="in-flight",
    )
