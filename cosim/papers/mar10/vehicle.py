"""A flying vehicle with the force equations of [Mar10] slide 7: four effectors, on which all 27 residuals exist.

The talk prints the pattern of its vehicle and no number. `aircraft/finned/finned.xml` is a JSBSim model with that
pattern, linear in the fins as slide 7 is: 500 kg, 300 m/s at 3,000 m, statically stable, fins for roll, pitch and yaw,
a motor. An autopilot holds bank, load factors and speed, and swings both load factors by 0.3 g so that a locked fin
shows.
Draws are slide 11's: every coefficient of the forces 5 % up or down, an accelerometer with scale factor, bias and white
noise, two steps of delay; the sizes of the IMU's errors are ours, the talk prints none.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from actuators.constants import G0, M_PER_FT, N_PER_LBF, PA_PER_PSF, RAD_PER_DEG
from cosim.flight.plant.plant import bare_model
from cosim.scenario.aircraft import FOLDER

MODEL = FOLDER / "finned" / "finned.xml"
DT, END, DELAY = 0.01, 42.0, 2  # [s], steps
EFFECTORS = ("delta_l", "delta_m", "delta_n", "eta")
FAULTS: dict[int, tuple[tuple[str, float], ...]] = {  # effector and time [s]; eta loses LOSS, the others lock in place
    1: (("eta", 12.0),),
    2: (("delta_m", 12.0), ("eta", 24.0)),
    3: (("eta", 12.0), ("delta_m", 22.0), ("delta_n", 32.0)),
}
LOSS = {1: 0.25, 2: 0.25, 3: 0.5}  # slide 11
ROWS = {"x": ("cx0", "cxa", "cxl", "cxm", "cxn"), "y": ("cy0", "cyb", "cyl", "cyn"), "z": ("cz0", "cza", "czm")}
SCALE, BIAS, NOISE, QBAR = 0.005, 0.002 * G0, 0.005 * G0, 0.01  # of the accelerometer [1, m/s2, m/s2]; of qbar [1]
VANE = 0.03 * RAD_PER_DEG  # noise of the angles of attack and sideslip


@dataclass(frozen=True)
class VehicleFlight:
    """What is measured, and the commands: arrays over ticks; SI, u_c as EFFECTORS (T, 4), a (T, 3) specific force."""

    t: np.ndarray
    a: np.ndarray
    alpha: np.ndarray
    beta: np.ndarray
    qbar: np.ndarray
    u_c: np.ndarray
    u: np.ndarray  # what the effectors did: the truth
    height: np.ndarray


@cache
def numbers() -> dict[str, float]:
    """Return the model's numbers as its file has them: coefficients, thrust [N], mass [kg], area [m2]."""
    root = ET.parse(MODEL).getroot()
    given = [p for p in root.iter("property") if "value" in p.attrib]
    out = {str(p.text).rpartition("/")[2]: float(p.attrib["value"]) for p in given}
    mass, area = root.find("mass_balance/emptywt"), root.find("metrics/wingarea")
    assert mass is not None and area is not None  # of a model that JSBSim loads
    return out | {"mass": float(mass.text or 0), "area": float(area.text or 0)}


def equations(flown: VehicleFlight, of: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return (known part (T, 3), G (T, 3, 4)) of a_b = known + G u [Mar10] slide 7, by the numbers `of`."""
    k = flown.qbar * of["area"] / of["mass"]
    x = -k * (of["cx0"] + of["cxa"] * flown.alpha) + of["least-n"] / of["mass"]
    known = np.stack([x, k * (of["cy0"] + of["cyb"] * flown.beta), k * (of["cz0"] + of["cza"] * flown.alpha)], 1)
    G = np.zeros((len(k), 3, 4))
    for j, name in enumerate(("cxl", "cxm", "cxn")):
        G[:, 0, j] = -k * of[name]
    G[:, 0, 3] = (of["most-n"] - of["least-n"]) / of["mass"]
    G[:, 1, 0], G[:, 1, 2], G[:, 2, 1] = k * of["cyl"], k * of["cyn"], k * of["czm"]
    return known, G


def bound(flown: VehicleFlight, of: Mapping[str, float], share: float = 0.05) -> np.ndarray:
    """Return how far a row may be off without a fault (T, 3) [m/s2], noise apart: the sum of what slide 11 allows.

    Every coefficient by `share`, the accelerometer and the dynamic pressure by their errors. Nothing is trained.
    """
    _, G = equations(flown, of)
    k = flown.qbar * of["area"] / of["mass"]
    aero = np.stack([k * (abs(of["cx0"]) + abs(of["cxa"] * flown.alpha)), k * abs(of["cyb"] * flown.beta),
                     k * abs(of["cza"] * flown.alpha)], 1)  # fmt: skip
    fins = np.abs(G[:, :, :3] * flown.u_c[:, None, :3]).sum(2)
    vane = VANE * np.stack([k * abs(of["cxa"]), k * abs(of["cyb"]), k * abs(of["cza"])], 1)
    return (share + QBAR) * (aero + fins) + SCALE * np.abs(flown.a) + BIAS + vane


def fly(number: int, draw: int | None = None) -> VehicleFlight:
    """Fly scenario 1 to 3 (0: no fault) with nominal coefficients and IMU, or those of a draw."""
    return fly_with(FAULTS.get(number, ()), LOSS.get(number, 0.0), (number, 0 if draw is None else draw + 1))


def fly_with(
    faults: tuple[tuple[str, float], ...], lost: float, seed: tuple[int, int] = (0, 0), bank: float = 0.0
) -> VehicleFlight:
    """Fly with `faults` (effector, onset [s]), `lost` the share of the thrust; the second seed 0: nominal.

    `bank` [rad] is rolled to and back every 2.5 s: zero, as in the talk's scenarios, hardly moves the roll fins.
    """
    rng, draw = np.random.default_rng([20101006, *seed]), seed[1] or None
    own = {n: v for n, v in numbers().items() if n in {c for row in ROWS.values() for c in row}}
    off = {n: 1.0 if draw is None else 1 + 0.05 * rng.choice((-1, 1)) for n in own}
    start = {"ic/h-sl-ft": 3000.0 / M_PER_FT, "ic/vt-fps": 300.0 / M_PER_FT, "ic/alpha-deg": 3.4, "ic/theta-deg": 3.4,
             **{f"coefficient/{n}": off[n] * v for n, v in own.items()}}  # fmt: skip
    run, port = bare_model(MODEL, DT, start)
    get = {n: port.node(p).get_double_value for n, p in READ.items()}
    effectors = port.row((p, 1.0) for p in ("fin/l-rad", "fin/m-rad", "fin/n-rad", "thrust/throttle"))
    pilot, n = _Autopilot(bank), round(END / DT)
    out, u_c, u = np.empty((n, 7)), np.empty((n, 4)), np.empty((n, 4))
    held = np.zeros(4)
    for k in range(n):
        t, now = k * DT, {name: read() for name, read in get.items()}
        u_c[k] = pilot.command(t, now)
        u[k] = u_c[k]
        for name, onset in faults:
            j = EFFECTORS.index(name)
            if t >= onset:
                u[k, j] = (1 - lost) * u_c[k, j] if name == "eta" else held[j]
            else:
                held[j] = u[k, j]
        effectors.write(u[k])
        run()
        out[k] = [get[name]() for name in MEASURED]
    a = out[:, :3] * N_PER_LBF / numbers()["mass"]
    return _measured(np.arange(n) * DT, a, out[:, 3:], u_c, u, rng, draw is not None)


def _measured(t, a, rest, u_c, u, rng, uncertain):
    """Return the VehicleFlight: measurements two steps late, and the commands with them."""
    noisy = float(uncertain)
    scale = 1 + noisy * SCALE * rng.choice((-1, 1), 3)
    a = a * scale + noisy * BIAS * rng.choice((-1, 1), 3) + NOISE * rng.standard_normal(a.shape)
    alpha, beta = rest[:, 0:2].T + VANE * rng.standard_normal((2, len(t)))
    qbar = rest[:, 2] * PA_PER_PSF * (1 + noisy * QBAR * rng.choice((-1, 1)))
    late = lambda y: np.concatenate([np.repeat(y[:1], DELAY, axis=0), y[:-DELAY]])  # noqa: E731
    return VehicleFlight(t, late(a), late(alpha), late(beta), late(qbar), late(u_c), late(u), rest[:, 3] * M_PER_FT)


MEASURED = ("fx", "fy", "fz", "alpha", "beta", "qbar", "h")
READ = {
    "fx": "forces/fbx-aero-lbs", "fy": "forces/fby-aero-lbs", "fz": "forces/fbz-aero-lbs", "alpha": "aero/alpha-rad",
    "beta": "aero/beta-rad", "qbar": "aero/qbar-psf", "h": "position/h-sl-ft", "p": "velocities/p-rad_sec",
    "q": "velocities/q-rad_sec", "r": "velocities/r-rad_sec", "phi": "attitude/phi-rad", "v": "velocities/vt-fps",
}  # fmt: skip


class _Autopilot:
    """Bank, load factors and speed as asked; integral action, so that a fault is answered as a law would."""

    def __init__(self, bank):
        self.bank = bank
        self.pitch, self.yaw, self.motor = -0.045, 0.0, 0.5

    def command(self, t, now):
        """Return (delta_l, delta_m, delta_n, eta) of this tick."""
        weight = numbers()["mass"] * G0 / N_PER_LBF
        swing = 0.3 * math.copysign(1.0, math.sin(2 * math.pi * t / 4.0)) * (t > 3.0)
        side = 0.3 * math.copysign(1.0, math.sin(2 * math.pi * t / 3.0)) * (t > 3.0)
        up = 1.0 + swing + np.clip((3000.0 - now["h"] * M_PER_FT) / 300.0, -0.2, 0.2) + now["fz"] / weight
        across = side - now["fy"] / weight
        slow = 300.0 + 3.0 * math.copysign(1.0, math.sin(2 * math.pi * t / 11.0)) - now["v"] * M_PER_FT
        self.pitch -= 0.15 * up * DT
        self.yaw -= 0.10 * across * DT
        self.motor += 0.01 * slow * DT
        bank = self.bank * math.copysign(1.0, math.sin(2 * math.pi * t / 5.0)) * (t > 3.0)
        l = -0.5 * (now["phi"] - bank) - 0.1 * now["p"]
        m = self.pitch - 0.01 * up + 0.12 * now["q"]
        n = self.yaw - 0.006 * across + 0.12 * now["r"]
        limit = 20 * RAD_PER_DEG
        return (*np.clip((l, m, n), -limit, limit), float(np.clip(self.motor + 0.04 * slow, 0.0, 1.0)))
