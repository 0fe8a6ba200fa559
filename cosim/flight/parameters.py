"""Set a number among a detector's parameters: the same names and the same refusals before a flight and on a replay."""

from cosim.errors import did_you_mean
from cosim.flight.parameter_bounds import parameter_range


def assign(detector, module, p, name, value, dt, *, error, place, also=()):
    """Set parameter `name` of all lanes in PARAMS `p`: a number, all elements of an array, or one of them, `name[i,j]`.

    `also` are names that the caller takes itself. Raises `error` (a CosimError) at `place`.
    """
    base, bracket, index = name.partition("[")
    if base not in p.dtype.names or bool(bracket) != index.endswith("]"):
        known = [*also, *(n + "[i]" * bool(p.dtype[n].shape) for n in p.dtype.names)]
        remedy = did_you_mean(base, [*also, *p.dtype.names])
        raise error("no such parameter", place=place, allowed=", ".join(known), remedy=remedy)
    shape = p.dtype[base].shape
    span = parameter_range(base, module, detector, dt)
    if span is not None and not (span[0] <= value <= span[1] and value == round(value)):
        said = f"a whole number from {span[0]:g} to {span[1]:g}"
        raise error(f"{value:g} does not fit the detector's arrays", place=place, allowed=said)
    try:
        at = tuple(int(i) for i in index.rstrip("]").split(",")) if index else ()
        p[base][(slice(None), *at)] = value
    except (ValueError, IndexError) as wrong:
        said = f"a number, elements of shape {shape}" if shape else "a number"
        raise error(f"{value!r} cannot be set", place=place, allowed=said) from wrong
