"""Our figures beside figures 2 to 7 of [Lu17]: one seed of the bench without load, and the mean error of 100."""

import numpy as np

from cosim.papers.drawing import Curve, Drawing, Panel, estimated
from cosim.papers.lu17 import bench, flown
from cosim.papers.lu17.stats import case

SEEN = {
    "fault-free": "No fault, although the paper's caption says liquid OFC: section IV.C calls it fault-free.",
    "liquid OFC": "From 12 s 0.02 sin(2 pi t) is added at the valve. The servo fights it, the rod swings by "
    "{swing:.1f} mm; f_hat follows {delay:.0f} ms late, which every seed shares: the mean error in (f) is no noise.",
    "solid OFC": "From 12 s the valve obeys the sine alone. f = s - u steps with the command; between the steps the "
    "published filter reads it 10 % short, because (17) is integrated at x_bar with sign(u).",
    "liquid jamming": "From 12 s the rod sensor reads 5 mm too much. The filter's state does not hear of it and "
    "steers: the rod stays on its command. The sensor deviates; the rod does where the measurement is fed back.",
    "solid jamming": "From 12 s the surface stays where it is. As in (5) the fault is added to an actuator that works "
    "on: q in (b) is that virtual rod, and f its distance from the stuck surface.",
    "runaway": "From 12 s the surface runs to its stop at 20 deg/s, 89 mm of rod; modelled as the jamming.",
}
LOOK = {
    "fault-free": "(e): the estimate stays within its noise about zero, while (a) the rod lies on its command.",
    "liquid OFC": "(e): from 12 s on the estimate follows the true sine, a thirtieth of a period late.",
    "solid OFC": "(a): from 12 s on the rod only oscillates where the fault found it, and (e) the estimate steps.",
    "liquid jamming": "(e): at 12 s the estimate steps to the 5 mm by which sensor and rod part in (a).",
    "solid jamming": "(e): the estimate lies on the true fault, the distance of the stuck surface from the rod in (b).",
    "runaway": "(e): the estimate follows the ramp of the surface in (a) up to the stop.",
}
ROLES = ("second", "third", "ours")  # of flown.FORMS
LOADED = " Under a hinge load that the filter does not know, f_hat is off by {error:.3g} {unit} on average."


def drawings() -> list[Drawing]:
    """Return six Drawings of the bench, and figures 2 to 7 in flight."""
    return [*(_drawing(scenario) for scenario in SEEN), _in_flight()]


def _in_flight():
    """Return panel (e) of each figure, in flight, with the three ways of knowing the load."""
    panels = []
    for scenario, (figure, watch) in flown.FIGURES.items():
        scale, unit, least = (1e3, "mm", 12.0) if watch == "rtsekf" else (1.0, "of u", 0.02)
        frames = {form: flown.flown(scenario, form) for form in flown.FORMS}
        true = scale * flown.true_fault(scenario, frames["pressure"], flown.flown("fault-free", "pressure", watch))
        curves = [Curve(form, scale * f.f_hat.to_numpy(), role) for (form, f), role in zip(frames.items(), ROLES)]
        most = 1.5 * max(np.abs(true).max(), least)
        title = f"figure {figure}(e), {scenario.replace('-', ' ').replace('ofc', 'OFC')}"
        panels.append(Panel(title, unit, (*curves, Curve("true", true, "true", "dot")), limits=(-most, most)))
    return Drawing(
        "lu17",
        "figures 2 to 7 (e)",
        "Fault estimates of figures 2 to 7 in the aircraft, by how the load is known",
        "Left inner elevator, 3-2-1-1 of 4 deg, light turbulence; the servo closes on the filter that is shown, "
        "IOTSEKF in 2 to 4, RTS-EKF in 5 to 7, where the form with a pressure has the surface sensor, too, and is "
        "blind to what moves both. True is that of its flight. Without a load in the model the rod that steers by it "
        "leaves its command.",
        tuple(panels),
        onset=flown.ONSET,
        span=(8.0, 25.0),
        look="the form with a pressure: in figures 2 to 5 it lies on the true fault, from which the two others depart.",
    )


def _drawing(scenario):
    figure, watch = bench.SCENARIOS[scenario]
    out = bench.fly(scenario)
    first = out[0]
    jam = watch == "rtsekf"
    unit, scale = ("mm", 1e3) if jam else ("of u", 1.0)
    command = 1e3 * bench.schedule(scenario)["command"]
    error = scale * (out["f_hat"] - out["f"])
    start = np.arange(out.shape[1]) >= round(0.5 / bench.DT)
    one, mean = (np.where(start, y, np.nan) for y in (error[0], error.mean(axis=0)))
    shown = [Curve("command", command, "quiet", "dot")]
    if scenario == "liquid jamming":
        fed = bench.fly(scenario, measured=True, seeds=1)[0]
        shown += [
            Curve("sensor", 1e3 * first["y"], "second", "dash"),
            Curve("rod", 1e3 * first["surface"], "true"),
            Curve("rod, measurement fed back", 1e3 * fed["surface"], "third", "dashdot"),
        ]
    else:
        shown.append(Curve("surface" if jam else "rod", 1e3 * first["surface"], "true"))

    panels = (
        Panel("(a) command and " + ("surface" if jam else "rod"), "mm", tuple(shown)),
        estimated("(b) q", "mm", 1e3 * first["q_hat"], 1e3 * first["q"]),
        estimated("(c) q'", "mm/s", 1e3 * first["qd_hat"], 1e3 * first["qd"]),
        estimated("(d) pressure over supply", "", first["x3_hat"], first["x3"]),
        estimated("(e) fault", unit, scale * first["f_hat"], scale * first["f"], 1.0 if jam else 0.02),
        Panel("(f) error of the fault", unit, (Curve("one seed", one, "quiet"), Curve("mean of 100 seeds", mean))),
    )
    swing = 1e3 * np.abs(out["q"] - out["r"])[:, round(20.5 / bench.DT) :].max()
    text = SEEN[scenario].format(swing=swing, delay=case(scenario)["delay", "after"])
    loaded = case(scenario, "F_d unknown")
    phase = "whole" if scenario == "fault-free" else "after"
    text += LOADED.format(error=scale * loaded["fault error", phase], unit=unit)
    return Drawing(
        "lu17",
        f"figure {figure}",
        f"{scenario[0].upper()}{scenario[1:]}, {'RTS-EKF' if jam else 'IOTSEKF'} as published, no load",
        text,
        panels,
        onset=None if scenario == "fault-free" else bench.ONSET,
        span=(0.0, bench.SECONDS),
        look=LOOK[scenario],
    )
