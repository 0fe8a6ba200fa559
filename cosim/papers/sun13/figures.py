"""Our figures beside figures 3 to 7 of [Sun13]: the left elevator with and without its fault, and its estimates."""

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.papers.drawing import Curve, Drawing, Panel
from cosim.papers.sun13 import flown, rows
from cosim.papers.sun13.airframe import beyond_command
from cosim.training.flights import COMMAND, estimate, fly_aircraft, side
from fdi.rfafe import rfafe_airframe

KINDS = (("ofc_liquid", "liquid", "figure 3", "figure 6", 0.016), ("ofc_solid", "solid", "figure 4", "figure 7", 0.033))


def drawings() -> list[Drawing]:
    """Return the five Drawings."""
    clean = fly_aircraft(duration=flown.ONSET + 10.5, seed=1)
    span = (flown.ONSET - 5.0, flown.ONSET + 10.5)

    def left(r):
        return side(r, "left") / RAD_PER_DEG

    out = []
    for kind, word, beside, _, share in KINDS:
        r = flown.faulty(kind, 1.0)
        said = "the sine rides on what the law commands" if word == "liquid" else "the sine alone is left"
        out.append(
            Drawing(
                "sun13",
                beside,
                f"Left elevator, {word} OFC of {share} of travel at 1 Hz, and without",
                "Mean of both left segments in still air, the fault from 20 s on.",
                (
                    Panel(
                        "left elevator",
                        "deg",
                        (Curve("fault-free", left(clean), "quiet"), Curve("with the fault", left(r), "true")),
                    ),
                ),
                1,
                onset=flown.ONSET,
                span=span,
                row_px=200,
                look=f"20 s: {said}.",
            )
        )
    noisy = rows._still()
    out.append(
        Drawing(
            "sun13",
            "figure 5",
            "Fault-free: estimates of the left elevator's fault",
            "Published form, driven by elevator positions, and the form on airframe outputs only; cruise in still "
            "air. Dashed: the 0.016 of travel that figure 6 injects.",
            (
                Panel(
                    "estimate",
                    "deg",
                    (
                        Curve("airframe only", _f(noisy, "rfafe_airframe"), "quiet"),
                        Curve("published form", _f(noisy, "rfafe"), "ours"),
                    ),
                    (0.64, -0.64),
                    0.8,
                ),
            ),
            1,
            span=(0.0, 40.0),
            row_px=200,
            look="the published form: its noise is far inside the dashed amplitude of figure 6's fault.",
        )
    )
    for kind, word, _, beside, share in KINDS:
        r = flown.faulty(kind, 1.0)
        command = r[COMMAND].to_numpy() if kind == "ofc_solid" else 0.0
        f = (r[flown.INJECTED].to_numpy() - command * (r.index.to_numpy() >= flown.ONSET)) / RAD_PER_DEG
        mean = beyond_command(r) / RAD_PER_DEG
        ratio = abs(rows.published(kind, 1.0))
        out.append(
            Drawing(
                "sun13",
                beside,
                f"{word.capitalize()} OFC of {share} of travel at 1 Hz, estimated",
                f"The published form gives {ratio:.2f} of the injected amplitude; with the block-diagonal P of our "
                "solver its whole gain sits on the elevator positions. Right: the form on airframe outputs, "
                "against the mean elevator less what the actuator's model makes of the command.",
                (
                    Panel(
                        "published form",
                        "deg",
                        (Curve("estimate", _f(r, "rfafe"), "ours"), Curve("injected", f, "true", "dot")),
                    ),
                    Panel(
                        "airframe outputs only",
                        "deg",
                        (Curve("estimate", _f(r, "rfafe_airframe"), "ours"), Curve("true", mean, "true", "dot")),
                    ),
                ),
                2,
                onset=flown.ONSET,
                span=span,
                row_px=200,
                look="the left axes: from 20 s on the estimate lies on the injected sine in size and frequency.",
                picture="figure-6" if word == "liquid" else "",
            )
        )
    return out


def _f(r, name):
    log = estimate(r, name, rfafe_airframe.params("design_point") if name == "rfafe_airframe" else None)
    return np.asarray(log["f_hat_left" if name == "rfafe" else "f_hat"]) / RAD_PER_DEG
