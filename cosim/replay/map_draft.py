"""Draft a map for a recording by looking at its columns: names, units in the names, ranges of the numbers.

A draft is a start, not a finding. Every line says how sure it is and what it rests on: the name alone, or what the
numbers prove together (cosim/replay/map_physics.py). What it is not sure of stands as a comment and does not fly.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from cosim.replay.foreign import read_channels, time_in
from cosim.replay.map_proof import SURE, Guess, Proof, speed_from
from cosim.replay.units import factors, known
from cosim.scenario.aircraft import DEFAULT, Aircraft, load_aircraft
from cosim.scenario.catalog import SEGMENTS
from cosim.scenario.toml import inline
from cosim.scenario.vocabulary import words

ELEVATOR = tuple(f"{a} {b}" for a in ("elevator", "elev")
                 for b in ("position", "pos", "deflection", "defl", "angle", "surface"))  # fmt: skip
NAMES = {  # word of the vocabulary -> what people call it, as tokens that a column's name must hold
    "alpha": ("alpha", "aoa", "angle of attack", "al", "alf"), "beta": ("beta", "aos", "sideslip", "be", "bet"),
    "cas": ("cas", "kcas", "ias", "kias", "vcas", "indicated airspeed", "calibrated airspeed"),
    "tas": ("tas", "ktas", "vtas", "airspeed", "va", "true airspeed"), "mach": ("mach",),
    "h_inertial": ("h inertial", "inertial altitude"),
    "h_baro": ("h baro", "baro", "altitude", "pressure altitude", "alt", "palt", "hp", "hqnh"),
    "hdot": ("hdot", "vertical speed", "climb rate", "vs", "alt rate"),
    "v_ground": ("v ground", "ground speed", "gs"),
    "p": ("p", "roll rate", "prgx", "gyr x", "gyro x", "angular velocity x"),
    "q": ("q", "pitch rate", "qrgy", "gyr y", "gyro y", "angular velocity y"),
    "r": ("r", "yaw rate", "rrgz", "gyr z", "gyro z", "angular velocity z"),
    "phi": ("phi", "bank", "roll", "roll att", "roll attitude", "roll angle", "bank angle"),
    "theta": ("theta", "pitch", "the", "pitch att", "pitch attitude", "pitch angle"),
    "psi": ("psi", "heading", "hdg", "yaw"), "pdot": ("pdot", "p dot", "roll acceleration"),
    "qdot": ("qdot", "q dot", "pitch acceleration"), "rdot": ("rdot", "r dot", "yaw acceleration"),
    "n_x": ("n x", "nx", "ax", "long acc", "acc x", "accelerometer x", "linear acceleration x"),
    "n_y": ("n y", "ny", "ay", "lat acc", "acc y", "accelerometer y", "linear acceleration y"),
    "n_z": ("n z", "nz", "load factor", "az", "an", "norm acc", "acc z", "accelerometer z", "linear acceleration z"),
    "n1": ("n1",),
    "mass": ("mass", "gross weight", "gw"), "cg": ("cg",),
    "deflection": ("delv", "de", "delta e", "elev", "elevator", *ELEVATOR),
    "de_cmd": ("de cmd", "elev cmd", "elevator cmd", "elevator command"),
    "da_cmd": ("da cmd", "ail cmd", "aileron command"), "dr_cmd": ("dr cmd", "rud cmd", "rudder command"),
    "stab_cmd": ("stab cmd", "stabiliser command", "stabilizer command"),
    "throttle_cmd": ("throttle cmd", "throttle", "thr"),
    "valve_command": ("valve", "valve cmd", "servo valve", "sv", "u"), "current_command": ("current cmd", "i cmd"),
    "rod": ("rod", "ram", "stroke", "lvdt"), "surface": ("surf", "surface", "rvdt", "deflection", "elev", "elevator",
                *ELEVATOR),
    "pressure": ("dp", "delta p", "pressure", "press"), "velocity": ("velocity", "motor speed", "omega"),
    "position": ("position", "screw", "pos"), "current": ("current", "amps", "motor current"),
    "hm0": ("hm0",), "hmd": ("hmd",), "hinge_moment": ("hinge moment", "hinge", "load"),
}  # fmt: skip
KNOTS = {"kcas", "kias", "ktas"}  # the unit is in the name of the speed
AXIS = re.compile(r"\[([0-2])\]$")  # of a vector: gyro_rad[1] is about y
EDGE = {"teu": -1, "ted": 1}  # trailing edge up, down: ours is + down
FILLERS = re.compile(r"(d?adc|ahrs|irs|ins|vane|air|b|cg)\d*")  # systems and axes: they say nothing of what is measured
WHOLE = {name for names in NAMES.values() for name in names if " " not in name}
PLACES = {"left": "lh l port", "right": "rh r starboard", "inner": "in inboard ib", "outer": "out outboard ob"}
SHORT = {"li": "left inner", "lo": "left outer", "ri": "right inner", "ro": "right outer", "lib": "left inner",
         "lob": "left outer", "rib": "right inner", "rob": "right outer"}  # fmt: skip
# degrees that an angle does not exceed: beyond them a column is in some other unit, counts of a servo say
MOST_DEG = {**dict.fromkeys(("alpha", "beta", "theta", "deflection", "surface"), 90.0), "phi": 185.0, "psi": 365.0}
# beyond which an angle or a rate is not in radians: no wing flies so, no cockpit turns so fast, a circle ends there
MOST_RAD = {"alpha": 0.5, "beta": 0.5, "phi": 3.2, "psi": 6.3, "q": 1.0, "r": 1.0,
            **dict.fromkeys(("deflection", "surface", "de_cmd", "da_cmd", "dr_cmd", "stab_cmd"), 0.9)}  # fmt: skip
# up to which it is hardly in degrees: less than the noise of a sensor all along. Between the two, either may be meant
LEAST_DEG = {"alpha": 0.1, "rad": 0.05, "rad/s": 0.02, "rad/s2": 0.05}
MISSING = (*(float(10**n - 1) for n in range(3, 10)), 32767.0, 32768.0, 1e30)  # written for a lost sample, either sign
BEYOND = 1e100  # no quantity is as large: its square is no number any more
FAR = 10.0  # times as far from zero as the others: a number of MISSING, or wild
WILD = 1000  # samples of which one may be wild
FIXED = ("mass", "cg", "hm0", "hmd", "hinge_moment")  # may be constant; a sensor or a command that is says nothing
LARGEST = {  # of the SI unit, beyond which a column is in another one
    "rad": 1.6, "m": 1.0, "rad/s": 3.0, "rad/s2": 6.0, "-": 1.6,
}  # fmt: skip
OTHER = {"rad": "deg", "rad/s": "deg/s", "rad/s2": "deg/s2", "m": "mm", "-": "%"}
POINT = {"mass": ("mass_t", 1e-3, 200.0), "cg": ("cg_pct", 100.0, 30.0), "h_baro": ("altitude_ft", 1 / 0.3048, 20000.0),
         "cas": ("cas_kt", 3600 / 1852, 290.0)}  # fmt: skip


def draft(
    path: str | Path, *, time: str | None = None, aircraft: str | None = None, columns: Sequence[str] = ()
) -> str:
    """Return the text of a map for the recording at `path`, for the detectors of `aircraft` (default: the transport's);
    `columns` name those of a file without names, `time` names its time column.

    Raises LogError as `read_channels` does, ScenarioError for an unknown aircraft.
    """
    own = load_aircraft(aircraft or DEFAULT)
    named = tuple(columns)
    time = time or time_in(Path(path), named)
    tables = read_channels(path, time=time, on_reset="split", part=0, columns=named)
    found, clocks, more = {}, {}, {}
    for name, frame in tables.items():
        for column, y in zip(frame.columns, frame.to_numpy().T):  # one by one pandas copies what is said of the table
            channel = column if len(tables) == 1 else f"{name}.{column}"
            clocks[channel] = frame.index.to_numpy()
            found[channel], more[channel] = _looked_at(y)
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
    steps = [float(np.median(np.diff(t))) for t in clocks.values() if len(t) > 1]
    rates = sorted({round(1.0 / step) for step in steps if step > 0.0})
    proved = Proof(taken, found, clocks, _segment([], own.segments)).proved()
    told = f"{rates[0]} Hz" if len(rates) == 1 else f"{rates[0]} to {rates[-1]} Hz" if rates else ""
    other = f": the recording's {told} is brought to it" if rates and rates != [200] else ""
    tick = f"rate_hz = 200  # tick at which the detectors were designed{other}"
    texts = [c for frame in tables.values() for c in frame.attrs.get("texts", ())]
    return _text(Path(path), proved, found, [tick, *head], own, more, texts)


def guesses(channel: str, y: np.ndarray, segments: Sequence[str] = SEGMENTS, engines: int = 4) -> Iterable[Guess]:
    """Yield what a column may be; `y` are its numbers."""
    name = AXIS.sub(lambda m: f" {'xyz'[int(m[1])]}", channel)
    bracket = re.search(r"[\[(]([^\[\]()]*)[\])]\s*$", name)
    tokens = _tokens(name[: bracket.start()] if bracket and known(bracket[1]) else name) or [""]
    unit = known(bracket[1]) if bracket else ""
    unit = unit or next(filter(None, map(_unit_in, reversed(tokens[1:]))), "")
    for k in range(len(tokens) - 1, 1, -1):  # DEG_S, M_S, FT_MIN: a unit over two words
        if (two := known("_".join(tokens[k - 1 : k + 1]))) and not bracket:
            unit, tokens = two, tokens[: k - 1] + tokens[k + 1 :]
            break
    sign = next((EDGE[t] for t in tokens if t in EDGE), 0)
    tokens = [t for t in tokens if t not in EDGE] or [""]
    rest = [t for t in tokens if _unit_in(t) != unit or t == tokens[0]] if unit else tokens
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
        found = max((n for n in names if set(held).issuperset(n.split())), key=len, default="")
        if not found or (sent and not word.endswith(("cmd", "command"))):
            continue
        if len(found) < 3 and len(found.split()) < len(held) and names != NAMES["n1"]:  # the R of DLC_R is no yaw rate
            continue
        if local and not place and (len(found) < 2 or found in NAMES["deflection"]):
            continue  # u beside v and w is a speed, "left u" a command; a segment's elevator has its place
        si = {"hinge_moment": "N m", "deflection": "rad"}.get(word) or words()[word].unit
        allowed = factors(si, {"Pa": 1.0} if word == "pressure" else {"N": 1.0} if word == "hinge_moment" else {})
        if found.startswith("gyro") and f"{unit}/s" in allowed:  # gyro_rad: in rad/s
            unit = f"{unit}/s"
        if unit and unit not in allowed:
            continue
        fit = len(found.split()) / max(1, len(held)) + 0.1 * len(found) / 20 + 0.2 * bool(place and local)
        fit = max(fit, 0.8) if names == NAMES["n1"] else fit  # with a side: nothing else is called so
        unit_, why, either = _unit(word, si, unit, y)
        most = float(np.nanmax(np.abs(y))) if np.isfinite(y).any() else 0.0
        if unit_ == "deg" and most > MOST_DEG.get(word, np.inf):
            unit_, why, fit = "deg", f"{why}, too large for degrees", min(fit, 0.5 * SURE)
        elif not np.isfinite(y).any():
            why = "no number in it"
        elif word not in FIXED and np.nanmin(y) == np.nanmax(y):
            why, fit = f"{why}, constant", min(fit, 0.5 * SURE)
        up = sign if word in ("surface", "deflection", "de_cmd") else 0
        why += f", trailing edge {'down' if up > 0 else 'up'} by its name" if up else ""
        yield Guess(channel, word, _segment(place, segments) if local else "", unit_, why, fit, up or 1, open=either)


def _looked_at(y: np.ndarray) -> tuple[np.ndarray, str]:
    """Return (the samples without those that say nothing of the others, what the map has to say of them): numbers that
    stand for lost samples, single wild ones, cells that are empty because the channel is slower than the table."""
    y, more = np.where(np.abs(y) < BEYOND, y, np.nan), ""
    size = np.sort(np.abs(y[np.isfinite(y)]))
    wild = len(size) // WILD + 1
    if not len(size):
        return y, more
    for value in (y[np.isfinite(y)].min(), y[np.isfinite(y)].max()):
        rest = np.abs(y[np.isfinite(y) & (y != value)])
        if abs(value) in MISSING and len(rest) and abs(value) > FAR * rest.max():
            more, y, size = f", missing = {value:.10g}", np.where(y == value, np.nan, y), np.sort(rest)
            break
    if len(size) > wild and size[-wild - 1] > 0.0:
        y = np.where(np.abs(y) > FAR * size[-wild - 1], np.nan, y)
    filled = np.diff(np.flatnonzero(np.isfinite(y)))
    if len(filled) > 1 and np.median(filled) > 1 and filled.max() <= 2 * np.median(filled):
        more += ", sparse = true"
    return y, more


def _tokens(channel: str) -> list[str]:
    """Return the words of a column's name, in small letters: of NzG, ELEV_CMD_DEG, left-inner rod [mm]."""
    out: list[str] = []
    for token in re.split(r"[^A-Za-z0-9]+", (re.search(r"[^./]+\.[xyz]$|[^.]+$", channel) or [channel])[0]):
        token = re.sub(r"(?<=[A-Z]{2})CG$", "", token)
        whole = _unit_in(token) or token.lower() in WHOLE
        parts = [token] if whole else re.split(r"(?<=[a-z0-9])(?=[A-Z])", token)
        out += [word for part in parts if part for word in SHORT.get(part.lower(), part.lower()).split()]
    return out


def _unit_in(token: str) -> str:
    """Return the unit that a word of a column's name is, "" for none."""
    return known(token) if token.isalpha() else ""


def _segment(place: list[str], segments: Sequence[str]) -> str:
    """Return the segment of the places named, the left inner one, or the left one, where nothing is said."""
    side = next((p for p in place if p in ("left", "right")), "left")
    where = next((p for p in place if p in ("inner", "outer")), "inner")
    return next((s for s in segments if s in (f"{side}_{where}", side)), segments[0])


def _unit(word: str, si: str, named: str, y: np.ndarray) -> tuple[str, str, bool]:
    """Return (unit, why, whether it may be another one, too): by the name, else by the range of the numbers."""
    finite = y[np.isfinite(y)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (np.nan, np.nan)
    span = f"{low:.4g} to {high:.4g}"
    if named:
        return named, f"{span}, unit by its name", False
    most = max(abs(low), abs(high))
    if si == "m" and (most > 100.0 or word.startswith("h_")):  # what Mach number and speeds do not prove
        unit, why = ("ft", "too large for an airliner's metres") if most > 16000.0 else ("m", "m or ft")
        return unit, f"{span}, {why}", False
    limit = LARGEST.get(si, np.inf)
    if word == "alpha" and len(finite):  # a vane turns freely on the ground
        most = max(float(np.percentile(np.abs(finite), 90.0)), 0.3 * most)
    if most > MOST_RAD.get(word, limit):
        return OTHER[si], f"{span}, too large for {si}", False
    if most > LEAST_DEG.get(word, LEAST_DEG.get(si, np.inf)):
        return si, f"{span}, {si} or {OTHER[si]}: these numbers allow both", True
    return si, f"{span}, as if in {si}", False


def _point(word: str, value: float, own: Aircraft) -> float:
    low, high = {"mass": own.mass.mass_t, "cg": own.mass.cg_pct, "h_baro": own.limits.altitude_ft,
                 "cas": own.limits.cas_kt}[word]  # fmt: skip
    return min(max(value, low), high)


def _text(
    path: Path, taken: Mapping[str, Guess], columns: Mapping[str, np.ndarray], head: list[str], own: Aircraft,
    looks: Mapping[str, str], texts: Sequence[str]
) -> str:  # fmt: skip
    lines = [f"# Draft of a map for {path.name}: check every unit, sign and meaning."]
    lines += [*head, '# aircraft = "NAME"  # that was recorded', "", "[flight]"]
    if own.name != DEFAULT:
        lines.append(f"aircraft = {inline(own.name)}")
    for word, (key, factor, usual) in POINT.items():
        if word in taken and taken[word].flies and np.isfinite(columns[taken[word].channel]).any():
            scale = factors(words()[word].unit)[taken[word].unit]
            middle = float(np.nanmedian(columns[taken[word].channel])) * scale * factor
            value = _point(word, middle, own)
            bounded = "" if value == middle else ", bounded"
            said = f"{float(format(value, '.4g')):.10g}"  # 20000, not 2e+04
            lines.append(f"{key} = {said}  # median of {inline(taken[word].channel)}{bounded}")
        else:
            lines.append(f"{key} = {_point(word, usual, own):g}  # not in the recording")
    lines += ["", "[signals]"]
    for name, g in sorted(taken.items(), key=lambda item: ("." in item[0], item[0])):
        unit = "" if g.unit == ("N m" if g.word == "hinge_moment" else words()[g.word].unit) else f', unit = "{g.unit}"'
        key = f'"{name}"' if "." in name else name
        sign = ", sign = -1" if g.sign < 0 else ""
        more = looks.get(g.channel, "") + (f", offset = {g.offset:g}" if g.offset else "")
        more += f", proxy = {inline(g.proxy)}" if g.proxy else ""
        said = "proved" if g.proof and g.flies else "likely" if g.flies else "a guess"
        line = f"{key} = {{ channel = {inline(g.channel)}{unit}{sign}{more} }}  # {said}: {g.why}"
        lines.append(line if g.flies else f"# {line}")
    if (base := speed_from(taken)) and not ("tas" in taken and taken["tas"].flies):
        lines.append(f'tas = {{ speed_of = "{base}" }}  # a proxy: by {base} and h_baro in the standard atmosphere')
    lanes = sorted({g.lane for g in taken.values() if g.lane and g.flies})
    for lane in lanes:
        if not {f"{lane}.hm0", f"{lane}.hinge_moment"} & taken.keys():
            lines.append(f'# "{lane}.hinge_moment" = {{ constant = 0.0 }}  # without load; not in the recording')
    used = {g.channel for g in taken.values()}
    left = [c for c in columns if c not in used]
    lines += ["", *(f"# not used: {inline(c)}" if not c.isprintable() else f"# not used: {c}" for c in left)]
    lines += [f"# text, not numbers: {inline(c)}" for c in texts]
    return "\n".join(lines).rstrip() + "\n"
