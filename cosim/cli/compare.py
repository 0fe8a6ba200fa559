"""The tables of `cosim compare`, built from the same plain data that --json prints. Nothing here prints."""

from rich.console import Group
from rich.text import Text


def compare(found: dict) -> Group:
    """Return the table of a comparison: `found` is the JSON of `cosim compare`."""
    from cosim.compare.tables import by_level, detectors, pairs, predictive  # `--help` needs no pandas

    lost = f"; {found['failed']} could not be flown" if found["failed"] else ""
    mute = [d for d in found["detectors"] if d["not_valid"] and d["why_not_valid"]]
    why = [f"{d['id']} not valid: {d['why_not_valid']}" for d in mute]
    files = [Text(f"{key:<7}{found[key]}") for key in ("report", "table") if found[key]]
    head = Text(f"{found['runs']} flights, {found['source']}{lost}")
    beside = [pairs(found["pairs"])] if found.get("pairs") else []
    joint = found.get("levels") and any(d["level"] == "both" for d in found["detectors"])
    more = [by_level(found["levels"])] if joint else []
    more += [predictive(found["predictive"])] if found.get("predictive") else []
    why_not = (Text(line, "dim") for line in why)
    return Group(head, *beside, detectors(found["detectors"]), *why_not, *more, *files)
