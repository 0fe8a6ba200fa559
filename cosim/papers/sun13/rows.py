"""[Sun13] row by row: designs, fault-free flight, liquid and solid OFC of the left elevator, and what is left out.

Flights are those of section IV at the point of table I: fault at 20 s on the left command, both left segments,
amplitudes 0.016 and 0.033 of the 40 deg of travel ("0.33" in the text is a slip); scenarios `sun13-liquid-ofc`,
`sun13-solid-ofc` and `sun13-both-sides`. f_hat/f is the complex ratio of least-squares sines at the fault's frequency
from 2 s after onset, f the injected signal, s - command for a solid one. The airframe form is judged on the deviation
of the mean elevator, half the difference of the sides, which share one command.
"""

import functools
import math
from typing import Any

import numpy as np

from actuators.constants import RAD_PER_DEG
from actuators.registry import HYDRAULIC
from cosim.flight.blocks.sensors import TRANSPORT
from cosim.flight.plant.point import SIX
from cosim.flight.signals import fly
from cosim.judge.achieved import sine
from cosim.judge.alarms import detection
from cosim.papers.row import Of
from cosim.papers.sun13 import variants
from cosim.scenario import load_scenario
from cosim.scenario.catalog import SEGMENTS as NAMES
from cosim.training import rfafe_noise
from cosim.training.flights import AIRCRAFT, COMMAND, DT, MANOEUVRES, MODULES, estimate, fly_aircraft, side
from cosim.training.rfafe import FLIGHT_S, RANK_E
from fdi.rfafe import rfafe, rfafe_airframe
from fdi.rfafe.store import choose, read

of = Of("sun13")
SHARE = {"ofc_liquid": 0.016, "ofc_solid": 0.033}  # of the normalised travel, section IV
SCENARIO = {"ofc_liquid": "sun13-liquid-ofc", "ofc_solid": "sun13-solid-ofc"}
TRAVEL = 40.0  # [deg]
ONSET = 20.0  # [s]
HZ = (0.5, 1.0, 2.0)
TRACKS = (
    'section IV: estimates "track the actual fault signals in magnitude and frequency"; 10 % can be seen in a figure'
)
INJECTED = "faults.0_left_outer.f_inj"  # [rad]


@functools.cache
def _faulty(kind, hz, turbulence="none", seed=1, onset=ONSET, point="sun13"):
    """Return the flown table, at SIX[point], with an OFC on the left command."""
    changes = {
        "seed": seed,
        "duration_s": onset + 10.5,
        "flight.turbulence": turbulence,
        "faults.0.start_s": onset,
        "faults.0.frequency_hz": hz,
        **{f"flight.{k}": v for k, v in SIX[point].items()},
    }
    asked = load_scenario(SCENARIO[kind], [f"{k}={v}" for k, v in changes.items()])
    return fly(asked, [*AIRCRAFT, INJECTED])


def _fault(r, kind):
    """Return the injected fault f [rad]: what the actuators were told beyond the command."""
    return r[INJECTED].to_numpy() - (r[COMMAND].to_numpy() if kind == "ofc_solid" else 0.0)


def _ratio(r, f_hat, f, hz, start, seconds):
    """Return the complex amplitude ratio f_hat/f at `hz` on `seconds` from `start`."""
    t = r.index.to_numpy()
    on = (t >= start) & (t < start + seconds)
    w = 2.0 * math.pi * hz
    return sine(t[on], f_hat[on], w) / sine(t[on], f[on], w)


def _published(kind, hz, turbulence="none", stored=None):
    r = _faulty(kind, hz, turbulence)
    f_hat = estimate(r, "rfafe", None if stored is None else rfafe.params(stored=stored))["f_hat_left"]
    return _ratio(r, f_hat, _fault(r, kind), hz, ONSET + 2.0, 3.0 / hz)


def _airframe(r, hz, start=ONSET + 2.0, stored=None):
    p = None if stored is None else rfafe_airframe.params(stored=stored)
    achieved = 0.5 * (side(r, "left") - side(r, "right"))
    return _ratio(r, estimate(r, "rfafe_airframe", p)["f_hat"], achieved, hz, start, 8.0)


def _lmis():
    """Return the largest eigenvalue of the left sides of (15), (30), (31) over their size, for the stored design."""
    d = choose("rfafe", "hydraulic", DT)[0]
    PN, TF = d.P @ d.N, d.T @ d.F
    c, r, decay = d.region.centre, d.region.radius, d.region.decay
    sides = {
        "(15)": np.block(
            [
                [PN + PN.T, -PN.T @ TF / d.alpha],
                [-(PN.T @ TF).T / d.alpha, -2 / d.alpha * TF.T @ d.P @ TF + d.G / (d.alpha * d.theta)],
            ]
        ),
        "(30)": np.block([[-r * d.P, c * d.P + PN.T], [c * d.P + PN, -r * d.P]]),
        "(31)": PN + PN.T + 2 * decay * d.P,
    }
    found = {k: np.linalg.eigvalsh(M).max() / np.abs(M).max() for k, M in sides.items()}
    return max(found.values()), ", ".join(f"{k} {v:.1g}" for k, v in found.items())


def _designs():
    yield of.claim(
        "theorem 2, published form: largest eigenvalue of (15), (30), (31) over their size",
        "theorem 2, definitions 2 and 3: negative",
        _lmis,
        -1.0,
        1e-6,
    )
    yield of.ours(
        f"section IV, E of the six fault-free flights: share of its squared singular values that rank {RANK_E} keeps",
        _rank,
        says="(36): the largest are kept; values not printed",
    )
    yield of.ours(
        "(17), published form: largest entry of M on an airframe output over that on positions",
        _positions,
        says="not said; derived: for C = I it is a position monitor",
    )


def _rank():
    sigma = np.linalg.svd(np.array(read("rfafe")["E"]), compute_uv=False)
    words = ", ".join(f"{v:.2g}" for v in sigma)
    return (sigma[:RANK_E] ** 2).sum() / (sigma**2).sum(), f"singular values {words}"


def _positions():
    M = np.abs(np.array(read("rfafe")["designs"]["hydraulic"]["design"]["M"]))
    return (M[:, :4].max(1) / M[:, 4:].max(1)).max()


def _quiet_law():
    """Return {estimator: fault-free flight} with noise for the estimator only: the law flies on clean sensors."""
    r, rng = fly_aircraft(duration=40.0, sensors={"noise_scale": 0.0}), np.random.default_rng(7)
    out = {}
    for form in MODULES:
        out[form] = r.copy()
        for name in ("tas", "alpha", "q", "theta"):
            out[form][f"sensors.{name}.y_obs"] += rng.normal(size=len(r)) * TRANSPORT[name][1]
    positions = [f"sensors.{s}_surface.y_obs" for s in NAMES]
    out["rfafe"][positions] += rng.normal(size=(len(r), 4)) * HYDRAULIC.sensors["surface"].sigma
    return out


@functools.cache
def _noise_level():
    """Return (deviation of f_hat over that predicted through the loop, with clean sensors in the law over that of the
    estimator's own sensors), published form."""
    f, clean = (estimate(r, "rfafe")["f_hat_left"] / RAD_PER_DEG for r in (_still(), _quiet_law()["rfafe"]))
    late = _still().index > 3.0
    own = read("rfafe")["designs"]["hydraulic"]["noise_deg"][0]
    return np.std(f[late]) / rfafe_noise.total(rfafe_noise.predicted()["rfafe"]), np.std(clean[late]) / own


@functools.cache
def _still():
    return fly_aircraft(duration=40.0)


def _fault_free():
    says = 'section IV: "in the fault-free case the estimates are in a noise level"; 20 % between prediction and flight'
    yield of.claim(
        "figure 5, still air: deviation of f_hat over that predicted from sensor noise through law, servos "
        "and estimator",
        says,
        lambda: _noise_level()[0],
        0.8,
        1.2,
    )
    yield of.claim(
        "figure 5, the same with sensor noise in the estimator only", says, lambda: _noise_level()[1], 0.8, 1.2
    )
    yield of.claim(
        "figures 5 and 6: largest amplitude over three periods, fault-free, over the 0.016 fault",
        "figures 5 and 6: the fault stands out of the noise; a fifth can be seen",
        lambda: _amplitude(_still()) / (SHARE["ofc_liquid"] * TRAVEL),
        0.0,
        0.2,
    )


def _amplitude(r):
    """Return the largest amplitude of f_hat at HZ in windows of three periods, from 3 s on [deg]."""
    t, f = r.index.to_numpy(), estimate(r, "rfafe")["f_hat_left"] / RAD_PER_DEG
    return max(
        abs(sine(t[k : k + n], f[k : k + n], 2 * math.pi * hz))
        for hz in HZ
        for n in (round(3.0 / hz / DT),)
        for k in range(600, len(f) - n, n)
    )


def _surfaces():
    """Figures 3 and 4: the left elevator itself, 1 Hz in still air, from 2 s after the onset over 8 s."""
    for figure, kind, says in (
        ("figure 3", "ofc_liquid", '"A sinusoidal signal is added to the normal control surface position"'),
        ("figure 4", "ofc_solid", '"totally substituted by a sinusoidal signal"'),
    ):
        yield of.claim(
            f"{figure}, {SHARE[kind]} of travel at 1 Hz: left elevator's amplitude over it",
            f"section IV: {says}; 10 % can be seen in a figure",
            lambda k=kind: abs(_moved(k)[0]) / (SHARE[k] * TRAVEL),
            0.9,
            1.1,
            ""
            if kind == "ofc_liquid"
            else "servo and actuator follow the sine as the first-order lag (37) "
            "of 12.6 rad/s does; a liquid one is amplified by the law",
        )
    yield of.claim(
        f"figure 4, {SHARE['ofc_solid']} of travel at 1 Hz: rest of the left elevator over it",
        'section IV: "totally substituted by a sinusoidal signal"; a tenth can be seen',
        lambda: _moved("ofc_solid")[1] / (SHARE["ofc_solid"] * TRAVEL),
        0.0,
        0.1,
    )


@functools.cache
def _moved(kind):
    """Return (complex amplitude of the left elevator, rms of what is no sine) [deg]."""
    r = _faulty(kind, 1.0)
    t = r.index.to_numpy()
    on = (t >= ONSET + 2.0) & (t < ONSET + 10.0)
    t, y = t[on], side(r, "left")[on] / RAD_PER_DEG
    a = sine(t, y, 2 * math.pi)
    return a, float(np.std(y - (a * np.exp(2j * math.pi * t)).real))


def _farthest(ratios):
    """Return (size of the ratio that is farthest from 1, all of them)."""
    sizes = {hz: abs(x) for hz, x in ratios.items()}
    told = ", ".join(f"{hz:g} Hz {sizes[hz]:.3f} at {math.degrees(np.angle(x)):.0f} deg" for hz, x in ratios.items())
    return max(sizes.values(), key=lambda x: abs(x - 1.0)), told


def _frequency(kind):
    """Return the frequency [Hz] at which f_hat of a 1 Hz fault has its largest sine over 8 s."""
    r = _faulty(kind, 1.0)
    t = r.index.to_numpy()
    on = (t >= ONSET + 2.0) & (t < ONSET + 10.0)
    f = estimate(r, "rfafe")["f_hat_left"][on]
    tried = np.linspace(0.5, 2.0, 301)
    return tried[np.argmax([abs(sine(t[on], f, 2 * math.pi * hz)) for hz in tried])]


def _periods(kind):
    at = detection(estimate(_faulty(kind, 1.0), "rfafe")["alarm"], 0)
    return at * DT - ONSET if at is not None else math.nan


def _faults():
    for figure, kind in (("figure 6", "ofc_liquid"), ("figure 7", "ofc_solid")):
        what = f"{figure}, {SHARE[kind]} of travel"
        yield of.claim(
            f"{what} at {HZ[0]:g}, {HZ[1]:g} and {HZ[2]:g} Hz, still air: |f_hat/f| farthest from 1",
            TRACKS,
            lambda k=kind: _farthest({hz: _published(k, hz) for hz in HZ}),
            0.9,
            1.1,
        )
        yield of.claim(
            f"{what} at 1 Hz: frequency of the estimate [Hz]", TRACKS, lambda k=kind: _frequency(k), 0.95, 1.05
        )
        yield of.ours(
            f"{what} at 1 Hz, light turbulence: |f_hat/f|", lambda k=kind: abs(_published(k, 1.0, "light")), 0.94, 1.06
        )
        yield of.ours(
            f"{what} at 1 Hz: alarm after so many periods",
            lambda k=kind: _periods(k),
            0.0,
            3.0,
            says="not said; our decision",
        )


@functools.cache
def _six(turbulence="none", aero=()):
    """Return the six fault-free flights."""
    return [
        fly_aircraft(
            duration=FLIGHT_S, manoeuvre=kind, flight={"turbulence": turbulence}, tolerances={"aero": dict(aero)}
        )
        for kind in MANOEUVRES
    ]


def _rms(flights, stored):
    p = rfafe.params(stored=stored)
    parts = [estimate(r, "rfafe", p)["f_hat_left"][600:] for r in flights]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)) / RAD_PER_DEG)


def _decoupled(source):
    """Return rms of f_hat with coefficients 5 % off over six flights, E from `source` over no E; the same in gusts."""
    off, gusts = _six("none", variants.WRONG), _six("moderate")
    ratio, gusty = (_rms(s, variants.published(source)) / _rms(s, variants.published("no E")) for s in (off, gusts))
    return ratio, f"of {_rms(off, variants.published('no E')):.3f} deg; {gusty:.3f} in moderate turbulence"


def _decoupling():
    """The central claim: does decoupling E make the estimate robust?"""
    yield of.claim(
        "six fault-free flights, Cm_alpha +5 %, Cm_de -5 %: rms of f_hat over that with nominal coefficients",
        'section IV: "not significantly affected by the modelling uncertainties"; 20 % is ours',
        lambda: _rms(_six("none", variants.WRONG), None) / _rms(_six(), None),
        0.8,
        1.2,
    )
    for source in list(variants.SOURCES)[1:]:
        item = f"six fault-free flights, coefficients 5 % off: rms of f_hat with E of {source} over that without E"
        if source == "six flights":
            yield of.claim(
                item,
                'section I: "by making the output error insensitive to modelling uncertainty the fault '
                'estimation robustness is improved": below 0.9',
                lambda s=source: _decoupled(s),
                0.0,
                0.9,
                "the published form is a position monitor (row (17)): its gain has no entry on an airframe "
                "output, so that no error of the airframe, decoupled or not, reaches f_hat",
            )
        else:
            yield of.ours(item, lambda s=source: _decoupled(s), says="not in the paper: E of other flights")


@functools.cache
def _rate(bandwidth):
    """Return (|f_hat/f| at 2 Hz, noise of the design [deg]) at a loop bandwidth [rad/s]."""
    stored = variants.published("six flights", bandwidth)
    return abs(_published("ofc_liquid", 2.0, stored=stored)), stored["designs"]["hydraulic"]["noise_deg"][0]


def _learning():
    says = 'section IV: the learning rate "should be tuned to a suitable value to achieve accurate and fast estimation"'
    yield of.claim(
        "learning rate a quarter of ours: |f_hat/f| at 2 Hz", says + ": too slow", lambda: _rate(10.0)[0], 0.0, 0.9
    )
    yield of.claim(
        "learning rate four times ours: noise of f_hat over ours",
        says + '; "influenced by high frequency sensor noise": too noisy',
        lambda: _rate(160.0)[1] / _rate(40.0)[1],
        1.2,
        10.0,
    )


def _airframe_only():
    for hz in HZ:
        yield of.ours(
            f"airframe outputs only, liquid at {hz:g} Hz, still air: |f_hat/f| over 8 s",
            lambda h=hz: abs(_airframe(_faulty("ofc_liquid", h), h)),
            0.85,
            1.15,
        )
    yield of.ours(
        "airframe outputs only, one design flown at points A to E, liquid at 1 Hz: |f_hat/f| farthest from 1",
        lambda: _points(lambda _: None),
        says="not in the paper: one LTI model, one point",
    )
    yield of.beyond(
        "airframe outputs only, a design for each of points A to E, liquid at 1 Hz: |f_hat/f| farthest from 1",
        "our extension: the design scheduled over flight points",
        lambda: _points(variants.airframe),
        0.85,
        1.15,
    )


@functools.cache
def _points(design):
    found = {p: abs(_airframe(_faulty("ofc_liquid", 1.0, point=p), 1.0, stored=design(p))) for p in "ABCDE"}
    return max(found.values(), key=lambda x: abs(x - 1.0)), ", ".join(f"{p} {x:.2f}" for p, x in found.items())


@functools.cache
def _both():
    """Return |f_hat/f| of each side, 1 Hz on the left and 2 Hz on the right at once, and the leak between them."""
    right = INJECTED.replace("0_left", "1_right")
    r = fly(load_scenario("sun13-both-sides"), [*AIRCRAFT, INJECTED, right])
    log = estimate(r, "rfafe")
    own = [
        abs(_ratio(r, log[f"f_hat_{s}"], r[name].to_numpy(), hz, ONSET + 2.0, 8.0))
        for s, name, hz in (("left", INJECTED, 1.0), ("right", right, 2.0))
    ]
    leak = [
        abs(_ratio(r, log[f"f_hat_{s}"], r[name].to_numpy(), hz, ONSET + 2.0, 8.0))
        for s, name, hz in (("left", right, 2.0), ("right", INJECTED, 1.0))
    ]
    return own, leak


def _sides():
    says = '(1): "columns of F_a denote the independent fault directions"; section I looks at the left only'
    yield of.beyond(
        "both sides at once, left 1 Hz, right 2 Hz: |f_hat/f| farthest from 1",
        says,
        lambda: (max(_both()[0], key=lambda x: abs(x - 1.0)), "left {:.3f}, right {:.3f}".format(*_both()[0])),
        0.9,
        1.1,
    )
    yield of.beyond(
        "both sides at once: largest share of one side's fault in the other's estimate",
        says,
        lambda: max(_both()[1]),
        0.0,
        0.1,
    )


def plan() -> list[Any]:
    """Return what is asked of [Sun13], in the paper's order, then of the airframe form and of both sides."""
    own = [*_designs(), *_surfaces(), *_fault_free(), *_faults(), *_decoupling(), *_learning()]
    return [*own, *_airframe_only(), *_sides()]
