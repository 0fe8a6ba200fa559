"""What the two Sun13 estimators read on the bus, and which stored design their elevators ask for."""

KINDS = ("hydraulic", "ema", "simple")  # of a side, else "mixed"

SEGMENTS = ("left_outer", "left_inner", "right_inner", "right_outer")
_AIR = {f"{n}{tail}": f"sensors.{n}.{field}" for n in ("tas", "alpha", "q", "theta")
        for tail, field in (("", "y_obs"), ("_valid", "valid_obs"))}
_POSITIONS = {f"surface{tail}[{i}]": f"sensors.{n}_surface.{field}" for i, n in enumerate(SEGMENTS)
              for tail, field in (("", "y_obs"), ("_valid", "valid_obs"))}
WIRES = {
    "rfafe": {**_AIR, **_POSITIONS, "command[0]": "law.law.de_cmd", "command[1]": "law.law.de_cmd"},
    "rfafe_airframe": {**_AIR, "command": "law.law.de_cmd"},
}


def technology(elevator):
    """Return the key of the stored design for `elevator`, a mapping of segment to technology: one word when both sides
    are alike, a kind or "mixed", else "left/right"."""
    left, right = (side([elevator[s] for s in part]) for part in (SEGMENTS[:2], SEGMENTS[2:]))
    return left if left == right else f"{left}/{right}"


def side(kinds):
    """Return the kind of a side with segments of these kinds."""
    return kinds[0] if len(set(kinds)) == 1 else "mixed"
