"""What the columns of a recording prove of one another's units and signs, by cosim/replay/map_physics.py; a signal of
which two units remain possible does not fly."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cosim.replay import map_physics as physics
from cosim.replay.units import factors

SURE = 0.6  # of a name understood: below it a line is a comment
SPEEDS = {"tas": "m/s", "cas": "m/s", "h_baro": "m"}  # their units are asked of the Mach number

ANGLES = ("alpha", "beta", "theta", "phi", "psi")
SURFACES = ("surface", "de_cmd", "da_cmd", "dr_cmd", "stab_cmd")
KINDS = (ANGLES, SURFACES, ("p", "q", "r"), ("pdot", "qdot", "rdot"))  # each in one unit as a rule


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
    open: bool = False  # its numbers may be in another unit, too

    @property
    def flies(self) -> bool:
        """Tell whether enough is known of it for a map that is to be flown."""
        return self.fit >= SURE and not self.open

    @property
    def name(self) -> str:
        """Return the signal's name in a map."""
        return f"{self.lane}.{self.word}" if self.lane else self.word

    @property
    def span(self) -> str:
        """Return the range of its numbers in words."""
        return self.why.split(",")[0]

    @property
    def named(self) -> bool:
        """Tell whether the unit stands in the channel's name."""
        return "unit by its name" in self.why


class Proof:
    """Guesses {signal: Guess} beside the columns {channel: samples} and their times, which prove them."""

    def __init__(self, taken: Mapping[str, Guess], columns: Mapping, clocks: Mapping, lane: str):
        self.out, self.columns, self.clocks, self.lane = dict(taken), columns, clocks, lane

    def y(self, name: str) -> Any:
        """Return the samples of a signal, in its channel's unit."""
        return self.columns[self.out[name].channel]

    def t(self, name: str) -> Any:
        """Return their times [s]."""
        return self.clocks[self.out[name].channel]

    def si(self, name: str, unit: str) -> Any:
        """Return the samples of a signal in the SI unit that is named."""
        return self.y(name) * factors(unit)[self.out[name].unit]

    def beside(self, *names: str) -> bool:
        """Tell whether all signals are there, of as many samples."""
        return all(n in self.out for n in names) and len({len(self.y(n)) for n in names}) == 1

    def flown(self, name: str, unit: str) -> Any:
        """Return the samples of a signal in SI where it flies, with its sign, else None."""
        g = self.out.get(name)
        return g.sign * self.si(name, unit) if g and g.flies else None

    def set(self, name: str, **changes: Any) -> None:
        """Change what is guessed of a signal."""
        self.out[name] = replace(self.out[name], **changes)

    def prove(self, name: str, why: str, **changes: Any) -> bool:
        """Take a unit or a sign for proved; where the name of the channel says another unit, say so and return True."""
        old = self.out[name]
        lies = old.named and changes.get("unit", old.unit) != old.unit
        why += f", though its name says {old.unit}" if lies else ""
        self.set(name, fit=1.0, proof=True, open=False, why=why, **changes)
        return lies

    def proved(self) -> dict[str, Guess]:
        """Return the guesses with the units and signs that the numbers prove; a deflection stands for a command."""
        out = self.out
        moved, lane = out.pop("deflection", None), self.lane
        if moved is not None and "de_cmd" not in out:
            out["de_cmd"] = replace(moved, word="de_cmd", proxy="the measured deflection")
        elif moved is not None and not any(g.word == "surface" for g in out.values()):
            out[f"{lane}.surface"] = replace(moved, word="surface", lane=lane, proxy="the deflection of the elevator")
        self._air()
        if "n_z" in out and (gravity := physics.gravity(self.y("n_z"))):
            unit, sign, offset, why, proof = gravity
            self.set("n_z", unit=unit, sign=sign, offset=offset, fit=1.0, proof=proof, open=False, why=why)
            for name in {"n_x", "n_y"} & out.keys():
                if not out[name].named:
                    self.set(name, unit=unit, open=False, why=f"as {out['n_z'].channel}")
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
        self._motion()
        _alike(out)
        for rate, of in (("p", "phi"), ("q", "theta"), ("r", "psi"), ("pdot", "p"), ("qdot", "q"), ("rdot", "r")):
            if self.beside(rate, of):
                self._rate(rate, of)
        _alike(out)  # with what is proved by now
        rods = [g for g in out.values() if g.word == "rod"]
        self._elevator(f"{lane}.surface" if moved is not None and f"{lane}.surface" in out else "de_cmd", rods)
        for rod, name in ((g.name, name) for g in rods for name in (f"{g.lane}.surface", "de_cmd")):
            if self.beside(rod, name) and physics.correlation(self.y(rod), self.y(name)) < -0.5:
                self.set(name, sign=-1, why=f"{out[name].why}, runs against the rod")  # all are + trailing edge down
        return out

    def _rate(self, rate, of):
        """Take the unit and sign of a rate by what it is the rate of, or where only the rate's unit is known, that."""
        g, base, more = self.out[rate], self.out[of], "2" if rate.endswith("dot") else ""
        if more and not g.open:
            return
        by = {u: physics.rate_unit(self.t(rate), self.y(rate), self.y(of), u) for u in ("rad", "deg")}
        own = base.unit.split("/")[0]
        if base.open and not g.open:
            own = next((u for u, (unit, _) in by.items() if unit + more == g.unit), own)
            if by[own][0] + more == g.unit:
                self.prove(of, f"{base.span}, {g.channel} is its rate of change",
                           unit=base.unit.replace(base.unit.split("/")[0], own))  # fmt: skip
                base = self.out[of]
        unit, sign = by[own]
        if unit:
            sure = not base.open
            self.set(rate, unit=unit + more, sign=sign, fit=1.0, proof=sure, open=not sure,
                     why=f"the rate of change of {base.channel}{'' if sure else ', in rad or deg'}")  # fmt: skip
            if base.fit < SURE:
                self.set(of, fit=1.0, proof=sure, why=f"{base.why}, {g.channel} is its rate of change")

    def _elevator(self, moved, rods):
        """Take the sign of an elevator by the pitching motion that follows it, of its command by the elevator's."""
        if moved not in self.out or rods:
            return
        g, nose = self.out[moved], 0.0
        if self.beside(moved, "q"):
            slope, nose = physics.elevator(self.t("q"), self.y(moved), self.si("q", "rad/s"))
            nose *= self.out["q"].sign
            unit = physics.elevator_unit(slope, nose) if g.open and self.out["q"].flies else ""
            if unit:
                self.prove(moved, f"{g.span}, by the pitching that follows it", unit=unit)
                _alike(self.out)
                g = self.out[moved]
        sign = -1 if nose > 0.3 else 1 if nose < -0.3 else g.sign
        up = "up" if sign < 0 else "down"
        told = f"the nose follows it {up}" if abs(nose) > 0.3 else "nothing proves that trailing edge down is +"
        self.set(moved, sign=sign, why=g.why if "trailing edge" in g.why and abs(nose) <= 0.3 else f"{g.why}, {told}")
        if moved != "de_cmd" and self.beside(moved, "de_cmd"):
            r = physics.correlation(self.y(moved), self.y("de_cmd"))
            if abs(r) > 0.5:
                why = f"{self.out['de_cmd'].why}, runs {'with' if r > 0.0 else 'against'} {g.channel}"
                self.set("de_cmd", sign=sign if r > 0.0 else -sign, why=why)

    def _speed(self):
        """Return the true airspeed [m/s], by tas or by what it can be made from, None if nothing holds it."""
        base = speed_from(self.out)
        if (tas := self.flown("tas", "m/s")) is not None or not base or not self.beside(base, "h_baro"):
            return tas
        return physics.airspeed(self.si("h_baro", "m"), **{base: self.si(base, "m/s" if base == "cas" else "-")})

    def _motion(self):
        """Take the units of angle of attack, attitude and pitch rate that the climb, the lift and the load allow."""
        out, speed, n_z, climb = self.out, self._speed(), self.flown("n_z", "g"), self.flown("hdot", "m/s")
        h = self.flown("h_baro", "m")
        if climb is None and h is not None and (np.diff(self.t("h_baro")) > 0.0).all():
            climb = np.gradient(h, self.t("h_baro"))
        pair = self.beside("theta", "alpha")
        if pair and speed is not None and climb is not None and len(speed) == len(climb) == len(self.y("theta")):
            with np.errstate(divide="ignore", invalid="ignore"):
                path = np.arcsin(np.clip(climb / speed, -1.0, 1.0))
            left = physics.path_units(self.t("theta"), self.y("theta"), self.y("alpha"), path)
            for k, name in enumerate(("theta", "alpha")):
                units = {u[k] for u in left}
                if len(units) == 1 and not out[name].proof and not out[name].named:
                    why = f"{out[name].span}, attitude less angle of attack is the path's angle"
                    self.prove(name, why, unit=units.pop())
        if "alpha" in out and out["alpha"].open and n_z is not None and len(n_z) == len(self.y("alpha")):
            if unit := physics.lift_unit(self.y("alpha"), n_z):
                self.prove("alpha", f"{out['alpha'].span}, by the lift in n_z", unit=unit)
        if "q" in out and out["q"].open and speed is not None:
            load = n_z if n_z is not None and len(n_z) == len(self.y("q")) else None
            if unit := physics.turn_unit(self.t("q"), self.y("q"), speed, load):
                self.prove("q", f"{out['q'].span}, by the load that it makes at the airspeed", unit=unit)

    def _air(self):
        """Take the units that Mach number, speeds and altitude allow together; one they refute does not fly."""
        for name, units in physics.air({n: self.y(n) for n in ("mach", *SPEEDS) if n in self.out}).items():
            g = self.out[name]
            if len(units) == 1:
                self.prove(name, f"{g.span}, Mach and the others ask for {units[0]}", unit=units[0])
            elif g.unit not in units:
                why = f"{g.span}, Mach allows {' or '.join(units)}"
                self.set(name, unit=units[0], fit=min(g.fit, 0.5 * SURE), why=why)

    def _as_small(self):
        """Take angles and rates that are named in degrees for radians, one of the file being proved to be, where they
        are as small: a full circle for a heading."""
        for name, g in self.out.items():
            most = float(np.nanmax(np.abs(self.y(name)), initial=0.0))
            if g.unit.startswith("deg") and not g.proof and most < (6.3 if name in ("psi", "phi") else 0.5):
                self.set(name, unit=g.unit.replace("deg", "rad"), why=f"{g.why}, but another's name is wrong here")


def speed_from(out: Mapping[str, Guess]) -> str:
    """Return which of the signals {name: Guess} gives the true airspeed beside the altitude, "" for none of them."""
    if "h_baro" not in out or not out["h_baro"].flies:
        return ""
    return next((name for name in ("cas", "mach") if name in out and out[name].flies), "")


def _alike(out):
    """Give angles, rates and deflections whose unit nothing says that of the others of their kind; a deflection has not
    the unit of an angle for certain: its own numbers, if small, agree with that, or it stays open."""
    for kind in KINDS:
        same = {n: g for n, g in out.items() if g.word in kind}
        own = {n: g for n, g in same.items() if not g.named and not g.proof and "too large" not in g.why}
        proved = {g.unit for g in same.values() if g.proof and not g.open}
        units = proved or {g.unit for g in same.values() if not g.named and "too large" in g.why and g.fit >= SURE}
        if kind is ANGLES and not units and all(n in own and "as if in" in own[n].why for n in ("alpha", "theta")):
            units = {"rad"}
        for name in own if len(units) == 1 else ():
            out[name] = replace(own[name], unit=min(units), open=False, why=f"{own[name].span}, as the others")
    angles = [g.unit for n, g in out.items() if n in ANGLES and not g.open]
    for name, g in out.items():
        if g.word in SURFACES and "as if in rad" in g.why and "deg" in angles:
            why = f"{g.span}, rad or deg: as small as in rad, but the angles are in deg"
            out[name] = replace(g, open=True, why=why)
