"""Small kernels that every block here needs: limits, signs, and numbers that are not finite."""

from actuators.block import kernel


@kernel
def clip(v, lo, hi):
    """Return v within lo..hi."""
    return min(max(v, lo), hi)


@kernel
def within(v, limit):
    """Return v within -limit..limit."""
    return min(max(v, -limit), limit)


@kernel
def stopped(q, v, lo, hi):
    """Return position and velocity between inelastic stops at lo and hi."""
    return clip(q, lo, hi), min(v, 0.0) if q > hi else max(v, 0.0) if q < lo else v


@kernel
def share(v):
    """Return v within 0..1."""
    return min(max(v, 0.0), 1.0)


@kernel
def sign(v):
    """Return -1, 0 or 1; sign(0) = 0."""
    return 1.0 if v > 0.0 else -1.0 if v < 0.0 else 0.0


@kernel
def finite(v, x):
    """Return v, or zero and x.status = 1 where it is not a sane number."""
    if abs(v) < 1e12:
        return v
    x.status = 1.0
    return 0.0


@kernel
def flush(v):
    """Return v, or zero where it has decayed beyond meaning: denormal numbers are a hundred times slower."""
    return v if abs(v) > 1e-30 else 0.0
