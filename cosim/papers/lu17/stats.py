"""What the rows of [Lu17] ask of many seeds: figures 2 to 7 without load and with F_d of (4) known.

(9) prints F_d, and (17) integrates (4), which has it: filter and inversion know it here. In figures 5 to 7 m = p = 1
and F = 1, so that N of (48) is 1 and y never reaches the state. The caption of figure 2 says liquid OFC; by section
IV.C, to which it belongs, it is the fault-free case. "Unbiased" is judged by the systematic error: what of the error
all seeds share, the scatter of their mean taken off, so that it does not depend on how many seeds there are.
"""

import functools
from typing import Any

import numpy as np

from actuators.hydraulic import actuator, lu17
from cosim.papers.lu17 import bench
from fdi.hydraulic import iotsekf

STATES = {"q": "q_hat", "q'": "qd_hat", "x3": "x3_hat"}
TRUE = {"q": "q", "q'": "qd", "x3": "x3", "f": "f"}
WALK = float(np.array(iotsekf.NOISE["q_f"]))  # of (14)


def _rms(y):
    return float(np.sqrt((y**2).mean()))


def _systematic(error, signal):
    """Return (what errors (seeds, ticks) have in common over the signal's own rms, the same over their scatter)."""
    scatter = _rms(error.std(0, ddof=1))
    common = np.sqrt(max(0.0, _rms(error.mean(0)) ** 2 - scatter**2 / len(error)))
    return float(common / max(_rms(signal), 1e-300)), float(common / max(scatter, 1e-300))


def _summary(out):
    found: dict[Any, Any] = {}
    for phase, ends in bench.PHASES.items():
        on = slice(*(round(t / bench.DT) for t in ends))
        o = out[:, on]
        error, leave = o["f_hat"] - o["f"], o["surface"] - o["r"]
        found["leaves", phase] = 1e3 * float(np.abs(leave).max())  # [mm]
        found["leaves rms", phase] = _rms(leave)
        found["rod leaves", phase] = 1e3 * abs(float((o["q"] - o["r"]).mean()))  # [mm]
        for name, estimate in STATES.items():
            mean = o[TRUE[name]].mean(0)
            found[name, phase] = _systematic(o[estimate] - o[TRUE[name]], mean - mean.mean())
        found["f", phase] = _systematic(error, np.array([bench.OFC_U / np.sqrt(2.0)]))
        found["q error", phase] = 1e3 * float(np.abs(o["q_hat"] - o["q"]).max())  # [mm]
        found["nis", phase] = float(o["nis"].mean())
        ahead = (out["f_hat"][:, :-1] - out["f"][:, 1:])[:, on]  # the filter's f is that of the tick to come
        found["nees", phase] = float((ahead**2 / np.maximum(out["f_sigma"][:, :-1][:, on], 1e-12) ** 2).mean())
        found["fault error", phase] = float(error.mean())
        found["fault error rms", phase] = _rms(error)
        found["fault error share", phase] = _rms(error) / max(_rms(o["f"]), 1e-300)
        found["share of bias", phase] = float(o["f_hat"].mean()) / bench.BIAS
    late = out["surface"][:, round(bench.ONSET / bench.DT) :]
    found["wanders", "after"] = 1e3 * float(np.abs(late - late[:, :1]).max())  # [mm]
    after = out[:, slice(*(round(t / bench.DT) for t in bench.PHASES["after"]))]
    gain = _sine(after["f_hat"]) / (_sine(after["f"]) or 1e-300)
    found["gain", "after"] = abs(gain)
    found["delay", "after"] = float(-1e3 * np.angle(gain) / (2 * np.pi * bench.OFC_HZ))  # [ms]
    return found


def _sine(y):
    """Return the complex amplitude of the OFC's frequency in the mean over the seeds, whole periods."""
    t = np.arange(y.shape[1]) * bench.DT
    return complex(2 * (y.mean(axis=0) * np.exp(-2j * np.pi * bench.OFC_HZ * t)).mean())


@functools.cache
def case(scenario: str, load: Any = "no load", seeds: int | None = None, **options: Any) -> Any:
    """Return {(number, phase): value} of a scenario under a load; `options` of `bench.fly`, `bench.SEEDS` seeds.

    "q", "q'", "x3" and "f" are (systematic error over the signal, over the scatter), the fault's over that of figure 3;
    "nis" and "nees" the squared innovation and fault error over the variance that the IOTSEKF reckons with.
    """
    return _summary(bench.fly(scenario, load, seeds=seeds or bench.SEEDS, **options))


def number(
    key: str,
    scenario: str,
    load: Any = "no load",
    phase: str = "after",
    over: str = "",
    walk: float = 1.0,
    **options: Any,
) -> Any:
    """Return one number of a case, over that of another phase if one is given; `walk` is a factor on q_f of (14)."""
    if walk != 1.0:
        options["q_f"] = walk * WALK
    found = case(scenario, load, **options)
    return found[key, phase] / found[key, over] if over else found[key, phase]


def unbiased(scenario: str, load: str = "no load", phase: str = "after", walk: float = 1.0, **options: Any) -> Any:
    """Return the systematic error of q, q' or x3 over the signal, the largest; over its scatter too in the note."""
    each = {name: number(name, scenario, load, phase, walk=walk, **options) for name in STATES}
    return max(over for over, _ in each.values()), _told(each)


def unbiased_fault(**of: Any) -> Any:
    """Return the systematic error of f_hat without a fault over the fault of figure 3; over its scatter in the note."""
    each = {"f": number("f", phase="whole", **of)}
    return each["f"][0], _told(each)


def _told(each):
    return ", ".join(f"{name} {over:.2g}, {scatter:.2g} of its scatter" for name, (over, scatter) in each.items())


def gain(load: str) -> tuple[float, str]:
    """Return |f_hat / f| of figure 3 at 1 Hz, and the delay."""
    found = case("liquid OFC", load)
    return found["gain", "after"], f"delay {found['delay', 'after']:.0f} ms"


def linear_servo() -> tuple[float, str]:
    """Return how far the rod leaves its reference with a servo that does not know the root of (11), over the NDI."""
    linear = case("fault-free", "F_d known", linear=True)["leaves", "whole"]
    return linear / case("fault-free", "F_d known")["leaves", "whole"], f"{linear:.2f} mm"


def speeds() -> tuple[float, str]:
    """Return how far f_hat of a runaway at 10 deg/s is from that at 20 deg/s: rms over that of the latter."""
    slow, fast = (bench.fly("runaway", seeds=20, rate=share * bench.RATE)["f_hat"].mean(0) for share in (0.5, 1.0))
    late = slice(round(bench.ONSET / bench.DT), None)
    apart = np.std((slow - fast)[late]) / np.std(fast[late])
    return float(apart), f"at 20 deg/s {1e3 * np.abs(fast).max():.0f} mm at most"


def relative_degree() -> int:
    """Return how often the rod must be differentiated until the valve shows, by (4) linearised at rest."""
    A, B = lu17.linear(actuator.params()[0])
    return 1 + next(r for r in range(3) if (np.linalg.matrix_power(A, r) @ B)[0, 0] != 0.0)
