"""Draft a map for a recording by the names of its columns alone.

A line stands ready where the name says what it is and in which unit. What a name cannot say stands as a comment: a unit
that is not in it, which way of an actuator or a surface is positive. It flies when its user has taken the `#` away.
"""

import re
from pathlib import Path
from typing import NamedTuple

from cosim.errors import LogError
from cosim.replay import clock
from cosim.replay.foreign import columns_of
from cosim.replay.map_signals import HINGE, readable
from cosim.replay.units import factor
from cosim.scenario.aircraft import DEFAULT, Aircraft, load_aircraft
from cosim.scenario.toml import inline
from cosim.scenario.vocabulary import words

NAMES = {  # word of the vocabulary -> what people call it, in small letters and single words
    "alpha": ("alpha", "aoa", "angle of attack"), "beta": ("beta", "aos", "sideslip"),
    "cas": ("cas", "vcas", "vc", "calibrated airspeed"), "tas": ("tas", "vtas", "true airspeed", "vtrue", "v total"),
    "mach": ("mach", "mach number"), "h_baro": ("h baro", "baro altitude", "pressure altitude", "palt"),
    "h_inertial": ("h inertial", "inertial altitude"), "hdot": ("hdot", "h dot", "vertical speed", "climb rate"),
    "v_ground": ("v ground", "ground speed"), "p": ("p", "roll rate"), "q": ("q", "pitch rate"), "r": ("r", "yaw rate"),
    "phi": ("phi", "bank", "bank angle", "roll", "roll angle"), "theta": ("theta", "pitch", "pitch angle"),
    "psi": ("psi", "heading"), "pdot": ("pdot", "p dot"), "qdot": ("qdot", "q dot"), "rdot": ("rdot", "r dot"),
    "n_x": ("n x", "nx"), "n_y": ("n y", "ny"), "n_z": ("n z", "nz", "load factor"),
    "mass": ("mass", "gross weight"), "cg": ("cg",),
    "de_cmd": ("de cmd", "elev cmd", "elevator cmd", "elevator command", "elev demand", "elevator demand"),
    "valve_command": ("valve command", "valve cmd", "valve"), "current_command": ("current command", "current cmd"),
    "rod": ("rod", "ram", "lvdt"), "surface": ("surface", "surf", "rvdt", "elevator position", "elevator"),
    "pressure": ("pressure", "dp", "delta p"), "velocity": ("motor speed",), "position": ("screw", "motor position"),
    "current": ("current", "motor current"), "hm0": ("hm0",), "hmd": ("hmd",),
    "hinge_moment": ("hinge moment", "hinge load"),
}  # fmt: skip
PLACES = {"left": "left lh l port", "right": "right rh r starboard",
          "inner": "inner inboard ib", "outer": "outer outboard ob"}  # fmt: skip
BOTH = {"li": "left inner", "lo": "left outer", "ri": "right inner", "ro": "right outer",
        "lib": "left inner", "lob": "left outer", "rib": "right inner", "rob": "right outer"}  # fmt: skip
BARE = ("mach", "n_x", "n_y", "n_z")  # have no unit that a name would say
SHORT = {"pct": "%", "degs": "deg/s", "mps": "m/s", "kn": "kt"}  # of units at the end of a name
NONE = """# none flies yet: take the # from a line, or write one: alpha = { channel = "NAME", unit = "deg" }"""
POINT = {"mass_t": 200.0, "cg_pct": 30.0, "altitude_ft": 20000.0, "cas_kt": 290.0}


class Guess(NamedTuple):
    """What a channel may be: signal of a map, unit as its name says it, and what remains to be said, "" if nothing."""

    signal: str
    unit: str
    open: str


def draft(path: str | Path, *, aircraft: str | None = None) -> str:
    """Return the text of a map for the recording at `path`, for the detectors of `aircraft` (default: the transport's).

    Raises LogError for a file that is not read here, ScenarioError for an unknown aircraft.
    """
    own = load_aircraft(aircraft or DEFAULT)
    channels, texts = columns_of(path)
    lines = [f"# Draft of a map for {Path(path).name} by names alone: check every unit, sign and meaning."]
    time, clock_line = _time(Path(path), [*channels, *texts])
    lines += ["rate_hz = 200  # tick at which the detectors were designed", clock_line]
    lines += ['# aircraft = "NAME"  # that was recorded', "", "[flight]  # the point for which the detectors are set"]
    lines += [f"aircraft = {inline(own.name)}"] * (own.name != DEFAULT)
    lines += [f"{key} = {value:g}  # not in the recording" for key, value in _point(own).items()]
    taken: dict[str, str] = {}
    read = {*readable(own), *(f"{segment}{HINGE}" for segment in own.segments)}
    for channel in channels:
        guess = guessed(channel, own)
        if guess and guess.signal not in taken and guess.signal in read:
            taken[guess.signal] = _line(channel, guess)
        elif channel.isprintable():
            texts.append(channel)
    lines += ["", "[signals]", *[NONE] * all(line.startswith("#") for line in taken.values()), *taken.values()]
    lines += ["", *(f"# not used: {inline(c)}" for c in texts if c != time)]
    return "\n".join(lines).rstrip() + "\n"


def guessed(channel: str, own: Aircraft) -> Guess | None:
    """Return what a channel is by its name: without unit and place it must be one of NAMES; None where it is not."""
    field = re.split(r"[./](?![^(\[]*[)\]])", channel)[-1]
    bracket = re.search(r"[\[(]([^\[\]()]*)[\])]\s*$", field)
    if bracket:
        return _named(_tokens(field[: bracket.start()]), bracket[1].strip(), own)
    tokens = _tokens(field)
    splits = [*range(max(1, len(tokens) - 2), len(tokens)), len(tokens)]  # with a unit of two words, of one, without
    return next(filter(None, (_named(tokens[:k], "/".join(tokens[k:]), own) for k in splits)), None)


def _named(tokens: list[str], unit: str, own: Aircraft) -> Guess | None:
    """Return what the words of a name are, without its `unit`; None where the unit is of something else."""
    split = " ".join(BOTH.get(t.lower(), t.lower()) for t in tokens).split()
    place = "" if _word(split) else "_".join(long for long, short in PLACES.items() if {*split} & {*short.split()})
    word = _word([t for t in split if not place or not any(t in short.split() for short in PLACES.values())])
    known = words().get(word)
    if not word:
        return None
    si = known.unit if known else "N m"
    local = word in ("hm0", "hmd", "hinge_moment") or bool(known and known.technologies)
    shares = {"Pa": 1.0} if word == "pressure" else {"N": 1.0} if word == "hinge_moment" else {}
    unit = next((u for u in (unit, SHORT.get(unit.lower(), ""), unit.lower()) if u and factor(u, si, shares)), unit)
    if (unit and not factor(unit, si, shares)) or (place and not local):
        return None
    said = [f"unit? {si} if none is said"] * (not unit and word not in BARE)
    segment = next((s for s in own.segments if place and s in (place, place.partition("_")[0])), "")
    said += ["which segment?"] * (local and not segment)
    if local or word == "de_cmd":
        said.append(f"sign? {known.meaning if known else 'hinge moment, + drives the trailing edge down'}")
    signal = f"{segment or own.segments[0]}.{word}" if local else word
    return Guess(signal, "" if unit == si else unit, "; ".join(said))


def _word(tokens: list[str]) -> str:
    """Return the word of the vocabulary that people call so, "" for none."""
    called = "".join(tokens)
    return next((word for word, names in NAMES.items() if called in (n.replace(" ", "") for n in names)), "")


def _tokens(name: str) -> list[str]:
    """Return the words of a name: of NzG, ELEV_CMD_DEG, PitchRate, left-inner rod."""
    return re.sub(r"(?<=[A-Za-z][a-z])(?=[A-Z])|[^A-Za-z0-9%]+", " ", name).split()


def _line(channel: str, guess: Guess) -> str:
    key = inline(guess.signal) if "." in guess.signal else guess.signal
    unit = f", unit = {inline(guess.unit)}" if guess.unit else ""
    line = f"{key} = {{ channel = {inline(channel)}{unit} }}"
    return f"# {line}  # {guess.open}" if guess.open else line


def _time(path: Path, columns: list[str]) -> tuple[str, str]:
    """Return (column of the clock or "", the line that names it)."""
    if path.suffix.lower() == ".mcap":
        return "", 'time = "log_time"  # or publish_time, or a field of the messages: "header.stamp", "t [us]"'
    try:
        name, _ = clock.of_table(columns, None, path)
    except LogError:
        return "", '# time = "NAME"  # which column? "NAME [us]" where its name does not end in its unit'
    unsaid = f"# time = {inline(name + ' [s]')}  # in which unit? ns, us, ms, s, min, h"
    return name, f"time = {inline(name)}" if clock.unit_of(name) else unsaid


def _point(own: Aircraft) -> dict[str, float]:
    """Return the usual point within the aircraft's limits."""
    spans = (own.mass.mass_t, own.mass.cg_pct, own.limits.altitude_ft, own.limits.cas_kt)
    return {key: min(max(value, low), high) for (key, value), (low, high) in zip(POINT.items(), spans)}
