"""[Lu17] row by row: figures 2 to 7 without load and with F_d of (4) known, what an unknown F_d does, and in flight.

The bench and what the paper leaves open are in `lu17.bench`. "Unbiased" is judged by a test: at which share of the
instants is the mean error of 100 seeds beyond the bound that an unbiased one passes in 1 %? (9) prints F_d, and (17)
integrates (4), which has it: filter and inversion know it here. In figures 5 to 7 m = p = 1 and F = 1, so that N of
(48) is 1 and y never reaches the state. The caption of figure 2 says liquid OFC; by section IV.C, to which it belongs,
it is the fault-free case.
"""

from typing import Any

import numpy as np

from cosim.papers.lu17 import bench
from cosim.papers.lu17.stats import case, linear_delay
from fdi.hydraulic import iotsekf

WALK = float(np.array(iotsekf.NOISE["q_f"]))  # of (14)
AT_X_HAT = {"centre": 1.0, "total_sign": 1.0}
SOLID: dict[str, tuple[float, dict]] = {  # what is changed of the filter in figure 4: factor on q_f, parameters
    "with a walk (14) ten times as strong": (10.0, {}),
    "hundred times": (100.0, {}),
    "with (17) at x_hat and sign(u + f)": (1.0, AT_X_HAT),
    "both": (100.0, AT_X_HAT),
}


def follows(load: str) -> tuple[float, str]:
    """Return how far the rod leaves its reference without a fault [mm]; with F_d constant over the rod in the note."""
    note = ""
    if load != "no load":
        note = f"with F_d constant over the rod {case('fault-free', load, hmd=0.0)['leaves', 'whole']:.2f}"
    return case("fault-free", load)["leaves", "whole"], note


def gain(load: str) -> tuple[float, str]:
    """Return |f_hat / f| of figure 3 at 1 Hz, and the delay."""
    found = case("liquid OFC", load)
    note = f"delay {found['delay', 'after']:.0f} ms, of a linear Kalman filter {linear_delay():.0f} ms"
    return found["gain", "after"], note


def solid_error() -> tuple[float, str]:
    """Return the rms of the fault's error over that of the fault in figure 4; with the filter changed in the note."""
    told = "; ".join(
        f"{word} {matches('solid OFC', seeds=20, q_f=q_f * WALK, **own):.2f}" for word, (q_f, own) in SOLID.items()
    )
    return matches("solid OFC"), told


def leaves(measured: bool) -> float:
    """Return how far the rod is from its reference in figure 5 [mm], mean size, by what is fed back."""
    return abs(case("liquid jamming", measured=measured)["rod leaves", "after"])


def output_fault(load: str) -> tuple[float, str]:
    """Return the mean of f_hat over the bias of figure 5."""
    note = "with N = 1 (46) never reads y: figures 6 and 7 differ from 5 in f only, and their error is the same"
    return case("liquid jamming", load)["f_hat", "after"] / bench.BIAS, note


def linear_servo() -> tuple[float, str]:
    """Return how far the rod leaves its reference with a servo that does not know the root of (11), over the NDI."""
    linear = case("fault-free", "F_d known", linear=True)["leaves", "whole"]
    return linear / case("fault-free", "F_d known")["leaves", "whole"], f"{linear:.2f} mm"


def biased(scenario: str, load: str) -> tuple[float, str]:
    """Return the share of instants with the mean error of a state beyond its 1 % bound; in the note what mends it."""
    found = case(scenario, load)["state", "after" if scenario != "fault-free" else "whole"]
    if scenario != "fault-free":
        strong = case(scenario, load, q_f=1e4 * WALK)["state", "after"]
        return found, f"with a walk (14) ten thousand times as strong {strong:.3f}"
    if load == "no load":
        return found, ""
    return found, f"with F_d constant {case(scenario, load, hmd=0.0)['state', 'whole']:.3f}"


def matches(scenario: str, load: str = "no load", **options: Any) -> float:
    """Return the rms of the fault's error over that of the fault; `options` of `case`."""
    found = case(scenario, load, **options)
    return found["fault error rms", "after"] / found["fault rms", "after"]


def speeds() -> tuple[float, str]:
    """Return how far f_hat of a runaway at 10 deg/s is from that at 20 deg/s: rms over that of the latter."""
    slow, fast = (bench.fly("runaway", seeds=20, rate=share * bench.RATE)["f_hat"].mean(0) for share in (0.5, 1.0))
    late = slice(round(bench.ONSET / bench.DT), None)
    apart = np.std((slow - fast)[late]) / np.std(fast[late])
    return float(apart), f"at 20 deg/s {1e3 * np.abs(fast).max():.0f} mm at most"
