"""Our figures beside figures 3 to 13 of [Jay]: seed 0 of the bench, quoted noise as peak value."""

from actuators.constants import RAD_PER_DEG
from cosim.papers.drawing import Curve, Drawing, Panel, estimated
from cosim.papers.jay import flown
from cosim.papers.jay.bench import COMMAND, FAULT, FIGURES, SECONDS, bench

SHOWN = {  # figure -> title, caption, what to look at
    3: ("Fault-free: position",
        f"Pulses of {1e3 * COMMAND:g} mm. The estimate comes from the velocity sensor alone.",
        "the end of each pulse: estimate and position lie on each other at 2.5 mm."),
    4: ("Fault-free: motor current", "True and estimated; the gate of 0.5 A is far from their difference.",
        "the edges: the estimated current lies on the true one in every peak."),
    5: ("Fault-free: mean of the innovation",
        "With the quoted noise as a peak value the mean stays below 0.5, as the paper has it; as one standard "
        "deviation it reaches 1.1. Dashed: 0.5.",
        "the dashed 0.5: with the noise as a peak value the mean stays below it, as printed."),
    6: ("Velocity sensor x1.25", "Dashed: threshold.",
        "the edges: the mean of the innovation crosses 3 while the motor turns."),
    7: ("Velocity sensor + 5 rad/s", "Dashed: threshold.",
        "2 s: the mean of the innovation steps beyond 3 and stays."),
    8: ("Position sensor x1.25", "Dashed: threshold.",
        "R1: it settles on its threshold of 0.5 mm and crosses it in the overshoot, while R2 stays small."),
    9: ("Position sensor + 1 mm", "The loop has moved the rod. Dashed: threshold.",
        "R1: it steps to 1 mm at 2 s, while R2 stays small."),
    10: ("Current sensor x1.25", "With a confirmation it would not be found. Dashed: threshold.",
         "R2: it crosses 0.5 A for a sample at each edge, while R1 stays small."),
    11: ("Current sensor + 1 A",
         "The fault is on the monitor's copy: inside the current loop it would move R1 instead. Dashed: threshold.",
         "R2: it steps to 1 A at 2 s, while R1 stays small."),
    12: ("Winding resistance 5 % up, without noise",
         "1.03, 0.18 mm and 0.14 A at most, where the paper prints 1, 0.2 and 0.1: no alarm. Dashed: thresholds.",
         "the dashed thresholds: none of the three tests comes near them."),
    13: ("Position sensor x1.25, with and without reconfiguration",
         "Without it the rod settles at 2.00 mm; closed on the estimate at the commanded 2.50 mm.",
         "the end of each pulse: 2.5 mm with reconfiguration, 2 mm without."),
}  # fmt: skip


def drawings() -> list[Drawing]:
    """Return eleven Drawings of the bench, and one of the flights."""
    return [*(_drawing(figure) for figure in SHOWN), _in_flight()]


def _drawing(figure):
    title, caption, look = SHOWN[figure]
    onset = FAULT if figure in FIGURES or figure == 13 else None
    return Drawing("jay", f"figure {figure}", title, caption, _panels(figure), onset=onset, span=(0.0, SECONDS),
                   row_px=200, look=look)  # fmt: skip


def _panels(figure):
    if figure == 13:
        without, with_it = (1e3 * bench(figure=8, noise=0.0, reconfigure=on)["position"] for on in (False, True))
        curves = Curve("without", without, "third", "dash"), Curve("reconfigured", with_it)
        return (Panel("true position", "mm", curves, (2.0, 2.5)),)
    run = bench(noise=0.0, resistance=0.05) if figure == 12 else bench(figure=figure if figure in FIGURES else None)
    if figure == 3:
        return (estimated("position", "mm", 1e3 * run["position_hat"], 1e3 * run["position"]),)
    if figure == 4:
        return (estimated("current", "A", run["current_hat"], run["current"]),)
    if figure == 5:
        sigma = Curve("noise as 1 sigma", bench(noise=1.0)["eta_bar"], "quiet")
        curves = sigma, Curve("noise as peak", run["eta_bar"])
        return (Panel("innovation mean", "", curves, (0.5, -0.5), 1.2),)
    mean = Panel("innovation mean", "", (Curve("innovation mean", run["eta_bar"]),), (3.0, -3.0), 4.0)
    left = tuple(
        Panel(name, unit, (Curve(name, scale * run[name]),), (0.5, -0.5), 0.7)
        for name, unit, scale in (("R1", "mm", 1e3), ("R2", "A", 1.0))
    )
    return (mean, *left) if figure == 12 else (mean,) if FIGURES[figure][0] == "velocity" else left


def _in_flight():
    """Return the load factor and the elevator with the position sensor off, by what the loop closes on."""
    words = {"left on it": ("false", "second"), "published form": ("published", "third"),
             "flight form": ("true", "ours")}  # fmt: skip
    frames = [(word, role, "solid", flown.flight(on)) for word, (on, role) in words.items()]
    frames.append(("healthy", "true", "dot", flown.healthy()))
    panels = [
        Panel(title, unit, tuple(Curve(word, scale * f[name].to_numpy(), role, dash) for word, role, dash, f in frames))
        for title, unit, name, scale in (
            ("load factor", "g", flown.TRUE[0], 1.0),
            ("right inner elevator", "deg", flown.TRUE[1], 1.0 / RAD_PER_DEG),
        )
    ]
    return Drawing(
        "jay",
        "figure 13",
        "Position sensor off by 5 deg in flight, by what the loop closes on",
        "Right inner elevator, electromechanical; the filter as published and the form that knows a load. Off the "
        f"healthy elevator by {flown.off('false'):.2g} deg rms on the sensor, {flown.off('published'):.2g} on the "
        f"estimate of the published form, {flown.off('true'):.2g} on that of the flight form.",
        tuple(panels),
        onset=flown.ONSET,
        span=(8.0, 30.0),
        look="the load factor: with the flight form it lies on that of the healthy flight.",
    )
