"""What the maps of the envelope show, and in which colours: shared by the page and by the picture."""

from dataclasses import dataclass

# cividis (Nunez, Anderton, Renslow 2018) at eighths: read alike with and without colour vision
STOPS = ("#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#fee838")
REASON = {  # reason -> (colour, letter, word)
    "stall": ("#d55e00", "S", "stall"),
    "thrust": ("#cc79a7", "T", "thrust"),
    "speed": ("#aab2bb", "M", "Mach 0.95"),
    "stabiliser": ("#56b4e9", "B", "stabiliser"),
    "none found": ("#ffffff", "?", "no trim found"),
}


@dataclass(frozen=True)
class Quantity:
    """One quantity of the trim map: column, heading, unit, digits, range of the colours, factor, what it tells."""

    column: str
    heading: str
    unit: str
    digits: int
    low: float
    high: float
    factor: float = 1.0
    told: str = ""


QUANTITIES = (
    Quantity("alpha_deg", "Trim angle of attack", "deg", 1, -2.0, 18.0),
    Quantity("stabilizer_deg", "Stabiliser in trim, trailing edge down +", "deg", 1, -5.0, 4.0,
             told="Its travel is −13 to +4 deg. A forward CG needs more of it nose up."),
    Quantity("throttle", "Throttle in trim", "%", 0, 25.0, 100.0, 100.0),
    Quantity("hydraulic_up_deg", "How far a hydraulic segment goes up", "deg", 1, 11.0, 23.0, -1.0,
             "Full travel is 23 deg; where it is less, the actuator stalls on the way."),
    Quantity("hydraulic_down_deg", "How far a hydraulic segment goes down", "deg", 1, 8.0, 17.0, 1.0,
             "Full travel is 17 deg."),
    Quantity("ema_up_deg", "How far an electromechanical segment goes up", "deg", 1, 11.0, 23.0, -1.0,
             "Full travel is 23 deg."),
    Quantity("ema_down_deg", "How far an electromechanical segment goes down", "deg", 1, 8.0, 17.0, 1.0,
             "Full travel is 17 deg."),
)  # fmt: skip
BY_COLUMN = {q.column: q for q in QUANTITIES}


def scale() -> list:
    """Return STOPS as a plotly colour scale."""
    return [[i / (len(STOPS) - 1), c] for i, c in enumerate(STOPS)]


def colour(share: float, steps: int = 32) -> str:
    """Return the colour at `share` 0..1 of STOPS, in `steps` steps."""
    at = min(max(round(share * steps) / steps, 0.0), 1.0) * (len(STOPS) - 1)
    i = min(int(at), len(STOPS) - 2)
    low, high = ([int(STOPS[k][j : j + 2], 16) for j in (1, 3, 5)] for k in (i, i + 1))
    return "#" + "".join(f"{round(a + (at - i) * (b - a)):02x}" for a, b in zip(low, high))
