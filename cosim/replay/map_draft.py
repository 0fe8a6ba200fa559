"""Draft a map for a recording by looking at its columns: names, units in the names, ranges of the numbers.

A draft is a start, not a finding. Every line says how sure it is and what it rests on: the name alone, or what the
numbers prove together (cosim/replay/map_physics.py). What it is not sure of stands as a comment and does not fly.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cosim.replay import map_physics as physics
from cosim.replay.foreign import TIME_NAMES, columns_of, read_channels, time_of
from cosim.replay.units import factors, known
from cosim.scenario.aircraft import DEFAULT, Aircraft, load_aircraft
from cosim.scenario.catalog import SEGMENTS
from cosim.scenario.toml import inline
from cosim.scenario.vocabulary import words

NAMES = {  # word of the vocabulary -> what people call it, as tokens that a column's name must hold
    "alpha": ("alpha", "aoa", "angle of attack", "al", "alf"), "beta": ("beta", "aos", "sideslip", "be", "bet"),
    "cas": ("cas", "kcas", "ias", "kias", "vcas"), "tas": ("tas", "ktas", "vtas", "airspeed", "va"), "mach": ("mach",),
    "h_inertial": ("h inertial", "inertial altitude"),
    "h_baro": ("h baro", "baro", "altitude", "pressure altitude", "alt", "palt", "hp", "hqnh"),
    "hdot": ("hdot", "vertical speed", "climb rate", "vs", "alt rate"),
    "v_ground": ("v ground", "ground speed", "gs"), "p": ("p", "roll rate", "prgx"), "q": ("q", "pitch rate", "qrgy"),
    "r": ("r", "yaw rate", "rrgz"),
    "phi": ("phi", "bank", "roll", "roll att", "roll attitude", "roll angle", "bank angle"),
    "theta": ("theta", "pitch", "the", "pitch att", "pitch attitude", "pitch angle"),
    "psi": ("psi", "heading", "hdg", "yaw"), "pdot": ("pdot", "p dot", "roll acceleration"),
    "qdot": ("qdot", "q dot", "pitch acceleration"), "rdot": ("rdot", "r dot", "yaw acceleration"),
    "n_x": ("n x", "nx", "ax", "long acc"), "n_y": ("n y", "ny", "ay", "lat acc"),
    "n_z": ("n z", "nz", "load factor", "az", "an", "norm acc"), "n1": ("n1",),
    "mass": ("mass", "gross weight", "gw"), "cg": ("cg",),
    "deflection": ("delv", "de", "delta e", "elev", "elevator"),
    "de_cmd": ("de cmd", "elev cmd", "elevator cmd", "elevator command"),
    "da_cmd": ("da cmd", "ail cmd", "aileron command"), "dr_cmd": ("dr cmd", "rud cmd", "rudder command"),
    "stab_cmd": ("stab cmd", "stabiliser command", "stabilizer command"),
    "throttle_cmd": ("throttle cmd", "throttle", "thr"),
    "valve_command": ("valve", "valve cmd", "servo valve", "sv", "u"), "current_command": ("current cmd", "i cmd"),
    "rod": ("rod", "ram", "stroke", "lvdt"), "surface": ("surf", "surface", "rvdt", "deflection", "elev", "elevator"),
    "pressure": ("dp", "delta p", "pressure", "press"), "velocity": ("velocity", "motor speed", "omega"),
    "position": ("position", "screw", "pos"), "current": ("current", "amps", "motor current"),
    "hm0": ("hm0",), "hmd": ("hmd",), "hinge_moment": ("hinge moment", "hinge", "load"),
}  # fmt: skip
UNIT = {  # how units stand in names, beside the writings of cosim/replay/units.py
    "deg": "deg", "degs": "deg/s", "dps": "deg/s", "rad": "rad", "rads": "rad/s", "mm": "mm", "m": "m", "in": "in",
    "ft": "ft", "kt": "kt", "kts": "kt", "kn": "kt", "mps": "m/s", "kmh": "km/h", "fpm": "ft/min", "pct": "%",
    "percent": "%", "bar": "bar", "psi": "psi", "mpa": "MPa", "kpa": "kPa", "ma": "mA", "a": "A", "rpm": "rpm",
    "g": "g", "t": "t", "kg": "kg", "lb": "lb", "lbfft": "lbf ft", "nm": "N m",
}  # fmt: skip
KNOTS = {"kcas", "kias", "ktas"}  # the unit is in the name of the speed
EDGE = {"teu": -1, "ted": 1}  # trailing edge up, down: ours is + down
FILLERS = re.compile(r"(d?adc|ahrs|irs|ins|vane|air|b|cg)\d*")  # systems and axes: they say nothing of what is measured
SURE = 0.6  # of a name understood: below it a line is a comment
SPEEDS = {"tas": "m/s", "cas": "m/s", "h_baro": "m"}  # their units are asked of the Mach number
WHOLE = {name for names in NAMES.values() for name in names if " " not in name}
PLACES = {"left": "lh l port", "right": "rh r starboard", "inner": "in inboard ib", "outer": "out outboard ob"}
SHORT = {"li": "left inner", "lo": "left outer", "ri": "right inner", "ro": "right outer", "lib": "left inner",
         "lob": "left outer", "rib": "right inner", "rob": "right outer"}  # fmt: skip
# degrees that an angle does not exceed: beyond them a column is in some other unit, counts of a servo say
MOST_DEG = {**dict.fromkeys(("alpha", "beta", "theta", "deflection", "surface"), 90.0), "phi": 185.0, "psi": 365.0}
FIXED = ("mass", "cg", "hm0", "hmd", "hinge_moment")  # may be constant; a sensor or a command that is says nothing
LARGEST = {  # of the SI unit, beyond which a column is in another one
    "rad": 1.6, "m": 1.0, "rad/s": 3.0, "rad/s2": 6.0, "-": 1.6,
}  # fmt: skip
OTHER = {"rad": "deg", "rad/s": "deg/s", "rad/s2": "deg/s2", "m": "mm", "-": "%"}
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
    sign: int = 1
    offset: float = 0.0
    proxy: str = ""
    proof: bool = False  # by other columns

    @property
    def name(self) -> str:
        """Return the signal's name in a map."""
        return f"{self.lane}.{self.word}" if self.lane else self.word

    @property
    def named(self) -> bool:
        """Tell whether the unit stands in the channel's name."""
        return "unit by its name" in self.why


def draft(
    path: str | Path, *, time: str | None = None, aircraft: str | None = None, columns: Sequence[str] = ()
) -> str:
    """Return the text of a map for the recording at `path`, for the detectors of `aircraft` (default: the transport's);
    `columns` name those of a file without names, `time` names its time column.

    Raises LogError as `read_channels` does, ScenarioError for an unknown aircraft.
    """
    own = load_aircraft(aircraft or DEFAULT)
    named = tuple(columns)
    time = time or _time(Path(path), named)
    tables = read_channels(path, time=time, on_reset="split", part=0, columns=named)
    one = len(tables) == 1
    found = {c if one else f"{t}.{c}": frame[c].to_numpy() for t, frame in tables.items() for c in frame.columns}
    clocks = {c if one else f"{t}.{c}": f.index.to_numpy() for t, f in tables.items() for c in f.columns}
    best: dict[str, Guess] = {}
    for channel, y in found.items():
        for guess in guesses(channel, y, own.segments, own.engines):
            if guess.fit > best[guess.name].fit if guess.name in best else True:
                best[guess.name] = guess
    taken: dict[str, Guess] = {}
    for guess in sorted(best.values(), key=lambda g: -g.fit):  # a column is one signal
        if guess.channel not in {g.channel for g in taken.values()}:
            taken[guess.name] = guess
    head = [f"time = {inline(time)}"] if time else []
    head += [f"columns = {inline(list(named))}"] if named else []
    return _text(Path(path), _Draft(taken, found, clocks).proved(), found, head, own)


class _Draft:
    """Guesses {signal: Guess} beside the columns {channel: samples} and their times, which prove them."""

    def __init__(self, taken, columns, clocks):
        self.out, self.columns, self.clocks = dict(taken), columns, clocks

    def y(self, name):
        return self.columns[self.out[name].channel]

    def t(self, name):
        return self.clocks[self.out[name].channel]

    def si(self, name, unit):
        """Return the samples of a signal in the SI unit that is named."""
        return self.y(name) * factors(unit).get(self.out[name].unit, 1.0)

    def beside(self, *names):
        """Tell whether all signals are there, of as many samples."""
        return all(n in self.out for n in names) and len({len(self.y(n)) for n in names}) == 1

    def set(self, name, **changes):
        self.out[name] = replace(self.out[name], **changes)

    def prove(self, name, why, **changes):
        """Take a unit or a sign for proved; where the name of the channel says another unit, say so."""
        old = self.out[name]
        lies = old.named and changes.get("unit", old.unit) != old.unit
        self.set(name, fit=1.0, proof=True, why=f"{why}, though its name says {old.unit}" if lies else why, **changes)
        return lies

    def proved(self):
        """Return the guesses with the units and signs that the numbers prove; a deflection stands for a command."""
        out = self.out
        moved = out.pop("deflection", None)
        if moved is not None and "de_cmd" not in out:
            out["de_cmd"] = replace(moved, word="de_cmd", proxy="the measured deflection")
        self._air()
        if "n_z" in out and (gravity := physics.gravity(self.y("n_z"))):
            unit, sign, offset, why, proof = gravity
            self.set("n_z", unit=unit, sign=sign, offset=offset, fit=1.0, proof=proof, why=why)
            for name in {"n_x", "n_y"} & out.keys():
                if not out[name].named:
                    self.set(name, unit=unit, why=f"as {out['n_z'].channel}")
        _alike(out)
        if self.beside("theta", "n_x", "tas"):
            n_x, speed = self.si("n_x", "g"), self.si("tas", "m/s")
            unit = physics.attitude_unit(self.t("theta"), self.y("theta"), n_x, speed)
            if unit and self.prove("theta", "gravity along the body", unit=unit) and unit == "rad":
                self._as_small()
        if self.beside("hdot", "h_baro"):
            h = out["h_baro"]
            unit = physics.climb_unit(self.t("hdot"), self.y("hdot"), self.y("h_baro"), h.unit)
            if unit:
                self.set("hdot", unit=unit, fit=1.0, proof=True, why=f"the rate of change of {h.channel}")
            elif not out["hdot"].named:
                self.set("hdot", unit="m/s", fit=0.3)
        for word, angle in (("p", "phi"), ("q", "theta"), ("r", "psi")):
            if self.beside(word, angle):
                unit, sign = physics.rate_unit(self.t(word), self.y(word), self.y(angle), out[angle].unit)
                if unit:
                    rate, of = out[word].channel, out[angle].channel
                    self.set(word, unit=unit, sign=sign, fit=1.0, proof=True, why=f"the rate of change of {of}")
                    if out[angle].fit < SURE:
                        self.set(angle, fit=1.0, proof=True, why=f"{out[angle].why}, {rate} is its rate of change")
        _alike(out)  # with what is proved by now
        rods = [g for g in out.values() if g.word == "rod"]
        if self.beside("de_cmd", "q") and not rods:
            pitches_up = physics.elevator_sign(self.t("q"), self.y("de_cmd"), self.y("q"))
            if out["q"].sign * pitches_up > 0.3:
                self.set("de_cmd", sign=-1, why=f"{out['de_cmd'].why}, the nose follows it up")
        for rod, name in ((g.name, name) for g in rods for name in (f"{g.lane}.surface", "de_cmd")):
            if self.beside(rod, name) and physics.correlation(self.y(rod), self.y(name)) < -0.5:
                self.set(name, sign=-1, why=f"{out[name].why}, runs against the rod")  # all are + trailing edge down
        return out

    def _air(self):
        """Take the units that Mach number, speeds and altitude allow together; one they refute does not fly."""
        for name, units in physics.air({n: self.y(n) for n in ("mach", *SPEEDS) if n in self.out}).items():
            g = self.out[name]
            span = g.why.split(",")[0]
            if len(units) == 1:
                self.prove(name, f"{span}, Mach and the others ask for {units[0]}", unit=units[0])
            elif g.unit not in units:
                why = f"{span}, Mach allows {' or '.join(units)}"
                self.set(name, unit=units[0], fit=min(g.fit, 0.5 * SURE), why=why)

    def _as_small(self):
        """Take angles and rates that are named in degrees for radians, one of the file being proved to be, where they
        are as small: a full circle for a heading."""
        for name, g in self.out.items():
            most = float(np.nanmax(np.abs(self.y(name)), initial=0.0))
            if g.unit.startswith("deg") and not g.proof and most < (6.3 if name in ("psi", "phi") else 0.5):
                self.set(name, unit=g.unit.replace("deg", "rad"), why=f"{g.why}, but another's name is wrong here")


def _alike(out):
    """Give angles, and rates, whose unit nothing says that of the others of the file whose numbers say it."""
    for si in ("rad", "rad/s", "rad/s2"):
        same = {n: g for n, g in out.items() if n in words() and words()[n].unit == si}
        proved = [g.unit for g in same.values() if g.proof]
        own = {n: g for n, g in same.items() if not g.named}
        units = proved or [g.unit for g in own.values() if "too large" in g.why and g.fit >= SURE]
        for name, g in own.items():
            if units and not g.proof and (proved or "too large" not in g.why):
                out[name] = replace(g, unit=units[0], why=f"{g.why.split(',')[0]}, as the others")


def guesses(channel: str, y: np.ndarray, segments: Sequence[str] = SEGMENTS, engines: int = 4) -> Iterable[Guess]:
    """Yield what a column may be; `y` are its numbers."""
    bracket = re.search(r"[\[(]([^\[\]()]*)[\])]\s*$", channel)
    tokens = _tokens(channel[: bracket.start()] if bracket and known(bracket[1]) else channel) or [""]
    unit = known(bracket[1]) if bracket else ""
    unit = unit or next((UNIT[t] for t in reversed(tokens[1:]) if t in UNIT), "")
    sign = next((EDGE[t] for t in tokens if t in EDGE), 0)
    tokens = [t for t in tokens if t not in EDGE] or [""]
    rest = [t for t in tokens if UNIT.get(t) != unit or t == tokens[0]] if unit else tokens
    place = [long for long, short in PLACES.items() if set(rest) & {long, *short.split()}]
    said = [t for t in rest if not any(t in (long, *short.split()) for long, short in PLACES.items())]
    meant = [t for t in rest if not FILLERS.fullmatch(t)] or rest
    sent, unit = bool({"cmd", "command"} & set(rest)), unit or ("kt" if KNOTS & set(tokens) else "")
    for word, names in NAMES.items():
        if word == "n1":
            if engines != 2 or place not in (["left"], ["right"]):
                continue
            word = "n1_1" if place == ["left"] else "n1_2"
        local = word == "hinge_moment" or (word in words() and bool(words()[word].technologies))
        held = said if local else meant
        found = max((n for n in names if set(n.split()) <= set(held)), key=len, default="")
        if not found or (sent and not word.endswith(("cmd", "command"))):
            continue
        if len(found) < 3 and len(found.split()) < len(held) and names != NAMES["n1"]:  # the R of DLC_R is no yaw rate
            continue
        if local and not place and (len(found) < 2 or found in NAMES["deflection"]):
            continue  # u beside v and w is a speed, "left u" a command; a segment's elevator has its place
        si = {"hinge_moment": "N m", "deflection": "rad"}.get(word) or words()[word].unit
        allowed = factors(si, {"Pa": 1.0} if word == "pressure" else {"N": 1.0} if word == "hinge_moment" else {})
        if unit and unit not in allowed:
            continue
        fit = len(found.split()) / max(1, len(held)) + 0.1 * len(found) / 20 + 0.2 * bool(place and local)
        fit = max(fit, 0.8) if names == NAMES["n1"] else fit  # with a side: nothing else is called so
        unit_, why = _unit(si, unit, y)
        most = float(np.nanmax(np.abs(y))) if np.isfinite(y).any() else 0.0
        if unit_ == "deg" and most > MOST_DEG.get(word, np.inf):
            unit_, why, fit = "deg", f"{why}, too large for degrees", min(fit, 0.5 * SURE)
        elif word not in FIXED and np.isfinite(y).any() and np.nanmin(y) == np.nanmax(y):
            why, fit = f"{why}, constant", min(fit, 0.5 * SURE)
        up = sign if word in ("surface", "deflection", "de_cmd") else 0
        why += f", trailing edge {'down' if up > 0 else 'up'} by its name" if up else ""
        yield Guess(channel, word, _segment(place, segments) if local else "", unit_, why, fit, up or 1)


def _time(path: Path, columns: tuple[str, ...] = ()) -> str | None:
    """Return the time column of a table by its name, None where `read_channels` finds it alone or there is none."""
    names = columns_of(path, columns)
    return None if set(names) & set(TIME_NAMES) or path.is_dir() else time_of(names)


def _tokens(channel: str) -> list[str]:
    """Return the words of a column's name, in small letters: of NzG, ELEV_CMD_DEG, left-inner rod [mm]."""
    out: list[str] = []
    for token in re.split(r"[^A-Za-z0-9]+", channel.rpartition(".")[2] or channel):
        token = re.sub(r"(?<=[A-Z]{2})CG$", "", token)
        whole = token.lower() in UNIT or token.lower() in WHOLE
        parts = [token] if whole else re.split(r"(?<=[a-z0-9])(?=[A-Z])", token)
        out += [word for part in parts if part for word in SHORT.get(part.lower(), part.lower()).split()]
    return out


def _segment(place: list[str], segments: Sequence[str]) -> str:
    """Return the segment of the places named, the left inner one, or the left one, where nothing is said."""
    side = next((p for p in place if p in ("left", "right")), "left")
    where = next((p for p in place if p in ("inner", "outer")), "inner")
    return next((s for s in segments if s in (f"{side}_{where}", side)), segments[0])


def _unit(si: str, named: str, y: np.ndarray) -> tuple[str, str]:
    """Return (unit, why): by the name, else by the range of the numbers."""
    finite = y[np.isfinite(y)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (np.nan, np.nan)
    span = f"{low:.4g} to {high:.4g}"
    if named:
        return named, f"{span}, unit by its name"
    most = max(abs(low), abs(high))
    if si == "m" and most > 100.0:  # an altitude: what Mach number and speeds do not prove
        return ("ft", f"{span}, too large for an airliner's metres") if most > 16000.0 else ("m", f"{span}, m or ft")
    if si in LARGEST and most > LARGEST[si]:
        return OTHER[si], f"{span}, too large for {si}"
    return si, f"{span}, as if in {si}"


def _point(word: str, value: float, own: Aircraft) -> float:
    """Return a number of [flight] within what the aircraft's record allows."""
    low, high = {"mass": own.mass.mass_t, "cg": own.mass.cg_pct, "h_baro": own.limits.altitude_ft,
                 "cas": own.limits.cas_kt}[word]  # fmt: skip
    return min(max(value, low), high)


def _text(
    path: Path, taken: Mapping[str, Guess], columns: Mapping[str, np.ndarray], head: list[str], own: Aircraft
) -> str:
    lines = [f"# Draft of a map for {path.name}: check every unit, sign and meaning.", "rate_hz = 200"]
    lines += [*head, '# aircraft = "NAME"  # that was recorded', "", "[flight]"]
    if own.name != DEFAULT:
        lines.append(f"aircraft = {inline(own.name)}")
    for word, (key, factor, usual) in POINT.items():
        if word in taken and taken[word].fit >= SURE:
            scale = factors(words()[word].unit)[taken[word].unit]
            middle = float(np.nanmedian(columns[taken[word].channel])) * scale * factor
            value = _point(word, middle, own)
            bounded = "" if value == middle else ", bounded"
            lines.append(f"{key} = {value:.4g}  # median of {inline(taken[word].channel)}{bounded}")
        else:
            lines.append(f"{key} = {_point(word, usual, own):g}  # not in the recording")
    lines += ["", "[signals]"]
    for name, g in sorted(taken.items(), key=lambda item: ("." in item[0], item[0])):
        unit = "" if g.unit == ("N m" if g.word == "hinge_moment" else words()[g.word].unit) else f', unit = "{g.unit}"'
        key = f'"{name}"' if "." in name else name
        sign = ", sign = -1" if g.sign < 0 else ""
        more = f", offset = {g.offset:g}" if g.offset else ""
        more += f", proxy = {inline(g.proxy)}" if g.proxy else ""
        flies = g.fit >= SURE
        said = "proved" if g.proof else "likely" if flies else "a guess"
        line = f"{key} = {{ channel = {inline(g.channel)}{unit}{sign}{more} }}  # {said}: {g.why}"
        lines.append(line if flies else f"# {line}")
    lanes = sorted({g.lane for g in taken.values() if g.lane and g.fit >= SURE})
    for lane in lanes:
        if not {f"{lane}.hm0", f"{lane}.hinge_moment"} & taken.keys():
            lines.append(f'"{lane}.hinge_moment" = {{ constant = 0.0 }}  # no column: none, as on a bench without load')
    left = [c for c in columns if c not in {g.channel for g in taken.values()}]
    lines += ["", *(f"# not used: {inline(c)}" if not c.isprintable() else f"# not used: {c}" for c in left)]
    return "\n".join(lines).rstrip() + "\n"
