"""The columns of a data set's flights: signals by their words, and what is known of each sample.

A signal is NaN while its sensor is invalid, and in a flight whose actuator has none. Samples are every n-th tick as it
was flown, without a filter.
"""

from collections.abc import Iterable, Sequence

from cosim.errors import CampaignError, did_you_mean
from cosim.scenario import Scenario
from cosim.scenario.vocabulary import Signal, words

Column = tuple[str, str, str]  # type in Croissant, unit, meaning

LABELS: dict[str, Column] = {
    "faults_active": ("sc:Integer", "-", "number of faults that act at this sample"),
    "fault_kind": ("sc:Text", "-", "kind of the fault that acts, of several joined by +, empty without one"),
    "fault_place": ("sc:Text", "-", "its target, and behind @ where it enters"),
    "fault_injected": ("sc:Float", "of the place", "its signal, where it enters"),
}


def every(scenarios: Iterable[Scenario]) -> dict[str, Signal]:
    """Return {column: Signal} of what the flights have; a word of an actuator for each segment that has it."""
    out: dict[str, Signal] = {}
    technologies: dict[str, set[str]] = {}
    for scenario in scenarios:
        for segment, technology in scenario.elevator.technology.items():
            technologies.setdefault(segment, set()).add(technology)
    for word, signal in words().items():
        if not signal.technologies:
            out[word] = signal
        else:
            lanes = (seg for seg, has in technologies.items() if has & set(signal.technologies))
            out |= {f"{seg}.{word}": signal.at(seg) for seg in lanes}
    return out


def chosen(scenarios: Sequence[Scenario], signals: Sequence[str]) -> list[str]:
    """Return the columns that `signals` mean, all without any. Raises CampaignError."""
    if not scenarios:
        raise CampaignError("no flight is left", place="--limit", allowed="1 or more")
    known = every(scenarios)
    out: list[str] = []
    for name in signals or known:
        found = [c for c in known if c == name or c.partition(".")[2] == name]
        if not found:
            near = did_you_mean(name, [*known, *words()])
            raise CampaignError("no flight of this campaign has it", place=f"--signal {name}", remedy=near)
        out += found
    return sorted(dict.fromkeys(out))


def achieved(scenario: Scenario) -> dict[str, str]:
    """Return {column: bus name} of the elevator deflections whose difference from the healthy flight is a label."""
    return {f"achieved_{seg}": f"{tech}.{seg}.delta" for seg, tech in scenario.elevator.technology.items()}


def described(scenarios: Sequence[Scenario], signals: Sequence[str]) -> dict[str, Column]:
    """Return {column: (type, unit, meaning)} of a flight's file, in its order."""
    known = every(scenarios)
    made = "deflection less that of the same flight without faults, trailing edge down +"
    return {
        "t_s": ("sc:Float", "s", "time since the start"),
        **{name: ("sc:Float", known[name].unit, known[name].meaning) for name in signals},
        **LABELS,
        **{name: ("sc:Float", "rad", made) for s in scenarios for name in achieved(s)},
    }
