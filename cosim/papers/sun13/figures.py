"""Our figures beside figures 3 to 7 of [Sun13]: the left elevator with and without its fault, and its estimates."""

from actuators.constants import RAD_PER_DEG
from cosim.papers.drawing import Curve, Drawing, Panel, estimated
from cosim.papers.sun13 import flown
from cosim.training.flights import fly_aircraft, side

KINDS = (("ofc_liquid", "liquid", "figure 3", "figure 6"), ("ofc_solid", "solid", "figure 4", "figure 7"))
SPAN = (flown.ONSET - 5.0, flown.ONSET + 10.5)


def drawings() -> list[Drawing]:
    """Return the five Drawings."""
    return [*(_moved(*about) for about in KINDS), _fault_free(), *(_estimated(*about) for about in KINDS)]


def _moved(kind, word, beside, _):
    clean, r = fly_aircraft(duration=flown.ONSET + 10.5, seed=1), flown.faulty(kind, 1.0)
    left = [side(flight, "left") / RAD_PER_DEG for flight in (clean, r)]
    said = "the sine rides on what the law commands" if word == "liquid" else "the sine alone is left"
    curves = Curve("fault-free", left[0], "quiet"), Curve("with the fault", left[1], "true")
    return Drawing(
        "sun13",
        beside,
        f"Left elevator, {word} OFC of {flown.SHARE[kind]} of travel at 1 Hz, and without",
        "Mean of both left segments in still air, the fault from 20 s on.",
        (Panel("left elevator", "deg", curves),),
        onset=flown.ONSET,
        span=SPAN,
        row_px=200,
        look=f"20 s: {said}.",
    )


def _fault_free():
    r = fly_aircraft(duration=40.0)
    curves = (
        Curve("airframe only", flown.f_hat_airframe(r) / RAD_PER_DEG, "quiet"),
        Curve("published form", flown.f_hat(r) / RAD_PER_DEG),
    )
    return Drawing(
        "sun13",
        "figure 5",
        "Fault-free: estimates of the left elevator's fault",
        "Published form, driven by elevator positions, and the form on airframe outputs only; cruise in still "
        "air. Dashed: the 0.016 of travel that figure 6 injects.",
        (Panel("estimate", "deg", curves, (0.64, -0.64), 0.8),),
        span=(0.0, 40.0),
        row_px=200,
        look="the published form: its noise is far inside the dashed amplitude of figure 6's fault.",
    )


def _estimated(kind, word, _, beside):
    r = flown.faulty(kind, 1.0)
    f = flown.injected(r, kind) * (r.index.to_numpy() >= flown.ONSET) / RAD_PER_DEG
    least, most = flown.airframe_in_gusts(kind)
    return Drawing(
        "sun13",
        beside,
        f"{word.capitalize()} OFC of {flown.SHARE[kind]} of travel at 1 Hz, estimated",
        f"The published form gives {abs(flown.followed(kind, 1.0)):.2f} of the injected amplitude; with the "
        "block-diagonal P of our solver its whole gain sits on the elevator positions. Right: the form on airframe "
        "outputs, against the mean elevator less what the actuator's model makes of the command; in moderate "
        f"turbulence it gives {least:.2f} to {most:.2f} of that over five seeds.",
        (
            estimated("published form", "deg", flown.f_hat(r) / RAD_PER_DEG, f, word="injected"),
            estimated("airframe outputs only", "deg", flown.f_hat_airframe(r) / RAD_PER_DEG,
                      flown.beyond_command(r) / RAD_PER_DEG),
        ),
        onset=flown.ONSET,
        span=SPAN,
        row_px=200,
        look="the left axes: from 20 s on the estimate lies on the injected sine in size and frequency.",
    )  # fmt: skip
