"""Draft a map for a recording by looking at its columns: names, units in the names, ranges of the numbers.

A draft is a start, not a finding: numbers show neither signs nor meanings. Every line says what it rests on.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim.replay.foreign import TIME_NAMES, columns_of, read_channels
from cosim.replay.units import factors
from cosim.scenario.catalog import SEGMENTS
from cosim.scenario.toml import inline
from cosim.scenario.vocabulary import words

NAMES = {  # word of the vocabulary -> what people call it, as tokens that a column's name must hold
    "alpha": ("alpha", "aoa", "angle of attack"), "beta": ("beta", "aos", "sideslip"), "cas": ("cas", "kcas", "ias"),
    "tas": ("tas", "ktas", "true airspeed"), "mach": ("mach",), "h_inertial": ("h inertial", "inertial altitude"),
    "h_baro": ("h baro", "baro", "altitude", "alt", "palt"), "hdot": ("hdot", "vertical speed", "climb rate", "vs"),
    "v_ground": ("v ground", "ground speed", "gs"), "p": ("p", "roll rate"), "q": ("q", "pitch rate"),
    "r": ("r", "yaw rate"), "phi": ("phi", "bank", "roll"), "theta": ("theta", "pitch"),
    "psi": ("psi", "heading", "hdg"), "n_x": ("n x", "nx"), "n_y": ("n y", "ny"),
    "n_z": ("n z", "nz", "load factor"), "mass": ("mass", "gross weight", "gw"), "cg": ("cg",),
    "de_cmd": ("de cmd", "elev cmd", "elevator cmd", "elevator command"),
    "da_cmd": ("da cmd", "ail cmd", "aileron command"), "dr_cmd": ("dr cmd", "rud cmd", "rudder command"),
    "stab_cmd": ("stab cmd", "stabiliser command", "stabilizer command"),
    "throttle_cmd": ("throttle cmd", "throttle", "thr"),
    "valve_command": ("valve", "valve cmd", "servo valve", "sv", "u"), "current_command": ("current cmd", "i cmd"),
    "rod": ("rod", "ram", "stroke", "lvdt"), "surface": ("surf", "surface", "rvdt", "deflection"),
    "pressure": ("dp", "delta p", "pressure", "press"), "velocity": ("velocity", "motor speed", "omega"),
    "position": ("position", "screw", "pos"), "current": ("current", "amps", "motor current"),
    "hm0": ("hm0",), "hmd": ("hmd",), "hinge_moment": ("hinge moment", "hinge", "load"),
}  # fmt: skip
UNIT = {  # how units stand in names
    "deg": "deg", "degs": "deg/s", "dps": "deg/s", "rad": "rad", "rads": "rad/s", "mm": "mm", "m": "m", "in": "in",
    "ft": "ft", "kt": "kt", "kts": "kt", "kn": "kt", "mps": "m/s", "kmh": "km/h", "fpm": "ft/min", "pct": "%",
    "percent": "%", "bar": "bar", "psi": "psi", "mpa": "MPa", "kpa": "kPa", "ma": "mA", "a": "A", "rpm": "rpm",
    "g": "g", "t": "t", "kg": "kg", "lb": "lb", "lbfft": "lbf ft", "nm": "N m",
}  # fmt: skip
WHOLE = {name for names in NAMES.values() for name in names if " " not in name}
PLACES = {"left": "lh l port", "right": "rh r starboard", "inner": "in inboard ib", "outer": "out outboard ob"}
SHORT = {"li": "left inner", "lo": "left outer", "ri": "right inner", "ro": "right outer", "lib": "left inner",
         "lob": "left outer", "rib": "right inner", "rob": "right outer"}  # fmt: skip
LARGEST = {"rad": 1.6, "m": 1.0, "rad/s": 3.0, "-": 1.6}  # of the SI unit, beyond which a column is in another one
OTHER = {"rad": "deg", "rad/s": "deg/s", "m": "mm", "-": "%"}
POINT = {"mass": ("mass_t", 1e-3, 200.0), "cg": ("cg_pct", 100.0, 30.0), "h_baro": ("altitude_ft", 1 / 0.3048, 20000.0),
         "cas": ("cas_kt", 3600 / 1852, 290.0)}  # fmt: skip


@dataclass(frozen=True)
class Guess:
    """One column that may be a signal: how, why, and how much of its name was understood (0 to 1)."""

    channel: str
    word: str
    lane: str
    unit: str
    why: str
    fit: float

    @property
    def name(self) -> str:
        """Return the signal's name in a map."""
        return f"{self.lane}.{self.word}" if self.lane else self.word


def draft(path: str | Path, *, time: str | None = None, aircraft: str | None = None) -> str:
    """Return the text of a map for the recording at `path`. Raises LogError as `read_channels` does."""
    time = time or _time(Path(path))
    tables = read_channels(path, time=time, on_reset="split", part=0)
    one = len(tables) == 1
    columns = {c if one else f"{t}.{c}": frame[c].to_numpy() for t, frame in tables.items() for c in frame.columns}
    best: dict[str, Guess] = {}
    for channel, y in columns.items():
        for guess in guesses(channel, y):
            if guess.fit > best[guess.name].fit if guess.name in best else True:
                best[guess.name] = guess
    taken: dict[str, Guess] = {}
    for guess in sorted(best.values(), key=lambda g: -g.fit):  # a column is one signal
        if guess.channel not in {g.channel for g in taken.values()}:
            taken[guess.name] = guess
    return _text(Path(path), taken, columns, time)


def guesses(channel: str, y: np.ndarray) -> Iterable[Guess]:
    """Yield what a column may be; `y` are its numbers."""
    tokens = _tokens(channel)
    unit = next((UNIT[t] for t in reversed(tokens[1:]) if t in UNIT), "")
    rest = [t for t in tokens if UNIT.get(t) != unit or t == tokens[0]] if unit else tokens
    place = [long for long, short in PLACES.items() if set(rest) & {long, *short.split()}]
    said = [t for t in rest if not any(t in (long, *short.split()) for long, short in PLACES.items())]
    for word, names in NAMES.items():
        local = word == "hinge_moment" or bool(words()[word].technologies)
        held = said if local else rest
        found = max((n for n in names if set(n.split()) <= set(held)), key=len, default="")
        if not found:
            continue
        si = "N m" if word == "hinge_moment" else words()[word].unit
        known = factors(si, {"Pa": 1.0} if word == "pressure" else {"N": 1.0} if word == "hinge_moment" else {})
        if unit and unit not in known:
            continue
        fit = len(found.split()) / max(1, len(held)) + 0.1 * len(found) / 20 + 0.2 * bool(place and local)
        yield Guess(channel, word, _segment(place) if local else "", *_unit(si, unit, y), fit)


def _time(path: Path) -> str | None:
    """Return the time column of a table by its name, None where `read_channels` finds it or there is none."""
    names = columns_of(path)
    if set(names) & set(TIME_NAMES):
        return None
    return next((n for n in names if set(_tokens(n)) & {"time", "clock", "timestamp", "seconds"}), None)


def _tokens(channel: str) -> list[str]:
    """Return the words of a column's name, in small letters: of NzG, ELEV_CMD_DEG, left-inner rod [mm]."""
    out: list[str] = []
    for token in re.split(r"[^A-Za-z0-9]+", channel.rpartition(".")[2] or channel):
        whole = token.lower() in UNIT or token.lower() in WHOLE
        parts = [token] if whole else re.split(r"(?<=[a-z0-9])(?=[A-Z])", token)
        out += [word for part in parts if part for word in SHORT.get(part.lower(), part.lower()).split()]
    return out


def _segment(place: list[str]) -> str:
    """Return the segment of the places named, the left inner one where nothing is said."""
    side = next((p for p in place if p in ("left", "right")), "left")
    where = next((p for p in place if p in ("inner", "outer")), "inner")
    return next((s for s in SEGMENTS if s == f"{side}_{where}"), f"{side}_{where}")


def _against(taken: Mapping[str, Guess], columns: Mapping[str, np.ndarray]) -> set[str]:
    """Return the surfaces and commands that move against a rod: all are + with the trailing edge down."""
    out = set()
    for rod in (g for g in taken.values() if g.word == "rod"):
        for name in (f"{rod.lane}.surface", "de_cmd"):
            if name not in taken or len(columns[taken[name].channel]) != len(columns[rod.channel]):
                continue
            pair = np.array([columns[rod.channel], columns[taken[name].channel]])
            moved = pair[:, np.isfinite(pair).all(axis=0)]
            if moved.shape[1] > 10 and np.ptp(moved, axis=1).all() and np.corrcoef(moved)[0, 1] < -0.5:
                out.add(name)
    return out


def _unit(si: str, named: str, y: np.ndarray) -> tuple[str, str]:
    """Return (unit, why): by the name, else by the range of the numbers."""
    finite = y[np.isfinite(y)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (np.nan, np.nan)
    span = f"{low:.4g} to {high:.4g}"
    if named:
        return named, f"{span}, unit by its name"
    most = max(abs(low), abs(high))
    if si in LARGEST and most > LARGEST[si]:
        return OTHER[si], f"{span}, too large for {si}: a guess"
    return si, f"{span}, as if in {si}"


def _text(path: Path, taken: Mapping[str, Guess], columns: Mapping[str, np.ndarray], time: str | None) -> str:
    lines = [f"# Draft of a map for {path.name}: check every unit, sign and meaning.", "rate_hz = 200"]
    lines += [*([f"time = {inline(time)}"] if time else []), "", "[flight]"]
    for word, (key, factor, usual) in POINT.items():
        if word in taken:
            scale = factors(words()[word].unit)[taken[word].unit]
            middle = float(np.nanmedian(columns[taken[word].channel])) * scale * factor
            lines.append(f"{key} = {middle:.4g}  # median of {taken[word].channel}")
        else:
            lines.append(f"{key} = {usual:g}  # not in the recording")
    against = _against(taken, columns)
    lines += ["", "[signals]"]
    for name, g in sorted(taken.items(), key=lambda item: ("." in item[0], item[0])):
        unit = "" if g.unit == ("N m" if g.word == "hinge_moment" else words()[g.word].unit) else f', unit = "{g.unit}"'
        key = f'"{name}"' if "." in name else name
        sign = ", sign = -1" if name in against else ""
        why = f"{g.why}{', runs against the rod' if sign else ''}"
        lines.append(f"{key} = {{ channel = {inline(g.channel)}{unit}{sign} }}  # {why}")
    lanes = sorted({g.lane for g in taken.values() if g.lane})
    for lane in lanes:
        if not {f"{lane}.hm0", f"{lane}.hinge_moment"} & taken.keys():
            lines.append(f'"{lane}.hinge_moment" = {{ constant = 0.0 }}  # no column: none, as on a bench without load')
    left = [c for c in columns if c not in {g.channel for g in taken.values()}]
    lines += ["", *(f"# not used: {c}" for c in left)]
    return "\n".join(lines).rstrip() + "\n"

