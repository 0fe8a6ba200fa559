"""Our figures beside figures 1 and 2 of [Alwi14]: the nonlinear aircraft at points A to E, fault-free and at fault."""

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.flight.detection.detectors import sources
from cosim.papers.alwi14 import flights as alwi14
from cosim.papers.alwi14.quiet import SHOWN
from cosim.papers.drawing import Curve, Drawing, Panel

DEG = RAD_PER_DEG
LOOKS = ("solid", "dash", "dot", "dashdot", "solid")
WORDS = (("elevator", "deg", 0.5), ("load-factor", "g", 0.1), ("angle-of-attack", "deg", 0.5))  # least half range


def drawings() -> list[Drawing]:
    """Return the two Drawings."""
    return [
        _drawing(
            (0.0, 0.0, 0.0),
            "figure 1",
            "Fault-free doublet of 0.15 g at points A to E",
            "Measured outputs that drive the observer, the elevator command, |e_y| and the three reconstructions on "
            "the nonlinear aircraft without noise, as there. The affine model misses the pitch stiffness of a point, "
            "so that the elevator's estimate follows the angle of attack: most at B and C.",
            "(c): |e_y| stays near zero, and so do the three reconstructions.",
        ),
        _drawing(
            alwi14.SENSIBLE,
            "figure 2",
            "Elevator 3 deg, load factor 0.5 g and angle of attack 5 deg at once, at points A to E",
            'From 10 s on; the sensible reading of the paper\'s "3 deg, 5 and 0.5 deg". The sensor faults reach the '
            "observer only, the 3 deg are on all four segments. Dashed: the injected faults.",
            "(c): from 10 s on each reconstruction lies on its dashed fault, all three at once.",
        ),
    ]


def _drawing(faults, beside, title, caption, look):
    flown = {point: alwi14.nonlinear(point, faults, noise=0.0) for point in alwi14.POINTS}
    roles = ("ours", "third", "second", "true", "quiet")

    def each(values):
        return tuple(
            Curve(f"point {p}", values(f, log), role, dash, dt=f.attrs["dt"])
            for (p, (f, log)), role, dash in zip(flown.items(), roles, LOOKS)
        )

    wires = sources("lpv_smo")

    def output(field, unit):
        def values(f, _):
            y = np.asarray(f[wires[field]]) / unit
            return y - y[: round(1.0 / f.attrs["dt"])].mean() if field in ("V", "h") else y

        return values

    change = {field: ", change" * (field in ("V", "h")) for field, *_ in SHOWN}
    panels = [Panel(f"(a) {word}{change[f]}", unit, each(output(f, scale))) for f, word, unit, scale in SHOWN]
    panels.append(Panel("(b) elevator command", "deg", each(lambda f, _: f["law.law.de_cmd"].to_numpy() / DEG)))
    panels.append(Panel("(b) stabiliser command", "deg", each(lambda f, _: f["law.law.stab_cmd"].to_numpy() / DEG)))
    panels.append(Panel("(c) |e_y|", "", each(lambda _, log: log["e_norm"])))
    for field, (word, unit, least), scale, fault in zip(alwi14.ESTIMATES, WORDS, alwi14.UNITS, faults):
        curves = each(lambda _, log, k=field, s=scale: log[k] / s)
        panels.append(Panel(f"(c) {word} fault", unit, curves, (fault,) if fault else (), least))
    end = min(float(f.index[-1]) for f, _ in flown.values())
    return Drawing("alwi14", beside, title, caption, tuple(panels), onset=alwi14.ONSET if any(faults) else None,
                   span=(0.0, end), row_px=150, look=look)  # fmt: skip
